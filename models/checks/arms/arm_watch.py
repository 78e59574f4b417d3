"""Follow the arms in a flight in progress: when a part passes its temperature's limit, which lead
is losing power, and which motor falls out of step with its ESC.

A temperature that rises by r K/s reaches a limit in (limit - T)/r s; by the first-order law of heat
it rises more slowly later, so this is the earliest time. A lead or lug with more resistance than
the others' brings its ESC less voltage, dU, at a current I, and is heated by I dU. Voltages are
compared with the other ESCs', less the difference that they had before take-off, which is of
instruments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.arms.desync import speed_falls
from thrustmargin.models.flight import FlightTrack, Floats, join_tracks

#: K at which the makers of heavy power systems raise an alarm: 105 °C of an ESC, 150 °C of a motor
#: (Hobbywing H15MD). Others reduce the power from 110 °C on (T-Motor).
ESC_LIMIT, MOTOR_LIMIT = 273.15 + 105.0, 273.15 + 150.0
LOOK_S = 30.0  # of readings from which a rise is measured
LEAST_LOOK_S = 10.0
LEAST_RISE = 2.0  # K in LOOK_S: readings are whole degrees
FEWEST_ARMS = 3  # of which one can be distinguished from the others
#: s in which falls out of step are counted, and of rows that are kept for them: a fall is compared
#: with what output and current do in the 10 s before.
DESYNC_S, KEPT_S = 20.0, 34.0
#: Readings before take-off, at least and at most, from which the instruments' differences are
#: known: the last ones are of motors that spin up.
LEAST_REST, MOST_REST = 5, 100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmHeat:
    """The heat of R arms, and their falls out of step, at N rows; NaN unknown."""

    esc_s: Floats  # (N, R) s until the ESC is at ESC_LIMIT; 0 beyond it, infinite while not rising
    motor_s: Floats  # (N, R) the same of the motor at MOTOR_LIMIT
    lead_watts: Floats  # (N, R) lost in the lead, more than in the others'
    desyncs: Floats  # (N, R) falls out of step in the last DESYNC_S; NaN where none could be seen


class ArmWatch:
    """The heat of one vehicle's arms, row by row."""

    def __init__(self) -> None:
        """Start without readings."""
        self._readings: dict[tuple[str, int], list[tuple[float, float]]] = {}
        self._recent: list[FlightTrack] = []  # the rows of the last KEPT_S, in parts
        self._second, self._falls = -1, np.zeros(0)  # of the last count, and what it was
        self._rest: list[Floats] = []  # (R,) ESC voltages at rest less their median

    def add(self, track: FlightTrack) -> ArmHeat:
        """Add the N rows of a track, later than those before, and return the arms' state per row.

        Its arrays (N, R): seconds until ESC and motor reach their temperature limits, W lost in
        each lead, and number of recent desyncs.
        """
        rows, rotors = track.esc_temperature.shape
        esc, motor = np.full((2, rows, rotors), np.nan)
        for row in range(rows):
            time_s = float(track.time_s[row])
            for arm in range(rotors):
                kelvin = float(track.esc_temperature[row, arm])
                esc[row, arm] = self._seconds("esc", arm, time_s, kelvin, ESC_LIMIT)
                kelvin = float(track.motor_temperature[row, arm])
                motor[row, arm] = self._seconds("motor", arm, time_s, kelvin, MOTOR_LIMIT)
        watts = self._lead_watts(track)
        return ArmHeat(esc_s=esc, motor_s=motor, lead_watts=watts, desyncs=self._desyncs(track))

    def _desyncs(self, track: FlightTrack) -> Floats:
        """Return the answered falls (N, R) of the DESYNC_S before the last full second of each row.

        They are counted once a second of the vehicle's clock, so that it does not matter how the
        rows are cut. NaN where a rotor has no measured speed or no output in the row.
        """
        rows, rotors = track.rotor_speed_rpm.shape
        counts, first = np.full((rows, rotors), np.nan), 0
        if not rows:
            return counts
        last = self._recent[-1] if self._recent else None
        if last is not None and (
            last.rotor_count != rotors or last.time_s[-1] >= track.time_s[0]
        ):  # another flight, or a restart
            self._recent, self._falls = [], np.zeros(rotors)
        for row in range(rows):
            second = math.floor(track.time_s[row])
            if second != self._second or self._falls.size != rotors:
                self._second = second
                self._recent.append(track.rows(slice(first, row + 1)))
                self._falls, first = self._counted(), row + 1
            counts[row] = self._falls
        if first < rows:
            self._recent.append(track.rows(slice(first, None)))
        known = np.isfinite(track.measured("rotor_speed_rpm")) & np.isfinite(track.throttle)
        return np.where(known, counts, np.nan)

    def _counted(self) -> Floats:
        """Return the answered falls (R,) of the last DESYNC_S, and drop rows beyond KEPT_S."""
        recent = join_tracks([(part, slice(None)) for part in self._recent])
        recent = recent.rows(recent.time_s > recent.time_s[-1] - KEPT_S)
        self._recent = [recent]
        near = recent.time_s > recent.time_s[-1] - DESYNC_S
        counted: Floats = speed_falls(recent).answered[near].sum(axis=0).astype(np.float64)
        return counted

    def _seconds(self, part: str, arm: int, time_s: float, kelvin: float, limit: float) -> float:
        """Store a temperature `kelvin` of a part at `time_s`, s, and return the s until it reaches
        `limit`, K, by its rise in the last LOOK_S s.

        0 at the limit; infinity if it hardly rises or has been known for less than LEAST_LOOK_S;
        NaN, without storing, where it is unknown. A step back in time begins anew.
        """
        if not math.isfinite(kelvin):
            return math.nan
        kept = self._readings.setdefault((part, arm), [])
        if kept and time_s <= kept[-1][0]:  # another flight, or a restart
            kept.clear()
        kept.append((time_s, kelvin))
        while time_s - kept[0][0] > LOOK_S:
            kept.pop(0)
        if kelvin >= limit:
            return 0.0
        long = time_s - kept[0][0]
        if long < LEAST_LOOK_S or kelvin - min(value for _, value in kept) < LEAST_RISE:
            return math.inf
        when, values = np.array(kept).T
        when = when - when.mean()
        rise = float(when @ values / (when @ when))
        return (limit - kelvin) / rise if rise > 0.0 else math.inf

    def _lead_watts(self, track: FlightTrack) -> Floats:
        """Return the power (N, R), W, lost in each lead beyond the other leads' median drop.

        NaN on the ground, where an ESC reports no voltage, and until enough voltages at rest, which
        give the offsets of the voltmeters, have been added.
        """
        volts, rotors = track.esc_voltage, track.rotor_count
        watts = np.full(volts.shape, np.nan)
        known = np.isfinite(volts).all(axis=1)
        if rotors < FEWEST_ARMS or not known.any():
            return watts
        resting = volts[known & ~track.flying]
        resting = resting - np.median(resting, axis=1, keepdims=True)
        self._rest = [*self._rest, *resting][-MOST_REST:]
        if len(self._rest) >= LEAST_REST:
            aloft = known & track.flying
            true = volts[aloft] - np.median(self._rest, axis=0)
            others = [[k for k in range(rotors) if k != arm] for arm in range(rotors)]
            lost = np.median(true[:, others], axis=2) - true
            watts[aloft] = lost * track.esc_current[aloft]
        return watts
