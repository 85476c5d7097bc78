"""The loop that runs for hours: sources in, estimates out, nothing lost."""
