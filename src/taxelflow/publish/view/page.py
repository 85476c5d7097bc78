"""The page: the scene and its panel, and the loop that feeds them."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.arrows import speed_of_ring
from taxelflow.publish.view.camera import Camera
from taxelflow.publish.view.framing import Framing
from taxelflow.publish.view.look import PANEL, PLOTS
from taxelflow.publish.view.palette import DARK, LIGHT, round_up
from taxelflow.publish.view.panel import OBJECT, Heading, Panel
from taxelflow.publish.view.player import Player
from taxelflow.publish.view.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import Joints
    from taxelflow.publish.view.history import History, Results, Snapshot
    from taxelflow.publish.view.server import PageServer
    from taxelflow.sensors.sensor import Sensor

DRAWING_S = 10.0
"""Within which a drawing ends, also on a busy machine: the server that it draws on closes after it."""
UPDATE_S = 1 / 30
"""The scene is drawn so often while something changes."""
_PLOT_S, _GROW_S = 0.1, 1.0
"""Times between two plots, and between two looks at the highest pressures, by which the scale of a source grows."""


class Page:
    """A hand in the browser.

    Browsers call from threads of their own; the scene is changed by one thread at a time, or an older one of two
    pictures could be drawn over the newer one, and stay.

    player: what is shown when. draws: how often the scene was drawn.
    """

    def __init__(
        self,
        sensor: Sensor,
        histories: tuple[History, ...],
        title: str,
        server: PageServer,
        joints: Joints | None = None,
    ) -> None:
        """server: closed with the page. histories: of each method, which may grow while the page shows them; the first
        one has the pressures.

        joints: angles of the hand's joints, by which its fingers move.
        """
        self.player, self._history = Player(), histories[0]
        self._drawing = threading.RLock()
        self._methods = {history.method: history for history in histories}
        self._page_server, self._server = server, server.viser
        with self._server.atomic():  # a browser that is open already is sent the scene and its camera as one
            self.scene = Scene(self._server, sensor, joints, compares=len(histories) > 1)
            heading = Heading(title, self.scene.note, tuple(self._methods))
            self.panel = Panel(self._server, sensor, self.scene.placement, self.player, heading)
            server.ready()
        self.draws = 0
        self._scaled = (False, False)  # by pressure, by speed
        self._shown: tuple[object, ...] = ()
        self._plotted_s = self._grown_s = 0.0
        self._settled: object = None
        self._listed: object = None
        self.panel.on_look(self.apply_look)
        self.panel.save.on_click(self._save)
        self.panel.face.on_click(self._face)
        self._looked_from: Camera | None = None
        self._framing = Framing(self.scene)
        self._server.on_client_connect(self._connect)
        self.apply_look()

    def on_decide(self, decide: Callable[[float], None]) -> None:
        """Offer in the panel to detect slips again; called with the accepted false alarms per hour."""
        self.panel.on_decide(decide)

    def run(self, stop: threading.Event) -> None:
        """Show what the player points at, until `stop` is set."""
        last = time.monotonic()
        while not stop.is_set():
            now = time.monotonic()
            self.tick(now, now - last)
            last = now
            stop.wait(max(0.0, UPDATE_S - (time.monotonic() - now)))

    @property
    def clients(self) -> dict[int, Any]:
        """Open browsers, by number."""
        found: dict[int, Any] = self._server.get_clients()
        return found

    def close(self) -> None:
        """Stop the server."""
        self._page_server.close()

    @property
    def url(self) -> str:
        """Where the page is."""
        return self._page_server.url

    def wait_for_browser(self, seconds: float) -> bool:
        """Wait until a browser has loaded the page, so long at most; whether one has."""
        return self._page_server.opened.wait(seconds)

    @property
    def histories(self) -> tuple[History, ...]:
        """Of each method, the first one with the pressures."""
        return tuple(self._methods.values())

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and last scan, s of the sensor's clock; 0 without any."""
        return self._history.span[:2]

    def show_at(self, at_s: float) -> None:
        """Draw the scene alone at a time, and write the time beside the scales."""
        self.player.extend(*self.span_s)
        self.player.seek(at_s)
        with self._drawing:
            self._scale_once()
            snapshot = self._snapshot()
            if snapshot is not None:
                self.scene.legend.write(f"{snapshot.t_s - self.player.first_s:.2f} s")
                self._draw(snapshot)
                self.scene.name()

    def direction(self) -> Any:
        """(3,), from which the scene that is shown is seen best."""
        snapshot = self._history.at(self.player.at_s)
        return self.scene.seen_from(None if snapshot is None else snapshot.pressure)

    def tick(self, now_s: float, elapsed_s: float) -> None:
        """Advance by the time that has passed; draw if that changes what is shown."""
        with self._drawing:
            if self._looked_from is not None:
                looked, self._looked_from = self._looked_from, None
                self.scene.turn(looked)
            self._tick(now_s, elapsed_s)

    def _tick(self, now_s: float, elapsed_s: float) -> None:
        first_s, last_s, scans = self._history.span
        if not scans:
            return
        player = self.player
        player.extend(first_s, last_s)
        player.advance(elapsed_s)
        snapshot = self._snapshot()
        if snapshot is None:
            return
        self._scale_once(now_s)
        chosen, decided = (self.panel.method.value, self.panel.second.value), [*map(_progress, self._methods.values())]
        shown = (snapshot.t_s, snapshot.results is None, scans, chosen, decided)
        settled = (shown, player.playing, player.speed, self.panel.pad.value)
        plots = now_s - self._plotted_s >= _PLOT_S and settled != self._settled
        if shown == self._shown and not plots:
            return
        with self._server.atomic():  # one message for both
            if shown != self._shown:
                self._shown = shown
                self._draw(snapshot)
            if plots:
                self._plotted_s, self._settled = now_s, settled
                self._show_panel(snapshot)
        if plots:
            self.scene.name()

    def _snapshot(self) -> Snapshot | None:
        """What is known at the player's time, by the chosen method."""
        snapshot = self._history.at(self.player.at_s)
        if snapshot is None or self._chosen is self._history:
            return snapshot
        return replace(snapshot, results=self._results(snapshot.t_s, snapshot.t_s))

    def _draw(self, snapshot: Snapshot) -> None:
        self.draws += 1
        trail = self._results(snapshot.t_s - PLOTS.shown_s, snapshot.t_s) if self.scene.follows else None
        self.scene.show(snapshot, trail, self._compared(snapshot.t_s, snapshot.t_s))

    def _show_panel(self, snapshot: Snapshot) -> None:
        history, since_s = self._chosen, snapshot.t_s - PLOTS.shown_s
        if history.events is not self._listed:
            self._listed = history.events
            self.panel.strip.list(history.events)
        self.panel.show_time(self._history.times)
        self.panel.show_state(snapshot, history.complete)
        self.panel.show_plots(self._results(since_s, snapshot.t_s), snapshot.t_s, self._compared(since_s, snapshot.t_s))
        if history.complete:
            self.panel.show_patterns(history.patterns, snapshot.t_s)

    @property
    def _chosen(self) -> History:
        return self._methods[self.panel.method.value]

    def _results(self, from_s: float, to_s: float) -> Results | None:
        """Results of the chosen method between two times."""
        return self._chosen.within(from_s, to_s)

    def _compared(self, from_s: float, to_s: float) -> Results | None:
        """Those of the method it is compared with."""
        second = self._methods.get(self.panel.second.value)
        return None if second is None or second is self._chosen else second.within(from_s, to_s)

    def _scale_once(self, now_s: float = 0.0) -> None:
        """Choose the scales from what is known: of pressure with the first scans, of speed with all results."""
        by_pressure, by_speed = self._scaled
        complete = self._history.complete
        if self.player.following:
            if not by_pressure or now_s - self._grown_s >= _GROW_S:
                self._grown_s = now_s
                self._scale_up()
            return
        if by_pressure and (by_speed or not complete):
            return
        top, ring_m_s = self.scene.top, self.scene.ring_m_s
        top = round_up(0.8 * self._history.strongest())
        if complete:
            known = self._history.within(-np.inf, np.inf)
            if known is not None:
                ring_m_s = speed_of_ring(np.hypot(*known.slips.velocity[known.slipping][:, :2].T))
        self._scaled = (True, complete)
        self.panel.set_scales(top, ring_m_s)
        self.scene.configure(top=top, ring_m_s=ring_m_s)

    def _scale_up(self) -> None:
        """Of a live source: the top of the scale grows with the pressure that is seen."""
        top = round_up(0.8 * self._history.strongest())
        if not self._scaled[0] or top > self.panel.scales[0] * (1 + 1e-6):
            self._scaled = (True, True)
            self.panel.set_scales(top, self.scene.ring_m_s)
            self.scene.configure(top=top)

    def apply_look(self) -> None:
        """Draw with the theme and scales that the panel holds."""
        with self._drawing:
            theme = LIGHT if self.panel.light.value else DARK
            self._server.gui.configure_theme(dark_mode=theme.dark, show_logo=False, show_share_button=False)
            top, ring_m_s = self.panel.scales
            self.scene.configure(theme=theme, top=top, ring_m_s=ring_m_s)

    def _connect(self, client: Any) -> None:
        """A browser has loaded the page."""
        client.camera.on_update(self._look_from)
        self._look_from(client.camera)

    def _look_from(self, camera: Any) -> None:
        """A browser's camera has moved, or its window: names face the one that moved last."""
        with self._drawing:
            self._framing.fit(camera)
        self._looked_from = Camera(np.array(camera.position), np.array(camera.look_at))

    def _face(self, event: Any) -> None:
        """Move the user's camera to where the pad of the plots, or else the most loaded one, is seen best."""
        if event.client is None:
            return
        pad = self._loaded_pad() if self.panel.pad.value == OBJECT else self.panel.pad.value
        camera = event.client.camera
        with self._drawing:
            found = self.scene.frame(self.scene.facing(pad), camera.aspect)
        with event.client.atomic():
            camera.position, camera.look_at = found.position, found.look_at

    def _loaded_pad(self) -> str:
        """The pad with the highest pressure at the player's time."""
        layout, snapshot = self.scene.layout, self._history.at(self.player.at_s)
        taxel = 0 if snapshot is None else int(np.argmax(snapshot.pressure))
        return layout.pads[int(np.searchsorted(layout.starts[: layout.pad_count + 1], taxel, side="right")) - 1]

    def _save(self, event: Any) -> None:
        """Send a PNG of the scene as the user's browser shows it."""
        from imageio.v3 import imwrite

        client = event.client
        if client is None:
            return
        high, wide = client.camera.image_height, client.camera.image_width
        share = min(
            1.0, PANEL.saved[0] / high, PANEL.saved[1] / wide
        )  # of another form, its background would not fill it
        height, width = round(share * high), round(share * wide)
        with BytesIO() as file:
            imwrite(file, client.get_render(height, width, transport_format="png", timeout=30.0), extension=".png")
            client.send_file_download("taxelflow.png", file.getvalue(), save_immediately=True)


def _progress(history: History) -> tuple[bool, int]:
    return history.complete, history.changes
