"""Find the moments at which a motor falls out of step with its ESC (desync).

A motor that loses the ESC's field slows down at once and is caught again, while the ESC goes on to
ask for the speed. Its speed falls by more than its output allows and comes back within RETURN_S.
Speed follows output by a power up to MOST_POWER with a lag of up to LAG_S, as in the check before
take-off: a fall that the lowest output of that time explains is the autopilot's, and one that the
other rotors share is the air's. Rotors that stay slow are left to other checks.

A wrong frame of telemetry looks alike for one reading. A fall is `answered` if in the moment the
autopilot drives this motor harder or the ESC's current departs from its own level, by more than
either does otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.speed_readings import TURNING
from thrustmargin.models.checks.takeoff import LAG_S, MOST_POWER
from thrustmargin.models.flight import Bools, FlightTrack, Floats

#: Share of its speed that a rotor loses at least. Gusts and inflow move a rotor of fixed output by
#: a few per cent.
LEAST_FALL = 0.12
#: Standard deviations of the noise of a rotor's own speed that a fall has at least.
NOISES = 6.0
#: s before a reading from which the speed falls, and s within which it comes back.
FALL_S, RETURN_S = 0.35, 2.0
#: Share of the fall that must be made good again.
RETURNS = 0.5
#: Median absolute deviations of output and current from which either answers a fall, and the share
#: of their level that they must move by.
ANSWERS, LEAST_ANSWER = 6.0, 0.05
FEWEST_ROTORS = 3  # of which one can be distinguished from the others
ANSWER_S = 0.6  # s after the fall in which the answer comes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpeedFalls:
    """Falls of T rows and R rotors: at the row of the lowest reading of each."""

    fell: Bools  # (T, R) the output does not explain the fall, and the speed came back
    answered: Bools  # (T, R) those that output or current answered


def speed_falls(track: FlightTrack) -> SpeedFalls:
    """Find short falls of measured rotor speed in flight that no motor output explains.

    The result flags (T, R) the lowest row of each fall, and of these the falls that the controller
    answered. A fall must return within RETURN_S: one that has not yet is not flagged. Nothing is
    found with fewer than FEWEST_ROTORS rotors, or for rotors without outputs.
    """
    time_s = track.time_s
    speed, output = np.abs(track.measured("rotor_speed_rpm")), track.throttle
    rows, rotors = speed.shape
    fell, answered = np.zeros((2, rows, rotors), dtype=np.bool_)
    if rows < 3 or not track.flying.any():
        return SpeedFalls(fell=fell, answered=answered)
    first = np.searchsorted(time_s, time_s - FALL_S - 1e-6)
    asked_first = np.searchsorted(time_s, time_s - FALL_S - LAG_S - 1e-6)
    last = np.searchsorted(time_s, time_s + RETURN_S)
    for rotor in range(rotors) if rotors >= FEWEST_ROTORS else ():
        others = np.sort(np.delete(speed, rotor, axis=1), axis=1)[:, (rotors - 1) // 2]
        own, asked = speed[:, rotor], output[:, rotor]
        known = np.isfinite(own) & np.isfinite(asked) & track.flying
        least = max(LEAST_FALL, NOISES * _noise(own[known]))
        # A quick look first: most rows are near the speed of the one before.
        before = np.fmax.reduce([_shifted(own, step) for step in (1, 2, 3)])
        with np.errstate(invalid="ignore"):
            rows_of = np.flatnonzero(known & (own < (1.0 - least) * before))
        taken = -1
        for row in rows_of.tolist():
            if row <= taken:
                continue
            part = slice(int(first[row]), row)
            level = float(np.fmax.reduce(own[part], initial=np.nan))
            if not level >= TURNING:
                continue
            # The outputs before the fall made the speed that is lost; an answer to it is no cause.
            top = part.start + int(np.nanargmax(own[part]))
            high = float(np.fmax.reduce(asked[int(asked_first[row]) : top + 1]))
            low = float(np.fmin.reduce(asked[int(asked_first[row]) : row + 1]))
            explained = (low / high) ** MOST_POWER if high > 0.0 else 0.0
            theirs = float(np.fmax.reduce(others[part], initial=np.nan))
            explained = min(explained, float(others[row]) / theirs if theirs > 0.0 else math.nan)
            if not own[row] < (1.0 - least) * explained * level:
                continue
            after = own[row : int(last[row])]
            lowest = row + int(np.nanargmin(after))
            back = own[lowest : int(last[row])]
            regained = float(np.fmax.reduce(back)) - own[lowest]
            if regained < RETURNS * (level - own[lowest]):
                continue
            fell[lowest, rotor] = True
            answered[lowest, rotor] = _answered(track, lowest, rotor)
            taken = int(last[row])
    return SpeedFalls(fell=fell, answered=answered)


def _noise(speed: Floats) -> float:
    """Return the standard deviation of the noise of speeds (n,), as a share; 0 for fewer than 3.

    By second differences, which a steady change does not move, and their median, which falls do
    not move either.
    """
    if speed.size < 3:
        return 0.0
    bend = np.abs(speed[2:] - 2.0 * speed[1:-1] + speed[:-2])
    return 1.4826 * float(np.median(bend)) / math.sqrt(6.0) / max(float(np.median(speed)), 1.0)


def _shifted(values: Floats, step: int) -> Floats:
    """Return values (T,) of `step` rows before; NaN at the start."""
    moved = np.full(values.shape, np.nan)
    moved[step:] = values[:-step]
    return moved


def _answered(track: FlightTrack, row: int, rotor: int) -> bool:
    """Return True if a rotor's relative output or ESC current moved at the fall in row `row`.

    It must move by more than its scatter over the seconds before; output upwards, current either
    way. Unknown channels count as not moved.
    """
    time_s = track.time_s
    near = slice(
        int(np.searchsorted(time_s, time_s[row] - 2.0 * FALL_S)),
        int(np.searchsorted(time_s, time_s[row] + ANSWER_S, side="right")),
    )
    level = slice(
        int(np.searchsorted(time_s, time_s[row] - 10.0)),
        int(np.searchsorted(time_s, time_s[row] - 2.0 * FALL_S)),
    )
    outputs, harder = track.throttle, np.full(time_s.size, np.nan)
    known = np.isfinite(outputs).any(axis=1)
    harder[known] = outputs[known, rotor] - np.nanmedian(outputs[known], axis=1)
    for values, both_ways in ((harder, False), (track.esc_current[:, rotor], True)):
        usual, now = values[level], values[near]
        usual, now = usual[np.isfinite(usual)], now[np.isfinite(now)]
        if usual.size < 10 or not now.size:
            continue
        middle = float(np.median(usual))
        scatter = 1.4826 * float(np.median(np.abs(usual - middle)))
        size = abs(middle) if both_ways else float(np.nanmedian(track.throttle[level, rotor]))
        apart = now - middle
        most = float(np.max(np.abs(apart) if both_ways else apart))
        if most > max(ANSWERS * scatter, LEAST_ANSWER * size):
            return True
    return False
