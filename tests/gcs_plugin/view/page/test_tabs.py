"""Tabs of browsers: each gets a scene when its connection is there, and keeps what it chose."""

from types import SimpleNamespace
from typing import Any

from thrustmargin.gcs_plugin.view.page.view_page import BrowserTab, Tabs
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera

MOST_TABS = 32


class FakeScene:
    """A scene that gives each client one of its own, and knows the camera it was given."""

    def __init__(self) -> None:
        self.camera = Camera.FIELD
        self.kept: list[int] = []

    def for_client(self, _: object) -> "FakeScene":
        return FakeScene()

    def keep_clients(self, numbers: Any) -> None:
        self.kept = sorted(numbers)

    def set_camera(self, camera: Camera) -> None:
        self.camera = camera


def server(*clients: int) -> Any:
    return SimpleNamespace(get_clients=lambda: {number: object() for number in clients})


def test_a_tab_is_drawn_while_it_is_connected_and_keeps_its_camera_over_a_new_connection():
    tabs, shared = Tabs(BrowserTab), FakeScene()
    drawn, new = tabs.drawn(server(), shared)  # type: ignore[arg-type]
    assert drawn == new == [tabs.shared]
    phone = tabs.of("phone")
    phone.wanted, phone.camera = 3, Camera.CHASE
    assert tabs.drawn(server(), shared) == ([tabs.shared], [])  # type: ignore[arg-type]
    assert tabs.drawn(server(3), shared) == ([phone], [phone])  # type: ignore[arg-type]
    first: Any = phone.scene
    assert first.camera is Camera.CHASE
    assert tabs.of_client(3) is phone
    assert tabs.of_client(4) is tabs.shared
    assert tabs.drawn(server(3), shared) == ([phone], [])  # type: ignore[arg-type]
    assert tabs.drawn(server(), shared) == ([tabs.shared], [])  # type: ignore[arg-type]
    phone.wanted = 5
    assert tabs.drawn(server(5), shared) == ([phone], [phone])  # type: ignore[arg-type]
    second: Any = phone.scene
    assert second is not first
    assert second.camera is Camera.CHASE
    assert shared.kept == [5]


def test_the_tab_that_asked_longest_ago_is_forgotten():
    tabs = Tabs(BrowserTab)
    phone = tabs.of("phone")
    for number in range(MOST_TABS - 1):
        tabs.of(f"tab {number}")
        assert tabs.of("phone") is phone
    tabs.of("one more")
    assert tabs.of("phone") is phone
    assert "tab 0" not in {tab.name for tab in tabs.all}
    assert tabs.of("") is tabs.shared
