"""Sentences on a known aircraft: how well it is known, what changed, and what must be asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.gcs_plugin.wording.language import number, percent, say
from thrustmargin.mission.forecast.experience import FlownMission
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.electric_power import NORMAL, PowerLaw, power_factors
from thrustmargin.models.physics.known_battery import KnownBattery


def known_words(name: str, flights: int, days: int) -> str:
    """Return on what the prediction of an aircraft rests, as the grounds of a verdict."""
    if flights == 1:
        return say("aircraft {name}, known from 1 flight", name=name)
    if days == 1:
        words = "aircraft {name}, known from {flights} flights on one day"
        return say(words, name=name, flights=flights)
    words = "aircraft {name}, known from {flights} flights on {days} days"
    return say(words, name=name, flights=flights, days=days)


def mission_words(mission: FlownMission) -> str:
    """Return a mission as its forecast said it and as it was flown."""
    parts = []
    for words, pair, factor, unit in (
        ("{said} s, flown {flown}", mission.seconds, 1.0, ""),
        ("{said} Wh, flown {flown}", mission.energy_wh, 1.0, ""),
        ("{said} of thrust on legs, flown {flown}", mission.leg_use, 100.0, "%"),
        ("{said} at most, flown {flown}", mission.peak_use, 100.0, "%"),
    ):
        said, flown = (number(factor * value, unit, 0) for value in (pair.said, pair.flown))
        parts.append(say(words, said=said, flown=flown))
    text = say("its forecast said {parts}", parts="; ".join(parts))
    return text if mission.complete else f"{text} ({say('the plan was left before its end')})"


def power_and_battery_words(law: PowerLaw | None, battery: KnownBattery) -> tuple[str, ...]:
    """Return what the flights of an aircraft show of its power and its battery; empty without."""
    parts = []
    if law is not None:
        reach = percent(power_factors(law.error)[1] - 1.0)
        words = "power known from {flights} flights, ± {reach}"
        parts.append(say(words, flights=len(law.flights), reach=reach))
    if battery.resistance > 0.0:
        ohm = number(1e3 * battery.resistance, "mOhm", 0)
        reach = percent(NORMAL * battery.resistance_error / battery.resistance)
        parts.append(say("battery {ohm} ± {reach}", ohm=ohm, reach=reach))
    if battery.rest_voltage > 0.0:
        parts.append(
            say("{volts} at rest before take-off", volts=number(battery.rest_voltage, "V"))
        )
    return ("; ".join(parts),) if parts else ()


def changed_words(by_rpm: Floats, modes: Sequence[int], columns: Floats) -> str:
    """Return what is different in a flight from the flights before it, with its size.

    `by_rpm` (R,) is the change of each mode, rpm, `modes` are those to name, from 0, and `columns`
    (R, R) the directions of the modes.
    """
    parts = []
    for mode in modes:
        by, size = by_rpm[mode], number(abs(by_rpm[mode]), "rpm", 0)
        if mode == 0:
            words = "all rotors turn {rpm} faster" if by > 0.0 else "all rotors turn {rpm} slower"
            parts.append(say(words, rpm=size))
            continue
        side = np.sign(by) * columns[:, mode]
        up, down = (
            ", ".join(str(k + 1) for k in np.flatnonzero(way > 0.1)) for way in (side, -side)
        )
        words = "rotors {up} turn {rpm} faster and {down} slower"
        parts.append(say(words, up=up, rpm=size, down=down))
    return say(
        "changed since the flights before it: {parts}; weigh it, look at what was repaired or "
        "fitted, and note that: thrustmargin aircraft NAME --changed PART",
        parts=", ".join(parts),
    )


def open_words(found: Sequence[tuple[str, str]]) -> str:
    """Return the question of which aircraft a log is, from names and reasons."""
    listed = "; ".join(f"{name} ({say(why)})" for name, why in found)
    return say(
        "its aircraft may be that of {listed}; give --aircraft NAME, a new name for a new aircraft",
        listed=listed,
    )
