"""Predict a flight by the state of its aircraft before it, then let the flight update the state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, KnownAircraft, NotTaught
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.wording.advice_words import suspects
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.advice import Advice, FlightLevel, advise
from thrustmargin.models.model.aircraft_change import (
    AircraftChange,
    ChangeKind,
    aircraft_change,
)
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, analysis_for_verdict
from thrustmargin.models.model.flight_arms import flight_arm_figures
from thrustmargin.models.model.flight_lessons import flight_offsets, power_coefficient
from thrustmargin.models.model.mode_walk import FlightOffsets, WalkStep, walk
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.offset_total import rotor_total
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.known_battery import battery_resistance
from thrustmargin.models.physics.smoothing import known_median

NAN = float("nan")
LEAST_KNOWN = 0.9  # share of a flight with a current, from which on its charge is known


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearntFlight:
    """A flight of a known aircraft: its analysis by the state before it, advice, and record."""

    analysis: FlightAnalysis
    advice: Advice
    row: AircraftFlight


def learnt_flight(
    log: FlightLog,
    airframe_match: AirframeMatch,
    model: RotorModel,
    aircraft: KnownAircraft,
    *,
    flight: str,
    limit: float = 0.5,
) -> LearntFlight:
    """Analyse a flight of a known aircraft in its state before the flight, and make the flight's
    record.

    `model` is the aircraft's model, `flight` the log's digest, `limit` the largest share of a
    rotor's thrust that may be used for long. A flight without a date is predicted in the state
    after the last flight, and does not update the state.
    """
    track = log.track
    start_unix_s = NAN if track.start_unix_s is None else track.start_unix_s
    longitude_deg = track.origin.longitude_deg if track.origin else NAN
    latitude_deg = track.origin.latitude_deg if track.origin else NAN
    others = tuple(one for one in aircraft.flights if one.flight != flight)
    without, start = replace(aircraft, flights=others), start_unix_s
    if not np.isfinite(start):
        start = _after_last(aircraft)
    if model.interval is not None and not airframe_match.no_verdict:
        state = without.state_before(start, model.airframe.rotor_count, longitude_deg)
        model = replace(model, state=state)
    model = replace(model, arms=without.arms_before(start) or model.arms)
    analysis = analysis_for_verdict(analyse(track, model, airframe_match=airframe_match))
    advice = advise(analysis, limit=limit).advice
    offsets = None
    if np.isfinite(start_unix_s):
        offsets = flight_offsets(
            analysis, flight=flight, start_unix_s=start_unix_s, longitude_deg=longitude_deg
        )
    reason = not_taught(advice, offsets)
    trained = flight in aircraft.training
    if reason is None and not model.taught:
        reason = NotTaught.MODEL
    elif reason is NotTaught.TOO_SHORT and trained:  # by motor outputs, which give no offsets
        reason = None
    step = None
    if offsets is not None and reason is None and model.interval is not None:
        step = step_of(aircraft, offsets)
    change = None if step is None else change_of(step, analysis, aircraft, log.name)
    advice, analysis = replace(advice, change=change), replace(analysis, change=change)
    ohm, ohm_error = battery_resistance(track.time_s, track.voltage, track.current, track.flying)
    row = AircraftFlight(
        flight=flight,
        log_name=log.name,
        started_unix_s=start_unix_s,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        flying_s=advice.airborne_s,
        verdict=str(advice.level),
        use_lasting=advice.use.lasting_most,
        use_lasting_low=advice.use.lasting_low,
        use_lasting_high=advice.use.lasting_high,
        tank_start_kg=_first_known(np.where(track.flying, track.tank_kg, np.nan)),
        density_median=known_median(analysis.density[track.flying]),
        rest_voltage=rest_voltage(analysis),
        mean_power=_mean_power(analysis),
        power_coefficient=power_coefficient(analysis),
        battery_ohm=ohm,
        battery_ohm_error=ohm_error,
        charge_used_ah=_charge_used(analysis),
        coverage=coverage(analysis),
        bias=advice.misfit.bias,
        fault_kinds=tuple(one.fault.kind for one in advice.faults),
        caveats=advice.caveats,
        fault_rotors=tuple(one.fault.rotor + 1 for one in advice.faults),
        suspects=suspects(advice),
        change=change,
        offsets=offsets,
        not_taught=reason,
        trained=trained,
        arms=flight_arm_figures(analysis, flight=flight),
        bad_arms=bad_arms(advice, track.rotor_count),
    )
    return LearntFlight(analysis=analysis, advice=advice, row=row)


def _after_last(aircraft: KnownAircraft) -> float:
    """Return a Unix time, s, after the last dated flight of an aircraft; 0 without one."""
    times = [one.started_unix_s for one in aircraft.flights if np.isfinite(one.started_unix_s)]
    return max(times, default=0.0) + 1.0


def step_of(aircraft: KnownAircraft, offsets: FlightOffsets) -> WalkStep:
    """Return the random walk's step at a flight: rotor speed offsets before and after it.

    The walk runs over the earlier flights of the aircraft that update its state, and this one.
    """
    earlier = [
        one
        for one in aircraft.lessons
        if one.start_unix_s < offsets.start_unix_s and one.flight != offsets.flight
    ]
    steps = aircraft.steps(offsets.start_unix_s)
    last = aircraft.last_training
    if last is not None and last.flight == offsets.flight:
        last = None
    return walk([*earlier, offsets], steps, last_training=last, repairs=aircraft.repairs)[-1]


def change_of(
    step: WalkStep, analysis: FlightAnalysis, aircraft: KnownAircraft, log_name: str
) -> AircraftChange | None:
    """Return how a flight differs from the earlier flights of its aircraft.

    `step` is the flight's step in the random walk of rotor speed offsets. None if it does not
    differ, or if the model has no interval. An earlier change is reported again until a repair is
    noted, as long as flights differ from the state before it by more than the walk allows.
    `log_name` names this flight's log.
    """
    model, flight = analysis.model, step.flight
    if model.interval is None:
        return None
    noted = max((one for one in aircraft.repairs if one < flight.start_unix_s), default=-np.inf)
    before = [one for one in aircraft.flights if noted < one.started_unix_s < flight.start_unix_s]
    began = [one.change.since_unix_s for one in before if one.change and one.change.modes]
    began = [one for one in began if one > noted]
    since = max(began, default=flight.start_unix_s)
    if began and not step.changed:
        step = _against(step, aircraft, since)
    elif step.changed:
        since = flight.start_unix_s
    lessons = [one for one in aircraft.lessons if one.start_unix_s < flight.start_unix_s]
    jump = since if began or step.changed else -np.inf
    change = aircraft_change(
        step,
        model.airframe,
        speed_rpm=known_median(analysis.prediction.rotor_speed_rpm[analysis.track.flying]),
        weight=known_median(analysis.weight[analysis.track.flying]),
        coverage=coverage(analysis),
        interval=model.interval,
        rotor=rotor_total([*lessons, flight], model, since_unix_s=noted, jump_unix_s=jump),
    )
    if change is None:
        return None
    logs = {one.started_unix_s: one.log_name for one in before} | {flight.start_unix_s: log_name}
    if change.rotor is not None:
        since = min(one for one in logs if one >= change.rotor.since_unix_s)
    elif change.kind is ChangeKind.COVERAGE:
        since = flight.start_unix_s
    return replace(change, since_unix_s=since, since_log=logs.get(since, log_name))


def _against(step: WalkStep, aircraft: KnownAircraft, since_unix_s: float) -> WalkStep:
    """Return a flight's step in the random walk, compared with an older state of its aircraft.

    That is the state before the flight at `since_unix_s`, Unix time. `surprise` is then the
    difference from it, in standard errors for each mode; the variance that the walk allows since
    then is included.
    """
    flight = step.flight
    earlier = [one for one in aircraft.lessons if one.start_unix_s < flight.start_unix_s]
    walked = walk(
        [*earlier, flight],
        aircraft.steps(since_unix_s),  # of the flights before the change, which enlarges them
        last_training=aircraft.last_training,
        repairs=aircraft.repairs,
    )
    since = [one for one in walked if one.flight.start_unix_s >= since_unix_s]
    old = since[0]
    # The walk may have gone on since: its steps from there on are expected too.
    variance = sum(np.square(one.before.error) - np.square(one.known) for one in since[1:])
    expected = np.sqrt(np.square(old.before.error) + variance + np.square(flight.error))
    difference = np.array(flight.offset) - np.array(old.before.offset)
    surprise = tuple((difference / expected).tolist())
    return replace(step, before=old.before, known=old.known, surprise=surprise)


def not_taught(advice: Advice, offsets: FlightOffsets | None) -> NotTaught | None:
    """Return why a flight does not update the state of its aircraft; None if it does.

    The reasons are a fault, lost control, no verdict, a wrong motor order, wrong rotor speeds, an
    uncertain load, and too little data (`offsets` None), in this order.
    """
    if advice.faults:
        return NotTaught.FAULT
    if advice.losses or FlightLevel.LOST in advice.levels:
        return NotTaught.LOST
    if advice.no_verdict or advice.level is FlightLevel.UNKNOWN:
        return NotTaught.NO_VERDICT
    if FlightLevel.ORDER in advice.levels:
        return NotTaught.ORDER
    if advice.misread is not None or Caveat.ROTOR_SPEEDS in advice.caveats:
        return NotTaught.READINGS
    if Caveat.LOAD in advice.caveats or Caveat.GAUGE in advice.caveats:
        return NotTaught.LOAD
    return NotTaught.TOO_SHORT if offsets is None else None


def bad_arms(advice: Advice, rotors: int) -> tuple[int, ...]:
    """Return the arms, from 0, in which a part may be bad: propeller, motor, ESC or lead.

    A wrong sensor reading does not count. Empty if arms were not checked. All `rotors` arms are
    returned if the aircraft shakes and no arm shows why.
    """
    if advice.arms is None:
        return ()
    if advice.arms.shaken is not None:
        return tuple(range(rotors))
    return tuple(one.arm for one in advice.arms.findings if not one.only_sensors)


def coverage(analysis: FlightAnalysis) -> float:
    """Return the share of measured rotor speeds in flight that are inside the prediction's
    interval.

    NaN without a measured speed.
    """
    track, prediction = analysis.track, analysis.prediction
    speed = track.measured("rotor_speed_rpm")
    known = track.flying[:, None] & np.isfinite(speed) & np.isfinite(prediction.lower_rpm)
    inside = (speed >= prediction.lower_rpm) & (speed <= prediction.upper_rpm)
    return float(inside[known].mean()) if known.any() else NAN


def rest_voltage(analysis: FlightAnalysis) -> float:
    """Return the median voltage, V, before the first take-off; NaN where the log begins later."""
    track = analysis.track
    return known_median(track.voltage[np.cumsum(track.flying) == 0])


def _mean_power(analysis: FlightAnalysis) -> float:
    """Return the mean electric power in flight, W; NaN without voltage and current."""
    track = analysis.track
    power = (track.voltage * track.current)[track.flying]
    return float(np.nanmean(power)) if np.isfinite(power).any() else NAN


def _charge_used(analysis: FlightAnalysis) -> float:
    """Return the charge used in flight, Ah, integrated from the current.

    NaN if the current is known in less than LEAST_KNOWN of the flight time, or without a flight.
    """
    track = analysis.track
    seconds = np.where(track.flying, np.gradient(track.time_s), 0.0)
    known = np.isfinite(track.current)
    flown_s = float(seconds.sum())
    if not flown_s > 0.0 or seconds[known].sum() < LEAST_KNOWN * flown_s:
        return NAN
    return float(np.nansum(track.current * seconds)) / 3600.0


def _first_known(values: Floats) -> float:
    """Return the first finite value; NaN without one."""
    known = values[np.isfinite(values)]
    return float(known[0]) if known.size else NAN
