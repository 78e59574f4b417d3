"""Answer, for whoever flies or repairs the aircraft, whether one flight was safe and why.

`advise` makes an `Advice` once, from the analysis, the faults of its rotors and the loss of
control. Every screen, page and alarm shows that one answer. Its levels, the gravest first:

    damaged      a rotor or motor makes less thrust than it should (rotor_faults.py)
    lost         control was lost (loss_of_control.py)
    battery      under load its cells fell below 3.0 V
    no_thrust    a rotor had no thrust in reserve for a second or more (thrust_use.py)
    critical     for a time the loss of one rotor would have brought the aircraft down
    over         the lasting use of thrust is above the limit
    order        the motors are not in the airframe's order, so rotors cannot be located
    near         the 90 % interval of use, or of redundancy after a rotor loss, includes the limit
    under        the use is below the limit, except in short turns or gusts
    unknown      no thrust utilisation, no flight, or a good answer that only a prediction supports
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer
from thrustmargin.models.checks.loss_of_control import (
    LossOfControl,
    before_loss,
    loss_of_control,
    stopped_rotors,
)
from thrustmargin.models.checks.voltage import HELD_ROWS
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.aircraft_change import AircraftChange
from thrustmargin.models.model.analysis import (
    FlightAnalysis,
    ThrustUse,
    analysis_for_verdict,
    running_median,
    thrust_use,
    with_bad_part,
    with_true_speed,
)
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.fill_limits import NextFill, next_fill, unsound_fill
from thrustmargin.models.model.flight_arms import flight_arm_answer
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.model_misfit import (
    Caveat,
    ModelMisfit,
    caveats,
    model_misfit,
    with_misfit,
)
from thrustmargin.models.model.output_faults import MisreadSpeed, misread_speed, undecided
from thrustmargin.models.model.rotor_faults import (
    FaultEpisode,
    FaultHistory,
    fault_episodes,
    fault_history,
    fault_signals,
    faults_in_model,
    trim_known,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.day import DaySource
from thrustmargin.models.physics.smoothing import known_least
from thrustmargin.models.vehicle_facts import CELL_IN_USE

LEAST_FLIGHT_S = 3.0  # a flight with less in it has no verdict
CELL = 3.7  # V, nominal, of the lithium cells that an airframe's nominal voltage counts
COLLAPSED = 3.0  # V a cell under load, below which a lithium cell collapses
HEALTHY = 3.5  # V a cell under load from which nothing is wrong: less may be of something else
LONG_PAUSE_S = 10.0  # of a log: a turn and more
MUCH = 0.1  # share of a flight that shorter pauses together may lack
NAN = float("nan")


class FlightLevel(StrEnum):
    """The grade of one flight, the gravest first."""

    DAMAGED = "damaged"
    LOST = "lost"
    BATTERY = "battery"
    NO_THRUST = "no_thrust"
    CRITICAL = "critical"
    OVER = "over"
    ORDER = "order"
    NEAR = "near"
    UNDER = "under"
    UNKNOWN = "unknown"

    @property
    def gravity(self) -> int:
        """Return the rank of the level: 0 for the gravest, the largest for `unknown`."""
        return list(FlightLevel).index(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorLost:
    """The effect that the loss of one rotor would have had in a flight, with yaw uncontrolled.

    The thrust ratios are NaN where the load is unknown, and where a rotor or motor is bad and the
    loss would have been survived.
    """

    redundancy_min: float = NAN  # thrust that can be held level over weight, with its 90 % interval
    redundancy_min_low: float = NAN
    redundancy_min_high: float = NAN
    not_survivable_s: float = 0.0
    known_s: float = NAN  # in flight with a known load


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """The lowest cell voltage that lasted about one second in flight; NaN where unknown."""

    least_cell: float = NAN
    at_s: float = NAN  # s of the flight
    at_most: bool = False  # the cell count is a minimum, so the voltage is an upper bound


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advice:
    """The assessment of one flight: its warning levels, and the figures and faults behind them."""

    levels: tuple[FlightLevel, ...]  # all that apply, the gravest first; never empty
    limit: float  # share of a rotor's largest thrust that may last
    airborne_s: float
    use: ThrustUse
    rotor_lost: RotorLost
    battery: Battery
    fill: NextFill
    faults: tuple[FaultEpisode, ...]
    repaired: tuple[RotorFault, ...]  # in the model file, but sound again in this flight
    losses: tuple[LossOfControl, ...]
    rotor_count: int
    rotor_names: tuple[str, ...]  # empty where the motor order is unknown
    unseen_from_s: float  # s, end of a log that ends in flight; else NaN
    begun_before: bool  # the log begins in flight
    #: s of the flight that the log lacks; see `_paused_s`
    paused_s: float
    in_progress: bool  # the aircraft still flies: all figures are of the flight so far
    unsought_s: float  # s in flight without the speeds by which to search for a weak rotor
    #: s in flight with motor outputs but no speeds: only a sudden change can be found
    by_outputs_s: float
    #: For most of the flight neither speeds nor outputs were measured; a prediction alone does not
    #: support a good verdict.
    predicted_alone: bool
    no_verdict: bool  # the aircraft is unknown or not the airframe's: no margin is reported
    #: How measured rotor speeds agree with the model; all unknown of a plan.
    misfit: ModelMisfit = field(default_factory=ModelMisfit)
    caveats: tuple[Caveat, ...] = ()
    #: A rotor whose ESC reads too high or low; its use is corrected where outputs show the error.
    misread: MisreadSpeed | None = None
    #: What power, heat, leads and vibration show of each arm; None of a plan and in flight.
    arms: ArmAnswer | None = None
    #: How the flight differs from the flights of its known aircraft before it.
    change: AircraftChange | None = None

    @property
    def level(self) -> FlightLevel:
        """Return the gravest of the levels."""
        return self.levels[0]

    @property
    def ends_in_flight(self) -> bool:
        """Return True if the log ends before the flight does."""
        return bool(np.isfinite(self.unseen_from_s))

    @property
    def complete(self) -> bool:
        """Return True if the log contains the whole flight, without a long pause."""
        return not (self.ends_in_flight or self.begun_before or self.paused_s > 0.0)

    @property
    def places(self) -> tuple[str, ...]:
        """Return the name of each rotor's arm; an empty tuple if the aircraft is unknown
        (`no_verdict`)."""
        return () if self.no_verdict else self.rotor_names


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advised:
    """The assessment of one flight, the analysis behind it and the fill limits at each time step.

    `fill_limit_kg` (T,) is the liquid, kg, with which the row would reach its limit of thrust use;
    `fill_one_rotor_out_kg` (T,) that above which it would not stay up without one rotor; NaN where
    unknown.
    """

    advice: Advice
    whole: FlightAnalysis  # with the rows after control was lost
    analysis: FlightAnalysis
    fill_limit_kg: Floats
    fill_one_rotor_out_kg: Floats


def advise(
    analysis: FlightAnalysis,
    *,
    limit: float = 0.5,
    history: FaultHistory | None = None,
    in_progress: bool = False,
    planned: bool = False,
) -> Advised:
    """Assess a whole flight: its warning levels, the next tank fill, faults and battery.

    `limit` is the share of a rotor's largest thrust that may be used for long. `history` contains
    the faults found during the flight; None: search for them here. `in_progress`: the aircraft
    still flies. `planned`: the flight has no measurements, only its prediction. Rows after a loss
    of control are left out of the figures.

        >>> log = read_log("sitl_logs/onset/worn_prop_onset.tlog")
        >>> made = advise(analyse(log.track, load_model())).advice
        >>> [str(level) for level in made.levels], made.fill.kg
        (['damaged', 'under'], nan)
    """
    whole = analysis_for_verdict(analysis)
    losses = loss_of_control(whole.track)
    analysis = replace(whole, track=before_loss(whole.track, losses)) if losses else whole
    found = fault_history(analysis) if history is None else history
    misread = None if planned else _misread_rotor(analysis, found)
    witnessed = misread if misread is not None and misread.witnessed else None
    if witnessed is not None:
        whole = with_true_speed(whole, witnessed.rotor, witnessed.factor)
        analysis = replace(whole, track=analysis.track) if losses else whole
    track, seconds = analysis.track, analysis.track.row_seconds
    misfit = ModelMisfit() if planned else model_misfit(analysis, witnessed)
    analysis = with_misfit(analysis, misfit)
    use = thrust_use(analysis, limit)
    heard = DaySource.LINK if in_progress else DaySource.LOG
    fill, by_use, by_lost = next_fill(analysis, use, limit, heard)
    free = analysis.redundancy_yaw_uncontrolled[track.flying]
    error = analysis.redundancy_error[track.flying]
    low = free * np.exp(-INTERVAL * error)
    high = free * np.exp(INTERVAL * (error - analysis.redundancy_beyond))
    lost = RotorLost(
        redundancy_min=known_least(free),
        redundancy_min_low=known_least(low),
        redundancy_min_high=known_least(high),
        not_survivable_s=float(seconds[track.flying][free < 1.0].sum()),
        known_s=float(seconds[track.flying][np.isfinite(free)].sum()),
    )
    open_pairs = analysis.airframe_match.open_pairs
    found = [(time_s, undecided(faults, open_pairs)) for time_s, faults in found]
    episodes, known = fault_episodes(found), faults_in_model(analysis.model)
    repaired = tuple(e.fault for e in episodes if e.end_s is not None and e.fault in known)
    faults = tuple(e for e in episodes if e.fault not in repaired)
    faults = () if analysis.no_verdict else faults
    stopped = stopped_episodes(track)
    faults = tuple(e for e in faults if not explained_by_stop(e.fault, stopped, e.begin_s))
    faults = tuple(sorted([*stopped, *faults], key=lambda one: one.begin_s))
    if faults:
        one, whole_too = with_bad_part(analysis), whole is analysis
        analysis, whole = one, one if whole_too else with_bad_part(whole)
        fill, by_use, by_lost = unsound_fill(fill), by_use * NAN, by_lost * NAN
        lost = lost if lost.not_survivable_s > 0.0 else RotorLost(known_s=lost.known_s)
    arms = None
    if not (planned or in_progress or analysis.no_verdict):
        arms = flight_arm_answer(analysis, [one.fault for one in faults], misread)
    battery = _battery(analysis)
    airborne_s = track.flying_s
    shown_s = float(seconds[track.flying & analysis.any_measured].sum())
    sought = np.isfinite(track.measured("rotor_speed_rpm") - analysis.prediction.rotor_speed_rpm)
    by_outputs = analysis.from_outputs.all(axis=1)
    by_outputs &= np.isfinite(analysis.prediction.rotor_speed_rpm).all(axis=1)
    unsought = track.flying & ~sought.all(axis=1) & ~by_outputs
    unsought_s = 0.0 if planned else float(seconds[unsought].sum())
    by_outputs_s = 0.0 if planned else float(seconds[track.flying & by_outputs].sum())
    predicted_alone = not planned and use.known_s > 0.0 and shown_s < 0.5 * airborne_s
    ends_s = NAN if in_progress else _log_end_in_flight(whole.track)
    begun = bool(whole.track.flying[:1].any() and not (in_progress or planned))
    paused_s = _paused_s(whole.track)
    levels: list[FlightLevel] = []
    if faults:
        levels.append(FlightLevel.DAMAGED)
    if losses:
        levels.append(FlightLevel.LOST)
    elif whole.track.flying_s >= LEAST_FLIGHT_S:
        if battery.least_cell < COLLAPSED:
            levels.append(FlightLevel.BATTERY)
        if use.spent_s >= 1.0:
            levels.append(FlightLevel.NO_THRUST)
        of_load = _load_level(use, low, high)
        # A good verdict needs the prediction, a measurement, and that they do not contradict.
        groundless = predicted_alone or (misfit.found and not faults)
        if use.known_s > 0.0 and not (groundless and of_load is FlightLevel.UNDER):
            levels.append(of_load)
        if use.known_s > 0.0 and analysis.airframe_match.other_order:
            levels.append(FlightLevel.ORDER)
    return Advised(
        advice=Advice(
            levels=tuple(sorted(levels, key=lambda one: one.gravity)) or (FlightLevel.UNKNOWN,),
            limit=limit,
            airborne_s=airborne_s,
            use=use,
            rotor_lost=lost,
            battery=battery,
            fill=fill,
            faults=faults,
            repaired=repaired,
            misread=misread,
            arms=arms,
            change=analysis.change,
            losses=tuple(losses),
            rotor_count=track.rotor_count,
            rotor_names=() if analysis.airframe_match.other_order else analysis.places,
            predicted_alone=predicted_alone,
            unseen_from_s=ends_s,
            begun_before=begun,
            paused_s=paused_s,
            in_progress=in_progress,
            unsought_s=unsought_s,
            by_outputs_s=by_outputs_s,
            no_verdict=bool(analysis.no_verdict),
            misfit=misfit,
            caveats=caveats(
                track,
                beyond_gauge_kg=fill.beyond_gauge_kg,
                model_fails=misfit.found and not faults,
                unsought_s=unsought_s,
                by_outputs_s=by_outputs_s,
                trim_known=planned or bool(faults) or trim_known(analysis.model),
                misread=misread is not None,
                complete=planned or not (np.isfinite(ends_s) or begun or paused_s > 0.0),
            ),
        ),
        whole=whole,
        analysis=analysis,
        fill_limit_kg=by_use,
        fill_one_rotor_out_kg=by_lost,
    )


def _misread_rotor(analysis: FlightAnalysis, found: FaultHistory) -> MisreadSpeed | None:
    """Return the rotor whose ESC misreports its speed, from the rows in flight.

    None if no rotor's does, no speeds were measured, the aircraft is unknown (`no_verdict`), or
    `found` contains a fault, which changes speeds as well. Speeds inferred from motor outputs are
    of no ESC.
    """
    measured = analysis.track.flying & ~analysis.from_outputs.any(axis=1)
    track = analysis.track
    blind = analysis.no_verdict or not track.reports("rotor_speed_rpm") or not measured.any()
    if blind or any(faults for _, faults in found):
        return None
    signals = fault_signals(analysis, slice(None))[measured]
    taught = analysis.model.good_flights is not None
    return misread_speed(signals, track.rotor_count, taught=taught)


def _log_end_in_flight(track: FlightTrack) -> float:
    """Return the time, s, at which the log ends in flight; NaN if it ends on the ground."""
    flies = track.flying.size and track.flying[-1]
    return float(track.time_s[-1]) if flies else NAN


def pauses_in_flight(track: FlightTrack) -> tuple[Floats, Floats]:
    """Return the start times (n,) s and lengths (n,) s of pauses of the log in flight of
    LONG_PAUSE_S or more."""
    steps = np.diff(track.time_s)
    at = np.flatnonzero((steps >= LONG_PAUSE_S) & track.flying[:-1] & track.flying[1:])
    return track.time_s[at], steps[at]


def _paused_s(track: FlightTrack) -> float:
    """Return the time of the flight, s, for which the log has no rows.

    If all gaps together are long and a large share of the flight (LONG_PAUSE_S and MUCH), they all
    count; else only single pauses of LONG_PAUSE_S or more.
    """
    steps, said = np.diff(track.time_s), track.row_seconds[:-1]
    inside = track.flying[:-1] & track.flying[1:] & (steps > said)
    lacks = float((steps - said)[inside].sum())
    much = lacks >= LONG_PAUSE_S and lacks >= MUCH * float(steps[track.flying[:-1]].sum())
    return lacks if much else float(pauses_in_flight(track)[1].sum())


def _load_level(use: ThrustUse, low: Floats, high: Floats) -> FlightLevel:
    """Return the warning level by load: critical, over, near or under the limit.

    CRITICAL: the redundancy after losing a rotor is surely below 1 in a row. OVER: lasting
    utilisation surely exceeds its limit. NEAR: either may. `low` and `high` (N,) are the ends of
    the redundancy's interval in the rows in flight; NaN counts as no loss.
    """
    if np.any(high < 1.0):
        return FlightLevel.CRITICAL
    if use.surely_above.any():
        return FlightLevel.OVER
    if use.maybe_above.any() or np.any(low < 1.0):
        return FlightLevel.NEAR
    return FlightLevel.UNDER


def stopped_fault(rotor: int) -> RotorFault:
    """Return the fault, of size 1, of a rotor, counted from 0, that does not turn."""
    return RotorFault(kind="stopped", rotor=rotor, size=1.0, lower=1.0, upper=1.0)


def stopped_episodes(track: FlightTrack) -> list[FaultEpisode]:
    """List the fault episodes of rotors that stood still while the aircraft flew on."""
    return [
        FaultEpisode(
            begin_s=one.time_s,
            end_s=one.until_s if np.isfinite(one.until_s) else None,
            fault=stopped_fault(one.rotor),
        )
        for one in stopped_rotors(track)
    ]


def explained_by_stop(fault: RotorFault, stopped: Sequence[FaultEpisode], time_s: float) -> bool:
    """Return True if a rotor of `fault`, found at `time_s`, had stopped by then, which explains the
    fault."""
    still = {one.fault.rotor for one in stopped if one.begin_s <= time_s}
    return not still.isdisjoint((fault.rotor, *fault.rotors))


def cell_count(airframe: Airframe) -> int:
    """Return the number of lithium cells in series by the airframe's nominal voltage; 0 if
    unknown."""
    return round(float(np.nan_to_num(airframe.nominal_voltage)) / CELL)


def _battery(analysis: FlightAnalysis) -> Battery:
    """Find the lowest cell voltage that lasted about 1 s in flight, and its time.

    The cell count is the airframe's. If the aircraft is unknown (`no_verdict`), it is the smallest
    count that the highest voltages allow (2 or more, at 3.5 V a cell or more), and the result is an
    upper bound (`at_most`). Empty without a count or with fewer than 3 voltages in flight.
    """
    track, count = analysis.track, cell_count(analysis.model.airframe)
    rows = track.flying & (track.voltage > 0.0)
    if np.count_nonzero(rows) < 3:
        return Battery()
    if analysis.no_verdict:
        most = float(np.sort(track.voltage[track.voltage > 0.0])[-HELD_ROWS:][0])
        count = int(np.ceil(most / CELL_IN_USE[1]))
        count = count if most >= HEALTHY * count and count > 1 else 0
    if not count:
        return Battery()
    time_s = track.time_s[rows]
    rate = max(1, round(1.0 / max(float(np.median(np.diff(time_s))), 1e-3)))
    held = running_median(track.voltage[rows][:, None], 2 * rate + 1)[:, 0] / count
    at_s = float(time_s[np.argmin(held)])
    return Battery(least_cell=float(held.min()), at_s=at_s, at_most=bool(analysis.no_verdict))
