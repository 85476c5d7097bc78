"""The web server of the page, which is there before the rest is imported, read or compiled."""

from __future__ import annotations

import socket
from contextlib import redirect_stdout
from io import StringIO
from threading import Event
from typing import TYPE_CHECKING, Any

from taxelflow.errors import ExtraMissing, ParameterInvalid
from taxelflow.publish.view.look import PANEL
from taxelflow.runtime.addresses import MOST_PORT
from taxelflow.runtime.endpoints import authority, family_of

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

_PREPARING = (
    "preparing: starting the estimate, reading the recording or source. The first time, kernels are compiled, "
    "for up to half a minute ..."
)


class PageServer:
    """Serves a page that is being prepared. Raises ExtraMissing without viser, and ParameterInvalid for a host or port
    that it cannot listen at.

    A browser takes a second to load the page: it does so while the command reads and imports. The module imports
    neither numba nor the pipeline. url: where the page is. viser: the server as the page uses it. opened: set when
    a browser has loaded it.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 8080) -> None:
        try:
            import viser
        except ImportError as error:
            raise ExtraMissing("view", "viser") from error
        _check(host, port)
        with redirect_stdout(StringIO()):  # viser prints a banner, and our own line gives the address
            self.viser: Any = viser.ViserServer(host=host, port=port, label="taxelflow", verbose=False)
        self.url = f"http://{authority(host, self.viser.get_port())}"
        gui = self.viser.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.set_panel_label("taxelflow")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL.wide)
        self._preparing = gui.add_markdown(_PREPARING)
        self._open, self.opened = True, Event()
        self.viser.on_client_connect(lambda _: self.opened.set())

    def ready(self) -> None:
        """The page has been filled."""
        self._preparing.remove()

    def close(self) -> None:
        """Stop, once."""
        if self._open:
            self._open = False
            with redirect_stdout(StringIO()):
                self.viser.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check(host: str, port: int) -> None:
    """Raises ParameterInvalid for an address at which viser's thread would fail, after which the command would hang."""
    if not 0 <= port <= MOST_PORT:
        raise ParameterInvalid("port", port, f"be from 0 to {MOST_PORT}")
    try:
        with socket.socket(family_of(host)) as probe:
            probe.bind((host, 0))
    except OSError as error:
        raise ParameterInvalid("host", host, "be an address of this computer, such as 127.0.0.1") from error
