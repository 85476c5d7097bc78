"""Grip controllers: what two pads feel in, a force per pad out.

Read `base` for the protocol, `touch` for a controller's input, then one file per controller.
"""
