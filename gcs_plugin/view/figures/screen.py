"""The page's own part around viser's scene: actions, the aircraft from above, alarms, charts.

It is the same for a recorded flight and for aircraft that fly now, from a phone to a wide screen.
Its script requests the state from this server a few times a second, as JSON: numbers, codes and
names. The sentences are those of the catalogue, in the browser's language. The page shows when the
server does not answer. An action needs the token that only this server's own page was given.

`FillAdvice` is the sentence on how much to fill, with the numbers of `thrustmargin fill`.
"""

from __future__ import annotations

import json
import math
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, WARNING, Alarm, AlarmEvent
from thrustmargin.gcs_plugin.store.remembered_day import remembered_day
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures, known
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import (
    LEVELS,
    VehicleSummary,
    severity_level,
)
from thrustmargin.gcs_plugin.view.scene.overlays import Overlay
from thrustmargin.gcs_plugin.view.scene.scene import Scene
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.day_words import day_line
from thrustmargin.gcs_plugin.wording.fill_words import UNSOUND, fill_advice
from thrustmargin.gcs_plugin.wording.language import LANGUAGES, say, spoken
from thrustmargin.gcs_plugin.wording.palette import legend
from thrustmargin.mission.day_fill import day_fill
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.flight_day import day_on_ground
from thrustmargin.models.physics.day import complete_day

CHANGE = 0.003  # of air density, from which it is worked out anew
CHANGE_V = 0.1  # of the battery at rest, likewise


class FillAdvice:
    """The sentence on how much to fill, for one aircraft on the ground; computed anew when the air
    or the battery changes.

    It is for the air and the battery that the aircraft reports, and else for the day that the user
    stated within twelve hours.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit  # share of a rotor's maximum thrust that may be in use
        self._known: tuple[object, float, float] | None = None
        self._text = ""

    def text(self, analysis: FlightAnalysis) -> str:
        """Return the sentence; empty in flight, without a recognised airframe, and in unknown
        air.
        """
        model = analysis.model
        if analysis.track.flying[-1] or analysis.withheld:
            return ""
        if analysis.bad_part:
            return f"{say(UNSOUND)}."
        try:
            stated = remembered_day()
        except DataError as error:
            return str(error)
        day = complete_day(model.airframe.nominal_voltage, day_on_ground(analysis), stated)
        if not math.isfinite(day.density):
            return ""
        now = (model, day.density, float(np.nan_to_num(day.battery_voltage.value)))
        known = self._known
        if (
            known is None
            or known[0] is not model
            or abs(now[1] / known[1] - 1.0) > CHANGE
            or abs(now[2] - known[2]) > CHANGE_V
        ):
            self._known = now
            found = day_fill(model, day, limit=self._limit)
            advice = fill_advice(found.fill, self._limit)
            self._text = f"{advice}. {day_line(day, found.voltage)}"
        return self._text


STATE, CHARTS, ACT = "/screen.json", "/screen/charts.json", "/screen/act"
KEPT = 200  # lines of the history
Key = tuple[int, tuple[str, int | None], float]  # vehicle, alarm and when it was raised
#: What a page may ask for, by name; each takes the text that came with it. Called on a thread of
#: the server, it raises ValueError for what it does not take.
Acts = Mapping[str, Callable[[str], None]]


class PageState:
    """The state that the page shows, and the actions that it may request.

    `summaries` returns every aircraft as last heard, on any thread; `more` returns further entries
    of the state; `charts` draws for a vehicle's number and s before now. `silent` means without
    sound; `recorded` is a flight of the past, or a `planned` one, with the colours of its
    `timeline`. `acknowledged` is called with each alarm that the pilot acknowledges.
    """

    def __init__(
        self,
        summaries: Callable[[], Sequence[VehicleSummary]],
        acts: Acts | None = None,
        *,
        more: Callable[[], dict[str, Any]] = dict,
        charts: Callable[[int, float], dict[str, Any]] = lambda *_: {},
        silent: bool = False,
        recorded: bool = False,
        planned: bool = False,
        timeline: Sequence[str] = (),
        acknowledged: Callable[[int, Alarm], None] | None = None,
    ) -> None:
        self._summaries, self._recorded = summaries, recorded
        self._more, self._charts = more, charts
        self._acknowledged = acknowledged
        self._acts = {"acknowledge": lambda _: self.acknowledge(), **(acts or {})}
        self._token = secrets.token_urlsafe(16)
        self._lock = threading.Lock()
        self._known: set[Key] = set()  # acknowledged alarms
        self._history: deque[dict[str, Any]] = deque(maxlen=KEPT)
        given = {
            "token": self._token,
            "silent": silent or recorded,
            "recorded": recorded,
            "planned": planned,
            "timeline": list(timeline),
            "spoken": "" if spoken() == LANGUAGES[0] else spoken(),
            "catalogues": {one: words.page_words(one) for one in LANGUAGES},
        }
        files = resources.files("thrustmargin.gcs_plugin.view.figures")
        parts = ("software_drawing.html", "screen_style.html", "screen.html")
        text = "".join((files / name).read_text(encoding="utf-8") for name in parts)
        data = json.dumps(given, ensure_ascii=False).replace("<", "\\u003c")
        self.insert = text.replace("@GIVEN@", data).encode()  # what the page gets before its end

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Add a change of an alarm to the history."""
        self.note(vehicle, event.kind, event.alarm.text)

    def acknowledge(self) -> None:
        """Mark every active alarm as known to the pilot."""
        for one in self._summaries():
            for alarm in one.alarms:
                key = _key(one, alarm)
                with self._lock:
                    fresh = key not in self._known
                    self._known.add(key)
                if fresh:
                    self.note(one.number, "acknowledged", alarm.text)
                    if self._acknowledged is not None:
                        self._acknowledged(one.number, alarm)

    def answer(self, target: str) -> tuple[int, bytes] | None:
        """Return status and JSON for the `target` of a request; None for a request of viser's
        page.
        """
        parts = urlsplit(target)
        asked = {name: given[0] for name, given in parse_qs(parts.query).items()}
        if parts.path == STATE:
            return 200, json.dumps(self.state(), allow_nan=False).encode()
        if parts.path == CHARTS:
            return self._drawn(asked)
        if parts.path != ACT:
            return None
        if not secrets.compare_digest(asked.get("token", "").encode(), self._token.encode()):
            return 403, json.dumps({"refused": words.SCREEN_REFUSES}).encode()
        try:
            self._acts[asked.get("do", "")](asked.get("to", ""))
        except (KeyError, ValueError, DataError):
            return 400, b"{}"
        return 200, b"{}"

    def _drawn(self, asked: Mapping[str, str]) -> tuple[int, bytes]:
        try:
            number, back_s = int(asked.get("vehicle", "")), finite(asked.get("back", "0"))
        except ValueError:
            return 400, b"{}"
        return 200, json.dumps(self._charts(number, max(back_s, 0.0)), allow_nan=False).encode()

    def state(self) -> dict[str, Any]:
        """Return the whole state of the page: vehicles, alarms (the gravest first), history (the
        newest first).
        """
        fleet = [one for one in self._summaries() if not one.gone]
        listed = [(one, alarm) for one in fleet for alarm in one.alarms]
        listed.sort(key=lambda pair: (pair[1].order[:3], _key(*pair) in self._known))
        with self._lock:
            known_keys, history = set(self._known), list(self._history)
        alarms = [
            {
                "id": repr(_key(one, alarm)),
                "vehicle": one.number,
                "text": alarm.text,
                "line": alarm.line,
                "state": alarm.state,
                "level": severity_level(alarm.severity),
                "loud": alarm.severity <= WARNING,
                "critical": alarm.severity <= CRITICAL,
                "acknowledged": _key(one, alarm) in known_keys,
            }
            for one, alarm in listed
        ]
        order = [one.number for one, _ in listed]
        first = min(
            fleet,
            key=lambda one: (
                LEVELS.index(one.first_line[2]),
                order.index(one.number) if one.number in order else len(order),
            ),
            default=None,
        )
        return {
            "first": first
            and {
                "vehicle": first.number,
                **dict(zip(("headline", "because", "level"), first.first_line, strict=True)),
            },
            "vehicles": [self._vehicle(one) for one in fleet],
            "alarms": alarms,
            "history": history,
            **self._more(),
        }

    def _vehicle(self, one: VehicleSummary) -> dict[str, Any]:
        """Return the state of one aircraft, with its figures where any are known, and their age,
        None for a recorded flight.
        """
        answer = None if one.update is None else one.update.answer
        entry = {
            "number": one.number,
            "age": None if self._recorded else round(max(one.age, 0.0), 2),
            "old": one.old,
            "silent": round(one.silent, 1),
            "problem": one.problem,
            "pending": one.pending,
            "stale": one.stale,
            "message": one.message,
            "fill": one.fill,
            "level": one.first_line[2],
            "flight": None if answer is None else {**answer.json, "line": answer.line},
            "shows": [] if (said := answer or one.whole) is None else list(said.contact_lines),
        }
        if one.row is None:
            return {**entry, "figures": None}
        outlook = None if one.update is None else one.update.outlook
        figures = aircraft_figures(one.row, one.seconds_to_empty, one.faulty)
        ahead = {"ahead": None, "full": None, "remarks": [], "why": one.row.why_unknown}
        if one.update is not None and outlook is not None:
            ahead["ahead"] = known(outlook.margin_ahead)
            ahead["full"] = known(outlook.margin_full)
            ahead["remarks"] = list(one.update.beside_the_airframe)
        return {**entry, "figures": {**figures, **ahead}}

    def note(self, vehicle: int, kind: str, text: str) -> None:
        """Add a line to the history, with the present time; callable from any thread."""
        at = time.strftime("%H:%M:%S")
        with self._lock:
            self._history.appendleft(
                {"time": at, "vehicle": vehicle, "kind": str(kind), "text": text}
            )


def field_state(names: Sequence[str], shown: Overlay, scene: Scene) -> dict[str, Any]:
    """Return the page's controls of the scene: colours of the route, legend and cameras."""
    return {
        "colours": list(names),
        "colour": shown.name,
        "legend": legend(shown.scale, shown.note),
        "cameras": [*Camera],
        "camera": scene.camera,
    }


def _key(one: VehicleSummary, alarm: Alarm) -> Key:
    return one.number, alarm.key, alarm.since_s


def finite(text: str) -> float:
    """Convert a text to a finite number. Raises ValueError for anything else."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
