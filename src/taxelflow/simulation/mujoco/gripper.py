"""A parallel gripper with a taxel pad on each finger. A force per pad goes in, both pads' readings come out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.mujoco.camera import View
from taxelflow.simulation.mujoco.gripper_model import SIDES, mjcf
from taxelflow.simulation.mujoco.plant import Actuator, Held, Plant, Truth
from taxelflow.simulation.mujoco.plants import CONTACT, GRIPPER
from taxelflow.simulation.mujoco.scene import add_contacts
from taxelflow.simulation.mujoco.skin import Skin

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.mujoco.events import Load

_FACING = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, 0.5))
"""Quaternions of the pads: z out of the skin to the other pad, y up, x along world y and against it."""


@dataclass
class Gripper:
    """The plant at work. Raises ExtraMissing without MuJoCo (extra `sim`)."""

    held: Held
    skin: Skin = field(default_factory=Skin)
    actuator: Actuator = field(default_factory=Actuator)
    rate_hz: float = 100.0
    seed: int = 0
    joint_names = ("left_m", "right_m")
    view = View((0.0, 0.0, 0.02), 0.36, 62.0, -16.0)

    def __post_init__(self) -> None:
        pads = [(side, self.skin) for side in SIDES]
        self._plant = Plant(self._spec, pads, self.held, self.actuator, rate_hz=self.rate_hz, seed=self.seed)
        self.model, self.data = self._plant.model, self._plant.data
        self.sensor = sensor_of(self.skin)

    @property
    def t_s(self) -> float:
        """Time since the start."""
        return self._plant.t_s

    @property
    def down(self) -> Floats:
        """(2,): the pads' y axes point up."""
        return np.array([0.0, -1.0])

    @property
    def joints(self) -> Floats:
        """(2,), how far each pad has closed, m."""
        return np.array(self.data.qpos[:2])

    def scan(self, force_n: float, load: Load) -> tuple[Floats, Truth]:
        """Let one scan period pass with a commanded force of each pad (below 0: open); readings (2, taxels) in Pa."""
        readings, truth = self._plant.scan(force_n, load, lambda due_n: due_n)
        return np.stack(readings), truth

    def pressure(self, side: int, normal_n: float) -> Floats:
        """(taxels,), Pa, what the taxels of a pad carry now, without noise."""
        return self._plant.pressure(side, normal_n)

    def grasps(self, truth: Truth, force_n: float) -> bool:
        """Whether each pad has half of that force or more."""
        return bool((truth.normal_n > CONTACT.grasped * force_n).all())

    def _spec(self, mujoco: Any) -> Any:
        spec = mujoco.MjSpec.from_string(mjcf(self.held.shape, self.held.inertial(), self.skin, self.actuator))
        add_contacts(spec, SIDES, self.held.friction)
        return spec


def sensor_of(skin: Skin) -> Sensor:
    """The gripper's two pads as a sensor, left before right."""
    pitch = (skin.pitch_m, skin.pitch_m)
    pads = tuple(
        Pad(side, rows=skin.rows, cols=skin.cols, pitch_m=pitch, pose=(x_m, 0.0, 0.0, *quaternion))
        for side, x_m, quaternion in zip(SIDES, (-GRIPPER.jaw_m, GRIPPER.jaw_m), _FACING, strict=True)
    )
    return Sensor("two-pad-gripper", "Pa", pads, full_scale=skin.full_scale_pa, unseen_error=0.0)
