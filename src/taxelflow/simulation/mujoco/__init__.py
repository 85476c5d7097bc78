"""Closed loop in MuJoCo: a gripper with two taxel pads, objects, and what happens to them (extra `sim`)."""
