"""The command `thrustmargin match`: the paper's load matching of an airframe, and its Figure 10."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from thrustmargin.gcs_plugin.commands.shared.inputs import LIMIT
from thrustmargin.gcs_plugin.commands.shared.options import OutputFile, check_outputs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.alarm_words import HELD, ONE_LOST, SPINS
from thrustmargin.models.errors import ModelError
from thrustmargin.models.physics.atmosphere import G0

if TYPE_CHECKING:
    from thrustmargin.models.model.rotor_model import RotorModel
    from thrustmargin.models.model.training import NetworkPoints
    from thrustmargin.models.physics.matching import Matching


PAPER_AIRFRAME = "topxgun-f16"
FOR_A_DAY = "How much to fill for the day's air, battery and wind: thrustmargin fill"
PAPER = "Han et al. 2024, F16: 9.28 kg, 5.28 kg, +75.83 %, about 50 % when full"


def match(
    *,
    airframe: str | None = None,
    model: Path | None = None,
    out: Path = Path("figure10"),
) -> None:
    """Match an aircraft's load with its power system, as the paper does, and draw its Figure 10.

    Prints what each rotor carries with a full and an empty tank, how much of its maximum that is,
    whether one lost rotor can be survived, and how much to fill on a usual day, as `fill` says.

    Example: thrustmargin match --airframe agras-t40 --out t40.svg

    Args:
        airframe: Name of an airframe that ships with thrustmargin, or path of your .toml file;
            without it that of --model, else the paper's own aircraft, which is then named.
        model: Rotor speed model whose predictions are drawn as points; else the shipped one.
        out: Figure to write, .svg or .pdf; without an ending both are written.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
    from thrustmargin.gcs_plugin.workshop.learn.model_figures import (
        ENDINGS,
        figure10,
        figure_paths,
        write_figure,
    )
    from thrustmargin.models.model.model_file import load_model
    from thrustmargin.models.physics.airframe import load_airframe
    from thrustmargin.models.physics.matching import match_airframe

    check_outputs(
        [OutputFile("--out", path, endings=ENDINGS) for path in figure_paths(out)],
        inputs=[model, airframe],
    )
    if airframe is None and model is not None:
        matching = match_airframe(load_model(model).airframe)
    else:
        matching = match_airframe(load_airframe(airframe or PAPER_AIRFRAME))
    points, drawn = _network_points(matching, model)
    console = Terminal()
    console.print(load_table(matching))
    if airframe is None and model is None:
        console.print(
            f"airframe {PAPER_AIRFRAME}, the paper's own aircraft: none was given; name yours with "
            "--airframe",
            soft_wrap=True,
        )
    for note in notes(matching):
        console.print(note)
    chosen = chosen_model(model, None if model else airframe or PAPER_AIRFRAME)
    for line in (*usual_fill(chosen), FOR_A_DAY):
        console.print(line, soft_wrap=True, highlight=False)
    console.print(drawn)
    for path in write_figure(figure10(matching, points), out):
        console.print(f"wrote {path}", soft_wrap=True)


def load_table(matching: Matching) -> Table:
    """Return load, rotor speed and utilisation in hover as a table for the terminal.

    Columns are full and empty tank. Each thrust ceiling has rows of utilisation, and of redundancy
    with one rotor lost.
    """

    # A title given as a string would be read as markup, and it comes from a file.
    title = Text(f"Load matching of {matching.airframe.title}")
    table = Table(title=title, caption=PAPER, box=box.SIMPLE_HEAD)
    table.add_column("")
    table.add_column("full tank", justify="right")
    table.add_column("empty tank", justify="right")
    load = matching.load
    table.add_row("load a rotor", f"{load.full_load:.2f} kg", f"{load.empty_load:.2f} kg")
    table.add_row("increase over empty (Eq. 8)", f"{100 * load.load_increase:.2f} %", "")
    table.add_row(
        "rotor speed in hover",
        f"{matching.rotor_speed_full_rpm:.0f} rpm",
        f"{matching.rotor_speed_empty_rpm:.0f} rpm",
    )
    for limit in matching.ceilings:
        table.add_section()
        table.add_row(Text(limit.name), f"{limit.max_thrust / G0:.2f} kgf a rotor", "")
        table.add_row(
            "  thrust utilisation",
            f"{100 * limit.use_full:.1f} %",
            f"{100 * limit.use_empty:.1f} %",
        )
        table.add_row(
            f"  {ONE_LOST}, {SPINS}",
            f"{limit.redundancy_yaw_uncontrolled_full:.2f} x weight",
            f"{limit.redundancy_yaw_uncontrolled_empty:.2f} x weight",
        )
        table.add_row(
            f"  {ONE_LOST}, {HELD}",
            f"{limit.redundancy_yaw_kept_full:.2f} x weight",
            f"{limit.redundancy_yaw_kept_empty:.2f} x weight",
        )
    return table


def usual_fill(model: RotorModel) -> list[str]:
    """Return the recommended fill and its conditions as lines, for the day remembered or assumed.

    They equal those of the command `thrustmargin fill` without options.
    """
    from thrustmargin.gcs_plugin.reports.fill.fill_table import conditions, fill_table
    from thrustmargin.gcs_plugin.store.remembered_day import remembered_day
    from thrustmargin.models.physics.day import complete_day

    day = complete_day(model.airframe.nominal_voltage, remembered_day())
    table = fill_table(
        model, day, limit=LIMIT, rotor_lost=True, temperatures_c=(30.0,), altitudes=(0.0,)
    )
    return [table.advice, *(f"  {sentence}" for sentence in conditions(table))]


def notes(matching: Matching) -> list[str]:
    """Return the two sentences below the table.

    The first compares the thrust coefficient with the range of the paper's parameters (Eq. 3), the
    second explains the values with one rotor lost.
    """
    low, high = matching.thrust_coefficient_range
    inside = "inside" if low <= matching.thrust_coefficient <= high else "outside"
    return [
        f"C_T of the thrust curve {matching.thrust_coefficient:.4f}, {inside} the range of Eq. 3, "
        f"{low:.4f} to {high:.4f} over the printed parameters.",
        "One rotor lost: thrust that can be held level and steady, over the weight. 1 or more "
        "carries the aircraft, with nothing kept back for gusts or turns.",
    ]


def _network_points(matching: Matching, path: Path | None) -> tuple[NetworkPoints | None, str]:
    """Return a network's predicted points for the figure, and a sentence about them.

    `path` is a model file; None uses the shipped model, and returns (None, reason) if that does not
    fit the airframe. Raises ModelError if the file's model does not fit.
    """
    from thrustmargin.models.model.model_file import load_model, shipped_model
    from thrustmargin.models.model.training import network_points

    if path is not None:
        model = load_model(path)
        points = network_points(matching.airframe, model)
    else:
        try:
            model = shipped_model()
            points = network_points(matching.airframe, model)
        except ModelError as error:
            return None, f"no network in the figure: {error}"
    sentence = f"network in the figure: {points.load.size} points of the model for {points.title}"
    if points.left_out:
        sentence += f"; {points.left_out} more lie outside its training domain"
    return points, sentence
