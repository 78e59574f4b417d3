"""Compare instrument readings with other channels of the same flight.

| reading | compared with | not a measurement where |
|---|---|---|
| battery voltage | itself, under load | its 5 s means stay within 0.25 % for a minute and more |
| tank gauge | mass by thrust | it stays while thrust falls, or gains other than 0.75 to 1.35 |
| barometer | its sensors' range, altitude, itself | see `barometer_fault` |
| speed of a rotor | speed of another | they are equal in every sample while they change |

All work on the whole flight, or on all of it that has been flown so far.

Readings that cannot be true are dropped from the flight, in one of two ways.

A frozen reading stays the same to the last digit while its quantity must change: a battery under
load never keeps its voltage; a tank does not keep its level while the thrust shows that the
aircraft becomes lighter; an aircraft that tilts does not keep its airspeed. Of voltage and airspeed
only the frozen rows are dropped; of a tank gauge all rows, because a gauge that stuck once is not
trusted before or after either.

A reading that changes, but not as its quantity does, is dropped in all rows.

A temperature in a table may be of the air or of a warm circuit board. Rotor speeds show which: at
one weight and pressure N² is proportional to the air's temperature, T (Eq. 1 with T_i ~ rho N²). If
good flights agree better with the thermometer's differences than without, its reading is used, less
its mean excess over the standard atmosphere (`Thermometer`). The mean difference of the flights'
air from the standard is in the model's effect `air_density`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.checks.output_evidence import SURELY, thrust_by_outputs, thrust_by_speeds
from thrustmargin.models.checks.speed_readings import FEWEST_ROWS, lifted_mass
from thrustmargin.models.checks.voltage import VoltageSoFar, broken_voltage
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import (
    FARTHEST_FROM_STANDARD,
    G0,
    isa_temperature,
    pressure_altitude,
    track_air,
)
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.physics.motor_output import output_curve
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import Meaning, Provenance, Reason, Rejected, SourceKind
from thrustmargin.models.scores import t_quantile
from thrustmargin.models.statement import Statement, state

LEAST_S = 60.0  # s in flight before a voltage must have moved
#: Share of its voltage by which a battery that carries an aircraft moves within a minute at least:
#: its charge alone takes 1 % (recorded flights 1.2 % and more; trembling by 30 mV of 58 V 0.1 %).
LIVE_VOLTAGE = 0.0025
MEAN_S = 5.0  # s of the means, in which trembling averages out

#: Share of its mass by which an aircraft of constant load cannot become lighter: lift of forward
#: flight and a battery that gets warm are less.
LIGHTER = 0.08
STUCK = 0.25  # share of the mass lost by thrust: a gauge that moved less was stuck
BLOCK_S, FEWEST_BLOCKS = 10.0, 8
APART = 4  # blocks
#: Gain of mass by thrust on the gauge, over the ratio of the two masses: 0.96 to 1.12 in recorded
#: flights. A thrust curve or an empty mass that is off moves numerator and denominator alike.
POSSIBLE_GAIN = (0.75, 1.35)
LARGEST_ERROR = 0.15  # standard error from which a gain is not used
#: Squared correlation of a gauge with a wrong gain: the line is straight. A rotor that fails on the
#: way makes a step (0.48 and 0.86 where one did; 0.84 and more in sound flights).
STRAIGHT = 0.9

#: K between which barometers are specified (MS5611, BMP388, DPS310: -40 to 85 degC).
SENSOR_RANGE = (233.0, 358.0)
WEATHER = 500.0  # m by which pressure altitude can differ from altitude: 55 hPa
#: m by which it can move against altitude within a flight: weather, warm electronics, gusts.
DRIFT = 60.0
FASTEST = 30.0  # m/s over RATE_S; no aircraft that carries a tank climbs or falls so
RATE_S = 3.0

PUMP_S = 30.0  # s of spraying that are needed

SAMPLES, VALUES = 100, 20  # equal samples, and different values among them, that exclude chance
EQUAL = 0.99  # share of the samples


def voltage_without_sag(track: FlightTrack) -> bool:
    """Return True if the battery voltage stays constant in flight, apart from small noise.

    False with less than LEAST_S of voltage in flight.
    """
    rows = track.flying & np.isfinite(track.voltage)
    if track.row_seconds[rows].sum() < LEAST_S or not track.source("voltage").reported:
        return False
    means = _block_medians(track.time_s[rows], track.voltage[rows], MEAN_S)
    return bool(np.ptp(means) < LIVE_VOLTAGE * np.median(means))


def lifted_masses(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> list[Floats]:
    """Return two masses (T,), kg: the mass that the thrust by rotor speeds carries, and the one by
    motor outputs.

    NaN where thrust is unknown. Empty if the airframe has another number of rotors. `parameters`
    are the autopilot's, by name.
    """
    if track.rotor_count != airframe.rotor_count:
        return []
    curve = output_curve(parameters, track.source("throttle"))
    by = thrust_by_speeds(track, airframe), thrust_by_outputs(track, airframe, curve)
    return [lifted_mass(track, thrust) for thrust in by]


def share_lighter(mass: Floats) -> float:
    """Return the share by which masses (n,) fall from first to last quarter, by medians.

    Negative if they rise; n is at least 4.
    """
    quarter = mass.size // 4
    return 1.0 - float(np.median(mass[-quarter:]) / np.median(mass[:quarter]))


def gauge_unfollowed(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> bool:
    """Return True if the reported tank mass contradicts the mass that the rotors' thrust would
    lift.

    Either of two estimates, by rotor speeds or by motor outputs, suffices for a gauge that hardly
    moves while the aircraft becomes lighter. Both, where available, must agree on a gauge that
    falls while the aircraft does not, and on a wrong slope between the two masses, because wrong
    rotor speeds look alike. Outputs count only with a measured voltage. False without a gauge or
    with too few rows.
    """
    gauge = track.measured("tank_kg")
    if not track.source("tank_kg").reported:
        return False
    wrong: list[bool] = []
    by_outputs = track.reports("voltage") and not voltage_without_sag(track)
    for mass in lifted_masses(track, airframe, parameters)[: 1 + by_outputs]:
        rows = track.flying & np.isfinite(mass) & np.isfinite(gauge)
        if np.count_nonzero(rows) < 4 * FEWEST_ROWS:
            continue
        time_s = track.time_s[rows]
        lifted = _block_medians(time_s, mass[rows], BLOCK_S)
        level = _block_medians(time_s, gauge[rows], BLOCK_S)
        if lifted.size < FEWEST_BLOCKS:
            continue
        lighter = share_lighter(mass[rows])
        if lighter > LIGHTER and np.ptp(level) < STUCK * lighter * lifted[0]:
            return True
        fell = share_lighter(airframe.empty_mass + gauge[rows])
        if fell > LIGHTER and lighter < STUCK * fell and _local_gain(lifted, level) < STUCK:
            wrong.append(True)
            continue
        gain, error, straight = _gain(lifted, level)
        over = known_median(mass[rows]) / (airframe.empty_mass + known_median(gauge[rows]))
        if not (error < LARGEST_ERROR * over and straight > STRAIGHT):
            continue
        low, high = ((gain + k * SURELY * error) / over for k in (-1.0, 1.0))
        wrong.append(high < POSSIBLE_GAIN[0] or low > POSSIBLE_GAIN[1])
    return bool(wrong) and all(wrong)


def _local_gain(mass: Floats, level: Floats) -> float:
    """Return the median ratio of the changes of mass and level, both (B,) kg, over APART blocks.

    An event such as the loss of a rotor affects few of them. NaN where no level changes.
    """
    changed = level[APART:] - level[:-APART]
    moved = changed != 0.0
    return known_median((mass[APART:] - mass[:-APART])[moved] / changed[moved])


def _gain(mass: Floats, level: Floats) -> tuple[float, float, float]:
    """Return slope, standard error and squared correlation of masses on levels, both (B,) kg.

    NaN, infinity and 0 if all levels are equal.
    """
    about, off = level - level.mean(), mass - mass.mean()
    squares = float(about @ about)
    if not squares > 0.0:
        return float("nan"), float("inf"), 0.0
    slope = float(about @ off) / squares
    left = off - slope * about
    error = float(np.sqrt(left @ left / (mass.size - 2) / squares))
    return slope, error, 1.0 - float(left @ left) / max(float(off @ off), 1e-12)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sprayed:
    """The mass, by thrust, that left the aircraft while its pump ran, at most, and pump time."""

    pump_s: float  # s in flight with the pump on
    most_kg: float  # upper end of the 99 % interval


def sprayed_by_thrust(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> Sprayed | None:
    """Estimate the mass, kg, that left the aircraft while it sprayed, from the fall of its thrust.

    Thrust is from rotor speeds, else from motor outputs. Return None with less than PUMP_S s of
    spraying in flight, or if thrust is known in too few rows.
    """
    seconds = np.where(track.flying & (track.spraying > 0.5), track.row_seconds, 0.0)
    if not seconds.sum() >= PUMP_S:
        return None
    for mass in lifted_masses(track, airframe, parameters):
        rows = track.flying & np.isfinite(mass)
        if np.count_nonzero(rows) < 4 * FEWEST_ROWS:
            continue
        time_s = track.time_s[rows]
        lifted = _block_medians(time_s, mass[rows], BLOCK_S)
        pumped_s = _block_medians(time_s, np.cumsum(seconds)[rows], BLOCK_S)
        if lifted.size < FEWEST_BLOCKS:
            continue
        slope, error, _ = _gain(lifted, pumped_s)
        left, reach = -slope * np.ptp(pumped_s), SURELY * error * np.ptp(pumped_s)
        whole = float(seconds.sum()) / max(float(np.ptp(pumped_s)), 1.0)
        return Sprayed(pump_s=float(seconds.sum()), most_kg=(left + reach) * whole)
    return None


def barometer_fault(track: FlightTrack) -> bool:
    """Return True if pressure or temperature cannot be those of the air at the aircraft.

    They cannot if the median temperature is outside the sensors' range; or if, of a reported
    pressure, the altitude is 500 m from the track's (median, in flight), moves by 60 m against it
    (5 to 95 % of the rows), or changes faster than 30 m/s between 3 s medians. Single wrong rows do
    not count. False with too few rows.
    """
    air = track.temperature[np.isfinite(track.temperature)]
    if air.size and not SENSOR_RANGE[0] < np.median(air) < SENSOR_RANGE[1]:
        return True
    known = np.isfinite(track.pressure)
    if np.count_nonzero(known) < FEWEST_ROWS or not track.source("pressure").reported:
        return False
    height, time_s = pressure_altitude(track.pressure[known]), track.time_s[known]
    means = _block_medians(time_s, height, RATE_S)
    if np.max(np.abs(np.diff(means)), initial=0.0) > FASTEST * RATE_S:
        return True
    apart = (height - track.altitude[known])[track.flying[known]]
    apart = apart[np.isfinite(apart)]
    if apart.size < FEWEST_ROWS:
        return False
    low, middle, high = np.quantile(apart, (0.05, 0.5, 0.95))
    return bool(abs(middle) > WEATHER or high - low > DRIFT)


def copied_rotors(track: FlightTrack) -> tuple[int, ...]:
    """Return the rotors, from 0, whose speeds are equal in nearly every sample; empty if none.

    Only one of them was measured, which one is not known. Rotors with equal motor outputs are
    excluded, since they may turn alike; so is the case that all rotors are equal.
    """
    speeds = track.measured("rotor_speed_rpm")[track.flying]
    outputs = track.throttle[track.flying]
    for one in range(track.rotor_count):
        same = [one]
        for other in range(one + 1, track.rotor_count):
            both = np.isfinite(speeds[:, one]) & np.isfinite(speeds[:, other])
            first, second = speeds[both, one], speeds[both, other]
            equal = first == second
            if both.sum() < SAMPLES or equal.mean() < EQUAL or np.unique(first).size < VALUES:
                continue
            driven = outputs[both][:, [one, other]]
            if np.isfinite(driven).any() and np.nanmax(np.abs(np.diff(driven, axis=1))) == 0.0:
                continue
            same.append(other)
        if 1 < len(same) < track.rotor_count:
            return tuple(same)
    return ()


def _block_medians(time_s: Floats, values: Floats, length_s: float) -> Floats:
    """Return the medians (B,) of `values` (n,) in blocks of `length_s` s of `time_s` (n,).

    Blocks count from the first time; those without values are left out.
    """
    block = np.floor((time_s - time_s[0]) / length_s)
    starts = np.append(0, np.flatnonzero(np.diff(block)) + 1)
    return np.array([np.median(part) for part in np.split(values, starts[1:])])


LEAST_FROZEN_S = 60.0  # s in flight of one and the same reading
#: s between changes, on average, above which a reading is too coarse to call it frozen.
FINE_S = 6.0
#: Channels that can be frozen -> what measures them.
INSTRUMENTS = {
    "voltage": "battery voltage",
    "tank_kg": "tank gauge",
    "airspeed": "airspeed reading",
    "pressure": "barometer",
    "temperature": "barometer",
    "rotor_speed_rpm": "rotor speed sensors",
}
#: rad, range of tilt (without the share SELDOM at either end) that surely changes the speed;
#: a hover shakes by less.
TILTED, SELDOM = 0.1, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """A faulty instrument reading: its value, rows and reason."""

    value: float  # in the unit of its channel
    rows: Bools  # (T,) in which it is dropped
    throughout: bool  # it never changed in flight
    reason: Reason = Reason.FROZEN
    rotors: tuple[int, ...] = ()  # rotors concerned, from 0; empty for other channels


def without_frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> FlightTrack:
    """Set the channels of frozen or faulty instruments to NaN in the rows affected.

    Likewise for the voltage where it broke down. A statement and the source give the reason.
    `parameters` are the autopilot's, by name.
    """
    track, _ = without_broken_voltage(track)
    return drop_readings(track, frozen_channels(track, airframe, parameters))


def without_broken_voltage(
    track: FlightTrack, so_far: VoltageSoFar | None = None
) -> tuple[FlightTrack, VoltageSoFar]:
    """Set the voltage to NaN in rows where its reading broke down.

    Also return the state for the next part of a flight, passed as `so_far`.
    """
    broke, found = broken_voltage(track, so_far)
    if not broke.any():
        return track, found
    least = float(np.nanmin(track.voltage[broke]))
    stand = Stand(value=least, rows=broke, throughout=False, reason=Reason.BROKEN)
    return drop_readings(track, {"voltage": stand}), found


def frozen_channels(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> dict[str, Stand]:
    """Return, by channel name, the rows in which its instrument was frozen or faulty.

    Of several runs of one channel the last is returned. `parameters` are the autopilot's, by name.
    """
    found = {}
    flown = track.flying & np.isfinite(track.voltage)
    for rows in _frozen_runs(track, "voltage"):
        throughout, else_s = bool(rows[flown].all()), track.row_seconds[flown & ~rows].sum()
        moves = np.count_nonzero(np.diff(track.voltage[flown & ~rows]))
        if throughout or else_s < FINE_S * moves:
            left = rows | ~track.flying if throughout else rows
            found["voltage"] = Stand(
                value=float(track.voltage[rows][0]), rows=left, throughout=throughout
            )
    for rows in _frozen_runs(track, "tank_kg"):
        if _grew_lighter(track, rows, airframe, parameters):
            known = track.flying & np.isfinite(track.tank_kg)
            found["tank_kg"] = Stand(
                value=float(track.tank_kg[rows][0]),
                rows=np.ones_like(rows),
                throughout=bool(rows[known].all()),
            )
    for rows in _frozen_runs(track, "airspeed"):
        tilt = track.attitude[rows, :2]
        tilt = tilt[np.isfinite(tilt).all(axis=1)]
        ends = np.quantile(tilt, [SELDOM, 1.0 - SELDOM], axis=0) if tilt.size else np.zeros((2, 2))
        if np.max(ends[1] - ends[0]) > TILTED:
            known = track.flying & np.isfinite(track.airspeed)
            found["airspeed"] = Stand(
                value=float(track.airspeed[rows][0]),
                rows=rows,
                throughout=bool(rows[known].all()),
            )
    whole = np.ones(track.time_s.size, dtype=np.bool_)
    for channel, reason, rotors in _contradictions(track, airframe, parameters):
        values = getattr(track, channel)[track.flying]
        value = known_median(values[:, list(rotors)] if rotors else values)
        stand = Stand(value=value, rows=whole, throughout=True, reason=reason, rotors=rotors)
        found.setdefault(channel, stand)
    return found


def _contradictions(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> Iterator[tuple[str, Reason, tuple[int, ...]]]:
    """Yield channel, reason and rotors (from 0; empty: all) of readings that other channels
    contradict."""
    if rotors := copied_rotors(track):
        yield "rotor_speed_rpm", Reason.COPIED, rotors
    if voltage_without_sag(track):
        yield "voltage", Reason.UNLOADED, ()
    if gauge_unfollowed(track, airframe, parameters):
        yield "tank_kg", Reason.UNFOLLOWED, ()
    if barometer_fault(track):
        yield "pressure", Reason.IMPOSSIBLE, ()
        yield "temperature", Reason.IMPOSSIBLE, ()


def drop_readings(track: FlightTrack, frozen: Mapping[str, Stand]) -> FlightTrack:
    """Set the rows of faulty readings to NaN, and add the reason to the channel's source and
    statements.

    `frozen` maps channel names to their faulty rows.
    """
    if not frozen:
        return track
    channels, sources, statements = {}, {}, list(track.statements)
    for channel, stand in frozen.items():
        source, values = track.source(channel), getattr(track, channel)
        if stand.rotors:
            of_rotor = np.isin(np.arange(track.rotor_count), stand.rotors)
            channels[channel] = np.where(stand.rows[:, None] & of_rotor, np.nan, values)
        else:
            channels[channel] = np.where(stand.rows, np.nan, values)
        gone = Rejected(source, stand.reason)
        sources[channel] = replace(source, rejected=(*source.rejected, gone))
        if not np.isfinite(channels[channel]).any():
            sources[channel] = Provenance(kind=SourceKind.ABSENT, rejected=(gone,))
        statements.append(_left_out(channel, stand))
    sources = {**track.sources, **sources}
    return replace(track, **channels, sources=sources, statements=tuple(statements))


def _left_out(channel: str, stand: Stand) -> Statement:
    """State which channel's readings were dropped, at which value, and why (`stand.reason`)."""
    kind = stand.reason.name.lower()
    if stand.reason is Reason.FROZEN:
        kind = "stood throughout" if stand.throughout else "stood"
    return state(
        "instrument",
        kind,
        "left out",
        instrument=INSTRUMENTS[channel],
        value=stand.value,
        unit=TRACK_CHANNELS[channel].unit,
        rotors=tuple(state("rotor", rotor=rotor + 1) for rotor in stand.rotors),
    )


def _frozen_runs(track: FlightTrack, channel: str) -> list[Bools]:
    """List, as masks (T,), the runs in flight in which a channel kept one value for LEAST_FROZEN_S.

    Empty for a channel that is not reported.
    """
    values = getattr(track, channel)
    known = np.flatnonzero(track.flying & np.isfinite(values))
    if not track.source(channel).reported or known.size < FEWEST_ROWS:
        return []
    changes = np.flatnonzero(np.diff(values[known])) + 1
    starts, ends = np.append(0, changes), np.append(changes, known.size)
    long = np.flatnonzero(ends - starts >= FEWEST_ROWS)
    runs = [known[starts[k] : ends[k]] for k in long]
    number = np.arange(values.size)
    return [np.isin(number, run) for run in runs if track.row_seconds[run].sum() >= LEAST_FROZEN_S]


def _grew_lighter(
    track: FlightTrack, rows: Bools, airframe: Airframe, parameters: Mapping[str, float]
) -> bool:
    """Return True if the mass by thrust falls by more than LIGHTER from the first to the last
    quarter of `rows` (T,)."""
    known = (m[rows & np.isfinite(m)] for m in lifted_masses(track, airframe, parameters))
    return any(share_lighter(m) > LIGHTER for m in known if m.size >= 4 * FEWEST_ROWS)


SURE = 0.95  # probability required: standard air is off by the weather, a wrong reading by more
FEWEST_FLIGHTS = 3  # so that without one of them the others still differ


@dataclass(frozen=True, slots=True, kw_only=True)
class Thermometer:
    """The offset and error of one aircraft's thermometer as a measure of air temperature."""

    warmer_k: float  # reading minus air temperature
    error_k: float  # standard error of the air temperature, between flights


def with_air_temperature(track: FlightTrack, thermometer: Thermometer | None) -> FlightTrack:
    """Replace a thermometer's reading of unknown meaning by the air temperature estimated from it.

    Return the track unchanged without a thermometer or such a reading.
    """
    if thermometer is None or not needs_thermometer(track):
        return track
    source = Provenance(
        kind=SourceKind.INFERRED,
        name=f"the thermometer less {thermometer.warmer_k:.1f} K, as good flights show",
        parts=(track.source("temperature"),),
    )
    return replace(
        track,
        temperature=track.temperature - thermometer.warmer_k,
        sources={**track.sources, "temperature": source},
        standard_errors={
            **track.standard_errors,
            "temperature": np.full(track.time_s.size, thermometer.error_k),
        },
    )


def learnt_thermometer(tracks: Sequence[FlightTrack], airframe: Airframe) -> Thermometer | None:
    """Estimate the thermometer's offset, K, and its error from fault-free flights.

    The offset is how much warmer the thermometer reads than the standard atmosphere, in the mean.
    Return it only if it makes flights agree better in ln N² than the standard atmosphere does (each
    against the mean of the others; Student's t test of the squared differences); else None. Also
    None with fewer than FEWEST_FLIGHTS usable flights, if a flight needs no correction, or if one
    is over FARTHEST_FROM_STANDARD K from the mean.
    """
    used = [track for track in tracks if training_rows(track, ("tank_kg",)).any()]
    if len(used) < FEWEST_FLIGHTS or not all(map(needs_thermometer, used)):
        return None
    above, standard, speed = _readings_and_speeds(used, airframe)
    warmer = float(above.mean())
    if np.any(np.abs(above - warmer) > FARTHEST_FROM_STANDARD):
        return None
    by_it = speed - np.log1p((above - warmer) / standard)
    gain = (speed - _others(speed)) ** 2 - (by_it - _others(by_it)) ** 2
    limit = t_quantile(gain.size - 1, SURE)
    if not gain.mean() > limit * np.std(gain, ddof=1) / np.sqrt(gain.size):
        return None
    error = float(np.std(by_it, ddof=1) * standard.mean())
    return Thermometer(warmer_k=warmer, error_k=error)


def needs_thermometer(track: FlightTrack) -> bool:
    """Return True if a temperature is reported, and nothing states that it is that of the air or
    of a board."""
    stated = "temperature" in track.standard_errors
    board = track.source("temperature").meaning is Meaning.BOARD_TEMPERATURE
    return track.reports("temperature") and not (stated or board)


def _readings_and_speeds(
    tracks: Sequence[FlightTrack], airframe: Airframe
) -> tuple[Floats, Floats, Floats]:
    """Return three values (F,) of each flight, from its training rows.

    They are the reading's median excess over standard air, K; the temperature of standard air, K;
    and the mean of ln(sum N² rho / mass), rho by standard air, corrected for the influence of
    airspeed, climb and load factor within flights.
    """
    above, standard, speed, motion = [], [], [], []
    for track in tracks:
        rows = training_rows(track, ("tank_kg",))
        air = track_air(track)
        altitude = (
            track.altitude if track.reports("altitude") else pressure_altitude(track.pressure)
        )
        isa = isa_temperature(np.nan_to_num(altitude))[rows]
        above.append(float(np.nanmedian(track.temperature[rows] - isa)))
        standard.append(float(np.median(isa)))
        n2 = np.sum(track.rotor_speed_rpm[rows] ** 2, axis=1)
        mass = airframe.empty_mass + track.tank_kg[rows]
        speed.append(np.log(n2 * air.density[rows] / mass))
        v, down = track.airspeed[rows], track.velocity_ned[rows, 2]
        load = np.linalg.norm(track.specific_force_frd[rows], axis=1) / G0
        motion.append(np.nan_to_num(np.stack([v, v**2, v**3, down, load], axis=1)))
    within = [m - m.mean(axis=0) for m in motion]
    wanted = np.concatenate([s - s.mean() for s in speed])
    slope = np.linalg.lstsq(np.concatenate(within), wanted, rcond=None)[0]
    means = [float(np.mean(s - m @ slope)) for s, m in zip(speed, motion, strict=True)]
    return np.array(above), np.array(standard), np.array(means)


def _others(values: Floats) -> Floats:
    """Return, for each of F values, the mean of the remaining F - 1; shape (F,)."""
    return (values.sum() - values) / (values.size - 1)
