"""Figures of the loop on the real flights: effects one by one, residual before and after, swing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_plugin.measured.crazyflie import MeasuredFlight
from gcs_plugin.measured.crazyflie_loop import Loop, ThrustLeft
from gcs_plugin.measured.findings import PlotJson
from gcs_plugin.measured.plots import bar_figure, binned, scatter_figure
from gcs_plugin.measured.swing_check import computed, unit
from models.flight import Floats

FASTEST_SHOWN = 0.99  # quantile of a channel, beyond which bins say little


def figures_of(
    loop: Loop, on_cable: Loop, cable: Sequence[MeasuredFlight]
) -> Mapping[str, PlotJson]:
    """All figures by caption."""
    made = {
        "thrust left, % of the weight, flights left out: the curve T = a N² and the model with the "
        "effects found": _thrust(loop, on_cable),
        "rotor speed error of flights left out in turn, as each effect comes in (no payload)": (
            _staircase(loop)
        ),
        "the same with a load on a cable, from the model of the flights without": _staircase(
            on_cable
        ),
    }
    if loop.found.held_out is not None:
        x = loop.found.held_out.channels
        caption = "thrust left against {}, no payload, flights left out"
        made[caption.format("speed")] = _against(loop, x.airspeed, "m/s")
        made[caption.format("the advance ratio of the climb")] = _against(
            loop, x.advance_ratio, "J, positive in climb"
        )
    length = on_cable.parameter("slung_load", "cable")[0]
    shown = [f for f in cable if f.track.name in on_cable.held_out]
    if np.isfinite(length) and shown:
        flight = max(shown, key=lambda f: f.track.duration)
        made[
            f"direction to the load in {flight.track.name}: measured, and worked out from the "
            "aircraft's own motion"
        ] = _swing(flight, length)
    return made


def _thrust(loop: Loop, on_cable: Loop) -> PlotJson:
    def row(which: str) -> list[float]:
        free, cable = getattr(loop, which), getattr(on_cable, which)
        return [free.all, free.in_fast, cable.all, cable.in_fast]

    return bar_figure(
        groups=[
            ("curve alone, mass known", row("curve")),
            ("with the effects found", row("after")),
        ],
        labels=["no payload", "no payload, over 1.5 m/s", "cable", "cable, over 1.5 m/s"],
        y_title="RMSE, % of the weight",
    )


def _staircase(loop: Loop) -> PlotJson:
    found = loop.found.found
    labels = ["before", *(f.term.effect.name.replace("_", " ") for f in found)]
    labels = [f"{k}. {label}" if k else label for k, label in enumerate(labels)]
    values = [found[0].rmse_before_rpm, *(f.rmse_after_rpm for f in found)] if found else [0.0]
    return bar_figure(groups=[("RMSE", values)], labels=labels, y_title="rpm")


def _against(loop: Loop, channel: Floats, title: str) -> PlotJson:
    low, high = np.quantile(channel, [1.0 - FASTEST_SHOWN, FASTEST_SHOWN])
    inside = (channel >= low) & (channel <= high)

    def mean(left: ThrustLeft) -> tuple[Floats, Floats]:
        return binned(channel[inside], left.error[inside])

    return scatter_figure(
        lines=[
            ("curve alone", *mean(loop.curve)),
            ("with the effects found", *mean(loop.after)),
        ],
        x_title=title,
        y_title="thrust less what was asked, % of the weight",
    )


def _swing(flight: MeasuredFlight, length: float) -> PlotJson:
    time_s = flight.track.time_s
    measured, told = unit(flight.load_ned), computed(flight, length)
    names = ("north", "east")
    return scatter_figure(
        points=[(f"{name}, measured", time_s, measured[:, k]) for k, name in enumerate(names)],
        lines=[(f"{name}, worked out", time_s, told[:, k]) for k, name in enumerate(names)],
        x_title="time, s",
        y_title="part of the direction to the load",
    )
