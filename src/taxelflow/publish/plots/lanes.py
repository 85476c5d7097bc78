"""Contact and slip against time: a lane per method, with the events at their times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.sizes import POSITION
from taxelflow.publish.plots.style import INK, MAGENTA, in_short

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from matplotlib.axes import Axes

    from taxelflow.messages import Event
    from taxelflow.publish.results import Track

_MARKS = {
    "contact": ("|", INK, 9.0),
    "release": ("|", INK, 9.0),
    "slip_start": (">", INK, 4.0),
    "slip_suspected": ("D", MAGENTA, 3.5),
}
"""Marker, colour and size of each event; the end of a slip is that of its bar."""


def draw_lanes(
    axis: Axes,
    tracks: Sequence[Track],
    styles: Sequence[dict[str, Any]],
    events: Sequence[Sequence[Event]],
    start_s: float,
) -> set[str]:
    """Light bar: contact, to its release. Solid bar: slip, since the scan before. Marks: events, slips at their onset.

    Returns the kinds of events that are marked.
    """
    marked = set()
    for lane, (track, style) in enumerate(zip(tracks, styles, strict=True)):
        t_s, colour = track.numbers["t_s"] - start_s, style["color"]
        touching = [(t_s[a], t_s[min(b, len(t_s) - 1)]) for a, b in spans(track.flags["contact"])]
        slipping = [(t_s[max(a - 1, 0)], t_s[b - 1]) for a, b in spans(track.flags["slipping"])]
        for ends, height, alpha in ((touching, 0.30, 0.25), (slipping, 0.62, 0.95)):
            bars = [(float(begin), float(end - begin)) for begin, end in ends]
            axis.broken_barh(bars, (lane - height / 2, height), facecolor=colour, alpha=alpha, linewidth=0)
        seen = events[lane] if lane < len(events) else ()
        for event in seen:
            if event.event in _MARKS and (len(seen) <= POSITION.events or event.event == "slip_suspected"):
                marker, edge, size = _MARKS[event.event]
                when = event.t_s if np.isnan(event.onset_s) else event.onset_s
                axis.plot([when - start_s], [lane], marker=marker, markersize=size, color=edge, markeredgewidth=0.7)
                marked.add(event.event)
    names = [in_short(track.method, style) for track, style in zip(tracks, styles, strict=True)]
    axis.set_yticks(range(len(tracks)), names, fontsize=7)
    axis.set_ylim(len(tracks) - 0.45, -0.55)
    axis.grid(visible=False)
    axis.spines["left"].set_visible(False)
    axis.tick_params(axis="y", length=0)
    return marked
