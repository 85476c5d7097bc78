"""Devices that are not there: they send recordings or simulated scans by the protocols of real ones, with faults."""
