"""Grip controllers: what two pads feel in, a force per pad out.

Read `base` for the protocol, `touch` for what a controller is told, then one file per controller.
"""
