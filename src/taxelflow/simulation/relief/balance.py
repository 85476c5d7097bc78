"""Balance of load and moment: depth and tilts at which the foundation carries a rigid relief.

The pressure at a point is p(h + d + a u + b v), with the relief's height h at body coordinates u, v, the depth d of the
load point and the tilts a and b. d, a and b minimise the convex energy  sum W(h + d + a u + b v) dA - F d - M_u a -
M_v b  with W' = p; there the pressure integrates to the force F, and its moments about the load point to M. Newton's
method with step halving, for all scans at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.relief.parameters import Skin

_STEPS = 60
_EXACT = 1e-9
"""Imbalance, relative to the force and to the force times the object's size, at which the balance is found."""
_STEEPEST = 0.5
"""Tilt beyond which the object has tipped over."""


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """The relief over the points of the skin, scan by scan, all (scans, points).

    height_m: of the relief. u_m, v_m: body coordinates. cell_m2: area of a point.
    """

    height_m: Floats
    u_m: Floats
    v_m: Floats
    cell_m2: float


def pressure_at(skin: Skin, depth_m: Floats) -> Floats:
    """Pressure (...) in Pa at depths (...) in m; 0 where the object does not touch."""
    deep = np.maximum(depth_m, 0.0)
    if skin.exponent == 1:
        return np.asarray(skin.stiffness_pa_m * deep, dtype=np.float64)
    law: Floats = skin.stiffness_pa_m * skin.reference_m * (deep / skin.reference_m) ** skin.exponent
    return law


def settle(skin: Skin, sites: Sites, load: Floats, start: Floats, tilts: bool) -> Floats:
    """Depth and tilts (scans, 3), m and rad, that carry a load.

    load: (scans, 3), force in N and its moments about the load point along u and v in N m: force times lever, for the
    centre of pressure in m. start: (scans, 3), from which to search. Raises ParameterInvalid if the object tips over.
    """
    free = 3 if tilts else 1
    state, size = start.copy(), max(float(np.abs(sites.u_m[sites.height_m > sites.height_m.min()]).max()), 1e-6)
    unit = np.array([1.0, size, size])[:free]
    open_scans = np.flatnonzero(load[:, 0] > 0)
    state[load[:, 0] <= 0] = 0.0
    for _ in range(_STEPS):
        left, hessian = _imbalance(skin, _some(sites, open_scans), state[open_scans], load[open_scans], free)
        wrong = np.abs(left / unit).max(axis=1) > _EXACT * load[open_scans, 0]
        if not wrong.any() and np.abs(state[:, 1:]).max() < _STEEPEST:
            return state
        if not wrong.any():
            break
        open_scans = open_scans[wrong]
        floor = 1e-12 * np.trace(hessian[wrong], axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.diag(unit**2)
        step = -np.linalg.solve(hessian[wrong] + floor, left[wrong, :, np.newaxis])[..., 0]
        some = _some(sites, open_scans)
        state[open_scans, :free] += _shortened(skin, some, state[open_scans], load[open_scans], step)
    raise ParameterInvalid("object", "tips over", "have its load point over the part of the skin that carries it")


def _some(sites: Sites, scans: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Sites:
    """The sites of some scans."""
    if len(scans) == len(sites.height_m):
        return sites
    return Sites(sites.height_m[scans], sites.u_m[scans], sites.v_m[scans], sites.cell_m2)


def depths(sites: Sites, state: Floats) -> Floats:
    """Depth (scans, points) in m; negative where there is a gap."""
    depth: Floats = sites.height_m + state[:, :1]
    if state[:, 1:].any():
        depth += state[:, 1:2] * sites.u_m
        depth += state[:, 2:3] * sites.v_m
    return depth


def _imbalance(skin: Skin, sites: Sites, state: Floats, load: Floats, free: int) -> tuple[Floats, Floats]:
    """Pressure's force and moments minus the load (scans, free), and their derivatives (scans, free, free)."""
    depth = depths(sites, state)
    pressure = sites.cell_m2 * pressure_at(skin, depth)
    if skin.exponent == 1:
        slope: Floats = np.where(depth > 0, sites.cell_m2 * skin.stiffness_pa_m, 0.0)
    else:
        slope = skin.exponent * pressure / np.maximum(depth, 1e-12)
    arms = (None, sites.u_m, sites.v_m)[:free]
    left, hessian = np.empty((len(state), free)), np.empty((len(state), free, free))
    for i, arm in enumerate(arms):
        left[:, i] = _sum(pressure, arm) - load[:, i]
        lever = slope if arm is None else slope * arm
        for j in range(i, free):
            hessian[:, i, j] = hessian[:, j, i] = _sum(lever, arms[j])
    return left, hessian


def _sum(values: Floats, arm: Floats | None) -> Floats:
    """Sum over points (scans,), weighted."""
    total: Floats = values.sum(axis=1) if arm is None else np.einsum("sp,sp->s", values, arm)
    return total


def _energy(skin: Skin, sites: Sites, state: Floats, load: Floats) -> Floats:
    """What the balance minimises (scans,), J."""
    depth = depths(sites, state)
    stored = _sum(pressure_at(skin, depth), np.maximum(depth, 0.0)) * sites.cell_m2 / (skin.exponent + 1)
    energy: Floats = stored - np.sum(load * state, axis=1)
    return energy


def _shortened(skin: Skin, sites: Sites, state: Floats, load: Floats, step: Floats) -> Floats:
    """Steps (scans, free), halved where the energy would rise."""
    before = _energy(skin, sites, state, load)
    step = step.copy()
    for _ in range(30):
        trial = state.copy()
        trial[:, : step.shape[1]] += step
        rises = _energy(skin, sites, trial, load) > before + 1e-12 * np.abs(before)
        if not rises.any():
            break
        step[rises] /= 2
    return step
