"""Speed of a slip whose contact a border of the pad cuts: scans count by what the border can hide of their motion.

A rigid pattern with pressure p moves by s along x over a pad from a to b. Its total S and its centroid c follow

    dS/ds = p(a) - p(b),    dc/ds = 1 - ((b - c) p(b) + (c - a) p(a)) / S,

with p integrated across x; along y the centroid moves, too, if the borders are loaded away from its middle. So readings
at the borders show which share of a motion the centroid does not follow, or follows across: the loss. A scan's velocity
has this share of the speed as a standard deviation, beside its noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, hypot, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import AMBIGUOUS
from taxelflow.numerics.rounding import LINE_POINTS, SIGNIFICANT
from taxelflow.sensors.border import border_of

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Scans, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.slip_fit import SlipMotion


class BorderLoss:
    """How the centroid of a cut contact fails to follow a motion. It has no memory."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._edge, self._edge_starts, self._faces = border_of(layout)

    def of(self, scans: Scans) -> Floats:
        """(scans, pads, 2, 2), 0 or more: along axis a, of a motion along axis b; NaN where nothing is loaded."""
        layout, starts = self._layout, self._edge_starts
        pressure = np.maximum(scans.pressure, 0.0)
        loss = np.full((*scans.contact.shape, 2, 2), np.nan)
        for pad in range(len(layout.pads)):
            own, edge = layout.of_pad(pad), self._edge[starts[pad] : starts[pad + 1]]
            total = pressure[:, own].sum(axis=1)
            loaded = total > 0.0
            load = pressure[loaded]
            for a, place in enumerate((layout.x_m, layout.y_m)):
                # No product of matrices, whose last bits depend on the number of scans.
                middle = (load[:, own] * place[own]).sum(axis=1) / total[loaded]
                for b, pitch_m in enumerate(layout.pitch_m[pad]):
                    ends = edge[self._faces[edge, b]]
                    reach = np.abs(place[ends] - middle[:, np.newaxis]) + (0.5 * pitch_m if a == b else 0.0)
                    facing = np.ascontiguousarray(reach * load[:, ends])
                    loss[loaded, pad, a, b] = facing.sum(axis=1) / (pitch_m * total[loaded])
        return loss


class Steps(NamedTuple):
    """Displacements of one slip. moved, variance: (scans, 2). loss: (scans, 2, 2). span_s: (scans,). cut: (scans,), a
    border cuts the contact. judged: (scans,), the method has judged the pose itself.
    """

    moved: Floats
    variance: Floats
    loss: Floats
    span_s: Floats
    cut: Bools
    judged: Bools


def steps_of(slips: Slips, loss: Floats, pad: int, start: int, stop: int) -> Steps:
    """Of a pad, scans from start to before stop."""
    own = slice(start, stop)
    cut: Bools = np.asarray(slips.border[own, pad].any(axis=1))
    ambiguous = slips.quality[own, pad] == AMBIGUOUS
    return Steps(
        slips.displacement[own, pad, :2],
        np.diagonal(slips.displacement_covariance[own, pad], axis1=1, axis2=2)[:, :2],
        loss[own, pad],
        slips.span_s[own, pad],
        cut,
        ambiguous != cut,
    )


def joined_steps(parts: list[Steps]) -> Steps:
    """All steps of a slip, at least one part."""
    # The order of a sum follows the order in memory, which must not depend on the blocks.
    return Steps(*(np.ascontiguousarray(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)))


def within(steps: Steps, most: int) -> Steps:
    """Fewer than `most` steps, an even number: neighbours are added up whenever there are as many, so that the blocks
    do not matter.
    """
    while len(steps.span_s) >= most:
        first, later = (Steps._make(array[part] for array in steps) for part in (slice(most), slice(most, None)))
        steps = joined_steps([_paired(first), later])
    return steps


def _paired(steps: Steps) -> Steps:
    """The sums of neighbouring steps, with the mean of their losses; a step that is not known adds nothing."""
    moved, variance, loss, span_s, cut, judged = steps
    known = _known(steps)
    share = np.where(known, span_s, 0.0).reshape(-1, 2)
    share /= np.where(share.sum(axis=1) > 0.0, share.sum(axis=1), np.nan)[:, np.newaxis]
    lost = np.where(known[:, np.newaxis, np.newaxis], loss * cut[:, np.newaxis, np.newaxis], 0.0)
    moved, variance = (
        np.where(known[:, np.newaxis], one, 0.0).reshape(-1, 2, 2).sum(axis=1) for one in (moved, variance)
    )
    return Steps(
        moved,
        variance,
        np.einsum("kn,knab->kab", share, lost.reshape(-1, 2, 2, 2)),
        np.where(known, span_s, 0.0).reshape(-1, 2).sum(axis=1),
        np.asarray((known & cut).reshape(-1, 2).any(axis=1)),
        np.asarray((known & judged).reshape(-1, 2).any(axis=1)),
    )


def _known(steps: Steps) -> Bools:
    """(scans,), steps whose motion, noise and loss are known."""
    known = np.isfinite(steps.moved).all(axis=1) & np.isfinite(steps.variance).all(axis=1)
    known &= np.isfinite(steps.loss).all(axis=(1, 2)) & (steps.span_s > 0.0)
    found: Bools = known & (steps.variance > 0.0).all(axis=1)
    return found


@dataclass(frozen=True, slots=True)
class Velocity:
    """Constant velocity of a slip, m/s, with the standard deviation of the speed."""

    x: float
    y: float
    std_m_s: float


def steady_velocity(steps: Steps | None) -> Velocity | None:
    """Velocity of a slip, if it was constant, a border cut the contact, and the method judges no pose itself."""
    if steps is None:
        return None
    moved, variance, loss, span_s, cut, judged = steps
    known = _known(steps)
    if judged[known].any() or not cut[known].any() or known.sum() < LINE_POINTS:
        return None
    velocity, spread = moved[known] / span_s[known, np.newaxis], variance[known] / span_s[known, np.newaxis] ** 2
    lost = loss[known] * cut[known, np.newaxis, np.newaxis]
    mean = np.median(velocity, axis=0)
    for _ in range(50):  # the weights depend on the speed, whose error each round halves, or better
        hidden = lost @ np.abs(mean)  # (scans, 2), m/s
        weight = 1.0 / (spread + hidden**2)
        mean = (weight * velocity).sum(axis=0) / weight.sum(axis=0)
    count = velocity.size
    chi_square = float((weight * (velocity - mean) ** 2).sum())
    if chi_square > count + SIGNIFICANT * sqrt(2.0 * count):
        return None
    # Losses of neighbours are alike: as a mean they do not fall with the number of scans, as noise does.
    bias = (weight * hidden).sum(axis=0) / weight.sum(axis=0)
    variances = 1.0 / weight.sum(axis=0) + bias**2
    speed = hypot(*mean)
    if not speed > 0.0:
        return None
    along = mean / speed
    return Velocity(float(mean[0]), float(mean[1]), sqrt(float((along**2 * variances).sum())))


def at_velocity(motion: SlipMotion, velocity: Velocity) -> SlipMotion:
    """A motion at this constant velocity, for as long; as it was fitted, if its speed is within the standard deviation,
    which it then has.
    """
    speed = hypot(velocity.x, velocity.y)
    std_path_m = hypot(velocity.std_m_s * motion.duration_s, speed * motion.std_duration_s)
    if abs(speed - motion.speed_m_s) <= velocity.std_m_s:
        wider = max(velocity.std_m_s, motion.std_speed_m_s), max(std_path_m, motion.std_path_m)
        return replace(motion, std_speed_m_s=wider[0], std_path_m=wider[1])
    return replace(
        motion,
        path_m=speed * motion.duration_s,
        speed_m_s=speed,
        direction_rad=atan2(velocity.y, velocity.x),
        std_path_m=std_path_m,
        std_speed_m_s=velocity.std_m_s,
    )
