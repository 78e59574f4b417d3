"""A real Chromium for tests that look at a page as its reader does.

Without a browser a test is skipped, unless THRUSTMARGIN_REQUIRE_BROWSER=1: then it fails.
THRUSTMARGIN_SCREENSHOTS names a folder in which screenshots are kept.
"""

from __future__ import annotations

import asyncio
import atexit
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from playwright.sync_api import Page

#: SwiftShader draws WebGL on the processor; the rest keeps the browser from calling home.
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
LOCAL_HOSTS = frozenset({"127.0.0.1", "localhost", ""})


def chromium_path() -> str | None:
    """The first Chromium or Chrome on this machine, or None."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next(filter(None, map(shutil.which, names)), None)


def require_chromium() -> str:
    """The browser's path; skips the test without one, or fails it where one is required."""
    path = chromium_path()
    if path is None:
        if os.environ.get("THRUSTMARGIN_REQUIRE_BROWSER") == "1":
            pytest.fail("THRUSTMARGIN_REQUIRE_BROWSER=1 but no Chromium or Chrome is installed")
        pytest.skip("no Chromium or Chrome on this machine")
    return path


def screenshot_folder(otherwise: Path) -> Path:
    """The folder for screenshots: THRUSTMARGIN_SCREENSHOTS, or the one given."""
    folder = Path(os.environ.get("THRUSTMARGIN_SCREENSHOTS") or otherwise)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


class _Shared:
    """One Chromium of this process for all pages, each of which gets a context of its own.

    To start a browser and playwright's driver takes longer than most tests of a page.
    """

    def __init__(self) -> None:
        from playwright.sync_api import sync_playwright

        path = require_chromium()  # a driver without a browser would leave its loop to other tests
        self._playwright = sync_playwright().start()
        self.browser = self._playwright.chromium.launch(
            executable_path=path, headless=True, args=[*FLAGS]
        )
        self._loop = asyncio.get_running_loop()
        atexit.register(self._end)

    def go_on(self) -> None:
        asyncio._set_running_loop(self._loop)

    def rest(self) -> None:
        """Playwright marks its loop as running; others in this thread could run none meanwhile."""
        asyncio._set_running_loop(None)

    def _end(self) -> None:
        self.go_on()
        with suppress(Exception):  # it may have died
            self.browser.close()
        self._playwright.stop()


@cache
def _shared(_start: int) -> _Shared:
    return _Shared()


def _living() -> _Shared:
    """The shared browser; a new one where a page has brought it down."""
    return next(one for one in map(_shared, count()) if one.browser.is_connected())


@contextmanager
def open_page(
    url: str, *, width: int = 1600, height: int = 900, script: str = ""
) -> Iterator[Page]:
    """Open `url` as in a fresh headless browser, nothing stored, and yield playwright's page.

    `script` runs before it. Fails on leaving when the page asked anything of another host, or threw
    an error in JavaScript.
    """
    shared = _living()
    shared.go_on()
    elsewhere: list[str] = []
    errors: list[str] = []
    try:
        page = shared.browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(1000 * PATIENCE)
        page.on(
            "request",
            lambda r: (
                elsewhere.append(r.url)
                if (urlsplit(r.url).hostname or "") not in LOCAL_HOSTS
                else None
            ),
        )
        page.on("pageerror", lambda e: errors.append(str(e)))
        if script:
            page.add_init_script(script)
        try:
            page.goto(url)
            yield page
        finally:
            page.close()
    finally:
        shared.rest()
    assert elsewhere == [], f"the page asked other hosts: {elsewhere[:3]}"
    assert errors == [], f"the page threw: {errors[:3]}"
