"""Match power system and load of any airframe: the paper's Eq. 6-8 and Figure 10.

Everything is for hover in the air of the airframe's thrust curve. Thrust of "a rotor" is the mean
over the rotors when all turn at one speed; on a coaxial airframe the upper ones make more of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import (
    Ceiling,
    ceiling,
    hover_use,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingMatch:
    """The load compared with one ceiling; `full` and `empty` refer to the tank."""

    name: str
    max_thrust: float  # N, mean over the rotors
    use_full: float
    use_empty: float
    redundancy_yaw_uncontrolled_full: float
    redundancy_yaw_uncontrolled_empty: float
    redundancy_yaw_kept_full: float
    redundancy_yaw_kept_empty: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matching:
    """The comparison of load and power system of one airframe."""

    airframe: Airframe
    load: LoadMatching
    rotor_speed_full_rpm: float
    rotor_speed_empty_rpm: float
    thrust_coefficient: float  # C_T of the fitted curve
    thrust_coefficient_range: tuple[float, float]  # C_T of Eq. 3 over the printed parameters
    ceilings: tuple[CeilingMatch, ...]


def match_airframe(airframe: Airframe) -> Matching:
    """Compute Eq. 6-8, the two thrust coefficients, and the load against each ceiling of the
    airframe.

    Ceilings are the nameplate or its estimate, the maximum of the thrust curve at its own voltage,
    and that at the battery's nominal voltage where this is lower.
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
        ceilings=tuple(
            _ceiling_match(airframe, name, limits, full, empty) for name, limits in named
        ),
    )


def _ceiling_match(
    airframe: Airframe, name: str, limits: Ceiling, full: Floats, empty: Floats
) -> CeilingMatch:
    """Compare the weights with a full and an empty tank, N, with one set of largest thrusts.

    Return utilisation in hover and redundancy for both; `name` is the ceiling's.
    """
    survived = partial(redundancy, airframe, limits)
    return CeilingMatch(
        name=name,
        max_thrust=float(limits.max_thrust.mean()),
        use_full=hover_use(airframe, limits, full).item(),
        use_empty=hover_use(airframe, limits, empty).item(),
        redundancy_yaw_uncontrolled_full=survived(full, yaw_kept=False).item(),
        redundancy_yaw_uncontrolled_empty=survived(empty, yaw_kept=False).item(),
        redundancy_yaw_kept_full=survived(full, yaw_kept=True).item(),
        redundancy_yaw_kept_empty=survived(empty, yaw_kept=True).item(),
    )


def same_aircraft(first: Airframe, second: Airframe) -> bool:
    """Return True if two airframes are of one design: mass, tank, propeller, curve and rotor count.

    Their air and voltage may differ, as between an aircraft and its simulation.
    """
    return first.rotor_count == second.rotor_count and all(
        np.isclose(getattr(first, name), getattr(second, name))
        for name in ("empty_mass", "tank_volume_l", "propeller_diameter", "thrust_coefficient")
    )
