"""Key scans and the sensor's health, for the report, from the recording."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.evaluation.checkup import check_up
from taxelflow.evaluation.source import pressure_at
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.hand import at_contacts
from taxelflow.publish.plots.outlines import box_mm
from taxelflow.publish.report.charts import shades
from taxelflow.publish.report.page import Sheet
from taxelflow.publish.results import counted_once, with_arrows

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Event, Floats
    from taxelflow.publish.results import Track
    from taxelflow.publish.summary import Summary
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True)
class _Key:
    """Key scans of a report."""

    most: int = 12
    """Key scans of a report at most."""
    apart_s: float = 0.5
    """Key scans are at least this far apart."""
    arrow: float = 0.09
    """An arrow of the median of the scans' fastest slips, as a share of the width of the picture; none is twice as
    long."""


_KEY = _Key()
_GONE = "The recording is gone or has changed since: no scans to show."


_Arrow = tuple[float, float, float, float, str]
"""x, y in m and vx, vy in m/s on the hand, colour."""


class Shown(NamedTuple):
    """A result as the report shows it. tracks: of pads that touched; label: method, and folder if it is not unique."""

    directory: Path
    ran: Summary
    tracks: list[Track]
    events: list[Event]
    label: str
    colour: str


class Health(NamedTuple):
    """The sensor's health. picture: shades and marks per taxel, None without the recording."""

    sheet: Sheet
    findings: list[str]
    picture: dict[str, Any] | None


class _Moment(NamedTuple):
    t_s: float
    pad: str
    caption: str


def health_of(ran: Summary, recording: Recording | None) -> Health:
    """A check-up of the recording; what the summary knows if it is gone."""
    if recording is None:
        rows = [
            [name, "" if pad.noise is None else f"{pad.noise:.3g} {ran.unit}", "yes" if pad.tared else "no"]
            for name, pad in ran.pads.items()
        ]
        return Health(Sheet(["pad", "noise", "tared"], rows), [], None)
    found = check_up(recording)
    heading = ["pad", "taxels", "masked", f"lowest {found.unit}", f"highest {found.unit}", f"noise {found.unit}",
               f"drift {found.unit}", "tared", "never loaded", "saturated", "missing readings", "findings"]  # fmt: skip
    rows = [
        [
            pad.name, str(pad.taxels), str(pad.masked), _number(pad.lowest), _number(pad.highest), _number(pad.noise),
            _number(pad.idle_drift), "yes" if pad.tared else "no", str(len(pad.idle_taxels)),
            str(len(pad.saturated_taxels)), str(pad.missing_readings), str(len(pad.findings)),
        ]
        for pad in found.pads
    ]  # fmt: skip
    layout = recording.layout
    peak, marks = np.full(layout.taxels, np.nan), [" "] * layout.taxels
    for number, pad in enumerate(found.pads):
        for taxel in range(*layout.of_pad(number).indices(layout.taxels)):
            row, col = layout.row[taxel], layout.col[taxel]
            value = pad.picture[row][col]
            peak[taxel] = np.nan if value is None else value
            marks[taxel] = pad.marks[row][col]
    largest = float(np.nanmax(peak, initial=0.0))
    caption = (
        f"Largest reading of each taxel, from light (0) to dark ({largest:.4g} {found.unit}). "
        "Red outline: taxel with a finding; magenta: reached full scale; white: masked."
    )
    masked = [taxel for taxel, mark in enumerate(marks) if mark == "x"]
    picture = {"shades": shades(peak, masked), "marks": "".join(marks), "caption": caption}
    findings = [fault for pad in found.pads for fault in pad.faults]
    return Health(Sheet(heading, rows, [bool(pad.findings) for pad in found.pads]), findings, picture)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def key_scans(
    results: Sequence[Shown], recording: Recording | None, layout: Layout, touched: Sequence[int]
) -> tuple[list[dict[str, Any]], str]:
    """The scan of the largest load and those within the longest slips, with slip vectors; why there are none.

    layout: all pads have a place. touched: numbers of the pads that the picture shows.
    """
    moving = next((result for result in results if any(track.flags["slipping"].any() for track in result.tracks)), None)
    shown = moving or next((result for result in results if result.tracks), None)
    if shown is None:
        return [], "No pad was touched."
    if recording is None:
        return [], _GONE
    moments = _moments(shown, shown.label if len(results) > 1 else "")
    left, right, *_ = box_mm(layout, touched)
    found = pressure_at(shown.ran, recording, [moment.t_s for moment in moments])
    scans = [(moment, found[moment.t_s]) for moment in moments if moment.t_s in found]
    arrows = [_arrows(moment, pressure, results, layout) for moment, pressure in scans]
    fastest = [max((hypot(vx, vy) for _, _, vx, vy, _ in own), default=0.0) for own in arrows]
    usual = float(np.median([speed for speed in fastest if speed > 0.0] or [1.0]))
    usual_mm = _KEY.arrow * (right - left)
    drawn = [
        _scan(moment, pressure[: layout.taxels], own, shown.ran.t_first_s, (usual_mm / usual, 2.0 * usual_mm))
        for (moment, pressure), own in zip(scans, arrows, strict=True)
    ]
    return drawn, "No scan of the recording has the time of a slip."


def _moments(shown: Shown, label: str) -> list[_Moment]:
    """In the order of time. label: of the method whose slips these are, where it is not clear."""
    pads = shown.ran.layout.layout.pads[: shown.ran.layout.layout.pad_count]
    tracks = [track for track in shown.tracks if track.pad in pads]
    load = np.sum([np.nan_to_num(track.numbers["load_pa"]) for track in tracks], axis=0)
    t_s = tracks[0].numbers["t_s"]
    largest = int(np.argmax(load))
    busiest = max(tracks, key=lambda track: float(np.nan_to_num(track.numbers["load_pa"][largest])))
    chosen = [_Moment(float(t_s[largest]), busiest.pad, "largest load")]
    once = counted_once(shown.ran)
    moved = [track for track in shown.tracks if track.pad in once]
    slips = [_slip(track, span, shown) for track in moved for span in spans(track.flags["slipping"])]
    for _, middle_s, pad, caption in sorted(slips, key=lambda slip: -slip[0]):
        if len(chosen) < _KEY.most and all(abs(middle_s - moment.t_s) >= _KEY.apart_s for moment in chosen):
            chosen.append(_Moment(middle_s, pad, caption + (f" by {label}" if label else "")))
    return sorted(chosen)


def _slip(track: Track, span: tuple[int, int], shown: Shown) -> tuple[float, float, str, str]:
    """Path in m, 0 if unknown, time of the middle scan, pad, and the caption of a slip, as its event describes it."""
    (first, stop), t_s = span, track.numbers["t_s"]
    middle_s = float(t_s[(first + stop) // 2 if stop - first > 1 else first])
    last_s = float(t_s[min(stop, len(t_s) - 1)])
    for event in shown.events:
        inside = t_s[first] - SAME_S <= event.t_s <= last_s + SAME_S
        if event.pad == track.pad and event.event in ("slip_start", "slip_stop") and inside and event.path_m > 0:
            caption = f"{track.pad} slips {1e3 * event.path_m:.1f} mm in {event.duration_s:.2f} s"
            return event.path_m, middle_s, track.pad, caption
    return 0.0, middle_s, track.pad, f"{track.pad} slips"


def _arrows(moment: _Moment, pressure: Floats, results: Sequence[Shown], layout: Layout) -> list[_Arrow]:
    """Slip vectors of a scan by all results."""
    arrows = []
    for result in results:
        own = {track.pad: track for track in result.tracks}
        t_s = next(iter(own.values())).numbers["t_s"] if own else np.zeros(0)
        k = int(np.searchsorted(t_s, moment.t_s - SAME_S))
        if k >= len(t_s) or abs(t_s[k] - moment.t_s) > SAME_S:
            continue
        pose, velocity = np.full((2, len(layout.pads), 3), np.nan)
        shown = with_arrows(result.ran)
        for pad, name in enumerate(layout.pads):
            if name in own and shown[pad]:
                pose[pad] = [own[name].numbers[column][k] for column in ("x_m", "y_m", "theta_rad")]
                velocity[pad] = [own[name].numbers[column][k] for column in ("vx_m_s", "vy_m_s", "omega_rad_s")]
        places, vectors = at_contacts(layout, pose, velocity, pressure)
        known = np.isfinite(places).all(axis=1) & np.isfinite(vectors).all(axis=1)
        arrows += [
            (*place, *vector, result.colour)
            for place, vector in zip(places[known].tolist(), vectors[known].tolist(), strict=True)
        ]
    return arrows


def _scan(
    moment: _Moment, pressure: Floats, arrows: Sequence[_Arrow], zero_s: float, scale: tuple[float, float]
) -> dict[str, Any]:
    """A scan as the page draws it. Arrows: x, y, dx, dy in mm on the hand, colour. scale: mm per m/s, and most mm."""
    fastest = max((hypot(vx, vy) for _, _, vx, vy, _ in arrows), default=0.0)
    title = f"{moment.t_s - zero_s:.2f} s: {moment.caption}"
    if fastest:
        title += f"; longest arrow {1e3 * fastest:.3g} mm/s"
    drawn = []
    for x, y, vx, vy, colour in arrows:
        times = min(scale[0], scale[1] / (hypot(vx, vy) or 1.0))
        drawn.append([round(1e3 * x, 2), round(1e3 * y, 2), round(times * vx, 2), round(times * vy, 2), colour])
    return {
        "t_s": round(moment.t_s - zero_s, 3),
        "pad": moment.pad,
        "title": title,
        "shades": shades(pressure),
        "arrows": drawn,
    }
