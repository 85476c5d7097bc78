"""What the page's script draws: packed trajectories, lanes of contact and slip, the hand, shades of its taxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.outlines import box_mm, on_hand_mm
from taxelflow.publish.plots.style import INK
from taxelflow.publish.report.series import Packer, binned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Event, Floats
    from taxelflow.publish.results import Track
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True)
class _Rounded:
    """What keeps the report small."""

    position_mm: float = 0.01
    turn_deg: float = 0.05
    load_percent: float = 0.1
    time_s: float = 1e-3
    """Steps that numbers are rounded to."""
    least_bytes: float = 2.0
    """Text that a scan of one pad takes at least; what is longer by far for sure is not tried."""
    most_truth: int = 20_000
    """Bins of a truth."""
    shades: int = 99


_ROUNDED = _Rounded()


def result_chart(
    tracks: Sequence[Track], events: Sequence[Event], zero_s: float, names: dict[str, str], most_bytes: float
) -> dict[str, Any]:
    """One result. tracks: of pads that touched. names: its label, short label and colour. zero_s: time shown as 0.

    Scans are put together in bins of 2, 4, 8, ... until the trajectories take at most `most_bytes`.
    """
    chart: dict[str, Any] = dict(names)
    lags = np.concatenate([track.numbers["lag_s"][track.flags["contact"]] for track in tracks])
    chart["lag_s"] = round(float(np.median(lags[np.isfinite(lags)])), 4) if np.isfinite(lags).any() else 0.0
    chart["lanes"] = {track.pad: _lanes(track, events, zero_s) for track in tracks}
    known = sum(int(track.flags["contact"].sum()) for track in tracks)
    width = 1
    while True:
        if known * _ROUNDED.least_bytes <= most_bytes * width:
            chart |= _trajectories(tracks, zero_s, width)
            if len(chart["packed"]["bytes"]) <= most_bytes:
                return chart
        width *= 2


def _trajectories(tracks: Sequence[Track], zero_s: float, width: int) -> dict[str, Any]:
    packer = Packer()
    t = packer.add((tracks[0].numbers["t_s"] - zero_s)[::width], _ROUNDED.time_s)
    found = {track.pad: _quantities(track, packer, width) for track in tracks}
    return {"width": width, "t": t, "tracks": found, "packed": packer.packed()}


def truth_chart(pad: str, t_s: Floats, pose: Floats) -> dict[str, Any]:
    """The truth of one pad: times (n,) since the recording's first scan, pose (n, 3); no lane."""
    packer = Packer()
    width = -(-len(t_s) // _ROUNDED.most_truth)
    chart: dict[str, Any] = {"label": "truth", "short": "truth", "colour": INK, "truth": True, "lag_s": 0.0}
    chart |= {"width": width, "t": packer.add(t_s[::width], _ROUNDED.time_s), "lanes": {}}
    columns = (("x", 1e3 * pose[:, 0], _ROUNDED.position_mm), ("y", 1e3 * pose[:, 1], _ROUNDED.position_mm))
    turn = ("theta", np.degrees(pose[:, 2]), _ROUNDED.turn_deg)
    wanted = (*columns, turn) if np.ptp(pose[np.isfinite(pose[:, 2]), 2]) > 0 else columns
    chart["tracks"] = {pad: {name: _bins(values, step, packer, width) for name, values, step in wanted}}
    chart["packed"] = packer.packed()
    return chart


def _quantities(track: Track, packer: Packer, width: int) -> dict[str, dict[str, int]]:
    """Numbers of the series of each quantity that is known."""
    found: dict[str, dict[str, int]] = {}
    scales = (("x", "x_m", 1e3, _ROUNDED.position_mm), ("y", "y_m", 1e3, _ROUNDED.position_mm))
    for name, column, scale, step in (*scales, ("theta", "theta_rad", 180 / np.pi, _ROUNDED.turn_deg)):
        values, std = scale * track.numbers[column], scale * track.numbers[f"std_{column}"]
        std = np.where(track.flags["ok"], std, np.nan)  # of others the band is not the error
        if np.isfinite(values).any():
            found[name] = _bins(values, step, packer, width)
            found[name]["std"] = packer.add_log(binned(std, width)[1])
    load = track.numbers["load_pa"]
    most = float(np.nanmax(load, initial=0.0)) or 1.0
    found["load"] = _bins(100 * load / most, _ROUNDED.load_percent, packer, width)
    return found


def _bins(values: Floats, step: float, packer: Packer, width: int) -> dict[str, int]:
    low, high = binned(values, width)
    first = packer.add(low, step)
    return {"lo": first, "hi": first if width == 1 else packer.add(high, step)}


def _lanes(track: Track, events: Sequence[Event], zero_s: float) -> dict[str, Any]:
    t_s = track.numbers["t_s"] - zero_s
    bars = {
        name: [
            [round(float(t_s[first]), 3), round(float(t_s[stop - 1]), 3)] for first, stop in spans(track.flags[flag])
        ]
        for name, flag in (("contact", "contact"), ("slip", "slipping"))
    }
    suspected = [event for event in events if event.pad == track.pad and event.event == "slip_suspected"]
    return {**bars, "suspected": [round(event.t_s - zero_s, 3) for event in suspected]}


def hand_chart(layout: Layout, touched: Sequence[int]) -> dict[str, Any]:
    """Outlines of all taxels, and boxes around them and around the pads touched, mm; all pads have a place."""
    outlines = [np.round(shape, 2).tolist() for pad in range(layout.pad_count) for shape in on_hand_mm(layout, pad)]
    boxes = {"box": box_mm(layout), "touched": box_mm(layout, touched or None)}
    return {"outlines": outlines} | {name: [round(side, 2) for side in box] for name, box in boxes.items()}


def shades(values: Floats, masked: Sequence[int] = ()) -> list[int]:
    """Shade of each taxel (taxels,) from 0 to 99, -1 where it is masked or unknown."""
    top = float(np.nanmax(values, initial=0.0)) or 1.0
    shade = np.where(
        np.isfinite(values), np.clip(np.round(_ROUNDED.shades * values / top), 0, _ROUNDED.shades), -1
    ).astype(int)
    shade[list(masked)] = -1
    return [int(value) for value in shade]
