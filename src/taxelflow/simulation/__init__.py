"""The simulated rig: a known object, moved in a known way, over taxels with known errors."""
