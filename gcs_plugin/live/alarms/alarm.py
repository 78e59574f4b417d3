"""What an alarm is, its states and thresholds, and the condition that must hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from thrustmargin.gcs_plugin.wording import alarm_words as words

#: MAV_SEVERITY
CRITICAL, WARNING, NOTICE = 2, 4, 5
#: Names of alarms, the gravest first: a part that is bad, control, battery, thrust, then the load,
#: then what an instrument says. Of one severity they are listed so.
GRAVEST_FIRST = (
    *(
        "telemetry",
        "shared id",
        "control",
        "stopped",
        "rotor",
        "motor",
        "esc",
        "battery",
        "saturation",
    ),
    *("margin", "predicted margin", "margin ahead", "tank", "gauge"),
    *("rotor speeds", "misfit", "motor order", "airframe", "envelope"),
)


#: Names of those that a rotor or a motor is bad.
OF_PARTS = ("stopped", "rotor", "motor")
#: Name of an alarm, and its rotor from 1; None: of no rotor.
Key = tuple[str, int | None]


class AlarmState(StrEnum):
    """An alarm is over only by evidence to the contrary, never because its ground is gone."""

    ACTIVE = "active"
    UNCONFIRMED = "unconfirmed"
    CLEARED = "cleared"


class Missing(StrEnum):
    """What an alarm goes by and is not there; `alarm_words.MISSING` calls it by name."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSettings:
    """Thresholds; shares are of one, times s."""

    max_utilisation: float = 0.5  # largest share of a rotor's maximum thrust in use
    margin_hysteresis: float = 0.03
    tank_share: float = 0.5  # of the larger loss by which two estimates may part
    tank_kg: float = 0.5  # kg by which they must part besides
    tank_mass_kg: float = 3.0  # kg between gauge and thrust
    saturation: float = 0.97
    silence: float = 3.0
    cell_voltage: float = 3.0  # V under load, below which a lithium cell collapses


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm. `text` fits the 50 characters of a STATUSTEXT."""

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
        """The text with how often it came, or why it cannot be confirmed, for people."""
        return words.alarm_line(self.text, self.missing, self.times, self.last_s - self.since_s)

    @property
    def order(self) -> tuple[int, int, bool, float]:
        """Least first on every screen: a lost link, lost control, then by severity and part,
        confirmed before not, age."""
        part = len(GRAVEST_FIRST)
        if self.name in GRAVEST_FIRST:
            part = GRAVEST_FIRST.index(self.name)
        severity = -1 if self.name in ("telemetry", "control") else self.severity
        return severity, part, self.state is AlarmState.UNCONFIRMED, self.since_s


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """An alarm changed its state to what it has now."""

    alarm: Alarm
    before: AlarmState
    time_s: float  # vehicle's clock, of the link the ground's
    unix_s: float = float("nan")  # ground's clock when the report came; NaN where nobody listens

    @property
    def raised(self) -> bool:
        """It was not listed before."""
        return self.before is AlarmState.CLEARED

    @property
    def kind(self) -> str:
        """raised, cleared, unconfirmed or confirmed."""
        if self.raised:
            return "raised"
        return "confirmed" if self.alarm.state is AlarmState.ACTIVE else self.alarm.state

    @property
    def line(self) -> str:
        """What happened, for people."""
        return words.event_line(self.kind, self.alarm.line)


@dataclass(frozen=True, slots=True)
class Debounce:
    """A condition that must hold for a time to count, and be gone for a time to end."""

    hold: float
    release: float
    active: bool = False
    since: float = float("nan")  # when the opposite of `active` began; NaN: it has not

    def after(self, time_s: float, on: bool, off: bool) -> Debounce:
        """The next state; `on` wants it active, `off` inactive, neither leaves it as it is."""
        if not (off if self.active else on):
            return replace(self, since=float("nan")) if self.since == self.since else self
        began = self.since if self.since == self.since else time_s
        if time_s - began >= (self.release if self.active else self.hold):
            return replace(self, active=not self.active, since=float("nan"))
        return self if self.since == self.since else replace(self, since=time_s)
