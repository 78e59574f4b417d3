"""The page of a view: a guarded server, the one thread that draws on it, and where to find it."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.view.guard import address_of, guarded_server, is_loopback, stop_server
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    import viser

WIDTH = 370  # of the panel on the left, with the gauges


class Page:
    """A page that one thread of its own draws; `open` opens it, `close` ends it.

    `port` 0 is any free one. `stopping` is set when the thread has to end.
    """

    def __init__(self, *, host: str, port: int) -> None:
        self.host = host
        self.stopping = threading.Event()
        self._port = port
        self._server: viser.ViserServer | None = None
        self._thread: threading.Thread | None = None

    @property
    def server(self) -> viser.ViserServer:
        """The server. Raises DataError before `open` and after `close`."""
        if self._server is None:
            raise DataError("the view is not open; call start() first")
        return self._server

    @property
    def url(self) -> str:
        """Where the page is. Raises DataError before `open` and after `close`."""
        return f"http://{address_of(self.host)}:{self.server.get_port()}"

    @property
    def drawing(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def open(
        self,
        build: Callable[[viser.ViserServer], None],
        draw: Callable[[viser.ViserServer], None],
        *,
        name: str,
    ) -> None:
        """Open the port, `build` what is on the page, then `draw` in a thread of this `name`.

        Raises LinkError when the port is taken.
        """
        self._server = guarded_server(host=self.host, port=self._port, label="thrustmargin")
        build(self._server)
        self._thread = threading.Thread(target=draw, args=(self._server,), name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop drawing and close the page; harmless when called twice."""
        self.stopping.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None
        if self._server is not None:
            server, self._server = self._server, None
            stop_server(server)

    def announce(self, what: str, *, browser: bool) -> None:
        """Print where `what` is shown, warn when others can reach it, and open the `browser`."""
        print(f"{what} at {self.url} - Ctrl-C ends it", flush=True)
        if not is_loopback(self.host):
            print(f"on {self.host} anyone who can reach this computer can open it", flush=True)
        if browser:
            _open_browser(self.url)


def arrange(gui: viser.GuiApi, *, width: int) -> None:
    """The project's colours, and the controls on the right, `width` pixels wide."""
    gui.configure_theme(
        dark_mode=False, show_logo=False, show_share_button=False, brand_color=(14, 66, 150)
    )
    gui.main_panel.dock_right()
    gui.main_panel.set_width(width)


def left_panel(gui: viser.GuiApi) -> viser.PanelHandle:
    """The panel on the left, for the gauges."""
    panel = gui.add_panel()
    panel.dock_left()
    panel.set_width(WIDTH)
    return panel


def _open_browser(url: str) -> None:
    # Without a screen a text browser would take over the terminal.
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    import webbrowser

    webbrowser.open(url)
