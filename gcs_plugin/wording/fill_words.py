"""Describe the largest fill in words, identically for console, page, view, report and plan."""

from __future__ import annotations

import math
from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.alarm_words import TOO_HEAVY
from thrustmargin.gcs_plugin.wording.day_words import day_briefly
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.gcs_plugin.wording.thrust_left import least_words
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.fill_limits import FillLevel, NextFill, Reason
from thrustmargin.models.physics.day import Day

#: Reason of the limit -> consequence of more, and consequence with an empty tank.
_BECAUSE: Mapping[Reason, tuple[str, str]] = {
    "utilisation": (
        "more would leave less than {limit} thrust in steady flight",
        "steady flight leaves less than {limit} thrust",
    ),
    "one rotor lost": TOO_HEAVY,
    "take-off mass": (
        "more is over the maker's maximum take-off mass",
        "it is over the maker's maximum take-off mass",
    ),
    "tank": ("the tank holds no more", ""),
    "unreported": ("what was not reported may be in the tank", ""),
    "as flown": (
        "with more, this flight had less than {limit} thrust left",
        "this flight had less than {limit} thrust left with hardly any load",
    ),
}
#: Reason why nothing can be filled -> its words.
_NOTHING_FITS: Mapping[Reason, str] = {
    "tank": "it has no tank",
    "take-off mass": "empty it has the maker's maximum take-off mass already",
}
UNKNOWN_FILL = "No fill can be recommended: mass and rotors of the aircraft are not known"
#: What settles a limit whose largest rotor speed is a guess.
CLIMB = "a climb at full throttle for 3 s, without liquid, settles it: airframe new --hover LOG"
UNSOUND = "No fill before the bad rotor or motor is repaired"
UNPREDICTED = "No fill can be recommended: the model predicts nothing in these conditions"


#: Answer -> the level of a flight that has its colour.
FLIGHT_LEVELS: Mapping[FillLevel, FlightLevel] = {
    FillLevel.FILL: FlightLevel.UNDER,
    FillLevel.NO_TANK: FlightLevel.UNDER,
    FillLevel.WEIGH: FlightLevel.NEAR,
    FillLevel.UNSURE: FlightLevel.CRITICAL,
    FillLevel.NO_FILL: FlightLevel.CRITICAL,
    FillLevel.TOO_HEAVY: FlightLevel.CRITICAL,
    FillLevel.NO_SPARE_MASS: FlightLevel.OVER,
    FillLevel.UNSOUND: FlightLevel.DAMAGED,
    FillLevel.UNPREDICTED: FlightLevel.UNKNOWN,
    FillLevel.UNKNOWN: FlightLevel.UNKNOWN,
}


def fill_advice(fill: NextFill, limit: float, *, was_within: bool = False) -> str:
    """Return how much to fill, for which day, and why not more; or why no amount is stated, by
    `fill.level`.

    `Fill at most 9.1 kg (9.1 L) with a full battery, 15 °C: with more it would descend ...`.
    `limit` is the largest share of a rotor's largest thrust that may be used for long.
    `was_within`: the flight just analysed kept the limits, so the sentence only permits: `You may
    fill up to 9.1 kg ...`.
    """
    level = fill.level
    if level is FillLevel.UNSOUND:
        return say(UNSOUND)
    if level is FillLevel.UNPREDICTED:
        return say(UNPREDICTED)
    if level is FillLevel.UNKNOWN:
        return say(UNKNOWN_FILL)
    assert fill.reason is not None
    more, empty = (say(words, limit=least_words(limit)) for words in _BECAUSE[fill.reason])
    day = with_day(fill.day)
    if fill.nothing_fits is not None:
        why = say(_NOTHING_FITS[fill.nothing_fits])
        if level is FillLevel.WEIGH:
            return say("Cannot tell whether it is too heavy as it is: weigh it; {why}", why=why)
        if level is FillLevel.TOO_HEAVY:
            words = "Too heavy as it is{day}: {empty}; {why}"
            return say(words, day=day, empty=empty, why=why)
        return say("Nothing to fill: {why}", why=why)
    if level is FillLevel.UNSURE:
        words = "Do not fill{day}: the limit is at {limit}, too unsure to fill anything"
        settled = f"; {say(CLIMB)}" if fill.ceiling_guessed else ""
        return f"{say(words, day=day, limit=_range(fill))}{settled}"
    if level is FillLevel.NO_FILL:
        return say("Do not fill{day}: even empty {empty}", day=day, empty=empty)
    first = (
        "You may fill up to {amount}{day}: {more}"
        if was_within
        else "Fill at most {amount}{day}: {more}"
    )
    return say(first, amount=amount(fill.kg, fill.liquid_density), day=day, more=more)


def with_day(day: Day) -> str:
    """Return ` with a full battery, 15 °C, no wind`; empty where nothing of the day is known."""
    words = day_briefly(day)
    return say(" with {day}", day=words) if words else ""


def how_sure(fill: NextFill) -> str:
    """Return the interval of the largest fill, and the largest fill with a full battery.

    `the limit is most likely at 9.8 kg (9.1 to 10.5); at most 12.1 kg with a full battery`. The
    first part is left out for an interval narrower than 0.05 kg, the second if it is no more than
    the fill. Empty without both, or if nothing may be filled.
    """
    if not math.isfinite(fill.kg) or fill.kg <= 0.0 or fill.nothing_fits is not None:
        return ""
    parts = (
        [say("the limit is most likely at {limit}", limit=_range(fill))]
        if fill.high_kg - fill.low_kg >= 0.05
        else []
    )
    if parts and fill.ceiling_guessed:
        parts.append(say(CLIMB))
    if fill.fresh_kg > fill.kg + 0.05:
        fresh = amount(fill.fresh_kg, fill.liquid_density)
        words = "at most {amount} with the battery as at the start"
        if fill.fresh_day.battery_voltage.known:  # that of another battery than the day's
            words = "at most {amount} with a full battery"
        parts.append(say(words, amount=fresh))
    return "; ".join(parts)


def amount(kg: float, liquid_density: float = math.nan) -> str:
    """Return `9.8 kg (9.8 L)`, rounded down; litres only if the liquid's density, kg/L, is
    known."""
    if not math.isfinite(kg):
        return number(kg, "kg")
    litres = kg / liquid_density if liquid_density > 0.0 else math.nan
    of = f" ({number(_down(litres), 'L')})" if math.isfinite(litres) else ""
    return f"{number(_down(kg), 'kg')}{of}"


def safe_kg(fill: NextFill) -> float:
    """Return the largest fill to recommend, kg, rounded down to 0.1; 0 if nothing may be filled.

    NaN if it is unknown.
    """
    return _down(fill.kg) if math.isfinite(fill.kg) else math.nan


def _range(fill: NextFill) -> str:
    """Return the largest fill with its interval as text, kg, with the ends rounded outwards.

    The interval is left out if it is narrower than 0.05 kg.
    """
    middle = number(_down(fill.limit_kg), "kg")
    if not fill.high_kg - fill.low_kg >= 0.05:
        return middle
    up = math.ceil(max(fill.high_kg, 0.0) * 10.0 - 1e-6) / 10.0
    return f"{middle} ({number(_down(fill.low_kg), '')} to {number(up, '')})"


def _down(kg: float) -> float:
    """Round kg or litres down to 0.1, at least 0."""
    return math.floor(max(kg, 0.0) * 10.0 + 1e-6) / 10.0
