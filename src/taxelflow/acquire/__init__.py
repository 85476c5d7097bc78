"""World -> RawScans: readers of recordings and the simulated rig."""
