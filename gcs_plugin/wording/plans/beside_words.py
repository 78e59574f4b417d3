"""A flight beside the forecast of its plan, in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from thrustmargin.gcs_plugin.wording.numbers import number, percent

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
    "flow": lambda flown, planned: f"used {number(flown, 'kg')}, {number(planned, 'kg')} forecast",
    "battery": lambda flown, planned: (
        f"battery at {number(flown, 'V')} on average, {number(planned, 'V')} forecast"
    ),
    "model": lambda flown, planned: (
        f"{percent(flown)} of thrust in use, {percent(planned)} forecast, and no assumption "
        "explains it: look for the cause with identify"
    ),
}


def off_words(what: str, flown: float, planned: float, *, item: int = 0, mattered: bool) -> str:
    """`took off with 16.0 kg, 13.0 kg assumed`."""
    words = _OFF[what](flown, planned)
    if what == "model":
        return f"to item {item} {words}"
    return words if mattered else f"{words}, which took no more thrust"


def beside_words(off: Sequence[str], *, left_at: int | None, compared: int) -> str:
    """One sentence on what of a forecast did not come: `as forecast`, or what was off."""
    left = "" if left_at is None else f"the plan was left on the way to item {left_at}"
    if not compared:
        return left or "nothing of the plan was flown"
    as_forecast = "until then flown as forecast" if left else "flown as forecast"
    return "; ".join(part for part in (left, *(off or (as_forecast,))) if part)
