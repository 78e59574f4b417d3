"""The banner of the live page and of a replay: what to do, in the few words that two seconds allow.

In the air it is the action of the gravest alarm, after landing the action of the flight's answer,
before take-off the fill on board against the largest. The reasons stand below it, in full.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.advice_words import suspects
from thrustmargin.gcs_plugin.wording.alarm_words import fault_amount, place_words
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.fault_test import Kind, RotorFault
from thrustmargin.models.model.fill_limits import NextFill

#: In the air, by the name of the alarm; {which} is the rotor, motor or ESC with its place.
_IN_THE_AIR: Mapping[str, str] = {
    "control": "CONTROL LOST",
    **dict.fromkeys(
        ("stopped", "rotor", "motor", "esc", "desync", "heat", "lead"), "LAND: {which}"
    ),
    "battery": "LAND: battery",
    "misfit": "LAND: it does not fly as its airframe says",
    "saturation": "SLOW DOWN: {which}",
    **dict.fromkeys(("margin", "predicted margin", "margin ahead"), "FLY GENTLY"),
}
NOTHING_KG = 0.05  # on board: below what a gauge can show
#: In a replay, by the kind of the fault.
_THEN: Mapping[Kind, str] = {
    "propeller": "alarm then: {which}, {amount} less thrust",
    "motor": "alarm then: {which}, {amount} slow for its output",
    "stopped": "alarm then: {which} stands still",
}
_PART: Mapping[str, str] = {
    "motor": "motor {numbers}",
    "esc": "ESC {numbers}",
    "heat": "heat of arm {numbers}",
    "desync": "desync of ESC {numbers}",
    "lead": "lead {numbers}",
}


def in_the_air(name: str, rotors: Sequence[int], place: str = "") -> str:
    """Return the action that an alarm asks of the pilot now: `LAND: rotor 3 front left`.

    `name` is the alarm's, `rotors` its rotors, from 1, and `place` the place of a single one, left
    out with several. Empty for an alarm whose own text already is the action, an unknown name, or
    an alarm that needs a rotor and has none.
    """
    words = _IN_THE_AIR.get(name, "")
    if not words or ("{which}" in words and not rotors):
        return ""
    return say(words, which=which_rotors(name, rotors, place))


def which_rotors(name: str, rotors: Sequence[int], place: str = "") -> str:
    """Return `rotor 3 front left`, `motor 2` or `rotors 1 and 3`; empty without rotors.

    `name` is the alarm's, which decides between rotor and motor; `rotors` count from 1; `place` is
    the place of a single one.
    """
    if not rotors:
        return ""
    words = _PART.get(name)
    if words is None or len(rotors) > 1:
        which = actions.rotors_words(rotors)
    else:
        which = say(words, numbers=rotors[0])
    return f"{which} {place_words(place)}" if place and len(rotors) == 1 else which


def alarm_then(fault: RotorFault, places: Sequence[str] = ()) -> str:
    """Return the alarm about a fault in a recorded flight: `alarm then: rotor 3, 12 % less thrust`.

    The action is left out: nobody can land a recording. `places` are the places of all rotors,
    empty where unknown. If several rotors could be the bad one, they are listed without an amount.
    """
    rotors = tuple(rotor + 1 for rotor in fault.rotors or (fault.rotor,))
    place = places[rotors[0] - 1] if len(rotors) == 1 and places else ""
    which = which_rotors("motor" if fault.kind == "motor" else "rotor", rotors, place)
    if fault.rotors:
        return say("alarm then: one of {which}", which=which)
    return say(_THEN[fault.kind], which=which, amount=fault_amount(fault))


def glance(advice: Advice) -> str:
    """Return the action after a flight in a few words: `OK, 9.8 L next`, `FILL 8.6 L`.

    Lost control, a bad rotor, the battery and the motor order come first, in this order. While the
    flight is in progress, a fault asks to land. Empty where nothing is known, and for a good answer
    with open caveats, an incomplete log or an unknown load, which needs a full sentence.
    """
    levels, land = advice.levels, advice.in_progress
    if FlightLevel.LOST in levels:
        return say("CONTROL LOST") if land else say("DO NOT FLY: control was lost")
    if FlightLevel.DAMAGED in levels or _alone(advice):
        rotors = suspects(advice) or _alone(advice)
        kinds = {episode.fault.kind for episode in advice.faults}
        name = "motor" if kinds == {"motor"} else "rotor"
        place = advice.places[rotors[0] - 1] if len(rotors) == 1 and advice.places else ""
        which = which_rotors(name, rotors, place)
        return say("LAND: {which}" if land else "DO NOT FLY: {which}", which=which)
    if FlightLevel.BATTERY in levels:
        return say("LAND: battery" if land else "DO NOT FLY: battery")
    if advice.level is FlightLevel.ORDER:
        return say("CHECK THE MOTOR ORDER")
    if advice.level is FlightLevel.UNKNOWN:
        return ""
    within = advice.level is FlightLevel.UNDER
    known = advice.complete and math.isfinite(advice.rotor_lost.redundancy_min)
    left_open = bool(advice.caveats) and not land
    if within and (left_open or not known):
        return ""
    return _fill(advice.fill, within=within, flying=land)


def _alone(advice: Advice) -> tuple[int, ...]:
    """Return the rotor, from 1, that alone had no thrust left; empty for none, or an unknown
    motor order."""
    alone = advice.use.spent_alone if FlightLevel.NO_THRUST in advice.levels else None
    return () if alone is None or not advice.rotor_names else (alone + 1,)


def _fill(fill: NextFill, *, within: bool, flying: bool) -> str:
    if fill.nothing_fits is not None or not math.isfinite(fill.kg):
        no_load = say("TOO HEAVY") if fill.limit_kg < 0.0 else say("FLY GENTLY")
        return say("OK") if within else no_load
    if fill.kg <= 0.0:
        return say("OK") if within else say("DO NOT FILL")
    short = "NEXT FILL {amount}" if flying else "FILL {amount}"
    words = "OK, {amount} next" if within else short
    return say(words, amount=short_amount(fill.kg, fill.liquid_density))


def short_amount(kg: float, liquid_density: float = math.nan, *, up: bool = False) -> str:
    """Return `9.8 L`, rounded down, or `up`; kg where the liquid's kg/L is unknown."""
    value, unit = (kg / liquid_density, "L") if liquid_density > 0.0 else (kg, "kg")
    tenths = math.ceil(value * 10.0 - 1e-6) if up else math.floor(value * 10.0 + 1e-6)
    return number(max(tenths, 0) / 10.0, unit)


def before_take_off(fill: NextFill, on_board_kg: float) -> tuple[str, bool]:
    """Return the banner of an aircraft on the ground, and True if it must not take off.

    The banner compares the load on board, kg (NaN if unknown), with the largest fill. Empty and
    False if that fill is unknown.
    """
    if fill.reason == "unsound":
        return say("DO NOT FLY: a rotor or motor is bad"), True
    if not math.isfinite(fill.kg) or fill.nothing_fits is not None:
        return "", False
    most = short_amount(fill.kg, fill.liquid_density)
    if not math.isfinite(on_board_kg):
        return say("FILL AT MOST {most}", most=most), False
    over = on_board_kg > max(fill.kg, 0.0) + NOTHING_KG
    # What is over the largest fill must not read like it, so it is rounded up.
    aboard = short_amount(on_board_kg, fill.liquid_density, up=over)
    words = "TOO MUCH: {aboard}, at most {most}" if over else "{aboard} on board, at most {most}"
    return say(words, aboard=aboard, most=most), over
