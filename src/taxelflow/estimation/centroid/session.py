"""The session that the centroid methods share: a kernel, its memory of each pad, and the message that it fills."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.estimation.centroid.records import Estimate, Row, ScanBlock, pads_of
from taxelflow.messages import Estimates, Floats, Scans, no_scans
from taxelflow.numerics.records import Records, records, unknown
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.sensors.layout import Layout


class CentroidSession:
    """A causal estimator. Nothing is kept but one small record per pad."""

    def __init__(
        self,
        layout: Layout,
        kernel: Callable[..., None],
        memory: type,
        *constants: Any,
        gains: Floats | None = None,
        prepare: Callable[[Floats, Floats, Records], Records] | None = None,
    ) -> None:
        """kernel: called with (block, places, pads, *constants, memory, rows), as
        `convolution_flow`. memory: the class of its records (pads,), which start as 0. gains: (pads, 2), factors on
        positions along x, y. prepare: called with (noise, places, pads) when the noise changes; what it returns becomes
        the kernel's last constant.
        """
        count = len(layout.pads)
        self._kernel, self._prepare = Settled(kernel), prepare
        self._places = np.stack([layout.x_m, layout.y_m])
        self.gains: Floats = np.ones((count, 2)) if gains is None else gains
        self._pads = pads_of(layout, self.gains)
        self._constants, self._prepared = constants, constants
        self._noise: Floats | None = None
        self._memory = records(memory, count)
        self._nothing = no_scans(layout.entries, count)
        self.step(self._nothing)  # compiles the kernels, or loads them from the cache, before the loop begins

    def room(self, scans: int) -> Records:
        """Rows (scans, pads) of `Row`, all unknown."""
        return unknown(Row, scans, len(self._pads))

    def run(self, scans: Scans, rows: Records) -> None:
        """The bare kernel, into what `room` gave."""
        noise = scans.noise
        if noise is not self._noise:
            self._noise = noise
            if self._prepare:
                self._prepared = (*self._constants, self._prepare(noise, self._places, self._pads))
        pressure = np.ascontiguousarray(scans.pressure)
        block = ScanBlock(scans.t_s, pressure, noise, scans.contact, scans.complete)
        self._kernel(block, self._places, self._pads, *self._prepared, self._memory, rows)

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        rows = self.room(len(scans))
        self.run(scans, rows)
        vectors, matrices = np.empty((2, *rows.shape, 3)), np.empty((2, *rows.shape, 3, 3))
        scalars = np.empty((3, *rows.shape))
        (unpack_block if is_block(len(rows), unpack) else unpack)(rows, vectors, matrices, scalars)
        return Estimates.of(scans.t_s, vectors, matrices, scalars, np.zeros(rows.shape, dtype=np.uint8))

    def finish(self) -> Estimates:
        """Nothing is held back."""
        return self.step(self._nothing)


def pad_gains(layout: Layout, gain: float, calibrated: Floats | None) -> Floats:
    """(pads, 2): one factor for all, times the calibrated ones (pads, 2) if there are any."""
    factors: Floats = np.full((len(layout.pads), 2), gain) * (1.0 if calibrated is None else calibrated)
    return factors


def unpack_block(rows: Records, vectors: Floats, matrices: Floats, scalars: Floats) -> None:
    """`unpack` in NumPy."""
    for estimate, vector, matrix in zip((rows["pose"], rows["displacement"]), vectors, matrices, strict=True):
        for a, name in enumerate(("x", "y", "theta")):
            vector[..., a], matrix[..., a, a] = estimate[name], estimate[f"var_{name}"]
        for a, b, name in ((0, 1, "cov_xy"), (0, 2, "cov_x_theta"), (1, 2, "cov_y_theta")):
            matrix[..., a, b] = matrix[..., b, a] = estimate[name]
    for own, name in zip(scalars, ("span_s", "lag_s", "disturbance"), strict=True):
        own[...] = rows[name]


@kernel
def unpack(rows: Records, vectors: Floats, matrices: Floats, scalars: Floats) -> None:
    """Fill the arrays of `Estimates.of` from rows (scans, pads)."""
    for scan in range(rows.shape[0]):
        for pad in range(rows.shape[1]):
            row: Row = rows[scan, pad]
            _unpack_estimate(row.pose, vectors[0, scan, pad], matrices[0, scan, pad])
            _unpack_estimate(row.displacement, vectors[1, scan, pad], matrices[1, scan, pad])
            scalars[0, scan, pad], scalars[1, scan, pad] = row.span_s, row.lag_s
            scalars[2, scan, pad] = row.disturbance


@routine
def _unpack_estimate(estimate: Estimate, vector: Floats, matrix: Floats) -> None:
    vector[0], vector[1], vector[2] = estimate.x, estimate.y, estimate.theta
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = estimate.var_x, estimate.var_y, estimate.var_theta
    matrix[0, 1] = matrix[1, 0] = estimate.cov_xy
    matrix[0, 2] = matrix[2, 0] = estimate.cov_x_theta
    matrix[1, 2] = matrix[2, 1] = estimate.cov_y_theta
