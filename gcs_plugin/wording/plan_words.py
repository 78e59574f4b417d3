"""Describe plans in words: items that are not understood, faults, and the comparison with a flight.

Reasons and faults are data of `mission.steps` and `mission.plan_check`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.language import number, percent, say
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.mission.plan_items import NotUnderstood
from thrustmargin.mission.plan_tracking.blame import Off
from thrustmargin.mission.plan_tracking.stretches import StretchComparison

#: Reason why an item is not understood -> its words, and the action.
NOT_UNDERSTOOD: Mapping[str, tuple[str, str]] = {
    "unknown command": ("what this command does is not known", "take it out, or allow for it"),
    "pattern rebuilt": (
        "only the drawn line of this pattern is stored, not its commands",
        "upload the plan and fetch it back",
    ),
    "height without a reference": (
        "its height has no reference and is read as above sea level, as ArduPilot does",
        "set it above home",
    ),
    "drops a load": ("what it drops is not known", "state the load that is left"),
    "changes the return": ("it moves home, where the return leads to", "set home before take-off"),
    "waits for a time of day": ("it waits for a time of day", "give it seconds to wait"),
    "waits without end": (
        "it waits until the pilot takes over, so nothing after it is flown",
        "take it out, or give it a time",
    ),
    "waits for the ground station": ("it waits for the pilot", "allow for that time"),
    "loiter without a radius": ("its circle is a setting of the vehicle", "give it a radius"),
    "points the nose": ("it points the nose somewhere", "expect other loads on the rotors"),
    "an output that may be the pump": (
        "the pump may hang at this output",
        "name the pump's output with --pump",
    ),
    "delays what follows": ("it delays the next command on the way", "switch the pump at a place"),
    "jump to nothing": ("it jumps to an item that is not there", "correct its target"),
    "jump to itself": ("it jumps to itself", "correct its target"),
    "jump without end": (
        "it repeats without an end, or more often than can be flown",
        "give it fewer repeats",
    ),
}
#: Fault of a plan -> its words, and the action.
FAULTS: Mapping[str, tuple[str, str]] = {
    "pump never on": (
        "the plan never switches the pump on",
        "say where it is on with --pump always or --pump lines, or add DO_SPRAYER",
    ),
    "pump never off": ("the pump is still on when the mission ends", "add DO_SPRAYER off"),
    "pump on before the first line": (
        "the pump is on before the first line",
        "switch it on at the start of the line",
    ),
    "pump on between lines": ("the pump is on between lines", "switch it off at the line end"),
    "pump on in turns": ("the pump stays on in turns", "switch it off at the line end"),
    "pump on at return": ("the pump is on during return or landing", "switch it off before"),
    "at the height of home": ("{height} above home", "give each the height that it is flown at"),
    "far above home": ("up to {height} above home", "is it meant above the sea?"),
    "far above home by sea level": (
        "up to {height} above home by heights above the sea",
        "is it meant above home, and is home's height right?",
    ),
    "below home": (
        "up to {height} below home",
        "are these heights and home's of one kind (home, sea level)?",
    ),
    "mixed height frames": (
        "heights are of different kinds (home, ground, sea level)",
        "use one kind",
    ),
    "jumps back": ("items are flown again by a jump", "check that the liquid lasts"),
    "fence crossed": ("the way leaves the geofence", "move the item or the fence"),
    "fence crosses itself": (
        "an area of the geofence crosses itself and was not checked",
        "draw it again",
    ),
    "take-off missing": ("the plan has no take-off", "add one as its first item"),
    "never flown": ("these come after the return and are never flown", "move them before it"),
    "another vehicle": (
        "the plan is for another kind of vehicle and is flown here as of a multirotor",
        "plan it for a multirotor",
    ),
    "far away": ("places are over 20 km apart", "check latitude and longitude"),
}
_SHOWN = 5  # items listed of one fault


def not_understood_words(one: NotUnderstood) -> str:
    """Return `item 12 (MAV_CMD 42): what this command does is not known; take it out, ... (touches
    time)`."""
    what, to_do = NOT_UNDERSTOOD[one.why]
    of = say("touches {what}", what=", ".join(map(say, one.touches)))
    return f"{say('item')} {one.item} (MAV_CMD {one.command}): {say(what)}; {say(to_do)} ({of})"


def fault_words(fault: str, items: Sequence[int], height: float = math.nan) -> str:
    """Return `items 4, 7, 9: the pump stays on in turns; switch it off at the line end`.

    `fault` is a key of FAULTS, `items` are mission item numbers; if there are none, the text begins
    with the fault. `height` is m above home, for faults of height.
    """
    what, to_do = FAULTS[fault]
    words = f"{say(what, height=number(abs(height), 'm', 0))}; {say(to_do)}"
    if not items:
        return words
    more = say(" and {count} more", count=len(items) - _SHOWN) if len(items) > _SHOWN else ""
    which = say("items" if len(items) > 1 else "item")
    return f"{which} {', '.join(map(str, items[:_SHOWN]))}{more}: {words}"


def hectares(area: float) -> str:
    """Return an area in m² as `12.34 ha`."""
    return number(area / 1e4, "ha", 2)


NO_COMPARISON = "the plan could not be put beside the flight"
#: Assumption -> its sentence, and unit and decimals of the flown and the forecast amount.
_OFF: Mapping[str, tuple[str, str, int]] = {
    "wind": ("wind of {flown}, {forecast} assumed", "m/s", 1),
    "fill": ("took off with {flown}, {forecast} assumed", "kg", 1),
    "density": ("air of {flown}, {forecast} assumed", "kg/m³", 3),
    "flow": (
        "used {flown}, {forecast} forecast: the pump gave {share} of the flow assumed",
        "kg",
        1,
    ),
    "battery": ("battery at {flown} on average, {forecast} forecast", "V", 1),
    "model": (
        "{flown} thrust left, {forecast} forecast, and no assumption explains it: look for the "
        "cause with identify",
        "%",
        0,
    ),
}


def off_sentence(off: Off) -> str:
    """Return how one value of the flight differs from its forecast.

    `took off with 16.0 kg, 13.0 kg assumed`. A difference that took no more thrust is marked so.
    """
    sentence, unit, digits = _OFF[off.what]
    flown, forecast = off.amount.flown, off.amount.forecast
    words = say(
        sentence,
        flown=left_words(1.0 - flown) if unit == "%" else number(flown, unit, digits),
        forecast=left_words(1.0 - forecast) if unit == "%" else number(forecast, unit, digits),
        share=percent(flown / forecast) if forecast else "",
    )
    if off.what == "model":
        return f"{say('on the way to item {item}', item=off.item)}: {words}"
    return words if off.mattered else f"{words}{say(', which took no more thrust')}"


def stretch_words(stretch: StretchComparison) -> str:
    """Return the values flown on one leg, with the forecast ones in brackets.

    `leg to mission item 5: 23 s (22 s), ...`; thrust left is the mean and the least.
    """
    used = stretch.utilisation_mean, stretch.utilisation_peak
    mean, least = (f"{left_words(1.0 - p.flown)} ({left_words(1.0 - p.forecast)})" for p in used)
    figures = (
        (stretch.seconds, "s", 0),
        (stretch.speed, "m/s", 1),
        (stretch.tank_end_kg, "kg", 1),
        (stretch.voltage, "V", 1),
    )
    parts = [
        *(f"{number(p.flown, unit, d)} ({number(p.forecast, unit, d)})" for p, unit, d in figures),
        say("thrust left {mean}, at least {least}", mean=mean, least=least),
    ]
    return f"{say(stretch.kind)} {say('to mission item')} {stretch.item}: {', '.join(parts)}"


def comparison_words(
    off: Sequence[Off], stretches: Sequence[StretchComparison], *, left_at: int | None
) -> str:
    """Return the comparison of a flight with its forecast: `flown as forecast`, or the differences.

    `off` are the values that differed. `left_at` is the mission item on the way to which the plan
    was left; None if it was flown to its end. Without `stretches` nothing of the plan was flown.
    """
    left = ""
    if left_at is not None:
        left = say("the plan was left on the way to item {item}", item=left_at)
    if not stretches:
        return left or say("nothing of the plan was flown")
    so = say("until then flown as forecast" if left else "flown as forecast")
    if not any(math.isfinite(s.utilisation_mean.off) for s in stretches):
        so = say("its thrust left is not known")
    return "; ".join(part for part in (left, *(map(off_sentence, off) if off else (so,))) if part)
