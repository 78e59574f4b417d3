"""The day that a fill holds for, in words: briefly in a headline, and whole with its sources.

`day_briefly` is what stands behind every fill; `day_line` names every value and where it is from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.language import clock, number, say
from thrustmargin.models.physics.day import (
    DAY_FIELDS,
    ZERO_CELSIUS,
    Day,
    DaySource,
    DayValue,
)

#: Where a value is from, behind it in brackets.
SOURCES: Mapping[DaySource, str] = {
    DaySource.OPTION: "as stated",
    DaySource.FILE: "by the file of the day",
    DaySource.LOG: "by the log",
    DaySource.LINK: "by the vehicle",
    DaySource.PLAN: "by the plan",
    DaySource.REMEMBERED: "as given at {time}",
    DaySource.EARLIER: "by its earlier flights",
    DaySource.DEFAULT: "assumed",
    DaySource.STANDARD: "of the standard atmosphere",
}
#: Field of a day -> what the user is asked for.
ASKED: Mapping[str, str] = {
    "air_temperature": "the air temperature",
    "height": "the height of the field",
    "wind": "the wind",
    "battery_voltage": "the battery's voltage at rest",
}
THROUGH_AIR = "Flown at {speed} through the air."
LEAST_WIND = 0.5  # m/s that is worth a word


def day_briefly(day: Day) -> str:
    """Return the conditions of a day in few words: `a full battery, 30 °C, at sea level, no wind`.

    For the day of a flight it is only the battery and its time, because the air is then that of the
    flight. Empty where nothing is known.
    """
    battery = battery_words(day)
    if math.isfinite(day.loaded_voltage.at_s):
        return battery
    parts = (_temperature(day), _place(day), _wind(day), _gusts(day))
    named = [_given(*part) for part in parts if part]
    return ", ".join([battery, *named] if battery else named)


def battery_words(day: Day) -> str:
    """Return a day's battery as a phrase to follow "with"; empty if it is unknown.

    `the battery at 3:20 of this flight`, `a battery of 56.5 V at rest`. The voltage under load
    comes first, else that at rest. An assumed one is `a half used battery` under load, `a full
    battery` at rest.
    """
    loaded, rest = day.loaded_voltage, day.battery_voltage
    if math.isfinite(loaded.at_s) and not loaded.source.assumed:
        return say("the battery at {clock} of this flight", clock=clock(loaded.at_s))
    if loaded.known and loaded.source.assumed:
        return say("a half used battery")
    if loaded.known:
        return say("a battery of {volts} under load", volts=number(loaded.value, "V"))
    if not rest.known:
        return ""
    if rest.source.assumed:
        return say("a full battery")
    volts = number(rest.value, "V")
    if rest.source is DaySource.LOG:
        return say("the battery of this log, {volts} at rest", volts=volts)
    if rest.source is DaySource.LINK:
        return say("this battery, {volts} at rest", volts=volts)
    return say("a battery of {volts} at rest", volts=volts)


#: Words of one value, and the value for its source; None where it is unknown.
_Part = tuple[str, DayValue] | None


def _temperature(day: Day) -> _Part:
    """Return the air temperature in words."""
    value = day.air_temperature
    return (number(value.value - ZERO_CELSIUS, "°C", 0), value) if value.known else None


def _place(day: Day) -> _Part:
    """Return (words, value) of the air pressure at the field, or if unknown of its height above the
    sea.

    None if both are unknown.
    """
    if day.pressure.known:
        return number(day.pressure.value / 100.0, "hPa", 0), day.pressure
    if not day.height.known:
        return None
    if round(day.height.value) == 0:
        return say("at sea level"), day.height
    height = number(day.height.value, "m", 0)
    return say("{height} above the sea", height=height), day.height


def _wind(day: Day) -> _Part:
    """Return the wind in words."""
    if not day.wind.known:
        return None
    if day.wind.value < LEAST_WIND:
        return say("no wind"), day.wind
    return say("wind {speed}", speed=number(day.wind.value, "m/s")), day.wind


def _gusts(day: Day) -> _Part:
    """Return the gusts in words; None where they are no more than the wind."""
    steady = day.wind.value if day.wind.known else 0.0
    if not day.gusts.value > max(steady, LEAST_WIND):
        return None
    return say("gusts {speed}", speed=number(day.gusts.value, "m/s")), day.gusts


def _given(words: str, value: DayValue) -> str:
    """Add the time at which a remembered value was stated; return other words unchanged."""
    if value.source is not DaySource.REMEMBERED:
        return words
    return f"{words} {say(SOURCES[value.source], time=value.given_at)}"


def _with_source(words: str, value: DayValue) -> str:
    """Add the source of a value in brackets."""
    return f"{words} ({say(SOURCES[value.source], time=value.given_at)})"


def day_line(day: Day, voltage: float = math.nan) -> str:
    """Return a sentence with each known value of a day and its source: `For 30 °C (assumed), ...`.

    `voltage` is the voltage under load, V, with which a fill was computed; it is named if the day
    itself has none. NaN: not named.
    """
    loaded, rest = day.loaded_voltage, day.battery_voltage
    parts = [part for part in (_temperature(day), _place(day), _wind(day), _gusts(day)) if part]
    if rest.known:
        words = say("battery {volts} at rest", volts=number(rest.value, "V"))
        parts.append((words, rest))
    named = [_with_source(*part) for part in parts]
    under = say("{volts} under load", volts=number(voltage, "V"))
    if loaded.known:
        under = say("{volts} under load", volts=number(loaded.value, "V"))
        named.append(_with_source(f"{say('battery')} {under}", loaded))
    elif math.isfinite(voltage):
        named.append(under)
    for value, unit, factor, decimals in (
        (day.battery_capacity_ah, "Ah", 1.0, 1),
        (day.battery_resistance, "mOhm", 1e3, 0),
    ):
        if value.known:
            named.append(_with_source(number(factor * value.value, unit, decimals), value))
    return say("For {day}.", day=", ".join(named))


def ask_words(name: str, step: float, kg: float) -> str:
    """Return a request to state a value of the day, with how much it changes the fill.

    `Say the air temperature with --air-temperature: it moves the fill by 1.0 kg per 10 °C.` `name`
    is a key of DAY_FIELDS: a field of `Day`. `step` (10) is in the unit of the field's option and
    left out of the text if 1. `kg` is the change of the fill per step, worded with its sign.
    """
    how = DAY_FIELDS[name]
    unit = f"{step:g} {how.unit}" if step != 1.0 else how.unit
    return say(
        "Say {what} with {option}: it moves the fill by {kg} per {unit}.",
        what=say(ASKED[name]),
        option=how.option,
        kg=number(kg, "kg"),
        unit=unit,
    )
