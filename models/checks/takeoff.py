"""Check an aircraft from the start of its motors to the first seconds of its hover.

The question is that of a pilot with the skids on the ground: may it lift? Rows of one run-up (from
the first motor that is driven to HOVER_S after lift-off) are compared rotor by rotor:

- a rotor that stands, or began to turn late, while the others turn;
- a rotor slower or faster than the others at a common output. Speed follows output by a power
  between LEAST_POWER and MOST_POWER, so a ratio of outputs gives an interval of the ratio of
  speeds, and no curve of the motor is needed;
- a rotor that is unlike itself on earlier flights of the aircraft, where they are known;
- yaw that runs away against the moment of the rotors: one turns the wrong way. Rotors of the side
  that the autopilot drives harder are the candidates: yaw alone cannot show which of them it is;
- per ESC, where the flight table has its channels: temperature, and resistance of its lead;
- in hover: mass by thrust against the mass that was stated, and reserve of yaw authority.

Only earlier rows decide, so that a live link and its recording give the same findings, each with
the time at which it was decided; an exchange of two motors replaces what it explains. A rotor whose
speed is not reported is `NOT_KNOWN`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.arms.spool_up import unlike_before, usual_spool_up
from thrustmargin.models.checks.speed_readings import FLOOR, TURNING
from thrustmargin.models.flight import (
    TRACK_CHANNELS,
    Bools,
    FlightTrack,
    Floats,
    join_tracks,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.margin import ceiling, rotor_thrust, yaw_reserve
from thrustmargin.models.physics.smoothing import known_mean, known_median

#: Motor output from which a motor counts as driven: PX4 logs some thousandths while disarmed.
DRIVEN = 0.03
#: s for which a rotor may be at rest after half of the others turn: those of 41 real and simulated
#: starts follow within 0.3 s of each other.
LATE_S = 0.5
#: Share of the others' output below which an autopilot may have stopped a motor itself.
ASKED_SHARE = 0.5
#: Powers of motor output between which rotor speed lies: 0.8 to 1.2 on the aircraft recorded.
LEAST_POWER, MOST_POWER = 0.5, 1.5
#: s over which speeds and outputs are means, and s for which they must disagree: an automatic
#: take-off spools up within 1 s.
MEAN_S, LASTS_S = 0.3, 0.3
#: Readings in which they must: two of 2 Hz may both meet a wobble of the autopilot at its height.
READINGS = 3
#: s by which the speed of a large rotor lags its output, at most.
LAG_S = 0.5
#: Ratios of speed to that of the others, beyond the interval by outputs: a rotor without propeller
#: turns 1.3 to 1.6 times as fast; a sound one at spool-up lags by up to a third.
SLOW, FAST = 0.6, 1.25
#: rad/s of yaw, rad/s by which it must have grown, and least share of the rotors' yaw moment in
#: their thrust against it, for a rotor that turns the wrong way.
RUNAWAY_RATE, RUNAWAY_GROWTH, AGAINST = 0.6, 0.4, 0.1
RUNAWAY_S = 0.5  # s over which it grows
#: Rotors from which an exchange of two can be seen, and the share of the deviation that it leaves.
FEWEST_TO_EXCHANGE, EXCHANGE_EXPLAINS = 4, 0.25
HOVER_S = 5.0  # s after lift-off that still belong to the check
SETTLED_S = 1.0  # s after lift-off from which the aircraft no longer leans on its legs
REST_S = 1.0  # s without a driven motor that end a run-up
#: kg and share of the stated mass by which thrust in the first seconds may differ from it: in a
#: climb of 1 m/s rotors make about 6 % less thrust at a speed than in hover.
MASS_KG, MASS_SHARE = 3.0, 0.1
#: Share of the yaw authority that is left, and s for which it is so low, from which it is reported.
LITTLE_YAW, YAW_S = 0.1, 1.0
#: K of an ESC at which it is too hot to lift with: most limit their current from 373 K on.
HOT_ESC = 363.0
#: A at which the lead's drop is measured at least, and resistance of lead and lugs, ohm, above that
#: of the median lead, from which a connector is bad: 20 A through it make 6 W, 100 A make 150 W. On
#: a heavy quad sound leads differ by up to 6 mOhm in such means.
LEAD_CURRENT, BAD_LEAD = 5.0, 0.015
#: s over which drop and current are means and for which a lead must be bad, and the share by which
#: that mean may have changed: while the current rises, voltages read one after the other differ.
LEAD_S, STEADY = 1.0, 0.2
#: Rows of a run-up that are kept for its check, five minutes.
MOST_ROWS = 3000
#: Channels of one ESC each that the check uses where the flight table has them.
ESC_CHANNELS = ("esc_temperature", "esc_voltage", "esc_current")


class TakeoffKind(StrEnum):
    """Kind of a finding in a run-up; its value and reference are in the unit in the comment."""

    STANDS = "stands"  # s since half of the others turned
    LATE = "late"  # s after half of the others
    SLOW = "slow"  # rpm, of the others at the common output
    FAST = "fast"  # likewise: no propeller, or a smaller one
    EXCHANGED = "exchanged"  # likewise, of two motors: each follows the other's output
    REVERSED = "reversed"  # rad/s of yaw against the rotors' moment
    HOT = "hot"  # K, of the other ESCs
    LEAD = "lead"  # ohm, of the other leads
    UNLIKE = "unlike"  # rpm, of itself at that output on earlier flights
    SILENT = "silent"  # number of motors with a speed, number of motors
    WEIGHT = "weight"  # kg by thrust, kg stated
    YAW = "yaw"  # share of the yaw authority that is left, least share


#: Kinds for which nobody should lift, or should set down at once.
DO_NOT_LIFT = frozenset(
    {
        *(TakeoffKind.STANDS, TakeoffKind.LATE, TakeoffKind.SLOW, TakeoffKind.FAST),
        *(TakeoffKind.EXCHANGED, TakeoffKind.REVERSED, TakeoffKind.HOT, TakeoffKind.LEAD),
    }
)


class MotorState(StrEnum):
    """State of a motor during the run-up."""

    TURNS = "turns"
    LATE = "late"
    STANDS = "stands"
    TURNED_BEFORE = "turned before"  # the first row
    NOT_KNOWN = "not known"  # no speed is reported


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeoffFinding:
    """A fault or deviation found in a run-up, decided at `time_s`; motors count from 0."""

    kind: TakeoffKind
    motors: tuple[int, ...]  # those that it may be of; empty: of no motor
    value: float
    reference: float
    time_s: float  # of the track
    low: float = math.nan  # of the interval of `reference` that counts as sound
    high: float = math.nan

    @property
    def forbids(self) -> bool:
        """Return True if nobody should lift with it."""
        return self.kind in DO_NOT_LIFT


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorStart:
    """The start of one motor; NaN where unknown."""

    state: MotorState
    turned_s: float = math.nan  # of the track, when it first turned
    after_s: float = math.nan  # s after half of the others
    idle_rpm: float = math.nan  # median before the outputs rise
    speed_ratio: float = math.nan  # median of speed over that of the others, at spool-up
    output_ratio: float = math.nan  # of motor output, in the same rows


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeoffCheck:
    """Result of one run-up; times, s, are the track's, NaN while unknown."""

    begin_s: float  # the first motor is driven
    lift_s: float  # off the ground
    until_s: float  # last row that was checked
    ended: bool  # no later row belongs to it
    motors: tuple[MotorStart, ...]
    findings: tuple[TakeoffFinding, ...]  # in order of time
    rest_voltage: float  # V before the motors turn
    idle_voltage: float  # V, median before the outputs rise
    lift_voltage: float  # V, least up to HOVER_S after lift-off
    sag_resistance: float  # ohm, from the rest to the largest current
    mass_kg: float  # by thrust, first seconds of hover
    stated_kg: float  # empty mass and fill
    yaw_reserve: float  # share of yaw authority, mean of the first seconds of hover

    @property
    def reporting(self) -> int:
        """Return the number of motors whose speed is reported."""
        return sum(motor.state is not MotorState.NOT_KNOWN for motor in self.motors)

    @property
    def forbidding(self) -> tuple[TakeoffFinding, ...]:
        """Return the findings for which nobody should lift."""
        return tuple(one for one in self.findings if one.forbids)


def takeoff_checks(
    track: FlightTrack, airframe: Airframe | None = None, arms: ArmLaw | None = None
) -> list[TakeoffCheck]:
    """Return the check of every run-up of a flight, in order of time.

    `airframe` is None where it is not known: then only the rotors are compared. `arms` are figures
    of the aircraft's earlier flights, None where none are known. A run-up that never lifts is
    checked to its end.
    """
    return [
        checked_run_up(track.rows(rows), airframe, arms, ended=rows.stop < track.time_s.size)
        for rows in run_ups(track)
    ]


class TakeoffWatch:
    """Check of the run-ups of a flight in progress; it stores the rows of the current run-up."""

    def __init__(self) -> None:
        """Start without rows."""
        self._kept: FlightTrack | None = None
        self._from_rest = True
        #: Check of the last run-up, None before the first.
        self.now: TakeoffCheck | None = None

    def add(
        self, track: FlightTrack, airframe: Airframe | None = None, arms: ArmLaw | None = None
    ) -> TakeoffCheck | None:
        """Add new rows, in order of time; return the check of the last run-up, None before the
        first.

        `airframe` is None where it is not known: then only the rotors are compared. `arms` are
        figures of the aircraft's earlier flights, None where none are known. Rows that do not
        follow the last ones begin another flight. Of a run-up of more than MOST_ROWS rows the
        middle is dropped.
        """
        if not track.time_s.size:
            return self.now
        kept = self._kept
        if kept is not None and _follows(kept, track):
            track = kept.followed_by(track)
        elif kept is not None:
            self.now, self._from_rest = None, True
        rows, time_s = list(run_ups(track, from_rest=self._from_rest)), track.time_s
        for part in rows:
            ended = part.stop < time_s.size
            self.now = checked_run_up(track.rows(part), airframe, arms, ended=ended)
        if rows and self.now is not None and not self.now.ended:
            first = rows[-1].start
            self._from_rest &= first == 0
            track = track.rows(slice(first, None))
            if track.time_s.size > MOST_ROWS:
                half = MOST_ROWS // 2
                track = join_tracks([(track, slice(0, half)), (track, slice(-half, None))])
            self._kept = track
        else:
            first = int(np.searchsorted(time_s, time_s[-1] - 2.0 * REST_S))
            self._kept, self._from_rest = track.rows(slice(first, None)), False
        return self.now


def _follows(before: FlightTrack, after: FlightTrack) -> bool:
    """Return True if `after` begins later than `before` ends and has as many rotors."""
    same = before.rotor_count == after.rotor_count
    return same and bool(before.time_s[-1] < after.time_s[0])


def run_ups(track: FlightTrack, *, from_rest: bool = True) -> Iterator[slice]:
    """Yield the rows of each run-up: REST_S before the first driven motor to HOVER_S after
    lift-off, or to the next rest.

    Rows without any motor data continue the state of the row before. A flight whose first row flies
    has no run-up before it. If not `from_rest`, motors already turning in the first row began
    earlier, which is no run-up either.
    """
    on, time_s = motors_on(track), track.time_s
    row = 0
    while not from_rest and row < time_s.size and on[row]:
        row += 1
    while row < time_s.size:
        if not on[row] or track.flying[row]:
            row += 1
            continue
        begin, end = row, row
        while end < time_s.size and not track.flying[end]:
            if on[end]:
                end += 1
                continue
            still = on[end : int(np.searchsorted(time_s, time_s[end] + REST_S, side="right"))]
            if not still.any() and time_s[-1] - time_s[end] >= REST_S:
                break
            end += 1
        lifted = end < time_s.size and bool(track.flying[end])
        if lifted:
            end = int(np.searchsorted(time_s, time_s[end] + HOVER_S, side="right"))
        before = int(np.searchsorted(time_s, time_s[begin] - REST_S))
        yield slice(before, end)
        row = end
        while row < time_s.size and on[row]:  # a landing with motors on is no new start
            row += 1


def motors_on(track: FlightTrack) -> Bools:
    """Flag rows (T,) with a motor driven or two turning; rows without motor data repeat the last
    state."""
    speeds, outputs = np.abs(track.measured("rotor_speed_rpm")), track.throttle
    with np.errstate(invalid="ignore"):
        # A single rotor may be turned by hand, or by its sensor's noise.
        turning = np.sum(speeds >= TURNING, axis=1) >= 2
        on: Bools = np.any(outputs > DRIVEN, axis=1) | turning
    known = np.isfinite(outputs).any(axis=1) | np.isfinite(speeds).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(known.size), -1))
    return np.where(last >= 0, on[np.maximum(last, 0)], False)


def checked_run_up(
    track: FlightTrack,
    airframe: Airframe | None = None,
    arms: ArmLaw | None = None,
    *,
    ended: bool = False,
) -> TakeoffCheck:
    """Check motors, speeds, ESCs, mass and yaw in one run-up, whose rows so far are `track`.

    Without an airframe of the track's rotor count, mass and yaw are not checked (NaN). `arms` are
    figures of the aircraft's earlier flights or None. `ended` states that the run-up has no later
    rows.
    """
    time_s, flying = track.time_s, track.flying
    begin = int(np.argmax(motors_on(track)))
    lift = int(np.argmax(flying)) if flying.any() else time_s.size
    lift_s = float(time_s[lift]) if lift < time_s.size else math.nan
    motors, found = _starts(track, begin, lift)
    slow_or_fast, ratios = _at_common_output(track, begin, lift, arms)
    found += slow_or_fast
    motors = [
        replace(motor, speed_ratio=speed, output_ratio=output)
        for motor, (speed, output) in zip(motors, ratios, strict=True)
    ]
    reported = [m.state is not MotorState.NOT_KNOWN for m in motors]
    if any(reported) and not all(reported):
        silent = tuple(k for k, known in enumerate(reported) if not known)
        at_s = float(time_s[begin])
        found.append(
            TakeoffFinding(
                kind=TakeoffKind.SILENT,
                motors=silent,
                value=float(sum(reported)),
                reference=float(len(reported)),
                time_s=at_s,
            )
        )
    found += _escs(track)
    mass_kg = stated_kg = reserve = math.nan
    if airframe is not None and airframe.rotor_count == track.rotor_count:
        found += _reversed(track, airframe, begin)
        mass_kg, stated_kg, heavier = _mass(track, airframe, lift_s)
        reserve, little = _yaw(track, airframe, lift_s)
        found += [*heavier, *little]
    rest, idle, least, ohm = _voltages(track, begin, lift)
    return TakeoffCheck(
        begin_s=float(time_s[begin]),
        lift_s=lift_s,
        until_s=float(time_s[-1]),
        ended=ended or float(time_s[-1]) - lift_s >= HOVER_S,
        motors=tuple(motors),
        findings=tuple(sorted(found, key=lambda one: (one.time_s, one.motors))),
        rest_voltage=rest,
        idle_voltage=idle,
        lift_voltage=least,
        sag_resistance=ohm,
        mass_kg=mass_kg,
        stated_kg=stated_kg,
        yaw_reserve=reserve,
    )


def _starts(
    track: FlightTrack, begin: int, lift: int
) -> tuple[list[MotorStart], list[TakeoffFinding]]:
    """Return each motor's start, and findings of motors that do not start or start late.

    `begin` is the first row with motors on, `lift` the row of lift-off (the number of rows if
    none). A motor without a reported speed is NOT_KNOWN; one already turning in its first report is
    TURNED_BEFORE.
    """
    time_s, speeds, outputs = (
        track.time_s,
        np.abs(track.measured("rotor_speed_rpm")),
        track.throttle,
    )
    rows = slice(0, max(lift, begin + 1))
    with np.errstate(invalid="ignore"):
        turns = speeds[rows] >= TURNING
    known = np.isfinite(speeds[rows])
    first = np.where(turns.any(axis=0), np.argmax(turns, axis=0), -1)
    first_known = np.where(known.any(axis=0), np.argmax(known, axis=0), -1)
    turned_s = np.where(first >= 0, time_s[np.maximum(first, 0)], np.inf)
    made: list[MotorStart] = []
    found: list[TakeoffFinding] = []
    for motor in range(track.rotor_count):
        if first_known[motor] < 0:
            made.append(MotorStart(state=MotorState.NOT_KNOWN))
            continue
        idle = _idle_rpm(track, motor, rows)
        if first[motor] >= 0 and first[motor] == first_known[motor]:
            # It turned when it was first heard: since when is not known.
            made.append(MotorStart(state=MotorState.TURNED_BEFORE, idle_rpm=idle))
            continue
        others_s = np.sort(np.delete(turned_s, motor)[np.delete(first_known, motor) >= 0])
        half_s = float(others_s[others_s.size // 2]) if others_s.size >= 2 else math.inf
        own_s = float(turned_s[motor])
        start = MotorStart(
            state=MotorState.TURNS,
            turned_s=own_s if math.isfinite(own_s) else math.nan,
            after_s=own_s - half_s if math.isfinite(own_s - half_s) else math.nan,
            idle_rpm=idle,
        )
        if math.isinf(own_s):
            start = replace(start, state=MotorState.STANDS)
        # Asked for: a standing reading at LATE_S after the others, and an output like theirs.
        with np.errstate(invalid="ignore"):
            stood = (speeds[rows, motor] < TURNING) & (time_s[rows] >= half_s + LATE_S)
            # A motor that was switched off again is not late.
            stood &= (time_s[rows] < own_s) & (turns.sum(axis=1) >= 2)
            own, theirs = outputs[rows, motor], np.delete(outputs[rows], motor, axis=1)
            stood &= ~(own < ASKED_SHARE * np.median(theirs, axis=1))
        if stood.any():
            late_row = int(np.argmax(stood))
            later = math.isfinite(own_s)
            start = replace(start, state=MotorState.LATE if later else MotorState.STANDS)
            last_stood = time_s[np.flatnonzero(stood)[-1]]
            found.append(
                TakeoffFinding(
                    kind=TakeoffKind.LATE if later else TakeoffKind.STANDS,
                    motors=(motor,),
                    value=float((own_s if later else last_stood) - half_s),
                    reference=0.0,
                    low=0.0,
                    high=LATE_S,
                    time_s=float(time_s[late_row]),
                )
            )
        made.append(start)
    return made, found


def _idle_rpm(track: FlightTrack, motor: int, rows: slice) -> float:
    """Return the median speed of a turning rotor while no output is above FLOOR."""
    speed = np.abs(track.measured("rotor_speed_rpm")[rows, motor])
    with np.errstate(invalid="ignore"):
        idles = ~(track.throttle[rows] > FLOOR).any(axis=1) & (speed >= TURNING)
    return known_median(speed[idles])


def _at_common_output(
    track: FlightTrack, begin: int, lift: int, arms: ArmLaw | None
) -> tuple[list[TakeoffFinding], list[tuple[float, float]]]:
    """Compare each rotor's speed with the speed that its output and the other rotors imply.

    Rows are from `begin` to just after `lift`. With the earlier flights in `arms` each rotor is
    also compared with its own history. Return the findings, and for each rotor the medians of its
    speed and of its output over those of the other rotors (NaN where unknown).
    """
    end = int(
        np.searchsorted(track.time_s, track.time_s[min(lift, track.time_s.size - 1)] + SETTLED_S)
    )
    rows = slice(begin, end)
    time_s = track.time_s[rows]
    speeds = _mean_before(time_s, np.abs(track.measured("rotor_speed_rpm")[rows]))
    outputs = _mean_before(time_s, track.throttle[rows])
    least = _mean_before(time_s, np.where(track.throttle[rows] >= FLOOR, 1.0, 0.0))
    found: list[TakeoffFinding] = []
    ratios: list[tuple[float, float]] = []
    exchanged: set[tuple[int, ...]] = set()
    usual = usual_spool_up(arms, track.name, track.rotor_count)
    for motor in range(track.rotor_count):
        others = _median_of_known(np.delete(speeds, motor, axis=1))
        theirs = _median_of_known(np.delete(outputs, motor, axis=1))
        driven = (least[:, motor] >= 1.0) & (np.delete(least, motor, axis=1) >= 1.0).all(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio, asked = speeds[:, motor] / others, outputs[:, motor] / theirs
        known = driven & np.isfinite(ratio * asked) & (others >= TURNING)
        ratios.append((known_median(ratio[known]), known_median(asked[known])))
        # A speed lags its output: any ratio of outputs of the last LAG_S may be the one it follows.
        low = -_most_before(time_s, -np.minimum(asked**LEAST_POWER, asked**MOST_POWER))
        high = _most_before(time_s, np.maximum(asked**LEAST_POWER, asked**MOST_POWER))
        for kind, wrong in (
            (TakeoffKind.SLOW, known & (ratio < SLOW * low)),
            (TakeoffKind.FAST, known & (ratio > FAST * high)),
        ):
            row = _first_lasting(time_s, wrong, LASTS_S, READINGS)
            if row is None:
                continue
            finding = TakeoffFinding(
                kind=kind,
                motors=(motor,),
                value=float(speeds[row, motor]),
                reference=float(others[row]),
                low=float(SLOW * low[row] * others[row]),
                high=float(FAST * high[row] * others[row]),
                time_s=float(time_s[row]),
            )
            other = exchanged_with(motor, speeds[row], outputs[row])
            if other is not None:
                pair = tuple(sorted((motor, other)))
                finding = replace(finding, kind=TakeoffKind.EXCHANGED, motors=pair)
            if finding.kind is not TakeoffKind.EXCHANGED or finding.motors not in exchanged:
                found.append(finding)
            exchanged |= {finding.motors} if other is not None else set()
        if usual is not None and not any(motor in one.motors for one in found):
            compared = np.where(known, ratio, np.nan), np.where(known, asked, np.nan)
            off, most = unlike_before(usual, motor, *compared)
            found += _unlike(time_s, motor, speeds[:, motor], off, most)
    # What an exchange explains is no fault of its own.
    explained = {motor for pair in exchanged for motor in pair}
    found = [
        one for one in found if one.kind is TakeoffKind.EXCHANGED or not explained & set(one.motors)
    ]
    return found, ratios


def _unlike(
    time_s: Floats, motor: int, speed: Floats, off: Floats, most: Floats
) -> list[TakeoffFinding]:
    """Return a finding at the first lasting difference of a motor from its own history; else empty.

    `off` (T,) is ln of its speed over the usual one, `most` (T,) the largest normal |off|, `speed`
    (T,) the speed itself, rpm.
    """
    with np.errstate(invalid="ignore"):
        row = _first_lasting(time_s, np.abs(off) > most, LASTS_S, READINGS)
    if row is None:
        return []
    before = float(speed[row] * np.exp(-off[row]))
    return [
        TakeoffFinding(
            kind=TakeoffKind.UNLIKE,
            motors=(motor,),
            value=float(speed[row]),
            reference=before,
            low=before * math.exp(-most[row]),
            high=before * math.exp(most[row]),
            time_s=float(time_s[row]),
        )
    ]


def exchanged_with(motor: int, speeds: Floats, outputs: Floats) -> int | None:
    """Return the rotor whose speed signal seems swapped with that of `motor`; None if none does.

    `speeds`, rpm, and `outputs` are (R,), rotors from 0; values not above 0 are unknown. Swapping
    both speeds must reduce the misfit of the speeds of all rotors with their outputs to less than
    EXCHANGE_EXPLAINS of it. None also with fewer than FEWEST_TO_EXCHANGE known rotors.
    """
    known = np.flatnonzero(np.isfinite(speeds * outputs) & (speeds > 0.0) & (outputs > 0.0))
    if known.size < FEWEST_TO_EXCHANGE or motor not in known:
        return None
    before = _off_output(speeds[known], outputs[known])
    best, least = None, EXCHANGE_EXPLAINS * before
    for other in known[known != motor].tolist():
        tried = speeds.copy()
        tried[[motor, other]] = tried[[other, motor]]
        left = _off_output(tried[known], outputs[known])
        if left < least:
            best, least = other, left
    return best


def _off_output(speeds: Floats, outputs: Floats) -> float:
    """Return the largest deviation (natural log) of speeds (n,) from a power of the outputs (n,).

    The power is fitted, within the range that rotors have.
    """
    x, y = np.log(outputs) - np.log(outputs).mean(), np.log(speeds) - np.log(speeds).mean()
    power = float(np.clip(x @ y / max(float(x @ x), 1e-12), LEAST_POWER, MOST_POWER))
    return float(np.max(np.abs(y - power * x)))


def _mean_before(time_s: Floats, values: Floats, seconds: float = MEAN_S) -> Floats:
    """Return the mean (T, R) of `values` (T, R) over the last `seconds` s up to each row, included.

    NaN where one of these values is NaN.
    """
    first = np.searchsorted(time_s, time_s - seconds - 1e-6)
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(np.nan_to_num(values), axis=0)])
    gaps = np.vstack([np.zeros(values.shape[1]), np.cumsum(~np.isfinite(values), axis=0)])
    rows = np.arange(time_s.size) + 1
    count = (rows - first)[:, None]
    whole = (gaps[rows] - gaps[first]) == 0
    return np.where(whole, (total[rows] - total[first]) / count, np.nan)


def _most_before(time_s: Floats, values: Floats) -> Floats:
    """Return the largest finite value (T,) of the LAG_S s up to each row; NaN without one."""
    most = values.copy()
    for step in range(1, time_s.size):
        near = time_s[step:] - time_s[:-step] <= LAG_S + 1e-6
        if not near.any():
            break
        most[step:] = np.fmax(most[step:], np.where(near, values[:-step], np.nan))
    return most


def _median_of_known(values: Floats) -> Floats:
    """Return the row medians (T,) of the finite values (T, R); NaN with fewer than two."""
    ordered = np.sort(values, axis=1)  # NaN at the end
    count, rows = np.isfinite(values).sum(axis=1), np.arange(len(values))
    middle = (ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, count // 2]) / 2.0
    return np.where(count >= 2, middle, np.nan)


def _first_lasting(time_s: Floats, wrong: Bools, seconds: float, readings: int = 2) -> int | None:
    """Return the first row at which `wrong` (T,) has been True for `seconds` s and `readings` rows.

    The rows must be consecutive. None without one.
    """
    since, count = math.nan, 0
    for row in range(time_s.size if wrong.any() else 0):
        if not wrong[row]:
            since, count = math.nan, 0
            continue
        since = float(time_s[row]) if count == 0 else since
        count += 1
        if count >= readings and time_s[row] - since >= seconds - 1e-6:
            return row
    return None


def _reversed(track: FlightTrack, airframe: Airframe, begin: int) -> list[TakeoffFinding]:
    """Return a finding if yaw accelerates against the yaw moment that the rotors should produce.

    Then rotors of one spin in `airframe` turn the other way; the finding names the motors whose
    reversed spin would produce the observed moment. Only rows from `begin` on count. Empty if no
    row shows it.
    """
    time_s, rate = track.time_s, track.angular_rate_frd[:, 2]
    square = track.measured("rotor_speed_rpm") ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (square @ airframe.rotor_spin) / square.sum(axis=1)
        against = np.abs(share) > AGAINST
        against &= (rate * share < 0.0) & (np.abs(rate) > RUNAWAY_RATE)
    for row in np.flatnonzero(against).tolist():
        first = max(int(np.searchsorted(time_s, time_s[row] - RUNAWAY_S - 1e-6)), begin)
        part = slice(first, row + 1)
        way = -np.sign(share[row])
        pulls = np.isfinite(share[part]) & (share[part] * way < -AGAINST)
        growth = way * (rate[row] - rate[first])
        if row > first and pulls.all() and growth > RUNAWAY_GROWTH:
            motors = tuple(np.flatnonzero(airframe.rotor_spin == -way).tolist())
            return [
                TakeoffFinding(
                    kind=TakeoffKind.REVERSED,
                    motors=motors,
                    value=float(rate[row]),
                    reference=float(share[row]),
                    time_s=float(time_s[row]),
                )
            ]
    return []


def _hover(track: FlightTrack, lift_s: float) -> Bools:
    """Flag the rows (T,) from SETTLED_S to HOVER_S after lift-off; none before it."""
    since = track.time_s - lift_s
    return track.flying & (since >= SETTLED_S) & (since <= HOVER_S)


def _mass(
    track: FlightTrack, airframe: Airframe, lift_s: float
) -> tuple[float, float, list[TakeoffFinding]]:
    """Return the mass, kg, weighed by thrust after lift-off, the expected mass, kg, and findings.

    Weighed mass is thrust over specific force; expected mass is the airframe's plus the tank's
    level. A finding states that they differ too much. `lift_s` is the time of lift-off, s. The
    weighed mass is NaN, without a finding, where the thrust is known too briefly.
    """
    rows = _hover(track, lift_s)
    density = track_air(track).density
    thrust = rotor_thrust(airframe, track.measured("rotor_speed_rpm"), density).sum(axis=1)
    # Without an accelerometer the mean of some seconds of level flight is g.
    force = -track.specific_force_frd[:, 2]
    mass = (thrust / np.where(np.isfinite(force), force, G0))[rows]
    stated_kg = airframe.empty_mass + known_median(track.measured("tank_kg")[rows])
    whole = track.time_s[rows]
    if np.isfinite(mass).sum() < 2 or whole[-1] - whole[0] < HOVER_S - SETTLED_S - MEAN_S:
        return math.nan, stated_kg, []
    mass_kg = known_median(mass)
    allowed = max(MASS_KG, MASS_SHARE * stated_kg)
    found = []
    if abs(mass_kg - stated_kg) > allowed:
        found = [
            TakeoffFinding(
                kind=TakeoffKind.WEIGHT,
                motors=(),
                value=mass_kg,
                reference=stated_kg,
                low=stated_kg - allowed,
                high=stated_kg + allowed,
                time_s=float(whole[-1]),
            )
        ]
    return mass_kg, stated_kg, found


def _yaw(
    track: FlightTrack, airframe: Airframe, lift_s: float
) -> tuple[float, list[TakeoffFinding]]:
    """Return the mean unused share of yaw authority in hover after lift-off, at `lift_s` s.

    Also return a finding if it is below LITTLE_YAW for YAW_S s.
    """
    rows = _hover(track, lift_s)
    density = track_air(track).density
    limits = ceiling(airframe, density, track.voltage)
    thrust = rotor_thrust(airframe, track.measured("rotor_speed_rpm"), density)
    reserve = yaw_reserve(airframe, thrust / limits.free_thrust[:, None])
    with np.errstate(invalid="ignore"):
        row = _first_lasting(track.time_s, rows & (reserve < LITTLE_YAW), YAW_S)
    found = []
    if row is not None:
        found = [
            TakeoffFinding(
                kind=TakeoffKind.YAW,
                motors=(),
                value=float(reserve[row]),
                reference=LITTLE_YAW,
                time_s=float(track.time_s[row]),
            )
        ]
    return known_mean(reserve[rows]), found


def _voltages(track: FlightTrack, begin: int, lift: int) -> tuple[float, float, float, float]:
    """Return the battery's median voltage at rest, its median with motors idling, the lowest of all
    rows, V, and its resistance, ohm.

    NaN where unknown. At rest is before row `begin`, idling from there to row `lift`. The
    resistance is the voltage drop from rest to the row of the largest current, over the rise of the
    current; NaN if that is below LEAD_CURRENT.
    """
    volts, amperes = track.voltage, track.current
    with np.errstate(invalid="ignore"):
        idles = ~(track.throttle > FLOOR).any(axis=1)
    at_rest, at_idle = np.arange(volts.size) < begin, np.arange(volts.size) >= begin
    at_idle &= idles & (np.arange(volts.size) < lift)
    rest, idle = known_median(volts[at_rest]), known_median(volts[at_idle])
    known = np.isfinite(volts) & np.isfinite(amperes)
    ohm = math.nan
    if known.any():
        row = int(np.argmax(np.where(known, amperes, -np.inf)))
        drawn = float(amperes[row]) - known_median(amperes[at_rest])
        if drawn >= LEAD_CURRENT:
            ohm = (rest - float(volts[row])) / drawn
    least = float(np.fmin.reduce(volts, initial=np.nan))
    return rest, idle, least, ohm


def _escs(track: FlightTrack) -> list[TakeoffFinding]:
    """Return findings of hot ESCs and of leads that lose more voltage than the others."""
    channels = [_esc_channel(track, name) for name in ESC_CHANNELS]
    temperature, volts, amperes = channels
    return [
        *hot_escs(track.time_s, temperature),
        *bad_leads(track.time_s, track.voltage, volts, amperes),
    ]


def _esc_channel(track: FlightTrack, name: str) -> Floats:
    """Return the ESC channel `name` (T, R) of a track; all NaN if tracks have no such channel."""
    if name in TRACK_CHANNELS:
        return np.asarray(getattr(track, name), dtype=np.float64)
    return np.full(track.rotor_speed_rpm.shape, np.nan)


def hot_escs(time_s: Floats, temperature: Floats) -> list[TakeoffFinding]:
    """Return a finding, at its first time, for each ESC whose `temperature` reaches HOT_ESC.

    `temperature` (T, R) is in K; `time_s` (T,) in s.
    """
    found = []
    with np.errstate(invalid="ignore"):
        hot = temperature >= HOT_ESC
    for motor in np.flatnonzero(hot.any(axis=0)).tolist():
        row = int(np.argmax(hot[:, motor]))
        found.append(
            TakeoffFinding(
                kind=TakeoffKind.HOT,
                motors=(motor,),
                value=float(temperature[row, motor]),
                reference=known_median(np.delete(temperature[row], motor)),
                high=HOT_ESC,
                time_s=float(time_s[row]),
            )
        )
    return found


def bad_leads(
    time_s: Floats, battery: Floats, volts: Floats, amperes: Floats
) -> list[TakeoffFinding]:
    """Return a finding for each ESC whose lead resistance exceeds the other leads' median by
    BAD_LEAD ohm.

    `battery` (T,) is the battery's voltage, V; `volts` and `amperes` (T, R) are those of the ESCs.
    The voltage drop at small current is an offset of the voltmeters and is subtracted. ESCs report
    one after the other, so only means over LEAD_S s of a steady current are compared: in most
    take-offs the first seconds of hover.
    """
    drop = battery[:, None] - volts
    with np.errstate(invalid="ignore"):
        offset = [
            known_median(d[a < LEAD_CURRENT / 2.0]) for d, a in zip(drop.T, amperes.T, strict=True)
        ]
    lost = _mean_before(time_s, drop - np.array(offset), LEAD_S)
    current = _mean_before(time_s, amperes, LEAD_S)
    earlier = current[np.searchsorted(time_s, time_s - LEAD_S - 1e-6)]
    with np.errstate(invalid="ignore"):
        steady = (current >= LEAD_CURRENT) & (np.abs(current - earlier) < STEADY * current)
    ohm = np.where(steady, lost / np.where(steady, current, 1.0), np.nan)
    found = []
    for motor in range(ohm.shape[1]):
        others = _median_of_known(np.delete(ohm, motor, axis=1))
        with np.errstate(invalid="ignore"):
            bad = ohm[:, motor] - others > BAD_LEAD
        row = _first_lasting(time_s, bad, LEAD_S, READINGS)
        if row is not None:
            found.append(
                TakeoffFinding(
                    kind=TakeoffKind.LEAD,
                    motors=(motor,),
                    value=float(ohm[row, motor]),
                    reference=float(others[row]),
                    high=float(others[row]) + BAD_LEAD,
                    time_s=float(time_s[row]),
                )
            )
    return found
