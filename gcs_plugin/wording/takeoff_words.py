"""Words of the check before take-off: its alarm, its findings, and one line about the run-up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.alarm_words import fitting, place_words
from thrustmargin.gcs_plugin.wording.language import known, number, percent, say
from thrustmargin.models.checks.takeoff import (
    MotorState,
    TakeoffCheck,
    TakeoffFinding,
    TakeoffKind,
)

ZERO_CELSIUS = 273.15
#: Kind -> alarm on the ground, of at most 50 letters.
_ON_GROUND: Mapping[TakeoffKind, str] = {
    TakeoffKind.STANDS: "DO NOT LIFT: motor {motors} does not turn",
    TakeoffKind.LATE: "DO NOT LIFT: motor {motors} turns late ({value})",
    TakeoffKind.SLOW: "DO NOT LIFT: motor {motors} slow for its output",
    TakeoffKind.FAST: "DO NOT LIFT: motor {motors} too fast: propeller?",
    TakeoffKind.EXCHANGED: "DO NOT LIFT: motors {motors} are exchanged",
    TakeoffKind.REVERSED: "DO NOT LIFT: motor {motors} turns the wrong way",
    TakeoffKind.HOT: "DO NOT LIFT: ESC {motors} has {value}",
    TakeoffKind.LEAD: "DO NOT LIFT: bad lead at ESC {motors}, {value}",
}
#: The same once it has left the ground.
_IN_FLIGHT: Mapping[TakeoffKind, str] = {
    TakeoffKind.STANDS: "Motor {motors} does not turn: land",
    TakeoffKind.LATE: "Motor {motors} turned late ({value}): land",
    TakeoffKind.SLOW: "Motor {motors} slow for its output: land",
    TakeoffKind.FAST: "Motor {motors} too fast, propeller?: land",
    TakeoffKind.EXCHANGED: "Motors {motors} are exchanged: land",
    TakeoffKind.REVERSED: "Motor {motors} turns the wrong way: land",
    TakeoffKind.HOT: "ESC {motors} has {value}: land",
    TakeoffKind.LEAD: "Bad lead at ESC {motors}, {value}: land",
}
#: Where too many motors are possible for the length of an alarm.
_WRONG_WAY_ON_GROUND = "DO NOT LIFT: a motor turns the wrong way"
_WRONG_WAY_IN_FLIGHT = "A motor turns the wrong way: land"
#: Kind -> sentence of a report, with the look that settles it.
_FOUND: Mapping[TakeoffKind, str] = {
    TakeoffKind.STANDS: "motor {motors} did not turn while the others did, for {value}: check its "
    "ESC, signal and leads",
    TakeoffKind.LATE: "motor {motors} turned {value} after the others: check its ESC, leads and "
    "bearing",
    TakeoffKind.SLOW: "motor {motors} turned at {value}, {low} to {high} are sound beside the "
    "others: check propeller, motor and ESC",
    TakeoffKind.FAST: "motor {motors} turned at {value}, {low} to {high} are sound beside the "
    "others: is its propeller on, and the right one?",
    TakeoffKind.EXCHANGED: "motors {motors} each follow the output of the other: check wiring and "
    "ESC numbers",
    TakeoffKind.REVERSED: "yaw ran away at {value} against the rotors: motor {motors} turns the "
    "wrong way, or has a propeller of the other hand",
    TakeoffKind.HOT: "ESC {motors} had {value}, the others {reference}: let it cool, and look for "
    "the reason",
    TakeoffKind.LEAD: "the lead of ESC {motors} has {value}, the others {reference}: feel its "
    "connectors",
    TakeoffKind.UNLIKE: "motor {motors} turned at {value}, {low} to {high} on earlier flights at "
    "that output: check propeller, motor and ESC",
    TakeoffKind.SILENT: "no speed of motor {motors} is reported: not known whether it turns",
    TakeoffKind.WEIGHT: "after lift-off thrust carries {value}, {reference} are stated: check the "
    "fill",
    TakeoffKind.YAW: "{value} of the yaw authority was left after lift-off: check that motors are "
    "level and the load is in the middle",
}
#: Kinds whose motors are alternatives; of the others all are meant.
_EITHER = (TakeoffKind.REVERSED,)


def takeoff_alarm(finding: TakeoffFinding, *, flying: bool) -> str:
    """Return the alarm, at most 50 characters, about a finding that forbids the take-off.

    `flying`: the aircraft has taken off already, and the alarm asks for another action.
    """
    words = (_IN_FLIGHT if flying else _ON_GROUND)[finding.kind]
    said = say(words, **_values(finding, ()))
    if finding.kind is TakeoffKind.REVERSED:
        return fitting(said, say(_WRONG_WAY_IN_FLIGHT if flying else _WRONG_WAY_ON_GROUND))
    return said


def finding_words(finding: TakeoffFinding, places: Sequence[str] = ()) -> str:
    """Return a finding as a sentence with its amounts and the inspection that settles it.

    `places` are the names of the rotors' places, empty where they are not known.
    """
    return say(_FOUND[finding.kind], **_values(finding, places))


def _values(finding: TakeoffFinding, places: Sequence[str]) -> dict[str, str]:
    """Return the texts for a finding's sentence by placeholder: motors, value, reference, low,
    high.

    `motors` counts from 1, with the place of a single motor; `places` are the places of all motors,
    empty where unknown. The others are numbers with their unit.
    """
    numbers = [str(motor + 1) for motor in finding.motors]
    between = f" {say('or')} " if finding.kind in _EITHER else f" {say('and')} "
    motors = ", ".join(numbers[:-1])
    motors = f"{motors}{between}{numbers[-1]}" if motors else "".join(numbers)
    if len(numbers) == 1 and places and places[finding.motors[0]]:
        motors = f"{motors} {place_words(places[finding.motors[0]])}"
    names = ("value", "reference", "low", "high")
    return {
        "motors": motors,
        **{name: _amount(finding.kind, getattr(finding, name)) for name in names},
    }


def _amount(kind: TakeoffKind, value: float) -> str:
    """Return a finding's value as text with the unit in which pilots read it, by the finding's
    kind.

    `value` is in SI, or rpm for rotor speeds. The unit is s, rpm, °/s, °C, mΩ, kg or %; none for
    other kinds.
    """
    if kind in (TakeoffKind.STANDS, TakeoffKind.LATE):
        return number(value, "s", 1)
    if kind in (TakeoffKind.SLOW, TakeoffKind.FAST, TakeoffKind.EXCHANGED, TakeoffKind.UNLIKE):
        return number(value, "rpm", 0)
    if kind is TakeoffKind.REVERSED:
        return number(math.degrees(abs(value)), "°/s", 0)
    if kind is TakeoffKind.HOT:
        return number(value - ZERO_CELSIUS, "°C", 0)
    if kind is TakeoffKind.LEAD:
        return number(1e3 * value, "mΩ", 0)
    if kind is TakeoffKind.WEIGHT:
        return number(value, "kg", 1)
    if kind is TakeoffKind.YAW:
        return percent(value, 0)
    return number(value, "", 0)


def check_line(check: TakeoffCheck) -> str:
    """Return the check before a take-off in one line: motors, battery voltage, mass by thrust, yaw.

    Unknown parts are left out; motors without a reported speed are counted as not known.
    """
    return "; ".join([_motors_line(check), *_battery_line(check), *_hover_line(check)])


def _motors_line(check: TakeoffCheck) -> str:
    """Return a phrase on how many motors turn, and within how many s of each other they started.

    Motors without a reported rotor speed are counted as not known. If no motor reports one, say
    only that.
    """
    count = len(check.motors)
    if not check.reporting:
        return say("no rotor speed is reported: not known whether the motors turn")
    turning = sum(
        m.state in (MotorState.TURNS, MotorState.LATE, MotorState.TURNED_BEFORE)
        for m in check.motors
    )
    said = say("{turning} of {count} motors turn", turning=turning, count=count)
    starts = [m.turned_s for m in check.motors if known(m.turned_s)]
    if len(starts) > 1:
        apart = number(max(starts) - min(starts), "s", 1)
        said = say("{motors}, started within {apart} of each other", motors=said, apart=apart)
    missing = count - check.reporting
    if missing:
        said = say("{motors}, {missing} not known", motors=said, missing=missing)
    return said


def _battery_line(check: TakeoffCheck) -> list[str]:
    """Return one phrase: the battery's voltage at rest, at idle and at lift-off, and its
    resistance.

    Unknown values are left out of the phrase. The list is empty without a voltage at rest.
    """
    if not known(check.rest_voltage):
        return []
    parts = [say("{volts} at rest", volts=number(check.rest_voltage, "V", 1))]
    if known(check.idle_voltage):
        parts.append(say("{volts} at idle", volts=number(check.idle_voltage, "V", 1)))
    if known(check.lift_s) and known(check.lift_voltage):
        parts.append(say("{volts} at lift-off", volts=number(check.lift_voltage, "V", 1)))
    if known(check.sag_resistance):
        parts.append(number(1e3 * check.sag_resistance, "mΩ", 0))
    return [", ".join(parts)]


def _hover_line(check: TakeoffCheck) -> list[str]:
    """Return up to two phrases on the hover after lift-off: the mass by thrust, and unused yaw
    authority.

    The first names the stated mass too, if there is one. A phrase whose value is unknown is left
    out.
    """
    parts = []
    if known(check.mass_kg):
        carried = number(check.mass_kg, "kg", 1)
        parts = [say("thrust carries {kg}", kg=carried)]
        if known(check.stated_kg):
            stated = number(check.stated_kg, "kg", 1)
            parts = [say("thrust carries {kg}, stated are {stated}", kg=carried, stated=stated)]
    if known(check.yaw_reserve):
        share = percent(check.yaw_reserve, 0)
        parts.append(say("{share} of the yaw authority left", share=share))
    return parts
