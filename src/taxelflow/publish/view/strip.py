"""The event strip: contacts and slips of each pad over time. Clicking it, or its buttons, sets the time."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.publish.view.look import STRIP

if TYPE_CHECKING:
    from taxelflow.messages import Event
    from taxelflow.publish.view.player import Player

MARKED = ("slip_start", "slip_suspected")

_PRESSED = (
    "const own=this.getBoundingClientRect(),track=document.querySelector('[role=slider]').parentElement,"
    "box=track.getBoundingClientRect(),share=(event.clientX-own.left)/own.width,"
    "at={clientX:box.left+share*box.width,clientY:box.top,bubbles:true,cancelable:true};"
    "track.dispatchEvent(new MouseEvent('mousedown',at));document.dispatchEvent(new MouseEvent('mouseup',at))"
)
"""JavaScript that passes a click on the strip on to the time slider, at the same share of its length."""

_JUMPS = ("previous", "next")
_NONE = "no slip yet"
_GREEN, _ORANGE, _PALE, _GREY = "#1d9a6c", "#eb5a14", "#e0a080", "#8f95a3"


class Bar(NamedTuple):
    """A stretch of time on the strip. lane: its pad. colour: CSS."""

    lane: str
    from_s: float
    to_s: float
    colour: str


class Strip:
    """Beside the scene; its buttons and list set the player."""

    def __init__(self, gui: Any, player: Player) -> None:
        self._player = player
        self._marks: list[float] = []
        self._words: list[str] = []
        self._events: list[Event] = []
        self._near: tuple[str, ...] = ()
        with gui.add_folder("Events"):
            self._picture = gui.add_html("")
            self._buttons = gui.add_button_group("go to", _JUMPS)
            self._list = gui.add_dropdown("all slips", (_NONE,), initial_value=_NONE)
        self._buttons.on_click(self._chosen)
        self._list.on_update(self._chosen)

    def list(self, events: list[Event]) -> None:
        """All events that are known."""
        first = self._player.first_s
        self._events = events
        slips = sorted((event for event in events if event.event in MARKED), key=_onset)
        listed = {  # once each: a slip may be suspected again, and a list with one entry twice ends the whole page
            f"{_onset(event) - first:.3f} s {event.pad}" + ("" if event.event == "slip_start" else "?"): _onset(event)
            for event in slips
        }
        self._words, self._marks = [*listed], [*listed.values()]
        self._list.options = tuple(self._words[: STRIP.listed]) or (_NONE,)
        self._near = ()

    def show(self, at_s: float) -> None:
        """Move to a time."""
        player = self._player
        self._picture.content = strip_svg(self._events, player.first_s, player.last_s, at_s)
        after = int(np.searchsorted(self._marks, at_s + 1e-6))
        begin = max(0, min(after - STRIP.buttons // 2, len(self._words) - STRIP.buttons))
        near = (*_JUMPS, *self._words[begin : begin + STRIP.buttons])
        if near != self._near:  # else a button would be replaced while it is clicked
            self._near = near
            self._buttons.options = near

    def _chosen(self, event: Any) -> None:
        when, found, _ = event.target.value.partition(" s ")
        if event.target.value in _JUMPS:
            self._player.jump(self._marks, back=event.target.value == _JUMPS[0])
        if event.client is not None and found:
            self._player.playing = False
            self._player.seek(self._player.first_s + float(when))


def bars_of(events: list[Event], last_s: float) -> list[Bar]:
    """Contacts, then slips over them; what has not ended yet lasts until last_s."""
    contacts: list[Bar] = []
    slips: list[Bar] = []
    since: dict[tuple[str, str], float] = {}
    ends = {"release": "contact", "slip_stop": "slip"}
    for event in events:
        kind = {"contact": "contact", "slip_start": "slip"}.get(event.event)
        if kind is not None:
            since[event.pad, kind] = _onset(event)
        elif event.event in ends:
            begin = since.pop((event.pad, ends[event.event]), None)
            if begin is not None:
                into, colour = (contacts, _GREEN) if ends[event.event] == "contact" else (slips, _ORANGE)
                into.append(Bar(event.pad, begin, _onset(event), colour))
        elif event.event == "slip_suspected":
            length = event.duration_s if np.isfinite(event.duration_s) else 0.0
            slips.append(Bar(event.pad, _onset(event), _onset(event) + length, _PALE))
    for (pad, kind), begin in since.items():
        (contacts if kind == "contact" else slips).append(
            Bar(pad, begin, last_s, _GREEN if kind == "contact" else _ORANGE)
        )
    return [*contacts, *slips]


def strip_svg(events: list[Event], first_s: float, last_s: float, at_s: float) -> str:
    """A picture of the events between two times, with a line at the time that is shown; empty without events.

    Of many pads those with an event near that time are shown.
    """
    bars = bars_of(events, last_s)[-STRIP.bars :]
    lanes = list(dict.fromkeys(bar.lane for bar in bars))
    if not lanes:
        return ""
    away = {lane: min(max(b.from_s - at_s, at_s - b.to_s, 0.0) for b in bars if b.lane == lane) for lane in lanes}
    hidden, nearest = len(lanes) - STRIP.lanes, sorted(lanes, key=lambda lane: away[lane])[: STRIP.lanes]
    lanes = [lane for lane in lanes if lane in nearest]
    per_s = (STRIP.wide - STRIP.names) / max(last_s - first_s, 1e-9)

    def x(t_s: float) -> float:
        return STRIP.names + min(max(t_s - first_s, 0.0), last_s - first_s) * per_s

    parts = []
    for number, lane in enumerate(lanes):
        middle = (number + 0.5) * STRIP.lane
        parts.append(f'<text x="{STRIP.names - 5}" y="{middle + 3.5:.1f}" text-anchor="end">{escape(lane[:14])}</text>')
        parts.append(
            f'<path d="M{STRIP.names} {middle}H{STRIP.wide}" stroke="{_GREY}" stroke-opacity=".35" stroke-width=".7"/>'
        )
        for bar in bars:
            if bar.lane == lane:
                high = 3 if bar.colour == _GREEN else 8
                wide = max(x(bar.to_s) - x(bar.from_s), 1.5)
                parts.append(
                    f'<rect x="{x(bar.from_s):.1f}" y="{middle - high / 2:.1f}" width="{wide:.1f}" '
                    f'height="{high}" rx="1" fill="{bar.colour}"/>'
                )
    foot = len(lanes) * STRIP.lane + 10
    more = f" (and {hidden} more pads)" if hidden > 0 else ""
    parts.append(f'<text x="{STRIP.names}" y="{foot}">0{more}</text>')
    parts.append(f'<text x="{STRIP.wide}" y="{foot}" text-anchor="end">{last_s - first_s:.3g} s</text>')
    parts.append(f'<path d="M{x(at_s):.1f} 0V{len(lanes) * STRIP.lane}" stroke="currentColor" stroke-width="1.2"/>')
    parts.append(
        f'<rect x="{STRIP.names}" y="0" width="{STRIP.wide - STRIP.names}" height="{len(lanes) * STRIP.lane}" '
        f'fill="transparent" style="cursor:pointer" onmousedown="{_PRESSED}"/>'
    )
    high = len(lanes) * STRIP.lane + STRIP.foot
    return (
        f'<svg viewBox="0 0 {STRIP.wide} {high}" style="display:block;width:100%;padding:0 .75em" font-size="9.5" '
        f'fill="currentColor" font-family="sans-serif">{"".join(parts)}</svg>'
    )


def _onset(event: Event) -> float:
    return event.onset_s if np.isfinite(event.onset_s) else event.t_s
