"""Joint angles of the hand: from a recording's own numbers, from a table beside it, or constant."""

from __future__ import annotations

import csv
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ExtraMissing
from taxelflow.messages import Joints
from taxelflow.sensors.hand import JointsInvalid, joint_angles, ways
from taxelflow.sensors.kinematics import angles_of, hand_model

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

TIME = "t_s"


def joints_of(names: Sequence[str], t_s: Floats, angles: Floats) -> Joints:
    """Angles (times, joints), NaN where unknown, at times (times,) in any order; of repeated times the first.

    Each joint is interpolated between its own times, so that one that starts late or pauses leaves the others known. A
    joint without any known angle is left out, as is a time without any.
    """
    own = [(name, *_known(t_s, column)) for name, column in zip(names, angles.T, strict=True)]
    own = [one for one in own if len(one[1])]
    times = np.unique(np.concatenate([np.zeros(0), *(own_s for _, own_s, _ in own)]))
    filled = np.full((len(times), len(own)), np.nan)
    for column, (name, own_s, known) in enumerate(own):
        inside = (times >= own_s[0]) & (times <= own_s[-1]) | (len(own_s) == 1)
        filled[inside, column] = Joints((name,), own_s, known[:, np.newaxis]).at(times[inside], (name,))[:, 0]
    return Joints(tuple(name for name, _, _ in own), times, filled)


def _known(t_s: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Times at which a joint's angle (times,) is known, in order, and the angles; of repeated times the first."""
    known = np.isfinite(t_s) & np.isfinite(angles)
    times, first = np.unique(t_s[known], return_index=True)
    return times, angles[known][first]


def constant_joints(angles: dict[str, float], sensor: Sensor) -> Joints:
    """Angles that never change, 0 for joints of the sensor's hand that are left out. Raises HandModelInvalid."""
    hand = sensor.hand
    with suppress(ExtraMissing):
        if hand is not None and any(pad.link is not None for pad in sensor.pads):
            names = hand_model(hand.urdf, hand.base, sensor.name).joints
            return Joints(names, np.zeros(1), angles_of(names, angles, sensor.name)[np.newaxis])
    return Joints(tuple(angles), np.zeros(1), np.array([list(angles.values())]))


def asked_joints(given: str, sensor: Sensor) -> Joints:
    """Joint angles that the user gives: JOINT=ANGLE pairs, a named pose of the sensor's hand, or the path of a csv with
    a column t_s (s) and one per joint (rad). Raises JointsInvalid.
    """
    pose = None if sensor.hand is None else sensor.hand.pose(given)
    if pose is not None:
        return constant_joints(joint_angles(pose), sensor)
    if given.endswith(".csv"):
        joints = read_joints(Path(given))
        _check_names(joints.names, given, sensor)
        return replace(joints, given=given)
    angles = joint_angles(given, ways(sensor.hand, table=True))
    _check_names(angles, given, sensor)
    return constant_joints(angles, sensor)


def _check_names(names: Iterable[str], given: str, sensor: Sensor) -> None:
    """Raises JointsInvalid for a joint that the sensor's hand lacks; without MuJoCo nothing is known of it."""
    if sensor.hand is None:
        raise JointsInvalid(given, f"sensor {sensor.name} has no [hand]", "leave --joints out")
    with suppress(ExtraMissing):
        model = hand_model(sensor.hand.urdf, sensor.hand.base, sensor.name)
        for name in names:
            if name in model.drivers:
                raise JointsInvalid(given, f"joint {name!r} follows {model.drivers[name]!r}", f"leave {name} out")
            if name not in model.joints:
                raise JointsInvalid(given, f"the hand has no joint {name!r}, only {', '.join(model.joints)}")


def declared_joints(sensor: Sensor) -> Joints | None:
    """The constant angles of the sensor file, if it has any. Raises HandModelInvalid."""
    if sensor.hand is None or not sensor.hand.joints:
        return None
    return constant_joints(joint_angles(sensor.hand.joints), sensor)


def read_joints(path: Path) -> Joints:
    """Joint angles from a csv: a header t_s,JOINT,..., times in s and angles in rad (m), an empty field where unknown.

    Raises JointsInvalid.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise JointsInvalid(
            str(path), f"the file cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from error
    header = [name.strip() for name in rows[0]] if rows else []
    if TIME not in header or len(set(header)) < len(header) or len(header) < 2:
        raise JointsInvalid(str(path), f"its header is {','.join(header)[:80] or 'empty'!r}")
    try:
        numbers = np.array([[float(field or "nan") for field in row] for row in rows[1:]], dtype=np.float64)
    except ValueError as error:
        raise JointsInvalid(str(path), f"a field is no number ({error})") from error
    if numbers.ndim != 2 or numbers.shape[1] != len(header):
        raise JointsInvalid(str(path), "its rows are not as long as its header, or there are none")
    time = header.index(TIME)
    others = [column for column in range(len(header)) if column != time]
    joints = joints_of([header[column] for column in others], numbers[:, time], numbers[:, others])
    if not len(joints.t_s):
        raise JointsInvalid(str(path), "no row has a time and an angle")
    return joints
