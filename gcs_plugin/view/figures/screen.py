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
from dataclasses import replace
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
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.day_words import day_line
from thrustmargin.gcs_plugin.wording.fill_words import UNSOUND, fill_advice
from thrustmargin.gcs_plugin.wording.language import LANGUAGES, in_spoken, say, speaking, spoken
from thrustmargin.gcs_plugin.wording.palette import legend
from thrustmargin.mission.day_fill import day_fill
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fill_limits import NextFill
from thrustmargin.models.model.flight_day import day_on_ground
from thrustmargin.models.physics.day import Day, complete_day

CHANGE = 0.003  # of air density, from which it is worked out anew
CHANGE_V = 0.1  # of the battery at rest, likewise


class FillAdvice:
    """The largest fill of an aircraft on the ground, and its sentence in the current language.

    It is for the air and battery that the aircraft reports, else for the day that the user stated
    within twelve hours, and computed again when air or battery change.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit  # share of a rotor's maximum thrust that may be in use
        self._known: tuple[object, float, float] | None = None
        self._fill, self._day, self._problem = NextFill(), Day(), ""
        self._loaded_v = math.nan  # V under load

    def fill(self, analysis: FlightAnalysis) -> NextFill | None:
        """Return the largest fill for the next flight, in the air on the ground or on a stated day.

        After a flight with a bad part it has the reason "unsound" and no amount. None in flight,
        without an air density, or where the airframe is not recognised.
        """
        model = analysis.model
        if analysis.track.flying[-1] or analysis.no_verdict:
            return None
        if analysis.bad_part:
            return NextFill(reason="unsound")
        problem, stated = "", None
        try:
            stated = remembered_day()
        except DataError as error:
            problem = f" {error}"
        days = [day_on_ground(analysis), *([] if stated is None else [stated])]
        day = complete_day(model.airframe.nominal_voltage, *days)
        if not math.isfinite(day.density):
            return None
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
            self._fill = found.fill
            self._loaded_v = found.voltage
        self._day, self._problem = day, problem
        return self._fill

    def text(self, fill: NextFill) -> str:
        """Return the sentence on `fill`, then the day it is for, then a problem in reading it."""
        if fill.reason == "unsound":
            return f"{say(UNSOUND)}."
        of_day = f"{day_line(self._day, self._loaded_v)}{self._problem}"
        return f"{fill_advice(fill, self._limit)}. {of_day}"


STATE, CHARTS, ACT = "/screen.json", "/screen/charts.json", "/screen/act"
KEPT = 200  # lines of the history
LONGEST_TAB = 40  # characters of a tab's name
Key = tuple[int, tuple[str, int | None], float]  # vehicle, alarm and when it was raised
#: What a page may ask for, by name; each takes the text that came with it and the tab that asks.
#: Called on a thread of the server, it raises ValueError for what it does not take.
Acts = Mapping[str, Callable[[str, str], None]]


class PageState:
    """The state that the page shows, and the actions that it may request.

    Each tab of a browser has a name of its own, empty for a program that gives none. `summaries`
    returns every aircraft as a tab shows it, on any thread; `more` returns further entries of its
    state; `charts` draws for a vehicle's number, s before now and a tab. `connected` is called with
    a tab and viser's number of its connection. `silent` means without sound; `recorded` is a flight
    of the past, or a `planned` one, with the colours of its `timeline`. `acknowledged` is called
    with each alarm that the pilot acknowledges. `clock` is the ground's, µs.
    """

    def __init__(
        self,
        summaries: Callable[[str], Sequence[VehicleSummary]],
        acts: Acts | None = None,
        *,
        more: Callable[[str], dict[str, Any]] = lambda _: {},
        charts: Callable[[int, float, str], dict[str, Any]] = lambda *_: {},
        connected: Callable[[str, int], None] = lambda *_: None,
        silent: bool = False,
        recorded: bool = False,
        planned: bool = False,
        timeline: Sequence[str] = (),
        acknowledged: Callable[[int, Alarm], None] | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        self._standing, self._recorded = summaries, recorded
        self._more, self._charts, self._connected = more, charts, connected
        self._acknowledged = acknowledged
        self._clock = clock or (lambda: time.time_ns() // 1000)
        self._acts = {
            "acknowledge": lambda text, _: self.acknowledge(int(text) if text else None),
            **(acts or {}),
        }
        self._seen: dict[int, int] = {}  # vehicle -> landing, µs, whose verdict was acknowledged
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
        """Append a change of an alarm to the history."""
        self.note(vehicle, event.kind, event.alarm.text)

    def _summaries(self, tab: str) -> list[VehicleSummary]:
        """Return the aircraft of a tab, with `seen` set if the pilot has confirmed the last
        flight's answer."""
        with self._lock:
            seen = dict(self._seen)
        made = []
        for one in self._standing(tab):
            landed = one.landed_us
            known = landed > 0 and seen.get(one.number) == landed
            made.append(replace(one, seen=True) if known else one)
        return made

    def acknowledge(self, vehicle: int | None = None) -> None:
        """Mark all alarms as known to the pilot, and the answer of a last flight as seen.

        That is vehicle `vehicle`; for None the only one, and none of several: answers that are not
        first on the page were not seen.
        """
        fleet = self._summaries("")
        for one in fleet:
            if one.finding and (vehicle == one.number or (vehicle is None and len(fleet) == 1)):
                with self._lock:
                    self._seen[one.number] = one.landed_us
                self.note(one.number, "seen", one.first_line[0])
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
        """Return HTTP status and JSON for the `target` (path and query) of a request: the page's
        state, a chart, or an action.

        A state that names a client connects it to the tab. An action that is done gets 200 and an
        empty object, without the page's token 403, a malformed or refused one 400. None for any
        other path, which is viser's.
        """
        parts = urlsplit(target)
        asked = {name: given[0] for name, given in parse_qs(parts.query).items()}
        tab = asked.get("tab", "")[:LONGEST_TAB]
        if parts.path == STATE:
            if (client := asked.get("client", "")).isdecimal():
                self._connected(tab, int(client))
            with speaking(asked.get("lang", "")):
                return 200, json.dumps(self.state(tab), allow_nan=False).encode()
        if parts.path == CHARTS:
            return self._drawn(asked, tab)
        if parts.path != ACT:
            return None
        if not secrets.compare_digest(asked.get("token", "").encode(), self._token.encode()):
            return 403, json.dumps({"refused": words.SCREEN_REFUSES}).encode()
        try:
            self._acts[asked.get("do", "")](asked.get("to", ""), tab)
        except (KeyError, ValueError, DataError):
            return 400, b"{}"
        return 200, b"{}"

    def _drawn(self, asked: Mapping[str, str], tab: str) -> tuple[int, bytes]:
        try:
            number, back_s = int(asked.get("vehicle", "")), finite(asked.get("back", "0"))
        except ValueError:
            return 400, b"{}"
        made = self._charts(number, max(back_s, 0.0), tab)
        return 200, json.dumps(made, allow_nan=False).encode()

    def state(self, tab: str = "") -> dict[str, Any]:
        """Return the whole state of a tab as JSON values.

        Keys: `first` (the vehicle with the gravest first line, or None), `vehicles`, `alarms`
        (gravest first), `history` (newest first), `left`, and further keys of the live or the
        replayed page. A vehicle that has left stays in `vehicles` until the answer of its last
        flight was seen; then it is in `left`.
        """
        heard = self._summaries(tab)
        fleet = [one for one in heard if not one.gone or one.finding]
        listed = [(one, alarm) for one in fleet for alarm in one.alarms]
        listed.sort(key=lambda pair: (pair[1].order[:3], _key(*pair) in self._known))
        with self._lock:
            known_keys, history = set(self._known), list(self._history)
        history = [{**line, "text": in_spoken(line["text"])} for line in history]
        alarms = [
            {
                "id": repr(_key(one, alarm)),
                "vehicle": one.number,
                "text": in_spoken(alarm.text),
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
            "left": [self._left(one) for one in heard if one not in fleet],
            **self._more(tab),
        }

    def _left(self, one: VehicleSummary) -> dict[str, Any]:
        """Return the number of a vehicle that is no longer displayed, and the time of its last
        message."""
        return {"number": one.number, "at": _at(self._clock() - round(one.silent * 1e6))}

    def _landed(self, one: VehicleSummary) -> dict[str, Any] | None:
        """Return for the last flight `at` (its end, time of day), `ago_s` (s since then) and
        `unseen` (its answer is not yet confirmed).

        None in the air, and without an answer.
        """
        if not one.landed_us or one.answer is None:
            return None
        ago_s = max(self._clock() - one.landed_us, 0) * 1e-6
        return {"at": _at(one.landed_us), "ago_s": round(ago_s), "unseen": one.finding}

    def _vehicle(self, one: VehicleSummary) -> dict[str, Any]:
        """Return the state of an aircraft as JSON: number, age, s, texts for the page, `level`, the
        last flight's answer as `flight`, and `figures`.

        `figures` is None before the first row; with an outlook it also has the least margin on the
        remaining route and the margin with a full tank, shares. The age is None, and `flight` too,
        for a recorded flight. `fill` is empty if the first line says it already.
        """
        answer = None if one.whole is not None else one.answer
        entry = {
            "number": one.number,
            "age": None if self._recorded else round(max(one.age, 0.0), 2),
            "old": one.old,
            "silent": round(one.silent, 1),
            "landed": self._landed(one),
            "problem": in_spoken(one.problem),
            "pending": one.pending,
            "stale": in_spoken(one.stale),
            "message": one.message,
            "fill": "" if one.first_line[1] == one.fill else one.fill,
            "level": one.first_line[2],
            "flight": None if answer is None else {**answer.json, "line": answer.line},
            "shows": [] if (said := answer or one.whole) is None else list(said.contact_lines),
        }
        if one.row is None:
            return {**entry, "figures": None}
        outlook = None if one.update is None else one.update.outlook
        figures = aircraft_figures(one.row, one.seconds_to_empty, one.faulty)
        outlook_figures = {
            "remaining": None,
            "full": None,
            "remarks": [],
            "why": say(one.row.why_unknown),
        }
        if one.update is not None and outlook is not None:
            outlook_figures["remaining"] = known(outlook.margin_ahead)
            outlook_figures["full"] = known(outlook.margin_full)
            outlook_figures["remarks"] = list(one.update.airframe_remarks)
        return {**entry, "figures": {**figures, **outlook_figures}}

    def note(self, vehicle: int, kind: str, text: str) -> None:
        """Add a line to the history, with the present time; callable from any thread."""
        at = time.strftime("%H:%M:%S")
        with self._lock:
            self._history.appendleft(
                {"time": at, "vehicle": vehicle, "kind": str(kind), "text": text}
            )


def field_state(names: Sequence[str], shown: Overlay, camera: Camera) -> dict[str, Any]:
    """Return the state of the 3D view's controls as JSON.

    Keys: `colours` (the `names` of the route's overlays), `colour` (name of the overlay `shown`),
    `legend` (of that), `cameras` (all) and `camera` (the chosen one).
    """
    return {
        "colours": list(names),
        "colour": shown.name,
        "legend": legend(shown.scale, shown.note),
        "cameras": [*Camera],
        "camera": camera,
    }


def _at(clock_us: int) -> str:
    """Return the ground's clock, µs, as the time of day where this computer is."""
    return time.strftime("%H:%M", time.localtime(clock_us * 1e-6))


def _key(one: VehicleSummary, alarm: Alarm) -> Key:
    return one.number, alarm.key, alarm.since_s


def finite(text: str) -> float:
    """Convert a text to a finite number. Raises ValueError for anything else."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
