"""Figures of a model: the paper's Figure 10 for any airframe, and the loss curves of a training."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.model.training import LossCurve
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from thrustmargin.models.model.network_points import NetworkPoints
    from thrustmargin.models.physics.matching import Matching

INK = "#1f2933"
BLUE = "#1f5fa8"
BAND = "#9fc3e6"
WARN = "#b3261e"
#: One colour and, because points of one load lie close together, one size an airspeed.
MARKER_SIZES = (9, 6, 3.5, 9, 6)
SPEED_COLOURS = ("#fdae61", "#d95f0e", "#7f2704", "#4d4d4d", "#969696")


def figure10(matching: Matching, points: NetworkPoints | None) -> Figure:
    """The paper's Figure 10: thrust curve, band of loads, maxima, the network's rotor speeds."""
    from matplotlib.figure import Figure

    airframe, load = matching.airframe, matching.load
    share = float(airframe.rotor_effectiveness.mean())
    top = 1.12 * max(limit.max_thrust / G0 for limit in matching.ceilings)
    right = 1.04 * airframe.max_rotor_speed_rpm
    figure = Figure(figsize=(8.0, 5.2), layout="constrained")
    axes = figure.add_subplot()

    axes.axhspan(load.empty_load, load.full_load, color=BAND, alpha=0.45, linewidth=0)
    speed = np.linspace(0.0, airframe.max_rotor_speed_rpm, 300)
    curve = share * airframe.thrust_coefficient * speed**2 / G0
    axes.plot(speed, curve, color=BLUE, linewidth=2.0)
    axes.plot(
        [matching.rotor_speed_empty_rpm, matching.rotor_speed_full_rpm],
        [load.empty_load, load.full_load],
        linestyle="none",
        marker="o",
        markersize=7,
        markerfacecolor="white",
        markeredgecolor=BLUE,
        markeredgewidth=1.6,
    )
    for tank, mass, rpm in (
        ("full", load.full_load, matching.rotor_speed_full_rpm),
        ("empty", load.empty_load, matching.rotor_speed_empty_rpm),
    ):
        _label(axes, f"{tank} tank {mass:.2f} kg, {rpm:.0f} rpm", (0.0, mass), color=INK)
    _draw_ceilings(axes, matching, top=top, right=right)
    if points is not None:
        _draw_points(axes, points)
    axes.set_xlim(0.0, right)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("rotor speed [rpm]")
    axes.set_ylabel("thrust of a rotor [kgf]")
    newtons = axes.twinx()
    newtons.set_ylim(0.0, top * G0)
    newtons.set_ylabel("[N]")
    newtons.spines[["top"]].set_visible(False)
    axes.set_title(_literal(f"{airframe.title}: thrust curve and load"), loc="left", color=INK)
    axes.spines[["top"]].set_visible(False)
    return figure


def _literal(text: str) -> str:
    """Text from a file, in which a dollar sign would start mathematical notation."""
    return text.replace("$", r"\$")


def _draw_ceilings(axes: Axes, matching: Matching, *, top: float, right: float) -> None:
    """A line for each ceiling, and the 50 % limit of the thrust curve's maximum."""
    heights: list[float] = []
    for limit in matching.ceilings:
        height = limit.max_thrust / G0
        axes.axhline(height, color=WARN, linewidth=1.1)
        # Two ceilings of nearly one height would print their names over each other.
        below = any(abs(height - other) < 0.035 * top for other in heights)
        heights.append(height)
        _label(axes, f"{limit.name}: {height:.2f} kgf", (0.0, height), below=below)
    half = 0.5 * heights[1]
    axes.axhline(half, color=WARN, linewidth=1.1, linestyle="--")
    _label(axes, f"50 % limit: {half:.2f} kgf", (right, half), left=True)


def _label(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    *,
    below: bool = True,
    left: bool = False,
    color: str = WARN,
) -> None:
    """Text a little off the place (rpm, kgf)."""
    axes.annotate(
        text,
        at,
        xytext=(-6 if left else 6, -4 if below else 3),
        textcoords="offset points",
        ha="right" if left else "left",
        va="top" if below else "bottom",
        color=color,
    )


def _draw_points(axes: Axes, points: NetworkPoints) -> None:
    """The network's rotor speeds against the load: mean of the rotors, bar over their range."""
    for index, airspeed in enumerate(np.unique(points.airspeed)):
        chosen = points.airspeed == airspeed
        rpm = points.rotor_speed_rpm[chosen]
        middle = rpm.mean(axis=1)
        axes.errorbar(
            middle,
            points.load[chosen] / G0,
            xerr=[middle - rpm.min(axis=1), rpm.max(axis=1) - middle],
            fmt="s",
            markersize=MARKER_SIZES[index % len(MARKER_SIZES)],
            capsize=3,
            linewidth=1.0,
            color=SPEED_COLOURS[index % len(SPEED_COLOURS)],
            label=f"{airspeed:g} m/s: mean and range of rotors",
        )
    legend_title = _literal(f"network, {points.title}")
    axes.legend(loc="lower right", frameon=False, title=legend_title, alignment="left")


def figure_paths(out: Path) -> list[Path]:
    """The files that `write_figure` writes: `out` itself, or without an ending .svg and .png."""
    return [out] if out.suffix else [out.with_suffix(".svg"), out.with_suffix(".png")]


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Write the figure as .svg, .png or both; each file appears whole or not at all."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    paths = figure_paths(out)
    for path in paths:
        kind = path.suffix[1:]
        try:
            with rc_context({"svg.hashsalt": "thrustmargin"}), whole_file(path) as draft:
                figure.savefig(
                    draft,
                    format=kind,
                    dpi=150,
                    metadata={"Date": None} if kind == "svg" else None,
                )
        except OSError as error:
            raise DataError(f"cannot write {path}: {error.strerror}; check the folder") from error
    return paths


def loss_paths(model_path: Path) -> tuple[Path, Path]:
    """MODEL.loss.csv and MODEL.loss.svg, beside the model file."""
    return model_path.with_suffix(".loss.csv"), model_path.with_suffix(".loss.svg")


def write_loss_curves(curves: Sequence[LossCurve], model_path: Path) -> list[Path]:
    """Write the table and the figure beside the model file; returns their paths.

    Raises DataError when they cannot be written.
    """
    table, drawn = loss_paths(model_path)
    try:
        with whole_file(table) as draft:
            write_table(curves, draft)
    except OSError as error:
        raise DataError(f"cannot write {table}: {error.strerror}; check the folder") from error
    return [table, *write_figure(loss_figure(curves), drawn)]


def write_table(curves: Sequence[LossCurve], path: Path) -> None:
    """One line a network and epoch: losses are mean squares of standardised rotor speed."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["network", "epoch", "training_loss", "validation_loss", "kept"])
        for curve in curves:
            losses = zip(curve.training_loss, curve.validation_loss, strict=True)
            for epoch, (training, validation) in enumerate(losses, 1):
                rows.writerow(
                    [
                        curve.name,
                        epoch,
                        f"{training:.6g}",
                        f"{validation:.6g}",
                        int(epoch == curve.best_epoch),
                    ]
                )


def loss_figure(curves: Sequence[LossCurve]) -> Figure:
    """Loss against epoch, a panel a network; the dot is the epoch whose weights are kept."""
    from matplotlib.figure import Figure

    columns = min(3, len(curves))
    lines = -(-len(curves) // columns)
    figure = Figure(figsize=(4.0 * columns, 2.8 * lines), layout="constrained")
    for index, curve in enumerate(curves):
        axes = figure.add_subplot(lines, columns, index + 1)
        epochs = range(1, curve.training_loss.size + 1)
        axes.plot(epochs, curve.training_loss, color=BLUE, linewidth=1.2, label="training")
        axes.plot(
            epochs, curve.validation_loss, color=SPEED_COLOURS[1], linewidth=1.2, label="validation"
        )
        lowest = curve.validation_loss[curve.best_epoch - 1]
        axes.plot(curve.best_epoch, lowest, marker="o", color=SPEED_COLOURS[2], markersize=5)
        axes.set_yscale("log")
        axes.set_title(f"{curve.name}: lowest {lowest:.3g} at epoch {curve.best_epoch}", fontsize=9)
        axes.set_xlabel("epoch")
        axes.set_ylabel("loss")
        axes.spines[["top", "right"]].set_visible(False)
        if index == 0:
            axes.legend(frameon=False)
    return figure
