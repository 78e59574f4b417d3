"""Define thrust margin, redundancy and largest fill, once for forecast, view and report.

    ceiling          N_max = N_max,ref min(V/V_ref, 1)^n,   T_max,i = a e_i rho/rho_ref N_max²
    utilisation      u_i = T_i/T_max,i = (N_i/N_max)²       thrust margin = 1 - u_i
    redundancy       largest level collective with one rotor lost / weight; >= 1 survives in trim
    trimmable loss   largest share of one rotor's thrust that may be lost with the weight held level

a thrust coefficient at rho_ref, e_i effectiveness of rotor i, V battery voltage. Rotors are the
last axis, time the first: T rows, R rotors. NaN in gives NaN out. On a quad redundancy with yaw
uncontrolled is 1/(2u): it crosses 1 at u = 0.5, the origin of the 50 % limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.allocation import holdable, trim_curve
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.thrust import speed_from_thrust, thrust_from_speed

Criterion = Literal["utilisation", "yaw uncontrolled", "yaw kept"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ceiling:
    """The largest speed and thrust of the rotors in T rows."""

    max_rotor_speed_rpm: Floats  # (T,) rpm
    free_thrust: Floats  # (T,) N of a rotor outside other rotors' wash
    max_thrust: Floats  # (T, R) N
    voltage_basis: str


def ceiling(airframe: Airframe, density: ArrayLike, voltage: ArrayLike | None = None) -> Ceiling:
    """Compute the ceiling at `density` (T,) or a number, kg/m³, and battery `voltage` (T,) V, NaN
    unknown.

    An unknown voltage is replaced by the battery's nominal one, as `voltage_basis` states. Above
    the ceiling's own voltage the speed does not increase, because it was not measured there.
    """
    rho = np.atleast_1d(np.asarray(density, dtype=np.float64))
    given = np.nan if voltage is None else voltage
    rho, volts = np.broadcast_arrays(rho, np.asarray(given, dtype=np.float64))
    known = np.isfinite(volts) & (volts > 0.0)
    volts = np.where(known, volts, airframe.nominal_voltage)
    share = np.minimum(volts / airframe.ceiling_voltage, 1.0) ** airframe.ceiling_voltage_exponent
    speed = airframe.max_rotor_speed_rpm * share
    free = thrust_from_speed(
        speed,
        coefficient=airframe.thrust_coefficient,
        density=rho,
        reference_density=airframe.reference_density,
    )
    nominal = f"nominal voltage {airframe.nominal_voltage:g} V"
    if np.all(known):
        basis = "measured battery voltage"
    elif not np.any(known):
        basis = f"{nominal}: battery voltage not reported"
    else:
        basis = (
            f"measured battery voltage; {nominal} in {np.count_nonzero(~known)} rows without one"
        )
    return Ceiling(
        max_rotor_speed_rpm=speed,
        free_thrust=free,
        max_thrust=free[:, None] * airframe.rotor_effectiveness,
        voltage_basis=basis,
    )


def nameplate_ceiling(airframe: Airframe) -> Ceiling:
    """Return the ceiling, one row, by the maker's printed maximum thrust, for any air and
    battery."""
    free = np.array([airframe.nameplate_max_thrust])
    return Ceiling(
        max_rotor_speed_rpm=speed_from_thrust(free, coefficient=airframe.thrust_coefficient),
        free_thrust=free,
        max_thrust=free[:, None] * airframe.rotor_effectiveness,
        voltage_basis="nameplate",
    )


def weight(airframe: Airframe, tank_kg: ArrayLike) -> Floats:
    """Return the weight, N, of the aircraft with `tank_kg` of liquid (any shape)."""
    return (airframe.empty_mass + np.asarray(tank_kg, dtype=np.float64)) * G0


def rotor_thrust(airframe: Airframe, rotor_speed_rpm: Floats, density: Floats) -> Floats:
    """Return the thrust (T, R), N, of rotor speeds (T, R) in air of `density` (T,), by the
    thrust curve."""
    free = thrust_from_speed(
        rotor_speed_rpm,
        coefficient=airframe.thrust_coefficient,
        density=density[:, None],
        reference_density=airframe.reference_density,
    )
    return free * airframe.rotor_effectiveness


def utilisation(rotor_speed_rpm: Floats, max_rotor_speed_rpm: Floats) -> Floats:
    """Return u (T, R) of rotor speeds (T, R) under a ceiling (T,), both rpm.

    Thrust over largest thrust at one density and one coefficient: both cancel.
    """
    return (rotor_speed_rpm / max_rotor_speed_rpm[:, None]) ** 2


def hover_use(airframe: Airframe, limits: Ceiling, load: ArrayLike) -> Floats:
    """Return the worst rotor's u (T,) for a `load` in N, (T,) or a number, shared as well as
    possible.

    On a symmetric airframe that is the equal share of hover.
    """
    return np.asarray(load, dtype=np.float64) / (limits.free_thrust * holdable(airframe).intact)


def redundancy(airframe: Airframe, limits: Ceiling, load: ArrayLike, *, yaw_kept: bool) -> Floats:
    """Return the largest level thrust (T,) with the worst single rotor lost, over `load` (T,) in
    N."""
    held = holdable(airframe)
    worst = float(np.min(held.yaw_kept if yaw_kept else held.yaw_uncontrolled))
    return worst * limits.free_thrust / np.asarray(load, dtype=np.float64)


def trimmable_loss(
    airframe: Airframe, limits: Ceiling, load: ArrayLike, *, yaw_kept: bool = True
) -> Floats:
    """Return the share (T,) of its largest thrust that any one rotor can lose with `load` held
    level.

    It is that of the worst-placed rotor: 1 where a rotor can be lost altogether, 0 without
    a reserve. On a quad with heading kept it is the thrust margin 1 - u, with yaw uncontrolled 2 (1
    - u) up to 1.
    """
    collective = np.asarray(load, dtype=np.float64) / limits.free_thrust
    worst = np.where(np.isnan(collective), np.nan, np.inf)
    for rotor, full in enumerate(airframe.rotor_effectiveness):
        curve = trim_curve(airframe, rotor, yaw_kept)
        needed = np.interp(collective, curve.collective, curve.rotor)
        worst = np.minimum(worst, 1.0 - needed / full)
    return worst


def largest_fill(
    airframe: Airframe,
    limits: Ceiling,
    *,
    criterion: Criterion = "utilisation",
    limit: float | None = None,
) -> Floats:
    """Return the fill (T,) kg at which the worst rotor's u, or the redundancy, equals `limit`.

    `limit` is 0.5 for utilisation and 1 for redundancy unless given. The result is not limited to
    the tank: above its capacity a full tank is within the limit, below 0 even the empty aircraft
    exceeds it.
    """
    held = holdable(airframe)
    if criterion == "utilisation":
        collective = (0.5 if limit is None else limit) * held.intact
    else:
        lost = held.yaw_kept if criterion == "yaw kept" else held.yaw_uncontrolled
        collective = float(np.min(lost)) / (1.0 if limit is None else limit)
    return collective * limits.free_thrust / G0 - airframe.empty_mass
