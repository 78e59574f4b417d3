"""`thrustmargin forecast`: may a plan be flown with this fill, before take-off."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from thrustmargin.gcs_plugin.commands.shared.inputs import ANY_KNOWN, Known, Share
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    UsageError,
    check_outputs,
    check_port,
    check_range,
    check_utilisation,
    check_voltage,
)
from thrustmargin.gcs_plugin.commands.shared.plan_source import pump_of
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs
    from thrustmargin.gcs_plugin.store.hangar import KnownAircraft
    from thrustmargin.mission.forecast.battery import FlightBattery
    from thrustmargin.mission.forecast.plan_forecast import PlanForecast
    from thrustmargin.models.model.model_misfit import Caveat
    from thrustmargin.models.model.rotor_faults import FaultHistory
    from thrustmargin.models.model.rotor_model import RotorModel
    from thrustmargin.models.physics.airframe import Airframe
    from thrustmargin.models.physics.known_battery import KnownBattery
    from thrustmargin.models.physics.power import FlightPower

PLANS = (".plan", ".mission", ".waypoints", ".txt")
ZERO_CELSIUS = 273.15


def forecast(
    plan: Annotated[Positional[Path], tyro.conf.arg(metavar="PLAN|LOG")],
    *,
    fill: str,
    model: Path | None = None,
    whose: Known = ANY_KNOWN,
    airframe: str | None = None,
    parameters: Path | None = None,
    air_temperature: float | None = None,
    altitude: float | None = None,
    pressure: float | None = None,
    wind: float = 0.0,
    wind_from: float | None = None,
    flow: float | None = None,
    rate: float | None = None,
    swath: float | None = None,
    pump: str | None = None,
    voltage: float | None = None,
    capacity: float | None = None,
    resistance: float | None = None,
    max_utilisation: Share = 0.5,
    out: UseAppendAction[tuple[Path, ...]] = (),
    json: Path | None = None,
    csv: Path | None = None,
    sorties: Path | None = None,
    view: bool = False,
    port: int = 8080,
    browser: bool = True,
    lua: Path | None = None,
    refuse: bool = False,
) -> int:
    """Say before take-off whether a plan can be flown with a fill, and where it is weakest.

    The plan is flown in time by the autopilot's own limits: legs, turns at line ends, climbs, wind,
    the tank and the voltage falling. Of a log its mission and parameters are taken, and the rotors
    and motors that were bad in its last flight.

    Example: thrustmargin forecast demo --fill 16 --flow 2.5

    Args:
        plan: Plan (.plan, .waypoints, .mission) or a log that holds the mission.
        fill: In the tank at take-off: kg, or litres as 16L.
        model: Rotor speed model file of this aircraft.
        whose: The known aircraft; see `thrustmargin learn`.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the model's.
        parameters: Parameter file of the autopilot (.param, .parm, .params); of a log, its own.
        air_temperature: °C at the field; without it that of the standard atmosphere.
        altitude: m of the field above the sea; without it that of the plan's home.
        pressure: hPa of the air at the field, not reduced to sea level; without it the standard of
            the altitude.
        wind: m/s of wind.
        wind_from: ° where the wind comes from, 0 is north; without it the worst of all directions.
        flow: L/min with the pump on, at the speed of the line.
        rate: L/ha, instead of --flow; needs --swath.
        swath: m between lines, for --rate and hectares.
        pump: What switches the pump: sprayer (DO_SPRAYER), servo:NUMBER:ON:OFF, or relay:NUMBER.
        voltage: V of the battery at rest; without it a full one.
        capacity: Ah of the battery; without it that of the parameters.
        resistance: mOhm of the battery.
        max_utilisation: Largest share of a rotor's maximum thrust that may last.
        out: Page to write, to look at (.html) or to print (.pdf); may be given again.
        json: Write the numbers as JSON to this file (.json); - is standard output, and nothing
            else.
        csv: Write ten rows a second of the flight to this file (.csv).
        sorties: Folder to write one .plan for each sortie into.
        view: Show the planned flight in 3D on a page of this computer, as `replay` does; Ctrl-C
            ends it.
        port: Port of that page.
        browser: Open that page in the browser.
        lua: Write a script for the vehicle (.lua, ArduPilot) that warns before arming with more
            than air and battery of that moment carry.
        refuse: With --lua: the script refuses to arm instead of warning.
    """
    from thrustmargin.gcs_plugin.commands.shared.plan_source import read_plan

    check_utilisation(max_utilisation)
    check_port(port)
    for name, value, low, high, unit in (
        ("--air-temperature", air_temperature, -60.0, 60.0, "°C"),
        ("--altitude", altitude, -430.0, 9000.0, "m"),
        ("--pressure", pressure, 300.0, 1100.0, "hPa"),
        ("--wind", wind, 0.0, 60.0, "m/s"),
        ("--wind-from", wind_from, -360.0, 360.0, "°"),
        ("--flow", flow, 0.0, 200.0, "L/min"),
        ("--rate", rate, 0.0, 2000.0, "L/ha"),
        ("--swath", swath, 0.1, 100.0, "m"),
        ("--voltage", voltage, 1.0, 1000.0, "V"),
        ("--capacity", capacity, 0.1, 1000.0, "Ah"),
        ("--resistance", resistance, 0.0, 1000.0, "mOhm"),
    ):
        check_range(name, value, low, high, unit)
    if rate is not None and (swath is None or flow is not None):
        raise UsageError("--rate needs --swath, and goes without --flow")
    if refuse and lua is None:
        raise UsageError("--refuse is how the script of --lua behaves; give --lua FILE as well")
    outputs = [
        *(
            OutputFile(f"--{name}", path, endings=(f".{name}",))
            for name, path in (("json", json), ("csv", csv), ("lua", lua))
        ),
        *(OutputFile("--out", path, endings=(".html", ".htm", ".pdf")) for path in out),
    ]
    check_outputs(outputs, inputs=[plan, model, airframe, parameters])
    if sorties is not None and not sorties.is_dir():
        raise DataError(f"no folder {sorties}; make it, or give another --sorties")
    found = read_plan(plan)  # a plan that is none is refused before the rest is loaded
    from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs
    from thrustmargin.mission.forecast import plan_forecast
    from thrustmargin.models.physics.known_battery import KnownBattery
    from thrustmargin.models.physics.power import power_law

    inputs = Inputs(model=model, airframe=airframe, max_utilisation=max_utilisation, known=whose)
    rotor_model = inputs.rotor_model()
    craft = rotor_model.airframe
    liquid = craft.liquid_density
    kg = _fill_kg(fill, liquid, craft.tank_capacity_kg)
    before = _before(plan, rotor_model, given=inputs.given)
    if before.beyond_gauge_kg > 0.0:
        from thrustmargin.models.model.rotor_model import heavier_model

        rotor_model = heavier_model(rotor_model, before.beyond_gauge_kg)
    if before.power is not None:
        rotor_model = replace(rotor_model, power=power_law([before.power], rotor_model.power))
    known = before.parameters
    if parameters is not None:
        from thrustmargin.gcs_plugin.logs.parameter_file import read_parameters

        known = read_parameters(parameters)
    aircraft = _known_aircraft(inputs)
    earlier = KnownBattery() if aircraft is None else aircraft.battery_before()
    battery = _battery(known, voltage, capacity, resistance, craft, earlier)
    made = plan_forecast.forecast(
        found,
        rotor_model,
        plan_forecast.TakeOff(
            fill_kg=kg,
            air_temperature=_or_nan(air_temperature) + ZERO_CELSIUS,
            altitude=_or_nan(altitude),
            pressure=100.0 * _or_nan(pressure),
            wind=wind,
            wind_from_deg=_or_nan(wind_from),
            flow=_or_nan(flow) * liquid / 60.0,
            flow_per_metre=_or_nan(rate) * liquid * _or_nan(swath) / 1e4,
            swath=_or_nan(swath),
            battery=battery,
        ),
        parameters=known,
        pump=None if pump is None else pump_of(pump),
        limit=inputs.limit,
        faults=before.faults,
        other_order=before.other_order,
        experience=None if aircraft is None else aircraft.experience_before(),
    )
    made = replace(made, caveats=before.caveats)
    if voltage is None and math.isfinite(earlier.rest_voltage):
        usual = {"earlier battery": (f"{earlier.rest_voltage:.1f}",)}
        made = replace(made, assumed={**usual, **made.assumed})
    if before.beyond_gauge_kg > 0.0:
        hidden = {"hidden mass": (f"{before.beyond_gauge_kg:.1f}",)}
        made = replace(made, assumed={**hidden, **made.assumed})
    if before.unlike:
        made = replace(made, assumed={"unlike": (craft.title, before.unlike[0]), **made.assumed})
    elif before.unlike is None and not inputs.given:
        made = replace(made, assumed={"aircraft": (craft.title,), **made.assumed})
    console = Terminal(soft_wrap=True, quiet=json == STDOUT)
    _show(made, console)
    files: list[tuple[Path, Callable[[], str | bytes]]] = []
    if out:
        from thrustmargin.gcs_plugin.reports.forecast.forecast_page import html_text, pdf_bytes

        pages = ((path, pdf_bytes if path.suffix.lower() == ".pdf" else html_text) for path in out)
        files += [(path, partial(page, made, plan.name)) for path, page in pages]
    if json is not None:
        from thrustmargin.gcs_plugin.reports.forecast.forecast_page import json_text

        if json == STDOUT:
            sys.stdout.write(json_text(made))
        else:
            files.append((json, lambda: json_text(made)))
    if csv is not None:
        from thrustmargin.gcs_plugin.reports.forecast.forecast_page import csv_text

        files.append((csv, lambda: csv_text(made)))
    if lua is not None:
        from thrustmargin.gcs_plugin.reports.forecast.forecast_page import fill_card, gate_text

        card = fill_card(made, battery)
        air = _or_nan(air_temperature) + ZERO_CELSIUS
        gate = partial(gate_text, made, card, plan=plan.name, refuse=refuse, air_temperature=air)
        files.append((lua, gate))
    for path, content in files:
        made_of = content()
        with whole_file(path) as draft:
            draft.write_bytes(made_of if isinstance(made_of, bytes) else made_of.encode())
        console.print(f"wrote {path}")
    for path in [] if sorties is None else _write_sorties(made, plan, sorties, pump):
        console.print(f"wrote {path}")
    if view:
        from thrustmargin.gcs_plugin.view.replay_view import planned_view, run_replay

        run_replay(planned_view(made, port=port), browser=browser)
    return 1 if before.unlike else 0


def _write_sorties(made: PlanForecast, plan: Path, folder: Path, pump: str | None) -> list[Path]:
    """Write one .plan for each sortie, none of which replaces the plan that was read."""
    from thrustmargin.mission.forecast.plan_forecast import sortie_plans
    from thrustmargin.mission.plan import write_plan

    made_plans = sortie_plans(made, pump=None if pump is None else pump_of(pump))
    paths = [
        folder / f"{plan.stem}-sortie-{number}.plan" for number in range(1, len(made_plans) + 1)
    ]
    there = next((path for path in paths if path.exists()), None)
    if there is not None:
        raise DataError(f"{there} is already there; give another folder with --sorties")
    for path, one in zip(paths, made_plans, strict=True):
        write_plan(one, path)
    return paths


def _show(made: PlanForecast, console: Terminal) -> None:
    from thrustmargin.gcs_plugin.wording import forecast_words as words

    for line in words.plan_faults(made):
        console.print(line)
    console.print(words.verdict(made), style="bold")
    console.print(words.weakest_words(made.weakest))
    console.print(words.fill_words(made))
    console.print(words.survivable_words(made))
    for line in (
        *words.sortie_words(made),
        *words.power_words(made),
        *words.as_flown_words(made),
        words.way_back_words(made),
    ):
        console.print(line)
    console.print(f"{say('Assumed')}:")
    for line in words.assumed_words(made):
        console.print(f"  {line}")


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _fill_kg(words: str, liquid: float, capacity_kg: float) -> float:
    found = re.fullmatch(r"\s*(\d{1,4}(?:\.\d+)?)\s*(kg|l)?\s*", words, re.IGNORECASE)
    if not found:
        raise UsageError(f"--fill {words!r:.40} is no amount; give kg as 16, or litres as 16L")
    kg = float(found[1]) * (liquid if (found[2] or "").lower() == "l" else 1.0)
    if kg > capacity_kg + 1e-6:
        raise UsageError(f"--fill {words} is more than the tank holds ({capacity_kg:g} kg)")
    return kg


@dataclass(frozen=True, slots=True, kw_only=True)
class _FlightBefore:
    """The results of the last flight in the log that a plan is in."""

    parameters: dict[str, float] = field(default_factory=dict)
    faults: FaultHistory | None = None
    other_order: bool = False  # its motors were not in the order of the airframe
    #: Why it was no flight of this aircraft; empty where it was one, None without a flight.
    unlike: tuple[str, ...] | None = None
    caveats: tuple[Caveat, ...] = ()
    beyond_gauge_kg: float = 0.0  # that hover thrust showed beyond the reported load
    power: FlightPower | None = None  # by its current; None where it has none


def _before(plan: Path, model: RotorModel, *, given: bool) -> _FlightBefore:
    if plan.suffix.lower() in PLANS:
        return _FlightBefore()
    from thrustmargin.gcs_plugin.commands.shared.inputs import read_flights
    from thrustmargin.gcs_plugin.commands.shared.known import flight_key
    from thrustmargin.gcs_plugin.logs.log_answer import answer_log
    from thrustmargin.models.model.analysis import analyse
    from thrustmargin.models.model.flight_power import flight_power

    try:
        log, claim = read_flights(plan, model, given=given)[-1]
    except LogError:
        return _FlightBefore()  # it still holds its mission; the defaults are listed
    analysis = analyse(log.track, model, claim=claim)
    advice = answer_log(log, analysis, 0.5).made.advice
    other_order = not advice.rotor_names  # which rotor it was is not known
    which = tuple(range(advice.rotor_count)) if other_order else ()
    found = tuple(replace(e.fault, rotors=which or e.fault.rotors) for e in advice.faults)
    return _FlightBefore(
        parameters=dict(log.parameters),
        faults=[(0.0, found)] if found else None,
        other_order=other_order,
        unlike=(claim.unlike,) if claim.unlike else claim.withheld,
        caveats=advice.caveats,
        beyond_gauge_kg=advice.fill.beyond_gauge_kg,
        power=None if advice.withheld or advice.faults else flight_power(analysis, flight_key(log)),
    )


def _battery(
    known: dict[str, float],
    voltage: float | None,
    capacity: float | None,
    resistance: float | None,
    craft: Airframe,
    earlier: KnownBattery,
) -> FlightBattery:
    """Return the battery by the options, else by the parameters and by earlier flights of the
    aircraft. Raises UsageError for an impossible voltage.
    """
    from thrustmargin.mission.forecast.battery import FlightBattery, stated_capacity

    if voltage is not None:
        check_voltage(voltage, craft)
    return FlightBattery(
        voltage=earlier.rest_voltage if voltage is None else voltage,
        voltage_error=earlier.rest_voltage_error if voltage is None else 0.0,
        capacity_ah=stated_capacity(known) if capacity is None else capacity,
        resistance=earlier.resistance if resistance is None else resistance / 1e3,
        resistance_error=earlier.resistance_error if resistance is None else 0.0,
    )


def _known_aircraft(inputs: Inputs) -> KnownAircraft | None:
    """Return the known aircraft that is named; None without one."""
    if inputs.known.aircraft is None or inputs.by_file:
        return None
    from thrustmargin.gcs_plugin.store.hangar import open_hangar

    return open_hangar(inputs.known.hangar).load(inputs.known.aircraft)
