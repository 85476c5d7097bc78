"""Whether and how fast an object slips between pads: the velocities of all pads, combined by their covariances.

Pads that grip one rigid object observe the same velocity, each its component in the plane of the pad. Their difference
is noise, whether the object moves or not. So it measures the noise of the velocities, and a velocity is a slip if it is
many standard deviations of that noise. `step_filter` combines the pads and the scans.

On a fine texture, the velocity by coarse taxels has an error as large as itself, and pads disagree because the object
moves. So while the slip detector of a pad alarms, agreement is not needed: velocities that are improbable for an object
at rest, with the noise learned before, are a slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.control.step_filter import StepFilter
from taxelflow.errors import ParameterInvalid
from taxelflow.numerics.robust import OUTLIER
from taxelflow.runtime.checks import positive

if TYPE_CHECKING:
    from taxelflow.control.base import Touch
    from taxelflow.messages import Bools, Floats


@dataclass(frozen=True)
class Agreement:
    """When the velocity of the pads is a slip."""

    slip_m_s: float = 0.00235
    """Least speed of a slip: apparent motion by changes of the load is slower."""
    sigmas: float = 4.0
    """Standard deviations of the velocity from rest that are a slip."""
    alerted_sigmas: float = 2.5
    """The same while the slip detector of a pad alarms, where velocities need not agree."""
    acceleration_m_s2: float = 2.0
    """Standard deviation of the object's acceleration, the process noise of its velocity."""
    noise_m_s: float = 0.001
    """Least standard deviation of a pad's velocity."""
    memory_s: float = 0.2
    """Time over which the noise is learned."""
    load_m: float = 1e-3
    """Standard deviation of apparent motion per unit of log load, as in the slip stage: it is equal on both pads."""
    load_share: float = 0.5
    """Change of a reading per unit of log load beyond that of all, as a standard deviation, of each taxel by itself.
    Measured on the BarrettHand: apparent motion of 0.08 to 0.14 (medians) of the detail, by 7 to 14 loaded taxels."""

    def __post_init__(self) -> None:
        for name in ("load_m", "load_share"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ParameterInvalid(f"agreement.{name}", getattr(self, name), "be a finite number, 0 or more")
        for name in ("sigmas", "alerted_sigmas", "acceleration_m_s2", "noise_m_s", "memory_s"):
            positive(f"agreement.{name}", getattr(self, name))

    def start(self) -> AgreementSession:
        """Begin at rest, with the covariances that the pads report."""
        return AgreementSession(self)


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion by the pads. velocity: (2,) or (3,), of the object in the grip's frame, m/s. sigmas: from rest.

    known: whether a pad has a velocity in this scan; else it is a prediction.
    """

    slipping: bool
    velocity: Floats
    sigmas: float
    known: bool

    @property
    def speed_m_s(self) -> float:
        """Size of the velocity."""
        return float(np.linalg.norm(self.velocity))


class AgreementSession:
    """A filter of the object's velocity; its measurement noise is learned from the differences of the pads."""

    def __init__(self, parameters: Agreement) -> None:
        self._p = parameters
        self._filter: StepFilter | None = None
        self._excess, self._force_n = 1.0, 0.0
        self._jumped: Bools = np.zeros(0, dtype=np.bool_)  # pads, in the scan before

    def step(self, touch: Touch) -> Motion:
        """The motion of the object up to this scan."""
        p, dt_s = self._p, touch.dt_s
        self._filter = moves = self._filter or StepFilter(touch.axes.shape[-1], len(touch.axes))
        known = np.asarray(np.isfinite(touch.velocity[:, :2]).all(axis=1), dtype=np.bool_)
        known &= np.isfinite(touch.covariance[:, :2, :2]).all(axis=(1, 2))
        known &= dt_s > 0.0
        moves.predict(p.acceleration_m_s2 * dt_s, touch.axes[known] if known.any() else touch.axes)
        seen, by_place, by_step = touch.velocity[:, :2], touch.plane_covariance(), self._by_step(touch)
        noise_seen = by_place + by_step
        alerted, at_rest = bool(touch.slipping.any()), self._excess
        believed = self._believed(known, touch, at_rest * noise_seen, moves)
        velocity, noise, axes = seen[believed], _of_pads(believed, noise_seen), touch.axes[believed]
        now = at_rest
        chi_square = _apart(velocity, axes, noise)
        if chi_square is not None:
            share = 0.0 if alerted else min(dt_s / p.memory_s, 1.0)
            self._excess += share * (max(min(chi_square, OUTLIER), 1.0) - self._excess)
            now = max(self._excess, chi_square)
        if len(velocity):
            moves.update(believed, seen, touch.axes, (now * by_place, now * by_step), dt_s)
        sigmas = float(np.sqrt(moves.velocity @ np.linalg.solve(moves.covariance, moves.velocity)))
        motion = Motion(False, moves.velocity, sigmas, bool(known.any()))
        needed = p.alerted_sigmas if alerted else p.sigmas
        slips = sigmas > needed and motion.speed_m_s > p.slip_m_s
        if alerted and known.any():
            fast = float(np.sqrt((seen[known] ** 2).sum(axis=1).mean())) > p.slip_m_s
            slips = slips or (fast and _from_rest(seen[known], at_rest * _of_pads(known, noise_seen)) > needed)
        return replace(motion, slipping=bool(slips))

    def _by_step(self, touch: Touch) -> Floats:
        """(pads, 2, pads, 2), (m/s)^2: covariance of the velocities that the readings' noise does not explain."""
        p, each = self._p, np.tile(self._p.noise_m_s**2 * np.eye(2), (len(touch.velocity), 1, 1))
        before_n, self._force_n = self._force_n, touch.force_n
        if before_n > 0.0 and touch.force_n > 0.0 and touch.dt_s > 0.0:
            growth_1_s = float(np.log(touch.force_n / before_n)) / touch.dt_s
            each += (p.load_m * growth_1_s) ** 2 * np.eye(2)
            if touch.by_taxel_m2 is not None:
                each += (p.load_share * growth_1_s) ** 2 * np.nan_to_num(touch.by_taxel_m2, posinf=0.0)
        apart: Floats = np.einsum("pq,pab->paqb", np.eye(len(each)), each)
        return apart

    def _believed(self, known: Bools, touch: Touch, noise: Floats, moves: StepFilter) -> Bools:
        """(pads,): those known, without outliers: pads far from the prediction in this scan only, while others are not.

        A failed registration lasts one scan; a pad that is far off in two scans shows that the object has started.
        """
        jumps = np.zeros(len(known), dtype=np.bool_)
        if not known.any():
            self._jumped = jumps
            return jumps
        expected, spread = moves.expected(touch.axes, touch.dt_s)
        off = (touch.velocity[:, :2] - expected)[known, :, np.newaxis]
        spread = spread[known] + noise[known, :, known]
        jumps[known] = (off.transpose(0, 2, 1) @ np.linalg.solve(spread, off))[:, 0, 0] > OUTLIER
        doubted = jumps & ~self._jumped if len(self._jumped) and not jumps[known].all() else np.zeros_like(jumps)
        self._jumped = jumps
        return known & ~doubted


def _of_pads(pads: Bools, covariance: Floats) -> Floats:
    """(2 n, 2 n): the blocks of n of the pads in a covariance (pads, 2, pads, 2)."""
    count = 2 * int(pads.sum())
    return covariance[pads][:, :, pads].reshape(count, count)


def _from_rest(velocity: Floats, noise: Floats) -> float:
    """Normal deviate with the same probability as the chi-square of velocities (pads, 2) for an object at rest.

    By the cube root of Wilson & Hilferty (1931). noise: (2 pads, 2 pads), covariance.
    """
    square = float(velocity.ravel() @ np.linalg.solve(noise, velocity.ravel()))
    spread = 2.0 / (9.0 * velocity.size)
    return float((np.cbrt(square / velocity.size) - (1.0 - spread)) / np.sqrt(spread))


def _apart(velocity: Floats, axes: Floats, noise: Floats) -> float | None:
    """Chi-square per degree of freedom of velocities (pads, 2) about one rigid motion; None without freedom.

    Of two facing pads that is their difference. axes: (pads, 2, n). noise: (2 pads, 2 pads), covariance.
    """
    if len(velocity) < 2:
        return None
    whiten = np.linalg.inv(np.linalg.cholesky(noise))
    A, b = whiten @ axes.reshape(-1, axes.shape[-1]), whiten @ velocity.ravel()
    found, _, rank, _ = np.linalg.lstsq(A, b, rcond=1e-6)
    residual = b - A @ found
    return float(residual @ residual) / (len(b) - int(rank))
