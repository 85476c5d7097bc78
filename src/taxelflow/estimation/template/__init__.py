"""The learned pressure pattern: a spline in the object's frame, and the poses of scans on it."""
