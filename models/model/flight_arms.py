"""Measure the figures of each arm in a flight, and find what is wrong with which arm."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from thrustmargin.models.checks.arms.arm_causes import THRUST_CAUSES, Cause
from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmReadings, arm_figures
from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer, arm_answer
from thrustmargin.models.checks.arms.desync import speed_falls
from thrustmargin.models.checks.arms.spool_up import spool_up_figure
from thrustmargin.models.checks.takeoff import takeoff_checks
from thrustmargin.models.flight import Bools, FlightTrack, Floats, join_tracks
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.mode_walk import local_day
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_faults import RowLimit, fault_signals, mode_directions
from thrustmargin.models.model.rotor_model import RotorModel

#: Of the squared speeds that carry the weight: with less, the legs are on the ground.
CARRIED = 0.8
#: s between two answers of a flight in progress, and the share by which it has grown: a longer one
#: takes longer, and changes less.
AGAIN_S, GROWN = 5.0, 0.05
LANDED_S = 5.0  # on the ground after which a take-off begins another flight
IN_PROGRESS = "in progress"  # the name of a flight that has no log yet
#: Causes of a rotor whose speed is not that of its motor output.
_OF_DRIVE = (Cause.MOTOR, Cause.ESC, Cause.LEAD)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmRows:
    """T rows of R arms, from which their figures are made; NaN unknown."""

    track: FlightTrack
    density_ratio: Floats  # (T,) of the air, over the model's reference density
    speed_rpm: Floats  # (T, R) measured: speeds inferred from motor outputs show no power
    thrust_excess: Floats  # (T, R) NaN if the aircraft is unknown
    output_excess: Floats  # (T, R)
    usable: Bools  # (T,) rows in flight in which the rotors carry the aircraft

    @classmethod
    def of(cls, analysis: FlightAnalysis, rows: slice = slice(None)) -> ArmRows:
        """Return the rows `rows` of an analysis."""
        track, rotors = analysis.track.rows(rows), analysis.track.rotor_count
        signals = fault_signals(analysis, rows)
        excess, output = signals[:, 1 : 1 + rotors], signals[:, 1 + rotors : 1 + 2 * rotors]
        speed = np.where(analysis.from_outputs[rows], np.nan, track.measured("rotor_speed_rpm"))
        predicted = np.sum(analysis.prediction.rotor_speed_rpm[rows] ** 2, axis=1)
        with np.errstate(invalid="ignore"):
            light = np.sum(speed**2, axis=1) < CARRIED * predicted  # False for an unknown load
        usable = track.flying & ~light & np.isfinite(speed).all(axis=1)
        return cls(
            track=track,
            density_ratio=analysis.density[rows] / analysis.model.reference_density,
            speed_rpm=speed,
            thrust_excess=np.full_like(excess, np.nan) if analysis.no_verdict else excess,
            output_excess=output,
            usable=usable & (signals[:, -1] < RowLimit.NO_FAULT),
        )

    @classmethod
    def joined(cls, parts: Sequence[ArmRows]) -> ArmRows:
        """Return the rows of parts that follow each other as one."""
        arrays = ("density_ratio", "speed_rpm", "thrust_excess", "output_excess", "usable")
        return cls(
            track=join_tracks([(part.track, slice(None)) for part in parts]),
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays},
        )

    def figures(self, flight: str) -> ArmFigures:
        """Return the power, heat and vibration figures of each arm in a flight of these rows.

        `flight` identifies it: the digest of its log, or its name. A flight without a date counts
        as of day 0.
        """
        track, falls = self.track, speed_falls(self.track)
        readings = ArmReadings(
            time_s=track.time_s,
            flying=track.flying,
            usable=self.usable,
            density_ratio=self.density_ratio,
            speed_rpm=self.speed_rpm,
            thrust_excess=self.thrust_excess,
            output_excess=self.output_excess,
            voltage=track.voltage,
            esc_voltage=track.esc_voltage,
            esc_current=track.esc_current,
            esc_temperature=track.esc_temperature,
            motor_temperature=track.motor_temperature,
            vibration=track.vibration_per_rev,
            fell=falls.fell,
            answered=falls.answered,
            outputs_known=np.any(np.isfinite(track.throttle) & np.isfinite(self.speed_rpm), axis=0),
            lost=track.esc_lost,
            shaking=track.vibration,
            clipping=track.clipping,
        )
        start = 0.0 if track.start_unix_s is None else track.start_unix_s
        longitude = track.origin.longitude_deg if track.origin else math.nan
        made = arm_figures(readings, flight=flight, day=local_day(start, longitude))
        starts = [check for check in takeoff_checks(track) if np.isfinite(check.lift_s)]
        last = starts[-1].motors if starts else ()
        figure = spool_up_figure([(one.speed_ratio, one.output_ratio) for one in last])
        return made if figure is None else replace(made, figures=(*made.figures, figure))


def flight_arm_figures(analysis: FlightAnalysis, *, flight: str) -> ArmFigures:
    """Return the figures of each arm in a flight, called `flight`: see `ArmRows.figures`."""
    return ArmRows.of(analysis).figures(flight)


class ArmsSoFar:
    """The arms of one vehicle in flights in progress, by the functions of a recorded one."""

    def __init__(self) -> None:
        """Start without rows."""
        self._begin()

    def _begin(self) -> None:
        """Begin another flight."""
        self._parts: list[ArmRows] = []
        self._answer: ArmAnswer | None = None
        self._due_s = self._landed_s = -math.inf

    def add(self, analysis: FlightAnalysis, rows: slice) -> list[ArmAnswer | None]:
        """Add the next N rows of an analysis, and return the answer by the flight so far at each.

        None before the first, and of an unknown aircraft. It is renewed after AGAIN_S, or once the
        flight is longer by GROWN, by the rows before that moment, so that it does not matter how
        the rows are cut. A take-off after LANDED_S on the ground begins another flight.
        """
        if analysis.no_verdict:
            self._begin()
            return [None] * len(range(analysis.track.time_s.size)[rows])
        new, first = ArmRows.of(analysis, rows), 0
        answers: list[ArmAnswer | None] = []

        def keep(row: int) -> None:
            """Keep the new rows before `row`."""
            nonlocal first
            if row > first:
                part = slice(first, row)
                arrays = {
                    f.name: getattr(new, f.name)[part] for f in fields(new) if f.name != "track"
                }
                self._parts.append(replace(new, track=new.track.rows(part), **arrays))
            first = row

        for row, (time_s, flying) in enumerate(
            zip(new.track.time_s.tolist(), new.track.flying.tolist(), strict=True)
        ):
            if self._is_another(new.track, row):
                keep(row)
                self._begin()
            if flying:
                self._landed_s = time_s
            elif not math.isfinite(self._landed_s):
                self._due_s = time_s + AGAIN_S  # not before it flies
            if time_s >= self._due_s:
                keep(row)
                self._renew(analysis.model, time_s)
            answers.append(self._answer)
        keep(len(answers))
        return answers

    def _is_another(self, track: FlightTrack, row: int) -> bool:
        """Return whether a row is of another flight than the rows before."""
        time_s = float(track.time_s[row])
        if row == 0 and self._parts:
            last = self._parts[-1].track
            if last.rotor_count != track.rotor_count or time_s <= last.time_s[-1]:
                return True
        return bool(track.flying[row]) and -math.inf < self._landed_s < time_s - LANDED_S

    def _renew(self, model: RotorModel, time_s: float) -> None:
        """Answer by all rows so far, at `time_s`."""
        if not self._parts:
            return
        self._parts = [ArmRows.joined(self._parts)]
        figures = self._parts[0].figures(IN_PROGRESS)
        self._answer = arm_answer([figures], model.arms, modes=mode_directions(model))
        so_far_s = time_s - float(self._parts[0].track.time_s[0])
        self._due_s = time_s + max(AGAIN_S, GROWN * so_far_s)


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
    causes of the arms that they name.
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
