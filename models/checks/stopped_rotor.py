"""Decide whether a rotor without readings stopped in flight, or only its ESC fell silent.

    step = ln(sum_{i != k} N_i^2/f) after - before,    whole share: ln(1 + N_k^2/sum_{i != k} N_i^2)

N_i rotor speeds, f specific force. A rotor that stops leaves its share of the weight to the others;
a rotor that only stops reporting does not change them. With six rotors or more an aircraft may fly
on after a stop, with all other figures looking sound.

A yaw turn or added load looks alike in the other speeds, but not in the motor outputs: the
autopilot demands more of the motor that no longer lifts than of the others, or has switched it off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.atmosphere import G0

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
    """List the rotors that stopped in flight for LOOK seconds or more, in order of time.

    A rotor without readings at the last row is listed already after the time that the comparison
    needs, which is shorter, for live use. Inferred speeds are not used.
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
        """Add N new rows, in order; flag (N, R), in the last row, each rotor that has stopped."""
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
    """Return whether the other rotors (T,) carry the rotor's share `own` (T,) from `time_s` on."""
    rows = _sides(track, time_s)
    sides = [others[side & np.isfinite(others)] for side in rows]
    own = own[rows[0] & np.isfinite(own)]
    if min(len(side) for side in (*sides, own)) < FEWEST_ROWS:
        return False
    was, now = (float(np.median(side)) for side in sides)
    return bool(np.log(now / was) > TAKEN_OVER * np.log1p(float(np.median(own)) / was))


def _asked_as_turning(track: FlightTrack, rotor: int, time_s: float) -> bool:
    """Return whether the outputs after `time_s` treat a rotor like one that turns.

    False where outputs are unknown, or do not follow the load of the others.
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
    """Flag the rows (T,) in flight before `time_s` that are compared, and those after it."""
    since = track.time_s - time_s
    before = track.flying & (since <= -LEFT_OUT) & (since >= -LOOK)
    return before, track.flying & (since >= LEFT_OUT) & (since <= LOOK)
