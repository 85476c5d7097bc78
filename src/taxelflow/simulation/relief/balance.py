"""Balance of load and moment: depth and tilts at which the foundation carries a rigid relief.

The pressure at a point is p(h + d + a u + b v), with the relief's height h at body coordinates u, v, the depth d of the
load point and the tilts a and b. d, a and b minimise the convex energy  sum W(h + d + a u + b v) dA - F d - M_u a -
M_v b  with W' = p; there the pressure integrates to the force F, and its moments about the load point to M. Newton's
method with steps halved where the energy would rise, for all scans at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import TipsOver

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.relief.parameters import Skin


@dataclass(frozen=True, slots=True)
class _Newton:
    """Of the search for the balance."""

    steps: int = 100
    exact: float = 1e-9
    """Imbalance, relative to the force and to the force times the object's size, at which the balance is found."""
    rounding: float = 1e-12
    """Relative rise of the energy that is rounding."""
    floor: float = 1e-12
    """Stiffness added to each axis, relative to that of all."""
    nothing: float = 1e-9
    """Stiffness in N/m that is added where nothing touches."""
    steepest: float = 0.5
    """Tilt beyond which the object has tipped over."""


_NEWTON = _Newton()


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """The relief over the points of the skin, scan by scan, all (scans, points).

    height_m: of the relief. u_m, v_m: body coordinates. cell_m2: area of a point.
    """

    height_m: Floats
    u_m: Floats
    v_m: Floats
    cell_m2: float

    def at(self, points: Bools) -> Sites:
        """Those of some points."""
        return Sites(self.height_m[:, points], self.u_m[:, points], self.v_m[:, points], self.cell_m2)

    def of(self, scans: NDArray[np.int64]) -> Sites:
        """Those of some scans."""
        if len(scans) == len(self.height_m):
            return self
        return Sites(self.height_m[scans], self.u_m[scans], self.v_m[scans], self.cell_m2)


def pressure_at(skin: Skin, depth_m: Floats) -> Floats:
    """Pressure (...) in Pa at depths (...) in m; 0 where the object does not touch."""
    if skin.exponent == 1:
        return np.asarray(skin.stiffness_pa_m * np.maximum(depth_m, 0.0), dtype=np.float64)
    law, touching = np.zeros(depth_m.shape), depth_m > 0
    law[touching] = (depth_m[touching] / skin.reference_m) ** skin.exponent
    law *= skin.stiffness_pa_m * skin.reference_m
    return law


def depths(sites: Sites, state: Floats) -> Floats:
    """Depth (scans, points) in m; negative where there is a gap."""
    depth: Floats = sites.height_m + state[:, :1]
    if state[:, 1:].any():
        depth += state[:, 1:2] * sites.u_m
        depth += state[:, 2:3] * sites.v_m
    return depth


def settle(skin: Skin, sites: Sites, load: Floats, start: Floats, tilts: bool) -> Floats:
    """Depth and tilts (scans, 3), m and rad, that carry a load.

    load: (scans, 3), a force in N and its moments along u and v about the load point in N m: force times lever.
    start: (scans, 3), from which to search. Raises TipsOver.
    """
    free = 3 if tilts else 1
    near = np.abs(sites.u_m[sites.height_m > sites.height_m.min()])
    size_m = max(float(near.max(initial=0.0)), 1e-6)
    unit = np.array([1.0, size_m, size_m])[:free]
    state, step, before = start.copy(), np.zeros((len(start), free)), np.full(len(start), np.inf)
    left = np.arange(len(start))
    for _ in range(_NEWTON.steps):
        now = _carried(skin, sites.of(left), state[left], load[left], free)
        rises = now.energy > before[left] + _NEWTON.rounding * np.abs(before[left])
        exact = (np.abs(now.excess / unit).max(axis=1) < _NEWTON.exact * load[left, 0]) & ~rises
        goes = ~rises & ~exact
        before[left[goes]] = now.energy[goes]
        step[left[rises]] /= 2
        state[left[rises], :free] -= step[left[rises]]
        step[left[goes]] = _newton(now.slope[goes], now.excess[goes], unit)
        state[left[goes], :free] += step[left[goes]]
        left = left[~exact]
        if not len(left):
            break
    if len(left) or np.abs(state[:, 1:]).max(initial=0.0) > _NEWTON.steepest:
        raise TipsOver
    return state


@dataclass(frozen=True, slots=True, eq=False)
class _Carried:
    """What the foundation carries beyond the load: excess (scans, free) of force and moments, its derivative slope
    (scans, free, free), and the energy (scans,) of foundation and load, J.
    """

    excess: Floats
    slope: Floats
    energy: Floats


def _carried(skin: Skin, sites: Sites, state: Floats, load: Floats, free: int) -> _Carried:
    depth = depths(sites, state)
    force = sites.cell_m2 * pressure_at(skin, depth)
    stored = np.einsum("sp,sp->s", force, depth) / (skin.exponent + 1)  # where there is a gap, there is no force
    stiffness = skin.exponent * np.divide(force, depth, out=np.zeros_like(force), where=depth > 0)
    arms = (None, sites.u_m, sites.v_m)[:free]
    excess, slope = np.empty((len(state), free)), np.empty((len(state), free, free))
    for i, arm in enumerate(arms):
        excess[:, i] = _sum(force, arm) - load[:, i]
        lever = stiffness if arm is None else stiffness * arm
        for j in range(i, free):
            slope[:, i, j] = slope[:, j, i] = _sum(lever, arms[j])
    return _Carried(excess, slope, stored - np.sum(load * state, axis=1))


def _sum(values: Floats, arm: Floats | None) -> Floats:
    """Sum over points (scans,), weighted."""
    total: Floats = values.sum(axis=1) if arm is None else np.einsum("sp,sp->s", values, arm)
    return total


def _newton(slope: Floats, excess: Floats, unit: Floats) -> Floats:
    """Newton's steps (scans, free); a hair of stiffness keeps them finite where too few points touch."""
    floor = _NEWTON.floor * np.trace(slope / np.outer(unit, unit), axis1=1, axis2=2)
    stiff = slope + (floor + _NEWTON.nothing)[:, np.newaxis, np.newaxis] * np.diag(unit**2)
    step: Floats = -np.linalg.solve(stiff, excess[:, :, np.newaxis])[..., 0]
    return step
