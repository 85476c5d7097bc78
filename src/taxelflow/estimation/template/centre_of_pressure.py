"""The centre of pressure as a second measurement of an object's place, beside its map (the second witness).

The centre of pressure c follows the object without a map: less precisely than a good map, but not misled by a map of
few scans. Of readings p at r from c (pitches), with the load F = sum(p) and M = sum(p r r^T) / F, its covariance is

    D = sum(((e p)^2 + noise^2) r r^T) / F^2  +  (1 + 12 M)^-1 / 12  +  (b s d)^2 1  +  a^2 1  +  (1 - n / N)^2 M

1. A reading stands for a cell across which the pressure varies: it has a gain error e.
2. A contact ends anywhere between two taxels, which moves the centre of n taxels in line by up to 1 / n of a cell.
3. Where a share s of the load lies at the pad's border, a motion d of c has a relative error b.
4. The load acts beside the middle of the contact by an eccentricity with standard deviation a, see `tilt`.
5. A contact that forms or ends presses n of its N taxels only, the median of all scans; the others may lie anywhere in
   it, with the median M.

**Fusion.** With the place p on the map and its covariance C, the pose is p + W (c - p). Tilt and border move p, too,
with an unknown correlation; their part of D is S. For any correlation the covariance is at most

    (1 + g) (1 - W) C (1 - W)^T  +  W (D - S) W^T  +  (1 + 1 / g) W S W^T

(split covariance intersection, Julier and Uhlmann, 2001); W and g minimise its trace, beginning with W = C (C + D)^-1.
If p and c contradict each other, it is multiplied by chi-square per degree of freedom (Birge, 1932).

**Rest.** Along a direction in which the object may have rested, see `hidden_motion`, a batch's map shows neither its
place nor the shift by the border. C is widened along it until it explains c - p, so that c decides.

**Short motions.** While a motion is too short for the map to show its length, see `short_motion`, C holds how much
shorter c finds it.

**Stream.** A map's frame shifts when it is adjusted. W and c refer to the point of the object at the mean of c over all
keyframes, see `Anchor`, which hardly shifts. A map that turns keeps the point that was reported, see `online.gauge`.

**Border.** A border cuts a pattern: c moves by less than the object, or jumps where a part leaves the pad. The map
predicts by how much: it is the difference of the centre of the readings that it predicts from its centre without a
border, a fixed point of the object. The part s of this difference that C + D do not explain at three standard
deviations is subtracted from c. s s^T is added to D, because the map alone knows that part. Smaller differences are
left, or a wrong map would confirm itself. Where a border cuts a pattern, C has been found too small: W stays
C (C + D)^-1 there, with S = D.

With `unseen_error = 0` none of this is done: the residuals then show the whole error of the map.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.pose_output import Poses, judged_again
from taxelflow.estimation.template.short_motion import stretched
from taxelflow.estimation.template.solution import ALL_SHOWN
from taxelflow.estimation.template.two_witnesses import combine, surely, widen
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.centroid import (
    CELL_ERROR,
    centroid_covariance,
    count_loaded,
    eccentricity_variance,
    pressure_centre,
)
from taxelflow.numerics.geometry import turned
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Readings, Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats

BORDER_ERROR = 0.2
"""Relative error of the motion of c for a contact whose whole load lies at the pad's border: b above."""


class _Centre(NamedTuple):
    """The centre of a map."""

    leap: float = 1.0
    """Pitches from scan to scan above which a map does not determine how far an object has moved."""
    rounds: int = 3
    """Of reweighting, in which scans that the border cuts count less, to find the centre of a map."""
    share: float = 0.5
    """Share of the size of a predicted pressure above which its sum has a centre: a spline may predict less than none
    beside its object, and the mean place of what nearly cancels is anywhere, once half a metre off the pad."""


_CENTRE = _Centre()


@kernel
def _centres(scans: Readings, edge: Bools, tilt: float, out: Floats) -> None:
    """Fill out (scans, 15) with each scan's `pressure_centre` (5,), `centroid_covariance` (9,) and `count_loaded`."""
    ceiling, places = scans.ceiling, scans.places
    for k in range(len(scans.value)):
        reading, variance = scans.value[k], scans.variance[k]
        pressure_centre(reading, variance, places, edge, out[k, :5])
        centroid_covariance(reading, variance, ceiling, places, out[k, :5], CELL_ERROR, tilt, out[k, 5:14])
        out[k, 14] = count_loaded(reading, variance)


class Anchor(NamedTuple):
    """The mean centre of pressure of a contact, in the object's frame, in pitches.

    arm: (2,), from the origin. variance: of one scan's centre, mean, pitches^2. inside: (2,), the mean centre by the
    map. off: (scans, 2), the centre by the map in each scan at t_s (scans,), less `inside`.
    """

    arm: Floats
    variance: float
    inside: Floats
    t_s: Floats
    off: Floats

    def held(self, t_s: Floats) -> Floats:
        """(scans, 2), of scans at these times; NaN where it has none."""
        found = np.full((len(t_s), 2), np.nan)
        _, those, own = np.intersect1d(t_s, self.t_s, assume_unique=True, return_indices=True)
        found[those] = self.off[own]
        return found


class Centres(NamedTuple):
    """Centres of pressure of scans, in pitches: where they are (scans, 2), the covariance of each as xx, xy and yy
    (scans, 3), with that by the border, the part of it that moves places on the map, too, the second moment of the load
    about the centre (scans, 3), the number of loaded taxels (scans,), the share of the load at the border (scans,),
    whether there is a load (scans,), and whether the border surely cuts the pattern (scans,).
    """

    place: Floats
    covariance: Floats
    common: Floats
    extent: Floats
    loaded: Floats
    border: Floats
    known: Bools
    cut: Bools

    @classmethod
    def of(cls, scanned: Scanned, edge: Bools, tilt: float) -> Centres:
        """edge: (taxels,), at the pad's border. tilt: see `centroid_covariance`."""
        found = np.empty((len(scanned), 15))
        _centres(scanned.with_error(0.0), edge, tilt, found)
        place, border, known = found[:, :2], found[:, 2], found[:, 3] > 0
        covariance, extent = found[:, 5:8] + found[:, 8:11], found[:, 11:14]
        common = np.zeros_like(extent)
        common[:, [0, 2]] = eccentricity_variance(tilt, 0.5) * (extent[:, :1] + extent[:, 2:])
        if known.any():
            moved = np.hypot(*(place - np.median(place[known], axis=0)).T)
            cut = ((BORDER_ERROR * border * moved) ** 2)[:, np.newaxis]
            covariance[:, [0, 2]] += cut
            common[:, [0, 2]] += cut
        return cls(place, covariance, common, extent, found[:, 14], border, known, np.zeros_like(known))

    @property
    def spread(self) -> Floats:
        """(scans,), trace of the covariance."""
        both: Floats = self.covariance[:, 0] + self.covariance[:, 2]
        return both

    def arm(self, states: Floats, trust: Floats) -> Floats:
        """(2,), from the origin of a body at states (scans, 3 or more) to the mean place of its centre of pressure."""
        own = _in_body(self.place, states)
        average: Floats = np.average(own[self.known], axis=0, weights=trust[self.known])
        return average

    def formed(self) -> Centres:
        """With the covariance of contacts that form or end.

        A taxel that comes and goes at the rim of a contact does not count. What the border does is subtracted before.
        The whole contact's extent is that of the scan of median size: a median of each element is no covariance.
        """
        if not self.known.any():
            return self
        own = self.extent[self.known]
        extent = own[np.argsort(own[:, 0] + own[:, 2], kind="stable")[len(own) // 2]]
        missing = np.maximum(1.0 - (self.loaded + 1.0) / np.median(self.loaded[self.known]), 0.0)
        return self._replace(covariance=self.covariance + np.outer(missing**2, extent))

    def uncut(
        self, solved: Solved, scanned: Scanned, before: Anchor | None = None, *, at_rest: Floats = ALL_SHOWN.at_rest
    ) -> tuple[Centres, Floats, Floats]:
        """The centres corrected for the pad's border, as far as the map of a solved contact predicts its effect.

        Also, in the object's frame, the map's centre for most scans (2,), and the shift from it in each scan (scans,
        2), NaN where the map predicts none. before: anchor by an earlier map of some of these scans. They keep their
        mean shift, so that the point that the centre follows does not depend on which scans a map is made of. at_rest:
        see `Hidden`; the map predicts no shift along it.

        The covariance contains the correction, which follows from the map. Scans before and after a jump are compared
        among themselves only: their part of the map may be another pattern.
        """
        found = np.empty((len(scanned), 15))
        model = solved.fit.model
        _centres(replace(scanned, readings=model).with_error(0.0), scanned.edge, 0.0, found)
        has_centre = np.nansum(model, axis=1) > _CENTRE.share * np.nansum(np.abs(model), axis=1)
        states = solved.states
        inside, own = _in_body(found[:, :2], states), solved.fit.covariance
        known, spread = self.known & has_centre & (found[:, 3] > 0), own[:, 0, 0] + own[:, 1, 1] + self.spread
        leaps = np.hypot(*np.diff(states[:, :2], axis=0).T) > _CENTRE.leap
        run = np.concatenate([[0], np.cumsum(leaps)])
        most = int(np.argmax(np.bincount(run, weights=known)))
        off, middle = np.zeros_like(inside), np.full(2, np.nan)
        held = before.held(scanned.t_s) if before is not None else np.full_like(inside, np.nan)
        for number in np.unique(run[known]).tolist():
            own_run = known & (run == number)
            is_held = own_run & np.isfinite(held[:, 0])
            if is_held.any():
                reference = np.average((inside - held)[is_held], axis=0, weights=1.0 / spread[is_held])
                off = np.where(own_run[:, np.newaxis], inside - reference, off)
            for _ in range(0 if is_held.any() else _CENTRE.rounds):
                weights = own_run / (spread + np.sum(off**2, axis=1))
                reference = np.average(inside, axis=0, weights=weights)
                off = np.where(own_run[:, np.newaxis], inside - reference, off)
            middle = reference if number == most else middle
        shift = turned(off, states_of(states).theta)
        x, y = scanned.reach * at_rest
        doubts = self.covariance + own[:, [0, 0, 1], [0, 1, 1]] + (x * x, x * y, y * y)
        shares = _sure_shares(shift, doubts)
        shift *= (shares if before is None else np.full_like(shares, shares[known].max(initial=0.0)))[:, np.newaxis]
        x, y = shift.T
        doubt = np.stack([x * x, x * y, y * y], axis=1)
        off = np.where(known[:, np.newaxis], off, np.nan)
        covariance, common = self.covariance + doubt, self.common + doubt
        cut: Bools = np.asarray(shift.any(axis=1), np.bool_)
        uncut = self._replace(place=self.place - shift, covariance=covariance, common=common, cut=cut)
        return uncut, middle, off


def _in_body(places: Floats, states: Floats) -> Floats:
    """(scans, 2), places (scans, 2) in the frame of a body at states (scans, 3 or more)."""
    return turned(places - states[:, :2], -states[:, 2])


def _sure_shares(shift: Floats, doubts: Floats) -> Floats:
    """(scans,), see `surely`, of shifts (scans, 2) and covariances (scans, 3)."""
    both = zip(shift.tolist(), doubts.tolist(), strict=True)
    return np.array([surely((x, y), (xx, xy, yy)) for (x, y), (xx, xy, yy) in both])


def anchor_of(solved: Solved, scanned: Scanned, tilt: float, before: Anchor | None) -> Anchor | None:
    """The anchor of a solved contact, by its scans; None if no scan has a centre. tilt: see `centroid_covariance`.

    before: see `Centres.uncut`.
    """
    centres = Centres.of(scanned, scanned.edge, tilt)
    if scanned.across.any() or not centres.known.any():
        return None
    centres, inside, off = centres.uncut(solved, scanned, before)
    centres = centres.formed()
    own = solved.fit.covariance
    trust = 1.0 / (own[:, 0, 0] + own[:, 1, 1] + centres.spread)
    variance = np.average(0.5 * centres.spread[centres.known], weights=trust[centres.known])
    return Anchor(centres.arm(solved.states, trust), float(variance), inside, scanned.t_s, off)


def witnessed(poses: Poses, scanned: Scanned, edge: Bools, pitch_m: float, tilt: float, solved: Solved | None) -> Poses:
    """Poses combined with the centre of pressure of each scan.

    edge, tilt: see `Centres`. solved: the contact whose poses they are; None if it has no single map. The centre
    of pressure is taken to follow the point of the body on which it lies on average.
    """
    centres = Centres.of(scanned, edge, tilt)
    at_rest = (ALL_SHOWN if solved is None else solved.hidden).at_rest
    if solved is not None:
        centres, _, _ = centres.uncut(solved, scanned, at_rest=at_rest)
    centres = centres.formed()
    known = np.isfinite(poses.pose[:, :2]).all(axis=1) & centres.known
    known &= np.isfinite(poses.covariance[:, :2, :2]).all(axis=(1, 2))
    if scanned.across.any() or not known.any():
        return poses
    centres = centres._replace(known=known)
    state = np.column_stack([poses.pose[:, :2] / pitch_m, np.nan_to_num(poses.pose[:, 2])])
    own = np.trace(poses.covariance[:, :2, :2], axis1=1, axis2=2) / pitch_m**2
    trust = 1.0 / (own + centres.spread)
    by_centre = centres.place - turned(centres.arm(state, trust), state[:, 2])
    apart = by_centre - state[:, :2]
    pose, covariance = poses.pose.copy(), poses.covariance.copy()
    shared, noise = np.zeros_like(covariance) + poses.shared, None if poses.noise is None else poses.noise.copy()
    if solved is not None:
        away = pitch_m * stretched(state[:, :2], by_centre, trust * known, centres.border)
        longer = away[:, :, np.newaxis] * away[:, np.newaxis, :]
        covariance[:, :2, :2] += longer
        shared[:, :2, :2] += longer
    weight = np.zeros((2, 2))
    for k in np.flatnonzero(known).tolist():
        own = covariance[k] / pitch_m**2
        doubt, common = tuple(centres.covariance[k]), tuple(centres.common[k])
        widen(own, doubt, tuple(apart[k]), at_rest)
        combine(own, doubt, common, tuple(apart[k]), bool(centres.cut[k]), weight)
        pose[k, :2] += pitch_m * (weight @ apart[k])
        covariance[k, :2] = pitch_m**2 * own[:2]
        covariance[k, 2, :2] = pitch_m**2 * own[2, :2]
        held = np.eye(2) - weight
        shared[k, :2, :2] = held @ shared[k, :2, :2] @ held.T
        if noise is not None:  # tilt moves c independently from scan to scan
            xx, xy, yy = pitch_m**2 * centres.covariance[k]
            noise[k, :2, :2] = held @ noise[k, :2, :2] @ held.T + weight @ np.array([[xx, xy], [xy, yy]]) @ weight.T
            noise[k, :2, 2] = noise[k, 2, :2] = held @ noise[k, :2, 2]
    return Poses(pose, covariance, judged_again(poses.quality, covariance, pitch_m), shared, noise)
