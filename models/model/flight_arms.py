"""Measure the figures of each arm in a flight, and find what is wrong with which arm."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.checks.arms.arm_causes import THRUST_CAUSES, Cause
from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmReadings, arm_figures
from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer, arm_answer
from thrustmargin.models.checks.arms.desync import speed_falls
from thrustmargin.models.checks.arms.spool_up import spool_up_figure
from thrustmargin.models.checks.takeoff import takeoff_checks
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.mode_walk import local_day
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_faults import RowLimit, fault_signals, mode_directions
from thrustmargin.models.model.rotor_model import RotorModel

#: Of the squared speeds that carry the weight: with less, the legs are on the ground.
CARRIED = 0.8
#: Causes of a rotor whose speed is not that of its motor output.
_OF_DRIVE = (Cause.MOTOR, Cause.ESC, Cause.LEAD)


def flight_arm_figures(analysis: FlightAnalysis, *, flight: str) -> ArmFigures:
    """Return the power, heat and vibration figures of each arm in a flight.

    `flight` identifies it: the digest of its log, or its name. Speeds inferred from motor outputs
    are not used, because they show no power. A flight without a date counts as of day 0. Thrust is
    NaN if the aircraft is unknown (`no_verdict`).
    """
    track, rotors = analysis.track, analysis.track.rotor_count
    signals = fault_signals(analysis, slice(None))
    excess, output = signals[:, 1 : 1 + rotors], signals[:, 1 + rotors : 1 + 2 * rotors]
    speed = np.where(analysis.from_outputs, np.nan, track.measured("rotor_speed_rpm"))
    predicted = np.sum(analysis.prediction.rotor_speed_rpm**2, axis=1)
    with np.errstate(invalid="ignore"):
        light = np.sum(speed**2, axis=1) < CARRIED * predicted  # False where the load is unknown
    usable = track.flying & ~light & np.isfinite(speed).all(axis=1)
    usable &= signals[:, -1] < RowLimit.NO_FAULT
    falls = speed_falls(track)
    readings = ArmReadings(
        time_s=track.time_s,
        flying=track.flying,
        usable=usable,
        density_ratio=analysis.density / analysis.model.reference_density,
        speed_rpm=speed,
        thrust_excess=np.full_like(excess, np.nan) if analysis.no_verdict else excess,
        output_excess=output,
        voltage=track.voltage,
        esc_voltage=track.esc_voltage,
        esc_current=track.esc_current,
        esc_temperature=track.esc_temperature,
        motor_temperature=track.motor_temperature,
        vibration=track.vibration_per_rev,
        fell=falls.fell,
        answered=falls.answered,
        outputs_known=np.any(np.isfinite(track.throttle) & np.isfinite(speed), axis=0),
        lost=track.esc_lost,
        shaking=track.vibration,
        clipping=track.clipping,
    )
    start = 0.0 if track.start_unix_s is None else track.start_unix_s
    longitude = track.origin.longitude_deg if track.origin else math.nan
    made = arm_figures(readings, flight=flight, day=local_day(start, longitude))
    starts = [check for check in takeoff_checks(track) if np.isfinite(check.lift_s)]
    ratios = [(one.speed_ratio, one.output_ratio) for one in starts[-1].motors] if starts else []
    figure = spool_up_figure(ratios)
    return made if figure is None else replace(made, figures=(*made.figures, figure))


def figures_of(model: RotorModel, tracks: Sequence[FlightTrack]) -> tuple[ArmFigures, ...]:
    """Return the figures of an aircraft's arms in each of some flights."""
    return tuple(flight_arm_figures(analyse(track, model), flight=track.name) for track in tracks)


def learnt_arms(model: RotorModel, tracks: Sequence[FlightTrack]) -> ArmLaw:
    """Return the figures of an aircraft's arms in its fault-free flights `tracks`, as a
    reference."""
    return ArmLaw(flights=figures_of(model, tracks))


def flight_arm_answer(
    analysis: FlightAnalysis,
    faults: Sequence[RotorFault] = (),
    misread: MisreadSpeed | None = None,
) -> ArmAnswer:
    """Return which arms of a flight are faulty and why, compared with the model's state of the arms
    in earlier flights.

    `faults` and `misread` are what the search for weak rotors by speeds found; they limit the
    causes of those arms.
    """
    model = analysis.model
    return arm_answer(
        [flight_arm_figures(analysis, flight=analysis.track.name)],
        model.arms,
        modes=mode_directions(model),
        given=_causes_left(faults, misread),
    )


def flights_arm_answer(
    model: RotorModel, flights: Sequence[ArmFigures], weak: Collection[int] = ()
) -> ArmAnswer:
    """Return what is wrong with which arms in several flights together, by their figures.

    `weak` are the rotors, from 0, that a search by speeds reports: either the propeller of each has
    lost thrust, or its speed is misread.
    """
    given = dict.fromkeys(weak, THRUST_CAUSES)
    return arm_answer(flights, model.arms, modes=mode_directions(model), given=given)


def _causes_left(
    faults: Sequence[RotorFault], misread: MisreadSpeed | None
) -> Mapping[int, tuple[Cause, ...]]:
    """Return the causes that remain possible, by the arm (from 0) of each reported fault or misread
    speed.

    A fault of one of several rotors adds no arm, because the arm is not known.
    """
    left: dict[int, tuple[Cause, ...]] = {}
    for fault in faults:
        if fault.rotors:
            continue
        of_speed = () if fault.witnessed else (Cause.SPEED_READING,)
        propeller = fault.kind == "propeller"
        left[fault.rotor] = (Cause.PROPELLER, *of_speed) if propeller else _OF_DRIVE
    if misread is not None:
        left[misread.rotor] = (Cause.SPEED_READING,)
        if not misread.witnessed:
            left[misread.rotor] = (Cause.SPEED_READING, Cause.PROPELLER)
    return left
