"""Slips -> Motions: one motion of the object from all pads."""
