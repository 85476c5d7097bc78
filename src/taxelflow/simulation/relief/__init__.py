"""A second contact model: a rigid relief pressed on an elastic foundation, with balance of load and moment.

It shares neither equations nor code with the pressure patterns of the rig, nor with any estimator.
"""
