"""Pressure of a contact by a boundary-element solver (tamaas): a rigid surface pressed on an elastic half-space.

Only the total force is from the formulas of `pattern`. The profile of the surface is chosen so that this force gives
about the nominal peak and radius; the pressure follows from elasticity. The stiffness is arbitrary, since pressure and
height scale together: E* is 1 Pa below, and pressures are relative to the peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import map_coordinates

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import TEXTURED, Load
from taxelflow.simulation.pattern import Analytic, roll, tilted
from taxelflow.simulation.texture import feet_of, texture_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Contact


@dataclass(frozen=True, slots=True)
class _Grid:
    """Of the elastic solution."""

    levels: int = 7
    """Forces at which the contact is solved if the force changes; fields are interpolated between them."""
    fewest: int = 256
    most: int = 1024
    """Points of the grid along each axis, a power of 2."""
    cells: int = 8
    """Cells of the grid per pitch, and per radius of the object, where `most` allows it."""
    box: float = 4.0
    box_feet: float = 2.6
    """Side of the periodic box over the reach of the object, and of one on feet."""
    tolerance: float = 1e-6
    """Relative error at which the solver stops."""


_GRID = _Grid()

_QUARTIC = 0.6525
"""A punch of profile C r^4 touches up to r = a under a force of 64/15 E* C a^5 (Sneddon, 1965), which is that of the
airbag p0 exp(-(r/a)^4), pi^1.5/2 p0 a^2, if C = 15 pi^1.5/128 p0 / (E* a^3). Its pressure,
(1 + 2 r^2/a^2) sqrt(1 - r^2/a^2), then peaks at 1.04 p0."""
_CONVERGED = 100 * _GRID.tolerance
"""Relative error below which a solution is accepted."""


class Elastic:
    """Pressure interpolated in fields (levels, n, n) that are solved once and move rigidly with the object."""

    def __init__(self, contact: Contact, load: Load, seed: int, pitch_m: float) -> None:
        self._contact, self._load = contact, load
        low, high = load.extremes
        self._forces = np.linspace(low, high, _GRID.levels if high > low else 1)
        box_m, points = grid_of(contact, high, pitch_m)
        self._cell_m = box_m / points
        self._fields = np.stack([solved(contact, seed, force, box_m, points) for force in self._forces])

    def __call__(self, along: Floats, across: Floats, state: State) -> Floats:
        """See `Pattern`."""
        rolled = roll(self._load, along, across, state)
        middle = (self._fields.shape[1] - 1) / 2
        level = np.zeros(())
        if len(self._forces) > 1:
            level = (state.force - self._forces[0]) / (self._forces[1] - self._forces[0])
        indices = np.broadcast_arrays(level, *(coordinate / self._cell_m + middle for coordinate in rolled))
        field = map_coordinates(self._fields, np.stack(indices), order=1, mode="grid-constant", cval=0.0)
        pressure: Floats = self._contact.peak_pa * np.where(state.force > 0, field, 0.0)
        return tilted(self._contact, self._load, pressure, rolled, state)


def grid_of(contact: Contact, most_force: float, pitch_m: float) -> tuple[float, int]:
    """Side of the periodic box in m, large enough that its images do not interact, and points along it.

    most_force: largest multiple of the nominal force.
    """
    box = _GRID.box_feet if contact.shape == "feet" else _GRID.box
    box_m = box * contact.reach_m * max(1.0, most_force) ** (1 / 3)
    wanted = box_m / (min(pitch_m, contact.radius_m) / _GRID.cells)
    return box_m, int(np.clip(2 ** np.ceil(np.log2(wanted)), _GRID.fewest, _GRID.most))


@lru_cache(maxsize=16)
def solved(contact: Contact, seed: int, force: float, box_m: float, points: int) -> Floats:
    """Pressure (points, points) over the peak, first axis along the object, for a multiple of the nominal force."""
    along, across = _grid(box_m, points)
    still = State(*(np.array(number) for number in (1.0, 0.0, 0.0, 0.0, 0.0)))
    mean = float(Analytic(contact, Load(), seed)(along, across, still).mean()) / contact.peak_pa
    return _solve(profile(contact, seed, along, across), force * mean, box_m)


def profile(contact: Contact, seed: int, along: Floats, across: Floats) -> Floats:
    """Height (...) of the object's surface towards the skin at points of its frame, in m if E* is `peak_pa`."""
    radius = contact.radius_m
    if contact.shape == "feet":
        return _caps(contact, along, across)
    r2 = (along / contact.length_m) ** 2 + (across / radius) ** 2
    if contact.shape == "hertz":
        sphere: Floats = -np.pi / 4 * radius * r2  # R = 2 a E* / (pi p0)
        return sphere
    punch: Floats = -_QUARTIC * radius * r2**2
    if contact.shape in TEXTURED:
        texture = texture_of(contact, seed)
        scale = contact.texture * np.sqrt(2 / len(texture.length_m)) / np.pi  # a wave A cos(kx) presses E* k A / 2
        for length, term in zip(texture.length_m, texture.terms(along, across), strict=True):
            punch += scale * length * term
    return punch


def _caps(contact: Contact, along: Floats, across: Floats) -> Floats:
    """Paraboloids, each of such a height that its pressure peaks as `feet_of` gives it."""
    positions, peaks = feet_of(contact)
    surface: Floats = np.full(along.shape, -np.inf)
    for (x, y), peak in zip(positions, peaks, strict=True):
        r2 = ((along - x) ** 2 + (across - y) ** 2) / contact.radius_m**2
        surface = np.maximum(surface, np.pi / 2 * contact.radius_m * (peak**2 - r2 / 2))
    return surface


def _grid(box_m: float, points: int) -> tuple[Floats, Floats]:
    axis = (np.arange(points) - (points - 1) / 2) * box_m / points
    along, across = np.meshgrid(axis, axis, indexing="ij")
    return along, across


def _solve(surface: Floats, mean: float, box_m: float) -> Floats:
    """Pressure (n, n) for E* = 1 Pa and a mean pressure, by the conjugate gradients of Polonsky and Keer (1999).

    Raises ExtraMissing, and ParameterInvalid without convergence.
    """
    try:
        import tamaas
    except ImportError as error:
        raise ExtraMissing("elastic", "tamaas") from error
    log_level = tamaas.get_log_level()
    tamaas.set_log_level(tamaas.LogLevel.error)
    try:
        model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [box_m, box_m], list(surface.shape))
        model.E, model.nu = 1.0, 0.0
        solver = tamaas.PolonskyKeerRey(model, np.ascontiguousarray(surface), _GRID.tolerance)
        residual = solver.solve(mean)
        pressure: Floats = np.array(model.traction, dtype=np.float64)
    finally:
        tamaas.set_log_level(log_level)
    if not residual <= _CONVERGED:
        duty = f"be analytic, or the contact smoother: the solver has not converged (residual {residual:.1g})"
        raise ParameterInvalid("solver", "elastic", duty)
    return pressure
