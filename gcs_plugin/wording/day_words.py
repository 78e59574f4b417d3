"""The day that a fill holds for, in words: briefly in a headline, and whole with its sources.

`day_briefly` is what stands behind every fill; `day_line` names every value and where it is from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.language import clock, number, say
from thrustmargin.models.physics.day import DAY_FIELDS, Day, DaySource, DayValue

#: Where a value is from, behind it in brackets.
SOURCES: Mapping[DaySource, str] = {
    DaySource.OPTION: "as stated",
    DaySource.FILE: "by the file of the day",
    DaySource.LOG: "by the log",
    DaySource.LINK: "by the vehicle",
    DaySource.PLAN: "by the plan",
    DaySource.REMEMBERED: "as given at {time}",
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
    """`a half used battery, 30 °C, at sea level, no wind`: the day in few words; empty if unknown.

    Of a flight only the battery is named, with the time: its air is that flight's own.
    """
    battery = battery_words(day)
    if math.isfinite(day.loaded_voltage.at_s):
        return battery
    return ", ".join(filter(None, (battery, _air(day), _height(day), _wind(day))))


def battery_words(day: Day) -> str:
    """`the battery at 3:20 of this flight`, `a full battery`, `a battery of 56.5 V at rest`."""
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


def _air(day: Day) -> str:
    value = day.air_temperature
    if not value.known:
        return ""
    return _given(number(value.value - 273.15, "°C", 0), value)


def _height(day: Day) -> str:
    if day.pressure.known:
        return _given(number(day.pressure.value / 100.0, "hPa", 0), day.pressure)
    if not day.height.known:
        return ""
    if round(day.height.value) == 0:
        return _given(say("at sea level"), day.height)
    return _given(
        say("{height} above the sea", height=number(day.height.value, "m", 0)), day.height
    )


def _wind(day: Day) -> str:
    wind, gusts = day.wind, day.gusts
    if not wind.known and not gusts.known:
        return ""
    steady = say("no wind")
    if wind.value >= LEAST_WIND:
        steady = say("wind {speed}", speed=number(wind.value, "m/s"))
    words = _given(steady, wind)
    if gusts.value > max(wind.value, LEAST_WIND):
        words = f"{words}, {_given(say('gusts {speed}', speed=number(gusts.value, 'm/s')), gusts)}"
    return words


def _given(words: str, value: DayValue) -> str:
    """The words with the time at which a remembered value was stated."""
    if value.source is not DaySource.REMEMBERED:
        return words
    return f"{words} {say(SOURCES[value.source], time=value.given_at)}"


def _with_source(words: str, value: DayValue) -> str:
    return f"{words} ({say(SOURCES[value.source], time=value.given_at)})"


def day_line(day: Day, voltage: float = math.nan) -> str:
    """`For 30 °C (assumed), at sea level (assumed), ...`: every value with its source.

    `voltage` is V under load that the battery has in it; NaN: that of the day, if it has one.
    """
    parts = [
        _with_source(number(day.air_temperature.value - 273.15, "°C", 0), day.air_temperature)
        if day.air_temperature.known
        else "",
        _with_source(number(day.pressure.value / 100.0, "hPa", 0), day.pressure)
        if day.pressure.known
        else "",
        _with_source(_height(Day(height=day.height)), day.height)
        if day.height.known and not day.pressure.known
        else "",
        _with_source(_wind(Day(wind=day.wind)), day.wind) if day.wind.known else "",
    ]
    if day.gusts.value > 0.0:
        parts.append(_with_source(_wind(Day(gusts=day.gusts)), day.gusts))
    loaded, rest = day.loaded_voltage, day.battery_voltage
    if rest.known:
        parts.append(
            _with_source(say("battery {volts} at rest", volts=number(rest.value, "V")), rest)
        )
    under = loaded.value if loaded.known else voltage
    if math.isfinite(under):
        words = say("{volts} under load", volts=number(under, "V"))
        parts.append(words if rest.known else _with_source(f"{say('battery')} {words}", loaded))
    return say("For {day}.", day=", ".join(filter(None, parts)))


def ask_words(name: str, step: float, kg: float) -> str:
    """`Say the air temperature with --air-temperature: it moves the fill by 1.0 kg per 10 °C.`"""
    how = DAY_FIELDS[name]
    unit = f"{step:g} {how.unit}" if step != 1.0 else how.unit
    return say(
        "Say {what} with {option}: it moves the fill by {kg} per {unit}.",
        what=say(ASKED[name]),
        option=how.option,
        kg=number(kg, "kg"),
        unit=unit,
    )
