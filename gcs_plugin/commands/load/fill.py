"""`thrustmargin fill`: how much to fill for a day's air, battery and wind."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from thrustmargin.gcs_plugin.commands.shared.inputs import ANY_KNOWN, Known, Share
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    UsageError,
    check_outputs,
    check_range,
    check_utilisation,
    json_apart,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.page_shell import grid
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.mission import SPRAY_SPEED
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.reports.fill.fill_table import FillTable

TEMPERATURES_C = (0.0, 10.0, 20.0, 30.0, 40.0)
ALTITUDES = (0.0, 500.0, 1000.0, 1500.0, 2000.0, 3000.0)  # m AMSL


def fill(
    *,
    model: Path | None = None,
    known: Known = ANY_KNOWN,
    airframe: str | None = None,
    day: Path | None = None,
    air_temperature: float | None = None,
    altitude: float | None = None,
    pressure: float | None = None,
    voltage: float | None = None,
    capacity: float | None = None,
    resistance: float | None = None,
    speed: float = SPRAY_SPEED,
    wind: float | None = None,
    gusts: float | None = None,
    max_utilisation: Share = 0.5,
    rotor_lost: bool = True,
    out: Path | None = None,
    json: Path | None = None,
) -> None:
    """Say how much liquid to fill for a day, and how that changes with air and battery.

    The largest fill that keeps thrust utilisation in steady flight below its limit, lets the
    aircraft hold its weight after losing any one rotor, and stays within tank and take-off mass.

    Example: thrustmargin fill --airframe topxgun-f16 --air-temperature 35 --altitude 400 --wind 4

    Args:
        model: Rotor speed model file of this aircraft.
        known: The known aircraft; see `thrustmargin learn`.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the model's.
        day: File (.toml, .json) with the day: air_temperature_c, altitude, pressure_hpa, wind,
            gusts, battery_voltage, battery_capacity_ah, battery_resistance_mohm. Without it, and
            without an option, the day last stated within 12 hours.
        air_temperature: °C of the air at the field; where it was never stated 30.
        altitude: m of the field above the sea; where it was never stated 0.
        pressure: hPa of the air at the field, not reduced to sea level, instead of --altitude.
        voltage: V of the battery at rest, before take-off; without it a half used battery, or a
            full one with --capacity.
        capacity: Ah of the battery, by which it sags under load.
        resistance: mOhm of the battery, instead of the usual one.
        speed: m/s over the ground while spraying.
        wind: m/s of wind, which is flown against; where it was never stated 0.
        gusts: m/s of wind in gusts.
        max_utilisation: Largest share of a rotor's maximum thrust that may be in use.
        rotor_lost: Whether one rotor lost must be survived; without yaw control, it will spin.
        out: Page to write (.html), for print or screen.
        json: Write the numbers as JSON to this file (.json); - is standard output, and nothing
            else.
    """
    from thrustmargin.gcs_plugin.commands.shared.day_options import day_of_command, stated_day
    from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs
    from thrustmargin.gcs_plugin.commands.shared.log_flights import named_aircraft
    from thrustmargin.gcs_plugin.reports.fill import fill_table as made
    from thrustmargin.models.model.clearance import NO_FLIGHT

    out, json = json_apart(out, json)
    inputs = Inputs(model=model, airframe=airframe, max_utilisation=max_utilisation, known=known)
    if not inputs.given:
        raise UsageError("no aircraft given; name one with --aircraft, --airframe or --model")
    check_utilisation(inputs.limit)
    check_range("--speed", speed, 0.0, 60.0, "m/s")
    stated = stated_day(
        day,
        air_temperature=air_temperature,
        height=altitude,
        pressure=pressure,
        battery_voltage=voltage,
        battery_capacity_ah=capacity,
        battery_resistance=resistance,
        wind=wind,
        gusts=gusts,
    )
    check_outputs(
        (
            OutputFile("--out", out, endings=(".html", ".htm")),
            OutputFile("--json", json, endings=(".json",)),
        ),
        inputs=[*inputs.files, day],
    )
    rotor_model = inputs.rotor_model()
    console = Terminal(soft_wrap=True, quiet=json == STDOUT)
    holds_for = day_of_command(rotor_model.airframe, stated, console)
    aircraft = named_aircraft(inputs)
    table = made.fill_table(
        rotor_model,
        holds_for,
        speed=speed,
        limit=inputs.limit,
        rotor_lost=rotor_lost,
        temperatures_c=TEMPERATURES_C,
        altitudes=ALTITUDES,
        clearance=NO_FLIGHT if aircraft is None else aircraft.clearance(),
    )
    console.print(table.advice, style="bold")
    for sentence in made.conditions(table):
        console.print(f"  {sentence}")
    for state, volts in table.voltages.items() if table.has_table else ():
        console.print(_grid(table, state, volts, made.temperatures(table)))
    for path, text in ((out, made.html_text), (json, made.json_text)):
        if path == STDOUT:
            sys.stdout.write(text(table))
        elif path is not None:
            with whole_file(path) as draft:
                draft.write_text(text(table), encoding="utf-8")
            console.print(f"wrote {path}")


def _grid(table: FillTable, state: str, volts: float, heads: list[str]) -> Table:
    title = f"{say(f'battery {state}')}, {number(volts, 'V')}"
    rows = [(name, *cells) for name, cells in table.rows(state)]
    return grid((say("above the sea"), *heads), rows, title=title, left=())
