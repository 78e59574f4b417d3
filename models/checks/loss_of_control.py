"""Decide whether and when an aircraft lost control: turned over, spun, fell or hit the ground.

A flip or a dive that calm flight follows was flown on purpose; one that calm flight does not follow
was a loss of control.

Decide whether a rotor without readings stopped in flight, or only its ESC fell silent.

    step = ln(sum_{i != k} N_i^2/f) after - before,    whole share: ln(1 + N_k^2/sum_{i != k} N_i^2)

N_i rotor speeds, f specific force. A rotor that stops leaves its share of the weight to the others;
a rotor that only stops reporting does not change them. With six rotors or more an aircraft may fly
on after a stop, with all other figures looking sound.

A yaw turn or added load looks alike in the other speeds, but not in the motor outputs: the
autopilot demands more of the motor that no longer lifts than of the others, or has switched it off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from itertools import pairwise

import numpy as np

from thrustmargin.models.checks.held import attitude_denied
from thrustmargin.models.flight import Bools, FlightTrack, Floats, FlyingBy, down_axis
from thrustmargin.models.physics.atmosphere import G0, pressure_altitude

#: rad: no autopilot lets anybody ask for more in the modes that spraying is flown in.
TURNED_TILT = np.radians(70.0)
#: rad between the axis that was asked for and the body's, and s: ArduPilot's crash check takes
#: the same angle; a fast change of what is asked is followed sooner.
OFF_TILT, OFF_S = np.radians(30.0), 1.0
SPIN_RATE = 6.0  # rad/s, about one turn a second
FALL_FORCE = 0.3 * G0  # m/s²: hardly held by anything
DRIVEN = 0.12  # mean output above which motors do more than idle: it may turn over on its legs
FALL_SPEED = 3.0  # m/s downwards: less is a gust, or a landing
HEIGHT_S = 1.0  # over which a height shows how fast it falls
HIT_FORCE = 3.0 * G0  # m/s², mean of a row
#: Calm flight: tilt in rad and rate in rad/s below which, and s for which it must be.
CALM_TILT, CALM_RATE, CALM_S = np.radians(40.0), 2.5, 3.0
#: s after the last row in flight that still belong to it: motors stop before it hits.
AFTER_S = 2.0
SMOOTHED_S = 1.0  # s before the first sign to which it may reach
#: s before the loss in which full output is a sign of it, and the share that is full
LED_S, FULL_OUTPUT = 5.0, 0.98


class LossKind(StrEnum):
    """The kind of sign by which a loss of control shows."""

    SATURATED = "saturated"  # value: largest share of a motor's output
    NOT_AS_ASKED = "not as asked"  # value: largest angle off the attitude that was asked for, rad
    TURNED_OVER = "turned over"  # value: largest tilt, rad
    SPUN = "spun"  # value: largest rate, rad/s
    FELL = "fell"  # value: largest sink rate, m/s
    HIT = "hit"  # value: largest specific force, m/s²


@dataclass(frozen=True, slots=True, kw_only=True)
class LossOfControl:
    """A sign of a loss of control: its kind, begin, and largest size in the unit of its kind."""

    kind: LossKind
    time_s: float
    value: float


#: s that a sign must last: single rows may be damaged
LASTS_S: Mapping[LossKind, float] = {
    LossKind.NOT_AS_ASKED: OFF_S,
    LossKind.TURNED_OVER: 0.3,
    LossKind.SPUN: 0.3,
    LossKind.FELL: 0.3,
    LossKind.HIT: 0.0,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Movements:
    """Signs of a loss of control, and calm flight, in each of T rows."""

    calm: Bools  # (T,)
    signs: Mapping[LossKind, tuple[Bools, Floats]]  # (T,) whether it shows, and its size


def loss_of_control(track: FlightTrack) -> tuple[LossOfControl, ...]:
    """Return the signs of a loss of control without recovery, in order of time.

    Empty if the flight recovered, or without attitude, rates and specific force.
    """
    signs_found = _first_of_each_kind(_signs(track)[1])
    if not signs_found:
        return ()
    return tuple(
        sorted([*_saturation_before(track, signs_found[0].time_s), *signs_found], key=_sign_time)
    )


def recovered_signs(track: FlightTrack) -> tuple[LossOfControl, ...]:
    """Return the first sign of each kind that calm flight followed, in order of time.

    They include a jolt alone, which is a hard landing.
    """
    return _first_of_each_kind(_signs(track)[0])


@lru_cache(maxsize=1)  # five callers need it for one flight
def _signs(track: FlightTrack) -> tuple[list[LossOfControl], list[LossOfControl]]:
    """Return the signs of lost control that lasted long enough, in two lists.

    The first has the signs before the last calm flight, from which the aircraft recovered; the
    second the signs after it: a loss of control. A hard jolt alone is a hard landing and counts in
    the first.
    """
    watched, driven = _in_or_after_flight(track), _motors_above_idle(track)
    if not (watched | driven).any():
        return [], []
    seen = movements(track)
    last_calm = _last_of_calm(track.time_s, track.flying & seen.calm)
    found = [
        LossOfControl(kind=kind, time_s=begin, value=float(np.nanmax(size[first:end])))
        for kind, (rows, size) in seen.signs.items()
        for first, end in _runs(rows & (watched | (driven & (kind is LossKind.TURNED_OVER))))
        if float(track.time_s[end - 1]) - (begin := float(track.time_s[first]))
        >= LASTS_S[kind] - 1e-9
    ]
    late = [sign for sign in found if sign.time_s >= last_calm]
    # A jolt alone is a hard landing.
    if all(sign.kind is LossKind.HIT for sign in late):
        return found, []
    return [sign for sign in found if sign.time_s < last_calm], late


def _first_of_each_kind(found: list[LossOfControl]) -> tuple[LossOfControl, ...]:
    """Return the first sign of each kind, in order of time."""
    firsts = [
        min((f for f in found if f.kind is k), key=_sign_time, default=None) for k in LossKind
    ]
    return tuple(sorted((sign for sign in firsts if sign is not None), key=_sign_time))


def movements(track: FlightTrack) -> Movements:
    """Flag the rows (T,) of calm flight, and map each kind of lost control to its rows (T,) and its
    size (T,).

    A row is flagged however briefly a sign lasts. Sizes are angles, rad, or rad/s, m/s and m/s² by
    the kind. SATURATED is not among the kinds. An unknown channel, or an attitude that specific
    force and pressure deny, shows no sign and does not prevent calm.
    """
    down = down_axis(track.attitude)
    tilt = np.arccos(np.clip(down[:, 2], -1.0, 1.0))
    rate = np.linalg.norm(track.angular_rate_frd, axis=1)
    force = np.linalg.norm(track.specific_force_frd, axis=1)
    sink = track.velocity_ned[:, 2]
    fell = ~_height_contradicts(track, sink)
    # The commanded attitude has no heading: use the actual one.
    asked = down_axis(np.column_stack([track.asked_attitude, track.attitude[:, 2]]))
    off = np.arccos(np.clip(np.sum(asked * down, axis=1), -1.0, 1.0))
    denied = attitude_denied(
        track.time_s,
        track.attitude,
        track.specific_force_frd,
        pressure_altitude(track.pressure),
    )
    tilt, off = (np.where(denied, np.nan, angle) for angle in (tilt, off))
    return Movements(
        calm=~(tilt > CALM_TILT)
        & ~(off > OFF_TILT)
        & ~(rate > CALM_RATE)
        & ~(sink > 2 * FALL_SPEED),
        signs={
            LossKind.NOT_AS_ASKED: (off > OFF_TILT, off),
            LossKind.TURNED_OVER: ((tilt > TURNED_TILT) & ~(off < OFF_TILT), tilt),
            LossKind.SPUN: (rate > SPIN_RATE, rate),
            LossKind.FELL: ((force < FALL_FORCE) & (sink > FALL_SPEED) & fell, sink),
            LossKind.HIT: (
                (force > HIT_FORCE) & _after_fall(track, np.where(fell, sink, 0.0)),
                force,
            ),
        },
    )


def _height_contradicts(track: FlightTrack, sink: Floats) -> Bools:
    """Flag the rows (T,) where the height does not fall as fast as the sink rate `sink` (T,), m/s,
    states.

    Only rates above FALL_SPEED are tested: the height must fall by half of the rate, and by
    FALL_SPEED, over HEIGHT_S about the row. An estimated rate drifts if an accelerometer is off.
    Height is by barometer, else above ground; False where unknown.
    """
    heights = (pressure_altitude(track.pressure), track.height_agl)
    known = [h for h in heights if np.isfinite(h).any()]
    denies = np.zeros(sink.size, dtype=np.bool_)
    suspect = np.nan_to_num(sink) > FALL_SPEED
    if not known or not suspect.any():
        return denies
    time_s, height = track.time_s, known[0]
    has = np.isfinite(height)
    before, after = (
        np.clip(time_s + side * HEIGHT_S, time_s[has][0], time_s[has][-1]) for side in (-0.5, 0.5)
    )
    fall = np.interp(before, time_s[has], height[has]) - np.interp(after, time_s[has], height[has])
    fell = fall / np.maximum(after - before, 1e-3)
    return suspect & (fell < np.maximum(0.5 * np.nan_to_num(sink), FALL_SPEED))


def signs_so_far(track: FlightTrack) -> tuple[Movements, Mapping[LossKind, Bools]]:
    """Return the movements, and for each sign of lost control the rows (T,) in which it has lasted
    enough.

    For a flight in progress, in which it is not yet known whether calm flight follows. A hard jolt
    alone is no sign, and is left out.
    """
    seen = movements(track)
    lasted: dict[LossKind, Bools] = {}
    for kind, (rows, _) in seen.signs.items():
        if kind is not LossKind.HIT:
            lasted[kind] = np.zeros_like(rows)
            for first, end in _runs(rows):
                lasting = track.time_s[first:end] - track.time_s[first] >= LASTS_S[kind] - 1e-9
                lasted[kind][first:end] = lasting
    return seen, lasted


def before_loss(track: FlightTrack, losses: tuple[LossOfControl, ...]) -> FlightTrack:
    """Return the track with `flying` only before the first sign of a loss.

    The last second is excluded too, because smoothed channels already contain the loss.
    """
    if not losses:
        return track
    return replace(track, flying=track.flying & (track.time_s < losses[0].time_s - SMOOTHED_S))


def _sign_time(sign: LossOfControl) -> float:
    """Return the time of a sign, s."""
    return sign.time_s


def _in_or_after_flight(track: FlightTrack) -> Bools:
    """Flag rows (T,) in flight and within AFTER_S after it."""
    flown = track.time_s[track.flying]
    if not flown.size:
        return track.flying
    last = np.searchsorted(flown, track.time_s, side="right") - 1
    return (last >= 0) & (track.time_s - flown[np.maximum(last, 0)] <= AFTER_S)


def _motors_above_idle(track: FlightTrack) -> Bools:
    """Flag rows (T,), on the ground too, in which the motors of an armed aircraft do more than
    idle."""
    off = track.flying_by in (FlyingBy.DISARMED, FlyingBy.CONSTANT_OUTPUTS, FlyingBy.HELD)
    total = np.nan_to_num(track.throttle).sum(axis=1)
    return (total > DRIVEN * track.rotor_count) & (not off)


def _after_fall(track: FlightTrack, sink: Floats) -> Bools:
    """Flag rows (T,) within a second after a sink (T,) m/s above FALL_SPEED."""
    fast = track.time_s[np.nan_to_num(sink) > FALL_SPEED]
    last = np.searchsorted(fast, track.time_s, side="right") - 1
    return (last >= 0) & (track.time_s - np.append(fast, np.inf)[last] <= 1.0)


def _last_of_calm(time_s: Floats, calm: Bools) -> float:
    """Return when the last calm flight of CALM_S or more began; -inf without one.

    Signs before it were recovered from.
    """
    lasting = [a for a, end in _runs(calm) if time_s[end - 1] - time_s[a] >= CALM_S]
    return float(time_s[lasting[-1]]) if lasting else -np.inf


def _saturation_before(track: FlightTrack, when: float) -> list[LossOfControl]:
    """Return the sign of a motor at full output within LED_S before `when`, from its first row;
    empty without."""
    near = (track.time_s >= when - LED_S) & (track.time_s <= when) & track.flying
    output = np.where(near[:, None], np.nan_to_num(track.throttle), 0.0).max(axis=1, initial=0.0)
    full = np.flatnonzero(output >= FULL_OUTPUT)
    if not full.size:
        return []
    begin = float(track.time_s[full[0]])
    return [LossOfControl(kind=LossKind.SATURATED, time_s=begin, value=float(output.max()))]


def _runs(rows: Bools) -> list[tuple[int, int]]:
    """List (first, end) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in list(pairwise(edges))[::2]]


#: s of flight before and after the stop that are compared, and s around it that are excluded
LOOK, LEFT_OUT = 4.0, 0.5
FEWEST_ROWS = 10  # known on each side
TAKEN_OVER = 0.6  # share of the whole step from which the others have taken over
#: Output over the others' mean, after over before: above IN_VAIN the autopilot demands thrust in
#: vain, below OFF it has switched the motor off. Outputs of a turning rotor are in between.
IN_VAIN, OFF = 1.1, 0.2
FOLLOWED = 1.01  # mean output of the others, after over before, from which outputs follow the load


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedRotor:
    """A rotor, from 0, the s of the flight at which it last turned, and at which it turned again
    (inf if never)."""

    rotor: int
    time_s: float
    until_s: float = np.inf


def stopped_rotors(track: FlightTrack) -> tuple[StoppedRotor, ...]:
    """List the rotors that stopped in flight, in order of time; at most one stop for each rotor.

    A rotor has stopped if it has no speed above 0 for more than LOOK seconds while the other rotors
    take over its thrust, and its output is not as for a turning rotor. After a rotor's last reading
    the silence need not last LOOK, for live use. Inferred speeds are not used.
    """
    turning = track.measured("rotor_speed_rpm")
    squares = np.where(turning > 0.0, turning, np.nan) ** 2
    if not np.isfinite(squares).any():
        return ()
    force = np.linalg.norm(track.specific_force_frd, axis=1)
    felt = np.where(np.isfinite(force), force, G0) / G0
    found = []
    for rotor in range(track.rotor_count):
        others = np.sum(np.delete(squares, rotor, axis=1), axis=1) / felt
        known = np.flatnonzero(track.flying & np.isfinite(squares[:, rotor]))
        times = track.time_s[known]
        later = np.append(times[1:], np.inf)
        for row in np.flatnonzero(later - times > LOOK).tolist():
            last_s, until_s = float(times[row]), float(later[row])
            if _taken_over(
                track, squares[:, rotor] / felt, others, last_s
            ) and not _asked_as_turning(track, rotor, last_s):
                found.append(StoppedRotor(rotor=rotor, time_s=last_s, until_s=until_s))
                break
    return tuple(sorted(found, key=lambda one: one.time_s))


class StoppedWatch:
    """The search for stopped rotors in a flight in progress; it keeps the rows that a comparison
    needs."""

    def __init__(self) -> None:
        """Start without rows."""
        self._kept: FlightTrack | None = None

    def add(self, track: FlightTrack) -> Bools:
        """Add N new rows, in order of time; return flags (N, R) of rotors that have stopped by now.

        Flags are only set in the last row.
        """
        kept, found = self._kept, np.zeros(track.rotor_speed_rpm.shape, dtype=np.bool_)
        if not track.time_s.size:
            return found
        begin_s, goes_on = float(track.time_s[0]), kept and kept.rotor_count == track.rotor_count
        if kept and goes_on and kept.time_s[-1] < begin_s:  # else a new flight began
            first = int(np.searchsorted(kept.time_s, begin_s - 2.0 * (LOOK + LEFT_OUT)))
            track = kept.followed_by(track, first)
        self._kept = track
        for one in stopped_rotors(track):
            found[-1, one.rotor] = np.isinf(one.until_s)
        return found


def _taken_over(track: FlightTrack, own: Floats, others: Floats, time_s: float) -> bool:
    """Return True if the other rotors' thrust (T,) rose at `time_s` as if to replace `own`.

    `own` (T,) is the thrust of the rotor in question, in the unit of `others`. False with too few
    rows before or after.
    """
    rows = _sides(track, time_s)
    sides = [others[side & np.isfinite(others)] for side in rows]
    own = own[rows[0] & np.isfinite(own)]
    if min(len(side) for side in (*sides, own)) < FEWEST_ROWS:
        return False
    was, now = (float(np.median(side)) for side in sides)
    return bool(np.log(now / was) > TAKEN_OVER * np.log1p(float(np.median(own)) / was))


def _asked_as_turning(track: FlightTrack, rotor: int, time_s: float) -> bool:
    """Return True if `rotor`'s motor output, relative to the other motors' output, hardly changes
    at `time_s`.

    The autopilot then still controls the rotor as one that turns. False where outputs are unknown,
    or the other outputs did not rise.
    """
    asked = track.throttle
    own, others = asked[:, rotor], np.mean(np.delete(asked, rotor, axis=1), axis=1)
    rows = [side & np.isfinite(own) & (others > 0.0) for side in _sides(track, time_s)]
    if min(np.count_nonzero(side) for side in rows) < FEWEST_ROWS:
        return False
    rise = np.median(others[rows[1]]) / np.median(others[rows[0]])
    was, now = (float(np.median(own[side] / others[side])) for side in rows)
    return bool(rise > FOLLOWED) and OFF * was < now < IN_VAIN * was


def _sides(track: FlightTrack, time_s: float) -> tuple[Bools, Bools]:
    """Flag the rows (T,) in flight that are compared: LEFT_OUT to LOOK s before, and after,
    `time_s`."""
    since = track.time_s - time_s
    before = track.flying & (since <= -LEFT_OUT) & (since >= -LOOK)
    return before, track.flying & (since >= LEFT_OUT) & (since <= LOOK)
