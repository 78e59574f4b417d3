"""A flight beside the forecast of its plan, in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from thrustmargin.gcs_plugin.wording.numbers import number, percent

NOT_BESIDE = "the plan could not be put beside the flight"
#: Assumption -> what is so of it, from the amounts flown and forecast.
_OFF: Mapping[str, Callable[[float, float], str]] = {
    "wind": lambda flown, planned: (
        f"wind of {number(flown, 'm/s')}, {number(planned, 'm/s')} assumed"
    ),
    "fill": lambda flown, planned: (
        f"took off with {number(flown, 'kg')}, {number(planned, 'kg')} assumed"
    ),
    "density": lambda flown, planned: (
        f"air of {number(flown, 'kg/m³', 3)}, {number(planned, 'kg/m³', 3)} assumed"
    ),
    "flow": lambda flown, planned: (
        f"used {number(flown, 'kg')}, {number(planned, 'kg')} forecast: the pump gave "
        f"{percent(flown / planned)} of the flow assumed"
    ),
    "battery": lambda flown, planned: (
        f"battery at {number(flown, 'V')} on average, {number(planned, 'V')} forecast"
    ),
    "model": lambda flown, planned: (
        f"{percent(flown)} of thrust in use, {percent(planned)} forecast, and no assumption "
        "explains it: look for the cause with identify"
    ),
}


class FlownFigure(Protocol):
    """A figure as forecast and as flown."""

    @property
    def forecast(self) -> float: ...
    @property
    def flown(self) -> float: ...
    @property
    def off(self) -> float: ...


class AssumptionOff(Protocol):
    """An assumption that was off."""

    @property
    def what(self) -> str: ...
    @property
    def amount(self) -> FlownFigure: ...
    @property
    def item(self) -> int: ...
    @property
    def mattered(self) -> bool: ...


class SpokenStretch(Protocol):
    """A stretch of the plan as forecast and as flown."""

    @property
    def item(self) -> int: ...
    @property
    def kind(self) -> str: ...
    @property
    def seconds(self) -> FlownFigure: ...
    @property
    def speed(self) -> FlownFigure: ...
    @property
    def utilisation(self) -> FlownFigure: ...
    @property
    def peak(self) -> FlownFigure: ...
    @property
    def tank_kg(self) -> FlownFigure: ...
    @property
    def voltage(self) -> FlownFigure: ...


def off_sentence(off: AssumptionOff) -> str:
    """`took off with 16.0 kg, 13.0 kg assumed`."""
    words = _OFF[off.what](off.amount.flown, off.amount.forecast)
    if off.what == "model":
        return f"to item {off.item} {words}"
    return words if off.mattered else f"{words}, which took no more thrust"


def stretch_words(stretch: SpokenStretch) -> str:
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
        f"thrust in use {mean}, at most {most}",
    ]
    return f"{stretch.kind} to item {stretch.item}: {', '.join(parts)}"


def beside_words(
    off: Sequence[str], stretches: Sequence[SpokenStretch], *, left_at: int | None
) -> str:
    """One sentence on what of a forecast did not come: `as forecast`, or what was off."""
    left = "" if left_at is None else f"the plan was left on the way to item {left_at}"
    if not stretches:
        return left or "nothing of the plan was flown"
    known = any(math.isfinite(s.utilisation.off) for s in stretches)
    so = "flown as forecast" if known else "its thrust in use is not known"
    return "; ".join(
        part for part in (left, *(off or (f"until then {so}" if left else so,))) if part
    )
