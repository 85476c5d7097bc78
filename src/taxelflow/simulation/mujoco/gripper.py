"""The plant: a parallel gripper with a taxel pad on each finger. A force per pad goes in, both pads' readings come out.

What MuJoCo's tactile sensor says about speed is the truth and stays here; only depths become pressure.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.mujoco.model import SIDES, TIMESTEP_S, add_contacts, mjcf
from taxelflow.simulation.mujoco.skin import Skin

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.mujoco.events import Load
    from taxelflow.simulation.mujoco.objects import Shape

_GYRATION_M2 = 0.05**2 / 3
"""Moment of inertia over mass, that of a cube of 71 mm."""
_JAW_M = 0.025
"""Place of a pad in the sensor's description; the jaws move, and only their directions matter."""
_FACING = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, 0.5))
"""Quaternions of the pads: z out of the skin to the other pad, y up, x along world y and against it."""
_SLIDING_M_S = 1e-3
"""Speed from which on kinetic friction acts, where it differs from static."""


@dataclass(frozen=True)
class Actuator:
    """How commanded force becomes force."""

    bandwidth_hz: float = 10.0
    """Of the first-order lag between command and force."""
    latency_s: float = 0.0
    """Delay of the command, rounded to whole scans."""
    max_n: float = 40.0
    """Largest force of a pad."""

    def __post_init__(self) -> None:
        if not 0 < self.bandwidth_hz < float("inf"):
            raise ParameterInvalid("actuator.bandwidth_hz", self.bandwidth_hz, "be a finite number above 0")
        if not 0 <= self.latency_s <= 1:
            raise ParameterInvalid("actuator.latency_s", self.latency_s, "be from 0 to 1 s")
        if not 0 < self.max_n < float("inf"):
            raise ParameterInvalid("actuator.max_n", self.max_n, "be a finite number above 0")


@dataclass(frozen=True)
class Held:
    """What is between the pads."""

    shape: Shape
    mass_kg: float
    friction: float
    """Static coefficient."""
    kinetic: float = 1.0
    """Kinetic friction over static."""
    offset_m: tuple[float, float] = (0.0, 0.0)
    """Centre of mass along world y and z, against the shape's origin."""


@dataclass(frozen=True)
class Truth:
    """State of the plant after a scan, which no controller sees.

    slid_m: (2,), place of the object's origin along world y and z. turned_rad: about world x. normal_n, (2,): force of
    each pad. speed_m_s: of the object's origin along the pads.
    """

    t_s: float
    slid_m: Floats
    turned_rad: float
    normal_n: Floats
    speed_m_s: float


@dataclass
class Gripper:
    """The plant at work. Raises ExtraMissing without MuJoCo (extra `sim`)."""

    held: Held
    skin: Skin = field(default_factory=Skin)
    actuator: Actuator = field(default_factory=Actuator)
    rate_hz: float = 100.0
    seed: int = 0

    def __post_init__(self) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise ExtraMissing("sim", "mujoco") from error
        self._mujoco: Any = mujoco
        steps = 1.0 / self.rate_hz / TIMESTEP_S
        if not (steps >= 1 and abs(steps - round(steps)) < 1e-6):
            raise ParameterInvalid("rate_hz", self.rate_hz, f"divide {1 / TIMESTEP_S:g} Hz, the rate of the solver")
        held = self.held
        (y_m, z_m), moment = held.offset_m, held.mass_kg * _GYRATION_M2
        inertial = f'pos="0 {y_m} {z_m}" mass="{held.mass_kg}" diaginertia="{moment} {moment} {moment}"'
        actuator = self.actuator
        text = mjcf(held.shape, self.skin, actuator.bandwidth_hz, actuator.max_n, inertial)
        spec = mujoco.MjSpec.from_string(text)
        add_contacts(spec, held.friction)
        if held.shape.mesh:
            spec.mesh("object").needsdf = True  # else the tactile sensor silently reads 0
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        self._body = self.model.body("object").id
        self._pads = [self.model.geom(f"{side}_pad").id for side in SIDES]
        self._order = self._vertex_order()
        self._delayed = deque([0.0] * round(self.actuator.latency_s * self.rate_hz))
        self._steps = round(steps)
        self._random = np.random.default_rng(self.seed)

    @property
    def t_s(self) -> float:
        """Time since the start."""
        return float(self.data.time)

    @property
    def closed_m(self) -> Floats:
        """(2,), how far each pad has closed."""
        return np.array(self.data.qpos[:2])

    def scan(self, force_n: float, load: Load) -> tuple[Floats, Truth]:
        """Let one scan period pass with a commanded force of each pad (below 0: open); readings (2, taxels) in Pa."""
        self._delayed.append(force_n)
        self.data.ctrl[:] = np.clip(self._delayed.popleft(), -self.actuator.max_n, self.actuator.max_n)
        self._set_mass(load.mass_kg)
        self.model.opt.gravity[:] = load.gravity
        self.data.xfrc_applied[self._body, :3] = load.pull
        off = int(self._mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self.model.opt.disableflags |= off  # depths cost more than a step, and only the last are read
        for step in range(self._steps):
            if self.held.kinetic != 1.0:
                sliding = float(np.linalg.norm(self.data.qvel[-5:-3])) > _SLIDING_M_S
                factor = self.held.kinetic if sliding else 1.0
                self.model.pair_friction[:, :2] = factor * self.held.friction
            if step == self._steps - 1:
                self.model.opt.disableflags &= ~off
            self._mujoco.mj_step(self.model, self.data)
        truth = self._truth()
        readings = np.stack([self._reading(side, truth.normal_n[side]) for side in range(2)])
        return readings, truth

    def pressure(self, side: int, normal_n: float) -> Floats:
        """(taxels,), Pa, what the taxels of a pad carry now, without noise."""
        depth = self.data.sensor(SIDES[side]).data[: len(self._order[side])][self._order[side]]
        return self.skin.pressure(depth, normal_n)

    def _reading(self, side: int, normal_n: float) -> Floats:
        return self.skin.read(self.pressure(side, normal_n), self._random)

    def _set_mass(self, mass_kg: float) -> None:
        self.model.body_mass[self._body] = mass_kg
        self.model.body_inertia[self._body] = mass_kg * _GYRATION_M2

    def _vertex_order(self) -> list[Any]:
        """Indices that bring MuJoCo's vertices, which it sorts anew, into the order of the skin's places."""
        self._mujoco.mj_forward(self.model, self.data)
        mesh = self.model.mesh("skin").id
        start, count = self.model.mesh_vertadr[mesh], self.model.mesh_vertnum[mesh]
        vertices = self.model.mesh_vert[start : start + count]
        orders = []
        for side, across in zip(SIDES, (1.0, -1.0), strict=True):
            geom = self.model.geom(f"{side}_skin").id
            world = vertices @ self.data.geom_xmat[geom].reshape(3, 3).T + self.data.geom_xpos[geom]
            orders.append(np.lexsort((np.round(across * world[:, 1], 7), -np.round(world[:, 2], 7))))
        return orders

    def _truth(self) -> Truth:
        body = self.data.body("object")
        turn = body.xmat.reshape(3, 3)
        turned = float(np.arctan2(turn[2, 1], turn[1, 1]))
        speed = float(np.linalg.norm(self.data.qvel[-5:-3]))
        return Truth(self.t_s, body.xpos[1:].copy(), turned, self._normal_n(), speed)

    def _normal_n(self) -> Floats:
        """(2,): normal force of each pad, from the solver's contacts."""
        force, normal = np.zeros(6), np.zeros(2)
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            for side, pad in enumerate(self._pads):
                if pad in (contact.geom1, contact.geom2):
                    self._mujoco.mj_contactForce(self.model, self.data, number, force)
                    normal[side] += force[0]
        return normal


def sensor_of(skin: Skin) -> Sensor:
    """The gripper's two pads as a sensor, left before right."""
    pitch = (skin.pitch_m, skin.pitch_m)
    pads = tuple(
        Pad(side, rows=skin.rows, cols=skin.cols, pitch_m=pitch, pose=(x_m, 0.0, 0.0, *quaternion))
        for side, x_m, quaternion in zip(SIDES, (-_JAW_M, _JAW_M), _FACING, strict=True)
    )
    return Sensor("two-pad-gripper", "Pa", pads, full_scale=skin.full_scale_pa, unseen_error=0.0)
