"""The object's motion in space: six degrees of freedom from pads on moving links."""
