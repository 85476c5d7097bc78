"""Readers and writers of recordings: files to `RawScans` and back."""
