"""Estimate thrust from the motor outputs of a flight, independent of gauge and ESCs.

    T_i = T_full,i f(x_i)          T_full by the airframe's ceiling at the battery's voltage

x motor output, f the autopilot's thrust curve (`physics.motor_output`). This is a third estimate
with weight and rotor speeds: compared two by two, all pairs may agree within wide limits while
all three together cannot be true.

    s(ln T)² = (s_f ln f)² + s_c² (+ the variance of guessed quantities)

s_f standard error of the curve's steepness, about full output; s_c of a measured ceiling. A surplus
over weight or speeds contradicts them from SURELY standard errors on. From SHOWS on (from one on
where no parameter sets the curve) an interval is extended to it, because too wide an interval does
no harm.

The ceiling is also too high where the battery reads more than a full one (`voltage.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from thrustmargin.models.checks.loss_of_control import FULL_OUTPUT
from thrustmargin.models.checks.speed_readings import FEWEST_ROWS, lifted_mass
from thrustmargin.models.checks.voltage import ceiling_too_high
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.physics.margin import ceiling, rotor_thrust
from thrustmargin.models.physics.motor_output import OutputCurve, output_curve
from thrustmargin.models.physics.smoothing import known_median

#: Standard errors of ln thrust: of a measured ceiling, and of each guessed quantity behind it.
CEILING_ERROR, GUESS = 0.05, 0.1
CURVE_ERROR = 0.03  # of a thrust curve that was measured on a bench
SURELY = 2.6  # standard errors beyond which two cannot both be true: 99 %
NINETY = 1.645
SHOWS = 0.5  # standard errors of surplus from which an interval is extended to it
_BEHIND = ("max_rotor_speed_rpm", "ceiling_voltage")  # quantities behind the ceiling
_LIFTED = ("thrust_coefficient", "empty_mass")  # behind the mass by rotor speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputEvidence:
    """Thrust by motor outputs in flight, against weight and against rotor speeds; NaN where
    unknown."""

    lifted_kg: float  # median mass that the outputs would lift with `load_kg` on board; NaN unknown
    load_kg: float  # median load in flight; NaN unknown
    over_speeds: float  # ln of their thrust over that of the measured rotor speeds; NaN
    error: float  # standard error of ln of their thrust
    shows: float = float("nan")  # ln of a surplus from which an interval is extended to it
    by_speeds_kg: float = float("nan")  # median mass that the measured rotor speeds lift
    by_speeds_error: float = float("nan")  # standard error of ln of it
    #: Share by which the ceiling's thrust is too high, as the battery reads beyond a full one.
    ceiling_high: float = 0.0

    @property
    def disagrees_with_speeds(self) -> bool:
        """Return True if outputs and measured rotor speeds cannot both be true."""
        return abs(self.over_speeds) > SURELY * self.error

    def more_than(self, mass: float) -> float:
        """Return the kg that the outputs lift beyond `mass` kg; 0 if that is not significant."""
        beyond = self.lifted_kg - mass
        return beyond if beyond > self.shows * self.lifted_kg else 0.0

    def share_beyond(self, mass: float) -> float:
        """Return the surplus of thrust over `mass` kg as a share of it; 0 if none is significant.

        The largest of: by outputs, by rotor speeds (90 %), and by a ceiling that is too high.
        """
        by_speeds = self.by_speeds_kg / mass - 1.0
        shown = by_speeds > NINETY * self.by_speeds_error
        return max(self.more_than(mass) / mass, by_speeds if shown else 0.0, self.ceiling_high)

    @property
    def share_beyond_speeds(self) -> float:
        """Return the surplus of output thrust over that of the measured speeds, as a share; 0 if
        none is significant.

        At least the share by which the ceiling is too high.
        """
        shown = self.over_speeds > self.shows
        return max(float(np.expm1(self.over_speeds)) if shown else 0.0, self.ceiling_high)

    @property
    def share_of_speeds(self) -> float:
        """Return thrust by outputs over that of the measured speeds where it is significantly
        less; else 1."""
        return float(np.exp(self.over_speeds)) if self.over_speeds < -self.shows else 1.0


def output_evidence(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> OutputEvidence:
    """Estimate thrust by motor outputs over a flight's T rows; `parameters` are the autopilot's.

    Inferred rotor speeds are excluded.
    """
    return _evidence(track, airframe, output_curve(parameters, track.source("throttle")))


@lru_cache(maxsize=1)  # four callers need it for one flight
def _evidence(track: FlightTrack, airframe: Airframe, curve: OutputCurve) -> OutputEvidence:
    """Compare the thrust by motor outputs with the load and with the thrust by rotor speeds.

    `curve` is the autopilot's thrust curve. Values are medians in flight: masses in kg, the ratio
    as a logarithm with its error. All NaN if the airframe has another number of rotors.
    """
    nan = float("nan")
    if track.rotor_count != airframe.rotor_count:
        return OutputEvidence(lifted_kg=nan, load_kg=nan, over_speeds=nan, error=nan)
    share = curve.thrust_share(track.throttle)
    thrust = thrust_by_outputs(track, airframe, curve)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.log(thrust / thrust_by_speeds(track, airframe))
        turned = _median(np.log(share)[track.flying].ravel())
    error = np.hypot(
        curve.steepness_error * turned, _thrust_error(CEILING_ERROR, airframe, _BEHIND)
    )
    load_kg = known_median(track.tank_kg[track.flying])
    # Where outputs or speeds are known for a part of the flight, its load is not that of the whole.
    lighter = np.nan_to_num(load_kg - track.tank_kg)
    return OutputEvidence(
        lifted_kg=_median(lifted_mass(track, thrust) + lighter),
        load_kg=load_kg,
        over_speeds=_median(np.where(track.flying, ratio, np.nan)),
        error=float(error),
        shows=float(error) * (1.0 if curve.is_assumed else SHOWS),
        by_speeds_kg=_median(lifted_mass(track, thrust_by_speeds(track, airframe)) + lighter),
        by_speeds_error=_thrust_error(CURVE_ERROR, airframe, _LIFTED),
        ceiling_high=ceiling_too_high(track.voltage, airframe),
    )


def _thrust_error(measured: float, airframe: Airframe, behind: tuple[str, ...]) -> float:
    """Return the standard error of ln thrust: the measured part and GUESS for each guessed
    quantity in `behind`."""
    guesses = sum(airframe.quantities[name].guessed for name in behind)
    return float(np.sqrt(measured**2 + guesses * GUESS**2))


def thrust_by_outputs(track: FlightTrack, airframe: Airframe, curve: OutputCurve) -> Floats:
    """Return the total thrust (T,), N, that the motor outputs imply.

    It is the thrust share of each output, by `curve`, of the rotor's largest thrust at this density
    and voltage. NaN where an output is unknown, or where some outputs are full and others not: the
    autopilot gives a stopped rotor full output.
    """
    limits = ceiling(airframe, track_air(track).density, track.voltage)
    thrust = np.sum(limits.max_thrust * curve.thrust_share(track.throttle), axis=1)
    full = track.throttle >= FULL_OUTPUT
    return np.where(full.any(axis=1) & ~full.all(axis=1), np.nan, thrust)


def thrust_by_speeds(track: FlightTrack, airframe: Airframe) -> Floats:
    """Return the thrust (T,) N of the measured rotor speeds; NaN where one is unknown."""
    speeds = track.measured("rotor_speed_rpm")
    return np.sum(rotor_thrust(airframe, speeds, track_air(track).density), axis=1)


def _median(values: Floats) -> float:
    """Return the median of the finite values; NaN with fewer than FEWEST_ROWS of them."""
    known = values[np.isfinite(values)]
    return known_median(known) if known.size >= FEWEST_ROWS else float("nan")
