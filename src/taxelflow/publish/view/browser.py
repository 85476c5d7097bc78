"""A browser without a window, that draws the page for a film or a measurement."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from taxelflow.errors import TaxelflowError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.publish.view.page import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_MAC = "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"
DRAWS = ("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""Flags by which a browser draws in software where there is no graphics card."""
_QUIET = ("--headless=new", "--no-first-run", "--disable-extensions", "--mute-audio", "--hide-scrollbars")
PATIENCE_S = 120.0
"""Time for a headless browser to load the page."""


class BrowserMissing(TaxelflowError):
    """There is no browser that could draw the page."""

    def __init__(self) -> None:
        super().__init__(
            f"no browser is installed (looked for {', '.join(BROWSERS)}); install Chromium, Chrome or Edge, on Debian "
            "with: apt install chromium"
        )


class BrowserFailed(TaxelflowError):
    """The browser did not open the page."""

    def __init__(self, seen: str) -> None:
        super().__init__(f"the browser did not draw the page ({seen}); try `taxelflow view` and open the page by hand")


def installed_browser() -> str:
    """Path of a browser of the Chromium family. Raises BrowserMissing."""
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None and Path(_MAC).is_file():
        found = _MAC
    if found is None:
        raise BrowserMissing
    return found


@contextmanager
def headless(url: str, width: int, height: int, *flags: str) -> Iterator[Path]:
    """Open an address in a window of that size, pixels; close it at the end. Yields the browser's own folder.

    Raises BrowserMissing.
    """
    sandbox = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with TemporaryDirectory(prefix="taxelflow-", ignore_cleanup_errors=True) as folder:
        command = [installed_browser(), *_QUIET, *DRAWS, *sandbox, *flags, f"--window-size={width},{height}"]
        command += [f"--user-data-dir={folder}", url]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield Path(folder)
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def drawn_by(page: Page, beside: int) -> Any:
    """viser's handle of the browser that has opened the page and draws a scene of at most this width in pixels.

    Raises BrowserFailed.
    """
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        for client in page.clients.values():
            if 0 < client.camera.image_width <= beside:
                return client
        time.sleep(0.05)
    raise BrowserFailed(f"nothing within {PATIENCE_S:.0f} s")
