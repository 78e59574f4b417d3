"""One aircraft as it was last heard, for the page: its row, its alarms, and how old they are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, WARNING, Alarm
from thrustmargin.gcs_plugin.live.link_vehicles import OLD
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.watch.update import Update
    from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
    from thrustmargin.mission.plan_items import PlanItem

Level = Literal["red", "amber", "grey", "green"]
#: The gravest first.
LEVELS: tuple[Level, ...] = ("red", "amber", "grey", "green")
#: Of a flight's verdict by its level.
VERDICT_LEVEL: Mapping[str, Level] = {
    **dict.fromkeys(("damaged", "lost", "battery", "no_thrust", "critical"), "red"),
    **dict.fromkeys(("over", "order", "near"), "amber"),
    "under": "green",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSummary:
    """All that the page shows of one aircraft: its newest row, its alarms and their age."""

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
    fill: str = ""  # what to fill, while it stands on the ground
    mission: Mapping[int, PlanItem] | None = None
    whole: FlightAnswer | None = None  # of a recorded flight

    @property
    def faulty(self) -> frozenset[int]:
        """Numbers, from 1, of the rotors that have an alarm."""
        return frozenset(alarm.rotor for alarm in self.alarms if alarm.rotor is not None)

    @property
    def old(self) -> bool:
        return self.age > self.old_s

    @property
    def first_line(self) -> tuple[str, str, Level]:
        """Headline, its reason and its level: of the gravest alarm, else of the flight.

        That is a whole one, or what flies now up to its last rows. Of an aircraft that is not known
        it is what its rows show; a notice does not take its place. Without either the headline is
        empty: the page then says that there is no alarm, in green only on the ground or where the
        thrust left of all rotors is known to be enough, and where nothing says that the loss of one
        would bring it down.
        """
        so_far = None if self.update is None else self.update.answer
        row = self.row
        unheard = row is None or bool(self.problem) or self.old
        shows = so_far is not None and so_far.contact is not None and not unheard
        if self.alarms and not (shows and self.alarms[0].severity > WARNING):
            first, *rest = self.alarms
            # Every grave one is named: one that is known must not hide another behind a number.
            grave = [alarm for alarm in rest if alarm.severity <= CRITICAL]
            reasons = ([first.line] if first.line != first.text else []) + [a.line for a in grave]
            level = severity_level(first.severity)
            if so_far is not None and verdict_level(so_far) == "red":
                # Short while it flies: what to do at a desk stands whole further down.
                reasons += [so_far.brief] if so_far.brief else []
                level = "red"
            return first.text, " · ".join(reasons), level
        if self.whole is not None:
            level = verdict_level(self.whole)
            # Not green before it is known whether there were alarms.
            unsure = self.pending and level == "green"
            do = _sentence(self.whole.action or self.whole.why)
            return self.whole.headline, do or self.pending, "grey" if unsure else level
        # Also while nothing is heard: what was found does not end with a gap in the telemetry.
        if so_far is not None and verdict_level(so_far) in ("red", "amber"):
            return so_far.headline, so_far.brief or _sentence(so_far.action), verdict_level(so_far)
        if so_far is not None and shows:
            return so_far.headline, self.pending, "grey"
        if row is None or unheard or self.pending:
            return "", self.pending, "grey"
        calm = row.survives and (not row.flying or row.surely_left >= colours.ENOUGH)
        return "", self.pending, "green" if calm else "grey"

    @property
    def shown(self) -> tuple[tuple[Alarm, ...], str, bool]:
        """The parts that the page must show at once when they change."""
        return self.alarms, self.problem, self.gone


def verdict_level(answer: FlightAnswer) -> Level:
    """Return the level of a flight's answer."""
    return VERDICT_LEVEL.get(answer.level, "grey")


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def severity_level(severity: int) -> Level:
    """Return the level of an alarm by its MAV_SEVERITY."""
    if severity <= CRITICAL:
        return "red"
    return "amber" if severity <= WARNING else "grey"
