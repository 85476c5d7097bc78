"""A live loop: push scans as they come, get slips, motion and events at once; nothing here knows the future.

Run it: python examples/02_live_loop.py
"""

from taxelflow import Live
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

device = simulate(SCENARIOS["stroke"])  # your driver goes here: anything that gives a time and the taxels' readings

live = Live(device.sensor, method="convolution")  # compiles the kernels
for block in device.blocks():
    for t_s, readings in zip(block.t_s, block.values, strict=True):
        out = live.step(t_s, readings)  # empty for the first 11 scans: noise and tare are learned
        for event in out.events:
            print(f"{event.t_s:7.3f} s  {event.pad}: {event.event}")
        for scan, pad in zip(*out.slipping.nonzero(), strict=True):
            vx, vy, _ = 1e3 * out.slips.velocity[scan, pad]
            print(f"{out.slips.t_s[scan]:7.3f} s  {live.pads[pad]} slips at ({vx:+.1f}, {vy:+.1f}) mm/s")
live.finish()
