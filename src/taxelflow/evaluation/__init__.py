"""Recordings with truth -> numbers: accuracy and speed."""
