"""One aircraft as it was last heard, for the page: its row, its alarms, and how old they are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from thrustmargin.gcs_plugin.live.alarms.alarm import (
    CRITICAL,
    NOTICE,
    OF_PARTS,
    WARNING,
    Alarm,
)
from thrustmargin.gcs_plugin.live.link_vehicles import OLD
from thrustmargin.gcs_plugin.wording.actions import Urgency
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.glance_words import before_take_off, in_the_air
from thrustmargin.gcs_plugin.wording.language import in_spoken, sentence
from thrustmargin.gcs_plugin.wording.takeoff_words import check_line
from thrustmargin.models.model.advice import FlightLevel

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.watch.update import Update
    from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
    from thrustmargin.mission.plan_items import PlanItem
    from thrustmargin.models.model.fill_limits import NextFill

Level = Literal["red", "amber", "grey", "green"]
#: The gravest first.
LEVELS: tuple[Level, ...] = ("red", "amber", "grey", "green")
#: Urgency of the action after a flight -> its colour.
URGENCY_LEVEL: Mapping[Urgency, Level] = {
    Urgency.STOP: "red",
    Urgency.BEFORE_NEXT: "amber",
    Urgency.NOTHING: "green",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSummary:
    """The state of one aircraft for the page: its newest row, its alarms and their age."""

    number: int
    row: ShownRow | None = None
    update: Update | None = None  # its last rows, of one that flies now
    alarms: tuple[Alarm, ...] = ()  # worst first
    age: float = 0.0  # s of the newest row
    old_s: float = OLD  # from which it is old
    silent: float = 0.0  # s since anything was heard of it, analysed or not
    problem: str = ""  # why there is no margin
    pending: str = ""  # why its alarms are not yet known
    gone: bool = False  # left for good: nothing of it is shown
    stale: str = ""  # fields that are no longer reported, in words
    message: str = ""  # its last message
    seconds_to_empty: float = math.nan  # inf: the tank does not fall
    fill: str = ""  # what to fill, in words, while it is on the ground
    largest: NextFill | None = None  # the fill that `fill` states
    mission: Mapping[int, PlanItem] | None = None
    whole: FlightAnswer | None = None  # of a recorded flight
    recorded: bool = False  # of the past: nothing that an alarm asked for can be done now
    seen: bool = False  # a user has acknowledged the verdict of its last flight

    @property
    def faulty(self) -> frozenset[int]:
        """Return the numbers, from 1, of the rotors with an alarm, and after a flight those
        found bad in it."""
        over = self.whole is not None or not self.flying
        found = self.answer.rotors if self.answer is not None and over else ()
        listed = (alarm.rotor for alarm in self.alarms if alarm.rotor is not None)
        return frozenset((*listed, *found))

    @property
    def old(self) -> bool:
        return self.age > self.old_s

    @property
    def answer(self) -> FlightAnswer | None:
        """Return the answer of the recorded flight, of the one in progress, or of the last one
        until seen."""
        if self.whole is not None:
            return self.whole
        if self.update is None or (self.seen and not self.flying):
            return None
        return self.update.answer

    @property
    def flying(self) -> bool:
        """Return True if the aircraft is off the ground in its newest row."""
        return self.row is not None and self.row.flying

    @property
    def landed_us(self) -> int:
        """Return the ground's clock, µs, at the last landing; 0 in flight, before one and in a
        replay."""
        return 0 if self.update is None or self.whole is not None else self.update.landed_us

    @property
    def finding(self) -> bool:
        """Return True if the last flight's answer is displayed and not yet confirmed."""
        return self.landed_us > 0 and self.answer is not None

    @property
    def first_line(self) -> tuple[str, str, Level]:
        """Return headline, reason and level of the most important statement on the aircraft.

        For a recorded flight it is as `_recorded` says. In the air it is the gravest alarm, with
        the action for now; with a red or amber finding of the flight, or the result of an unknown
        aircraft, only an alarm of WARNING or graver, else the finding or the result (grey). On the
        ground it is the finding, with the action before the next flight. There an alarm of WARNING
        or graver leads, unless it is of a bad rotor or motor (OF_PARTS), or the aircraft was
        damaged or lost. Before a flight it is the fill on board against the largest. With no
        statement the headline is empty and the level grey, but green in the air with enough thrust
        left on all rotors and no known risk from the loss of one.
        """
        if self.whole is not None:
            return self._recorded(self.whole)
        answer, alarms = self.answer, self.alarms
        level = "grey" if answer is None else verdict_level(answer)
        unheard = self.row is None or bool(self.problem) or self.old
        if answer is not None and not self.flying and self._leads(answer):
            rest = [a.line for a in alarms if a.severity <= CRITICAL and a.name not in OF_PARTS]
            return _found(answer, level, rest)
        shows = answer is not None and answer.contact is not None and not unheard
        # Also while nothing is heard: what was found does not end with a gap in the telemetry.
        found = answer is not None and (level in ("red", "amber") or not self.flying)
        if alarms and alarms[0].severity <= (WARNING if shows or found else NOTICE):
            return self._alarmed(answer, level)
        if answer is not None and found:
            return _found(answer, level, [self.pending])
        if answer is not None and shows:
            return answer.headline, self.pending, "grey"
        if self.row is None or unheard or self.pending:
            return "", self.pending, "grey"
        if not self.row.flying:
            return self._before_take_off(self.row)
        calm = self.row.survives and self.row.calm
        return "", self.pending, "green" if calm else "grey"

    def _leads(self, answer: FlightAnswer) -> bool:
        """Return True if a flight's answer is displayed before the alarms on the ground.

        It is if the aircraft was damaged or lost, or if no other alarm is a warning or graver.
        """
        others = (a for a in self.alarms if a.severity <= WARNING and a.name not in OF_PARTS)
        return answer.level in (FlightLevel.DAMAGED, FlightLevel.LOST) or not any(others)

    def _alarmed(self, answer: FlightAnswer | None, level: Level) -> tuple[str, str, Level]:
        """Return headline, reason and level for the gravest alarm: its action, then every grave
        alarm in full.

        `answer` is that of the flight, if any, of `level`; if that is red, the level is red.
        """
        first, *rest = self.alarms
        rotors = first.rotors or tuple(filter(None, (first.rotor,)))
        places = () if self.row is None else self.row.analysis.places
        place = places[rotors[0] - 1] if len(rotors) == 1 and len(places) >= rotors[0] else ""
        asks = in_the_air(first.name, rotors, place) if first.severity <= WARNING else ""
        headline = asks if self.flying and asks and not self.recorded else in_spoken(first.text)
        reasons = [first.line] if first.line != headline else []
        # Every grave one is named: one that is known must not hide another behind a number.
        reasons += [alarm.line for alarm in rest if alarm.severity <= CRITICAL]
        if answer is not None and level == "red" and not self.flying:
            reasons += [answer.brief] if answer.brief else []
        worse = "red" if level == "red" else severity_level(first.severity)
        return headline, " · ".join(reasons), worse

    def _recorded(self, whole: FlightAnswer) -> tuple[str, str, Level]:
        """Return headline, reason and level for a recorded flight: the action before the next one.

        It is equal at every time of the replay, unless there is an alarm and the answer `whole` is
        not red. The action for an alarm is of no use any more, so only the alarm itself is named.
        """
        level = verdict_level(whole)
        # Not green before it is known whether there were alarms.
        unsure = self.pending and level == "green"
        if self.alarms and level != "red":  # an answer of which the alarm is no part
            first, *rest = self.alarms
            known = [in_spoken(alarm.text) for alarm in rest] + [whole.headline]
            return in_spoken(first.text), " · ".join(known), severity_level(first.severity)
        headline, because, _ = _found(
            whole, level, [in_spoken(alarm.text) for alarm in self.alarms]
        )
        return headline, because or self.pending, "grey" if unsure else level

    def _before_take_off(self, row: ShownRow) -> tuple[str, str, Level]:
        """Return headline, reason and level on the ground: the fill on board against the largest.

        Red if it is more, else grey; no headline where the largest is unknown. While the motors
        run, the check of the run-up follows.
        """
        check = None if self.update is None else self.update.takeoff
        run_up = "" if check is None or check.ended else check_line(check)
        if self.largest is None:
            return "", _joined(run_up, self.pending), "grey"
        headline, over = before_take_off(self.largest, float(row.analysis.track.tank_kg[row.row]))
        return headline, _joined(run_up, self.fill), "red" if over else "grey"

    @property
    def shown(self) -> tuple[tuple[Alarm, ...], str, bool]:
        """Return the parts whose change the page must display at once: alarms, problem, and if
        it left."""
        return self.alarms, self.problem, self.gone


def verdict_level(answer: FlightAnswer) -> Level:
    """Return the colour level of a flight's answer; grey if it asks for no action."""
    return "grey" if answer.urgency is None else URGENCY_LEVEL[answer.urgency]


def _found(answer: FlightAnswer, level: Level, rest: Sequence[str]) -> tuple[str, str, Level]:
    """Return headline, reason and level for a flight's finding.

    The headline is the short action, or the finding if there is none; the reason has the finding
    (unless it is the headline), the full action or else why, and `rest`. `level` is returned
    unchanged.
    """
    headline = answer.glance or answer.headline
    finding = _sentence(sentence(answer.headline)) if answer.glance else ""
    do = _sentence(answer.action or answer.why)
    return headline, " · ".join(filter(None, (finding, do, *rest))), level


def _joined(*texts: str) -> str:
    return " · ".join(filter(None, texts))


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def severity_level(severity: int) -> Level:
    """Return the level of an alarm by its MAV_SEVERITY."""
    if severity <= CRITICAL:
        return "red"
    return "amber" if severity <= WARNING else "grey"
