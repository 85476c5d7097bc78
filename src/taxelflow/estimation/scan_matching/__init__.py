"""Two scans against each other: the earlier one as a spline, the later one registered on it."""
