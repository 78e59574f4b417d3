"""Compute thrust from motor output, by inverting the autopilot's curve from thrust to output.

    ArduPilot   c = (x - spin_min)/(spin_max - spin_min)      T/T_full = (1 - e) c + e c²
    PX4         T/T_full = f x² + (1 - f) x

x motor output from 0 to 1 of the pulse range, e MOT_THST_EXPO, f THR_MDL_FAC. Sources: ArduPilot
libraries/AP_Motors/AP_Motors_Thrust_Linearization.cpp (thrust_to_actuator and its inverse), PX4
src/lib/mixer_module/functions/FunctionMotors.hpp. Both contain the builder's settings, not the
motor's behaviour: ArduPilot's MOT_BAT_VOLT_MAX makes full thrust follow (1 - e) v + e v² of the
battery's share v, which is true for an ESC that passes the voltage on, not for one that keeps a
speed. So voltage is no part of this curve: `model.inferred.output_speed` fits its exponent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import NOT_REPORTED, Meaning, Provenance
from thrustmargin.models.statement import Statement, state

#: ArduPilot's defaults; the exponent is that of most propellers, so PX4 without a factor has it too
USUAL_EXPO, USUAL_SPIN_MIN, USUAL_SPIN_MAX = 0.65, 0.15, 0.95
#: standard error of the curve's steepness, as a share: on the Quiver thrust rises 1.87 times as
#: fast as output where its own MOT_THST_EXPO gives 2.2. Twice that where no parameter sets a curve.
STEEPNESS_SET, STEEPNESS_ASSUMED = 0.15, 0.3
_CURVE_FIELDS = ("expo", "low", "high", "is_thrust_factor", "steepness_error")
_LEAST = 0.01  # share of full thrust below which the curve is not used


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputCurve:
    """The curve T/T_full = (1 - expo) c + expo c², with c from 0 at output `low` to 1 at output
    `high`."""

    expo: float
    low: float = 0.0
    high: float = 1.0
    is_thrust_factor: float = (
        0.0  # if above 0: outputs are PX4 thrust before its curve with this factor
    )
    steepness_error: float = STEEPNESS_SET
    set_by: Statement  # the parameter or the assumption that sets it

    @property
    def is_assumed(self) -> bool:
        """Return True if no parameter of the vehicle sets the curve."""
        return self.steepness_error == STEEPNESS_ASSUMED

    @property
    def numbers(self) -> tuple[tuple[str, float], ...]:
        """Return the numbers that set `thrust_share`, by name, for the provenance of results."""
        return tuple((name, getattr(self, name)) for name in _CURVE_FIELDS)

    def thrust_share(self, throttle: Floats) -> Floats:
        """Return the thrust, over that of full output, at motor outputs `throttle` (0 to 1, any
        shape).

        NaN where the motor idles or the output is unknown.
        """
        signal = throttle
        if (f := self.is_thrust_factor) > 0.0:
            signal = (f - 1.0 + np.sqrt((1.0 - f) ** 2 + 4.0 * f * throttle)) / (2.0 * f)
        c = (signal - self.low) / (self.high - self.low)
        share = (1.0 - self.expo) * c + self.expo * c**2
        return np.where((c > 0.0) & (share > _LEAST), share, np.nan)


def curve_of(speeds: Provenance, outputs: Provenance) -> OutputCurve:
    """Return the output curve stored in the provenance `speeds` of inferred rotor speeds.

    If `speeds` contains none, return the default curve for the source `outputs`.
    """
    numbers = dict(speeds.numbers)
    if not numbers.keys() >= {*_CURVE_FIELDS}:
        return output_curve({}, outputs)
    known = {name: numbers[name] for name in _CURVE_FIELDS}
    return OutputCurve(set_by=state("curve of speeds", source=speeds), **known)


def output_curve(parameters: Mapping[str, float], source: Provenance = NOT_REPORTED) -> OutputCurve:
    """Return the curve from motor output to thrust that a vehicle's parameters set.

    `source` is that of the outputs: PX4's `actuator_motors` is thrust before its curve, its servo
    outputs are after it. A parameter outside the range that the firmware allows counts as not set.
    """
    factor = parameters.get("THR_MDL_FAC")
    before = source.meaning is Meaning.THRUST_DEMAND
    if factor is not None or before or source.meaning is Meaning.PX4_OUTPUT:
        if factor is not None and 0.0 < factor <= 1.0:
            return OutputCurve(
                expo=factor,
                is_thrust_factor=factor if before else 0.0,
                set_by=state("thrust factor", factor=factor),
            )
        return OutputCurve(
            expo=USUAL_EXPO,
            steepness_error=STEEPNESS_ASSUMED,
            set_by=state("thrust exponent assumed", expo=USUAL_EXPO),
        )
    low = parameters.get("MOT_SPIN_MIN", USUAL_SPIN_MIN)
    high = parameters.get("MOT_SPIN_MAX", USUAL_SPIN_MAX)
    if not 0.0 <= low < high <= 1.0:
        low, high = USUAL_SPIN_MIN, USUAL_SPIN_MAX
    expo = parameters.get("MOT_THST_EXPO", np.nan)
    is_set = -1.0 <= expo <= 1.0
    return OutputCurve(
        expo=expo if is_set else USUAL_EXPO,
        low=low,
        high=high,
        steepness_error=STEEPNESS_SET if is_set else STEEPNESS_ASSUMED,
        set_by=state("exponent set", expo=expo)
        if is_set
        else state("exponent assumed", expo=USUAL_EXPO),
    )
