"""Words of a vehicle's own reports, each with what its log shows of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.language import Verbatim, known, percent, say

if TYPE_CHECKING:
    from collections.abc import Iterable

#: Kind of report -> its title.
KINDS: Mapping[str, str] = {
    "crash": "crash",
    "lost control": "lost control",
    "flight terminated": "flight terminated",
    "attitude failure": "attitude failure",
    "thrust loss": "thrust loss",
    "yaw imbalance": "yaw imbalance",
    "motor failure": "motor failure",
    "ESC failure": "ESC failure",
    "propeller imbalance": "propeller imbalance",
    "battery failsafe": "battery failsafe",
    "radio failsafe": "radio failsafe",
    "ground station failsafe": "ground station failsafe",
    "estimator": "estimator",
    "GPS": "GPS",
    "compass": "compass",
    "barometer": "barometer",
    "sensors failsafe": "sensors failsafe",
    "vibration": "vibration",
    "fence": "fence",
    "terrain": "terrain",
    "flight mode": "flight mode",
    "internal error": "internal error",
    "other": "other",
}
#: `Corroboration` of a vehicle's report by its log -> sentence.
_OF_CORROBORATION: Mapping[str, str] = {
    "agrees": "the log says the same: motor {found}",
    "other motor": "the vehicle names motor {named}; speeds say {found}: {named} works harder "
    "because {found} gives less",
    "motor found": "the vehicle names no motor; speeds say {found}",
    "exchanged": "motors {found} each follow the output of the other: the name cannot be trusted",
    "all hard": "all motors were near full output, none stands out: too heavy, or a low battery",
    "hardest": "motor {named} had the highest output, {value}, and its speed follows: it works "
    "hardest, nothing shows that it is bad",
    "follows": "speeds follow the outputs of all motors: nothing shows that one is bad",
    "control lost": "the log shows the loss of control too: {losses}",
    "control kept": "the log shows no loss of control",
    "yaw": "{value} of the yaw authority was left then",
    "not compared": "without speeds and outputs at that time it cannot be compared",
    "nothing": "",
}


def corroboration_words(
    corroboration: str,
    *,
    named: Sequence[int] = (),
    found: Sequence[int] = (),
    value: float = float("nan"),
    losses: str = "",
    places: Sequence[str] = (),
) -> str:
    """Return a sentence on whether the log confirms a fault that the vehicle reported.

    `corroboration` is the value of a `Corroboration`; empty where it has no sentence. `named` are
    the motors in the vehicle's report, `found` those in the log, both from 0. `value` is a share,
    NaN if unknown. `losses` are the signs of lost control in words, `places` the places of all
    motors, empty where unknown.
    """
    words = _OF_CORROBORATION[corroboration]
    if not words:
        return ""
    return say(
        words,
        named=_motors(named, ()),
        found=_motors(found, places, "and" if corroboration == "exchanged" else "or"),
        value=percent(value) if known(value) else say("unknown"),
        losses=Verbatim(losses),
    )


def _motors(motors: Iterable[int], places: Sequence[str], between: str = "or") -> str:
    """Return the numbers of motors from 1, with the place of a single one and a word between."""
    numbers = [motor + 1 for motor in motors]
    if len(numbers) == 1 and places and places[numbers[0] - 1]:
        return f"{numbers[0]} {place_words(places[numbers[0] - 1])}"
    return f" {say(between)} ".join(map(str, numbers))


def kind_words(kind: str) -> str:
    """Return the title of a kind of report."""
    return say(KINDS.get(kind, kind))
