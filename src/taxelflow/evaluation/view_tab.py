"""A browser's tab, asked by its debugging protocol: what is on the page, how often it draws, how much memory it has."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any
from urllib.request import urlopen

from taxelflow.errors import ExtraMissing
from taxelflow.publish.view.browser import PATIENCE_S, BrowserFailed

if TYPE_CHECKING:
    from pathlib import Path

DEBUGGED = "--remote-debugging-port=0"
"""Flag by which a browser lets itself be asked, on this computer only."""
_PORT_FILE = "DevToolsActivePort"
_COUNT = "window.drawn = 0; (function next() { window.drawn++; requestAnimationFrame(next) })(); 0"
_RENDERER = """(() => { const gl = document.createElement('canvas').getContext('webgl');
const known = gl && gl.getExtension('WEBGL_debug_renderer_info');
return known ? gl.getParameter(known.UNMASKED_RENDERER_WEBGL) : 'unknown' })()"""


class Tab:
    """The first tab of a browser that was started with `DEBUGGED`. Raises BrowserFailed, ExtraMissing."""

    def __init__(self, folder: Path) -> None:
        """folder: the browser's own."""
        try:
            from websockets.sync.client import connect
        except ImportError as error:
            raise ExtraMissing("view", "websockets") from error
        self._number = 0
        end = time.monotonic() + PATIENCE_S
        while not (address := _tab_address(folder)):
            if time.monotonic() > end:
                raise BrowserFailed("it cannot be asked")
            time.sleep(0.05)
        self._socket = connect(address, max_size=None, open_timeout=PATIENCE_S)

    def call(self, method: str, **parameters: Any) -> Any:
        """Result of a method of the protocol."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            reply = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if reply.get("id") == self._number:
                return reply.get("result", {})

    def value(self, expression: str) -> Any:
        """Value of an expression in the page."""
        return self.call("Runtime.evaluate", expression=expression).get("result", {}).get("value")

    def open(self, url: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=url)

    def wait_for(self, expression: str) -> None:
        """Wait until an expression in the page is true. Raises BrowserFailed."""
        end = time.monotonic() + PATIENCE_S
        while not self.value(expression):
            if time.monotonic() > end:
                raise BrowserFailed(f"never {expression}")
            time.sleep(0.02)

    def count_pictures(self) -> None:
        """Begin to count."""
        self.value(_COUNT)

    @property
    def pictures(self) -> int:
        """Drawn since the count began."""
        return int(self.value("window.drawn") or 0)

    @property
    def renderer(self) -> str:
        """What the browser draws with."""
        return str(self.value(_RENDERER))

    def heap_mb(self) -> float:
        """JavaScript heap in use, after a collection."""
        self.call("HeapProfiler.collectGarbage")
        return float(self.call("Runtime.getHeapUsage").get("usedSize", float("nan"))) / 1e6

    def close(self) -> None:
        """Leave the tab."""
        self._socket.close()


def _tab_address(folder: Path) -> str:
    """WebSocket of the tab, empty while the browser is not ready."""
    try:
        port = (folder / _PORT_FILE).read_text(encoding="utf-8").split()[0]
        with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE_S) as answer:
            tabs = json.load(answer)
    except (OSError, IndexError, ValueError):
        return ""
    return next((str(tab["webSocketDebuggerUrl"]) for tab in tabs if tab.get("type") == "page"), "")
