"""Pose of the object at any time: back-and-forth strokes, rotation about a point, stick-slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.geometry import rotation
from taxelflow.simulation.seeds import STICK_SLIP

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.parameters import Motion


@dataclass(frozen=True, slots=True)
class Path:
    """Path of the object at times of any shape (...).

    pose: (..., 3), x, y in m and theta in rad, in the frame of the scenario. travelled_m: (...), distance travelled so
    far, of a rotation that at the lever arm. slipping: (...), whether the object slides or turns.
    """

    pose: Floats
    travelled_m: Floats
    slipping: Bools


@dataclass(frozen=True, slots=True)
class _Plan:
    """Motion relative to its start: shift (..., 2) in m, turn (...) in rad, distances so far in m and rad, slipping."""

    shift: Floats
    turn: Floats
    slid_m: Floats
    turned_rad: Floats
    slipping: Bools


def move(motion: Motion, t_s: Floats, seed: int = 0, arm_m: float = 0.0) -> Path:
    """Path at times t_s (...). arm_m: lever arm at which a rotation counts as distance travelled, m."""
    plan = _stick_slip(motion, t_s, seed) if motion.kind == "stick-slip" else _strokes(motion, t_s)
    pose = np.empty((*t_s.shape, 3))
    pose[..., 0] = motion.middle_m[0] + plan.shift[..., 0]
    pose[..., 1] = motion.middle_m[1] + plan.shift[..., 1]
    pose[..., 2] = motion.angle_rad + plan.turn
    if motion.centre_m is not None:
        lever = np.subtract(motion.middle_m, motion.centre_m)
        pose[..., :2] += rotation(plan.turn) @ lever - lever
        arm_m += float(np.hypot(*lever))
    return Path(pose, plan.slid_m + arm_m * plan.turned_rad, plan.slipping)


def _strokes(motion: Motion, t_s: Floats) -> _Plan:
    """Rest, strokes back and forth, rest."""
    stroke_s = motion.stroke_s
    progress = (t_s - motion.rest_s) / stroke_s
    strokes = np.clip(progress, 0.0, motion.strokes)
    position = 1.0 - np.abs(strokes % 2.0 - 1.0)  # triangle wave: 0 at the start, 1 after one stroke, 0 after two
    along = (position - 0.5) * motion.travel_m
    moves = motion.travel_m > 0 or motion.turn_rad_s != 0
    return _Plan(
        shift=np.stack([along * np.cos(motion.direction_rad), along * np.sin(motion.direction_rad)], axis=-1),
        turn=position * stroke_s * motion.turn_rad_s,
        slid_m=strokes * motion.travel_m,
        turned_rad=strokes * stroke_s * abs(motion.turn_rad_s),
        slipping=(progress > 0) & (progress < motion.strokes) & moves,
    )


def _stick_slip(motion: Motion, t_s: Floats, seed: int) -> _Plan:
    """Alternating holds and slips; a slip is straight at constant speed and turn rate."""
    random = np.random.default_rng([seed, STICK_SLIP])
    end_s = motion.rest_s + motion.stick_slip_s
    knots = [np.array([motion.rest_s, 0.0, 0.0, 0.0, 0.0, 0.0])]  # t, shift x, shift y, turn, slid, turned
    slips = [False]  # before the first knot
    while knots[-1][0] < end_s:
        lasts_s = min(random.uniform(*motion.interval_s), end_s - knots[-1][0])
        slip = not slips[-1] and len(slips) > 1
        knots.append(knots[-1] + (_slip(motion, knots[-1][1:3], lasts_s, random) if slip else [lasts_s, 0, 0, 0, 0, 0]))
        slips.append(slip)
    table = np.array(knots)
    columns = [np.interp(t_s, table[:, 0], column) for column in table[:, 1:].T]
    interval = np.searchsorted(table[:, 0], t_s, side="right")
    return _Plan(
        shift=np.stack(columns[:2], axis=-1),
        turn=columns[2],
        slid_m=columns[3],
        turned_rad=columns[4],
        slipping=np.array([*slips, False])[interval],
    )


def _slip(motion: Motion, position: Floats, lasts_s: float, random: np.random.Generator) -> Floats:
    """One slip as a step of the knots; one that would leave the range of travel is directed to the middle."""
    length = random.uniform(*motion.slip_m_s) * lasts_s
    direction = random.uniform(-np.pi, np.pi)
    turn = random.uniform(-1.0, 1.0) * motion.turn_rad_s * lasts_s
    step = length * np.array([np.cos(direction), np.sin(direction)])
    if np.hypot(*(position + step)) > motion.travel_m / 2:
        step = -length * position / np.hypot(*position)
    return np.array([lasts_s, *step, turn, length, abs(turn)])
