"""Draw the paper's Figure 10 for any airframe, and the loss curves of a training; write the curves
as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.reports.shared.page_shell import csv_text
from thrustmargin.gcs_plugin.reports.shared.plot_style import Figure, Trace, scatter, titled
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.training import LossCurve
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.models.model.training import NetworkPoints
    from thrustmargin.models.physics.matching import Matching


INK = "#1f2933"
BLUE = "#1f5fa8"
BAND = "rgba(159, 195, 230, 0.45)"
WARN = "#b3261e"
#: One colour and, because points of one load lie close together, one size an airspeed.
MARKER_SIZES = (18, 13, 9, 18, 13)
SPEED_COLOURS = ("#fdae61", "#d95f0e", "#7f2704", "#4d4d4d", "#969696")
ENDINGS = (".svg", ".pdf")


def figure10(matching: Matching, points: NetworkPoints | None) -> Figure:
    """Draw the paper's Figure 10: thrust of one rotor, kgf, against its speed, rpm.

    It shows the thrust curve, the band from empty to full load, and the ceilings. `points` are a
    network's predictions; None draws none.
    """
    airframe, load = matching.airframe, matching.load
    share = float(airframe.rotor_effectiveness.mean())
    top = 1.12 * max(limit.max_thrust / G0 for limit in matching.ceilings)
    right = 1.04 * airframe.max_rotor_speed_rpm
    made = Figure(
        {
            "height": 650,
            "margin": {"l": 80, "r": 80, "t": 60, "b": 50},
            "shapes": [],
            "xaxis": titled("rotor speed [rpm]", range=[0.0, right]),
            "yaxis": titled("thrust of a rotor [kgf]", range=[0.0, top], nticks=8),
            "yaxis2": titled("[N]", range=[0.0, top * G0], side="right", nticks=8),
            "legend": {"orientation": "v", "x": 0.56, "y": 0.2},
        }
    )
    title = f"{escape(airframe.title)}: thrust curve and load"
    made.note(title, x=0, y=1.03, xref="paper", yref="paper", xanchor="left", yanchor="bottom")
    ends = np.array([0.0, right, right, 0.0]), np.repeat([load.empty_load, load.full_load], 2)
    band = {"fill": "toself", "fillcolor": BAND, "showlegend": False}
    speed = np.linspace(0.0, airframe.max_rotor_speed_rpm, 300)
    curve = share * airframe.thrust_coefficient * speed**2 / G0
    loads = (
        ("full", load.full_load, matching.rotor_speed_full_rpm),
        ("empty", load.empty_load, matching.rotor_speed_empty_rpm),
    )
    ring = {"symbol": "circle-open", "color": BLUE, "size": 16, "line": {"width": 3}}
    hover = [rpm for *_, rpm in loads], [mass for _, mass, _ in loads]
    made.add(
        [
            scatter(*ends, **band),
            scatter(speed, curve, line={"color": BLUE, "width": 3}, showlegend=False),
            scatter(*hover, mode="markers", marker=ring, showlegend=False),
        ]
    )
    for tank, mass, rpm in loads:
        _label(made, f"{tank} tank {mass:.2f} kg, {rpm:.0f} rpm", (0.0, mass), color=INK)
    _draw_ceilings(made, matching, top=top, right=right)
    if points is not None:
        made.add(_network_traces(points))
        made.layout["legend"]["title"] = {"text": f"network, {escape(points.title)}"}
    return made


def _draw_ceilings(made: Figure, matching: Matching, *, top: float, right: float) -> None:
    """Draw a horizontal line at the thrust of each ceiling, kgf, and at half of the second one.

    The second ceiling is that of the thrust curve; at least two are needed. `top`, kgf, and
    `right`, rpm, are the ends of the axes.
    """
    heights: list[float] = []
    for limit in matching.ceilings:
        height = limit.max_thrust / G0
        # Two ceilings of nearly one height would print their names over each other.
        below = any(abs(height - other) < 0.035 * top for other in heights)
        heights.append(height)
        _draw_line(made, height)
        _label(made, f"{limit.name}: {height:.2f} kgf", (0.0, height), below=below)
    half = 0.5 * heights[1]
    _draw_line(made, half, dash="dash")
    _label(made, f"50 % limit: {half:.2f} kgf", (right, half), left=True)


def _draw_line(made: Figure, height: float, **look: str) -> None:
    """Draw a horizontal line at `height`, kgf, over the whole width."""
    line = {"color": WARN, "width": 1.6, **look}
    ends = {"x0": 0, "x1": 1, "xref": "x domain", "y0": height, "y1": height, "yref": "y"}
    made.layout["shapes"].append({"type": "line", **ends, "line": line})


def _label(
    made: Figure,
    text: str,
    at: tuple[float, float],
    *,
    below: bool = True,
    left: bool = False,
    color: str = WARN,
) -> None:
    """Write `text` next to the point `at`, (rpm, kgf).

    It is below the point, or above if `below` is False; right of it, or left if `left`.
    """
    anchors = {"xanchor": "right" if left else "left", "yanchor": "top" if below else "bottom"}
    shift = {"xshift": -8 if left else 8, "yshift": -4 if below else 4}
    made.note(escape(text), x=at[0], y=at[1], font={"color": color}, **anchors, **shift)


def _network_traces(points: NetworkPoints) -> list[Trace]:
    """Return plotly traces of the network's rotor speeds, rpm, against load, kgf.

    Each airspeed has a trace of the mean over rotors, and one of lines from the slowest to the
    fastest rotor.
    """
    traces = []
    for index, airspeed in enumerate(np.unique(points.airspeed)):
        chosen = points.airspeed == airspeed
        rpm, load = points.rotor_speed_rpm[chosen], points.load[chosen] / G0
        colour = SPEED_COLOURS[index % len(SPEED_COLOURS)]
        size = MARKER_SIZES[index % len(MARKER_SIZES)]
        name = f"{airspeed:g} m/s: mean and range of rotors"
        gap = np.full(load.size, np.nan)
        ranges = np.stack([rpm.min(axis=1), rpm.max(axis=1), gap], axis=1).ravel()
        look = {"line": {"color": colour, "width": 1.4}, "showlegend": False}
        mark = {"symbol": "square", "color": colour, "size": size}
        traces.append(scatter(ranges, np.repeat(load, 3), **look))
        traces.append(scatter(rpm.mean(axis=1), load, mode="markers", marker=mark, name=name))
    return traces


def figure_paths(out: Path) -> list[Path]:
    """Return the files that `write_figure` writes: `out`, or without an ending one for each of
    ENDINGS."""
    return [out] if out.suffix else [out.with_suffix(ending) for ending in ENDINGS]


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Write the figure to `out`, which ends in .svg or .pdf; without an ending write both.

    Return the paths. No file is left incomplete. Raise DataError if a file cannot be written.
    """
    from thrustmargin.gcs_plugin.reports.paper.drawn_figure import file_bytes

    paths = figure_paths(out)
    for path in paths:
        _write_file(path, file_bytes(figure, path.suffix))
    return paths


def loss_paths(model_path: Path) -> tuple[Path, Path]:
    """Return the paths MODEL.loss.csv and MODEL.loss.svg in the folder of the model file."""
    return model_path.with_suffix(".loss.csv"), model_path.with_suffix(".loss.svg")


def write_loss_curves(curves: Sequence[LossCurve], model_path: Path) -> list[Path]:
    """Write the loss curves as a table and a figure next to the model file; return both paths.

    Raise DataError if a file cannot be written.
    """
    table, drawn = loss_paths(model_path)
    _write_file(table, loss_table(curves).encode())
    return [table, *write_figure(loss_figure(curves), drawn)]


def _write_file(path: Path, content: bytes) -> None:
    """Write the whole file or none; raise DataError if that fails."""
    try:
        with whole_file(path) as draft:
            draft.write_bytes(content)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror}; check the folder") from error


def loss_table(curves: Sequence[LossCurve]) -> str:
    """Return the loss curves as CSV: network, epoch (from 1), training and validation loss, kept.

    `kept` is 1 in the epoch whose weights are used. Losses are mean squares of standardised rotor
    speed.
    """
    rows = [
        (curve.name, epoch, f"{training:.6g}", f"{validation:.6g}", int(epoch == curve.best_epoch))
        for curve in curves
        for epoch, (training, validation) in enumerate(
            zip(curve.training_loss, curve.validation_loss, strict=True), 1
        )
    ]
    return csv_text(("network", "epoch", "training_loss", "validation_loss", "kept"), rows)


def loss_figure(curves: Sequence[LossCurve]) -> Figure:
    """Draw training and validation loss against epoch, one panel for each network.

    A dot marks the epoch whose weights are used.
    """
    high, gap = 150.0, 74.0
    whole = len(curves) * (high + gap) - gap
    margin = {"l": 80, "r": 20, "t": 70, "b": 60}
    made = Figure({"height": whole + margin["t"] + margin["b"], "margin": margin})
    for index, curve in enumerate(curves):
        axes, top = str(index + 1) if index else "", 1.0 - index * (high + gap) / whole
        epochs = np.arange(1.0, curve.training_loss.size + 1)
        lowest = curve.validation_loss[curve.best_epoch - 1]
        shown, orange = {"showlegend": index == 0}, SPEED_COLOURS[1]
        training = {"color": BLUE, "width": 2}
        validation = {"color": orange, "width": 2, "dash": "dash"}
        kept = {"color": SPEED_COLOURS[2], "size": 10}
        at = [curve.best_epoch], [lowest]
        made.add(
            [
                scatter(epochs, curve.training_loss, line=training, name="training", **shown),
                scatter(epochs, curve.validation_loss, line=validation, name="validation", **shown),
                scatter(*at, mode="markers", marker=kept, name="kept", **shown),
            ],
            axes,
        )
        made.layout[f"xaxis{axes}"] = titled("epoch", anchor=f"y{axes}")
        place = {"anchor": f"x{axes}", "domain": [max(top - high / whole, 0.0), top]}
        made.layout[f"yaxis{axes}"] = titled("loss", type="log", **place)
        words = f"{escape(curve.name)}: lowest {lowest:.3g} at epoch {curve.best_epoch}"
        paper = {"xref": "paper", "yref": "paper", "xanchor": "right", "yanchor": "bottom"}
        made.note(words, x=1, y=top, **paper)
    return made
