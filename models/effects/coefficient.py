"""Effects on the coefficient: thrust made at a rotor speed, as a factor kappa on a0."""

from __future__ import annotations

from dataclasses import replace

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.physics.forward_flight import induced_ratio

CLIMB_SHARE = 0.15  # of the scatter of axial inflow, that must be climbing to be called so
LEAST_DENSITY_ERROR = 0.01  # of the model's density: 3 K, or 100 m of height


def _air_density(p, x: Channels, xp):  # noqa: ARG001
    warmer = x.isa_temperature / (x.isa_temperature + p["temperature_offset"])
    return x.reported_density * warmer / x.reference_density


def _air_density_torque(p, x: Channels, xp):
    return 1.0 + p["torque_share"] * (_air_density(p, x, xp) - 1.0)


def _air_density_weight(p, x: Channels, xp):
    return xp.sqrt(xp.mean((_air_density(p, x, xp) - 1.0) ** 2)) / LEAST_DENSITY_ERROR


def _translational_lift(p, x: Channels, xp):
    return 1.0 + p["gain"] * (1.0 - induced_ratio(x.airspeed / x.hover_induced_velocity, xp))


def _climb_inflow(p, x: Channels, xp):  # noqa: ARG001
    return 1.0 - p["slope"] * x.advance_ratio


def _climb_inflow_weight(p, x: Channels, xp):  # noqa: ARG001
    return xp.std(x.climb_ratio) / (CLIMB_SHARE * xp.std(x.advance_ratio))


def _ground_effect(p, x: Channels, xp):  # noqa: ARG001
    return 1.0 / (1.0 - p["strength"] * x.radius_over_height**2)


def _after_onset(p, x: Channels, xp):
    since = x.clock_s - p["onset_clock"] if "onset_clock" in p else x.time_s - p["onset_time"]
    return 1.0 / (1.0 + xp.exp(-xp.clip(4.0 * since, -40.0, 40.0)))


def _rotor_degradation(p, x: Channels, xp):  # noqa: ARG001
    return 1.0 - p["loss"] + 0.0 * x.time_s


def _rotor_degradation_torque(p, x: Channels, xp):  # noqa: ARG001
    return 1.0 - p["loss"] * p["torque_share"] + 0.0 * x.time_s


def _rotor_degradation_onset(p, x: Channels, xp):
    return 1.0 - p["loss"] * _after_onset(p, x, xp)


def _rotor_degradation_onset_torque(p, x: Channels, xp):
    return 1.0 - p["loss"] * p["torque_share"] * _after_onset(p, x, xp)


def _thrust_drift(p, x: Channels, xp):  # noqa: ARG001
    return 1.0 - p["rate"] * x.time_s


def _battery_voltage(p, x: Channels, xp):
    return xp.exp(p["exponent"] * xp.log(x.voltage / x.reference_voltage))


def _one(name: str, unit: str, **given) -> tuple[Parameter]:
    return (Parameter(name=name, unit=unit, absent=0.0, start=0.0, **given),)


#: How much of the thrust loss the torque shares: 0 when drag stays, 1 when it falls as much.
TORQUE_SHARE = Parameter(
    name="torque_share",
    unit="1",
    absent=None,
    start=0.5,
    lower=-1.0,
    upper=2.0,
    scale=0.5,
    detail=True,
)

ONSET_TIME = Parameter(
    name="onset_time",
    unit="s",
    absent=None,
    start=0.0,
    lower=0.0,
    upper=1e5,
    scale=60.0,
    detail=True,
    resolution=0.3,
)

AIR_DENSITY = Effect(
    name="air_density",
    kind=Kind.COEFFICIENT,
    parameters=(
        Parameter(
            name="temperature_offset",
            unit="K",
            absent=None,
            start=0.0,
            lower=-35.0,
            upper=35.0,
            scale=8.0,
        ),
        replace(TORQUE_SHARE, start=1.0, lower=0.0),
    ),
    needs=("reported_density", "isa_temperature"),
    shape_channels=("density",),
    source="thrust goes with air density; the offset is that of the air to the standard atmosphere",
    tell="read a shaded thermometer and a barometer; or fly the same load on a colder day",
    apply=_air_density,
    torque=_air_density_torque,
    weight=_air_density_weight,
    affine=True,
)

TRANSLATIONAL_LIFT = Effect(
    name="translational_lift",
    kind=Kind.COEFFICIENT,
    parameters=_one("gain", "1", lower=-0.5, upper=1.0, scale=0.1, smallest=0.01),
    needs=("airspeed", "hover_induced_velocity"),
    shape_channels=("airspeed",),
    source="Glauert: induced velocity in forward flight, v_i/v_h = sqrt(sqrt(1 + m^4/4) - m^2/2), "
    "m = V/v_h",
    tell="a straight line flown fast and slow at the same tank level",
    apply=_translational_lift,
)

CLIMB_INFLOW = Effect(
    name="climb_inflow",
    kind=Kind.COEFFICIENT,
    parameters=_one("slope", "1", lower=-2.0, upper=6.0, scale=1.0, smallest=0.05),
    needs=("advance_ratio",),
    shape_channels=("advance_ratio",),
    source="blade element: thrust falls with the advance ratio of the axial inflow, J = w 60/(N D)",
    tell="climb and descend at a steady rate at one tank level",
    apply=_climb_inflow,
    weight=_climb_inflow_weight,
)

GROUND_EFFECT = Effect(
    name="ground_effect",
    kind=Kind.COEFFICIENT,
    parameters=_one("strength", "1", lower=-1.0, upper=3.0, scale=0.2, smallest=0.02),
    needs=("radius_over_height",),
    shape_channels=("radius_over_height",),
    source="Cheeseman and Bennett: 1/kappa = 1 - k (R/z)^2, k = 1/16 for one rotor",
    tell="hover at one and at five rotor radii above ground",
    apply=_ground_effect,
)

ROTOR_DEGRADATION = Effect(
    name="rotor_degradation",
    kind=Kind.COEFFICIENT,
    parameters=(
        *_one("loss", "1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.008),
        TORQUE_SHARE,
    ),
    needs=(),
    shape_channels=("time_s",),
    source="a worn, chipped or dirty propeller makes less thrust at a speed",
    tell="swap the propeller with another arm's: a worn rotor moves, a wrong sensor stays",
    apply=_rotor_degradation,
    torque=_rotor_degradation_torque,
    of_one_rotor=True,
)

ROTOR_DEGRADATION_ONSET = replace(
    ROTOR_DEGRADATION,
    variant="onset",
    parameters=(
        *_one("loss", "1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.015, per_flight=True),
        replace(ONSET_TIME, per_flight=True),
        replace(TORQUE_SHARE, per_flight=True),
    ),
    source="a propeller that chips in flight makes less thrust from then on",
    apply=_rotor_degradation_onset,
    torque=_rotor_degradation_onset_torque,
    begins=True,
)

ROTOR_DEGRADATION_EACH = replace(
    ROTOR_DEGRADATION_ONSET,
    variant="in each flight",
    parameters=(
        *_one("loss", "1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.015),
        ONSET_TIME,
        TORQUE_SHARE,
    ),
    source="a rotor that weakens at the same time after each start, as one that gets warm",
)

ROTOR_DEGRADATION_SINCE = replace(
    ROTOR_DEGRADATION_EACH,
    variant="since",
    parameters=(
        *_one("loss", "1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.015),
        replace(ONSET_TIME, name="onset_clock", upper=1e11),
        TORQUE_SHARE,
    ),
    needs=("clock_s",),
    source="a propeller that chips in one flight stays so in the flights after it",
)

#: A rotor that goes bad at a moment: in one flight, in each at one time, in one and all later.
ONSETS = (ROTOR_DEGRADATION_ONSET, ROTOR_DEGRADATION_EACH, ROTOR_DEGRADATION_SINCE)

THRUST_DRIFT = Effect(
    name="thrust_drift",
    kind=Kind.COEFFICIENT,
    parameters=_one("rate", "1/s", lower=-1e-3, upper=2e-3, scale=1e-4, smallest=2e-5),
    needs=(),
    shape_channels=("time_s",),
    source="icing, fouling or dust: all rotors lose thrust as time goes on",
    tell="hover 60 s full and 60 s empty, then again with the tank held level",
    apply=_thrust_drift,
)

BATTERY_VOLTAGE = Effect(
    name="battery_voltage",
    kind=Kind.COEFFICIENT,
    parameters=_one("exponent", "1", lower=-4.0, upper=6.0, scale=0.5, smallest=0.05),
    needs=("voltage",),
    shape_channels=("voltage",),
    source="not physics of a measured rotor speed: simulators and estimated speeds that ignore "
    "the pack show thrust going with voltage^p",
    tell="the same load on a full and on an empty pack",
    apply=_battery_voltage,
)
