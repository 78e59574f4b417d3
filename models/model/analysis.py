"""Summarise how much of the rotors' thrust a flight used: lasting use, passing use, no reserve.

    lasting use    of each rotor the running median of its thrust utilisation over 15 s
    passing use    above the limit for a shorter time: a turn, a climb, a gust
    spent          over 90 % of the largest thrust for a second or more

The limit is on lasting use: at 50 % a quad that loses a rotor can still carry its weight
(margin.py), which depends on weight, not on a turn. Turns at a line end take 4 to 7 s; a median
over 15 s follows use that lasts longer than half of that, and ignores a shorter turn. Where the log
pauses within the window, the seconds with data must suffice. In a turn the question is whether
thrust is left to hold the attitude: ArduPilot's own check for a loss of thrust begins at 90 %, for
a second (ArduCopter, crash_check.cpp).

Run one flight through its model: prediction, ceiling, utilisation, margin and redundancy per
row.

Replay, report and monitor all show these arrays; none of them computes its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.instruments import with_air_temperature
from thrustmargin.models.checks.loss_of_control import FULL_OUTPUT
from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.effects.base import FlightState as FlightState
from thrustmargin.models.effects.channels import own_channels
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.aircraft_change import AircraftChange
from thrustmargin.models.model.airframe_match import AirframeMatch, match_airframe, unknown_aircraft
from thrustmargin.models.model.inferred.load_inference import with_load_for_verdict
from thrustmargin.models.model.inferred.speed_basis import SpeedBasis as SpeedBasis
from thrustmargin.models.model.inferred.speed_basis import speed_basis
from thrustmargin.models.model.inferred.utilisation_error import (
    INTERVAL,
    beyond_load,
    redundancy_error,
    utilisation_error,
)
from thrustmargin.models.model.rotor_model import Basis as Basis
from thrustmargin.models.model.rotor_model import Prediction as Prediction
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    identified_airframe,
    predict,
    temperature_offset,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.margin import (
    ceiling,
    redundancy,
    rotor_thrust,
    trimmable_loss,
    utilisation,
    weight,
    yaw_reserve,
)
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import VehicleFacts

LASTING_S = 15  # s
SPENT = 0.9  # of the largest thrust
MEDIAN_ERROR = 1.2533  # standard error of a median over that of the mean, of normal scatter
ALONE_S = 2.0  # s in which only one rotor had no reserve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustUse:
    """Thrust utilisation of the worst rotor of one flight; NaN where unknown."""

    lasting_most: float  # with the ends of its 90 % interval
    lasting_low: float
    lasting_high: float
    lasting_above_limit_s: float  # s with the lasting use above the limit
    above_limit_s: float  # s above the limit in all
    known_s: float  # s in flight with a known use
    step_s: float  # median s from one such row to the next
    peak: float
    passing: int  # number of times above the limit, lasting use excepted
    passing_longest_s: float
    #: s in which a rotor surely had no reserve, by the outputs too where they are known
    spent_s: float
    spent_alone: int | None  # rotor, from 0, that most of this time was the only one
    lasting: Floats  # (T,)
    reach: Floats  # (T,) high end of its 90 % interval minus `lasting`
    surely_above: Bools  # (T,) rows whose lasting use is above the limit with its whole interval
    maybe_above: Bools  # (T,) rows whose interval reaches above the limit


def thrust_use(analysis: FlightAnalysis, limit: float) -> ThrustUse:
    """Summarise the utilisation of a flight: typical, lasting and worst, and time above `limit`.

    `limit` is the share of a rotor's largest thrust that may last.
    """
    track, outputs = analysis.track, analysis.airframe_match.outputs
    use = np.where(track.flying[:, None], analysis.known_utilisation, np.nan)
    second, means = _second_means(track.time_s, use)
    above, beyond = (
        _second_means(track.time_s, INTERVAL * np.where(np.isfinite(use), error, np.nan))[1]
        for error in (analysis.utilisation_error, analysis.utilisation_beyond)
    )
    seen = np.isfinite(means)
    silent = _silent_seconds(track, second, seen.shape[0])
    medians = _lasting_use(means, silent)[_window_centres(np.any(seen, axis=1) | silent)]
    medians[~seen] = np.nan
    most, which = worst_rotor(medians)
    known = np.isfinite(most)
    up, down = np.zeros((2, most.size))
    cells = np.flatnonzero(known), which[known].astype(int)
    up[known] = np.nan_to_num(above[cells])
    down[known] = up[known] - np.nan_to_num(beyond[cells])
    scatter = reading_scatter(track)
    of_second, of_median = (2.0 * INTERVAL * scatter.of_mean(s) for s in (1.0, LASTING_S))
    single = MEDIAN_ERROR * of_median[cells[1]] * most[known]
    up[known], down[known] = np.hypot(up[known], single), np.hypot(down[known], single)
    now = worst_rotor(means)[0]
    flown = np.where(track.flying, track.row_seconds, 0.0)
    length = np.bincount(second, weights=flown).astype(np.float64)
    with np.errstate(invalid="ignore"):
        lasting_above, over = most > limit, now > limit
        surely, maybe = most - down > limit, most + up > limit
        # Speeds that read too high give the largest thrust while the outputs are lower.
        least = means * (1.0 if outputs is None else outputs.share_of_speeds)
        spent = least - np.hypot(np.nan_to_num(above - beyond), of_second * means) > SPENT
    if not known.any():  # without an airframe: full output means no reserve
        output = np.where(track.flying[:, None], track.throttle, np.nan)
        full = np.nan_to_num(_second_means(track.time_s, output)[1]) >= FULL_OUTPUT
        # No aircraft flies for long with all outputs full: their range was misread.
        spent = full & (length[full.all(axis=1)].sum() < 0.5 * length.sum())
    passed = _run_lengths(over & ~lasting_above, length)
    rows = np.isfinite(use).any(axis=1)
    top = int(np.nanargmax(most)) if known.any() else 0
    nothing = float("nan")
    return ThrustUse(
        lasting_most=float(most[top]) if known.any() else nothing,
        lasting_low=float(max((most - down)[top], 0.0)) if known.any() else nothing,
        lasting_high=float(max(most[top], min((most + up)[top], 1.0))) if known.any() else nothing,
        lasting_above_limit_s=float(length[lasting_above].sum()),
        above_limit_s=float(track.row_seconds[analysis.above_limit(limit)].sum()),
        known_s=float(track.row_seconds[rows].sum()),
        step_s=known_median(np.diff(track.time_s[rows])),
        peak=float(np.nanmax(use)) if rows.any() else nothing,
        passing=len(passed),
        passing_longest_s=max(passed, default=0.0),
        spent_s=float(length[spent.any(axis=1)].sum()),
        spent_alone=_exhausted_rotor(spent, length),
        lasting=most[second],
        reach=up[second],
        surely_above=surely[second] & track.flying,
        maybe_above=maybe[second] & track.flying,
    )


def _exhausted_rotor(spent: Bools, length: Floats) -> int | None:
    """Return the rotor, from 0, that spent the longest time as the only one at its largest thrust.

    `spent` (S, R) flags rotors at their largest thrust in each second, `length` (S,) is the time
    flown in it, s. Return None unless that rotor's time is ALONE_S or more, and over half of the
    time with any rotor at its largest thrust. A turn exhausts two rotors, a climb all; a single
    one is weak or bears an off-centre load.
    """
    alone = np.where((spent.sum(axis=1) == 1)[:, None], spent, False) * length[:, None]
    seconds = alone.sum(axis=0)
    most = float(seconds.max(initial=0.0))
    lasting = most >= ALONE_S and most > 0.5 * length[spent.any(axis=1)].sum()
    return int(np.argmax(seconds)) if lasting else None


def _window_centres(known: Bools) -> NDArray[np.intp]:
    """Return for each of S seconds the index (S,) of the second whose window of LASTING_S s to use.

    That is the nearest second whose whole window lies in the same stretch of seconds flagged in
    `known` (S,), or the stretch's middle if there is none: half a window, at the end of a stretch,
    would count a short use as lasting.
    """
    at, half, rows = np.arange(known.size), LASTING_S // 2, np.flatnonzero(known)
    for stretch in np.split(rows, np.flatnonzero(np.diff(rows) > half) + 1) if rows.size else ():
        first, last = int(stretch[0]), int(stretch[-1])
        middle = (first + last) // 2
        inside = min(first + half, middle), max(last - half, middle)
        at[first : last + 1] = np.clip(at[first : last + 1], *inside)
    return at


def _silent_seconds(track: FlightTrack, second: NDArray[np.int64], count: int) -> Bools:
    """Flag the seconds (S,) without a row, in a pause of the log with flight before and after it.

    `second` (T,) is the number of each row's second, from 0; `count` is S.
    """
    on = np.diff(track.time_s) > track.row_seconds[:-1]
    on &= track.flying[:-1] & track.flying[1:]
    found = np.zeros(count, dtype=np.bool_)
    for row in np.flatnonzero(on).tolist():
        found[second[row] + 1 : second[row + 1]] = True
    return found


def _lasting_use(means: Floats, silent: Bools) -> Floats:
    """Return a lower bound (S, R) of the running median over LASTING_S seconds of means (S, R).

    `means` has one row a second. Seconds flagged in `silent` (S,), in a pause of the log, count as
    0, but the result is at least the lowest known mean of the window. NaN without a known mean in
    the window.
    """
    seen = np.isfinite(means)
    least = running_median(np.where(silent[:, None] & ~seen, 0.0, means), LASTING_S)
    half = LASTING_S // 2
    padded = np.pad(np.where(seen, means, np.inf), ((half, half), (0, 0)), constant_values=np.inf)
    lowest = np.lib.stride_tricks.sliding_window_view(padded, LASTING_S, axis=0).min(axis=-1)
    return np.fmax(least, np.where(np.isfinite(lowest), lowest, np.nan))


def running_median(values: Floats, window: int) -> Floats:
    """Return the median (S, R) of the finite values among the `window` rows centred on each row.

    NaN where none of them is finite.
    """
    half = window // 2
    padded = np.pad(values, ((half, half), (0, 0)), constant_values=np.nan)
    around = np.sort(np.lib.stride_tricks.sliding_window_view(padded, window, axis=0), axis=-1)
    count = np.isfinite(around).sum(axis=-1, keepdims=True)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    pick = np.take_along_axis(around, np.minimum(low, window - 1), axis=-1)
    other = np.take_along_axis(around, np.minimum(high, window - 1), axis=-1)
    return np.where(count > 0, 0.5 * (pick + np.where(count > 0, other, pick)), np.nan)[..., 0]


def _second_means(time_s: Floats, values: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return the number (T,) of each row's second, and the means (S, R) of known values by second.

    A pause of the log is shortened to LASTING_S + 1 s. A mean without known values is NaN.
    """
    whole = np.floor(time_s - time_s[0]) if time_s.size else time_s
    steps = np.clip(np.diff(whole, prepend=0.0), 0.0, LASTING_S + 1.0)
    second = np.cumsum(steps).astype(np.int64)
    count, total = (
        np.zeros((int(second[-1]) + 1 if second.size else 0, values.shape[1])) for _ in range(2)
    )
    known = np.isfinite(values)
    np.add.at(count, second, known)
    np.add.at(total, second, np.where(known, values, 0.0))
    return second, np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


def _run_lengths(on: Bools, seconds: Floats) -> list[float]:
    """List the lengths, s, of the runs of True in `on` (S,), with `seconds` (S,) s in each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    sums = np.concatenate([[0.0], np.cumsum(seconds)])
    return [float(sums[b] - sums[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]


GIVEN_AIR = state("air given")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightAnalysis:
    """The prediction, thrust utilisation, margins and redundancy of one flight of T rows and R
    rotors."""

    track: FlightTrack
    model: RotorModel
    density: Floats  # (T,) kg/m³
    density_error: Floats  # (T,) kg/m³, standard error
    density_given: bool  # by the caller, not made from the track
    density_basis: Statement
    voltage_basis: Statement
    prediction: Prediction
    residual_rpm: Floats  # (T, R) measured minus predicted; NaN where the load was inferred from it
    max_rotor_speed_rpm: Floats  # (T,) rpm, ceiling at the battery's voltage
    max_thrust: Floats  # (T, R) N
    thrust: Floats  # (T, R) N from rotor speeds, measured or made from motor outputs
    utilisation: Floats  # (T, R) from the same speed
    utilisation_error: Floats  # (T, R) standard error of `known_utilisation`, high side
    utilisation_beyond: Floats  # (T, R) part of that error on the high side alone
    utilisation_predicted: Floats  # (T, R) from the predicted rotor speed
    weight: Floats  # (T,) N of the vehicle with its liquid
    redundancy_yaw_kept: Floats  # (T,) worst single rotor lost: holdable thrust over weight
    redundancy_yaw_uncontrolled: Floats  # (T,) likewise, with yaw uncontrolled
    redundancy_error: Floats  # (T,) standard error of ln redundancy, low side
    redundancy_beyond: float  # part of that error on the low side alone
    trimmable_loss: Floats  # (T,) largest share of one rotor's thrust that can be lost in trim
    airframe_match: AirframeMatch  # grounds on which it is a flight of the model's airframe
    start: FlightState | None = None  # state of the effects before the first row
    #: kg of load by hover thrust beyond gauge or statement, where they surely differ; else 0.
    beyond_gauge_kg: float = 0.0
    #: A rotor or motor is bad: see `with_bad_part`.
    bad_part: bool = False
    #: How the flight differs from the flights of its known aircraft before it.
    change: AircraftChange | None = None

    def __repr__(self) -> str:
        def worst(use: Floats) -> str:
            return f"{np.nanmin(1.0 - use):.1%}" if np.isfinite(use).any() else "unknown"

        error = self.residual_rpm[np.isfinite(self.residual_rpm)]
        off = f"{np.sqrt(np.mean(error**2)):.1f} rpm" if error.size else "unknown"
        return (
            f"FlightAnalysis of {self.track.name}: {self.track.time_s.size} rows, "
            f"{self.track.duration:.1f} s\n"
            f"  model: {self.model.description}\n"
            f"  least thrust margin {worst(self.utilisation)} {self.speed_basis}, "
            f"{worst(self.utilisation_predicted)} predicted; rotor speed error {off} RMS\n"
            f"  air: {self.density_basis}\n  ceiling: {self.voltage_basis}"
            + (f"\n  airframe: {self.airframe_match}" if str(self.airframe_match) else "")
        )

    def state_at(self, row: int) -> FlightState:
        """Return the state of the model's effects after `row`, with which the next window starts.

        Raises IndexError for a row that the track does not have.
        """
        rows = range(self.track.time_s.size)[row] + 1
        effects = [p.effect for p in self.model.placed if p.effect.own_channel is not None]
        if not effects:
            return FlightState()
        before = self.track.rows(slice(0, rows))
        return own_channels(before, self.model.airframe, effects, self.start)[1]

    @property
    def no_verdict(self) -> tuple[Statement, ...]:
        """Return the reasons why the flight is not analysed with an airframe; empty if it is.

        With a reason, all figures that need the airframe, as margins, are NaN.
        """
        return self.airframe_match.no_verdict

    @property
    def places(self) -> tuple[str, ...]:
        """Return the name of each rotor's arm; empty strings if the motor order is not the
        airframe's."""
        names = self.model.airframe.rotor_names
        return ("",) * len(names) if self.airframe_match.other_order else names

    @property
    def placed(self) -> bool:
        """Return True if the arm of each rotor is known, so that the rotor may be drawn there."""
        return not (self.airframe_match.no_verdict or self.airframe_match.other_order)

    @property
    def margin(self) -> Floats:
        """Return the thrust margin (T, R), 1 - utilisation, by measured or output-based rotor
        speeds."""
        return 1.0 - self.utilisation

    @property
    def margin_predicted(self) -> Floats:
        """Return the thrust margin (T, R) by predicted rotor speeds, which are of sound rotors.

        NaN where a rotor or motor is known to be bad.
        """
        return np.where(self.bad_part, np.nan, 1.0 - self.utilisation_predicted)

    @property
    def yaw_reserve(self) -> Floats:
        """Return the unused share (T,) of the yaw authority, by measured or inferred rotor speeds.

        NaN where a speed is unknown, and everywhere if the aircraft is unknown (`no_verdict`).
        """
        airframe = identified_airframe(self.model)
        if self.no_verdict or not airframe.rotor_count:
            return np.full(self.track.time_s.size, np.nan)
        return yaw_reserve(airframe, self.utilisation * airframe.rotor_effectiveness)

    @property
    def any_measured(self) -> Bools:
        """Flag the rows (T,) in which at least one rotor has a speed, measured or inferred from its
        motor output."""
        return np.any(np.isfinite(self.utilisation), axis=1)

    @property
    def known_utilisation(self) -> Floats:
        """Return the thrust utilisation (T, R) that screen, alarms and report use.

        It is by rotor speeds where at least one rotor of the row has one; a rotor without a speed
        is then NaN, because a prediction should not be compared with measurements. In other rows it
        is predicted.
        """
        return np.where(self.any_measured[:, None], self.utilisation, self.utilisation_predicted)

    @property
    def use_ends(self) -> tuple[Floats, Floats]:
        """Return the low and the high end (T, R) of the 90 % interval of the known utilisation.

        NaN where the utilisation is unknown. Where its error is unknown both ends are the value.
        The high end exceeds 1 only if the value does.
        """
        use = self.known_utilisation
        down, up = (INTERVAL * np.nan_to_num(error) for error in self.row_errors)
        return np.maximum(use - down, 0.0), np.minimum(use + up, np.maximum(use, 1.0))

    @property
    def row_errors(self) -> tuple[Floats, Floats]:
        """Return the standard errors (T, R) of the known utilisation in single rows, to the low and
        the high side.

        They include the scatter of the single speed readings.
        """
        single = 2.0 * reading_scatter(self.track).share * self.utilisation
        low = self.utilisation_error - self.utilisation_beyond
        errors = (low, self.utilisation_error)
        one, other = (np.hypot(error, np.nan_to_num(single)) for error in errors)
        return one, other

    @property
    def from_outputs(self) -> Bools:
        """Flag the rotor speeds (T, R) that were inferred from the motor's output, not measured."""
        error = self.track.standard_errors.get("rotor_speed_rpm")
        return np.zeros(self.utilisation.shape, bool) if error is None else error > 0.0

    @property
    def speed_basis(self) -> SpeedBasis:
        """Return the basis of the flight's rotor speeds: measured, from motor outputs, or both."""
        return speed_basis(self.track)

    def basis_of(self, row: int, rotor: int) -> SpeedBasis:
        """Return the basis of a rotor's margin in a row: measured, outputs, predicted or
        unknown."""
        if np.isfinite(self.utilisation[row, rotor]):
            inferred = self.from_outputs[row, rotor]
            return SpeedBasis.MOTOR_OUTPUTS if inferred else SpeedBasis.MEASURED
        known = np.isfinite(self.utilisation_predicted[row, rotor])
        return SpeedBasis.PREDICTED if known else SpeedBasis.UNKNOWN

    def above_limit(self, limit: float) -> Bools:
        """Flag the rows (T,) in flight in which the known utilisation of a rotor exceeds `limit`.

        One rotor is enough, whatever is known of the others: an ESC without readings hides no
        overload.
        """
        with np.errstate(invalid="ignore"):
            return self.track.flying & np.any(self.known_utilisation > limit, axis=1)


def analyse(
    track: FlightTrack,
    model: RotorModel,
    density: Floats | None = None,
    *,
    start: FlightState | None = None,
    airframe_match: AirframeMatch | None = None,
) -> FlightAnalysis:
    """Run one flight of T rows and R rotors through the model.

    `density` (T,) kg/m³ replaces the one made from the track's own pressure or altitude. A figure
    is NaN in rows without a channel that it needs: thrust and utilisation need rotor speed; weight,
    redundancy and trimmable loss need the tank. Voltage and density have stated fallbacks.

    `airframe_match` is the result of comparing the flight with the model's airframe; without it the
    airframe counts as stated by the user, and the flight is compared with it here. If a comparison
    contradicts, the analysis is that of an unknown aircraft: its margins are NaN.

    A track may be a window of a flight: its `time_s` counts from the flight's start, and `start` is
    `state_at` of its first row in the window before. Rows at least `model.look_back_s` after the
    window's first row (where that is not the flight's) and `model.look_ahead_s` before its last
    equal those of the whole flight. Raises AirframeError when the flight has another number of
    rotors than the model's airframe.

        >>> flight = analyse(read_log("sitl_logs/campaign/v4_m16_q2.5.tlog").track, load_model())
        >>> round(float(flight.margin.min()), 2)
        0.25
    """
    if airframe_match is None:
        require_rotors(track, model.airframe)
        facts = VehicleFacts()
        airframe_match = match_airframe(track, identified_airframe(model), facts, {}, given=True)
    if airframe_match.no_verdict:
        model = unknown_aircraft(track.rotor_count)
    airframe = identified_airframe(model)
    require_rotors(track, airframe)
    track = with_air_temperature(track, model.thermometer)
    if density is None:
        air = track_air(track, temperature_offset(model))
        rho, density_error, density_basis = air.density, air.density_error, air.basis
    else:
        rho, density_basis = np.asarray(density, dtype=np.float64), GIVEN_AIR
        density_error = np.zeros_like(rho)
    limits = ceiling(airframe, rho, track.voltage)
    prediction = predict(model, track, rho, start=start)
    load = weight(airframe, track.tank_kg)
    use = utilisation(track.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    use_predicted = utilisation(prediction.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    use_error, use_beyond = utilisation_error(
        track, airframe, prediction, use, use_predicted, airframe_match.outputs
    )
    load_known = np.isfinite(track.measured("tank_kg"))[:, None]
    return FlightAnalysis(
        track=track,
        model=model,
        density=rho,
        density_error=density_error,
        density_given=density is not None,
        density_basis=density_basis,
        voltage_basis=state("no airframe") if airframe_match.no_verdict else limits.voltage_basis,
        prediction=prediction,
        residual_rpm=np.where(load_known, track.rotor_speed_rpm, np.nan)
        - prediction.rotor_speed_rpm,
        max_rotor_speed_rpm=limits.max_rotor_speed_rpm,
        max_thrust=limits.max_thrust,
        thrust=rotor_thrust(airframe, track.rotor_speed_rpm, rho),
        utilisation=use,
        utilisation_error=use_error,
        utilisation_beyond=use_beyond,
        utilisation_predicted=use_predicted,
        weight=load,
        redundancy_yaw_kept=redundancy(airframe, limits, load, yaw_kept=True),
        redundancy_yaw_uncontrolled=redundancy(airframe, limits, load, yaw_kept=False),
        redundancy_error=redundancy_error(
            track, airframe, density_error / rho, airframe_match.outputs
        ),
        redundancy_beyond=beyond_load(track, airframe, airframe_match.outputs),
        trimmable_loss=trimmable_loss(airframe, limits, load),
        start=start,
        airframe_match=airframe_match,
    )


def with_load_beyond_gauge(analysis: FlightAnalysis, beyond_kg: float) -> FlightAnalysis:
    """Add `beyond_kg`, kg that no gauge reports, to the weight and lower the redundancy to match.

    Utilisation is by rotor speeds and unchanged. For single rows of a flight in progress whose
    `analysis_for_verdict` found that load. Return the analysis unchanged for 0 or NaN.
    """
    if not beyond_kg > 0.0:
        return analysis
    share = analysis.weight / (analysis.weight + G0 * beyond_kg)
    return replace(
        analysis,
        weight=analysis.weight / share,
        redundancy_yaw_kept=analysis.redundancy_yaw_kept * share,
        redundancy_yaw_uncontrolled=analysis.redundancy_yaw_uncontrolled * share,
        beyond_gauge_kg=beyond_kg,
    )


def with_density_error(analysis: FlightAnalysis, share: float) -> FlightAnalysis:
    """Return a copy of the analysis in which the density's standard error is `share` of the density
    in every row.

    It replaces the earlier error; `share` 0.02 is 2 %. The standard error of the redundancy is
    computed again from it; densities and redundancy remain.
    """
    shares = np.full(analysis.density.shape, share)
    airframe = identified_airframe(analysis.model)
    return replace(
        analysis,
        density_error=shares * analysis.density,
        redundancy_error=redundancy_error(
            analysis.track, airframe, shares, analysis.airframe_match.outputs
        ),
    )


def with_bad_part(analysis: FlightAnalysis) -> FlightAnalysis:
    """Remove figures that assume sound rotors from the analysis of an aircraft with a faulty rotor.

    The redundancy after losing one more rotor was computed for sound rotors: values of 1 and more
    become NaN. Values below 1 stay, because a faulty rotor only lowers them.
    """
    kept, free = analysis.redundancy_yaw_kept, analysis.redundancy_yaw_uncontrolled
    return replace(
        analysis,
        redundancy_yaw_kept=np.where(kept < 1.0, kept, np.nan),
        redundancy_yaw_uncontrolled=np.where(free < 1.0, free, np.nan),
        trimmable_loss=np.full_like(analysis.trimmable_loss, np.nan),
        bad_part=True,
    )


def with_true_speed(analysis: FlightAnalysis, rotor: int, factor: float) -> FlightAnalysis:
    """Correct thrust and utilisation of a rotor, from 0, whose ESC reads `factor` times its true
    speed."""
    scale = np.ones(analysis.track.rotor_count)
    scale[rotor] = factor**-2.0
    return replace(
        analysis, thrust=analysis.thrust * scale, utilisation=analysis.utilisation * scale
    )


def analysis_for_verdict(analysis: FlightAnalysis) -> FlightAnalysis:
    """Return the analysis of a whole flight on which its verdict is based.

    Where hover thrust surely shows more load than the gauge or the user stated, the flight is
    analysed again with that load. Return other analyses unchanged.
    """
    track = with_load_for_verdict(
        analysis.track, identified_airframe(analysis.model), analysis.airframe_match.outputs
    )
    if analysis.no_verdict or track is analysis.track:
        return analysis
    given = analysis.density if analysis.density_given else None
    made = analyse(
        track, analysis.model, given, start=analysis.start, airframe_match=analysis.airframe_match
    )
    beyond = (track.tank_kg - analysis.track.tank_kg)[track.flying]
    return replace(made, beyond_gauge_kg=float(np.nanmedian(beyond)))


def worst_rotor(values: Floats, badness: Floats | None = None) -> tuple[Floats, Floats]:
    """Return the value (T,) of the rotor with the largest badness, and its index from 0 as a float
    (T,).

    `values` and `badness` are (T, R); without `badness` the largest value is the worst. Both
    results are NaN where no badness is known.
    """
    if not values.shape[1]:
        return np.full(values.shape[0], np.nan), np.full(values.shape[0], np.nan)
    badness = values if badness is None else badness
    score = np.where(np.isfinite(badness), badness, -np.inf)
    which = np.argmax(score, axis=1)
    known = np.isfinite(np.max(score, axis=1))
    rows = np.arange(values.shape[0])
    return np.where(known, values[rows, which], np.nan), np.where(known, which, np.nan)


def require_rotors(track: FlightTrack, airframe: Airframe) -> None:
    """Raise AirframeError when the flight and the airframe have different numbers of rotors."""
    if track.rotor_count != airframe.rotor_count:
        raise AirframeError(
            f"{track.name}: the flight reports {track.rotor_count} rotors and airframe "
            f"{airframe.name} has {airframe.rotor_count}; give --airframe or --model of the "
            "aircraft that flew"
        )
