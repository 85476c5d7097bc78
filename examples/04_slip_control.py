"""Slip-driven control, the paper's purpose, on the rig: hold an object that grows heavier, and let one slip 5 mm.

The plant is the simplest that slips: the object moves when its weight exceeds friction, with a velocity that grows with
the excess. The controllers know the readings of the taxels only. Run it: python examples/04_slip_control.py
"""

from dataclasses import dataclass, field

import numpy as np

from taxelflow import Conditioner, Pipeline, RawScans, Recording, estimator, load_sensor
from taxelflow.simulation.contact import taxel_pressure
from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import Contact, Load, Sensing
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.sensing import sense

SENSOR = load_sensor("grid-16x16")
LAYOUT = SENSOR.layout
PERIOD_S, FRICTION, DRAG_N_S_M = 0.01, 0.5, 40.0
CONTACT = Contact("elongated", radius_m=0.008, aspect=1.5, peak_pa=40e3)
SENSING = Sensing(noise_pa=40.0, baseline_pa=(0.0, 0.0), bits=12)
GRIP_0_N = 10.0


@dataclass
class Grasp:
    """An object between a fingertip and its twin: `grip_n` is commanded, `weight_n` pulls it down along -y."""

    grip_n: float = GRIP_0_N
    weight_n: float = 3.0
    slid_m: float = 0.0
    t_s: float = 0.0
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    pattern: Analytic = field(default_factory=lambda: Analytic(CONTACT, Load(), seed=0))

    def scan(self) -> RawScans:
        """Let one period pass and read the taxels."""
        excess_n = self.weight_n - FRICTION * self.grip_n
        self.slid_m += max(excess_n, 0.0) / DRAG_N_S_M * PERIOD_S
        self.t_s += PERIOD_S
        pose = np.array([[[0.0, 0.01 - self.slid_m, 0.0]]])
        zero = np.zeros((1, 1))
        state = State(zero + self.grip_n / GRIP_0_N, zero, zero, zero, zero)
        pressure = taxel_pressure(self.pattern, pose, state, LAYOUT.x_m, LAYOUT.y_m, (0.0036, 0.0036))
        now = np.array([self.t_s])
        return RawScans(now, sense(SENSING, pressure, now, self.random) / SENSOR.to_si)


class Touch:
    """taxelflow as a controller sees it: slipping or not, and how far."""

    def __init__(self) -> None:
        pipeline = Pipeline(estimator("convolution"), "stream", Conditioner(tare="none"))
        self.run = pipeline.start(Recording.live(SENSOR))
        self.start_m, self.felt_m = np.nan, 0.0

    def slips(self, scan: RawScans) -> bool:
        out = self.run.step(scan)
        if not len(out):
            return False
        at_m = float(out.slips.pose[-1, 0, 1])
        self.start_m = at_m if np.isnan(self.start_m) else self.start_m
        self.felt_m = self.start_m - at_m if np.isfinite(at_m) else self.felt_m
        return bool(out.slipping[-1, 0])


def hold(*, controlled: bool) -> Grasp:
    """The weight doubles in 4 s: raise the grip whenever the object slips, and keep it."""
    grasp, touch = Grasp(), Touch()
    for step in range(500):
        grasp.weight_n = 3.0 + 3.0 * min(step / 400, 1.0)
        if touch.slips(grasp.scan()) and controlled:
            grasp.grip_n += 0.25
    return grasp


def let_slip(distance_m: float) -> tuple[Grasp, Touch]:
    """Loosen the grip until the object slips, hold it there, and close when it has gone far enough."""
    grasp, touch = Grasp(), Touch()
    for _ in range(1500):
        slipping = touch.slips(grasp.scan())
        if touch.felt_m >= distance_m:
            grasp.grip_n = GRIP_0_N
        elif not slipping and grasp.t_s > 0.5:
            grasp.grip_n -= 0.02
    return grasp, touch


loose, held = hold(controlled=False), hold(controlled=True)
print(f"weight doubles: slid {1e3 * loose.slid_m:.1f} mm with a fixed grip of {loose.grip_n:.1f} N,")
print(f"                {1e3 * held.slid_m:.1f} mm with slip control, which ended at {held.grip_n:.1f} N")
grasp, touch = let_slip(0.005)
print(f"asked for 5.0 mm: felt {1e3 * touch.felt_m:.1f} mm, slid {1e3 * grasp.slid_m:.1f} mm in truth")
