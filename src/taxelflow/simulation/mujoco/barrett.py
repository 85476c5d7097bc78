"""The BarrettHand from primitives: links, joints, pads and taxels are those of its sensor file.

The hand lies on its side and grasps an upright object: hand x is world z (up), hand y is world x, the closing axis of
its fingers, and the palm looks along world y. Its fingers close alike, with the published coupling of their outer
joints; the clutch that lets these close on is not modelled. Only pads touch the object.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from taxelflow.numerics.geometry import quaternion_of, se3_of
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.kinematics import model_text
from taxelflow.simulation.mujoco.camera import View
from taxelflow.simulation.mujoco.plant import Actuator, Held, Plant, Truth
from taxelflow.simulation.mujoco.plants import BARRETT, CONTACT, SOLVER
from taxelflow.simulation.mujoco.scene import add_contacts, mechanism, scene, sheet
from taxelflow.simulation.mujoco.skin import Skin

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.pads import Pad
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.mujoco.events import Load

_PREFIX = "hand/"
_FINGERS = ("f1", "f2", "f3")


@dataclass
class BarrettHand:
    """The plant at work. Raises ExtraMissing without MuJoCo (extra `sim`).

    The force of the grip is half of all pads' normal forces, as friction carries 2 mu times as much. What torque gives
    that force depends on where the fingers touch: the hand learns it from its pads' forces, measured without error.
    """

    held: Held
    actuator: Actuator = field(default_factory=Actuator)
    rate_hz: float = 100.0
    seed: int = 0
    joint_names = ("spread_rad", "f1_rad", "f2_rad", "f3_rad")
    view = View((0.0, -0.03, 0.01), 0.42, 222.0, -24.0)

    def __post_init__(self) -> None:
        self.sensor: Sensor = load_sensor("barretthand-162")
        pads = [(pad.name, skin_of(pad, self.sensor)) for pad in self.sensor.pads]
        self._plant = Plant(self._spec, pads, self.held, self.actuator, rate_hz=self.rate_hz, seed=self.seed)
        self.model, self.data = self._plant.model, self._plant.data
        self._of_finger = [[n for n, pad in enumerate(self.sensor.pads) if f"finger{k}" in pad.name] for k in (1, 2, 3)]
        self._lever_m = BARRETT.lever_m
        self._open()

    @property
    def t_s(self) -> float:
        """Time since the start."""
        return self._plant.t_s

    @property
    def down(self) -> Floats:
        """(3,): the hand lies on its side, its x axis up."""
        return np.array([-1.0, 0.0, 0.0])

    @property
    def joints(self) -> Floats:
        """(4,): the spread, and how far each finger has closed, rad."""
        return np.array([self.data.joint(_PREFIX + name.removesuffix("_rad")).qpos[0] for name in self.joint_names])

    def scan(self, force_n: float, load: Load) -> tuple[Floats, Truth]:
        """Let one scan period pass with a commanded force of the grip (below 0: open); readings (162,) in kPa."""
        readings, truth = self._plant.scan(force_n, load, lambda due_n: self._lever_m * due_n)
        if truth.force_n > BARRETT.touched_n:
            lever_m = float(np.clip(self.data.act.mean() / truth.force_n, *BARRETT.levers_m))
            self._lever_m += min(1.0 / (self.rate_hz * BARRETT.lever_s), 1.0) * (lever_m - self._lever_m)
        return np.concatenate(readings) / self.sensor.to_si, truth

    def pressure(self, pad: int, normal_n: float) -> Floats:
        """(taxels,), Pa, what the taxels of a pad carry now, without noise."""
        return self._plant.pressure(pad, normal_n)

    def grasps(self, truth: Truth, force_n: float) -> bool:
        """Whether the grip has half of that force or more, and each finger a tenth of that."""
        fingers = [truth.normal_n[own].sum() for own in self._of_finger]
        return truth.force_n > CONTACT.grasped * force_n and bool(
            min(fingers) > BARRETT.finger * CONTACT.grasped * force_n
        )

    def _spec(self, mujoco: Any) -> Any:
        """The world with the object, and the hand attached to it."""
        skins = {pad.name: skin_of(pad, self.sensor) for pad in self.sensor.pads}
        sheets = "".join(sheet(f"{name}_sheet", skin) for name, skin in skins.items())
        shape = self.held.shape
        drives = {name: _PREFIX + name for name in _FINGERS}
        named = {name: f"{name}_sheet" for name in skins}
        most_nm = BARRETT.levers_m[1] * self.actuator.max_n
        moving = mechanism(drives, self.actuator.bandwidth_hz, most_nm, _coupled(), named)
        spec = mujoco.MjSpec.from_string(scene(shape, self.held.inertial(), sheets, moving))
        palm_m = next(pad.pose[2] for pad in self.sensor.pads if pad.link == "base" and pad.pose)
        place = [0.0, -(shape.back_m + BARRETT.palm_gap_m + palm_m), 0.0]
        spec.attach(
            _hand(mujoco, self.sensor), frame=spec.worldbody.add_frame(pos=place, quat=BARRETT.up), prefix=_PREFIX
        )
        for pad in self.sensor.pads:
            _add_pad(mujoco, spec, pad, skins[pad.name])
        add_contacts(spec, [pad.name for pad in self.sensor.pads], self.held.friction)
        for equality in spec.equalities:
            equality.solref[:] = SOLVER.coupling_solref
        _add_links(mujoco, spec, palm_m)
        for name in _FINGERS:
            joint = spec.joint(_PREFIX + name)
            joint.damping[0], joint.armature = BARRETT.damping, BARRETT.armature
        return spec

    def _open(self) -> None:
        """Turn the fingers to where the nearest pad is a gap away from the object."""
        import mujoco

        pads = [self.model.geom(f"{pad.name}_pad").id for pad in self.sensor.pads if pad.link != "base"]
        first = int(self.model.body("object").geomadr[0])
        things = [
            geom
            for geom in range(first, first + int(self.model.body("object").geomnum[0]))
            if self.model.geom_contype[geom]
        ]
        address = [int(self.model.joint(_PREFIX + name).qposadr[0]) for name in _FINGERS]
        outer = [int(self.model.joint(f"{_PREFIX}{name}_outer").qposadr[0]) for name in _FINGERS]
        followers = [self.model.joint(f"{_PREFIX}{name}_outer").id for name in _FINGERS]
        ratios = np.array([self.model.eq_data[self.model.eq_obj1id == joint, 1].item() for joint in followers])
        for angle in np.arange(0.5, 2.4, 0.01):
            self.data.qpos[address], self.data.qpos[outer] = angle, ratios * angle
            mujoco.mj_kinematics(self.model, self.data)
            apart = [mujoco.mj_geomDistance(self.model, self.data, a, b, 1.0, None) for a in pads for b in things]
            if min(apart) < CONTACT.gap_m:
                break
        mujoco.mj_forward(self.model, self.data)


def skin_of(pad: Pad, sensor: Sensor) -> Skin:
    """The skin of a hand's pad: its grid, and assumptions where nothing is published."""
    assert pad.pitch_m is not None
    assert sensor.full_scale is not None
    return Skin(
        pad.rows,
        pad.cols,
        pad.pitch_m[0],
        fine=int(np.ceil(pad.pitch_m[0] / BARRETT.vertex_m)),
        cover_m=BARRETT.cover_m,
        noise_pa=BARRETT.noise_pa,
        full_scale_pa=sensor.full_scale * sensor.to_si,
        missing=pad.missing,
    )


def _coupled() -> str:
    """Equalities: the spread stays, and fingers 2 and 3 close as finger 1. The outer joints' are the URDF's."""
    fixed = f'<joint joint1="{_PREFIX}spread" polycoef="{BARRETT.spread_rad} 0 0 0 0"/>'
    followers = "".join(f'<joint joint1="{_PREFIX}{name}" joint2="{_PREFIX}{_FINGERS[0]}"/>' for name in _FINGERS[1:])
    return fixed + followers


def _hand(mujoco: Any, sensor: Sensor) -> Any:
    """The sensor's URDF as a spec, whose root link stays a body."""
    assert sensor.hand is not None
    root = ElementTree.fromstring(model_text(sensor.hand.urdf, sensor.name))
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", {"fusestatic": "false"})
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))


def _add_links(mujoco: Any, spec: Any, palm_m: float) -> None:
    """The palm's body and a capsule along each link, to look at; knuckles of fingers 1 and 2 have mass as well."""
    rgba, free = [0.75, 0.75, 0.78, 1.0], {"contype": 0, "conaffinity": 0}
    cylinder, capsule = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE
    for body in [one for one in spec.bodies if one.name.startswith(_PREFIX)]:
        mass, root = (0.0 if body.geoms else BARRETT.knuckle_kg), body.name == f"{_PREFIX}base"
        if root:
            half_m = palm_m / 2 - BARRETT.half_pad_m
            body.add_geom(
                type=cylinder, size=[BARRETT.base_m, half_m, 0], pos=[0, 0, half_m], mass=mass, rgba=rgba, **free
            )
            continue
        end = body.bodies[0].pos if body.bodies else [-BARRETT.outer_link_m, 0.0, 0.0]
        line = [0.0, 0.0, 0.0, *end]
        body.add_geom(type=capsule, fromto=line, size=[BARRETT.link_m, 0, 0], mass=mass, rgba=rgba, **free)


def _add_pad(mujoco: Any, spec: Any, pad: Pad, skin: Skin) -> None:
    """A block with the pad's face, the sheet before it, and the pad's frame."""
    assert pad.pose is not None
    body = spec.body(f"{_PREFIX}{pad.link}")
    T = se3_of(np.array(pad.pose[:3]), np.array(pad.pose[3:]))
    quat = np.roll(quaternion_of(T[:3, :3]), 1)

    def at(z_m: float) -> dict[str, Any]:
        return {"pos": T[:3, 3] + z_m * T[:3, 2], "quat": quat}

    half = [skin.cols * skin.pitch_m / 2, skin.rows * skin.pitch_m / 2, BARRETT.half_pad_m]
    still = {"contype": 0, "conaffinity": 0}
    touching = {"contype": 2, "conaffinity": 0}  # a tactile sensor needs one that collides; this one does in pairs only
    box, mesh = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH
    grey = [0.15, 0.15, 0.17, 1.0]
    body.add_geom(
        name=f"{pad.name}_pad", type=box, size=half, mass=0.04, rgba=grey, **at(-BARRETT.half_pad_m), **touching
    )
    sheet_name = f"{pad.name}_sheet"
    body.add_geom(
        name=f"{pad.name}_skin", type=mesh, meshname=sheet_name, mass=0.0, group=4, **at(CONTACT.sheet_m), **still
    )
    body.add_site(name=pad.name, group=4, **at(0.0))
