"""RawScans -> Scans: units, tare, noise, missing taxels, contact."""
