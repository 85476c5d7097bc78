"""A page of the view in a headless browser, and where things of the scene are in its picture."""

from __future__ import annotations

import shutil
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from taxelflow.messages import Floats
    from taxelflow.publish.view.page import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SIZE = {"width": 960, "height": 560}
_PATIENCE_S = 60.0
_SAME = 5.0
"""Levels of 255 by which two pictures of the same scene differ at most."""


def installed_browser() -> str:
    """Path of the browser; skips the test where there is none."""
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(BROWSERS)})")
    return found


@dataclass
class Browsed:
    """A page of ours in a tab. errors: what the browser's console reports."""

    page: Page
    tab: Any
    errors: list[str] = field(default_factory=list)
    now_s: float = 0.0

    def tick(self, elapsed_s: float = 0.0) -> None:
        """Let time pass for the page."""
        self.now_s += max(elapsed_s, 1.0)
        self.page.tick(self.now_s, elapsed_s)

    def picture(self) -> Floats:
        """(height, width, 3), the scene as it is drawn now, by the browser's own camera."""
        client = self.client
        size = int(client.camera.image_height), int(client.camera.image_width)
        rendered: Any = self._while_open(lambda: client.get_render(*size, transport_format="png", timeout=_PATIENCE_S))
        return np.asarray(rendered[..., :3], dtype=np.float64)

    def settled(self, done: Callable[[Floats], bool] = lambda _: True) -> Floats:
        """The picture when it does not change any more, and something is so; the last one if that never comes."""
        end, before = time.monotonic() + _PATIENCE_S, self.picture()
        while True:
            self.tab.wait_for_timeout(50)
            now = self.picture()
            if time.monotonic() > end or (np.abs(now - before).max() < _SAME and done(now)):
                return now
            before = now

    def _while_open(self, work: Any) -> Any:
        """The result of blocking work, while the tab goes on."""
        found: list[Any] = []
        thread = threading.Thread(target=lambda: found.append(work()))
        thread.start()
        while thread.is_alive():
            self.tab.wait_for_timeout(50)
        return found[0]

    @property
    def client(self) -> Any:
        """What the server knows of the tab."""
        return next(iter(self.page.clients.values()))

    def pixels(self, points: Floats) -> Floats:
        """(n, 2), column and row in the picture of points (n, 3) of the scene."""
        camera = self.client.camera
        ahead = camera.look_at - camera.position
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, camera.up_direction)
        right = right / np.linalg.norm(right)
        seen = (np.atleast_2d(points) - camera.position) @ np.stack([right, np.cross(ahead, right), ahead], axis=1)
        zoom = camera.image_height / 2 / np.tan(camera.fov / 2)
        middle = np.array([camera.image_width, camera.image_height]) / 2
        found: Floats = middle + zoom * seen[:, :2] / seen[:, 2:]
        return found

    def wait_for(self, done: Any) -> None:
        """Let the tab go on until something is so."""
        end = time.monotonic() + _PATIENCE_S
        while not done():
            assert time.monotonic() < end, "the browser did not get there"
            self.tab.wait_for_timeout(50)


@contextmanager
def opened(page: Page, executable: str, size: dict[str, int] = SIZE) -> Iterator[Browsed]:
    """Open a page in a headless browser, in a window of this size."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=list(FLAGS))
        try:
            tab = browser.new_page(viewport=size)
            browsed = Browsed(page, tab)
            tab.on("console", lambda said: browsed.errors.append(said.text) if said.type == "error" else None)
            tab.on("pageerror", lambda error: browsed.errors.append(str(error)))
            tab.goto(page.url)
            tab.wait_for_selector("canvas", timeout=1e3 * _PATIENCE_S)
            beside = size["width"] - 300  # the panel is docked, and the scene has what is left
            browsed.wait_for(lambda: page.clients and 0 < browsed.client.camera.image_width < beside)
            yield browsed
        finally:
            browser.close()
