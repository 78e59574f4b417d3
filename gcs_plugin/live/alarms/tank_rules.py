"""What is said of the tank where gauge, pump and thrust part from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import NOTICE, WARNING, AlarmSettings
from thrustmargin.gcs_plugin.live.alarms.alarm_checks import AlarmChecks, RowsNow, one_alarm
from thrustmargin.gcs_plugin.live.rows.tank_balance import TankBalance
from thrustmargin.gcs_plugin.wording import alarm_words as words


def tank(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    texts = ["" if b is None else pump_verdict(b, s) for b in now.balances]
    known = [b is not None and math.isfinite(b.gauge - b.pump) for b in now.balances]
    return _of_tank(texts, known, WARNING)


def gauge(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    # A bad rotor makes thrust of which the model knows nothing: it has the order, and is the news.
    bad = now.bad_rotors
    texts = [
        "" if b is None or pump_verdict(b, s) else mass_verdict(b, s, bad) for b in now.balances
    ]
    known = [b is not None and math.isfinite(b.apart_kg) for b in now.balances]
    return _of_tank(texts, known, NOTICE if bad else WARNING)


def _of_tank(texts: Sequence[str], known: Sequence[bool], severity: int) -> AlarmChecks:
    on, sure = np.array([bool(text) for text in texts], dtype=np.bool_), np.array(known, np.bool_)
    return one_alarm(
        on, sure & ~on, on | sure, severity=lambda *_: severity, text=lambda row, _: texts[row]
    )


def pump_verdict(balance: TankBalance, settings: AlarmSettings) -> str:
    """What is wrong between gauge and pump, for people; empty when they agree or are too few."""

    def parts(one: float, other: float) -> bool:
        """Whether two losses, kg, differ by more than either tolerance; False for an unknown."""
        allowed = settings.tank_share * max(abs(one), abs(other))
        return abs(one - other) > max(settings.tank_kg, allowed)

    gauge, pump, thrust = balance.gauge, balance.pump, balance.thrust
    if not parts(gauge, pump):
        return ""
    if balance.level_kg < 0.3 and gauge < pump and not balance.apart_kg > settings.tank_mass_kg:
        return words.TANK_EMPTY
    if gauge > pump:
        backed = parts(thrust, pump) and thrust > pump
        return words.TANK_LEAKS if backed else words.TANK_FAST
    backed = parts(pump, thrust) and thrust < pump
    return words.TANK_CLOGGED if backed else words.GAUGE_WRONG


def mass_verdict(balance: TankBalance, settings: AlarmSettings, bad: Sequence[int] = ()) -> str:
    """That thrust carries another mass than the gauge says, for people; empty when it does not.

    `bad` are the rotors, from 1, of which an alarm stands.
    """
    apart = abs(balance.apart_kg) > settings.tank_mass_kg
    return words.thrust_against_gauge(balance.apart_kg, bad) if apart else ""
