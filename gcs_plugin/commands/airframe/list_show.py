"""`thrustmargin airframe list` and `show`: the airframes that ship, and every value of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.written import grid

if TYPE_CHECKING:
    from thrustmargin.models.physics.airframe import Airframe


@dataclass(frozen=True, slots=True)
class AirframeList:
    """Show the airframes and the power sets that ship with thrustmargin.

    Example: thrustmargin airframe list
    """

    def run(self) -> int:
        from thrustmargin.models.physics.airframe import airframe_names, load_airframe
        from thrustmargin.models.physics.airframe_draft import power_sets

        console, rows = Terminal(), []
        for name in airframe_names():
            craft = load_airframe(name)
            masses = (f"{craft.empty_mass:g}", f"{craft.tank_capacity_kg:g}")
            rows.append((name, craft.layout, str(craft.rotor_count), *masses, craft.title))
        heads = ("name", "layout", "rotors", "empty kg", "tank kg", "aircraft")
        console.print(grid(heads, rows, left=(0, 1, 5)))
        console.print("power sets, for: thrustmargin airframe new --power-set NAME")
        sets = []
        for one in power_sets().values():
            top = one.quantities["nameplate_max_thrust"]
            words = f"{top.value / 9.80665:.3g}" + (" guessed" if top.guessed else "")
            sets.append((one.name, one.title, words))
        console.print(grid(("name", "motor and propeller", "kgf a rotor"), sets, left=(0, 1)))
        return 0


@dataclass(frozen=True, slots=True)
class AirframeShow:
    """Show every value of an airframe with its unit and source, and which are guesses.

    Example: thrustmargin airframe show topxgun-f16
    """

    name: Annotated[Positional[str], tyro.conf.arg(metavar="NAME|FILE")]
    """Name of a shipped airframe, or an airframe file (.toml)."""

    def run(self) -> int:
        from thrustmargin.models.physics.airframe import load_airframe

        print_airframe(Terminal(), load_airframe(self.name))
        return 0


def print_airframe(console: Console, craft: Airframe) -> None:
    """The aircraft in a sentence, its quantities and its rotors as tables."""
    console.print(repr(craft), soft_wrap=True)
    table = grid(("quantity", "value", "unit", "known", "from"), left=(0, 2, 3, 4))
    for name, q in craft.quantities.items():
        known, style = ("guessed", "yellow") if q.guessed else ("", "")
        unit = "" if q.unit == "1" else q.unit
        table.add_row(name, f"{q.value:.5g}", unit, known, q.source, style=style)
    console.print(table)
    rotors = []
    for n, name in enumerate(craft.rotor_names):
        cells = [f"{p:.3f}" for p in craft.rotor_position_frd[n]]
        turns = "ccw" if craft.rotor_spin[n] > 0 else "cw"
        rotors.append((str(n + 1), *cells, f"{craft.rotor_effectiveness[n]:g}", turns, name))
    heads = ("motor", "forward m", "right m", "down m", "effectiveness", "turns", "place")
    console.print(grid(heads, rotors, left=(5, 6)))
    if craft.guessed:
        console.print(
            f"guessed, not measured and not printed by a maker: {', '.join(craft.guessed)}",
            soft_wrap=True,
        )
