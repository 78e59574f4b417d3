"""The page of a view: a guarded server, the one thread that draws on it, and where to find it.

A pilot's phone and a laptop look at the same aircraft, but each has its own time in a replay, its
own colour of the route and its own camera. A tab names itself in each request, and so keeps what it
chose when its connection is lost or the page is loaded anew. A program that names no tab has the
server's own scene.
"""

from __future__ import annotations

import ipaddress
import logging
import os
import queue
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Generic, TypeVar

from thrustmargin.gcs_plugin.view.page.guard import (
    PageAddition,
    address_of,
    asked_for,
    guarded_server,
    is_loopback,
    stop_server,
)
from thrustmargin.gcs_plugin.view.scene.scene import Scene
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    import viser

FASTEST = 0.04  # s between two drawings
MOST_TABS = 32  # that are remembered; of more the one that asked longest ago is forgotten
#: The option that opens the page to other computers.
OPEN_TO_ALL = "--host 0.0.0.0"
#: An address for documentation (RFC 5737), to which no packet is sent: the system only decides
#: from which of its own addresses it would send one.
ELSEWHERE = ("192.0.2.1", 9)
_log = logging.getLogger(__name__)


class ViewPage(ABC):
    """A page that its own thread draws, every `every` s and whenever `wake` is set.

    `start` opens it, `stop` closes it. `_build` makes its content once and `_draw` updates it.
    `what` names the page in messages; `port` 0 is any free one; `addition` is added to viser's
    page; `token` is what a browser must know, empty for none.
    """

    def __init__(
        self,
        what: str,
        *,
        host: str,
        port: int,
        token: str,
        every: float,
        addition: PageAddition | None = None,
    ) -> None:
        self._addition, self._token = addition, token
        self.wake = threading.Event()  # set: draw at once
        self.draw_seconds: deque[float] = deque(maxlen=1000)  # how long the last drawings took
        self._what, self._host, self._port, self._every = what, host, port, every
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._server: viser.ViserServer | None = None
        self._phone: dict[str, str] | None = None  # the last that `phone_page` made
        self._thread: threading.Thread | None = None

    @abstractmethod
    def _build(self, server: viser.ViserServer) -> None:
        """Create the content of the page, before the first drawing."""

    @abstractmethod
    def _draw(self) -> None:
        """Update the content of the page."""

    @property
    def url(self) -> str:
        """Return the URL of the page with its token. Raise DataError before `start` and after
        `stop`."""
        if self._server is None:
            raise DataError("the view is not open; call start() first")
        ends = f"/?token={self._token}" if self._token else ""
        return f"http://{address_of(self._host)}:{self._server.get_port()}{ends}"

    def phone_page(self) -> dict[str, str] | None:
        """Return `url`, the page's address with token for a phone, and `code`, its QR code (SVG).

        None where no phone in the network can reach the page, or it is not open.
        """
        own = network_address(self._host)
        if own is None or self._server is None:
            return None
        if self._phone is None or self._phone["address"] != own:
            name, port = address_of(own), self._server.get_port()
            url = f"http://{name}:{port}/?token={self._token}"
            self._phone = {"address": own, "url": url, "code": scan_code(url)}
        return {"url": self._phone["url"], "code": self._phone["code"]}

    def start(self) -> None:
        """Open the port, build the page and start drawing. Raises LinkError for a taken port."""
        door = partial(asked_for, token=self._token) if self._token else None
        self._server = guarded_server(
            host=self._host, port=self._port, addition=self._addition, door=door
        )
        # The page has its own controls; viser's panel is what its settings button shows.
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._build(self._server)
        self._thread = threading.Thread(
            target=self._run, args=(self._server,), name=f"{self._what}-page", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop drawing and close the page; harmless when called twice."""
        self._stopping.set()
        self.wake.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None
        if self._server is not None:
            server, self._server = self._server, None
            stop_server(server)

    def announce(self, *, browser: bool) -> None:
        """Print the page's address, and a warning if other computers can reach it.

        `browser`: open it in the browser too, where there is a screen.
        """
        print(f"{self._what} at {self.url} - Ctrl-C ends it", flush=True)
        if not is_loopback(self._host):
            print(
                "others open it at this computer's address in their network, with this token, "
                "which travels unencrypted: docs/live.md says how to put TLS before it",
                flush=True,
            )
        if browser:
            _open_browser(self.url)

    def ask(self, act: Callable[[], None]) -> None:
        """Queue `act` for the drawing thread, which calls it and then draws; callable from any
        thread."""
        self._requests.put(act)
        self.wake.set()

    def _run(self, server: viser.ViserServer) -> None:
        """Draw until `stop` is called; log an error of one drawing and continue."""
        while not self._stopping.is_set():
            self.wake.wait(max(self._every - FASTEST, 0.0))
            self.wake.clear()
            begun = time.perf_counter()
            try:
                with server.atomic():  # a new colour and its legend reach the page together
                    while not self._requests.empty():
                        self._requests.get()()
                    self._draw()
            except Exception:  # of any kind, a page's own too: a pilot must not lose the view
                _log.exception("the %s could not be drawn", self._what)
            took = time.perf_counter() - begun
            self.draw_seconds.append(took)
            self._stopping.wait(max(FASTEST - took, 0.0))


def _open_browser(url: str) -> None:
    # Without a screen a text browser would take over the terminal.
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    import webbrowser

    webbrowser.open(url)


def network_address(host: str) -> str | None:
    """Return the address of this computer at which others reach a server that listens on `host`.

    None where no other computer can, or where this one has no address in a network. `0.0.0.0` and
    `::` listen on all addresses, of which the one of the default route is returned.
    """
    if is_loopback(host):
        return None
    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
        except OSError:
            return None
        own = str(probe.getsockname()[0])
    return None if ipaddress.ip_address(own).is_loopback else own


def scan_code(text: str) -> str:
    """Return the QR code of a text as an SVG of black on white, with its quiet zone."""
    import segno

    code = segno.make(text, error="m", micro=False)
    return code.svg_inline(border=4, dark="#000", light="#fff", omitsize=True)


@dataclass(slots=True, eq=False)
class BrowserTab:
    """A tab of a browser; `scene` is None until viser has connected it."""

    name: str
    scene: Scene | None = None
    camera: Camera = Camera.FIELD
    client: int | None = None  # viser's number of the connection that `scene` is of
    wanted: int | None = None  # viser's number as its page last said it


Of = TypeVar("Of", bound=BrowserTab)


class Tabs(Generic[Of]):
    """All tabs that sent a request, made by `new` from their names; `shared` is for calls from
    programs."""

    def __init__(self, new: Callable[[str], Of]) -> None:
        self._new, self._lock = new, threading.Lock()
        self._tabs: dict[str, Of] = {}
        self.shared = new("")

    def of(self, name: str) -> Of:
        """Return the tab of this name, at first a new one; the shared one for "".

        Of more than MOST_TABS the one unused longest is forgotten. Safe to call from any thread.
        """
        if not name:
            return self.shared
        with self._lock:
            tab = self._tabs.pop(name, None) or self._new(name)
            self._tabs[name] = tab  # the last to ask is the last to be forgotten
            for oldest in list(self._tabs)[:-MOST_TABS]:
                del self._tabs[oldest]
        return tab

    def of_client(self, number: int) -> Of:
        """Return the tab of viser's connection `number`; the shared one if there is none."""
        return next((tab for tab in self.all if tab.client == number), self.shared)

    @property
    def all(self) -> list[Of]:
        """Return all tabs with a name."""
        with self._lock:
            return list(self._tabs.values())

    def drawn(self, server: viser.ViserServer, shared: Scene) -> tuple[list[Of], list[Of]]:
        """Return the tabs to draw, and the tabs that got a scene in this call.

        Drawn are the tabs that viser has connected, else the shared one, whose scene is `shared`
        (given to it in the first call, whether it is drawn or not). A tab whose wanted connection
        exists gets a new scene over it; a tab that lost its connection loses its scene.
        """
        clients, new = server.get_clients(), []
        shared.keep_clients(clients)
        for tab in self.all:
            if tab.client not in clients:
                tab.scene = tab.client = None
            if tab.wanted is not None and tab.wanted != tab.client and tab.wanted in clients:
                tab.client, tab.scene = tab.wanted, shared.for_client(clients[tab.wanted])
                if tab.camera is not Camera.FIELD:
                    tab.scene.set_camera(tab.camera)
                new.append(tab)
        if self.shared.scene is None:
            self.shared.scene = shared
            new.append(self.shared)
        return [tab for tab in self.all if tab.scene is not None] or [self.shared], new
