"""Figures of the loop on the real flights: effects one by one, residual before and after, swing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tests.measured.crazyflie import MeasuredFlight
from tests.measured.crazyflie_errors import ThrustLeft, fast_part, joined_errors
from tests.measured.crazyflie_loop import Loop
from tests.measured.crazyflie_words import Flown
from tests.measured.findings import PlotJson
from tests.measured.plots import BEFORE_AFTER, bar_figure, binned, scatter_figure
from tests.measured.swing_check import computed, unit
from thrustmargin.gcs_plugin.reports.shared.plot_style import MEAN, MEASURED
from thrustmargin.models.flight import Floats

BINS = 14
FASTEST_SHOWN = 0.99  # quantile of a channel, beyond which bins say little


def figures_of(flown: Flown) -> Mapping[str, PlotJson]:
    """All figures by caption."""
    loop, on_cable = flown.loops[0], flown.on_cable
    made = {
        "Error of thrust on flights left out, with 95 % intervals over flights: the thrust curve "
        "with the mass known, and the model with the effects found": _thrust(flown),
        "Error of rotor speed as each effect comes in, without payload; each flight predicted "
        "with values found without it": _staircase(loop),
        "The same with a load on a cable, starting from the model of the flights without": (
            _staircase(on_cable)
        ),
    }
    problems = [one.found.held_out for one in flown.loops if one.found.held_out is not None]
    for caption, channel, title in (
        ("speed through the air", "airspeed", "speed, m/s"),
        ("climb", "advance_ratio", "advance ratio J of the climb (1 = one diameter a turn)"),
    ):
        along = np.concatenate([getattr(p.channels, channel) for p in problems])
        made[f"Mean error of thrust against {caption}, without payload, flights left out"] = (
            _against(flown.loops, along, title)
        )
    length = on_cable.parameter("slung_load", "cable")[0]
    shown = [f for f in flown.cable if f.track.name in on_cable.held_out]
    if np.isfinite(length) and shown:
        flight = max(shown, key=lambda f: f.track.duration)
        made[
            f"Direction to the load in flight {flight.track.name}: by motion capture (points, used "
            "in no fit), and worked out from the aircraft's own accelerometer (lines)"
        ] = _swing(flight, length)
    return made


def _thrust(flown: Flown) -> PlotJson:
    cable = flown.on_cable
    curves = [flown.curve, fast_part(flown.curve), cable.curve, fast_part(cable.curve)]
    found = [flown.after, fast_part(flown.after), cable.after, fast_part(cable.after)]
    return bar_figure(
        groups=[
            ("thrust curve alone", [e.all for e in curves]),
            ("with the effects found", [e.all for e in found]),
        ],
        intervals=[[e.interval() for e in errors] for errors in (curves, found)],
        labels=[
            "no payload",
            "no payload,\nover 1.5 m/s",
            "load on a cable",
            "load on a cable,\nover 1.5 m/s",
        ],
        y_title="RMSE of thrust, % of weight",
    )


def _staircase(loop: Loop) -> PlotJson:
    found = loop.found.found
    labels = ["before", *(_broken(name) for name in loop.names)]
    values = [found[0].rmse_before_rpm, *(f.rmse_after_rpm for f in found)] if found else [0.0]
    return bar_figure(
        groups=[("RMSE", values)], labels=labels, y_title="RMSE of rotor speed, rpm", digits=0
    )


def _broken(name: str) -> str:
    """A name on two lines, so that neighbours on an axis do not touch."""
    first, _, rest = name.partition(" ")
    return f"+ {first}\n{rest}"


def _against(loops: Sequence[Loop], channel: Floats, title: str) -> PlotJson:
    low, high = np.quantile(channel, [1.0 - FASTEST_SHOWN, FASTEST_SHOWN])
    inside = (channel >= low) & (channel <= high)

    def mean(parts: list[ThrustLeft]) -> tuple[Floats, Floats]:
        return binned(channel[inside], joined_errors(parts).error[inside], BINS)

    return scatter_figure(
        lines=[
            ("thrust curve alone", *mean([loop.curve for loop in loops])),
            ("with the effects found", *mean([loop.after for loop in loops])),
        ],
        x_title=title,
        y_title="error of thrust, % of weight",
        line_colours=BEFORE_AFTER,
    )


def _swing(flight: MeasuredFlight, length: float) -> PlotJson:
    time_s = flight.track.time_s
    measured, told = unit(flight.load_ned), computed(flight, length)
    names = ("north", "east")
    return scatter_figure(
        points=[(f"{name}, measured", time_s, measured[:, k]) for k, name in enumerate(names)],
        lines=[(f"{name}, worked out", time_s, told[:, k]) for k, name in enumerate(names)],
        x_title="time, s",
        y_title="part of the unit vector to the load",
        line_colours=(MEASURED, MEAN),
    )
