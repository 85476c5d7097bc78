"""Work beside a stream of scans, and when its results are put to use."""
