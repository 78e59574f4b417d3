"""What alarms say: short, for a STATUSTEXT has 50 characters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.alarm import AlarmSettings
from thrustmargin.gcs_plugin.live.tank_balance import TankBalance

#: ESC_FAILURE_FLAGS, gravest first
FAILURES = {
    32: "motor stuck",
    4: "too hot",
    1: "too much current",
    2: "voltage too high",
    8: "too fast",
    16: "does not follow",
    64: "failure",
}


def margin_words(what: str, margin: float, limit: float, of: str = "") -> str:
    """Rounded down, so that what is under the limit also reads so."""
    if not math.isfinite(margin):
        return ""
    place = "under" if margin < limit else "near"
    return f"{what} {math.floor(100 * margin + 1e-6)}% {place} {limit:.0%}{of}"


def failure_words(flags: int) -> str:
    """What an ESC says of itself, gravest first: ESC_FAILURE_FLAGS of MAVLink's common.xml."""
    known = [words for bit, words in FAILURES.items() if flags & bit]
    return ", ".join(known) or f"failure {flags}"


def unheard_words(missing: NDArray[np.intp], rotors: int) -> str:
    """Which rotors give no speed, for people."""
    if missing.size == rotors:
        return "No rotor speeds: ESC telemetry lost"
    several = "s" if missing.size > 1 else ""
    return f"No speed of rotor{several} {', '.join(str(k + 1) for k in missing)}: ESC?"


def tank_verdict(balance: TankBalance, settings: AlarmSettings) -> str:
    """What is wrong with the tank, for people; empty when its estimates agree or are too few."""
    gauge, pump, thrust = balance.gauge, balance.pump, balance.thrust
    if parts(gauge, pump, settings):
        if balance.level_kg < 0.3 and gauge < pump:
            return "Tank empty, pump still on"
        if gauge > pump:
            backed = parts(thrust, pump, settings) and thrust > pump
            return "Tank falls faster than the pump" + (": leak?" if backed else "")
        backed = parts(pump, thrust, settings) and thrust < pump
        return "Tank falls slower than the pump" + (": clogged?" if backed else ": gauge?")
    if abs(balance.apart_kg) > settings.tank_mass_kg:
        return f"Thrust says {balance.apart_kg:+.1f} kg against the gauge"
    return ""


def parts(one: float, other: float, settings: AlarmSettings) -> bool:
    """Whether two losses, kg, differ by more than either tolerance; False when one is unknown."""
    apart = abs(one - other)
    return apart > max(settings.tank_kg, settings.tank_share * max(abs(one), abs(other)))
