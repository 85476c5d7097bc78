"""What all plants share: the solver's steps, what the taxels read, and the truth.

What MuJoCo's tactile sensor reports of speed is the truth and stays here; only depths become pressure.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.numerics.geometry import se3_inverse
from taxelflow.runtime.checks import positive
from taxelflow.simulation.mujoco.camera import Viewed
from taxelflow.simulation.mujoco.plants import CONTACT, SOLVER

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.mujoco.events import Load
    from taxelflow.simulation.mujoco.objects import Shape
    from taxelflow.simulation.mujoco.skin import Skin

GYRATION_M2 = 0.05**2 / 3
"""Moment of inertia over mass, that of a cube of 71 mm."""


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
        positive("actuator.bandwidth_hz", self.bandwidth_hz)
        if not 0 <= self.latency_s <= 1:
            raise ParameterInvalid("actuator.latency_s", self.latency_s, "be from 0 to 1 s")
        positive("actuator.max_n", self.max_n)


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

    def inertial(self) -> str:
        """Attributes of the object's mass in MJCF; contacts are as soft as the masses at compile time make them."""
        (y_m, z_m), moment = self.offset_m, self.mass_kg * GYRATION_M2
        return f'pos="0 {y_m} {z_m}" mass="{self.mass_kg}" diaginertia="{moment} {moment} {moment}"'


@dataclass(frozen=True)
class Truth:
    """State of the plant after a scan, which no controller sees.

    slid_m: (2,), place of the object's origin along world y and z. turned_rad: about world x. normal_n: (pads,), force
    of each pad. speed_m_s: of the object's origin along the pads. T_pad_object: (pads, 4, 4), pose of the object in
    each pad's frame. twist: (pads, 6), of the object relative to each pad, in that pad's frame: the velocity of the
    object's origin, m/s, then its rate of rotation, rad/s.
    """

    t_s: float
    slid_m: Floats
    turned_rad: float
    normal_n: Floats
    speed_m_s: float
    T_pad_object: Floats
    twist: Floats

    @property
    def force_n(self) -> float:
        """Force of the grip: half of all pads' normal forces. Friction carries 2 mu times as much."""
        return float(self.normal_n.sum()) / 2


class Grip(Viewed, Protocol):
    """A plant with a force to command: the gripper or a hand."""

    @property
    def rate_hz(self) -> float:
        """Scans a second."""
        ...

    @property
    def t_s(self) -> float:
        """Time since the start."""
        ...

    @property
    def sensor(self) -> Sensor:
        """Pads and taxels of its scans."""
        ...

    @property
    def down(self) -> Floats:
        """(n,), unit vector of gravity in the grip's frame, see `Touch`; its own acceleration is along it."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints with their unit, such as `f1_rad`."""
        ...

    @property
    def joints(self) -> Floats:
        """(joints,), now."""
        ...

    def scan(self, force_n: float, load: Load) -> tuple[Floats, Truth]:
        """Let one scan period pass with a commanded force (below 0: open); readings in the sensor's unit."""
        ...

    def grasps(self, truth: Truth, force_n: float) -> bool:
        """Whether the object is between the pads, with half of that force or more."""
        ...


class Plant:
    """The solver at work. Each pad NAME has a geom NAME_pad, a sheet NAME_skin, a tactile sensor and a site NAME.

    The site is the pad's frame. The object is the body `object`.
    """

    def __init__(
        self,
        build: Callable[[Any], Any],
        pads: Sequence[tuple[str, Skin]],
        held: Held,
        actuator: Actuator,
        *,
        rate_hz: float,
        seed: int,
    ) -> None:
        """build: MuJoCo's module to an MjSpec. Raises ExtraMissing without MuJoCo (extra `sim`), ParameterInvalid."""
        try:
            import mujoco
        except ImportError as error:
            raise ExtraMissing("sim", "mujoco") from error
        self._mujoco: Any = mujoco
        steps = 1.0 / rate_hz / SOLVER.timestep_s
        if not (steps >= 1 and abs(steps - round(steps)) < 1e-6):
            raise ParameterInvalid("rate_hz", rate_hz, f"divide {1 / SOLVER.timestep_s:g} Hz, the rate of the solver")
        self._steps, self._held, self._actuator = round(steps), held, actuator
        spec = build(mujoco)
        if held.shape.mesh:
            spec.mesh("object").needsdf = True  # else the tactile sensor silently reads 0
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        self._names, self.skins = [name for name, _ in pads], [skin for _, skin in pads]
        self._body, self._first_dof = self.model.body("object").id, int(self.model.body("object").dofadr[0])
        self._geoms = {self.model.geom(f"{name}_pad").id: number for number, name in enumerate(self._names)}
        self._sites = [self.model.site(name).id for name in self._names]
        mujoco.mj_forward(self.model, self.data)
        self._orders = [self._vertex_order(name) for name in self._names]
        self._delayed = deque([0.0] * round(actuator.latency_s * rate_hz))
        self._random = np.random.default_rng(seed)

    @property
    def t_s(self) -> float:
        """Time since the start."""
        return float(self.data.time)

    def scan(
        self, force_n: float, load: Load, controls: Callable[[float], Floats | float]
    ) -> tuple[list[Floats], Truth]:
        """Let one scan period pass with a commanded force; readings of each pad (taxels,) in Pa.

        controls: from the force that is due now to MuJoCo's actuators.
        """
        self._delayed.append(force_n)
        due_n = float(np.clip(self._delayed.popleft(), -self._actuator.max_n, self._actuator.max_n))
        self.data.ctrl[:] = controls(due_n)
        self._set_mass(load.mass_kg)
        self.model.opt.gravity[:] = load.gravity
        self.data.xfrc_applied[self._body, :3] = load.pull
        off = int(self._mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self.model.opt.disableflags |= off  # depths cost more than a step, and only the last are read
        for step in range(self._steps):
            if self._held.kinetic != 1.0:
                factor = self._held.kinetic if self._speed() > CONTACT.sliding_m_s else 1.0
                self.model.pair_friction[:, :2] = factor * self._held.friction
            if step == self._steps - 1:
                self.model.opt.disableflags &= ~off
            self._mujoco.mj_step(self.model, self.data)
        truth = self.truth()
        pressures = [self.pressure(pad, normal_n) for pad, normal_n in enumerate(truth.normal_n.tolist())]
        return [skin.read(one, self._random) for skin, one in zip(self.skins, pressures, strict=True)], truth

    def pressure(self, pad: int, normal_n: float) -> Floats:
        """(taxels,), Pa, what the taxels of a pad carry now, without noise."""
        order = self._orders[pad]
        depth = self.data.sensor(self._names[pad]).data[: len(order)][order]
        return self.skins[pad].pressure(depth, normal_n)

    def truth(self) -> Truth:
        """The state now."""
        body = self.data.body("object")
        turn = body.xmat.reshape(3, 3)
        turned = float(np.arctan2(turn[2, 1], turn[1, 1]))
        T_world_object = _pose(body.xpos, turn)
        T_pad_world = se3_inverse(np.stack([self._frame(pad) for pad in range(len(self._names))]))
        twist = np.stack([self._twist(pad) for pad in range(len(self._names))])
        slid_m = body.xpos[1:].copy()
        return Truth(self.t_s, slid_m, turned, self._normal_n(), self._speed(), T_pad_world @ T_world_object, twist)

    def _speed(self) -> float:
        return float(np.linalg.norm(self.data.qvel[self._first_dof + 1 : self._first_dof + 3]))

    def _frame(self, pad: int) -> Floats:
        """T_world_pad."""
        site = self._sites[pad]
        return _pose(self.data.site_xpos[site], self.data.site_xmat[site].reshape(3, 3))

    def _twist(self, pad: int) -> Floats:
        """(6,): of the object relative to a pad, at the object's origin, in the pad's frame."""
        T, kinds, twists = self._frame(pad), self._mujoco.mjtObj, np.zeros((2, 6))
        for kind, number, twist in (
            (kinds.mjOBJ_XBODY, self._body, twists[0]),
            (kinds.mjOBJ_SITE, self._sites[pad], twists[1]),
        ):
            self._mujoco.mj_objectVelocity(self.model, self.data, kind, number, twist, 0)  # rotation first
        lever = self.data.xpos[self._body] - T[:3, 3]
        turning = twists[0, :3] - twists[1, :3]
        moving = twists[0, 3:] - twists[1, 3:] - np.cross(twists[1, :3], lever)
        return np.concatenate([moving @ T[:3, :3], turning @ T[:3, :3]])

    def _set_mass(self, mass_kg: float) -> None:
        self.model.body_mass[self._body] = mass_kg
        self.model.body_inertia[self._body] = mass_kg * GYRATION_M2

    def _vertex_order(self, name: str) -> Any:
        """Indices that bring MuJoCo's vertices, which it sorts, into the order of the skin's places."""
        geom = self.model.geom(f"{name}_skin").id
        mesh = self.model.geom_dataid[geom]
        start, count = self.model.mesh_vertadr[mesh], self.model.mesh_vertnum[mesh]
        local = self.model.mesh_vert[start : start + count]
        world = local @ self.data.geom_xmat[geom].reshape(3, 3).T + self.data.geom_xpos[geom]
        T = self._frame(self._names.index(name))
        x, y, _ = np.round((world - T[:3, 3]) @ T[:3, :3], 7).T
        return np.lexsort((x, -y))

    def _normal_n(self) -> Floats:
        """(pads,): normal force of each pad, from the solver's contacts."""
        force, normal = np.zeros(6), np.zeros(len(self._names))
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            for geom in (contact.geom1, contact.geom2):
                if geom in self._geoms:
                    self._mujoco.mj_contactForce(self.model, self.data, number, force)
                    normal[self._geoms[geom]] += force[0]
        return normal


def _pose(position: Floats, rotation: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, position
    return T
