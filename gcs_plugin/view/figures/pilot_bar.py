"""The bar that every width of the live page keeps in sight: margin, age of the data, gravest alarm.

viser's panels fold on a phone, and an alarm inside a fold is none. So the bar is a part of the page
itself, above viser's. It asks this server for its state twice a second, by JSON; what it does not
hear it says. An acknowledgement needs the token that only this server's own page was given.
"""

from __future__ import annotations

import json
import math
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from html import escape
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, WARNING, Alarm, AlarmEvent
from thrustmargin.gcs_plugin.view.figures.live_html import GREY, VERDICT_PAPER, Standing, paper_of
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording import view_words as words

STATE, ACKNOWLEDGE = "/pilot-bar.json", "/pilot-bar/acknowledge"
KEPT = 200  # lines of the history
MOST_NAMED = 3  # grave alarms: more would push the numbers off the page
Key = tuple[int, tuple[str, int | None], float]  # vehicle, alarm and when it was raised


class PilotBar:
    """State of the bar. `standing` gives the aircraft as last heard, to any thread.

    `style` is that of the rest of the page, which a folded panel must not take away. `silent` takes
    the sound button away, `recorded` all buttons and ages; the
    `verdict` of a whole flight, in words and its level, stands there too; `acknowledged` hears of
    every alarm that was acknowledged.
    """

    def __init__(
        self,
        standing: Callable[[], Sequence[Standing]],
        *,
        style: str = "",
        silent: bool = False,
        recorded: bool = False,
        verdict: tuple[str, str] = ("", ""),
        acknowledged: Callable[[int, Alarm], None] | None = None,
    ) -> None:
        self._standing, self._recorded, self._verdict = standing, recorded, verdict
        self._acknowledged = acknowledged
        self._token = secrets.token_urlsafe(16)
        self._lock = threading.Lock()
        self._known: set[Key] = set()  # acknowledged alarms
        self._history: deque[str] = deque(maxlen=KEPT)
        files = resources.files("thrustmargin.gcs_plugin.view.figures")
        parts = ("software_drawing.html", "pilot_bar.html")
        text = "".join((files / name).read_text(encoding="utf-8") for name in parts)
        text = text.replace("@TOKEN@", self._token).replace("@RECORDED@", json.dumps(recorded))
        text = text.replace("@SILENT@", json.dumps(silent or recorded))
        text = text.replace("@WORDS@", json.dumps(words.BAR_SCRIPT, ensure_ascii=False))
        self.insert = (style + text).encode()  # what the page gets before its end

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """An alarm changed: a line of the history."""
        self._note(words.alarm_line(vehicle, event.kind, event.alarm.text))

    def acknowledge(self) -> None:
        """All alarms that stand now are known to the pilot."""
        for one in self._standing():
            for alarm in one.alarms:
                key = _key(one, alarm)
                with self._lock:
                    fresh = key not in self._known
                    self._known.add(key)
                if fresh:
                    self._note(words.alarm_line(one.number, "acknowledged", alarm.text))
                    if self._acknowledged is not None:
                        self._acknowledged(one.number, alarm)

    def answer(self, target: str) -> tuple[int, bytes] | None:
        """Status and JSON for the `target` of a request; None for one that is not the bar's."""
        parts = urlsplit(target)
        if parts.path == STATE:
            return 200, json.dumps(self.state(), allow_nan=False).encode()
        if parts.path != ACKNOWLEDGE:
            return None
        given = parse_qs(parts.query).get("token", [""])[0]
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            return 403, json.dumps({"refused": words.BAR_REFUSES}).encode()
        self.acknowledge()
        return 200, b"{}"

    def state(self) -> dict[str, Any]:
        """What the bar shows: vehicles, alarms (the gravest first), history (the newest first)."""
        fleet = [one for one in self._standing() if not one.gone]
        standing = [(one, alarm) for one in fleet for alarm in one.alarms]
        standing.sort(key=lambda pair: (pair[1].order[:3], _key(*pair) in self._known))
        many = len(fleet) > 1
        with self._lock:
            known, history = set(self._known), list(self._history)
        alarms = [
            {
                "id": repr(_key(one, alarm)),
                "text": words.of_vehicle(one.number, alarm.line) if many else alarm.line,
                "state": alarm.state,
                "paper": paper_of(alarm.severity),
                "loud": alarm.severity <= WARNING,
                "critical": alarm.severity <= CRITICAL,
                "acknowledged": _key(one, alarm) in known,
            }
            for one, alarm in standing
        ]
        # Every grave one is named: one that is known must not hide another behind a number.
        pending = next((one.pending for one in fleet if one.pending), "")
        verdict, level = self._verdict
        # Not green before it is known whether there were alarms.
        paper = GREY if pending and level == "under" else VERDICT_PAPER.get(level, GREY)
        named = [a for a in alarms if a["critical"]][:MOST_NAMED] or alarms[:1]
        return {
            "vehicles": [_vehicle(one, recorded=self._recorded) for one in fleet],
            "named": " · ".join(a["text"] for a in named),
            "unnamed": len(alarms) - len(named),
            "alarms": alarms,
            "pending": pending,
            "history": history,
            "verdict": verdict,
            "verdict_paper": paper,
        }

    def _note(self, line: str) -> None:
        with self._lock:
            self._history.appendleft(f"{time.strftime('%H:%M:%S')} {line}")


def snapshot_html(one: Standing) -> str:
    """What the bar says of an aircraft, beside the gauges that say the same."""
    said = json.dumps(_vehicle(one, recorded=False), allow_nan=False)
    return f'<div hidden data-snapshot="{escape(said)}"></div>'


def _key(one: Standing, alarm: Alarm) -> Key:
    return one.number, alarm.key, alarm.since_s


def _vehicle(one: Standing, *, recorded: bool) -> dict[str, Any]:
    """One aircraft: its margin in words and colours, and the age of it (None of a record)."""
    shown = one.flying and not one.problem
    paper = colours.MARGIN.screen(one.coloured if shown else float("nan"))
    if one.problem:
        big, caption = words.BAR_WITHOUT_VERDICT, one.problem
    elif not one.flying:
        big, caption = words.ON_GROUND, words.NO_MARGIN_YET
    elif math.isnan(one.margin):
        big, caption = words.BAR_WITHOUT_VERDICT, one.rests_on
    else:
        big, caption = words.share_words(one.margin), one.rests_on
    return {
        "number": one.number,
        "stamp_us": one.stamp_us,
        "margin": big,
        "caption": caption,
        "paper": colours.css(paper),
        "ink": colours.ink_on(paper),
        # Whether the silence of the alarms says anything good: on the ground, or enough margin of
        # all rotors. An alarm of the margin comes a few seconds after its colour.
        "watched": not one.problem and (not one.flying or one.coloured >= colours.ENOUGH),
        "age": None if recorded else round(max(one.age, 0.0), 2),
        "old": one.old,
    }
