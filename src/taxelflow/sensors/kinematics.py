"""Poses of the pads in space: forward kinematics of a hand from its URDF or MJCF, by MuJoCo (extra `sim`).

Only links and joints are used: meshes, geometries, actuators and sensors are taken out of the model before it is
compiled. Coupled joints (URDF `mimic`, MJCF joint equalities) follow the joints that drive them.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from taxelflow.errors import ExtraMissing
from taxelflow.numerics.geometry import se3_inverse, se3_of
from taxelflow.sensors.hand import HandModelInvalid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from taxelflow.messages import Bools, Floats, Joints
    from taxelflow.sensors.sensor import Sensor

_DROPPED = {
    "visual", "collision", "inertial", "transmission", "gazebo", "material", "sensor", "actuator", "asset", "geom",
    "contact", "tendon", "light", "camera", "site", "keyframe", "custom", "extension", "fluid", "deformable", "mujoco",
}  # fmt: skip
"""Elements of URDF and MJCF that do not move a link; `mujoco` inside a URDF holds compiler options for meshes."""


class Kinematics:
    """A hand's links by its joints. joints: names of those that can be set, in the order of angles; units: of their
    angles, rad or m; ranges: (joints, 2), smallest and largest, infinite without a limit; drivers: by coupled joint.
    """

    def __init__(self, text: str, base: str, source: str) -> None:
        """text: of the URDF or MJCF. base: the link that is the hand's frame; empty for the root.

        Raises HandModelInvalid for a model that MuJoCo refuses or that lacks the base; ExtraMissing.
        """
        try:
            import mujoco
        except ImportError as error:
            raise ExtraMissing("sim", "mujoco") from error
        self._source, self._mujoco = source, mujoco
        root, self._root_link = _stripped(text, source)
        try:
            self._model: Any = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        except ValueError as error:
            seen = " ".join(str(error).split())[:200]
            raise HandModelInvalid(source, seen, "give a URDF or MJCF in one file that MuJoCo compiles") from error
        self._data: Any = mujoco.MjData(self._model)
        self._base = self.link(base) if base else 0
        self._coupled = self._couplings()
        self.drivers = {self._joint_name(one): self._joint_name(other) for one, other, _ in self._coupled}
        driven = {follower for follower, _, _ in self._coupled}
        self._free = [joint for joint in range(self._model.njnt) if joint not in driven]
        self._driver = {joint: joint for joint in self._free} | {one: other for one, other, _ in self._coupled}
        self._check_types()
        address = self._model.jnt_qposadr
        self._address = [int(address[joint]) for joint in self._free]
        self._followers = [(int(address[one]), int(address[other]), terms) for one, other, terms in self._coupled]
        self.joints = tuple(self._joint_name(joint) for joint in self._free)
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        self.units = tuple("m" if self._model.jnt_type[joint] == slide else "rad" for joint in self._free)
        limited = self._model.jnt_limited[self._free].astype(np.bool_)[:, np.newaxis]
        self.ranges: Floats = np.where(limited, self._model.jnt_range[self._free], [[-np.inf, np.inf]])

    def link(self, name: str) -> int:
        """Number of a link. Raises HandModelInvalid, which lists the links."""
        found: int = self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_BODY, name)
        if found >= 0:
            return found
        if name == self._root_link:
            return 0  # MuJoCo merges the root of a URDF with the world
        names = [self._model.body(body).name for body in range(1, self._model.nbody)]
        known = ", ".join(dict.fromkeys(name for name in (self._root_link, *names) if name))
        raise HandModelInvalid(self._source, f"it has no link {name!r}", f"choose one of {known}")

    def poses(self, angles: Floats, links: list[int]) -> Floats:
        """T_hand_link (scans, links, 4, 4) at joint angles (scans, joints), rad (m for a slide).

        NaN for the links that a joint moves whose angle is unknown (NaN).
        """
        T = np.full((len(angles), len(links), 4, 4), np.nan)
        world = np.zeros((len(links) + 1, 4, 4))
        world[:, 3, 3] = 1.0
        bodies = [self._base, *links]
        placed, angles = self._placed(angles, links)
        for scan in np.flatnonzero(placed.any(axis=1)):
            self._set(angles[scan])
            world[:, :3, :3] = self._data.xmat[bodies].reshape(-1, 3, 3)
            world[:, :3, 3] = self._data.xpos[bodies]
            T[scan] = se3_inverse(world[0]) @ world[1:] if self._base else world[1:]
        T[~placed] = np.nan
        return T

    def ends(self) -> dict[int, Floats]:
        """(n, 2, 3) of each link of the hand: place and axis of its joint to the link above, then of those to the links
        below, in its frame. The axis is 0 where nothing moves.
        """
        model = self._model
        found = {self._base: [np.zeros((2, 3))]}
        for link in range(self._base + 1, model.nbody):  # each comes after the one that carries it
            above, first = int(model.body_parentid[link]), int(model.body_jntadr[link])
            if above in found:
                end = np.zeros((2, 3)) if first < 0 else np.stack([model.jnt_pos[first], model.jnt_axis[first]])
                T = se3_of(model.body_pos[link], np.roll(model.body_quat[link], -1))
                found[link] = [end]
                found[above].append(end @ T[:3, :3].T + np.stack([T[:3, 3], np.zeros(3)]))
        return {link: np.stack(ends) for link, ends in found.items()}

    def _placed(self, angles: Floats, links: list[int]) -> tuple[Bools, Floats]:
        """(scans, links), whether the joints that move a link have known angles; angles with 0 for unknown ones."""
        known = np.isfinite(angles)
        if known.all():
            return np.ones((len(angles), len(links)), dtype=np.bool_), angles
        placed = np.stack([known[:, self._movers(link)].all(axis=1) for link in links], axis=1)
        return placed, np.where(known, angles, 0.0)

    def _set(self, angles: Floats) -> None:
        """Move the links to joint angles (joints,)."""
        qpos, qpos0 = self._data.qpos, self._model.qpos0
        qpos[self._address] = angles
        for one, other, terms in self._followers:
            qpos[one] = qpos0[one] + _polynomial(terms, float(qpos[other] - qpos0[other]))
        self._mujoco.mj_kinematics(self._model, self._data)

    def _movers(self, link: int) -> list[int]:
        """Numbers of the joints, in the order of angles, that move a link in the hand's frame."""
        moving = self._above(link) ^ self._above(self._base)
        return sorted({self._free.index(self._driver[joint]) for joint in moving if self._driver[joint] in self._free})

    def _above(self, link: int) -> set[int]:
        """Joints between a link and the root."""
        found: set[int] = set()
        while link:
            first, count = int(self._model.body_jntadr[link]), int(self._model.body_jntnum[link])
            found.update(range(first, first + count))
            link = int(self._model.body_parentid[link])
        return found

    def jacobians(self, angles: Floats, links: list[int]) -> Floats:
        """Twists (scans, links, 6, joints) of links per rate of each joint, at the hand's origin, in its frame.

        NaN as in `poses`.
        """
        J = np.full((len(angles), len(links), 6, len(self.joints)), np.nan)
        model, data, bodies = self._model, self._data, [self._base, *links]
        world = np.empty((len(bodies), 6, model.nv))
        placed, angles = self._placed(angles, links)
        for scan in np.flatnonzero(placed.any(axis=1)):
            self._set(angles[scan])
            self._mujoco.mj_comPos(model, data)
            for number, body in enumerate(bodies):
                self._mujoco.mj_jac(model, data, world[number, :3], world[number, 3:], data.xpos[self._base], body)
            turn = data.xmat[self._base].reshape(3, 3).T
            moved = (world[1:] - world[0]) @ self._rates()
            J[scan] = (turn @ moved.reshape(len(links), 2, 3, -1)).reshape(moved.shape)
        J[~placed] = np.nan
        return J

    def _rates(self) -> Floats:
        """(model's joints, joints): rates of all joints per rate of each that can be set, as they now are."""
        rates = np.zeros((self._model.nv, len(self._free)))
        rates[self._address, range(len(self._free))] = 1.0
        for one, other, terms in self._followers:
            off = float(self._data.qpos[other] - self._model.qpos0[other])
            rates[one] = _polynomial([k * term for k, term in enumerate(terms)][1:], off) * rates[other]
        return rates

    def _couplings(self) -> list[tuple[int, int, list[float]]]:
        """(follower, driver, polynomial coefficients from the constant on) of the joint equalities."""
        model = self._model
        return [
            (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]), model.eq_data[k, :5].tolist())
            for k in np.flatnonzero((model.eq_type == self._mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0))
        ]

    def _check_types(self) -> None:
        known = {int(self._mujoco.mjtJoint.mjJNT_SLIDE), int(self._mujoco.mjtJoint.mjJNT_HINGE)}
        wrong = [joint for joint in self._free if self._model.jnt_type[joint] not in known]
        if wrong:
            seen = f"joint {self._joint_name(wrong[0])!r} has more than one coordinate"
            raise HandModelInvalid(self._source, seen, "use hinges and slides; leave out a floating base")

    def _joint_name(self, joint: int) -> str:
        return str(self._model.joint(joint).name)


class PadKinematics:
    """T_hand_pad of a sensor's pads by joint angles. Pads without a link stay at their `pose` in the hand.

    placed: (pads,), whether a pad has a place. linked: numbers of the pads on links, links: those of their links.
    fixed: (pads, 4, 4), poses on them. joints: of the hand. model: None without linked pads.
    """

    def __init__(self, sensor: Sensor) -> None:
        """Raises HandModelInvalid, ExtraMissing."""
        self.fixed = np.array(
            [
                np.eye(4) if pad.pose is None else se3_of(np.array(pad.pose[:3]), np.array(pad.pose[3:]))
                for pad in sensor.pads
            ]
        )
        self.placed = np.array([pad.pose is not None or pad.link is not None for pad in sensor.pads])
        self.linked = [number for number, pad in enumerate(sensor.pads) if pad.link is not None]
        hand = sensor.hand
        self.model = None if hand is None or not self.linked else hand_model(hand.urdf, hand.base, sensor.name)
        self.links = [self.model.link(sensor.pads[k].link or "") for k in self.linked] if self.model else []
        self.joints: tuple[str, ...] = self.model.joints if self.model else ()

    def angles_at(self, joints: Joints | None, t_s: Floats) -> Floats:
        """(scans, joints) at times (scans,), NaN where unknown."""
        return np.full((len(t_s), len(self.joints)), np.nan) if joints is None else joints.at(t_s, self.joints)

    def poses(self, angles: Floats) -> Floats:
        """(scans, pads, 4, 4) at joint angles (scans, joints); NaN for pads without a place, and unknown angles."""
        T = np.tile(self.fixed, (len(angles), 1, 1, 1))
        T[:, ~self.placed] = np.nan
        if self.model is not None:
            T[:, self.linked] = self.model.poses(angles, self.links) @ self.fixed[self.linked]
        return T

    def jacobians(self, angles: Floats) -> Floats:
        """Twists (scans, pads, 6, joints) of the pads per rate of each joint, at the hand's origin; 0 if unlinked."""
        J = np.zeros((len(angles), len(self.fixed), 6, len(self.joints)))
        if self.model is not None:
            J[:, self.linked] = self.model.jacobians(angles, self.links)
        return J


@cache
def hand_model(model: str, base: str, source: str) -> Kinematics:
    """The kinematics of a model's text, or of a built-in hand by name; kept. Raises as `Kinematics` does."""
    return Kinematics(model_text(model, source), base, source)


def model_text(model: str, source: str) -> str:
    """The XML of a model: its text itself, or a built-in hand's. Raises HandModelInvalid, which lists them."""
    if model.lstrip().startswith("<"):
        return model
    folder = resources.files("taxelflow") / "sensors" / "data" / "hands"
    names = sorted(file.name.removesuffix(".urdf") for file in folder.iterdir() if file.name.endswith(".urdf"))
    if model not in names:
        raise HandModelInvalid(source, f"no hand model {model!r}", f"give {', '.join(names)} or a URDF or MJCF file")
    return (folder / f"{model}.urdf").read_text(encoding="utf-8")


def _polynomial(terms: list[float], x: float) -> float:
    """Its value, by coefficients from the constant on."""
    total = 0.0
    for term in reversed(terms):
        total = total * x + term
    return total


def angles_of(joints: tuple[str, ...], given: Mapping[str, float], source: str) -> Floats:
    """(joints,) angles by name, 0 where none is given. Raises HandModelInvalid for a joint that the hand lacks."""
    for name in given:
        if name not in joints:
            raise HandModelInvalid(source, f"no joint {name!r}", f"its joints are {', '.join(joints) or 'none'}")
    return np.array([given.get(name, 0.0) for name in joints], dtype=np.float64)


def _stripped(text: str, source: str) -> tuple[ElementTree.Element, str]:
    """The model with links and joints only, and the name of a URDF's root link. Raises HandModelInvalid."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise HandModelInvalid(source, f"it is no XML ({error})", "give a URDF or MJCF file") from error
    if root.tag not in ("robot", "mujoco"):
        raise HandModelInvalid(source, f"its root is <{root.tag}>", "give a URDF (<robot>) or MJCF (<mujoco>) file")
    if any("/xacro}" in part.tag for part in root.iter()):
        raise HandModelInvalid(source, "it holds xacro that is not expanded", "give what `xacro FILE` prints")
    if root.find(".//include") is not None:
        raise HandModelInvalid(source, "it includes other files", "give one file, as MuJoCo's compiler writes it")
    _drop(root)
    if root.tag == "mujoco":
        compiler = root.find("compiler")
        compiler = ElementTree.SubElement(root, "compiler") if compiler is None else compiler
        compiler.attrib.update(boundmass="1", boundinertia="1")
        return root, ""
    options = {"fusestatic": "false", "boundmass": "1", "boundinertia": "1"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    children = {child.get("link") for child in root.findall("joint/child")}
    roots = [name for name in (link.get("name", "") for link in root.findall("link")) if name not in children]
    if len(roots) != 1:
        raise HandModelInvalid(source, f"it has {len(roots)} root links", "connect its links to one tree")
    return root, roots[0]


def _drop(element: ElementTree.Element) -> None:
    for child in list(element):
        if child.tag in _DROPPED:
            element.remove(child)
        else:
            _drop(child)
