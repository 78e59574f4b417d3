"""What an alarm is, its thresholds, how it changes, and the condition that must hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

#: MAV_SEVERITY
CRITICAL, WARNING, NOTICE = 2, 4, 5


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


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm that stands. `text` fits the 50 characters of a STATUSTEXT."""

    name: str
    rotor: int | None  # from 1
    severity: int  # MAV_SEVERITY
    text: str
    since_s: float

    @property
    def key(self) -> tuple[str, int | None]:
        return self.name, self.rotor


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """An alarm was raised or cleared."""

    raised: bool
    alarm: Alarm
    time_s: float  # vehicle's clock, of the link the ground's
    unix_s: float = float("nan")  # ground's clock when the report came; NaN where nobody listens


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


def worst_first(standing: Sequence[Alarm]) -> list[Alarm]:
    """Alarms by severity, then age."""
    return sorted(standing, key=lambda alarm: (alarm.severity, alarm.since_s))
