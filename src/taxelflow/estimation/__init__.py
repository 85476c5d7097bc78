"""Scans -> Slips: the motion seen by each pad, by method."""
