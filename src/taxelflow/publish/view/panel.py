"""The panel beside the scene: playback, state of each pad with its quality, plots, events, learned map, look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.messages import QUALITY
from taxelflow.publish.spatial import in_words
from taxelflow.publish.view.charts import Charts, load_unit, shown_unit
from taxelflow.publish.view.look import PANEL
from taxelflow.publish.view.palette import DARK, ramp
from taxelflow.publish.view.placement import IN_A_ROW, ON_LINKS, WORDS
from taxelflow.publish.view.strip import Strip

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import LearnedPattern
    from taxelflow.publish.view.history import Results, Snapshot
    from taxelflow.publish.view.placement import Placement
    from taxelflow.publish.view.player import Player
    from taxelflow.sensors.sensor import Sensor

OBJECT = "object (all pads)"
_MARKS = {"assum": "assumed", "not published": "not published", "measured": "measured", "published": "published"}
"""Parts of a note on places, and what they mean; the first one counts."""
NO_METHOD = "none"


class Heading(NamedTuple):
    """What the panel begins with. title: of the recording. note: what the user should know. methods: at least one."""

    title: str
    note: str
    methods: tuple[str, ...]


class Panel:
    """Everything beside the scene. Callbacks set the player; others are set by `on_look` and its like."""

    def __init__(self, server: Any, sensor: Sensor, placement: Placement, player: Player, heading: Heading) -> None:
        self._sensor, self._player = sensor, player
        self._scale, self._unit = shown_unit(sensor)
        self._load = load_unit(self._scale, self._unit)
        self._pads = sensor.layout.pads
        self._times = np.zeros(0)
        self._patterns: list[LearnedPattern] = []
        gui = server.gui
        marks = marked(sensor, placement.how)
        poses = ", ".join(f"{len(own)} {'pad' if len(own) == 1 else 'pads'} {words}" for words, own in marks.items())
        note = f"  \n{heading.note}" if heading.note else ""
        gui.add_markdown(f"**{heading.title}**  \n`{sensor.name}`: {poses}{note}")
        self._status = gui.add_markdown("reading ...")
        self._source = gui.add_markdown("", visible=False)
        self._add_playback(gui)
        self.strip = Strip(gui, player)
        several, methods = len(heading.methods) > 1, heading.methods
        self.method = gui.add_dropdown("method", methods, initial_value=methods[0], visible=several)
        second = methods[1] if several else NO_METHOD
        self.second = gui.add_dropdown("compared with", (NO_METHOD, *methods), initial_value=second, visible=several)
        self.pad = gui.add_dropdown("shown below", (OBJECT, *self._pads), initial_value=OBJECT)
        self._table = gui.add_markdown("")
        self._charts = Charts(gui, *self._load, compares=several)
        with gui.add_folder("Learned map", visible=False) as self._map_folder:
            self._map = gui.add_image(np.zeros((8, 8, 3), np.uint8), format="png")
            self._map_text = gui.add_markdown("")
        with gui.add_folder("Slip detector", expand_by_default=False, visible=False) as self._detector:
            self.alarms = gui.add_number("false alarms per hour", 1.0, min=1e-6)
            self._decide = gui.add_button("Decide again")
            self._decided = gui.add_markdown("")
        self._add_look(gui)
        with gui.add_folder("Where the places come from", expand_by_default=False):
            each = [f"- **{words}**: {', '.join(own)}" for words, own in marks.items()]
            gui.add_markdown("\n".join([*each, notes_of(sensor)]))

    def _add_playback(self, gui: Any) -> None:
        player = self._player
        with gui.add_folder("Playback"):
            buttons = gui.add_button_group("", ("play / pause", "- scan", "+ scan"))
            self.time = gui.add_slider("time, s", 0.0, 1.0, 0.001, 0.0)
            speed = gui.add_dropdown(
                "speed", tuple(f"{value:g} x" for value in PANEL.speeds), initial_value=f"{player.speed:g} x"
            )

        buttons.on_click(self._stepped)
        self.time.on_update(self._sought)
        speed.on_update(self._sped)

    def _stepped(self, event: Any) -> None:
        player = self._player
        if event.target.value == "play / pause":
            player.playing = not player.playing
        else:
            player.step(self._times, 1 if event.target.value == "+ scan" else -1)

    def _sought(self, event: Any) -> None:
        if event.client is not None:  # not one of our own updates
            self._player.playing = False
            self._player.seek(self._player.first_s + event.target.value)

    def _sped(self, event: Any) -> None:
        self._player.speed = float(event.target.value.split()[0])

    def _add_look(self, gui: Any) -> None:
        with gui.add_folder("Look", expand_by_default=False):
            self.light = gui.add_checkbox("light background", False)
            self.top = gui.add_number(f"top of scale, {self._unit}", 1.0, min=1e-3)
            self.ring = gui.add_number("ring, mm/s", 10.0, min=1e-3)
            self.face = gui.add_button("Face the contact")
            self.save = gui.add_button("Save PNG")
            gui.add_markdown(
                "Light of a pad: green contact, orange slip. Arrow: velocity of the object relative to the skin; "
                "grey where the pose is not ok; none within 3 standard deviations of 0; blue: of the method that is "
                "compared. Magenta: motion of the object; grey lines: directions in which its contacts do not show it."
            )

    def on_look(self, changed: Callable[[], None]) -> None:
        """Call this when the user has changed theme or scales."""
        for handle in (self.light, self.top, self.ring):
            handle.on_update(lambda event: changed() if event.client is not None else None)

    def set_scales(self, top: float, ring_m_s: float) -> None:
        """Show the scales that were chosen. top: Pa or counts."""
        self.top.value, self.ring.value = top * self._scale, 1e3 * ring_m_s

    @property
    def scales(self) -> tuple[float, float]:
        """Top of the scale in Pa or counts, speed of the first ring in m/s."""
        return float(self.top.value) / self._scale, 1e-3 * float(self.ring.value)

    def show_time(self, times: Any) -> None:
        """The position, and how far the recording is known."""
        self._times = times
        length = round(max(self._player.last_s - self._player.first_s, 1e-3), 3)
        if self.time.max != length:
            self.time.max = length
        self.time.value = min(max(self._player.at_s - self._player.first_s, 0.0), length)
        self.strip.show(self._player.at_s)

    def on_decide(self, decide: Callable[[float], None]) -> None:
        """Offer to detect slips again, at an accepted rate of false alarms per hour."""
        self._detector.visible = True
        self._decide.on_click(lambda _: decide(float(self.alarms.value)))

    @property
    def decided(self) -> str:
        """What was shown last."""
        return str(self._decided.content)

    def show_decided(self, words: str) -> None:
        """What became of the last request to detect slips again."""
        self._decided.content = words

    def show_source(self, words: str) -> None:
        """Rate, latency and losses of a live source."""
        if words != self._source.content:
            self._source.visible, self._source.content = True, words

    @property
    def source(self) -> str:
        """What was shown last of the source."""
        return str(self._source.content)

    def show_state(self, snapshot: Snapshot, complete: bool) -> None:
        """Time, and a row per pad in contact."""
        player = self._player
        state = "playing" if player.playing else "paused"
        if player.following and player.playing:
            state = "live"
        pending = "" if complete or player.following else " · estimating ..."
        pace = "" if player.following else f" {player.speed:g} x"
        self._status.content = f"**{snapshot.t_s - player.first_s:.3f} s** · {state}{pace}{pending}"
        self._table.content = _table(self._pads, snapshot.results, *self._load)

    def show_plots(self, results: Results | None, at_s: float, second: Results | None) -> None:
        """Draw the last seconds. second: of the method that is compared."""
        pad = None if self.pad.value == OBJECT else self._pads.index(self.pad.value)
        self._charts.show(results, pad, at_s, second)

    def show_patterns(self, patterns: list[LearnedPattern], at_s: float) -> None:
        """The map of the contact on the chosen pad that is nearest in time; of any pad while the object is shown."""
        own = [one for one in patterns if self.pad.value in (OBJECT, one.pad)]
        self._map_folder.visible = bool(own)
        if not own:
            self._patterns = []
            return
        best = min(own, key=lambda one: max(one.t_first_s - at_s, at_s - one.t_last_s, 0.0))
        if self._patterns == [best]:
            return
        self._patterns = [best]
        self._map.image = _picture(best)
        wide, high = 1e3 * np.ptp(best.x_m), 1e3 * np.ptp(best.y_m)
        top = float(np.nanmax(best.pressure)) * self._scale
        self._map_text.content = (
            f"{best.pad}, {best.scans} scans, {wide:.0f} x {high:.0f} mm, up to {top:.3g} {self._unit}; "
            "blank: not observed"
        )


def marked(sensor: Sensor, how: tuple[int, ...]) -> dict[str, list[str]]:
    """Names of pads by where they stand, and whether that is measured, published or assumed by the sensor file's notes.

    how: (pads,), index in `WORDS`.
    """
    found: dict[str, list[str]] = {}
    for pad, way in zip(sensor.pads, how, strict=True):
        hand = "" if sensor.hand is None else sensor.hand.note
        notes = f"{hand if way == ON_LINKS else sensor.note} {pad.note}".lower()
        known = next((mark for part, mark in _MARKS.items() if part in notes), "as the sensor file has it")
        known = f"mounting {known}" if way == ON_LINKS and known == "assumed" else known
        mark = "" if way == IN_A_ROW else f" ({known})"
        found.setdefault(f"{WORDS[way]}{mark}", []).append(pad.name)
    return found


def notes_of(sensor: Sensor) -> str:
    """What the sensor file notes on its pads' places: published, measured or assumed. Pads alike are in one line."""
    own = [("sensor", sensor.note), ("hand", "" if sensor.hand is None else sensor.hand.note)]
    lines: dict[str, list[str]] = {}
    for name, note in [*own, *((pad.name, pad.note) for pad in sensor.pads)]:
        if note:
            lines.setdefault(note, []).append(name)
    return "\n".join(f"- {', '.join(names)}: {note}" for note, names in lines.items())


def _table(pads: tuple[str, ...], results: Results | None, scale: float, unit: str) -> str:
    if results is None:
        return "_no estimate at this time yet_"
    slips, velocity = results.slips, results.slips.velocity[0]
    touched = np.flatnonzero(slips.contact[0])
    if not len(touched):
        return "_no contact_"
    most = touched[np.argsort(-slips.load[0, touched])][: PANEL.table_rows]
    rows = []
    for pad in sorted(most):
        speed = 1e3 * float(np.hypot(*velocity[pad, :2]))
        known = f"{speed:.1f}" if np.isfinite(speed) else "-"
        state = "**slip**" if results.slipping[0, pad] else "rest"
        quality = QUALITY[slips.quality[0, pad]] or "no pose"
        rows.append(f"| {pads[pad]} | {state} | {known} | {_load(slips.load[0, pad] * scale)} | {quality} |")
    spatial = results.spatial
    blind = [] if spatial is None or not spatial.pads[0] else in_words(spatial.blind[0])
    unseen = "".join(f"  \n_not observable: {words}_" for words in blind)
    more = f"\n\n{len(touched) - len(most)} more pads in contact" if len(touched) > len(most) else ""
    return (
        "\n".join([f"| pad | state | mm/s | sum of taxels, {unit} | quality |", "|---|---|---|---|---|", *rows])
        + more
        + (f"\n{unseen}" if unseen else "")
    )


def _load(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _picture(pattern: LearnedPattern) -> Any:
    """(height, width, 4), the map with y up, transparent where nothing was observed."""
    pressure = pattern.pressure[::-1]
    level = np.nan_to_num(pressure) / max(float(np.nanmax(pressure)), 1e-12)
    colours = ramp(DARK.idle)[(255 * np.clip(level, 0.0, 1.0)).astype(int)]
    image = np.dstack([colours, np.where(np.isfinite(pressure), 255, 0).astype(np.uint8)])
    times = max(1, round(PANEL.map / max(image.shape[:2])))
    return image.repeat(times, axis=0).repeat(times, axis=1)
