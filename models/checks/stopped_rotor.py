"""Did a rotor stand still in flight, or did its ESC only fall silent? By what the others carry.

    step = ln(sum_{i != k} N_i^2/f) after - before,      all of it: ln(1 + N_k^2/sum_{i != k} N_i^2)

N_i rotor speeds, f specific force felt. A rotor that stops leaves its share of the weight to the
others; one whose speed is no longer reported leaves them as they were. With six rotors or more an
aircraft may fly on so, and all other numbers of it look sound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.atmosphere import G0

#: s of flight before and after that are compared, and about the moment that are left out
LOOK, LEFT_OUT = 4.0, 0.5
FEWEST_ROWS = 10  # known on each side
TAKEN_OVER = 0.6  # share of the whole step from which the others carry what it did


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedRotor:
    """A rotor from 0, and s of the flight at which it was last known to turn."""

    rotor: int
    time_s: float


def stopped_rotors(track: FlightTrack) -> tuple[StoppedRotor, ...]:
    """Rotors that stopped in flight for LOOK seconds or more, in order of time.

    Of T rows and R measured speeds; inferred ones are no evidence.
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
        for row in known[np.diff(track.time_s[known], append=np.inf) > LOOK].tolist():
            if _taken_over(track, squares[:, rotor] / felt, others, float(track.time_s[row])):
                found.append(StoppedRotor(rotor=rotor, time_s=float(track.time_s[row])))
                break
    return tuple(sorted(found, key=lambda one: one.time_s))


def _taken_over(track: FlightTrack, own: Floats, others: Floats, time_s: float) -> bool:
    """Whether the others (T,) carry from `time_s` on what the rotor's own (T,) did before."""
    since = track.time_s - time_s
    before = track.flying & (since <= -LEFT_OUT) & (since >= -LOOK)
    after = track.flying & (since >= LEFT_OUT) & (since <= LOOK)
    sides = [others[rows & np.isfinite(others)] for rows in (before, after)]
    own = own[before & np.isfinite(own)]
    if min(len(side) for side in (*sides, own)) < FEWEST_ROWS:
        return False
    was, now = (float(np.median(side)) for side in sides)
    return bool(np.log(now / was) > TAKEN_OVER * np.log1p(float(np.median(own)) / was))
