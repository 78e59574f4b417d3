"""The largest fill in words: one sentence for console, page, view and report."""

from __future__ import annotations

import math
from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.fault_words import TOO_HEAVY
from thrustmargin.gcs_plugin.wording.numbers import number, percent
from thrustmargin.models.model.fill_limits import Reason

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
}


def fill_advice(fill: float, low: float, high: float, reason: Reason, *, limit: float) -> str:
    """`Fill at most 9.1 kg (limit at 9.8, 9.1 to 10.5): with more it would descend after ...`.

    `fill` and its 90 % interval in kg; `limit` the share of thrust that may be in use.
    """
    if not math.isfinite(fill):
        return "No fill can be recommended: the model predicts nothing in these conditions"
    more, empty = (words.format(limit=percent(limit)) for words in _BECAUSE[reason])
    if reason == "tank" and fill <= 0.0:
        return "Nothing to fill: the airframe file has no tank"
    if fill <= 0.0:
        return f"Do not fill: even empty {empty}"
    if low <= 0.0:
        return (
            f"Do not fill: the limit is at {amount(fill, low, high)}, too unsure to fill anything"
        )
    return f"Fill at most {sure(fill, low, high)}: {more}"


def sure(fill: float, low: float, high: float) -> str:
    """What keeps a limit even at the low end of its interval, which is what loads are planned by:
    `9.1 kg (limit at 9.8, 9.1 to 10.5)`; `9.8 kg` where the interval is none."""
    if not _has_interval(low, high):
        return amount(fill, low, high)
    middle = number(_down(fill), "")
    return f"{number(_down(low), 'kg')} (limit at {middle}, {_ends(low, high)})"


def amount(fill: float, low: float, high: float) -> str:
    """`9.8 kg (9.1 to 10.5)`, rounded to the safe side, its interval outwards; without the bracket
    where there is none."""
    if not math.isfinite(fill):
        return number(fill, "kg")
    words = number(_down(fill), "kg")
    return f"{words} ({_ends(low, high)})" if _has_interval(low, high) else words


def _has_interval(low: float, high: float) -> bool:
    return math.isfinite(low) and math.isfinite(high) and high - low >= 0.05


def _ends(low: float, high: float) -> str:
    up = math.ceil(max(high, 0.0) * 10.0 - 1e-6) / 10.0
    return f"{number(_down(low), '')} to {number(up, '')}"


def _down(kg: float) -> float:
    return math.floor(max(kg, 0.0) * 10.0 + 1e-6) / 10.0
