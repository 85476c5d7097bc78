"""The stages by hand, scan by scan, as in a control loop: nothing here knows the future.

Run it: python examples/02_live_loop.py
"""

from taxelflow import Conditioner, RawScans, SlipMonitor, estimator
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

device = simulate(SCENARIOS["stroke"])  # your driver goes here: anything that gives a time and the taxels' readings
sensor, layout = device.sensor, device.layout

condition = Conditioner().start(sensor, device.masked, lookahead=None)
estimate = estimator("convolution").start(layout, "stream")
monitor = SlipMonitor().begin(layout.pads)

for block in device.blocks():
    for t_s, readings in zip(block.t_s, block.values, strict=True):
        scan = RawScans(t_s[None], readings[None])
        for clean in condition.step(scan):  # nothing for the first 12 scans, from which noise and tare are learned
            slips = estimate.step(clean)
            slipping, events = monitor.step(slips)
            for event in events:
                print(f"{event.t_s:7.3f} s  {event.pad}: {event.event}")
            for pad in slipping[0].nonzero()[0]:
                vx, vy, _ = 1e3 * slips.velocity[0, pad]
                print(f"{t_s:7.3f} s  {layout.pads[pad]} slips at ({vx:+.1f}, {vy:+.1f}) mm/s")
