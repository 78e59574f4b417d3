"""The tabs of browsers that show the page: what each has chosen, and its own scene.

A pilot's phone and a laptop look at the same aircraft, but each has its own time in a replay, its
own colour of the route and its own camera. A tab names itself in each request, and so keeps what it
chose when its connection is lost or the page is loaded anew. A program that names no tab has the
server's own scene.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from thrustmargin.gcs_plugin.view.scene.scene import Scene
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera

if TYPE_CHECKING:
    from viser import ViserServer

MOST_TABS = 32  # that are remembered; of more the one that asked longest ago is forgotten


@dataclass(slots=True, eq=False)
class BrowserTab:
    """One tab; `scene` is None until viser has connected it."""

    name: str
    scene: Scene | None = None
    camera: Camera = Camera.FIELD
    client: int | None = None  # viser's number of the connection that `scene` is of
    wanted: int | None = None  # viser's number as its page last said it


Of = TypeVar("Of", bound=BrowserTab)


class Tabs(Generic[Of]):
    """All tabs that asked, made by `new` from their names. `shared` is that of programs."""

    def __init__(self, new: Callable[[str], Of]) -> None:
        self._new, self._lock = new, threading.Lock()
        self._tabs: dict[str, Of] = {}
        self.shared = new("")

    def of(self, name: str) -> Of:
        """Return the tab of this name, a new one at its first request; callable from any thread."""
        if not name:
            return self.shared
        with self._lock:
            tab = self._tabs.pop(name, None) or self._new(name)
            self._tabs[name] = tab  # the last to ask is the last to be forgotten
            for oldest in list(self._tabs)[:-MOST_TABS]:
                del self._tabs[oldest]
        return tab

    def of_client(self, number: int) -> Of:
        """Return the tab of a connection, by viser's number; the shared one for none."""
        return next((tab for tab in self.all if tab.client == number), self.shared)

    @property
    def all(self) -> list[Of]:
        """All tabs with a name."""
        with self._lock:
            return list(self._tabs.values())

    def drawn(self, server: ViserServer, shared: Scene) -> tuple[list[Of], list[Of]]:
        """Return the tabs to draw, the connected ones, else the shared one; and of them the new.

        A tab whose connection is new gets a new scene, and one whose connection is gone has none.
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
