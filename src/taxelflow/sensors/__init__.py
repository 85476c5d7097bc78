"""What all stages share about a sensor: its pads, layout, channels, calibration; and the built-in sensors."""
