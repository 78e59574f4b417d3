"""Matching of power system and load: the paper's Eq. 6-8 and Figure 10 for any airframe.

Everything is for hover in the air of the airframe's thrust curve. Thrust of "a rotor" is the mean
over the rotors when all turn at one speed; on a coaxial airframe the upper ones make more of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.predict import Basis, predict
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import (
    Ceiling,
    ceiling,
    hover_use,
    largest_fill,
    nameplate_ceiling,
    redundancy,
    weight,
)
from thrustmargin.models.physics.thrust import (
    LoadMatching,
    dimensionless_coefficient,
    load_matching,
    speed_from_thrust,
    thrust_coefficient_range,
)

#: m/s and shares of the tank at which the network is asked for Figure 10: the paper's three speeds
#: and its three payloads 4, 10 and 16 of 16 kg.
FIGURE_AIRSPEEDS = (2.0, 4.0, 6.0)
FIGURE_TANK_SHARES = (0.25, 0.625, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingMatch:
    """The load against one ceiling; `full` and `empty` are of the tank."""

    name: str
    max_thrust: float  # N, mean over the rotors
    use_full: float
    use_empty: float
    redundancy_yaw_free_full: float
    redundancy_yaw_free_empty: float
    redundancy_yaw_kept_full: float
    redundancy_yaw_kept_empty: float
    fill_half_use: float  # kg at which capacity use is 50 %; not cut to the tank
    fill_one_rotor_out: float  # kg at which redundancy with heading given up is 1; likewise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matching:
    """Load and power system of one airframe side by side."""

    airframe: Airframe
    load: LoadMatching
    rotor_speed_full_rpm: float
    rotor_speed_empty_rpm: float
    thrust_coefficient: float  # C_T of the fitted curve
    thrust_coefficient_range: tuple[float, float]  # C_T of Eq. 3 over the printed parameters
    ceilings: tuple[CeilingMatch, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NetworkPoints:
    """Rotor speeds that a learnt model predicts at P airspeeds and tank levels."""

    title: str  # of the aircraft whose flights taught it, which may be a simulated one
    airspeed: Floats  # (P,) m/s
    tank_kg: Floats  # (P,) kg
    rotor_speed_rpm: Floats  # (P, R)
    load: Floats  # (P,) N that a rotor carries
    left_out: int  # points outside the model's training envelope


def match_airframe(airframe: Airframe) -> Matching:
    """Eq. 6-8, the two thrust coefficients, and the load against each ceiling of the airframe.

    Ceilings are the nameplate or what stands for it, the maximum of the thrust curve at its own
    voltage, and that at the pack's nominal voltage where this is lower.
    """
    full, empty = weight(airframe, airframe.tank_capacity_kg), weight(airframe, 0.0)
    effective = float(airframe.rotor_effectiveness.sum()) * airframe.thrust_coefficient
    air = airframe.reference_density
    maker = airframe.quantities["nameplate_max_thrust"].source
    estimated = maker.startswith(("derived", "assumed"))
    named = [
        ("estimated maximum" if estimated else "nameplate", nameplate_ceiling(airframe)),
        (
            f"curve maximum, {airframe.max_rotor_speed_rpm:g} rpm "
            f"at {airframe.ceiling_voltage:g} V",
            ceiling(airframe, air, airframe.ceiling_voltage),
        ),
    ]
    if airframe.nominal_voltage < airframe.ceiling_voltage:
        name = f"curve maximum at the nominal {airframe.nominal_voltage:g} V"
        named.append((name, ceiling(airframe, air, airframe.nominal_voltage)))
    return Matching(
        airframe=airframe,
        load=load_matching(airframe),
        rotor_speed_full_rpm=float(speed_from_thrust(full, coefficient=effective)),
        rotor_speed_empty_rpm=float(speed_from_thrust(empty, coefficient=effective)),
        thrust_coefficient=dimensionless_coefficient(
            airframe.thrust_coefficient, density=air, diameter=airframe.propeller_diameter
        ),
        thrust_coefficient_range=thrust_coefficient_range(
            pitch=airframe.propeller_pitch,
            diameter=airframe.propeller_diameter,
            blades=airframe.propeller_blades,
        ),
        ceilings=tuple(_against(airframe, name, limits, full, empty) for name, limits in named),
    )


def _against(
    airframe: Airframe, name: str, limits: Ceiling, full: Floats, empty: Floats
) -> CeilingMatch:
    return CeilingMatch(
        name=name,
        max_thrust=float(limits.max_thrust.mean()),
        use_full=hover_use(airframe, limits, full).item(),
        use_empty=hover_use(airframe, limits, empty).item(),
        redundancy_yaw_free_full=redundancy(airframe, limits, full, yaw_kept=False).item(),
        redundancy_yaw_free_empty=redundancy(airframe, limits, empty, yaw_kept=False).item(),
        redundancy_yaw_kept_full=redundancy(airframe, limits, full, yaw_kept=True).item(),
        redundancy_yaw_kept_empty=redundancy(airframe, limits, empty, yaw_kept=True).item(),
        fill_half_use=largest_fill(airframe, limits).item(),
        fill_one_rotor_out=largest_fill(airframe, limits, criterion="yaw free").item(),
    )


def same_aircraft(first: Airframe, second: Airframe) -> bool:
    """True when two airframe files describe one design: mass, tank, propeller, curve and rotors.

    Their air and voltage may differ, as between an aircraft and its simulation.
    """
    return first.rotor_count == second.rotor_count and all(
        np.isclose(getattr(first, name), getattr(second, name))
        for name in ("empty_mass", "tank_volume_l", "propeller_diameter", "thrust_coefficient")
    )


def network_points(
    airframe: Airframe,
    model: RotorModel,
    *,
    airspeeds: Sequence[float] = FIGURE_AIRSPEEDS,
    tank_shares: Sequence[float] = FIGURE_TANK_SHARES,
) -> NetworkPoints:
    """What the model's network predicts over a grid of airspeed (m/s) and share of the tank.

    The model is asked in the air of its training, and Eq. 1 carries its speeds over to the air of
    its airframe's thrust curve, in which the figure is drawn. Raises ModelError when it was made
    for another aircraft, or when its network covers none of the points.
    """
    if not same_aircraft(airframe, model.airframe):
        raise ModelError(
            f"the model was made for {model.airframe.name}, not for {airframe.name}; "
            "give --model a file trained on this aircraft"
        )
    speed, share = (g.ravel() for g in np.meshgrid(airspeeds, tank_shares, indexing="ij"))
    tank = share * airframe.tank_capacity_kg
    rows = speed.size
    still = np.zeros((rows, 3))
    track = FlightTrack.of(
        name="Figure 10",
        time_s=np.arange(rows, dtype=np.float64),
        rotor_count=airframe.rotor_count,
        airspeed=speed,
        tank_kg=tank,
        velocity_ned=np.stack([speed, still[:, 0], still[:, 0]], axis=1),
        wind_ned=still,
    )
    predicted = predict(model, track, np.full(rows, model.reference_density))
    to_curve = np.sqrt(model.reference_density / model.airframe.reference_density)
    learnt = np.asarray(predicted.basis) == Basis.NETWORK
    if not np.any(learnt):
        raise ModelError(
            f"the model for {model.airframe.name} has no network that covers these speeds and "
            "tank levels; train one with `thrustmargin train`"
        )
    return NetworkPoints(
        title=model.airframe.title,
        airspeed=speed[learnt],
        tank_kg=tank[learnt],
        rotor_speed_rpm=predicted.rotor_speed_rpm[learnt] * to_curve,
        load=weight(airframe, tank[learnt]) / airframe.rotor_count,
        left_out=int(np.count_nonzero(~learnt)),
    )
