"""From states on a pattern to poses in a pad's frame, with covariance and quality."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import AMBIGUOUS, OK, UNRESOLVED
from taxelflow.numerics.bspline import STATE, states_of
from taxelflow.numerics.geometry import rotation, turned
from taxelflow.numerics.robust import GATE
from taxelflow.numerics.rounding import BLURRED, NEGLIGIBLE, ROUNDING

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Bytes, Floats


@dataclass(slots=True, eq=False)
class Poses:
    """Poses (scans, 3) of the pattern's centre in a pad's frame, in m and rad, turned since the first; covariance
    (scans, 3, 3), NaN where the turn is unknown; quality (scans,), see `messages.QUALITY`. shared: (scans, 3, 3), what
    of the covariance consecutive scans share.
    """

    pose: Floats
    covariance: Floats
    quality: Bytes
    shared: Floats | float = 0.0
    noise: Floats | None = None
    """(scans, 3, 3), the other part of the covariance, where it is known by itself; None: what is not shared."""

    def __len__(self) -> int:
        return len(self.pose)

    def steps(self, t_s: Floats, present: Bools) -> tuple[Floats, Floats, Floats]:
        """Displacement (scans, 3) since the scan before, its covariance (scans, 3, 3) and time (scans,); first NaN.

        present: (scans,), the others are passed over, and have none. The pattern's error is common to both scans;
        what is left is the noise of both.
        """
        moved, noise, span = (np.full_like(like, np.nan) for like in (self.pose, self.covariance, t_s))
        own = self.covariance - self.shared if self.noise is None else self.noise
        at = np.flatnonzero(present)
        now, before = at[1:], at[:-1]
        moved[now] = self.pose[now] - self.pose[before]
        noise[now] = own[now] + own[before]
        span[now] = t_s[now] - t_s[before]
        return moved, noise, span

    def spread(self, present: Bools) -> Poses:
        """Poses of the scans that are present (scans,), with unknown ones in the others."""

        def among(values: Floats) -> Floats:
            spread = np.full((len(present), *values.shape[1:]), np.nan)
            spread[present] = values
            return spread

        quality = np.zeros(len(present), np.uint8)
        quality[present] = self.quality
        shared = among(np.zeros_like(self.covariance) + self.shared)
        noise = None if self.noise is None else among(self.noise)
        return Poses(among(self.pose), among(self.covariance), quality, shared, noise)

    def open_across(self, scanned: Scanned, pitch_m: float) -> Poses:
        """With a place along x or y that its taxels do not measure left open: anywhere on the pad."""
        across = np.flatnonzero(scanned.across)
        if not len(across):
            return self
        covariance = self.covariance.copy()
        covariance[:, across, across] = (pitch_m * scanned.reach) ** 2
        return replace(self, covariance=covariance, quality=np.maximum(self.quality, AMBIGUOUS), noise=None)

    def open_along(self, direction: Floats, scanned: Scanned, pitch_m: float) -> Poses:
        """With the place along a direction (2,) of the pad, if it is not 0, left open: anywhere on the pad."""
        if not direction.any():
            return self
        shared = np.zeros_like(self.covariance)
        shared[:, :2, :2] = (pitch_m * scanned.reach) ** 2 * np.outer(direction, direction)
        return self._sharing(shared, pitch_m)

    def shifted(self, shift: Floats, pitch_m: float) -> Poses:
        """With a covariance (scans, 2, 2) of places, in pitches^2, by a load that hardly changes from scan to scan."""
        shared = np.zeros_like(self.covariance)
        shared[:, :2, :2] = pitch_m**2 * shift
        return self._sharing(shared, pitch_m)

    def doubted(self, rival: Floats, pitch_m: float) -> Poses:
        """With the distance (scans, 3), in pitches and rad, of a hypothesis that explains nearly as much in the
        covariance.

        Consecutive scans share it: it adds nothing to the noise of a step.
        """
        if len(rival) != len(self):
            return self
        apart = rival * np.array([pitch_m, pitch_m, 1.0])
        return self._sharing(apart[:, :, np.newaxis] * apart[:, np.newaxis, :], pitch_m)

    def with_map(self, error: Floats, solved: Solved, scanned: Scanned, pitch_m: float) -> Poses:
        """With the map's part (scans, 5, 5) of the states' covariance, see `map_doubt`, in that of the poses."""
        lever = _lever(solved.states, solved.middle(scanned), pitch_m, turns=solved.turns)
        shared = lever @ error[:, :3, :3] @ lever.transpose(0, 2, 1)
        return self._sharing(_short_of_all(shared, self.covariance), pitch_m)

    def with_noise(self, information: Floats, solved: Solved, scanned: Scanned, pitch_m: float) -> Poses:
        """With the noise of scans by the states' information (scans, 5, 5) without unseen errors, where that is less.

        Hysteresis and tilt hardly change from scan to scan.
        """
        middle = solved.middle(scanned)
        _, noise = to_pad(solved.states, information, middle, pitch_m, turns=solved.turns)
        xx, xy, yy = noise[:, 0, 0], noise[:, 0, 1], noise[:, 1, 1]
        less = (xx > 0) & (xx * yy > xy * xy) & (xx + yy < self.covariance[:, 0, 0] + self.covariance[:, 1, 1])
        return replace(self, noise=np.where(less[:, np.newaxis, np.newaxis], noise, self.covariance - self.shared))

    def _sharing(self, shared: Floats, pitch_m: float) -> Poses:
        """With an error of which consecutive scans share the covariance (scans, 3, 3)."""
        covariance = self.covariance + shared
        quality = judged_again(self.quality, covariance, pitch_m)
        return replace(self, covariance=covariance, quality=quality, shared=self.shared + shared)


def poses_of(solved: Solved, scanned: Scanned, information: Floats, pitch_m: float) -> Poses:
    """Poses of all scans of a solved contact. information: (scans, 5, 5) of its states."""
    pose, covariance = to_pad(solved.states, information, solved.middle(scanned), pitch_m, turns=solved.turns)
    quality = judge(covariance, pitch_m, solved.fit.per_reading / solved.fit.freedom)
    if len(solved.agrees):
        quality = np.where(solved.agrees, quality, np.maximum(quality, AMBIGUOUS)).astype(np.uint8)
    return Poses(pose, covariance, quality)


def to_pad(
    states: Floats, information: Floats, centre: Floats, pitch_m: float, *, turns: bool
) -> tuple[Floats, Floats]:
    """Poses (scans, 3) and covariances (scans, 3, 3) of the body's point `centre` (2,), SI, from states (scans, 5)."""
    own = np.linalg.inv(information + NEGLIGIBLE * np.eye(STATE))[:, :3, :3]
    arm, lever = arm_of(centre, states), _lever(states, centre, pitch_m, turns=turns)
    pose = np.empty((len(states), 3))
    pose[:, :2] = pitch_m * (states[:, :2] + arm)
    theta = states_of(states).theta
    pose[:, 2] = np.unwrap(theta) - theta[0]
    covariance = lever @ own @ lever.transpose(0, 2, 1)
    if not turns:
        pose[:, 2] = np.nan
        covariance[:, 2, :] = covariance[:, :, 2] = np.nan
    return pose, covariance


def _lever(states: Floats, centre: Floats, pitch_m: float, *, turns: bool) -> Floats:
    """(scans, 3, 3), pose of the body's point `centre` (2,), SI, by the first three parts of states (scans, 5)."""
    lever = np.zeros((len(states), 3, 3))
    lever[:, 0, 0] = lever[:, 1, 1] = pitch_m
    lever[:, 2, 2] = 1.0
    if turns:
        arm = arm_of(centre, states)
        lever[:, 0, 2] = -pitch_m * arm[:, 1]
        lever[:, 1, 2] = pitch_m * arm[:, 0]
    return lever


def arm_of(centre: Floats, states: Floats) -> Floats:
    """(scans, 2), in pitches: from where the states (scans, 5) are to the body's point `centre` (2,)."""
    parts = states_of(states)
    arm: Floats = np.exp(parts.size)[:, np.newaxis] * turned(centre, parts.theta)
    return arm


def _short_of_all(shared: Floats, covariance: Floats) -> Floats:
    """(scans, 3, 3), what is added to covariances (scans, 3, 3), NaN where a turn is unknown: the sum stays positive.

    A little less where it takes all of a covariance away, as of the only scan of a contact, whose place defines the
    object's frame: the sum would be what rounding leaves, of either sign. Where it would take more than there is, as of
    a pose that the scans around it bound, what it takes belongs to the scan alone: only what it adds is left.
    """
    own = np.nan_to_num(covariance)
    std = np.sqrt(np.maximum(np.diagonal(own, axis1=1, axis2=2), 0.0))
    scale = std[:, :, np.newaxis] * std[:, np.newaxis, :]
    added = np.divide(np.nan_to_num(shared), scale, out=np.zeros_like(own), where=scale > 0.0)
    left = np.divide(own, scale, out=np.zeros_like(own), where=scale > 0.0) + added
    left[..., range(3), range(3)] += std == 0.0
    least = np.linalg.eigvalsh(left)[:, 0]
    short: Floats = shared * np.where(least < ROUNDING, 1.0 - ROUNDING, 1.0)[:, np.newaxis, np.newaxis]
    more = least < -ROUNDING
    values, vectors = np.linalg.eigh(added[more])
    kept = vectors * np.maximum(values, 0.0)[:, np.newaxis] @ vectors.transpose(0, 2, 1)
    short[more] = scale[more] * kept
    return short


def judge(covariance: Floats, pitch_m: float, misfit: Floats | float = 0.0) -> Bytes:
    """Quality (scans,). misfit: (scans,), chi-square per degree of freedom."""
    xx, yy, xy = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    # Where a scan holds hardly any information, its inverse may have lost its sign to rounding.
    is_known = (xx > 0) & (yy > 0) & (largest <= (BLURRED * pitch_m) ** 2)
    quality = np.where(is_known, OK, AMBIGUOUS)
    quality = np.where(misfit > GATE, UNRESOLVED, quality)
    return quality.astype(np.uint8)


def judged_again(quality: Bytes, covariance: Floats, pitch_m: float) -> Bytes:
    """Quality (scans,) of poses whose covariance has changed."""
    worse = np.where(quality == OK, judge(covariance, pitch_m), OK)
    return np.maximum(quality, worse).astype(np.uint8)


def aligned(poses: Poses, before: Floats) -> Poses:
    """Poses of a window in the frame of the window before, which gave its first scans the poses (scans, 3) `before`.

    The object's own frame is arbitrary: it is shifted and turned so that both windows agree on the scans they share.
    """
    shared = len(before)
    turns = rotation(np.nan_to_num(poses.pose[:, 2]))
    gap = before[:, :2] - poses.pose[:shared, :2]
    known = np.isfinite(gap).all(axis=1)
    turn = (before[:, 2] - poses.pose[:shared, 2])[known]
    offset = float(np.mean(turn)) if len(turn) and np.isfinite(turn).all() else 0.0
    body = np.einsum("kji,kj->ki", turns[:shared][known], gap[known]).mean(axis=0) if known.any() else np.zeros(2)
    pose = poses.pose.copy()
    pose[:, :2] += turns @ body
    pose[:, 2] += offset
    return replace(poses, pose=pose)
