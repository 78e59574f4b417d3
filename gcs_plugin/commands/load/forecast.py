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

import numpy as np
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
    json_apart,
)
from thrustmargin.gcs_plugin.commands.shared.plan_source import pump_of, pump_rule_of
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.check_words import no_verdict_words, statement_words
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.mission.forecast.plan_forecast import PlanForecast
    from thrustmargin.mission.plan_items import MissionPlan
    from thrustmargin.mission.steps import PumpOutput
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.model.clearance import Clearance
    from thrustmargin.models.model.rotor_faults import FaultHistory
    from thrustmargin.models.model.rotor_model import RotorModel
    from thrustmargin.models.physics.day import Day
    from thrustmargin.models.physics.electric_power import FlightPower

PLANS = (".plan", ".mission", ".waypoints", ".txt")
AT_HOME = 30.0  # m from a plan's home within which a lift-off was there


def forecast(
    plan: Annotated[Positional[Path], tyro.conf.arg(metavar="PLAN|LOG")],
    *,
    fill: str | None = None,
    model: Path | None = None,
    whose: Known = ANY_KNOWN,
    airframe: str | None = None,
    parameters: Path | None = None,
    day: Path | None = None,
    air_temperature: float | None = None,
    altitude: float | None = None,
    pressure: float | None = None,
    wind: float | None = None,
    wind_from: float | None = None,
    gusts: float | None = None,
    flow: float | None = None,
    rate: float | None = None,
    swath: float | None = None,
    pump: str | None = None,
    dem: Path | None = None,
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
    and motors that were bad in its last flight. The exit code is no permission to fly: it is 1 only
    where the log is of another aircraft; scripts read `verdict.level` of --json.

    Example: thrustmargin forecast demo --fill 16 --flow 2.5

    Args:
        plan: Plan (.plan, .waypoints, .mission) or a log that holds the mission.
        fill: In the tank at take-off: kg, or litres as 16L. Needed, unless the aircraft has no
            tank.
        model: Rotor speed model file of this aircraft.
        whose: The known aircraft; see `thrustmargin learn`.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the model's.
        parameters: Parameter file of the autopilot (.param, .parm, .params); of a log, its own.
        day: File (.toml, .json) with the day: air_temperature_c, altitude, pressure_hpa, wind,
            gusts, battery_voltage, battery_capacity_ah, battery_resistance_mohm. Without it, and
            without an option, the log's, else the day last stated within 12 hours.
        air_temperature: °C at the field; where nothing says it 30.
        altitude: m of the field above the sea; without it that of the plan's home.
        pressure: hPa of the air at the field, not reduced to sea level; without it the standard of
            the altitude.
        wind: m/s of wind; without it that of the log, and where nothing says it 0.
        wind_from: ° where the wind comes from, 0 is north; without it the worst of all directions,
            or with the wind of a log that of the log.
        gusts: m/s of wind in gusts; they are named, and not flown.
        flow: L/min with the pump on, at the speed of the line.
        rate: L/ha, instead of --flow; needs --swath.
        swath: m between lines, for --rate and hectares.
        pump: What switches the pump in the plan: sprayer (DO_SPRAYER), servo:NUMBER:ON:OFF, or
            relay:NUMBER. Where the plan does not switch it: always (on from the first place to the
            last) or lines (on along parallel lines).
        dem: Heights of the ground (.asc in degrees, or .hgt), which heights above the ground then
            follow; without it the ground is level.
        voltage: V of the battery at rest; without it that before the flight of the log, else a
            full one.
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
    from thrustmargin.mission.terrain import read_terrain

    check_utilisation(max_utilisation)
    check_port(port)
    from thrustmargin.gcs_plugin.commands.shared.day_options import day_of_command, stated_day

    stated = stated_day(
        day,
        air_temperature=air_temperature,
        height=altitude,
        pressure=pressure,
        wind=wind,
        gusts=gusts,
        battery_voltage=voltage,
        battery_capacity_ah=capacity,
        battery_resistance=resistance,
    )
    for name, value, low, high, unit in (
        ("--wind-from", wind_from, -360.0, 360.0, "°"),
        ("--flow", flow, 0.0, 200.0, "L/min"),
        ("--rate", rate, 0.0, 2000.0, "L/ha"),
        ("--swath", swath, 0.1, 100.0, "m"),
    ):
        check_range(name, value, low, high, unit)
    if rate is not None and (swath is None or flow is not None):
        raise UsageError("--rate needs --swath, and goes without --flow")
    for path in out:
        kept, json = json_apart(path, json)
        out = out if kept else tuple(one for one in out if one != path)
    if refuse and lua is None:
        raise UsageError("--refuse is how the script of --lua behaves; give --lua FILE as well")
    outputs = [
        *(
            OutputFile(f"--{name}", path, endings=(f".{name}",))
            for name, path in (("json", json), ("csv", csv), ("lua", lua))
        ),
        *(OutputFile("--out", path, endings=(".html", ".htm", ".pdf")) for path in out),
    ]
    check_outputs(outputs, inputs=[plan, model, airframe, parameters, day, dem])
    if sorties is not None and not sorties.is_dir():
        raise DataError(f"no folder {sorties}; make it, or give another --sorties")
    found = read_plan(plan)  # a plan that is none is refused before the rest is loaded
    ground = None if dem is None else read_terrain(dem)
    from thrustmargin.gcs_plugin.commands.load.pump_question import (
        asked_pump_rule,
        never_switched,
    )
    from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs
    from thrustmargin.gcs_plugin.commands.shared.log_flights import named_aircraft
    from thrustmargin.mission.forecast import plan_forecast
    from thrustmargin.mission.forecast.battery import stated_capacity
    from thrustmargin.models.model.clearance import both
    from thrustmargin.models.physics.day import Day, DaySource, DayValue
    from thrustmargin.models.physics.electric_power import power_law
    from thrustmargin.models.physics.known_battery import KnownBattery

    inputs = Inputs(model=model, airframe=airframe, max_utilisation=max_utilisation, known=whose)
    rotor_model = inputs.rotor_model()
    craft = rotor_model.airframe
    liquid = craft.liquid_density
    output = pump_of(pump) if pump is not None and pump_rule_of(pump) is None else None
    kg = _fill_kg(fill, liquid, craft.tank_capacity_kg)
    before = _before(plan, rotor_model, given=inputs.given)
    found = _at_lift_off(found, before)
    if before.beyond_gauge_kg > 0.0:
        from thrustmargin.models.model.rotor_model import heavier_model

        rotor_model = heavier_model(rotor_model, before.beyond_gauge_kg)
    if before.power is not None:
        rotor_model = replace(rotor_model, power=power_law([before.power], rotor_model.power))
    known = before.parameters
    if parameters is not None:
        from thrustmargin.gcs_plugin.logs.parameter_file import read_parameters

        known = read_parameters(parameters)
    console = Terminal(soft_wrap=True, quiet=json == STDOUT)
    heard = DaySource.LOG if parameters is None else DaySource.OPTION
    by_parameters = Day(battery_capacity_ah=DayValue(stated_capacity(known), heard))
    by_plan = Day(height=DayValue(found.home[2], DaySource.PLAN))
    logged = () if before.day is None else (before.day,)
    aircraft = named_aircraft(inputs)
    earlier = KnownBattery() if aircraft is None else aircraft.battery_before()
    flown = DaySource.EARLIER
    by_flights = Day(
        battery_voltage=DayValue(earlier.rest_voltage, flown, earlier.rest_voltage_error),
        battery_resistance=DayValue(earlier.resistance, flown, earlier.resistance_error),
    )
    days = (*logged, by_parameters, by_plan, by_flights)
    holds_for = day_of_command(craft, stated, console, *days)
    windward = _or_nan(wind_from)
    if wind_from is None and holds_for.wind.source is DaySource.LOG:
        windward = before.wind_from_deg
    rule = pump_rule_of(pump)
    if rule is None and json != STDOUT and never_switched(found, output, known, craft):
        rule = asked_pump_rule(airframe)
    made = plan_forecast.forecast(
        found,
        rotor_model,
        plan_forecast.TakeOff(
            fill_kg=kg,
            wind_from_deg=windward,
            nose_deg=before.nose_deg,
            flow=_or_nan(flow) * liquid / 60.0,
            flow_per_metre=_or_nan(rate) * liquid * _or_nan(swath) / 1e4,
            swath=_or_nan(swath),
            known=holds_for,
        ),
        parameters=known,
        pump=output,
        pump_rule=rule,
        terrain=ground,
        limit=inputs.limit,
        faults=before.faults,
        other_order=before.other_order,
        experience=None if aircraft is None else aircraft.experience,
    )
    cleared = before.clearance
    if aircraft is not None:
        cleared = both(cleared, aircraft.clearance())
    made = plan_forecast.with_clearance(made, cleared)
    if before.beyond_gauge_kg > 0.0:
        hidden = {"hidden mass": (f"{before.beyond_gauge_kg:.1f}",)}
        made = replace(made, assumed={**hidden, **made.assumed})
    if before.unlike:
        made = replace(made, assumed={"unlike": (craft.title, before.unlike[0]), **made.assumed})
    elif before.unlike is None and not inputs.given:
        made = replace(made, assumed={"aircraft": (craft.title,), **made.assumed})
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

        gate = partial(gate_text, made, fill_card(made), plan=plan.name, refuse=refuse)
        files.append((lua, gate))
    for path, content in files:
        made_of = content()
        with whole_file(path) as draft:
            draft.write_bytes(made_of if isinstance(made_of, bytes) else made_of.encode())
        console.print(f"wrote {path}")
    for path in [] if sorties is None else _write_sorties(made, plan, sorties, output):
        console.print(f"wrote {path}")
    if view:
        from thrustmargin.gcs_plugin.view.replay_view import planned_view, run_replay

        run_replay(planned_view(made, port=port), browser=browser)
    return 1 if before.unlike else 0


def _write_sorties(
    made: PlanForecast, plan: Path, folder: Path, pump: PumpOutput | None
) -> list[Path]:
    """Write a plan file for each sortie of the forecast into `folder` and return the paths.

    The names are those of `plan` with -sortie-1 and so on; `pump` is the output that switches the
    pump. Raises DataError, and writes nothing, if one of the files exists.
    """
    from thrustmargin.mission.forecast.plan_forecast import sortie_plans
    from thrustmargin.mission.plan import write_plan

    made_plans = sortie_plans(made, pump=pump)
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
    for line in words.before_words(made):
        console.print(line)
    console.print(words.weakest_words(made.weakest))
    for line in words.place_words(made):
        console.print(line)
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


def _fill_kg(words: str | None, liquid: float, capacity_kg: float) -> float:
    """Return the fill, kg, that `words` state: kg, or litres of density `liquid`, kg/L.

    None states nothing, which is 0 for an aircraft without a tank (`capacity_kg` 0). Raise
    UsageError where it is none, no amount, or more than the tank holds.
    """
    if words is None:
        if capacity_kg > 0.0:
            raise UsageError("what is in the tank at take-off? add --fill KG, or litres as 16L")
        return 0.0
    found = re.fullmatch(r"\s*(\d{1,4}(?:[.,]\d+)?)\s*(kg|l)?\s*", words, re.IGNORECASE)
    if not found:
        raise UsageError(f"--fill {words!r:.40} is no amount; give kg as 16, or litres as 16L")
    kg = float(found[1].replace(",", ".")) * (liquid if (found[2] or "").lower() == "l" else 1.0)
    if kg > 0.0 and capacity_kg <= 0.0:
        raise UsageError(
            f"--fill {words}: the airframe has no tank; give --fill 0, or tank_volume_l in its file"
        )
    if kg > capacity_kg + 1e-6:
        raise UsageError(f"--fill {words} is more than the tank holds ({capacity_kg:g} kg)")
    return kg


@dataclass(frozen=True, slots=True, kw_only=True)
class _FlightBefore:
    """Results of the flights in the log that contains the plan; all but two are those of the last
    flight."""

    clearance: Clearance  # of all its flights
    faults: FaultHistory | None = None  # of the flight that grounds the aircraft
    parameters: dict[str, float] = field(default_factory=dict)
    other_order: bool = False  # its motors were not in the order of the airframe
    #: Why it was no flight of this aircraft; empty where it was one, None without a flight.
    unlike: tuple[str, ...] | None = None
    day: Day | None = None  # its air and its battery before it took off, and its wind
    wind_from_deg: float = math.nan  # where that wind came from
    nose_deg: float = math.nan  # its heading before it took off
    beyond_gauge_kg: float = 0.0  # that hover thrust showed beyond the reported load
    #: Where it lifted off: degrees, degrees, m AMSL; None where the log does not say.
    lift_off: tuple[float, float, float] | None = None
    power: FlightPower | None = None  # by its current; None where it has none


def _before(plan: Path, model: RotorModel, *, given: bool) -> _FlightBefore:
    """Return what the flights in a log mean for the next one: clearance, faults, day, parameters.

    `plan` is that log; a plan file has no flights, and gives an empty result. `given`: the user
    chose `model`. For a log without a readable flight the clearance only says that the flight was
    not seen.
    """
    from thrustmargin.models.model.clearance import NO_FLIGHT, NOT_SEEN, clearance

    if plan.suffix.lower() in PLANS:
        return _FlightBefore(clearance=NO_FLIGHT)
    from thrustmargin.gcs_plugin.commands.shared.log_flights import flight_key
    from thrustmargin.gcs_plugin.logs.log_answer import answer_log, matched_flights
    from thrustmargin.mission.plan_tracking.stretches import yaw_before
    from thrustmargin.models.model.analysis import analyse
    from thrustmargin.models.model.flight_day import day_before_take_off, flight_wind
    from thrustmargin.models.model.flight_lessons import flight_power

    try:
        flown = matched_flights(plan, model, given=given)
    except LogError:
        return _FlightBefore(clearance=NOT_SEEN)  # it still holds its mission
    analyses = [
        analyse(log.track, model, airframe_match=airframe_match) for log, airframe_match in flown
    ]
    answers = [
        answer_log(log, analysis, 0.5) for (log, _), analysis in zip(flown, analyses, strict=True)
    ]
    cleared = clearance([one.advice for one in answers])
    (log, airframe_match), analysis, answer = flown[-1], analyses[-1], answers[-1]
    advice, (wind, from_deg) = answer.advice, flight_wind(answer.whole.track)
    other_order = not advice.rotor_names  # which rotor it was is not known
    bad = cleared.flight or advice
    which = () if bad.rotor_names else tuple(range(bad.rotor_count))
    found = tuple(replace(e.fault, rotors=which or e.fault.rotors) for e in bad.faults)
    trusted = cleared.level is None and not advice.faults
    return _FlightBefore(
        clearance=replace(cleared, unrecognised=bool(airframe_match.unlike)),
        parameters=dict(log.parameters),
        faults=[(0.0, found)] if found else None,
        other_order=other_order,
        unlike=(statement_words(airframe_match.unlike),)
        if airframe_match.unlike
        else tuple(no_verdict_words(airframe_match)),
        day=replace(day_before_take_off(answer.whole), wind=wind),
        wind_from_deg=from_deg,
        nose_deg=math.degrees(yaw_before(log.track)),
        beyond_gauge_kg=advice.fill.beyond_gauge_kg,
        lift_off=_lift_off(log.track),
        power=flight_power(analysis, flight_key(log)) if trusted else None,
    )


def _lift_off(track: FlightTrack) -> tuple[float, float, float] | None:
    """Return latitude, longitude, degrees, and height, m AMSL, of the first row in flight with a
    position; None without one."""
    known = track.flying & np.isfinite(track.position_ned).all(axis=1)
    if track.origin is None or not known.any():
        return None
    latitude, longitude, altitude = track.origin.geodetic(track.position_ned[np.argmax(known)])
    return (float(latitude), float(longitude), float(altitude))


def _at_lift_off(plan: MissionPlan, before: _FlightBefore) -> MissionPlan:
    """Return the plan with home's altitude replaced by that of the last lift-off.

    Unchanged if there was none, or if it was not within AT_HOME m of home.
    """
    import pymap3d

    from thrustmargin.mission.plan_items import with_home_height

    if before.lift_off is None:
        return plan
    latitude, longitude, altitude = before.lift_off
    east, north, _ = pymap3d.geodetic2enu(latitude, longitude, 0.0, *plan.home[:2], 0.0)
    at_home = math.hypot(float(east), float(north)) <= AT_HOME
    return with_home_height(plan, altitude) if at_home else plan
