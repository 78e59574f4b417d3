"""The types of an alarm: its state, its thresholds, and what a rule is given and returns.

A rule takes the rows of one vehicle (`RowsNow`) or its link (`LinkNow`) and returns `AlarmChecks`,
arrays of rows. `Debounce` turns these into a state that lasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.gcs_plugin.live.rows.tank_balance import TankBalance
from thrustmargin.gcs_plugin.wording import alarm_words as words
from thrustmargin.gcs_plugin.wording.actions import Phase, Trouble, Urgency, answer_to
from thrustmargin.gcs_plugin.wording.language import in_spoken
from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer
from thrustmargin.models.checks.arms.arm_watch import ArmHeat
from thrustmargin.models.checks.takeoff import TakeoffCheck
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fault_test import Kind, RotorFault

#: MAV_SEVERITY
CRITICAL, WARNING, NOTICE = 2, 4, 5
_SEVERITIES: Mapping[Urgency, int] = {
    Urgency.STOP: CRITICAL,
    Urgency.BEFORE_NEXT: WARNING,
    Urgency.NOTHING: NOTICE,
}
#: Names of alarms, the gravest first: control, a part that is bad, the link, battery, thrust, then
#: the load, then what an instrument says. Of one severity they are listed so. A lost link comes
#: after a bad rotor: that rotor is still bad, and what to do about it is still known.
GRAVEST_FIRST = (
    *(
        "control",
        "take-off",
        "stopped",
        "rotor",
        "motor",
        "telemetry",
        "shared id",
        "esc",
        "desync",
        "heat",
        "lead",
        "battery",
        "saturation",
    ),
    *("margin", "predicted margin", "margin ahead", "tank", "gauge", "shaking", "frames"),
    *("rotor speeds", "misfit", "motor order", "airframe", "envelope"),
)


#: Names of those that a rotor or a motor is bad.
OF_PARTS = ("stopped", "rotor", "motor")
#: Name of an alarm, and its rotor from 1; None: of no rotor.
Key = tuple[str, int | None]


def severity_of(trouble: Trouble) -> int:
    """Return the MAV_SEVERITY of a finding's alarm, from the urgency of its action in flight."""
    return _SEVERITIES[answer_to(trouble, Phase.IN_FLIGHT).urgency]


class AlarmState(StrEnum):
    """The state of an alarm. It ends only by evidence to the contrary, never because data are
    missing."""

    ACTIVE = "active"
    UNCONFIRMED = "unconfirmed"
    CLEARED = "cleared"


class Missing(StrEnum):
    """The kind of missing data that an alarm needs; its words are in `alarm_words.MISSING`."""

    NOTHING = ""
    LINK = "link"
    ROWS = "rows"
    VERDICT = "verdict"
    SPEEDS = "speeds"
    OUTPUTS = "outputs"
    LOAD = "load"
    FORECAST = "forecast"
    GAUGE = "gauge"
    VOLTAGE = "voltage"
    ATTITUDE = "attitude"
    ESC = "esc"
    HEAT = "heat"


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSettings:
    """The thresholds of all alarms; shares are of one, times in s."""

    max_utilisation: float = 0.5  # largest share of a rotor's maximum thrust in use
    tank_share: float = 0.5  # of the larger loss by which two estimates may part
    tank_kg: float = 0.5  # kg by which they must part besides
    tank_mass_kg: float = 3.0  # kg between gauge and thrust
    saturation: float = 0.97
    silence: float = 3.0
    cell_voltage: float = 3.0  # V under load, below which a lithium cell collapses
    heat_ahead: float = 60.0  # s before a temperature passes its limit: enough to land
    #: W that a lead loses more than the others': a lug of 20 cm² in the rotors' wash (50 W/m²K)
    #: grows 100 K warm of it.
    lead_watts: float = 10.0
    #: Falls out of step in 20 s: one may be a wrong frame; in 4 h of sound flights there was none.
    desyncs: int = 2


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm of one vehicle.

    `text` fits the 50 characters of a STATUSTEXT; as a `str` it is in the link's language, as a
    `Sentence` in any other.
    """

    name: str
    rotor: int | None  # from 1; None: of no rotor, or of one of `rotors`
    severity: int  # MAV_SEVERITY
    text: str
    since_s: float
    state: AlarmState = AlarmState.ACTIVE
    missing: Missing = Missing.NOTHING  # why it cannot be confirmed
    times: int = 1  # how often its condition came since `since_s`
    last_s: float = float("nan")  # when it came the last time of several
    rotors: tuple[int, ...] = ()  # from 1: those that it may be of
    past: str = ""  # the text once its number is of the past

    @property
    def key(self) -> Key:
        return self.name, self.rotor

    @property
    def line(self) -> str:
        """Return the text with how often and how long the alarm was raised, or why it cannot be
        confirmed, in the current language."""
        return words.alarm_line(
            in_spoken(self.text), self.missing, self.times, self.last_s - self.since_s
        )

    @property
    def order(self) -> tuple[int, int, bool, float]:
        """Return the sort key for all screens, lowest first: severity, part, confirmed before not,
        age."""
        part = len(GRAVEST_FIRST)
        if self.name in GRAVEST_FIRST:
            part = GRAVEST_FIRST.index(self.name)
        return self.severity, part, self.state is AlarmState.UNCONFIRMED, self.since_s


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """A change of an alarm to the state that `alarm` has."""

    alarm: Alarm
    before: AlarmState
    time_s: float  # vehicle's clock, of the link the ground's
    unix_s: float = float("nan")  # ground's clock when the report came; NaN where nobody listens

    @property
    def raised(self) -> bool:
        """Return True if the alarm was not listed before."""
        return self.before is AlarmState.CLEARED

    @property
    def kind(self) -> str:
        """Return "raised", "cleared", "unconfirmed" or "confirmed"."""
        if self.raised:
            return "raised"
        return "confirmed" if self.alarm.state is AlarmState.ACTIVE else self.alarm.state

    @property
    def line(self) -> str:
        """Return a sentence on the change, such as raised or cleared, with the alarm's text."""
        return words.event_line(self.kind, self.alarm.line)


@dataclass(frozen=True, slots=True)
class Debounce:
    """A condition that must be true for a time to begin, and false for a time to end."""

    hold: float
    release: float
    active: bool = False
    since: float = float("nan")  # when the opposite of `active` began; NaN: it has not

    def after(self, time_s: float, on: bool, off: bool) -> Debounce:
        """Return the state after `time_s`, s: `on` requests active, `off` inactive.

        The state changes once a request has lasted `hold` s (to active) or `release` s (to
        inactive) without a break.
        """
        if not (off if self.active else on):
            return replace(self, since=float("nan")) if self.since == self.since else self
        began = self.since if self.since == self.since else time_s
        if time_s - began >= (self.release if self.active else self.hold):
            return replace(self, active=not self.active, since=float("nan"))
        return self if self.since == self.since else replace(self, since=time_s)


@dataclass(frozen=True, slots=True, eq=False)
class AlarmChecks:
    """The result of a rule for N rows of K alarms, one per rotor or a single one.

    `on` raises an alarm and `off` clears it; with neither it keeps its state. `known` is False
    where data that the rule needs are missing.
    """

    on: Bools  # (N, K)
    off: Bools  # (N, K)
    known: Bools  # (N, K)
    severity: Callable[[int, int], int]  # MAV_SEVERITY, by row and alarm
    text: Callable[[int, int], str]
    rotor: int = 0  # the first so many are of rotors, from 1 on
    past: Callable[[int], str] | None = None  # text while no number of it is known or low
    over: Bools | None = None  # (N,) there is nothing of which it could be: no lull is waited for
    rotors: Callable[[int, int], tuple[int, ...]] | None = None  # from 1: those it may be of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowsNow:
    """The N rows `rows` of an analysis of T rows and R rotors, with further values in them."""

    analysis: FlightAnalysis
    rows: slice
    margin_ahead: Floats | None = None  # (T,) least predicted on the rest of the route
    esc_failures: Floats | None = None  # (T, R) ESC_FAILURE_FLAGS, NaN: unknown
    rest_voltage: float = math.nan  # V before take-off, else the first that was heard
    #: (N,) faults by kind that was tested, at the ends of blocks; empty between
    faults: Sequence[dict[Kind, tuple[RotorFault, ...]]] = ()
    balances: Sequence[TankBalance | None] = ()  # (N,) about one a second
    stopped: Bools | None = None  # (N, R) rotors that were found at rest by that row
    heat: ArmHeat | None = None  # (N, R) of the arms by that row
    arms: Sequence[ArmAnswer | None] = ()  # (N,) by the flight up to each row
    #: (T, R) s for which messages came without a rotor's speed; NaN: none was ever reported
    unheard_s: Floats | None = None
    from_outputs: bool = False  # all rotor speeds are made from motor outputs
    takeoff: TakeoffCheck | None = None  # of the last run-up; None before the first
    listed: Mapping[Key, Alarm] = field(default_factory=dict)  # the alarms raised before these rows

    @property
    def bad_rotors(self) -> tuple[int, ...]:
        """Return the rotors, from 1, of the gravest alarm on a bad rotor or motor; empty for
        none."""
        parts = [alarm for (name, _), alarm in self.listed.items() if name in OF_PARTS]
        first = min(parts, key=lambda alarm: alarm.order, default=None)
        if first is None:
            return ()
        return first.rotors or tuple(filter(None, (first.rotor,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkNow:
    """The state of a link; silence is that of received bytes, whether or not they were analysed."""

    silent: float  # s since anything was heard
    #: when last heard: a vehicle that is switched off after a landing is worth a notice
    flying: bool = True
    shared_id: int = 0  # system id under which two vehicles send; 0: none
    shared_since_s: float = math.nan  # ground's clock
    rows_behind: float = 0.0  # s for which messages were analysed that gave no row
    read_s: float = math.nan  # ground's clock of the last message that was analysed


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """Rule of an alarm: its check, and the s for which a condition must be true to raise it, or
    false to clear it."""

    name: str
    hold: float
    release: float
    checks: Callable[[AlarmSettings, Any], AlarmChecks]
    needs: Missing = Missing.NOTHING  # what is missing where nothing is known
    on_ground: str = "cleared"  # or "kept" as it was, or "checked" there too
    lull: float = 0.0  # s for which it stays raised after that, to be counted when it comes again
    sampled: bool = False  # found out now and then: nothing is asked between
    of_airframe: bool = False  # nothing is known of it without a verdict


def one_alarm(on: ArrayLike, off: ArrayLike, known: ArrayLike, **more: Any) -> AlarmChecks:
    """Return the checks (N, 1) of a single alarm, from (N,) arrays or single values (N = 1).

    `more` are further fields of AlarmChecks.
    """
    a, b, c = (np.atleast_1d(np.asarray(x, dtype=np.bool_))[:, None] for x in (on, off, known))
    return AlarmChecks(a, b, c, **more)
