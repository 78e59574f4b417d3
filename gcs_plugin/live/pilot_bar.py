"""The pilot's bar for others' screens: margin, worst rotor, what to do and how old that is.

A small page for BlueOS and Cockpit, which show it in a frame, and the JSON that it is drawn from.
It holds no positions, takes nothing and changes nothing, so it asks for no token; whoever reaches
the port may see it.

    /                     the bar                  /register_service     for BlueOS
    /bar.json             its figures              /cockpit_extras.json  for Cockpit
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.announce import figures, what_to_do
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.small_server import SmallServer
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.wording.alarm_words import ASKED
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.thrust_left import too_little

FRESH = 3.0  # s for which figures are shown as live
FILES = "thrustmargin.gcs_plugin.live"


@dataclass(frozen=True, slots=True)
class _Shown:
    figures: dict[str, float]
    answer: FlightAnswer | None
    update: Update
    low: bool  # too little thrust is left


class PilotBar(Output):
    """An output that serves the bar's page over HTTP; `clock` returns the ground's time, µs.

    `limit` is the least margin, a share. `start` raises LinkError if the port is taken.
    """

    name = "--bar"

    def __init__(self, clock: Callable[[], int], *, limit: float, port: int, host: str) -> None:
        self._clock, self._limit, self._address = clock, limit, (host, port)
        self._shown: dict[int, _Shown] = {}
        self._server: SmallServer | None = None

    def on_round(self, fleet: Fleet, now_us: int) -> None:  # noqa: ARG002
        shown = {}
        for number, watch in fleet.vehicles.items():
            if watch.last is not None:
                found = figures(watch.last) | what_to_do(watch.alarms.listed.values())
                left = found.get("MARGIN", found.get("MARGIN_PRE", math.nan))
                before = number in self._shown and self._shown[number].low
                low = bool(too_little(np.array([[left / 100.0]]), self._limit, before)[0, 0])
                shown[number] = _Shown(found, watch.last.answer, watch.last, low)
        self._shown = shown

    @property
    def port(self) -> int:
        """Return the TCP port on which the bar is served."""
        assert self._server is not None
        return self._server.port

    def start(self) -> None:
        """Open the port and start answering requests, on threads of its own."""
        self._server = SmallServer(self.answer, "--bar", self._address, for_all=True)

    def close(self) -> None:
        """Close the port; harmless when called twice."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return media type and body for the path of an HTTP request: figures (/bar.json), page,
        icon and the registration with BlueOS; None for an unknown path."""
        if path == "/bar.json":
            return "application/json", json.dumps(self.content()).encode()
        if path in ("/", "/index.html"):
            return "text/html; charset=utf-8", _file("bar.html")
        if path in ("/register_service", "/cockpit_extras.json"):
            text = _file(path.removeprefix("/").removesuffix(".json") + ".json").decode()
            return "application/json", text.replace("VERSION", _version()).encode()
        return ("image/svg+xml", _file("icon.svg")) if path == "/icon.svg" else None

    def content(self) -> dict[str, Any]:
        """Return the content of /bar.json: `schema`, `limit` (least margin, %) and `vehicles`, a
        dict a vehicle.

        Its keys: `vehicle` (system id), `age_s`, `margin`, `predicted` and `last_margin`, %, `low`,
        `rotor` (from 1), `action` (text) and `flight` (the answer, or None). `margin`, `predicted`
        and `rotor` are None, `low` False and `action` empty, once they are older than FRESH s;
        `last_margin` stays.
        """
        now_us, vehicles = self._clock(), []
        for number, shown in sorted(self._shown.items()):
            age_s = shown.update.age_s(now_us)
            live, found = age_s <= FRESH, shown.figures
            margin, predicted = found.get("MARGIN"), found.get("MARGIN_PRE")
            vehicles.append(
                {
                    "vehicle": number,
                    "age_s": round(age_s, 1),
                    "margin": margin if live else None,
                    "predicted": predicted if live else None,
                    "last_margin": margin,
                    "low": live and shown.low,
                    "rotor": int(found["MARGIN_ROT"]) if live and "MARGIN_ROT" in found else None,
                    "action": say(ASKED[int(found["MARGIN_DO"])]) if live else "",
                    "flight": None if shown.answer is None else shown.answer.json,
                }
            )
        return {"schema": "thrustmargin.bar/1", "limit": 100.0 * self._limit, "vehicles": vehicles}


def _file(name: str) -> bytes:
    return (resources.files(FILES) / "bar" / name).read_bytes()


def _version() -> str:
    try:
        return version("thrustmargin")
    except PackageNotFoundError:
        return "not installed"


def output(context: OutputContext, value: int) -> PilotBar:
    """Return the output of `--bar PORT`."""
    address = {"port": value, "host": context.options["host"]}
    return PilotBar(context.monitor.now_us, limit=context.least_margin, **address)
