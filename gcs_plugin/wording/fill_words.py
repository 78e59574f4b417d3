"""The largest fill in words: the same for console, page, view, report and plan."""

from __future__ import annotations

import math
from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.alarm_words import TOO_HEAVY
from thrustmargin.gcs_plugin.wording.language import number, percent, say
from thrustmargin.models.model.fill_limits import NextFill, Reason

#: reason -> why not more, and why not even empty
_BECAUSE: Mapping[Reason, tuple[str, str]] = {
    "utilisation": (
        "more would take over {limit} of a rotor's maximum thrust in steady flight",
        "steady flight takes over {limit} of a rotor's maximum thrust",
    ),
    "one rotor lost": TOO_HEAVY,
    "take-off mass": (
        "more is over the maker's maximum take-off mass",
        "it is over the maker's maximum take-off mass",
    ),
    "tank": ("the tank holds no more", ""),
    "unreported": ("what was not reported may be in the tank", ""),
    "as flown": (
        "with more, this flight was above {limit} of a rotor's maximum thrust",
        "this flight was above {limit} of a rotor's maximum thrust with hardly any load",
    ),
}
#: Why nothing goes into an aircraft that is light enough.
_NOTHING_FITS: Mapping[Reason, str] = {
    "tank": "it has no tank",
    "take-off mass": "empty it has the maker's maximum take-off mass already",
}
UNKNOWN_FILL = "No fill can be recommended: mass and rotors of the aircraft are not known"
#: What settles a limit whose largest rotor speed is a guess.
CLIMB = "a climb at full throttle for 3 s, without liquid, settles it: airframe new --hover LOG"
UNSOUND = "No fill can be recommended: a rotor or motor is bad, and the limits are of sound ones"
UNPREDICTED = "No fill can be recommended: the model predicts nothing in these conditions"


def fill_advice(fill: NextFill, limit: float, *, was_within: bool = False) -> str:
    """`Fill at most 9.1 kg (9.1 L): with more it would descend after losing a rotor`.

    `limit` is the share of a rotor's largest thrust that may last. Where a flight `was_within` the
    limits nothing must change: `Up to 9.1 kg (9.1 L): with more ...`.
    """
    if fill.reason == "unsound":
        return say(UNSOUND)
    if not math.isfinite(fill.kg):
        return say(UNPREDICTED if fill.reason else UNKNOWN_FILL)
    assert fill.reason is not None
    more, empty = (say(words, limit=percent(limit)) for words in _BECAUSE[fill.reason])
    if fill.nothing_fits is not None:
        why = say(_NOTHING_FITS[fill.nothing_fits])
        if fill.limit_kg < 0.0 <= fill.high_kg and fill.nothing_fits == "tank":
            return say("Cannot tell whether it is too heavy as it is: weigh it; {why}", why=why)
        if fill.limit_kg < 0.0 and fill.nothing_fits == "tank" and empty:
            return say("Too heavy as it is: {empty}; {why}", empty=empty, why=why)
        return say("Nothing to fill: {why}", why=why)
    if fill.kg <= 0.0:
        if fill.limit_kg > 0.0 and fill.reason != "as flown":
            words = "Do not fill: the limit is at {limit}, too unsure to fill anything"
            settled = f"; {say(CLIMB)}" if fill.ceiling_guessed else ""
            return f"{say(words, limit=_range(fill))}{settled}"
        return say("Do not fill: even empty {empty}", empty=empty)
    first = "Up to {amount}: {more}" if was_within else "Fill at most {amount}: {more}"
    return say(first, amount=amount(fill.kg, fill.liquid_density), more=more)


def how_sure(fill: NextFill) -> str:
    """`limit at 9.8 kg (9.1 to 10.5); 12.1 kg with a fresh battery`; empty where nothing adds."""
    if not math.isfinite(fill.kg) or fill.kg <= 0.0 or fill.nothing_fits is not None:
        return ""
    parts = (
        [say("limit at {limit}", limit=_range(fill))] if fill.high_kg - fill.low_kg >= 0.05 else []
    )
    if parts and fill.ceiling_guessed:
        parts.append(say(CLIMB))
    if fill.fresh_kg > fill.kg + 0.05:
        fresh = amount(fill.fresh_kg, fill.liquid_density)
        parts.append(say("at most {amount} with the battery as at the start", amount=fresh))
    return "; ".join(parts)


def amount(kg: float, liquid_density: float = math.nan) -> str:
    """`9.8 kg (9.8 L)`, rounded to the safe side; litres where the liquid's kg/L is known."""
    if not math.isfinite(kg):
        return number(kg, "kg")
    litres = kg / liquid_density if liquid_density > 0.0 else math.nan
    of = f" ({number(_down(litres), 'L')})" if math.isfinite(litres) else ""
    return f"{number(_down(kg), 'kg')}{of}"


def safe_kg(fill: NextFill) -> float:
    """The kg that `fill_advice` says; NaN unknown, 0 where nothing may be filled."""
    return _down(fill.kg) if math.isfinite(fill.kg) else math.nan


def _range(fill: NextFill) -> str:
    middle = number(_down(fill.limit_kg), "kg")
    if not fill.high_kg - fill.low_kg >= 0.05:
        return middle
    up = math.ceil(max(fill.high_kg, 0.0) * 10.0 - 1e-6) / 10.0
    return f"{middle} ({number(_down(fill.low_kg), '')} to {number(up, '')})"


def _down(kg: float) -> float:
    return math.floor(max(kg, 0.0) * 10.0 + 1e-6) / 10.0
