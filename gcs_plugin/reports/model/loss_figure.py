"""Loss curves of a training as a figure and as a table of numbers."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.reports.model.figure10 import BLUE, SPEED_COLOURS, write_figure
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.training import LossCurve
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
