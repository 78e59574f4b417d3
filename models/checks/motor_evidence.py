"""Show what outputs and rotor speeds say of each motor at the moment in which a vehicle names one.

ArduPilot's "Potential Thrust Loss (n)" names the motor with the highest output
(libraries/AP_Motors/AP_MotorsMatrix.cpp, check_for_failed_motor). That is the motor that works
hardest: often a sound one next to a weak one. So each motor is compared with the others by its
speed at its output, as before take-off (`takeoff.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.speed_readings import FLOOR, TURNING
from thrustmargin.models.checks.takeoff import LEAST_POWER, MOST_POWER, exchanged_with
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.smoothing import known_mean

#: s before the report over which outputs and speeds are means: ArduPilot's check takes one second.
LOOK_S = 2.0
#: Share of the speed that the others reach at its output, below which a motor is slow: in the
#: flights recorded a sound one stays above 0.9 in means of LOOK_S.
SLOW_IN_FLIGHT = 0.8
#: Mean output of all motors from which none has much left: the weight or the battery is the cause.
ALL_HARD = 0.85


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorEvidence:
    """Outputs and speeds of the motors just before a time; NaN where unknown, motors from 0."""

    outputs: tuple[float, ...]  # share of full output
    speeds_rpm: tuple[float, ...]
    highest: int | None  # motor with the highest output
    slow: tuple[int, ...]  # slower than the others reach at their output
    exchanged: tuple[int, ...]  # two of which each follows the output of the other
    stands: tuple[int, ...]  # without turning, while their output asks for thrust

    @property
    def all_hard(self) -> bool:
        """Return True if the mean output of the motors is ALL_HARD or more; False without an
        output."""
        known = [share for share in self.outputs if math.isfinite(share)]
        return bool(known) and sum(known) / len(known) >= ALL_HARD

    @property
    def compared(self) -> bool:
        """Return True if the speeds and outputs of at least three motors are known."""
        pairs = zip(self.outputs, self.speeds_rpm, strict=True)
        return sum(math.isfinite(output + speed) for output, speed in pairs) >= 3


def motor_evidence(track: FlightTrack, time_s: float) -> MotorEvidence:
    """Compare the motors' mean outputs and speeds in the LOOK_S s up to the track's time `time_s`.

    Means are NaN where nothing was reported.
    """
    rows = (track.time_s > time_s - LOOK_S) & (track.time_s <= time_s)
    outputs = np.array([known_mean(column) for column in track.throttle[rows].T])
    measured = np.abs(track.measured("rotor_speed_rpm")[rows])
    speeds = np.array([known_mean(column) for column in measured.T])
    driven = np.nan_to_num(outputs) >= FLOOR
    slow = [k for k in np.flatnonzero(driven).tolist() if _is_slow(k, outputs, speeds)]
    pairs = [(k, other) for k in slow if (other := exchanged_with(k, speeds, outputs)) is not None]
    exchanged = tuple(sorted(pairs[0])) if pairs else ()
    slow = [k for k in slow if k not in exchanged]
    with np.errstate(invalid="ignore"):
        stands = np.flatnonzero(driven & (speeds < TURNING)).tolist()
    return MotorEvidence(
        outputs=tuple(outputs.tolist()),
        speeds_rpm=tuple(speeds.tolist()),
        highest=int(np.nanargmax(outputs)) if np.isfinite(outputs).any() else None,
        slow=tuple(slow),
        exchanged=exchanged,
        stands=tuple(stands),
    )


def _is_slow(motor: int, outputs: Floats, speeds: Floats) -> bool:
    """Return True if motor `motor`, from 0, is slower than most others would be at its output.

    `outputs` (R,) are 0 to 1, `speeds` (R,) rpm, NaN where unknown. False if fewer than two other
    motors turn with both known.
    """
    known = np.isfinite(outputs * speeds) & (outputs >= FLOOR) & (speeds >= TURNING)
    others = np.flatnonzero(known & (np.arange(outputs.size) != motor))
    if others.size < 2 or not math.isfinite(outputs[motor] * speeds[motor]):
        return False
    asked = outputs[motor] / outputs[others]
    least = np.minimum(asked**LEAST_POWER, asked**MOST_POWER)
    slower = speeds[motor] < SLOW_IN_FLIGHT * least * speeds[others]
    return bool(np.mean(slower) > 0.5)
