"""Methods that reduce a scan to one place: the paper's two, and the baselines."""
