"""A flight beside the forecast of its plan, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.numbers import number, percent
from thrustmargin.mission.beside.blame import Off
from thrustmargin.mission.beside.stretches import StretchBeside

NOT_BESIDE = "the plan could not be put beside the flight"
#: Assumption -> what is so of it, and the unit and digits of what was flown and forecast.
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
        "{flown} of thrust in use, {forecast} forecast, and no assumption explains it: look for "
        "the cause with identify",
        "%",
        0,
    ),
}


def off_sentence(off: Off) -> str:
    """`took off with 16.0 kg, 13.0 kg assumed`."""
    sentence, unit, digits = _OFF[off.what]
    flown, forecast = off.amount.flown, off.amount.forecast
    percents = 100.0 if unit == "%" else 1.0
    words = say(
        sentence,
        flown=number(percents * flown, unit, digits),
        forecast=number(percents * forecast, unit, digits),
        share=percent(flown / forecast) if forecast else "",
    )
    if off.what == "model":
        return f"{say('to item')} {off.item} {words}"
    return words if off.mattered else f"{words}{say(', which took no more thrust')}"


def stretch_words(stretch: StretchBeside) -> str:
    """`leg to item 5: 23 s (22 s), 3.9 m/s (4.0 m/s), ...` as flown, the forecast in brackets."""
    used = stretch.utilisation, stretch.peak
    mean, most = (f"{percent(p.flown)} ({percent(p.forecast)})" for p in used)
    figures = (
        (stretch.seconds, "s", 0),
        (stretch.speed, "m/s", 1),
        (stretch.tank_kg, "kg", 1),
        (stretch.voltage, "V", 1),
    )
    parts = [
        *(f"{number(p.flown, unit, d)} ({number(p.forecast, unit, d)})" for p, unit, d in figures),
        say("thrust in use {mean}, at most {most}", mean=mean, most=most),
    ]
    return f"{say(stretch.kind)} {say('to item')} {stretch.item}: {', '.join(parts)}"


def beside_words(
    off: Sequence[Off], stretches: Sequence[StretchBeside], *, left_at: int | None
) -> str:
    """One sentence on what of a forecast did not come: `as forecast`, or what was off."""
    left = ""
    if left_at is not None:
        left = say("the plan was left on the way to item {item}", item=left_at)
    if not stretches:
        return left or say("nothing of the plan was flown")
    so = say("until then flown as forecast" if left else "flown as forecast")
    if not any(math.isfinite(s.utilisation.off) for s in stretches):
        so = say("its thrust in use is not known")
    return "; ".join(part for part in (left, *(map(off_sentence, off) if off else (so,))) if part)
