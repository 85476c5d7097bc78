"""A second contact model: a rigid relief pressed on an elastic foundation, with balance of load and moment.

It shares neither equations nor code with the pressure patterns of the rig, and no code with any estimator. At an
exponent of 1 its law of pressure is that of the depth in `template`.
"""
