"""Recording and known trajectory -> calibration: the paper's factor, fitted.

What the edge can do to a scan: where a contact is cut by the pad's border, its centroid is that of the part that is
still there. One pitch beyond a border taxel of pressure p_b lies a place without a taxel. A contact that falls off
outward goes on falling: with r = p_b / p_inner, at most 1, the ratio of the border taxel to its inner neighbour, the
hidden place carries about r p_b, and would move the centroid c by r p_b (|x_b - c| + pitch) / sum(p). The sum of this
over the loaded border taxels is taken as one more standard deviation of the position along that axis. It grows from 0,
where the contact's skirt touches the border, to about the contact's half width where half of it is cut. It stands for
a bias, which is alike in stroke after stroke, so that standard errors are wide rather than narrow where scans are cut.
"""

from __future__ import annotations

from importlib.metadata import version
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.trajectory import Trajectory, read_trajectory
from taxelflow.errors import GainsUnknown, NameUnknown, ParameterInvalid
from taxelflow.estimation.base import Calibratable
from taxelflow.estimation.completion import start_slips
from taxelflow.evaluation.gainfit import GainFit, Sightings, fit_gains
from taxelflow.evaluation.statistics import rms
from taxelflow.messages import Scans, Slips, joined
from taxelflow.pipeline import api
from taxelflow.runtime import registry
from taxelflow.runtime.checks import not_negative, positive
from taxelflow.runtime.compiling import announced
from taxelflow.sensors.calibration import Calibration, PadCalibration, fingerprint

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout

_INTERIOR = 0.05
"""A scan that the edge may move by less than this share of a pitch counts as interior."""


def calibrate(
    recording: Recording | str | Path,
    truth: Trajectory | str | Path | None = None,
    method: str = "convolution",
    *,
    pad: str | None = None,
    search_s: float = 1.0,
    edge: float = 1.0,
    within_m: float | None = None,
) -> Calibration:
    """Gains per pad and axis from a known trajectory (an object or a file); the recording's own truth if none is given.

    method: one that is `Calibratable`, built in or from an entry point. pad: that one only; else the pad of the
    recording's truth, or all that can be calibrated. search_s: largest offset between the clocks, s. edge: factor on
    the standard deviation by the edge; 0 trusts cut contacts. within_m: use only positions at most this far from the
    pad's centre along each axis, m.
    Raises GainsUnknown, NameUnknown, ParameterInvalid and what reading raises.
    """
    estimator = _calibratable(method)
    for name, value in (("search_s", search_s), ("edge", edge)):
        not_negative(name, value)
    if within_m is not None:
        positive("within_m", within_m)
    recording, truth = _opened(recording, truth)
    layout = recording.layout
    names = layout.pads[: layout.pad_count]
    if pad is not None and pad not in names:
        raise NameUnknown("pad", pad, names)
    if truth is None:
        if recording.truth is None:
            raise GainsUnknown(f"{recording.source} holds no truth", "name the robot's trajectory with --truth FILE")
        truth = Trajectory(recording.truth.t_s, recording.truth.pose[:, :2])
        if pad is None and recording.truth.pad in names:  # else the truth is of the whole hand
            pad = recording.truth.pad
    scans, slips = _estimated(recording, estimator)
    found, failed = [], []
    for number, name in enumerate(names):
        if pad in (None, name):
            sightings = _sightings(layout, number, scans, slips, edge, within_m)
            try:
                fit = fit_gains(sightings, truth, layout.pitch_m[number], search_s)
            except GainsUnknown as error:
                failed.append((-len(sightings), f"{name}: {error.why}"))
                continue
            found.append(_entry(name, fit, sightings, layout.pitch_m[number], estimator.pitches_per_index))
    if not found:
        most_seen = [why for _, why in sorted(failed, key=itemgetter(0))]
        raise GainsUnknown("; ".join(most_seen[:3]), "none of these pads can be calibrated by this recording")
    return Calibration(method, recording.sensor.name, fingerprint(recording.sensor), version("taxelflow"), tuple(found))


def _opened(
    recording: Recording | str | Path, truth: Trajectory | str | Path | None
) -> tuple[Recording, Trajectory | None]:
    return (
        recording if isinstance(recording, Recording) else api.read(recording),
        read_trajectory(truth) if isinstance(truth, str | Path) else truth,
    )


def _calibratable(method: str) -> Calibratable:
    """The estimator of that name with its usual parameters. Raises NameUnknown, ParameterInvalid."""
    estimator = api.estimator(method)
    if not isinstance(estimator, Calibratable):
        able = [name for name in registry.names("estimator") if isinstance(api.estimator(name), Calibratable)]
        raise ParameterInvalid("method", method, f"be one that can be calibrated: {', '.join(able)}")
    return estimator


def _estimated(recording: Recording, estimator: Calibratable) -> tuple[Scans, Slips]:
    """All scans, conditioned, and their slips at gain 1."""
    scans = api.conditioned(recording)
    with announced():
        session = start_slips(estimator, recording.layout, "batch")
        return scans, joined([session.step(scans), session.finish()])


def _sightings(layout: Layout, pad: int, scans: Scans, slips: Slips, edge: float, within_m: float | None) -> Sightings:
    """Positions of one pad at gain 1, where they are known."""
    place = slips.pose[:, pad, :2]
    reach = edge * edge_reach(layout, pad, scans.pressure, scans.noise) * scans.contact[:, pad, np.newaxis]
    late = (slips.lag_s[:, pad] > 0)[:, np.newaxis]
    before = np.concatenate([reach[:1], reach[:-1]])
    reach = np.where(late, (reach + before) / 2, reach)  # the index of Method II spans two scans
    known = np.isfinite(place[:, 0])
    if within_m is not None:
        with np.errstate(invalid="ignore"):
            known &= (np.abs(place) <= within_m).all(axis=1)
    noise = np.sqrt(np.diagonal(slips.covariance[:, pad, :2, :2], axis1=1, axis2=2))
    when = slips.t_s - slips.lag_s[:, pad]
    return Sightings(when, place, noise, reach).chosen(known)


def edge_reach(layout: Layout, pad: int, pressure: Floats, noise: Floats) -> Floats:
    """(scans, 2), m: how far what the border hides may have moved the centroid along x, y; 0 for empty scans."""
    own = layout.of_pad(pad)
    p = np.clip(pressure[:, own], 0.0, None) * (pressure[:, own] > 6.0 * noise[own])
    total = np.where(p.sum(axis=1) > 0, p.sum(axis=1), 1.0)
    beside = layout.adjacent[own]
    reach = np.zeros((len(p), 2))
    for axis, r in enumerate((layout.x_m[own], layout.y_m[own])):
        centre = (p @ r) / total
        for side in range(2):
            outer, inner = beside[:, axis, side], beside[:, axis, 1 - side]
            last = np.flatnonzero(outer < 0)
            behind = np.where(inner[last] >= 0, p[:, inner[last]], p[:, last])
            falling = np.minimum(1.0, p[:, last] / np.where(behind > 0, behind, 1.0)) * (p[:, last] > 0)
            arm = np.abs(r[last] - centre[:, np.newaxis]) + layout.pitch_m[pad, axis]
            reach[:, axis] += np.sum(falling * p[:, last] * arm, axis=1) / total
    return reach


def _entry(name: str, fit: GainFit, seen: Sightings, pitch_m: Floats, index_share: float) -> PadCalibration:
    observed = np.isfinite(fit.std)
    clear = (seen.edge_m[fit.used] <= _INTERIOR * pitch_m)[:, observed].all(axis=1)
    calm = fit.residual_m[clear] if clear.any() else fit.residual_m
    std = [float(value) if known else None for value, known in zip(fit.std, observed, strict=True)]
    mm = 1e3 * index_share * pitch_m * fit.gain
    return PadCalibration(
        name=name,
        gain_x=float(fit.gain[0]),
        gain_y=float(fit.gain[1]),
        mm_per_index_x=float(mm[0]),
        mm_per_index_y=float(mm[1]),
        T_pad_robot=(float(fit.T_pad_robot[0]), float(fit.T_pad_robot[1]), float(fit.T_pad_robot[2])),
        std_pad_robot=(float(fit.std_frame[0]), float(fit.std_frame[1]), float(fit.std_frame[2])),
        time_offset_s=fit.offset_s,
        std_time_offset_s=fit.std_offset_s,
        scans=int(fit.used.sum()),
        interior_scans=int(clear.sum()),
        residual_mm=1e3 * rms(calm[:, observed]),
        std_x=std[0],
        std_y=std[1],
        note=fit.note,
    )
