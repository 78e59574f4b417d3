"""The loop on the real flights as one picture: error of thrust, and of rotor speed by effect."""

from __future__ import annotations

import numpy as np
from plotly.graph_objects import Bar, Figure
from plotly.subplots import make_subplots

from tests.measured.crazyflie_errors import ThrustLeft, fast_part
from tests.measured.crazyflie_numbers import Flown
from thrustmargin.gcs_plugin.reports.shared.plot_style import MEASURED, PREDICTED, STYLE

WIDTH, HEIGHT = 980, 950  # px
THRUST = "Error of thrust on flights left out, with 95 % intervals over flights"
SPEED = "Error of rotor speed as each effect comes in, without payload, flights left out in turn"


def picture(flown: Flown) -> Figure:
    """Bars of both errors, before and after."""
    figure = make_subplots(rows=2, subplot_titles=(THRUST, SPEED), vertical_spacing=0.16)
    cable = flown.on_cable
    for name, colour, errors in (
        ("thrust curve alone", PREDICTED, (flown.curve, cable.curve)),
        ("with the effects found", MEASURED, (flown.after, cable.after)),
    ):
        figure.add_trace(_thrust(name, colour, errors), row=1, col=1)
    found = flown.loops[0].found.found
    names = ["before", *(f"+ {f.term.words}".replace("_", " ", 1).replace("_", " ") for f in found)]
    values = [found[0].rmse_before_rpm, *(f.rmse_after_rpm for f in found)] if found else [0.0]
    texts = [f"{v:.0f}" for v in values]
    bars = Bar(x=names, y=values, text=texts, marker_color=PREDICTED, showlegend=False)
    figure.add_trace(bars, row=2, col=1)
    legend = {"x": 0.02, "y": 0.98, "yref": "paper", "orientation": "v"}
    figure.update_layout(template=STYLE, width=WIDTH, height=HEIGHT, legend=legend)
    figure.update_yaxes(title="RMSE, % of weight", row=1, col=1)
    figure.update_yaxes(title="RMSE, rpm", row=2, col=1)
    return figure


def _thrust(name: str, colour: str, errors: tuple[ThrustLeft, ThrustLeft]) -> Bar:
    every = [part for whole in errors for part in (whole, fast_part(whole))]
    values = np.array([part.all for part in every])
    ends = np.array([part.interval() for part in every])
    cases = ("no payload", "load on a cable")
    labels = [f"{case}{fast}" for case in cases for fast in ("", ",<br>over 1.5 m/s")]
    spread = {"array": ends[:, 1] - values, "arrayminus": values - ends[:, 0], "color": "#8a8a8a"}
    texts = [f"{v:.2f}" for v in values]
    return Bar(
        x=labels,
        y=values,
        name=name,
        marker_color=colour,
        text=texts,
        textposition="inside",
        insidetextanchor="start",
        error_y={"type": "data", "symmetric": False, **spread},
    )
