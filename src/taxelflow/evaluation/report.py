"""What `taxelflow report` shows: gathered from results and, where they are still there, from their recordings."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.report_scans import Shown, health_of, key_scans
from taxelflow.evaluation.source import source_of
from taxelflow.publish.plots.film import on_one_plane
from taxelflow.publish.plots.outlines import extent_mm
from taxelflow.publish.plots.style import BLUE, GREEN, MAGENTA, VERMILION, look
from taxelflow.publish.report.charts import hand_chart, result_chart, truth_chart
from taxelflow.publish.report.page import Report, Section, Sheet, write_report
from taxelflow.publish.results import Track, counted_once, read_events, read_result

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Event
    from taxelflow.publish.summary import Summary


@dataclass(frozen=True, slots=True)
class _Page:
    """The size of a page."""

    bytes: float = 3.4e6
    """Text of all trajectories together; the rest of the page takes some hundred kB."""
    events: int = 500
    """Events in the table; how many more there are is stated."""


_PAGE = _Page()
_COLOURS = (BLUE, VERMILION, GREEN, MAGENTA, "#8a6d00", "#56b4e9")
"""Okabe and Ito's, in the order of results; a method keeps the colour of its pictures if no other result has it."""


def make_report(directories: Sequence[Path], out: Path) -> int:
    """Write a report of results into an .html file; return its size in bytes.

    Results of one recording are drawn together, different recordings one after the other. Raises ResultMissing,
    ParameterInvalid, ExtraMissing.
    """
    if not directories:
        raise ParameterInvalid("results", "nothing", "name at least one directory")
    if out.suffix.lower() not in (".html", ".htm"):
        raise ParameterInvalid("out", str(out), "end in .html")
    results = _read(directories)
    recordings: dict[tuple[str, str], list[Shown]] = {}
    for result in results:
        recordings.setdefault((result.ran.input, result.ran.sensor), []).append(result)
    sections = [_section(group, _PAGE.bytes / len(results)) for group in recordings.values()]
    names = [_name(group[0].ran) for group in recordings.values()]
    title = names[0] if len(names) == 1 else f"{len(names)} recordings"
    made_by = f"taxelflow {version('taxelflow')}: {len(results)} result{'s' if len(results) > 1 else ''}"
    return write_report(Report(title, made_by, _overview(results), sections), out)


def _name(ran: Summary) -> str:
    """The recording's file, whatever system it was recorded on."""
    return ran.input.replace("\\", "/").rsplit("/", 1)[-1]


def _read(directories: Sequence[Path]) -> list[Shown]:
    read = [(directory, *read_result(directory), read_events(directory)) for directory in directories]
    runs = [(ran.input, ran.method) for _, ran, _, _ in read]
    results, used = [], set[tuple[str, str]]()
    for directory, ran, tracks, events in read:
        label = str(look(ran.method)["label"])
        if runs.count((ran.input, ran.method)) > 1:
            label = f"{label}, {directory.name}"
        colour = next(
            colour for colour in (look(ran.method)["color"], *_COLOURS, "#5f6368") if (ran.input, colour) not in used
        ) if len(used) < len(_COLOURS) else "#5f6368"  # fmt: skip
        used.add((ran.input, colour))
        touched = [track for track in tracks if track.flags["contact"].any()]
        results.append(Shown(directory, ran, touched, events, label, colour))
    return results


def _section(results: list[Shown], most_bytes: float) -> Section:
    """One recording with all its results."""
    first = results[0]
    recording = source_of(first.ran)
    layout = on_one_plane(first.ran.layout.layout)
    health = health_of(first.ran, recording)
    pads = _busiest(results)
    touched = [pad for pad, name in enumerate(layout.pads[: layout.pad_count]) if name in pads]
    scans, why = key_scans(results, recording, layout, touched)
    charts: dict[str, Any] = {
        "duration_s": round(first.ran.t_last_s - first.ran.t_first_s, 3),
        "pads": pads or [first.ran.layout.layout.pads[0]],
        "results": [_chart(result, most_bytes) for result in results if result.tracks],
        "hand": hand_chart(layout, touched),
        "extent": {pad: [round(side, 2) for side in extent_mm(layout, layout.pads.index(pad))] for pad in pads},
        "scans": scans,
        "no_scans": why,
        "health": health.picture,
    }
    if recording is not None and recording.truth is not None and recording.truth.pad in _pads_of(first):
        charts["results"].append(_truth(recording, first))
    events = [(event, result) for result in results for event in result.events]
    events.sort(key=lambda pair: pair[0].t_s)
    ran = first.ran
    return Section(
        title=_name(ran),
        about=f"{ran.input}: {ran.scans} scans of {ran.sensor} in {ran.t_last_s - ran.t_first_s:.1f} s"
        + (f", {ran.rate_hz:.3g} scans per s" if ran.rate_hz else ""),
        charts=charts,
        pads=_pads(results, pads),
        health=health.sheet,
        events=_events(events[: _PAGE.events], ran.t_first_s),
        parameters=_parameters(results),
        notes=_notes(results),
        findings=health.findings,
        events_left_out=max(len(events) - _PAGE.events, 0),
    )


def _busiest(results: Sequence[Shown]) -> list[str]:
    """Pads that touched, with the longest contact first."""
    count: dict[str, int] = {}
    for result in results:
        for track in result.tracks:
            count[track.pad] = max(count.get(track.pad, 0), int(track.flags["contact"].sum()))
    return sorted(count, key=lambda pad: -count[pad])


def _pads_of(result: Shown) -> list[str]:
    return [track.pad for track in result.tracks]


def _chart(result: Shown, most_bytes: float) -> dict[str, Any]:
    names = {"label": result.label, "short": result.label.split(" (")[0], "colour": result.colour}
    return result_chart(result.tracks, result.events, result.ran.t_first_s, names, most_bytes)


def _truth(recording: Recording, shown: Shown) -> dict[str, Any]:
    """The truth while its pad was touched."""
    truth = recording.known_truth
    (track,) = (track for track in shown.tracks if track.pad == truth.pad)
    # Between no contact (0) and contact (1), interpolated at the truth's times.
    touching = np.interp(truth.t_s, track.numbers["t_s"], track.flags["contact"].astype(np.float64)) > 0.5
    pose = np.where(touching[:, np.newaxis], truth.pose, np.nan)
    return truth_chart(truth.pad, truth.t_s - shown.ran.t_first_s, pose)


def _overview(results: Sequence[Shown]) -> Sheet:
    heading = ["recording", "method", "mode", "scans", "duration s", "contacts", "slips", "slip path mm", "slip s",
               "slip speed mm/s", "poses ok %", "at border %"]  # fmt: skip
    rows = []
    for result in results:
        ran = result.ran
        once = counted_once(ran)
        own = [track for track in result.tracks if track.pad in once]
        rows.append(
            [
                _name(ran),
                result.label,
                ran.mode,
                str(ran.scans),
                f"{ran.t_last_s - ran.t_first_s:.1f}",
                *_moves(own, ran),
            ]
        )
    return Sheet(heading, rows)


def _pads(results: Sequence[Shown], pads: Sequence[str]) -> Sheet:
    heading = [
        "pad",
        "method",
        "contacts",
        "slips",
        "slip path mm",
        "slip s",
        "slip speed mm/s",
        "poses ok %",
        "at border %",
    ]
    rows = [
        [pad, result.label, *_moves([track], result.ran)]
        for pad in pads
        for result in results
        for track in result.tracks
        if track.pad == pad
    ]
    return Sheet(heading, rows)


def _moves(tracks: Sequence[Track], ran: Summary) -> list[str]:
    """Contacts, slips, path while slipping, its duration and mean speed, shares of poses ok and of border contact."""
    pads = {track.pad for track in tracks}
    contacts = [contact for contact in ran.contacts if contact.pad in pads]
    slips = sum(contact.slips for contact in contacts)
    paths_mm = [1e3 * contact.path_m for contact in contacts if contact.path_m is not None]
    path_mm, measured = sum(paths_mm), bool(paths_mm or not slips)
    slip_s = sum(contact.slip_s for contact in contacts)
    ok = known = border = touching = 0.0
    for track in tracks:
        poses = np.isfinite(track.numbers["x_m"])
        ok, known = ok + float((track.flags["ok"] & poses).sum()), known + float(poses.sum())
        count = float(track.flags["contact"].sum())
        border, touching = border + ran.pads[track.pad].border_share * count, touching + count
    speed = f"{path_mm / slip_s:.1f}" if slip_s > 0 else "-"
    shares = [f"{100 * part / all_:.0f}" if all_ else "-" for part, all_ in ((ok, known), (border, touching))]
    moved = [f"{path_mm:.1f}", f"{slip_s:.2f}"] if measured else ["-", "-"]
    return [str(len(contacts)), str(slips), *moved, speed, *shares]


def _events(events: Sequence[tuple[Event, Shown]], zero_s: float) -> Sheet:
    heading = ["time s", "pad", "event", "method", "onset s", "path mm", "speed mm/s", "direction deg", "quality"]
    rows = [
        [
            f"{event.t_s - zero_s:.3f}",
            event.pad,
            event.event.replace("_", " "),
            result.label,
            _number(event.onset_s - zero_s, ".3f"),
            _number(1e3 * event.path_m, ".1f"),
            _number(1e3 * event.speed_m_s, ".1f"),
            _number(float(np.degrees(event.direction_rad)), ".0f"),
            event.quality,
        ]
        for event, result in events
    ]
    return Sheet(heading, rows)


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else ""


def _parameters(results: Sequence[Shown]) -> Sheet:
    """Parameters of all results side by side; rows that differ are marked."""
    flat = [{"method": result.ran.method, "mode": result.ran.mode} | _flat(result.ran.parameters) for result in results]
    names = list(dict.fromkeys(name for own in flat for name in own))
    rows = [[name, *(own.get(name, "") for own in flat)] for name in names]
    marked = [len({own[name] for own in flat if name in own}) > 1 for name in names]
    return Sheet(["parameter", *(result.label for result in results)], rows, marked)


def _flat(value: object, name: str = "") -> dict[str, str]:
    if isinstance(value, dict):
        found: dict[str, str] = {}
        for key, part in value.items():
            found |= _flat(part, f"{name}.{key}" if name else str(key))
        return found
    return {name: str(value)}


def _notes(results: Sequence[Shown]) -> list[str]:
    """Notes of all results, each once; with the method where there are several."""
    notes = []
    for result in results:
        own = [*result.ran.notes, *([result.ran.loss] if result.ran.loss else [])]
        notes += [f"{result.label}: {note}" if len(results) > 1 else note for note in own]
    return list(dict.fromkeys(notes))
