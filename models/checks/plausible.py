"""Compare a flight with an airframe in everything that both contain, to decide whether they match.

| compared | value in the flight | close | fits |
|---|---|---|---|
| vehicle | kind that it reports | | a multirotor, or not reported |
| clock | movement and turning over their rates times seconds | | 0.6 to 1.7 (motion_units.py) |
| motors | number of rotors that it reports | reported, and the airframe's | not reported |
| frame | FRAME_CLASS and FRAME_TYPE | | motors in the airframe's places and order |
| voltage | median in flight over nominal | 0.92 to 1.15 | 0.78 to 1.22 |
| | cells that the battery states | | nominal 3.5 to 3.9 V a cell |
| rotor speed | median over what the weight needs | 0.92 to 1.15 | 0.75 to 1.35 |
| rotor speed limit | s above 1.2 of the largest thrust | | under 3 s, or under 5 % of the flight |
| motor output | square root of its thrust over weight | 0.92 to 1.08 | 0.6 to 1.7 |
| outputs and speeds | thrust of the one over that of the other | | 2.6 standard errors |
| one ESC | speed of a rotor over that of the others at its output | | 0.75 to 1.33 |

Without measured speeds the outputs may also not lift surely more (2.6 standard errors) than the
gauge reports, because the gauge then calibrates them. Where no load is reported, rotor speed is
close only if the motor outputs agree with it within 8 %.
A value that does not fit contradicts, and no margin is claimed; an airframe that nobody gave is
recognised by the close values. A value that is apart, but by less, widens the margin's interval
(`output_evidence`): outputs with more thrust than weight or speeds, a battery that reads more than
a full one. Origin of the tolerances: a lithium cell of 3.7 V flies at 3.4 to 4.25 V, and 2.9 V (a
worn one, or of 3.6 V) to 4.5 V (4.35 V when full, its gauge 3 % off) bound what can be the same
number of cells. 3 kg unknown to the gauge of an empty sprayer of 21 kg raise rotor speed by
7 %, 8 % less thrust of every propeller by 4 %, air 20 K warmer than standard by 3.5 %: 15 %
together; lift of forward flight and cold air lower it by 8 %. A coefficient off by a third and a
rotor speed that a voltage fault distorts still fit. A falling or unloaded rotor passes its ceiling
by 10 % of speed, for moments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thrustmargin.models.checks.motion_units import motion_units
from thrustmargin.models.checks.output_evidence import (
    SURELY,
    OutputEvidence,
    output_evidence,
)
from thrustmargin.models.checks.speed_readings import FEWEST_ROWS, check_speed_scale
from thrustmargin.models.checks.voltage import (
    POSSIBLE_VOLTAGE,
    beyond_full,
    full_voltage,
    most_voltage,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import ceiling, utilisation
from thrustmargin.models.physics.motor_layouts import ardupilot_layout, bearings
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import SourceKind
from thrustmargin.models.vehicle_facts import StatedBattery, VehicleFacts, can_be_cells

Range = tuple[float, float]
CLOSE_VOLTAGE = (0.92, 1.15)
CLOSE_SPEED = (0.92, 1.15)
CLOSE_OUTPUT, POSSIBLE_OUTPUT = (0.92, 1.08), (0.6, 1.7)
#: Nominal V of a lithium cell: ion 3.6, polymer 3.7, high voltage 3.85.
NOMINAL_CELL = (3.5, 3.9)
#: Utilisation that no rotor can keep up, and the s and share of the flight that are tolerated.
IMPOSSIBLE_USE, MOMENT_S, MOMENT_SHARE = 1.2, 3.0, 0.05
#: deg by which an arm may stand elsewhere; the next arm of an octocopter is 45 away.
ARM_BEARING = 22.0
#: Checks that compare a flight with itself, whatever the aircraft is.
OF_ANY_AIRFRAME = ("clock", "one ESC")
#: ln of the speed of one rotor over that of the others at its output: propellers of one aircraft
#: differ by a few percent, pole counts by a seventh and more, and a third is no propeller.
ODD_SPEED = 0.29


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One quantity of a flight compared with the airframe, and its verdict."""

    check: str
    verdict: Literal["close", "fits", "apart", "contradicts", "unknown"]
    words: str  # value found, value of the airframe, and why they contradict
    brief: str = ""  # value found, in a few words


def comparisons(
    track: FlightTrack,
    airframe: Airframe,
    facts: VehicleFacts,
    parameters: Mapping[str, float],
) -> tuple[Comparison, ...]:
    """Compare a flight with an airframe by every test in the table of this module.

    Tests without data are omitted or "unknown". Values inferred with the airframe's help are
    excluded. `parameters` are the autopilot's, by name.
    """
    found: list[Comparison | None] = [_vehicle(track, facts), _clock(track)]
    found.append(motors := _motors(track, airframe, facts))
    if motors.verdict != "contradicts":
        if track.standard_errors:
            track = replace(track, **{c: track.measured(c) for c in track.standard_errors})
        found.append(_frame(airframe, parameters))
        outputs = output_evidence(track, airframe, parameters)
        found.append(_one_esc(track))
        found.append(_rotor_speed(track, airframe, outputs))
        found.append(voltage := _voltage(track, airframe, facts.battery))
        if (
            voltage.verdict != "contradicts"
        ):  # else the tests that use the voltage would repeat its contradiction
            found.append(_speed_limit(track, airframe))
            found.append(_output(track, airframe, outputs))
            found.append(_speeds_by_output(outputs, airframe))
            found += [_full_battery(track, airframe), _surplus_thrust(track, airframe, outputs)]
    return tuple(c for c in found if c is not None)


def recognition(found: tuple[Comparison, ...]) -> str:
    """List what matches the airframe, in words; empty if the flight is not recognised.

    Number of rotors, voltage, and rotor speed or else motor output must be close; nothing may
    contradict.
    """
    by_name = {c.check: c for c in found}
    strength = by_name.get("rotor speed")
    if strength is None or strength.verdict != "close":
        strength = by_name.get("motor output")
    needed = [by_name.get("motors"), by_name.get("voltage"), strength]
    if "vehicle" in by_name or any(c.verdict == "contradicts" for c in found):
        return ""
    if any(c is None or c.verdict != "close" for c in needed):
        return ""
    return ", ".join(c.brief for c in needed if c is not None)


def _vehicle(track: FlightTrack, facts: VehicleFacts) -> Comparison | None:
    """Compare the kind of vehicle; None if it is a multirotor or not reported."""
    if refusal := facts.refusal(track.name):
        return Comparison(check="vehicle", verdict="contradicts", words=refusal)
    if facts.kind != "quadplane":
        return None
    words = f"a quadplane by {facts.evidence}: it can be compared in hover alone"
    return Comparison(check="vehicle", verdict="fits", words=words)


def _clock(track: FlightTrack) -> Comparison | None:
    """Compare movement and turning in flight with their rates times the seconds of the log; None
    if they agree."""
    words = motion_units(track.rows(track.flying), by_table=False)
    return Comparison(check="clock", verdict="contradicts", words=words) if words else None


def _motors(track: FlightTrack, airframe: Airframe, facts: VehicleFacts) -> Comparison:
    """Compare the number of rotors that the vehicle reports, and that of the track, with the
    airframe's."""
    count, how = facts.rotor_count, facts.rotor_evidence
    if not count and track.rotor_count == airframe.rotor_count:
        words = (
            "nothing reports the number of rotors; "
            f"airframe {airframe.name} has {airframe.rotor_count}"
        )
        return Comparison(check="motors", verdict="fits", words=words)
    brief = f"{count} rotors by {how}" if count else f"{track.rotor_count} rotors in the flight"
    if facts.rotor_conflict:
        brief += f", but {facts.rotor_conflict}"
    same = (count or track.rotor_count) == track.rotor_count == airframe.rotor_count
    same = same and not facts.rotor_conflict
    return Comparison(
        check="motors",
        verdict="close" if same else "contradicts",
        words=f"{brief}; airframe {airframe.name} has {airframe.rotor_count}",
        brief=brief,
    )


def _frame(airframe: Airframe, parameters: Mapping[str, float]) -> Comparison | None:
    """Compare the arms' bearings by FRAME_CLASS and FRAME_TYPE; None if they are unknown or of
    another rotor count."""
    kind, shape = parameters.get("FRAME_CLASS", np.nan), parameters.get("FRAME_TYPE", np.nan)
    if not np.isfinite([kind, shape]).all():
        return None
    layout = ardupilot_layout(int(kind), int(shape))
    if layout is None or layout.rotor_count != airframe.rotor_count:
        return None
    places = airframe.rotor_position_frd[:, :2]
    turned = (bearings(places) - bearings(layout.place) + 180.0) % 360.0 - 180.0
    same = np.max(np.abs(turned)) <= ARM_BEARING
    words = f"FRAME_CLASS {kind:.0f} and FRAME_TYPE {shape:.0f} are {layout.name}"
    other = "as in" if same else "which puts the motors elsewhere than"
    return Comparison(
        check="frame",
        verdict="fits" if same else "contradicts",
        words=f"{words}, {other} airframe {airframe.name} ({airframe.layout})",
    )


def _voltage(track: FlightTrack, airframe: Airframe, battery: StatedBattery) -> Comparison:
    """Compare median voltage in flight, or the stated cells, with the nominal voltage."""
    volts = track.voltage[track.flying & (track.voltage > 0.0)]
    found = known_median(volts) if volts.size >= FEWEST_ROWS else np.nan
    each = airframe.nominal_voltage / battery.cells if battery.cells else np.nan
    # A stated cell count that the flight's own voltage excludes is ignored.
    if can_be_cells(battery.cells, found) and (each < NOMINAL_CELL[0] or each > NOMINAL_CELL[1]):
        words = (
            f"a battery of {battery.words}; the {airframe.nominal_voltage:.1f} V of airframe "
            f"{airframe.name} would be {each:.2f} V a cell"
        )
        return Comparison(check="voltage", verdict="contradicts", words=words)
    if not np.isfinite(found):
        return Comparison(check="voltage", verdict="unknown", words="no battery voltage in flight")
    share = found / airframe.nominal_voltage
    verdict = _verdict(share, share, CLOSE_VOLTAGE, POSSIBLE_VOLTAGE)
    words = (
        f"{found:.1f} V in flight, {round(100 * share, 1):g} % of the "
        f"{airframe.nominal_voltage:.1f} V of airframe {airframe.name}"
    )
    if verdict == "contradicts":
        low, high = POSSIBLE_VOLTAGE
        words += f"; the same battery stays within {100 * low:.0f} % to {100 * high:.0f} %"
    return Comparison(check="voltage", verdict=verdict, words=words, brief=f"{found:.1f} V")


def _full_battery(track: FlightTrack, airframe: Airframe) -> Comparison | None:
    """Report a voltage above that of a full battery; None without."""
    if not (beyond := beyond_full(track.voltage, airframe)):
        return None
    words = (
        f"{most_voltage(track.voltage, airframe):.1f} V at most, where a full battery of "
        f"{airframe.nominal_voltage:.1f} V has {full_voltage(airframe):.1f}: the voltmeter reads "
        f"{100 * beyond:.0f} % too much, or nominal_voltage is of other cells; margin and fill "
        "reach to what is left then"
    )
    return Comparison(check="full battery", verdict="apart", words=words)


def _surplus_thrust(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence
) -> Comparison | None:
    """Report surplus thrust: what motor outputs or rotor speeds show beyond rotor speeds or weight.

    The verdict is "apart": the intervals of margin and fill reach to the larger surplus. None
    without one.
    """
    outputs = replace(outputs, ceiling_high=0.0)
    beyond, by, than = outputs.share_beyond_speeds, "motor outputs show", "the rotor speeds"
    gauge = track.measured("tank_kg")[track.flying]
    if (tank_kg := gauge[gauge >= 0.0]).size:
        mass = airframe.empty_mass + known_median(tank_kg)
        if (share := outputs.share_beyond(mass)) > beyond:
            alone = outputs.more_than(mass) / mass < share
            beyond, than = share, "the weight"
            by = "rotor speeds show" if alone else by
    if not beyond > 0.0:
        return None
    words = (
        f"{by} {100 * beyond:.0f} % more thrust than {than}; margin and fill reach to that: check "
        "voltmeter, gauge and empty mass, and the airframe's largest rotor speed and its voltage"
    )
    return Comparison(check="thrust", verdict="apart", words=words)


def _rotor_speed(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence) -> Comparison:
    """Compare the rotor speeds with the speed that the weight needs."""
    scale = check_speed_scale(track, airframe)
    if scale.verdict == "unknown":
        return Comparison(check="rotor speed", verdict="unknown", words=scale.words)
    if scale.verdict != "rotor":
        return Comparison(check="rotor speed", verdict="contradicts", words=scale.words)
    speed = known_median(track.rotor_speed_rpm[track.flying])
    close = _verdict(scale.low, scale.high, CLOSE_SPEED, CLOSE_SPEED) != "contradicts"
    # Between an empty and a full tank fly many aircraft: without the load, outputs must agree too.
    known = bool((track.measured("tank_kg")[track.flying] >= 0.0).any())
    driven = float(np.exp(0.5 * outputs.over_speeds))  # as a ratio of speeds; NaN: not known
    alike = known or _verdict(driven, driven, CLOSE_OUTPUT, CLOSE_OUTPUT) == "close"
    words = scale.words
    if not close:
        words += ", but not closely"
    elif not alike:
        words += " of some load, but no tank level says which, and no motor outputs confirm them"
    return Comparison(
        check="rotor speed",
        verdict="close" if close and alike else "fits",
        words=words,
        brief=f"rotors at {speed:,.0f} rpm {_for_mass(track, airframe, scale.ratio)}",
    )


def _one_esc(track: FlightTrack) -> Comparison | None:
    """Report a rotor whose speed is far from the others' at its output, which no propeller
    explains; None without."""
    speed, output = np.abs(track.rotor_speed_rpm[track.flying]), track.throttle[track.flying]
    rows = (speed > 0.0).all(axis=1) & (output > 0.0).all(axis=1)
    if track.rotor_count < 3 or np.count_nonzero(rows) < FEWEST_ROWS:
        return None
    each = np.median(speed[rows] / output[rows], axis=0)
    ratio = each / np.median(each)
    odd = int(np.argmax(np.abs(np.log(ratio))))
    if not abs(np.log(ratio[odd])) > ODD_SPEED:
        return None
    words = (
        f"rotor {odd + 1} reads {ratio[odd]:.2f} times the speed that the others have at its "
        "output: check sensor and pole count of its ESC, or that the ESC is that motor's"
    )
    return Comparison(check="one ESC", verdict="apart", words=words)


def _speed_limit(track: FlightTrack, airframe: Airframe) -> Comparison | None:
    """Report rotor speeds that no rotor of the airframe can keep up; None without."""
    volts = track.voltage[track.flying & (track.voltage > 0.0)]
    battery = known_median(volts)  # median: a failing voltmeter must not look like a fast rotor
    limit = ceiling(airframe, airframe.reference_density, battery).max_rotor_speed_rpm
    with np.errstate(invalid="ignore"):
        use = np.nan_to_num(utilisation(track.rotor_speed_rpm, limit))
    beyond = use[track.flying] > IMPOSSIBLE_USE
    above = beyond.any(axis=1)
    step = known_median(np.diff(track.time_s)) if track.time_s.size > 1 else 0.0
    seconds = float(np.count_nonzero(above)) * step
    if not seconds > MOMENT_S or np.mean(above) < MOMENT_SHARE:
        return None
    fastest = float(np.nanmax(track.rotor_speed_rpm[track.flying]))
    of = np.flatnonzero(2 * np.count_nonzero(beyond, axis=0) > np.count_nonzero(above)) + 1
    which = f"rotor {of[0]}" if of.size == 1 else "a rotor"
    return Comparison(
        check="rotor speed limit",
        verdict="contradicts",
        words=(
            f"{which} turns at up to {fastest:,.0f} rpm, where airframe {airframe.name} reaches at "
            f"most {limit.item():,.0f} rpm at this voltage: {100 * use.max():.0f} % of its thrust "
            "would be "
            "in use"
        ),
    )


def _output(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence) -> Comparison | None:
    """Compare the thrust of the outputs, by the autopilot's curve and the airframe's ceiling,
    with the weight."""
    mass = outputs.lifted_kg
    if not np.isfinite(mass):
        return None
    gauge = track.measured("tank_kg")
    tank_kg = gauge[track.flying & (gauge >= 0.0)]
    known = tank_kg.size > 0
    tank = (known_median(tank_kg),) * 2 if known else (0.0, airframe.tank_capacity_kg)
    high, low = (float(np.sqrt(mass / (airframe.empty_mass + kg))) for kg in tank)
    output = known_median(track.throttle[track.flying])
    verdict = _verdict(low, high, CLOSE_OUTPUT, POSSIBLE_OUTPUT)
    # Most aircraft hover near half of their thrust: without the load that is no likeness.
    verdict = "fits" if verdict == "close" and not known else verdict
    brief = f"motor outputs of {100 * output:.0f} %"
    weighs = airframe.empty_mass + tank[1]
    words = f"{brief} would lift {mass:.3g} kg with the rotors of airframe {airframe.name}, "
    stated = track.source("tank_kg").kind in (SourceKind.STATED, SourceKind.AIRFRAME)
    by = " with the load that is stated" if stated else " by the gauge"
    words += f"which weighs {weighs:.3g} kg" + (by if known else " full")
    # Without speeds of its own the gauge sets what the outputs mean: then it must agree with them.
    alone = not np.isfinite(outputs.over_speeds)
    if alone and outputs.surely_more_than(weighs):
        verdict = "contradicts"
        wrong = "load" if stated else "gauge"
        words += f": {wrong}, empty mass or the airframe's largest rotor speed is wrong"
    brief += f" {_for_mass(track, airframe, np.sqrt(low * high))}"
    return Comparison(check="motor output", verdict=verdict, words=words, brief=brief)


def _speeds_by_output(outputs: OutputEvidence, airframe: Airframe) -> Comparison | None:
    """Compare the thrust of the outputs with that of the rotor speeds, independent of load and
    air."""
    if not np.isfinite(outputs.over_speeds):
        return None
    share = float(np.exp(outputs.over_speeds))
    words = f"motor outputs make {share:.2f} times the thrust of the rotor speeds"
    if not outputs.disagrees_with_speeds:
        return Comparison(check="outputs and speeds", verdict="fits", words=words)
    low, high = (float(np.exp(k * SURELY * outputs.error)) for k in (-1, 1))
    words += (
        f", where {low:.2f} to {high:.2f} is possible: the rotor speeds, the voltage or the "
        f"largest rotor speed of airframe {airframe.name} are wrong, and which is not known"
    )
    return Comparison(check="outputs and speeds", verdict="contradicts", words=words)


def _for_mass(track: FlightTrack, airframe: Airframe, ratio: float) -> str:
    """Return the mass and the deviation that go with a speed ratio, for people."""
    gauge = track.measured("tank_kg")
    tank_kg = gauge[track.flying & (gauge >= 0.0)]
    if not tank_kg.size:
        full = airframe.empty_mass + airframe.tank_capacity_kg
        return f"for {airframe.empty_mass:.0f} to {full:.0f} kg"
    mass = airframe.empty_mass + known_median(tank_kg)
    return f"for {mass:.0f} kg within {100 * max(abs(ratio - 1.0), 0.01):.0f} %"


def _verdict(
    low: float, high: float, close: Range, possible: Range
) -> Literal["close", "fits", "contradicts"]:
    """Return the verdict of a ratio that is known to lie between `low` and `high`."""
    if low <= close[1] and high >= close[0]:
        return "close"
    return "fits" if low <= possible[1] and high >= possible[0] else "contradicts"
