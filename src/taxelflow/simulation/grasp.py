"""A spread grasp: a textured rigid object slides and turns between moving fingers, its contacts elastic.

Each pad presses on a random relief of its own, which is fixed to the object, through an elastic foundation that carries
the load and its moments (`relief`). It shares no code with any estimator; with an exponent of 1 its law of pressure is
that of the depth in `template`, with others it is not. The geometry is exact: pose of the object and of the pads in
space give the relief's pose along the pad. Loads stay constant, as if the object gave way
along the normals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.messages import Joints, RawScans
from taxelflow.numerics.geometry import se3_exp, se3_inverse
from taxelflow.runtime.checks import positive
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import joint_angles
from taxelflow.sensors.kinematics import PadKinematics, angles_of
from taxelflow.simulation.relief.course import Followed
from taxelflow.simulation.relief.parameters import Object, Pressing, Skin
from taxelflow.simulation.relief.simulate import pressed_along

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

FINGERS = tuple(f"finger{number}_{part}" for number in (1, 2, 3) for part in ("tip", "mid"))
"""Pads that touch: the object moves along them, away from the palm."""


@dataclass(frozen=True, slots=True)
class _Step:
    """Steps of the derivatives for the bound, to both sides."""

    m: float = 2e-4
    rad: float = 0.01


_STEP = _Step()
_FINGERS_HZ = 1.3
"""Frequency at which the fingers sway."""


@dataclass(frozen=True)
class Grasp:
    """A grasp of the BarrettHand with 162 taxels, in its spread pose."""

    seed: int = 0
    """Seed of reliefs, noise and joint errors."""
    speed_m_s: float = 0.025
    """Speed of the object's centre along the fingers, m/s."""
    turn_rad_s: float = 0.5235987755982988
    """Rate of its turn about the same axis, rad/s."""
    fingers_rad: float = 0.005
    """Amplitude of the fingers' own motion, rad: 0.5 mm at the tips, which the contacts can give way to."""
    joint_error_rad: float = 0.0
    """Standard deviation of the recorded joint angles, rad."""
    rate_hz: float = 100.0
    """Scan rate, Hz."""
    stroke_s: float = 0.3
    """Duration of each stroke, s."""
    strokes: int = 6
    """Strokes, there and back in turn."""
    rest_s: float = 0.35
    """Duration of the contact at rest before them, s."""
    idle_s: float = 0.3
    """Duration without contact at the start, s."""
    noise_pa: float = 400.0
    """Standard deviation of the noise of a reading, Pa."""
    peak_pa: float = 60e3
    """Largest pressure of a pad, Pa."""
    exponent: float = 1.0
    """Exponent of the skin's law of pressure over depth, 0.8 to 1.5; see `Skin`."""

    def __post_init__(self) -> None:
        for name in ("rate_hz", "stroke_s", "rest_s", "peak_pa"):
            positive(name, getattr(self, name))


class Grasped(NamedTuple):
    """recording: with joint angles. X: (scans, 4, 4), pose of the object since first contact in the hand. twist:
    (scans, 6), at the hand's origin. strokes: slices of scans at constant twist. T: (scans, pads, 4, 4), of the pads.
    """

    recording: Recording
    X: Floats
    twist: Floats
    strokes: list[slice]
    T: Floats


def simulate_grasp(grasp: Grasp) -> Grasped:
    """The recording of a grasp with its truth. Raises ExtraMissing without MuJoCo."""
    sensor = load_sensor("barretthand-162")
    std = grasp.joint_error_rad
    if sensor.hand is not None and std:
        sensor = msgspec.structs.replace(sensor, hand=msgspec.structs.replace(sensor.hand, joint_std_rad=std))
    random = np.random.default_rng([grasp.seed, 41])
    t_s = (
        np.arange(round((grasp.idle_s + grasp.rest_s + grasp.strokes * grasp.stroke_s) * grasp.rate_hz)) / grasp.rate_hz
    )
    joints, angles = _angles(grasp, sensor, t_s)
    X, twist, strokes = _motion(grasp, t_s)
    T = PadKinematics(sensor).poses(angles)
    values = np.zeros((len(t_s), sensor.layout.taxels))
    for name in FINGERS:
        pad = sensor.layout.pads.index(name)
        own = sensor.layout.of_pad(pad)
        values[:, own] = pressed_along(
            _pressing(grasp, pad), sensor.layout, pad, t_s, _Path.on(grasp, t_s, X, T[:, pad])
        )
    values += random.normal(0.0, grasp.noise_pa, values.shape) + 2e3
    raw = RawScans(t_s, np.maximum(values, 0.0) / sensor.to_si)
    known = angles + random.normal(0.0, 1.0, angles.shape) * std
    recording = Recording(
        f"simulated grasp, seed {grasp.seed}",
        "rig",
        msgspec.structs.replace(sensor, unseen_error=0.0),
        lambda: iter((raw,)),
        scans=len(t_s),
        joints=Joints(joints, t_s, known),
    )
    return Grasped(recording, X, twist, strokes, T)


def grasp_bound(grasp: Grasp, grasped: Grasped, scans: list[int]) -> Floats:
    """Cramér-Rao covariances (n, 6, 6) of the object's pose in single scans, at the hand's origin, patterns known.

    Gain and baseline of each pad are free in every scan. Angles of the joints are taken as known.
    """
    layout = grasped.recording.layout
    information = np.zeros((len(scans), 6, 6))
    t_s = np.arange(len(grasped.X)) / grasp.rate_hz
    chosen = t_s[scans]
    for name in FINGERS:
        pad = layout.pads.index(name)
        pressing = _pressing(grasp, pad)
        path = _Path.on(grasp, t_s, grasped.X, grasped.T[:, pad])
        plain = pressed_along(pressing, layout, pad, chosen, path)
        by_pose = np.stack(
            [
                (
                    pressed_along(pressing, layout, pad, chosen, replace(path, shift=step))
                    - pressed_along(pressing, layout, pad, chosen, replace(path, shift=-step))
                )
                / (2 * np.abs(step).max())
                for step in np.diag((_STEP.m, _STEP.m, _STEP.rad))
            ],
            axis=-1,
        )
        nuisance, _ = np.linalg.qr(np.stack([plain, np.ones_like(plain)], axis=-1))
        by_pose -= nuisance @ (np.swapaxes(nuisance, 1, 2) @ by_pose)
        F = np.swapaxes(by_pose, 1, 2) @ by_pose / grasp.noise_pa**2
        pose = path(chosen).pose
        for k, scan in enumerate(scans):
            J = _rows(grasped.T[scan, pad], pose[k])
            information[k] += J.T @ F[k] @ J
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _rows(T: Floats, pose: Floats) -> Floats:
    """(3, 6): change of the relief's pose on the pad T (4, 4) by a small motion of the object, at the hand's origin."""
    place = T[:3, :3] @ [pose[0], pose[1], 0.0] + T[:3, 3]
    rows = np.zeros((3, 6))
    rows[:2, :3] = T[:3, :2].T
    rows[:2, 3:] = np.cross(place, T[:3, :2].T)
    rows[2, 3:] = T[:3, 2]
    return rows


def _angles(grasp: Grasp, sensor: Sensor, t_s: Floats) -> tuple[tuple[str, ...], Floats]:
    """Names, and true angles (scans, joints): the spread pose, about which each finger sways."""
    names = PadKinematics(sensor).joints
    pose = "" if sensor.hand is None else sensor.hand.pose("spread") or ""
    still = angles_of(names, joint_angles(pose), sensor.name)
    phase = np.arange(len(names))
    sway = np.sin(2 * np.pi * _FINGERS_HZ * t_s[:, np.newaxis] + phase) - np.sin(phase)
    return names, still + grasp.fingers_rad * sway


def _motion(grasp: Grasp, t_s: Floats) -> tuple[Floats, Floats, list[slice]]:
    """Pose (scans, 4, 4), twist (scans, 6) and strokes of the object."""
    begin = grasp.idle_s + grasp.rest_s
    stroke = np.clip((t_s - begin) / grasp.stroke_s, 0.0, grasp.strokes)
    along = grasp.stroke_s * (1.0 - np.abs(stroke % 2.0 - 1.0))
    axis = np.array([0.0, 0.0, grasp.speed_m_s, 0.0, 0.0, grasp.turn_rad_s])
    edges = [round((begin + k * grasp.stroke_s) * grasp.rate_hz) for k in range(grasp.strokes + 1)]
    twist = np.zeros((len(t_s), 6))
    strokes = [slice(*pair) for pair in pairwise(edges)]
    for number, own in enumerate(strokes):
        twist[own] = axis if number % 2 == 0 else -axis
    return se3_exp(along[:, np.newaxis] * axis), twist, strokes


def _pressing(grasp: Grasp, pad: int) -> Pressing:
    return Pressing(
        object=Object(shape="cloth", size_m=0.08, seed=1000 * grasp.seed + pad, tilts=False),
        skin=Skin(exponent=grasp.exponent),
        peak_pa=grasp.peak_pa,
        rate_hz=grasp.rate_hz,
        seed=grasp.seed,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """Pose (scans, 3) of a relief on its pad at times (scans,), from first touch on; shift (3,): added to each pose."""

    t_s: Floats
    pose: Floats
    begin_s: float
    shift: Floats | float = 0.0

    @classmethod
    def on(cls, grasp: Grasp, t_s: Floats, X: Floats, T: Floats) -> _Path:
        """Of the object X on a pad T, (scans, 4, 4) each."""
        start = T[np.searchsorted(t_s, grasp.idle_s)]  # the relief lies under the pad where it is first touched
        on_pad = se3_inverse(T) @ X @ start
        turn = np.unwrap(np.arctan2(on_pad[:, 1, 0], on_pad[:, 0, 0]))
        return cls(t_s, np.column_stack([on_pad[:, :2, 3], turn]), grasp.idle_s)

    def __call__(self, t_s: Floats) -> Followed:
        pose = np.column_stack([np.interp(t_s, self.t_s, axis) for axis in self.pose.T]) + self.shift
        none = np.zeros(len(t_s), dtype=np.bool_)
        load = np.clip((t_s - self.begin_s) / 0.05, 0.0, 1.0)
        return Followed(pose, load, np.zeros((len(t_s), 2)), none, none, np.zeros(2))
