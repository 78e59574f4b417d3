"""Compare a flight with an airframe in everything that both contain, to decide whether they match.

Each quantity is a `Comparison`; `LIMITS` is the one table of the values that are close and of
those that fit. Without measured speeds the outputs may also not lift surely more (2.6 standard
errors) than the gauge reports, because the gauge then calibrates them. Where no load is reported,
rotor speed is close only if the motor outputs agree with it within 8 %.
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
from math import inf, isnan
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from thrustmargin.models.checks.motion_units import motion_units
from thrustmargin.models.checks.output_evidence import (
    SURELY,
    OutputEvidence,
    output_evidence,
)
from thrustmargin.models.checks.speed_readings import (
    FEWEST_ROWS,
    USUAL_RATIO,
    check_speed_scale,
)
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
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import (
    StatedBattery,
    VehicleFacts,
    can_be_cells,
    rotors_reported,
)

Range = tuple[float, float]
Verdict = Literal["close", "fits", "apart", "contradicts", "unknown"]
CLOSE_OUTPUT = (0.92, 1.08)
#: Nominal V of a lithium cell: ion 3.6, polymer 3.7, high voltage 3.85.
NOMINAL_CELL = (3.5, 3.9)
#: Utilisation that no rotor can keep up, and the s and share of the flight that are tolerated.
IMPOSSIBLE_USE, MOMENT_S, MOMENT_SHARE = 1.2, 3.0, 0.05
#: Checks that compare a flight with itself, whatever the aircraft is.
OF_ANY_AIRFRAME = ("clock", "one ESC")


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Ranges of a quantity that are possible and close for an airframe, and the verdict beyond
    them."""

    possible: Range
    close: Range | None = None  # None: no value is a likeness
    beyond: Literal["apart", "contradicts"] = "contradicts"


_EQUAL = (0.0, 0.0)
#: The one table of what is compared. Counts and kinds are differences from the airframe, others
#: ratios to it, if nothing else is stated.
LIMITS: Mapping[str, Limits] = MappingProxyType(
    {
        "vehicle": Limits(possible=_EQUAL),
        "clock": Limits(possible=_EQUAL),
        "motors": Limits(possible=_EQUAL, close=_EQUAL),
        # deg by which an arm is at another bearing; the next arm of an octocopter is 45 away.
        "frame": Limits(possible=(0.0, 22.0)),
        "voltage": Limits(possible=POSSIBLE_VOLTAGE, close=(0.92, 1.15)),
        "rotor speed": Limits(possible=USUAL_RATIO, close=(0.92, 1.15)),
        # s beyond IMPOSSIBLE_USE
        "rotor speed limit": Limits(possible=(0.0, MOMENT_S)),
        "motor output": Limits(possible=(0.6, 1.7), close=CLOSE_OUTPUT),
        # Standard errors of ln thrust.
        "outputs and speeds": Limits(possible=(-SURELY, SURELY)),
        # ln of the speed of one rotor over that of the others at its output: propellers of one
        # aircraft differ by a few percent, pole counts by a seventh and more, and a third is no
        # propeller.
        "one ESC": Limits(possible=(-0.29, 0.29), beyond="apart"),
        "full battery": Limits(possible=_EQUAL, beyond="apart"),
        "thrust": Limits(possible=_EQUAL, beyond="apart"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Comparison of one quantity of a flight with the airframe; its value lies in `low` to
    `high`."""

    check: str
    low: float  # NaN: not known
    high: float
    limits: Limits
    found: Statement
    brief: Statement | None = None  # the value found, in short

    @property
    def verdict(self) -> Verdict:
        """Return the verdict on the value, by its limits."""
        if isnan(self.low):
            return "unknown"
        if not self._within(self.limits.possible):
            return self.limits.beyond
        close = self.limits.close is not None and self._within(self.limits.close)
        return "close" if close else "fits"

    def _within(self, limits: Range) -> bool:
        return self.low <= limits[1] and self.high >= limits[0]


def _compared(
    check: str,
    value: float | Range,
    found: Statement,
    *,
    brief: Statement | None = None,
    **limits: Any,
) -> Comparison:
    """Build the result of the comparison `check`, with the limits of that name in LIMITS.

    `value` is the compared number, or the interval (low, high) in which it is; the limits decide
    the verdict. `found` states the result, `brief` (or None) the same in short; `limits` are fields
    of these limits to replace.
    """
    low, high = value if isinstance(value, tuple) else (value, value)
    used = replace(LIMITS[check], **limits)
    return Comparison(check=check, low=low, high=high, limits=used, found=found, brief=brief)


def comparisons(
    track: FlightTrack,
    airframe: Airframe,
    facts: VehicleFacts,
    parameters: Mapping[str, float],
) -> tuple[Comparison, ...]:
    """Compare a flight with an airframe by the tests of this module, in a fixed order.

    A contradiction ends it where later tests would only repeat it: after a contradicting motor
    count no other test follows, after a contradicting voltage none that uses the voltage. Tests
    without data are omitted or "unknown". Values inferred with the airframe's help are excluded.
    `parameters` are the autopilot's, by name.
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


def recognition(found: tuple[Comparison, ...]) -> tuple[Statement, ...]:
    """Return short statements of what matches the airframe; empty if the flight is not recognised.

    Number of rotors, voltage, and rotor speed or else motor output must be close; nothing may
    contradict. Not recognised either is a vehicle whose kind was compared (one that is no
    multirotor).
    """
    by_name = {c.check: c for c in found}
    strength = by_name.get("rotor speed")
    if strength is None or strength.verdict != "close":
        strength = by_name.get("motor output")
    needed = [by_name.get("motors"), by_name.get("voltage"), strength]
    if "vehicle" in by_name or any(c.verdict == "contradicts" for c in found):
        return ()
    if any(c is None or c.verdict != "close" for c in needed):
        return ()
    return tuple(c.brief for c in needed if c is not None and c.brief is not None)


def _vehicle(track: FlightTrack, facts: VehicleFacts) -> Comparison | None:
    """Compare the kind of vehicle; None if it is a multirotor or not reported."""
    if refusal := facts.refusal(track.name):
        return _compared("vehicle", 1.0, refusal)
    if facts.kind != "quadplane":
        return None
    return _compared("vehicle", 0.0, state("quadplane", evidence=facts.evidence))


def _clock(track: FlightTrack) -> Comparison | None:
    """Compare movement and turning in flight with their rates times the seconds of the log; None
    if they agree."""
    wrong = motion_units(track.rows(track.flying), by_table=False)
    return _compared("clock", 1.0, wrong) if wrong else None


def _motors(track: FlightTrack, airframe: Airframe, facts: VehicleFacts) -> Comparison:
    """Compare the airframe's number of rotors with the number that the vehicle reports and the
    number in the track.

    The compared value is the larger difference; infinite if the vehicle's own reports conflict. If
    the vehicle reports none and the track agrees, the result is only that rotors are not reported.
    """
    own = {"airframe": airframe.name, "own": airframe.rotor_count}
    if not facts.rotor_count and track.rotor_count == airframe.rotor_count:
        return _compared("motors", 0.0, state("rotors not reported", **own), close=None)
    brief = state("rotors in flight", count=track.rotor_count)
    if facts.rotor_count:
        brief = rotors_reported(facts)
    elif facts.rotor_conflict:
        brief = state(brief.kind, "but", count=track.rotor_count, conflict=facts.rotor_conflict)
    counts = (facts.rotor_count or track.rotor_count, track.rotor_count)
    apart = max(abs(count - airframe.rotor_count) for count in counts)
    # Two numbers of rotors that contradict each other are no number.
    apart = inf if facts.rotor_conflict else float(apart)
    return _compared("motors", apart, state("rotors", of=brief, **own), brief=brief)


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
    apart = float(np.max(np.abs(turned)))
    found = state(
        "frame alike" if apart <= LIMITS["frame"].possible[1] else "frame other",
        frame_class=kind,
        frame_type=shape,
        layout=layout.name,
        airframe=airframe.name,
        own=airframe.layout,
    )
    return _compared("frame", apart, found)


def _voltage(track: FlightTrack, airframe: Airframe, battery: StatedBattery) -> Comparison:
    """Compare the median voltage in flight with the airframe's nominal voltage, as their ratio.

    If the vehicle states a number of cells that its voltage allows and the nominal voltage does
    not, the nominal voltage of one cell, V, is compared instead. NaN with fewer than FEWEST_ROWS
    voltages.
    """
    volts = track.voltage[track.flying & (track.voltage > 0.0)]
    found = known_median(volts) if volts.size >= FEWEST_ROWS else np.nan
    each = airframe.nominal_voltage / battery.cells if battery.cells else np.nan
    own = {"nominal": airframe.nominal_voltage, "airframe": airframe.name}
    # A stated cell count that the flight's own voltage excludes is ignored.
    low, high = NOMINAL_CELL
    if can_be_cells(battery.cells, found) and (each < low or each > high):
        words = state("cells", battery=battery.statement, each=each, **own)
        return _compared("voltage", each, words, possible=NOMINAL_CELL)
    if not np.isfinite(found):
        return _compared("voltage", np.nan, state("no voltage"))
    share = found / airframe.nominal_voltage
    low, high = (100.0 * end for end in POSSIBLE_VOLTAGE)
    ends = {"percent": round(100.0 * share, 1), "low": low, "high": high}
    words = state("voltage", volts=found, **ends, **own)
    made = _compared("voltage", share, words, brief=state("volts", volts=found))
    if made.verdict != "contradicts":
        return made
    return replace(made, found=replace(words, clauses=("voltage beyond",)))


def _full_battery(track: FlightTrack, airframe: Airframe) -> Comparison | None:
    """Report a voltage above that of a full battery; None if it is not above."""
    if not (beyond := beyond_full(track.voltage, airframe)):
        return None
    found = state(
        "beyond full",
        most=most_voltage(track.voltage, airframe),
        nominal=airframe.nominal_voltage,
        full=full_voltage(airframe),
        percent=100.0 * beyond,
    )
    return _compared("full battery", beyond, found)


def _surplus_thrust(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence
) -> Comparison | None:
    """Report thrust in use that the reported load or speeds do not account for; None without one.

    It is what motor outputs show beyond rotor speeds, or either shows beyond the weight; the larger
    one counts. The intervals of margin and fill are extended to it, so the verdict is only "apart".
    """
    outputs = replace(outputs, ceiling_high=0.0)
    beyond, kind = outputs.share_beyond_speeds, "outputs beyond speeds"
    gauge = track.measured("tank_kg")[track.flying]
    if (tank_kg := gauge[gauge >= 0.0]).size:
        mass = airframe.empty_mass + known_median(tank_kg)
        if (share := outputs.share_beyond(mass)) > beyond:
            alone = outputs.more_than(mass) / mass < share
            beyond, kind = share, "speeds beyond weight" if alone else "outputs beyond weight"
    if not beyond > 0.0:
        return None
    return _compared("thrust", beyond, state(kind, percent=100.0 * beyond))


def _rotor_speed(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence) -> Comparison:
    """Compare the rotor speeds with the speed that the weight needs.

    Without a known load they count as close only if the motor outputs agree too.
    """
    scale = check_speed_scale(track, airframe)
    if scale.verdict != "rotor":
        return _compared("rotor speed", (scale.low, scale.high), scale.found)
    # Between an empty and a full tank fly many aircraft: without the load, outputs must agree too.
    known = bool((track.measured("tank_kg")[track.flying] >= 0.0).any())
    driven = float(np.exp(0.5 * outputs.over_speeds))  # as a ratio of speeds; NaN: not known
    alike = known or CLOSE_OUTPUT[0] <= driven <= CLOSE_OUTPUT[1]
    speed = known_median(track.rotor_speed_rpm[track.flying])
    made = _compared(
        "rotor speed",
        (scale.low, scale.high),
        scale.found,
        brief=state("speed", speed=speed, of=_for_mass(track, airframe, scale.ratio)),
    )
    if made.verdict != "close":
        return replace(made, found=replace(scale.found, clauses=("not closely",)))
    if alike:
        return made
    unlike = replace(scale.found, clauses=("of some load",))
    return replace(made, limits=replace(made.limits, close=None), found=unlike)


def _one_esc(track: FlightTrack) -> Comparison | None:
    """Report the rotor whose ratio of speed to output differs too much from the other rotors'
    median.

    No other propeller explains such a difference. None without such a rotor, or with too few rows.
    """
    speed, output = np.abs(track.rotor_speed_rpm[track.flying]), track.throttle[track.flying]
    rows = (speed > 0.0).all(axis=1) & (output > 0.0).all(axis=1)
    if track.rotor_count < 3 or np.count_nonzero(rows) < FEWEST_ROWS:
        return None
    each = np.median(speed[rows] / output[rows], axis=0)
    ratio = each / np.median(each)
    odd = int(np.argmax(np.abs(np.log(ratio))))
    found = state("one ESC", rotor=odd + 1, ratio=float(ratio[odd]))
    made = _compared("one ESC", float(np.log(ratio[odd])), found)
    return made if made.verdict == "apart" else None


def _speed_limit(track: FlightTrack, airframe: Airframe) -> Comparison | None:
    """Report rotor speeds in flight that need more than IMPOSSIBLE_USE of the airframe's largest
    thrust at the battery's median voltage.

    The compared value is the time above it, s. None if that is at most MOMENT_S, or less than
    MOMENT_SHARE of the flight, or without speeds. If one rotor alone is above for most of that
    time, it is named.
    """
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
    of = np.flatnonzero(2 * np.count_nonzero(beyond, axis=0) > np.count_nonzero(above)) + 1
    found = state(
        "speed limit of one" if of.size == 1 else "speed limit",
        rotor=int(of[0]) if of.size == 1 else 0,
        fastest=float(np.nanmax(track.rotor_speed_rpm[track.flying])),
        airframe=airframe.name,
        most=limit.item(),
        percent=float(100.0 * use.max()),
    )
    return _compared("rotor speed limit", seconds, found)


def _output(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence) -> Comparison | None:
    """Compare the thrust that motor outputs imply with the weight; None if that thrust is unknown.

    The compared value is the square root of thrust over weight. Without a known load it is the
    interval from an empty to a full tank, which is never close.
    """
    mass = outputs.lifted_kg
    if not np.isfinite(mass):
        return None
    gauge = track.measured("tank_kg")
    tank_kg = gauge[track.flying & (gauge >= 0.0)]
    known = tank_kg.size > 0
    tank = (known_median(tank_kg),) * 2 if known else (0.0, airframe.tank_capacity_kg)
    high, low = (float(np.sqrt(mass / (airframe.empty_mass + kg))) for kg in tank)
    weighs = airframe.empty_mass + tank[1]
    stated = track.source("tank_kg").kind in (SourceKind.STATED, SourceKind.AIRFRAME)
    by = ("stated load" if stated else "by the gauge") if known else "full"
    limits = LIMITS["motor output"]
    # Most aircraft hover near half of their thrust: without the load that is no likeness.
    close, possible, wrong = limits.close if known else None, limits.possible, ()
    # Without speeds of its own the gauge sets what the outputs mean: then it must agree with them.
    if not np.isfinite(outputs.over_speeds):
        surely = float(np.exp(0.5 * SURELY * outputs.error))
        possible = (possible[0], min(possible[1], surely))
        wrong = ("load is wrong" if stated else "gauge is wrong",) if low > surely else ()
    percent = 100.0 * known_median(track.throttle[track.flying])
    own = {"lifts": mass, "airframe": airframe.name, "weighs": weighs}
    return _compared(
        "motor output",
        (low, high),
        state("outputs lift", by, *wrong, percent=percent, **own),
        brief=state("outputs", percent=percent, of=_for_mass(track, airframe, np.sqrt(low * high))),
        close=close,
        possible=possible,
    )


def _speeds_by_output(outputs: OutputEvidence, airframe: Airframe) -> Comparison | None:
    """Compare the thrust by motor outputs with that by rotor speeds; None if either is unknown.

    The compared value is ln of their ratio in standard errors; load and air do not change it.
    """
    if not np.isfinite(outputs.over_speeds):
        return None
    low, high = (float(np.exp(k * SURELY * outputs.error)) for k in (-1, 1))
    found = state(
        "outputs and speeds",
        *(("outputs or speeds wrong",) if outputs.disagrees_with_speeds else ()),
        ratio=float(np.exp(outputs.over_speeds)),
        low=low,
        high=high,
        airframe=airframe.name,
    )
    return _compared("outputs and speeds", outputs.over_speeds / outputs.error, found)


def _for_mass(track: FlightTrack, airframe: Airframe, ratio: float) -> Statement:
    """State the mass, kg, for which rotor speeds are `ratio` times the expected ones.

    It is the median mass in flight; without a gauge the masses with an empty and a full tank.
    """
    gauge = track.measured("tank_kg")
    tank_kg = gauge[track.flying & (gauge >= 0.0)]
    if not tank_kg.size:
        full = airframe.empty_mass + airframe.tank_capacity_kg
        return state("for masses", empty=airframe.empty_mass, full=full)
    mass = airframe.empty_mass + known_median(tank_kg)
    return state("for mass", mass=mass, percent=100.0 * max(abs(ratio - 1.0), 0.01))
