"""Did a rotor stand still in flight, or did its ESC only fall silent? By what the others carry.

    step = ln(sum_{i != k} N_i^2/f) after - before,      all of it: ln(1 + N_k^2/sum_{i != k} N_i^2)

N_i rotor speeds, f specific force felt. A rotor that stops leaves its share of the weight to the
others; one whose speed is no longer reported leaves them as they were. With six rotors or more an
aircraft may fly on so, and all other numbers of it look sound.

A yaw turn or a load that is taken up looks alike in the others, and not in the motor outputs: the
autopilot asks more of the motor that leaves a side low than of the others, or has switched it off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.atmosphere import G0

#: s of flight before and after that are compared, and about the moment that are left out
LOOK, LEFT_OUT = 4.0, 0.5
FEWEST_ROWS = 10  # known on each side
TAKEN_OVER = 0.6  # share of the whole step from which the others carry what it did
#: Output over the others' mean, after over before: asked for in vain from the one on, off below the
#: other. Outputs of a turning rotor are in between.
IN_VAIN, OFF = 1.1, 0.2
FOLLOWED = 1.01  # mean output of the others, after over before, where outputs show what they do


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedRotor:
    """A rotor from 0, and s of the flight at which it was last known to turn, and at which again;
    infinite where it does not."""

    rotor: int
    time_s: float
    until_s: float = np.inf


def stopped_rotors(track: FlightTrack) -> tuple[StoppedRotor, ...]:
    """Rotors that stopped in flight for LOOK seconds or more, in order of time.

    One that stands at the last row needs to have done so for the time that the comparison takes,
    which is less: whoever listens cannot wait. Of T rows and R measured speeds; inferred ones are
    no evidence.
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
            if _taken_over(track, squares[:, rotor] / felt, others, last_s) and not _turns(
                track, rotor, last_s
            ):
                found.append(StoppedRotor(rotor=rotor, time_s=last_s, until_s=until_s))
                break
    return tuple(sorted(found, key=lambda one: one.time_s))


class StoppedWatch:
    """The same of a flight that goes on, of which it keeps the rows that a comparison needs."""

    def __init__(self) -> None:
        self._kept: FlightTrack | None = None

    def add(self, track: FlightTrack) -> Bools:
        """(N, R) of N new rows, in order: True in the last one of a rotor that stands by then."""
        kept, found = self._kept, np.zeros(track.rotor_speed_rpm.shape, dtype=np.bool_)
        if not track.time_s.size:
            return found
        begin_s, goes_on = float(track.time_s[0]), kept and kept.rotor_count == track.rotor_count
        if kept and goes_on and kept.time_s[-1] < begin_s:  # else it was started anew
            first = int(np.searchsorted(kept.time_s, begin_s - 2.0 * (LOOK + LEFT_OUT)))
            track = kept.followed_by(track, first)
        self._kept = track
        for one in stopped_rotors(track):
            found[-1, one.rotor] = np.isinf(one.until_s)
        return found


def _taken_over(track: FlightTrack, own: Floats, others: Floats, time_s: float) -> bool:
    """Whether the others (T,) carry from `time_s` on what the rotor's own (T,) did before."""
    rows = _sides(track, time_s)
    sides = [others[side & np.isfinite(others)] for side in rows]
    own = own[rows[0] & np.isfinite(own)]
    if min(len(side) for side in (*sides, own)) < FEWEST_ROWS:
        return False
    was, now = (float(np.median(side)) for side in sides)
    return bool(np.log(now / was) > TAKEN_OVER * np.log1p(float(np.median(own)) / was))


def _turns(track: FlightTrack, rotor: int, time_s: float) -> bool:
    """Whether the autopilot asks of a rotor after `time_s` what it asks of one that turns; False
    where its outputs are not known, or show nothing of what the others do."""
    asked = track.throttle
    own, others = asked[:, rotor], np.mean(np.delete(asked, rotor, axis=1), axis=1)
    rows = [side & np.isfinite(own) & (others > 0.0) for side in _sides(track, time_s)]
    if min(np.count_nonzero(side) for side in rows) < FEWEST_ROWS:
        return False
    rise = np.median(others[rows[1]]) / np.median(others[rows[0]])
    was, now = (float(np.median(own[side] / others[side])) for side in rows)
    return bool(rise > FOLLOWED) and OFF * was < now < IN_VAIN * was


def _sides(track: FlightTrack, time_s: float) -> tuple[Bools, Bools]:
    """The rows in flight before `time_s` and after it that are compared."""
    since = track.time_s - time_s
    before = track.flying & (since <= -LEFT_OUT) & (since >= -LOOK)
    return before, track.flying & (since >= LEFT_OUT) & (since <= LOOK)
