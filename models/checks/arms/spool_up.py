"""Compare each motor at spool-up with the same motor on earlier flights of the aircraft.

At a common output a motor repeats the ratio of its speed to that of the others: ESC, motor and
propeller of one make differ by some per cent. Speed follows output by a power of about POWER, so

    v = ln(speed over the others') - POWER ln(output over the others')

is what is kept of a flight (`ArmQuantity.SPOOL_UP`), with the error that the power's makes. On a
heavy quad v differs by 0.03 to 0.07 between flights, because legs and gusts disturb a start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.arms.arm_figures import ArmFigure, ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_law import ArmLaw, departures
from thrustmargin.models.flight import Floats

#: Power of output that speed follows, and its standard deviation: 0.8 to 1.2 on aircraft recorded.
POWER, POWER_ERROR = 1.0, 0.1
#: Readings from which a motor is compared: one second at 10 Hz.
FEWEST = 10
#: Expected false findings of a run-up, over all its motors.
FALSE_FINDINGS = 1e-3
NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsualSpoolUp:
    """The v of each of R motors on earlier flights, with its standard deviation, and the number of
    standard deviations that no sound motor is off by."""

    value: Floats  # (R,)
    deviation: Floats  # (R,)
    most: float


def spool_up_figure(ratios: Sequence[tuple[float, float]]) -> ArmFigure | None:
    """Return v of each motor, in motor order, from its first run-up on the ground; None if none is
    known.

    v is ln of relative speed minus POWER times ln of relative output. `ratios` has a pair for each
    motor: its speed over the other motors' speed and its output over their output; NaN where
    unknown.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        speed, output = np.log(np.array(ratios, dtype=np.float64)).reshape(-1, 2).T
    value = speed - POWER * output
    if not np.isfinite(value).any():
        return None
    return ArmFigure(
        quantity=ArmQuantity.SPOOL_UP,
        value=tuple(value.tolist()),
        error=tuple((POWER_ERROR * np.abs(output)).tolist()),
    )


def usual_spool_up(law: ArmLaw | None, name: str, rotors: int) -> UsualSpoolUp | None:
    """Return the usual v (see `spool_up_figure`) of each motor, from the earlier flights in `law`.

    The flight called `name` is left out. None without a law, where too few flights have v, or where
    one has another number of motors than `rotors`.
    """
    zero = ArmFigure(quantity=ArmQuantity.SPOOL_UP, value=(0.0,) * rotors, error=(0.0,) * rotors)
    if law is None or any(
        len(one.value) != rotors
        for flight in law.flights
        if (one := flight.of(ArmQuantity.SPOOL_UP)) is not None
    ):
        return None
    found = departures([ArmFigures(flight=name, day=-1, figures=(zero,))], law)
    if not found:
        return None
    from scipy.special import stdtrit

    (one,) = found
    return UsualSpoolUp(
        value=-one.departure,
        deviation=np.sqrt(np.diag(one.covariance)),
        most=float(stdtrit(one.freedom, 1.0 - 0.5 * FALSE_FINDINGS / max(rotors, 1))),
    )


def unlike_before(
    usual: UsualSpoolUp, motor: int, speed: Floats, output: Floats
) -> tuple[Floats, Floats]:
    """Return how far a motor's v is from its usual one, and the limit for a sound motor, both (T,).

    Row t takes the mean of v over rows 0..t. `motor` is from 0; `speed` and `output` (T,) are the
    motor's, each over that of the other motors, NaN where not comparable. Both results are NaN in
    rows without a reading and before FEWEST readings.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        ln_speed, ln_output = np.log(speed), np.log(output)
    known = np.isfinite(ln_speed + ln_output)
    count = np.cumsum(known)
    enough = known & (count >= FEWEST)
    total = np.where(enough, count, 1)
    v = np.cumsum(np.where(known, ln_speed - POWER * ln_output, 0.0)) / total
    error = POWER_ERROR * np.abs(np.cumsum(np.where(known, ln_output, 0.0)) / total)
    off = np.where(enough, v - usual.value[motor], NAN)
    return off, np.where(enough, usual.most * np.hypot(usual.deviation[motor], error), NAN)
