"""The session that both of the paper's methods share: a kernel, its memory, and the message it fills."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.messages import Bools, Floats, Scans, Slips, judged, no_scans
from taxelflow.sensors.border import border_of, mark_border, pad_load

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from taxelflow.sensors.layout import Layout

DX, DY, X, Y, VAR_X, VAR_Y, COV_XY, D_VAR_X, D_VAR_Y, D_COV_XY, SPAN, LAG, LOAD, DISTURBANCE, COLUMNS = range(15)
"""Columns of the row that a kernel fills per scan and pad: displacement, pose, the pose's covariance, the
displacement's, its span of time, the pose's lag; the pad's load (if the kernel knows it), a sign of slip for methods
without direction."""


class TranslationSession:
    """A causal estimator of translation. Nothing is kept but the kernel's few numbers per pad."""

    def __init__(
        self,
        layout: Layout,
        kernel: Callable[..., None],
        memory: int,
        *constants: Any,
        prepare: Callable[[Floats, Floats, NDArray[np.int64], Floats], Floats] | None = None,
    ) -> None:
        """kernel: called with (t, pressure, noise, contact, complete, places, starts, *constants, memory, rows), as
        `flow.convolution_flow`. memory: numbers it keeps per pad. prepare: called with (noise, places, starts, pitch)
        when the noise changes; what it gives becomes the kernel's last constant.
        """
        self._pads = len(layout.pads)
        self._kernel, self._prepare = kernel, prepare
        self._constants: tuple[Any, ...] = (np.stack([layout.x_m, layout.y_m]), layout.starts, *constants)
        self._pitch = layout.pitch_m
        self._prepared: tuple[Any, ...] = ()
        self._noise: Floats | None = None
        self._edge = border_of(layout)
        self._memory = np.zeros((self._pads, memory))
        self._nothing = no_scans(layout.entries, self._pads)
        self.step(self._nothing)  # compiles the kernel, or loads it from the cache, before the loop begins

    def room(self, scans: int) -> tuple[Floats, Bools]:
        """Rows (scans, pads, COLUMNS), all unknown, and border flags (scans, pads, 2), all clear."""
        border = np.zeros((scans, self._pads, 2), dtype=np.bool_)
        return np.full((scans, self._pads, COLUMNS), np.nan), border

    def run(self, scans: Scans, rows: Floats, border: Bools) -> None:
        """The bare kernels, into what `room` gave."""
        noise = scans.noise
        if noise is not self._noise:
            self._noise = noise
            places, starts = self._constants[:2]
            self._prepared = (self._prepare(noise, places, starts, self._pitch),) if self._prepare else ()
        self._kernel(
            scans.t_s,
            scans.pressure,
            noise,
            scans.contact,
            scans.complete,
            *self._constants,
            *self._prepared,
            self._memory,
            rows,
        )
        pad_load(scans.pressure, self._constants[1], rows[..., LOAD])
        mark_border(scans.pressure, noise, scans.contact, *self._edge, border)

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; see `EstimatorSession.step`."""
        rows, border = self.room(len(scans))
        self.run(scans, rows, border)
        pose = _planar(rows[..., X : Y + 1])
        return Slips(
            t_s=scans.t_s,
            contact=scans.contact,
            border=border,
            displacement=_planar(rows[..., DX : DY + 1]),
            pose=pose,
            covariance=_symmetric(rows[..., VAR_X : COV_XY + 1]),
            displacement_covariance=_symmetric(rows[..., D_VAR_X : D_COV_XY + 1]),
            span_s=rows[..., SPAN],
            lag_s=rows[..., LAG],
            load=rows[..., LOAD],
            disturbance=rows[..., DISTURBANCE],
            quality=judged(pose, border),
        )

    def finish(self) -> Slips:
        """Nothing is held back."""
        return self.step(self._nothing)


def pad_gains(layout: Layout, gain: float, calibrated: Floats | None) -> Floats:
    """(pads, 2): one factor for all, times the calibrated ones (pads, 2) if there are any."""
    factors: Floats = np.full((len(layout.pads), 2), gain) * (1.0 if calibrated is None else calibrated)
    return factors


def _planar(two: Floats) -> Floats:
    """(..., 2) -> (..., 3) with an unknown rotation."""
    three = np.full((*two.shape[:-1], 3), np.nan)
    three[..., :2] = two
    return three


def _symmetric(parts: Floats) -> Floats:
    """(..., 3) of var_x, var_y, cov_xy -> (..., 3, 3) with an unknown rotation."""
    matrix = np.full((*parts.shape[:-1], 3, 3), np.nan)
    matrix[..., 0, 0] = parts[..., 0]
    matrix[..., 1, 1] = parts[..., 1]
    matrix[..., 0, 1] = matrix[..., 1, 0] = parts[..., 2]
    return matrix
