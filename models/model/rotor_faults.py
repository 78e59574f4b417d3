"""Find rotors that lose thrust, and motors that do not reach the speed of their output, in flight.

Two tests of `checks.sudden_change` on means of BLOCK seconds, or of FEWEST_ROWS rows where those
take longer:
    propeller   y = Q' (N² - N_hat²)/mean(N_hat²), Q the layout's modes: collective, roll, pitch,
                yaw, and the other modes of more than four rotors. A lost share x of rotor i moves
                all modes by what the composition of effects says, mixer and torque included; turns
                and gusts move the modes one by one.
    motor       y_i = ln N_i² - ln f(x_i), less the median rotor's, f the autopilot's thrust curve:
                speed against output. A motor that reaches 1 - s of its speed moves its own by
                2 ln(1 - s) and no other; battery and air move all alike.
A row is predicted without the effects of manoeuvres (AS_INPUTS): those look up to two seconds
ahead. Load factor, rates and angular accelerations are inputs of the test instead, with
coefficients learned in the flight. So a fault is found from past rows alone.
A row is not used where the model is not valid (`RowLimit`): at a voltage impossible for these
cells, or in a fall; nor, for a second fault, while a motor is at full output.
A fault is reported when the ratio exceeds `THRESHOLD` and one rotor has the posterior probability
SURE. Its size lies between LEAST and MOST, and its interval narrows while the change is held; then
the size counts as known, and further changes are searched for from there, one back to sound
included.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache

import numpy as np

from thrustmargin.models.checks.loss_of_control import FULL_OUTPUT
from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.checks.sudden_change import Prior
from thrustmargin.models.checks.voltage import POSSIBLE_VOLTAGE
from thrustmargin.models.effects.base import TORQUE_SHARE, Placed
from thrustmargin.models.effects.compose import losses_of, rotor_speed_rpm, with_neutral_gaps
from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fault_test import (
    BLOCK,
    FAULT_SIZES,
    LEAST,
    MOST,
    FaultTest,
    Kind,
    RotorFault,
)
from thrustmargin.models.model.output_faults import (
    OutputWitness,
    of_outputs,
    output_test,
    square_of_outputs,
    undecided,
)
from thrustmargin.models.model.rotor_fade import UNKNOWN_DRIFT, RotorFade
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    model_channels,
    predict,
    table_of,
    without_state,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.margin import mixer
from thrustmargin.models.physics.motor_output import curve_of, output_curve

#: Least relative error of a step: half of RATIO
STEP_ERROR = 0.03
#: Without good flights: standard deviation of trims and of a block's noise, of a rotor's thrust
TRIM, NOISE = 0.1, 0.01
LEAK = 0.1  # share of an axis's demand that may show in another mode
STEEPNESS, LAG = 0.15, 0.2  # standard errors of the thrust curve (Quiver), and of a lag in s
IDLING = 0.05  # of full thrust, below which a motor's speed lags its output
UNLOADED = -0.2  # mean of y over the rotors below which the legs are on the ground
CHANGED = 30.0  # s on the ground in which a part can have been changed

FALLING = 6.0  # m/s downwards, faster than a descent: the air no longer meets the rotors from above
#: Effects that need later rows, and are inputs of the test instead.
AS_INPUTS = ("load_factor", "manoeuvre_moment")

FEWEST_ROTORS = 4
#: Least rows of a block, and the s that it may take to collect them: 3 s at 1 Hz.
FEWEST_ROWS, LONGEST_BLOCK = 3, 4.0
#: Times, s, and the faults that are present from then on.
FaultHistory = list[tuple[float, tuple[RotorFault, ...]]]


class RowLimit(IntEnum):
    """The faults that the rows of a block are allowed to show."""

    ANY = 0
    NO_SECOND_FAULT = 1  # a motor is at full output, so other rotors change as well
    NO_FAULT = 2  # the aircraft falls, or its battery has a voltage that none has


@lru_cache(maxsize=8)
def fault_model(model: RotorModel) -> RotorModel:
    """Return the model with which the fault tests compare a flight.

    It lacks the effects of AS_INPUTS, which the tests estimate themselves, and the state of later
    flights, which may contain the fault.
    """
    model = without_state(model)
    kept = tuple(effect for effect in model.effects if effect.name not in AS_INPUTS)
    return model if len(kept) == len(model.effects) else replace(model, effects=kept)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEpisode:
    """A fault of one flight, with the s from its first row at which it was found and ended
    (None: not yet)."""

    begin_s: float
    end_s: float | None
    fault: RotorFault  # as it was known last; of one that is over as it stood longest

    def holds(self, time_s: float) -> bool:
        """Return True if the fault is present at a time of the flight, s."""
        return self.begin_s <= time_s and (self.end_s is None or time_s < self.end_s)


class RotorFaults:
    """All fault tests of one vehicle, fed row by row; `current` lists the faults found and not
    cleared."""

    def __init__(self, model: RotorModel) -> None:
        # With fewer rotors than modes no rotor can be distinguished from a turn.
        """Start with the weak rotors that the model contains as present faults."""
        enough = model.airframe.rotor_count >= FEWEST_ROTORS
        self._modes = mode_directions(model)
        self._tests = [propeller_test(model, self._modes), motor_test(model)] if enough else []
        self._known = faults_in_model(model)
        for test in self._tests[:1]:
            test.forget(self._known)
        self._witness = OutputWitness(model.airframe.rotor_count)
        self._fade = rotor_fade(model, self._modes) if enough else None
        self._outputs = _output_test(model, self._modes) if enough else None
        self._rows: list[Floats] = []
        self._begun_s = self._landed_s = math.nan
        #: Faults after the last block, by kind; without kinds that could not be tested.
        self.tested: dict[Kind, tuple[RotorFault, ...]] = {}
        #: Times of changes, and the faults from then on.
        self.history: FaultHistory = []

    @property
    def current(self) -> tuple[RotorFault, ...]:
        """Return the present faults by kind and rotor."""
        found = [fault for test in self._tests for fault in self._current(test)]
        named = {rotor for fault in found for rotor in (fault.rotor, *fault.rotors)}
        others = (one for one in self._by_outputs if one.rotor not in named)
        return (*self._witness.assessed(found, self._known), *others)

    @property
    def _by_outputs(self) -> tuple[RotorFault, ...]:
        """Return the faults that the test of motor outputs shows."""
        return tuple(map(of_outputs, self._outputs.current)) if self._outputs else ()

    def _current(self, test: FaultTest) -> tuple[RotorFault, ...]:
        """Return the faults of a test, replaced by the slow fading of a rotor if that is larger."""
        fade, found = self._fade and self._fade.current, test.current
        if fade is None or test is not self._tests[0]:
            return found
        smaller = found and found[0].rotor == fade.rotor and found[0].size < fade.size
        return (fade,) if not found or (len(found) == 1 and smaller) else found

    def landed(self, time_s: float) -> None:
        """Report a row on the ground, at `time_s` s: the next row in flight begins a new flight,
        after CHANGED s perhaps with new parts."""
        if math.isnan(self._landed_s):
            self._landed_s, self._rows = time_s, []

    def add(self, time_s: float, row: Floats) -> bool:
        """Add a row of `fault_signals`, in flight and in order of time, s.

        Return True if the rows before it completed a block, after which `current` may have changed.
        A row without the squared speeds of all rotors only counts for time. After a time on the
        ground a new block begins, and after more than CHANGED s there earlier faults may have been
        repaired.
        """
        begins = math.isnan(self._begun_s) or not math.isnan(self._landed_s)
        if not math.isnan(self._landed_s):
            for test in self._tests:
                if time_s - self._landed_s > CHANGED:
                    test.forget(self._known if test is self._tests[0] else ())
                test.restart()
            self._witness.forget()
            if self._fade and self._outputs:
                if time_s - self._landed_s > CHANGED:
                    self._fade.restart()
                    self._outputs.forget()
                self._outputs.restart()
            self._landed_s = math.nan
        least = BLOCK if len(self._rows) >= FEWEST_ROWS else LONGEST_BLOCK
        whole = not begins and not 0.0 <= time_s - self._begun_s < least - 0.01
        if whole:
            self._close_block(self._rows)
            self._rows = []
        if whole or begins:
            self._record_history(time_s)
            self._begun_s = time_s
        # Between slow readings there are rows of other messages.
        if math.isfinite(np.add.reduce(row[1 : 1 + len(self._modes)])):
            self._rows.append(row)
            self._witness.add(row)
        return whole

    def _record_history(self, time_s: float) -> None:
        """Record the present faults in the history if they have changed."""
        current = self.current
        if current != (self.history[-1][1] if self.history else ()):
            self.history.append((time_s, current))

    def _close_block(self, of_block: Sequence[Floats] | Floats) -> None:
        """Pass the mean and slope of a completed block to the fault tests, and set `tested` to
        their results.

        `of_block` (N, 7 + 3 R) are rows of `fault_signals`. If some rows have measured speeds,
        those by outputs alone are dropped. With fewer than FEWEST_ROWS rows, or all at one time,
        nothing is tested and `tested` is empty. Rotor speed is tested only under load. If the
        `RowLimit` of a row forbids new faults, the tests keep their earlier results.
        """
        rotors, self.tested = len(self._modes), {}
        if not len(of_block) or not self._tests:
            return
        rows = np.array(of_block)
        # Rows by outputs alone are not mixed with measured ones.
        by_outputs = np.isnan(rows[:, 1 + rotors : 1 + 2 * rotors]).all(axis=1)
        by_outputs &= np.isfinite(rows[:, 1 + 2 * rotors : 1 + 3 * rotors]).all(axis=1)
        if not by_outputs.all():
            rows = rows[~by_outputs]
        if len(rows) < FEWEST_ROWS:
            return
        long = rows[-1, 0] - rows[0, 0]
        if long <= 0.0:
            return
        limit, coarse = max(rows[:, -1]), max(rows[:, -2])
        rows = rows[:, :-2]
        mean = np.add.reduce(rows[:, 1:], axis=0) / len(rows)
        slope = (rows[-1] - rows[0])[1:] / long
        excess, motors = mean[:rotors], mean[rotors : 2 * rotors]
        turns = np.concatenate([mean[3 * rotors :], slope[3 * rotors + 1 :]])
        # A sum is finite only if all its terms are, and faster than testing each.
        loaded = UNLOADED < np.add.reduce(excess) / rotors < math.inf
        may_find = self._may_change(limit)
        if loaded and self._outputs and by_outputs.all():
            if may_find:
                self._outputs.add(self._begun_s, excess @ self._modes, turns[None])
            self.tested["propeller"] = self._by_outputs
        elif loaded:
            if may_find:
                self._tests[0].add(self._begun_s, excess @ self._modes, turns[None])
                # While a sudden change is present, a slow one cannot be distinguished from it.
                if self._fade and not self._tests[0].current:
                    self._fade.add(float(rows[0, 0]), excess @ self._modes, coarse)
            found = self._current(self._tests[0])
            self.tested["propeller"] = self._witness.assessed(found, self._known)
        if math.isfinite(np.add.reduce(motors)):
            outputs = slice(2 * rotors, 3 * rotors)
            moves = np.array([motors, mean[outputs], slope[outputs]]).T
            moves -= _median(moves)
            if may_find:
                self._tests[1].add(self._begun_s, moves[:, 0], moves[:, 1:])
            self.tested["motor"] = self._tests[1].current

    def _may_change(self, limit: float) -> bool:
        """Return True if a block of rows may add or clear faults; `limit` is its largest
        `RowLimit`."""
        return limit < (RowLimit.NO_SECOND_FAULT if self.current else RowLimit.NO_FAULT)


@lru_cache(maxsize=1)  # a replay needs it twice, which takes seconds for an hour of flight
def fault_history(analysis: FlightAnalysis) -> FaultHistory:
    """Return the changes of a whole flight's faults: each time, s, and the faults from then on.

    They equal those of the live alarms. Empty if the aircraft is unknown (`no_verdict`).
    """
    if analysis.no_verdict:
        return []
    found, track = RotorFaults(analysis.model), analysis.track
    if not track.reports("rotor_speed_rpm"):  # such as a plan: only faults in the model
        return [
            (float(at), found.current) for at in track.time_s[track.flying][:1] if found.current
        ]
    for row, signals in enumerate(fault_signals(analysis, slice(None))):
        if track.flying[row]:
            found.add(float(track.time_s[row]), signals)
        else:
            found.landed(float(track.time_s[row]))
    open_pairs = analysis.airframe_match.open_pairs
    return [(time_s, undecided(faults, open_pairs)) for time_s, faults in found.history]


def _median(values: Floats) -> Floats:
    """Return the median over the first axis, NaN where one value is; ten times as fast as
    np.median for few values."""
    order, half = np.sort(values, axis=0), len(values) // 2
    return (order[half] + order[(len(values) - 1) // 2]) / 2.0 + 0.0 * order[-1]


def fault_episodes(history: FaultHistory) -> tuple[FaultEpisode, ...]:
    """List the faults of a flight with begin and end, in the order in which they were found.

    A fault that ended has the bounded size that lasted longest, because a part that becomes sound
    again passes through smaller ones. One still present has its last size.
    """
    open_now: dict[tuple[str, tuple[int, ...]], FaultEpisode] = {}
    stood: dict[tuple[str, tuple[int, ...]], list[tuple[float, RotorFault]]] = {}
    over: list[FaultEpisode] = []
    for time_s, faults in history:
        current = {(fault.kind, fault.rotors or (fault.rotor,)): fault for fault in faults}
        # What was named and is now of one of several goes on.
        for kind, rotors in current.keys() - open_now.keys():
            for rotor in rotors if len(rotors) > 1 else ():
                if (before := open_now.pop((kind, (rotor,)), None)) is not None:
                    open_now[kind, rotors] = before
        for key in open_now.keys() - current.keys():
            fault = _stood_longest(stood.pop(key), time_s)
            ended = replace(open_now.pop(key), end_s=time_s, fault=fault)
            found = {(f.kind, r) for f in faults for r in (f.rotor, *f.rotors)}
            # One whose rotor has become known is not listed twice.
            if not any((key[0], rotor) in found for rotor in ended.fault.rotors):
                over.append(ended)
        for key, fault in current.items():
            begin_s = open_now[key].begin_s if key in open_now else time_s
            open_now[key] = FaultEpisode(begin_s=begin_s, end_s=None, fault=fault)
            stood.setdefault(key, []).append((time_s, fault))
    return tuple(sorted([*over, *open_now.values()], key=lambda episode: episode.begin_s))


def _stood_longest(stood: Sequence[tuple[float, RotorFault]], end_s: float) -> RotorFault:
    """Return the version of a fault that lasted longest among those with a bounded size.

    `stood` are its versions with the time, s, at which each began, in order; the last one lasts
    until `end_s`. The last version if none is bounded.
    """
    ends = [time_s for time_s, _ in stood[1:]] + [end_s]
    known = [
        (until - since, fault)
        for (since, fault), until in zip(stood, ends, strict=True)
        if fault.upper < MOST
    ]
    return max(reversed(known), key=lambda one: one[0])[1] if known else stood[-1][1]


@lru_cache(maxsize=8)
def faults_in_model(model: RotorModel) -> tuple[RotorFault, ...]:
    """List the rotors whose thrust loss in the model is at least LEAST, as faults with intervals.

    A loss that the model includes is not repaired: the fault stays until a flight shows the rotor
    without it.
    """
    found = []
    for rotor, loss in losses_of(model.effects).items():
        if loss.value >= LEAST:
            lower, upper = max(loss.ci95[0], 0.0), loss.ci95[1]
            found.append(
                RotorFault(
                    kind="propeller", rotor=rotor - 1, size=loss.value, lower=lower, upper=upper
                )
            )
    return tuple(found)


@lru_cache(maxsize=8)
def _sound_speed_ratio(model: RotorModel) -> Floats:
    """Return the ratio (R,) of each rotor's predicted speed without the model's weak rotors to that
    with them.

    Computed in hover with half a tank. Predictions are multiplied by the ratio, so that the fault
    tests compare a flight with an aircraft without faults.
    """
    weak = {fault.rotor for fault in faults_in_model(model)}
    kept = tuple(r for r in model.effects if r.loss is None or (r.rotor or 0) - 1 not in weak)
    both = [_hover_rpm(replace(model, effects=of)) for of in (kept, model.effects)]
    return both[0] / both[1]


def _hover_rpm(model: RotorModel) -> Floats:
    """Return the rotor speeds (R,) rpm of a model in hover with half a tank."""
    half = 0.5 * model.airframe.tank_capacity_kg
    row = np.zeros(1)
    track = FlightTrack.of(
        name="hover",
        time_s=row,
        rotor_count=model.airframe.rotor_count,
        airspeed=row,
        tank_kg=row + half,
    )
    placed = [with_neutral_gaps(item) for item in model.placed]
    return rotor_speed_rpm(table_of(model), placed, model_channels(model, track))[0]


def fault_signals(analysis: FlightAnalysis, rows: slice) -> Floats:
    """Return the inputs (N, 7 + 3 R) of the fault tests, for the N rows `rows` of R rotors.

    Columns, with N_r the measured rotor speed and f_r the thrust over that of full output, which
    `output_curve` gives from the motor output:

    - 1: time, s
    - R: N_r² less the predicted square, over the mean predicted square of all rotors
    - R: ln N_r² - ln f_r, rpm²
    - R: ln f_r
    - 4: load factor - 1, then the body rates, rad/s; 0 where unknown
    - 1: standard error due to coarsely stepped speeds, as a share of thrust; equal in all rows
    - 1: `RowLimit`

    ln f_r is NaN where f_r is at or below IDLING or unknown. Later rows still change the last
    `fault_model(model).look_ahead_s` of the analysis; rows before them are final.

    Where the speeds of all rotors are inferred from motor outputs, the excess is that of the
    outputs, and ln N_r² - ln f_r is NaN (`output_faults`). Where those of some are, these rotors
    are NaN, because motors differ from each other by more than the faults searched for.
    """
    track = analysis.track
    measured = np.where(analysis.from_outputs[rows], np.nan, track.rotor_speed_rpm[rows])
    model = fault_model(analysis.model)
    prediction = analysis.prediction
    if model is not analysis.model and not analysis.no_verdict:
        prediction = predict(model, track, analysis.density, start=analysis.start)
    predicted = prediction.rotor_speed_rpm[rows]
    if faults_in_model(analysis.model):
        predicted = predicted * _sound_speed_ratio(analysis.model)
    curve = output_curve({}, track.source("throttle"))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = curve.thrust_share(track.throttle[rows])
        own = curve_of(track.source("rotor_speed_rpm"), track.source("throttle"))
        square = np.where(
            np.all(analysis.from_outputs[rows], axis=1, keepdims=True),
            square_of_outputs(track.rotor_speed_rpm[rows], own.thrust_share(track.throttle[rows])),
            measured**2,
        )
        excess = (square - predicted**2) / np.mean(predicted**2, axis=1, keepdims=True)
        output = np.log(np.where(share > IDLING, share, np.nan))
        motors = np.log(measured**2) - output
    load = np.linalg.norm(track.specific_force_frd[rows], axis=1) / G0 - 1.0
    turning = np.column_stack([load, track.angular_rate_frd[rows]])
    turning = np.where(np.isfinite(turning), turning, 0.0)
    limits = _row_limits(track.rows(rows), analysis.model.airframe)
    scatter = reading_scatter(track)
    coarse = 2.0 * scatter.share.max(initial=0.0) if scatter.in_steps else 0.0
    columns = [track.time_s[rows], excess, motors, output, turning]
    return np.column_stack([*columns, np.full(limits.size, coarse), limits])


def _row_limits(track: FlightTrack, airframe: Airframe) -> Floats:
    """Return the `RowLimit` (T,) of each row: which faults it may show. An unknown channel
    limits nothing."""
    with np.errstate(invalid="ignore"):
        full = (track.throttle >= FULL_OUTPUT).any(axis=1)
        dead = track.voltage < POSSIBLE_VOLTAGE[0] * airframe.nominal_voltage
        falls = track.velocity_ned[:, 2] > FALLING
    limits = np.where(full, RowLimit.NO_SECOND_FAULT, RowLimit.ANY)
    return np.where((dead & (track.voltage > 0.0)) | falls, RowLimit.NO_FAULT, limits)


def mode_directions(model: RotorModel) -> Floats:
    """Return orthonormal columns (R, R): collective, roll, pitch, yaw, and the other modes of
    the layout."""
    rows = mixer(model.airframe)
    rotors = rows.shape[1]
    return np.linalg.qr(np.concatenate([rows.T, np.eye(rotors)], axis=1))[0][:, :rotors]


@lru_cache(maxsize=8)  # for each of many vehicles
def loss_steps(model: RotorModel) -> tuple[Floats, Floats]:
    """Return the change (R, J, R) of all rotors' excess by a loss of each of J sizes on each rotor.

    The excess is the squared speed less the predicted one, over the mean predicted square; computed
    in hover with half a tank. Axis 0 is the bad rotor. Also return the standard error (R, J, R) of
    the changes, due to the unknown torque of the bad rotor relative to its thrust.
    """
    rotors, rows = model.airframe.rotor_count, np.zeros(FAULT_SIZES.size)
    track = FlightTrack.of(
        name="hover",
        time_s=np.arange(FAULT_SIZES.size, dtype=np.float64),
        rotor_count=rotors,
        airspeed=rows,
        tank_kg=rows + 0.5 * model.airframe.tank_capacity_kg,
    )
    x, table = model_channels(model, track, effects=()), table_of(model)

    def square(*placed: Placed) -> Floats:
        """Return squared rotor speeds (J, R), rpm², with some effects."""
        return rotor_speed_rpm(table, placed, x) ** 2

    def excess(rotor: int, torque_share: float) -> Floats:
        """Return the excess (J, R) by the loss of one rotor."""
        values = {"loss": FAULT_SIZES, "torque_share": torque_share}
        bad = Placed(effect=ROTOR_DEGRADATION, values=values, rotor=rotor)
        return (square(bad) - sound) / np.mean(sound)

    sound, middle = square(), TORQUE_SHARE.start
    steps = np.array([excess(i, middle) for i in range(rotors)])
    return steps, np.array([excess(i, middle + TORQUE_SHARE.scale) for i in range(rotors)]) - steps


def _good_trim(model: RotorModel) -> tuple[Floats, int] | None:
    """Return twice the standard deviation (R,) of each rotor speed mode between fault-free flights.

    It is relative to the rotor speed in hover with half a tank; the second value is the number of
    flights, 0 if unknown. None if the model contains no standard deviations.
    """
    good = model.good_flights
    of_mode = good.mode_scatter_rpm if good else model.background_rpm
    flights = good.flights if good else model.training_domain and len(model.training_domain.flights)
    if not of_mode:
        return None
    hover = model.base_speed(np.zeros(1), np.full(1, 0.5 * model.airframe.tank_capacity_kg))
    return 2.0 * np.array(of_mode) / float(hover.mean()), flights or 0


def trim_known(model: RotorModel) -> bool:
    """Return True if the model knows from fault-free flights how the rotors share the thrust.

    Otherwise a constant difference between rotors may be an off-centre mass as well as a weak
    rotor, and only a change in flight is found.
    """
    return _good_trim(model) is not None


def rotor_fade(model: RotorModel, modes: Floats) -> RotorFade:
    """Return the test for a slow loss of thrust, by the modes (R, R) of a model's layout."""
    steps, torque = (a @ modes for a in loss_steps(model))
    good = _good_trim(model)
    drift = np.full(len(modes), UNKNOWN_DRIFT) if good is None else 0.5 * good[0]
    return RotorFade(steps, np.hypot(torque, STEP_ERROR * steps), drift)


def propeller_test(model: RotorModel, modes: Floats) -> FaultTest:
    """Return the test for a sudden loss of a rotor's thrust, in modal signals.

    `modes` (R, R) has the direction of each signal as a column (`mode_directions`).
    """
    rotors = model.airframe.rotor_count
    size = math.sqrt(rotors)
    steps, torque = (a @ modes for a in loss_steps(model))
    trim, flights = _good_trim(model) or (np.full(rotors, TRIM * size), 0)
    prior = Prior(
        trim=trim,
        noise=np.full(rotors, NOISE * size),
        inputs=_turn_inputs(model),
        flights=flights,
    )
    return FaultTest("propeller", steps, np.hypot(torque, STEP_ERROR * steps), prior)


def _turn_inputs(model: RotorModel) -> Floats:
    """Return the prior standard deviations (R, 7) of the response of R modes to seven inputs.

    Columns: load factor, three body rates (rad/s), the three slopes of the rates (rad/s²). Values
    are shares of hover thrust per unit of the input. Rows are in the order of `mode_directions`; a
    mode responds to the input of its own axis in full, and to any other input by the share LEAK,
    never zero. A rate has the same value as its slope.
    """
    airframe = model.airframe
    rotors, size = airframe.rotor_count, math.sqrt(airframe.rotor_count)
    # What a load factor of 2, or 1 rad/s² of a body all of whose mass sits at the rotors, needs.
    arm = airframe.arm
    turn = np.array([G0, arm, arm, arm**2 / airframe.torque_ratio]) * size / G0
    inputs = np.tile(LEAK * turn, (rotors, 1))
    inputs[range(4), range(4)] /= LEAK
    return np.column_stack([inputs, inputs[:, 1:]])


def _output_test(model: RotorModel, modes: Floats) -> FaultTest:
    """Return the test for a sudden change of motor outputs, by the modes (R, R) of a layout."""
    steps, torque = (a @ modes for a in loss_steps(model))
    return output_test(steps, np.hypot(torque, STEP_ERROR * steps), _turn_inputs(model))


def motor_test(model: RotorModel) -> FaultTest:
    """Return the test for a motor that turns more slowly than its output demands, in R signals.

    A signal is ln of squared speed less ln of the thrust share of the output, less the rotors'
    median.
    """
    rotors = model.airframe.rotor_count
    steps = 2.0 * np.log1p(-FAULT_SIZES)[:, None] * np.eye(rotors)[:, None, :]
    each = np.ones(rotors)
    prior = Prior(
        trim=TRIM * each,
        noise=NOISE * each,
        inputs=np.outer(each, [STEEPNESS, LAG]),
        alone=False,
    )
    return FaultTest("motor", steps, STEP_ERROR * abs(steps), prior)
