"""Is a reported rotor speed in rpm of the rotor? The thrust that the aircraft needs shows it.

In flight the rotors together make m f, f the upward specific force [m/s²] and m the mass. With
T = a (rho/rho_ref) N^2 the speed that a reported one should be is known to the square root of the
mass, so a wrong factor shows: pole pairs (an ESC that reports electrical rpm), 60 (rev/s),
2 pi/60 (rad/s), powers of ten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.smoothing import known_median

#: Pole pairs of motors that carry sprayers and their trainers.
POLE_PAIRS = (4, 6, 7, 10, 11, 12, 14, 15, 16, 18, 20, 21)
#: reported over true -> what that unit is
OTHER_UNITS = {
    1.0 / 60.0: "revolutions per second",
    2.0 * math.pi / 60.0: "rad/s",
    0.1: "tens of rpm",
    0.01: "hundreds of rpm",
    100.0: "hundredths of rpm",
}
#: A ratio within this of 1 is a rotor's own speed: payload, wear and air explain it.
USUAL = (0.75, 1.35)
#: A factor fits when the ratio over it is within this of 1.
CLOSE = 0.15
FEWEST_ROWS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedScale:
    """Reported rotor speed over the speed that the weight needs."""

    verdict: Literal["rotor", "electrical", "unit", "odd", "unknown"]
    words: str
    ratio: float  # with the tank as reported, else with half a tank
    low: float  # with a full tank where the level is unknown
    high: float  # with an empty one
    rows: int


def check_speed_scale(track: FlightTrack, airframe: Airframe) -> SpeedScale:
    """Compare the flight's rotor speeds with what its weight and the thrust curve need."""
    nan = float("nan")
    unknown = SpeedScale(
        verdict="unknown",
        words="cannot tell: too few rows in flight with every rotor's speed",
        ratio=nan,
        low=nan,
        high=nan,
        rows=0,
    )
    if track.rotor_count != airframe.rotor_count:
        return unknown
    density = track_air(track).density
    thrust = (
        airframe.thrust_coefficient
        * (density / airframe.reference_density)
        * np.sum(airframe.rotor_effectiveness * track.rotor_speed_rpm**2, axis=1)
    )
    lift = lifted_mass(track, thrust)
    use = np.isfinite(lift)
    rows = int(np.sum(use))
    if rows < FEWEST_ROWS:
        return replace(unknown, rows=rows)

    def ratio_with(tank_kg: np.ndarray | float) -> float:
        return known_median(np.sqrt(lift / (airframe.empty_mass + tank_kg)))

    lift = lift[use]
    gauge = track.measured("tank_kg")
    tank_kg = np.where(gauge >= 0, gauge, np.nan)[use]
    if np.isfinite(tank_kg).any():
        ratio = full = empty = ratio_with(tank_kg)
    else:
        full, empty = ratio_with(airframe.tank_capacity_kg), ratio_with(0.0)
        ratio = ratio_with(0.5 * airframe.tank_capacity_kg)
    verdict, words = _named(ratio, full, empty, airframe)
    return SpeedScale(verdict=verdict, words=words, ratio=ratio, low=full, high=empty, rows=rows)


def lifted_mass(track: FlightTrack, thrust: Floats) -> Floats:
    """(T,) kg that `thrust` (T,) N holds in the rows in flight, as the body accelerates in them."""
    # Thrust points up the body's axis: its specific force, without the drag of the body.
    upward = -track.specific_force_frd[:, 2]
    upward = np.where(np.isfinite(upward), upward, G0)
    use = track.flying & np.isfinite(thrust) & (thrust > 0) & (upward > 0.5 * G0)
    return np.where(use, thrust / np.where(use, upward, np.nan), np.nan)


def _named(
    ratio: float, low: float, high: float, airframe: Airframe
) -> tuple[Literal["rotor", "electrical", "unit", "odd"], str]:
    if low <= USUAL[1] and high >= USUAL[0]:
        return "rotor", f"rotor speeds fit the weight (ratio {ratio:.2f})"
    unit = min(OTHER_UNITS, key=lambda factor: abs(math.log(ratio / factor)))
    if abs(math.log(ratio / unit)) <= math.log(1 + CLOSE):
        return "unit", (
            f"rotor speeds are {ratio:.3g} times what the weight needs: they look like "
            f"{OTHER_UNITS[unit]}, not rpm"
        )
    own = airframe.motor_poles / 2.0
    pairs = sorted({float(p) for p in POLE_PAIRS} | {own})
    fitting = [p for p in pairs if low / (1 + CLOSE) <= p <= high * (1 + CLOSE)]
    if fitting:
        nearest = own if own in fitting else min(fitting, key=lambda p: abs(math.log(ratio / p)))
        words = (
            f"rotor speeds are {ratio:.1f} times what the weight needs: the ESC looks to report "
            f"electrical rpm; set its pole count ({2 * nearest:g} poles fits"
        )
        others = [f"{2 * p:g}" for p in fitting if p != nearest]
        return "electrical", words + (f", so would {', '.join(others)})" if others else ")")
    return "odd", (
        f"rotor speeds are {ratio:.2f} times what the weight and the thrust curve of "
        f"{airframe.name} need: wrong airframe, wrong unit, or a load that it does not know"
    )
