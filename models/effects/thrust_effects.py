"""Effects on the thrust that a rotor makes at a given speed (thrust coefficient).

Air density, drift with time, battery voltage, inflow (climb, forward flight, ground) and the loss
of thrust of one rotor: constant, from an onset on, or for a limited time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import (
    KAPPA_FLOOR,
    TORQUE_SHARE,
    Effect,
    Kind,
    Parameter,
    Values,
    shaping,
)
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.forward_flight import induced_ratio

LEAST_DENSITY_ERROR = 0.01  # of the model's density: 3 K, or 100 m of height


def _warm_air_ratio(p, x: Channels):
    """Return the density at the reported or standard temperature with the offset, over that
    without."""
    return x.air_temperature / (x.air_temperature + p["temperature_offset"])


def _density_ratio(p, x: Channels):
    # In a model that already follows density, a second offset corrects the thermometer only.
    """Return the factor of thrust by air density over the reference density."""
    density = x.reported_density / x.reference_density
    return density ** (1.0 / x.density_effects) * _warm_air_ratio(p, x)


def _density_torque(p, x: Channels):
    """Return the factor of torque by air density."""
    return 1.0 + p["torque_share"] * (_density_ratio(p, x) - 1.0)


def _density_weight(p, x: Channels):
    """Return the RMS influence of density over the least that is reported."""
    return np.sqrt(np.mean((_density_ratio(p, x) - 1.0) ** 2)) / LEAST_DENSITY_ERROR


AIR_DENSITY = Effect(
    name="air_density",
    kind=Kind.COEFFICIENT,
    parameters=(
        Parameter(
            name="temperature_offset", unit="K", absent=None, lower=-35.0, upper=35.0, scale=8.0
        ),
        replace(
            TORQUE_SHARE, lower=0.0, upper=1.0, scale=0.5
        ),  # simulators may have no torque of air
    ),
    needs=("reported_density", "air_temperature"),
    neutral={
        "reported_density": lambda p, x: (
            x.reference_density / _warm_air_ratio(p, x) ** x.density_effects
        )
    },
    source="thrust goes with air density; the offset is of the air to what the log has",
    apply=_density_ratio,
    torque=_density_torque,
    weight=_density_weight,
    temperature_offset=lambda p: float(p["temperature_offset"]),
)


THRUST_DRIFT = Effect(
    name="thrust_drift",
    kind=Kind.COEFFICIENT,
    parameters=(
        # Smallest: air that warms by 3 K in 10 minutes.
        Parameter(name="rate", unit="1/s", lower=-1e-3, upper=2e-3, scale=1e-4, smallest=1.7e-5),
    ),
    source="icing, fouling or dust: all rotors lose thrust as time goes on",
    apply=lambda p, x: 1.0 - p["rate"] * x.time_s,
)


def _voltage_thrust(p, x: Channels):
    """Return the factor of thrust by battery voltage."""
    right_at = (1.0 + p["level"]) * x.reference_voltage
    return np.exp(p["exponent"] * np.log(x.voltage / right_at))


BATTERY_VOLTAGE = Effect(
    name="battery_voltage",
    kind=Kind.COEFFICIENT,
    # Smallest: 0.5 % of thrust where the voltage falls by a tenth. Bounds: a motor's speed goes at
    # most in proportion to the voltage, so thrust at a speed that is reported the same whatever
    # the battery goes at most with V², and at one worked out in that proportion, if it does not go
    # so at all, with 1 / V²; and an error of a fifth.
    parameters=(
        Parameter(
            name="exponent", unit="1", start=1.0, lower=-2.5, upper=2.5, scale=0.5, smallest=0.05
        ),
        # Where speeds that somebody works out are right, against a full battery: a lithium cell has
        # 4.2 V when full, 3.7 V on its label (12 % less, twice the usual size), 3.4 V when empty.
        # Taken to be right at a full one, what they are off by all along would be hidden mass.
        Parameter(name="level", unit="1", detail=True, lower=-0.2, upper=0.1, scale=0.06),
    ),
    needs=("voltage", "moving_voltage"),
    neutral={"voltage": lambda p, x: (1.0 + p["level"]) * x.reference_voltage},
    source="not physics of a measured rotor speed: simulators and estimated speeds that ignore "
    "the battery show thrust going with voltage^p, speeds that follow it too far against it",
    apply=_voltage_thrust,
)


CLIMB_SHARE = 0.15  # share of the scatter of axial inflow that must be due to climb


def _climb_weight(p, x: Channels):
    """Return the share of axial inflow due to climb over the least that is reported."""
    inflow = np.std(x.advance_ratio)
    return np.std(x.climb_ratio) / (CLIMB_SHARE * inflow) if inflow > 0.0 else 0.0


CLIMB_INFLOW = Effect(
    name="climb_inflow",
    kind=Kind.COEFFICIENT,
    # Smallest: 0.3 % of the thrust at 2 m/s, by up- and downdraughts.
    parameters=(
        Parameter(name="slope", unit="1", lower=-2.0, upper=6.0, scale=1.0, smallest=0.05),
    ),
    needs=("advance_ratio",),
    neutral={"advance_ratio": 0.0},
    of_every_aircraft=True,
    source="blade element: thrust falls with the advance ratio of the axial inflow, J = w 60/(N D)",
    apply=lambda p, x: 1.0 - p["slope"] * x.advance_ratio,
    weight=_climb_weight,
)


def _lifted_thrust(p, x: Channels):
    """Return the factor of thrust by translational lift."""
    return 1.0 + p["gain"] * (1.0 - induced_ratio(x.airspeed / x.hover_induced_velocity))


TRANSLATIONAL_LIFT = Effect(
    name="translational_lift",
    kind=Kind.COEFFICIENT,
    # Smallest: a wind of 1 m/s that nobody reports.
    parameters=(Parameter(name="gain", unit="1", lower=-0.5, upper=1.0, scale=0.1, smallest=0.01),),
    needs=("airspeed", "hover_induced_velocity"),
    neutral={"airspeed": 0.0},
    of_every_aircraft=True,
    source="Glauert: induced velocity in forward flight, v_i/v_h = sqrt(sqrt(1 + m^4/4) - m^2/2), "
    "m = V/v_h",
    apply=_lifted_thrust,
)

GROUND_EFFECT = Effect(
    name="ground_effect",
    kind=Kind.COEFFICIENT,
    parameters=(
        # Ground never takes thrust away. Smallest: what slopes and crops change of a lone rotor's.
        Parameter(
            name="strength", unit="1", start=0.0625, lower=0.0, upper=3.0, scale=0.2, smallest=0.02
        ),
    ),
    needs=("radius_over_height",),
    neutral={"radius_over_height": 0.0},
    source="Cheeseman and Bennett: 1/kappa = 1 - k (R/z)^2, k = 1/16 for one rotor",
    apply=lambda p, x: 1.0 / (1.0 - p["strength"] * x.radius_over_height**2),
)


LONG_BEFORE = 1e4  # s


def _degraded_thrust(p, x: Channels):
    """Return the factor of thrust of a degraded rotor, in the rows of its time span."""
    return 1.0 - p["loss"] * _after_onset(p, x)


def _degraded_torque(p, x: Channels):
    """Return the factor of torque of a degraded rotor, in the rows of its time span."""
    return np.maximum(1.0 - p["loss"] * p["torque_share"] * _after_onset(p, x), KAPPA_FLOOR)


def _after_onset(p, x: Channels):
    """Return (T,): 1 from the onset in `p` to its end, 0 outside; 1 everywhere without an onset.

    Onset and end, s, are Unix times (`onset_clock`, `end_clock`) or on the flight's clock
    (`onset_time`, `end_time`); without an end the 1 lasts. The edges are smooth.
    """
    if "onset_clock" in p:
        began = _step(x.clock_s - p["onset_clock"])
        return began * _step(p["end_clock"] - x.clock_s) if "end_clock" in p else began
    if "onset_time" not in p:
        return 1.0 + 0.0 * x.time_s
    began = _step(x.time_s - p["onset_time"])
    return began * _step(p["end_time"] - x.time_s) if "end_time" in p else began


def _step(seconds):
    """Return a smooth step: 0 well before zero seconds and 1 well after."""
    return 1.0 / (1.0 + np.exp(-np.clip(4.0 * seconds, -40.0, 40.0)))


def _with_weak_rotor(p: Values, airframe: Airframe, rotor: int | None) -> Airframe:
    """Return the airframe with the rotor's effectiveness reduced by the loss."""
    effectiveness = airframe.rotor_effectiveness.copy()
    effectiveness[rotor] *= 1.0 - float(p["loss"])
    return replace(airframe, rotor_effectiveness=effectiveness)


#: Smallest: propellers differ by 0.3 to 0.5 % as they are balanced, folded and warm.
LOSS = Parameter(name="loss", unit="1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.004)

ONSET_TIME = replace(
    shaping("onset_time", "s", start=0.0, lower=0.0, upper=1e5, scale=60.0), resolution=0.3
)

ROTOR_DEGRADATION = Effect(
    name="rotor_degradation",
    kind=Kind.COEFFICIENT,
    parameters=(LOSS, TORQUE_SHARE),
    source="a worn, chipped or dirty propeller makes less thrust at a speed",
    apply=_degraded_thrust,
    torque=_degraded_torque,
    of_one_rotor=True,
    on_airframe=_with_weak_rotor,
)

ROTOR_DEGRADATION_ONSET = replace(
    ROTOR_DEGRADATION,
    variant="onset",
    parameters=tuple(replace(p, per_flight=True) for p in (LOSS, ONSET_TIME, TORQUE_SHARE)),
    source="a propeller that chips in flight makes less thrust from then on",
    begins=True,
    afterwards=ROTOR_DEGRADATION,
)

ROTOR_DEGRADATION_WHILE = replace(
    ROTOR_DEGRADATION_ONSET,
    variant="for a while",
    parameters=tuple(
        replace(p, per_flight=True)
        for p in (LOSS, ONSET_TIME, replace(ONSET_TIME, name="end_time"), TORQUE_SHARE)
    ),
    source="a motor, an ESC or ice that takes thrust from a rotor and lets it come back",
    afterwards=None,
)

ROTOR_DEGRADATION_EACH = replace(
    ROTOR_DEGRADATION_ONSET,
    variant="in each flight",
    parameters=(LOSS, ONSET_TIME, TORQUE_SHARE),
    source="a rotor that weakens at the same time after each start, as one that gets warm",
    afterwards=None,
)

_CLOCK = replace(ONSET_TIME, name="onset_clock", upper=1e11)

ROTOR_DEGRADATION_SINCE = replace(
    ROTOR_DEGRADATION_EACH,
    variant="since",
    parameters=(LOSS, _CLOCK, TORQUE_SHARE),
    needs=("clock_s",),
    neutral={"clock_s": lambda p, x: p["onset_clock"] - LONG_BEFORE},
    source="a propeller that chips in one flight stays so in the flights after it",
    afterwards=ROTOR_DEGRADATION,
)

ROTOR_DEGRADATION_UNTIL = replace(
    ROTOR_DEGRADATION_SINCE,
    variant="until repaired",
    parameters=(LOSS, _CLOCK, replace(_CLOCK, name="end_clock"), TORQUE_SHARE),
    source="a propeller that was weak in some flights in a row and was replaced after them",
    afterwards=None,
    gone=True,
)

#: A rotor that degrades at some time: in one flight, in a part of it, in each at the same time, in
#: one and all later ones, in several consecutive ones.
ONSETS = (
    ROTOR_DEGRADATION_ONSET,
    ROTOR_DEGRADATION_WHILE,
    ROTOR_DEGRADATION_EACH,
    ROTOR_DEGRADATION_SINCE,
    ROTOR_DEGRADATION_UNTIL,
)


EFFECTS = (
    AIR_DENSITY,
    THRUST_DRIFT,
    BATTERY_VOLTAGE,
    CLIMB_INFLOW,
    TRANSLATIONAL_LIFT,
    GROUND_EFFECT,
    ROTOR_DEGRADATION,
    *ONSETS,
)
