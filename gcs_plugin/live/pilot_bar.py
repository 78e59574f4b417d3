"""The pilot's bar for others' screens: margin, worst rotor, what to do and how old that is.

A small page for BlueOS and Cockpit, which show it in a frame, and the JSON that it is drawn from.
It holds no positions, takes nothing and changes nothing, so it asks for no token; whoever reaches
the port may see it.

    /                     the bar                  /register_service     for BlueOS
    /bar.json             its figures              /cockpit_extras.json  for Cockpit
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from thrustmargin.gcs_plugin.live.announce import figures, what_to_do
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
from thrustmargin.gcs_plugin.wording.alarm_words import ASKED
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import LinkError

MOST = 32  # requests at once
FRESH = 3.0  # s for which figures are shown as live
FILES = "thrustmargin.gcs_plugin"


@dataclass(frozen=True, slots=True)
class _Shown:
    figures: dict[str, float]
    answer: FlightAnswer | None
    stamp_us: int  # ground's clock when the row's report came


class _Server(ThreadingHTTPServer):
    """A thread a request, of which there are MOST at once: others are hung up on.

    Else whoever reaches the port could take the threads and files that the monitor needs.
    """

    daemon_threads = True
    request_queue_size = 2 * MOST

    def __init__(self, *args: Any) -> None:
        self._room = threading.BoundedSemaphore(MOST)
        super().__init__(*args)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()


class PilotBar(Subscriber):
    """Serves the bar from `start` to `stop`; `clock` gives the ground's time, µs.

    Raises LinkError from `start` when the port is taken.
    """

    def __init__(self, clock: Callable[[], int], *, limit: float, port: int, host: str) -> None:
        self._clock, self._limit, self._address = clock, limit, (host, port)
        self._shown: dict[int, _Shown] = {}
        self._server: ThreadingHTTPServer | None = None

    def on_round(self, fleet: Fleet, now_us: int) -> None:  # noqa: ARG002
        shown = {}
        for number, watch in fleet.vehicles.items():
            if watch.last is not None:
                found = figures(watch.last) | what_to_do(watch.alarms.listed.values())
                shown[number] = _Shown(found, watch.last.answer, int(watch.last.stamp_us[-1]))
        self._shown = shown

    @property
    def port(self) -> int:
        """Where it is served."""
        assert self._server is not None
        return self._server.server_address[1]

    def start(self) -> None:
        """Open the port and answer, on threads of its own."""
        try:
            self._server = _Server(self._address, _handler(self.answer))
        except (OSError, OverflowError) as error:
            raise LinkError(
                f"--bar {self._address[1]} cannot be opened: {error}; give another port"
            ) from error
        threading.Thread(target=self._server.serve_forever, name="bar", daemon=True).start()

    def stop(self) -> None:
        """Close the port; harmless when called twice."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Media type and body of a path; None for one that is not there."""
        if path == "/bar.json":
            return "application/json", json.dumps(self.content()).encode()
        if path in ("/", "/index.html"):
            return "text/html; charset=utf-8", _file("bar.html")
        if path in ("/register_service", "/cockpit_extras.json"):
            text = _file(path.removeprefix("/").removesuffix(".json") + ".json").decode()
            return "application/json", text.replace("VERSION", _version()).encode()
        return ("image/svg+xml", _file("icon.svg")) if path == "/icon.svg" else None

    def content(self) -> dict[str, Any]:
        """The figures of each vehicle; margins are null once they are older than FRESH."""
        now_us, vehicles = self._clock(), []
        for number, shown in sorted(self._shown.items()):
            age_s = max(0.0, (now_us - shown.stamp_us) * 1e-6)
            live, found = age_s <= FRESH, shown.figures
            margin, predicted = found.get("MARGIN"), found.get("MARGIN_PRE")
            vehicles.append(
                {
                    "vehicle": number,
                    "age_s": round(age_s, 1),
                    "margin": margin if live else None,
                    "predicted": predicted if live else None,
                    "last_margin": margin,
                    "rotor": int(found["MARGIN_ROT"]) if live and "MARGIN_ROT" in found else None,
                    "action": say(ASKED[int(found["MARGIN_DO"])]) if live else "",
                    "flight": None if shown.answer is None else shown.answer.json,
                }
            )
        return {"schema": "thrustmargin.bar/1", "limit": 100.0 * self._limit, "vehicles": vehicles}


def _handler(answer: Callable[[str], tuple[str, bytes] | None]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = 10.0  # s that a slow peer may hold a thread

        def do_GET(self) -> None:
            found = answer(self.path.partition("?")[0])
            if found is None:
                self.send_error(404)
                return
            self.send_response(200)
            for name, value in (
                ("Content-Type", found[0]),
                ("Content-Length", str(len(found[1]))),
                ("Cache-Control", "no-store"),
                ("X-Content-Type-Options", "nosniff"),
                ("Access-Control-Allow-Origin", "*"),
            ):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(found[1])

        def log_message(self, format: str, *args: Any) -> None:
            """Nothing: the terminal is the monitor's."""

    return Handler


def _file(name: str) -> bytes:
    return (resources.files(FILES) / "companion" / name).read_bytes()


def _version() -> str:
    try:
        return version("thrustmargin")
    except PackageNotFoundError:
        return "not installed"
