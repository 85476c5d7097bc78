"""Sinks: where a live run's results go."""
