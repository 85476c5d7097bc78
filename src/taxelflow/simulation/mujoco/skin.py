"""From the depths of a pad's vertices to pressure that sums to the contact's normal force.

MuJoCo's `tactile` sensor gives how deep each vertex of a sheet lies inside the object. That depth follows the solver's
softness, not the skin's. The skin here is an elastic foundation: the object is lowered into it, or lifted out of it,
until its pressures sum to the force that the solver has found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.runtime.checks import at_least, not_negative, positive
from taxelflow.sensors.pad_geometry import present_taxels


@dataclass(frozen=True)
class Skin:
    """Taxels of one pad and their skin; each parameter has its unit in its name."""

    rows: int = 16
    cols: int = 16
    pitch_m: float = 0.002
    fine: int = 4
    """Vertices per taxel and axis. A taxel reads their mean. They have to be closer than a rib's contact is wide."""
    stiffness_pa_m: float = 1.0e8
    """Stiffness of the elastic foundation: 1 mm of indentation gives 100 kPa."""
    cover_m: float = 0.0015
    """Standard deviation of the spread of pressure in the cover over the taxels."""
    noise_pa: float = 100.0
    """Standard deviation of a reading."""
    full_scale_pa: float = 6.0e5
    """A reading is clipped here, and at 0."""
    missing: tuple[tuple[int, int], ...] = ()
    """Cells [row, col] without a taxel, where there is no skin either."""

    def __post_init__(self) -> None:
        for name in ("rows", "cols", "fine"):
            at_least(f"skin.{name}", getattr(self, name), 1)
        for name in ("pitch_m", "stiffness_pa_m", "full_scale_pa"):
            positive(f"skin.{name}", getattr(self, name))
        for name in ("cover_m", "noise_pa"):
            not_negative(f"skin.{name}", getattr(self, name))

    @property
    def step_m(self) -> float:
        """Distance of neighbouring vertices."""
        return self.pitch_m / self.fine

    def places_m(self) -> Floats:
        """(vertices, 2): places in the pad's frame, row by row from the top, as the depths of `pressure`."""
        across = (np.arange(self.cols * self.fine) - (self.cols * self.fine - 1) / 2) * self.step_m
        up = ((self.rows * self.fine - 1) / 2 - np.arange(self.rows * self.fine)) * self.step_m
        return np.stack([np.tile(across, len(up)), np.repeat(up, len(across))], axis=1)

    def pressure(self, depth_m: Floats, force_n: float) -> Floats:
        """(taxels,), Pa, without noise. depth_m: (vertices,), 0 or more, in the order of `places_m`."""
        present, kept = _present(self), _kept(self)
        depth_m = np.where(np.kron(present, np.ones((self.fine, self.fine))).ravel() > 0, depth_m, 0.0)
        if force_n <= 0.0 or not depth_m.any():
            return np.zeros(int(present.sum()))
        fine = self.stiffness_pa_m * balanced(depth_m, force_n / (self.step_m**2 * self.stiffness_pa_m))
        rows, cols = _spread(self, self.rows), _spread(self, self.cols)
        pressure: Floats = rows @ (fine.reshape(kept.shape) / kept) @ cols.T
        return pressure[present]

    def read(self, pressure_pa: Floats, random: np.random.Generator) -> Floats:
        """Readings of pressures: with noise, clipped."""
        noisy: Floats = pressure_pa + random.normal(0.0, self.noise_pa, pressure_pa.shape)
        return np.clip(noisy, 0.0, self.full_scale_pa)


@cache
def _present(skin: Skin) -> Bools:
    """(rows, cols), whether there is a taxel."""
    return present_taxels(skin.rows, skin.cols, skin.missing)


@cache
def _kept(skin: Skin) -> Floats:
    """(rows, cols) of vertices: share of the pressure there that taxels read; the cover spreads the rest away."""
    if not skin.missing:
        return np.ones((skin.rows * skin.fine, skin.cols * skin.fine))
    share: Floats = skin.fine**2 * _spread(skin, skin.rows).T @ _present(skin) @ _spread(skin, skin.cols)
    return share


@cache
def _spread(skin: Skin, taxels: int) -> Floats:
    """(taxels, vertices) along one axis: the cover's blur, which keeps the sum, then the mean over each taxel."""
    at = np.arange(taxels * skin.fine) * skin.step_m
    apart = at[:, None] - at
    blur = np.exp(-0.5 * (apart / skin.cover_m) ** 2) if skin.cover_m > 0.0 else np.eye(len(at))
    mean = np.kron(np.eye(taxels), np.full((1, skin.fine), 1.0 / skin.fine))
    return np.asarray(mean @ (blur / blur.sum(axis=0)), dtype=np.float64)


def balanced(depth_m: Floats, sum_m: float) -> Floats:
    """(vertices,): depths that sum to `sum_m`: max(depth - lift, 0), with the one lift that balances.

    Where the depths sum to less, the object's shape beyond their rim is unknown, and they are scaled instead.
    depth_m: (vertices,), 0 or more, not all 0.
    """
    total = depth_m.sum()
    if total <= sum_m:
        return np.asarray(depth_m * (sum_m / total))
    top = np.sort(depth_m)[::-1]
    lifts = (np.cumsum(top) - sum_m) / np.arange(1, len(top) + 1)
    pressed = int(np.flatnonzero(top > lifts)[-1])  # that many stay in contact; the deepest one always does
    return np.asarray(np.maximum(depth_m - lifts[pressed], 0.0))
