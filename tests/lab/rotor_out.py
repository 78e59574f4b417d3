"""How much a multirotor holds after losing a rotor: flown in a simulation, and by redundancy = 1.

Example: python -m tests.lab.rotor_out

A rigid body with lagging motors hovers, and two seconds later one of them stops. A controller that
knows it asks the others for the moments that keep the attitude first, then for height, last for
heading. The largest load that still flies ten seconds later is found by halving, for every rotor,
and set beside the load at which redundancy is 1. Air resistance is left out: redundancy is one of
hover. No autopilot of today knows of a lost rotor at once; its loss of height until it does is not
in these figures.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.margin import ceiling, redundancy

G0, SEA_LEVEL_DENSITY = 9.80665, 1.225  # m/s², kg/m³

AIRFRAMES = ("agras-t20", "agras-t40")
STEP, MOTOR_LAG, LOST_AT, FLOWN = 0.01, 0.05, 2.0, 12.0  # s
SUNK, TILTED = 0.3, np.radians(15.0)  # m/s and rad in the last two seconds, beyond which it fell
#: what the controller asks for most: level, then height, then heading
WEIGHTS = np.sqrt([1.0, 30.0, 30.0, 0.02])
INERTIA = np.array([0.15, 0.15, 0.3])  # of mass x arm²: rotors and liquid near the middle
HALVINGS = 6


@dataclass(frozen=True, kw_only=True)
class Held:
    """kg that are held without one rotor (from 0), flown, and by redundancy of the worst rotor."""

    airframe: str
    rotor: int
    flown_kg: float
    worst_kg: float


def holds(craft: Airframe, rotor: int, mass: float) -> bool:
    """Whether the aircraft of `mass` kg still flies ten seconds after losing a rotor."""
    most = ceiling(craft, SEA_LEVEL_DENSITY).free_thrust.item() * craft.rotor_effectiveness
    x, y = craft.rotor_position_frd[:, :2].T / craft.arm
    yaw = craft.rotor_spin * craft.torque_ratio / craft.arm  # a rotor turns the body the other way
    effects = np.stack([np.ones_like(x), -y, x, yaw])  # N up, and N of moment over the arm, FRD
    inertia = INERTIA * mass * craft.arm  # over the arm, as the moments
    thrust: NDArray[np.float64] = np.full(x.size, mass * G0 / x.size)
    body, rates, sink, fallen = Rotation.identity(), np.zeros(3), 0.0, 0.0  # NED, down positive
    worst_sink, worst_tilt = 0.0, 0.0
    for k in range(round(FLOWN / STEP)):
        lost = k * STEP >= LOST_AT
        down = body.as_matrix()[2]  # the world's down in the body
        tilt = float(np.arccos(np.clip(down[2], -1.0, 1.0)))
        if tilt > np.radians(80.0):
            return False
        level = np.cross([0.0, 0.0, 1.0], down)  # turns the body's down onto the world's
        moment = inertia * (60.0 * level - 12.0 * rates)
        lift = mass * (G0 + 3.0 * sink + np.clip(1.5 * fallen, -3.0, 3.0)) / max(down[2], 0.5)
        bound = np.where(lost & (np.arange(x.size) == rotor), 1e-9, most)
        asked = np.array([lift, *moment])
        wanted = lsq_linear(WEIGHTS[:, None] * effects, WEIGHTS * asked, (0.0, bound), "bvls").x
        thrust = thrust + (wanted - thrust) * STEP / MOTOR_LAG
        thrust[rotor] *= not lost
        up, *turning = effects @ thrust
        turned = np.array(turning) - np.cross(rates, inertia * rates)
        rates = rates + turned / inertia * STEP
        body = body * Rotation.from_rotvec(rates * STEP)
        sink += (G0 - up / mass * down[2]) * STEP
        fallen += sink * STEP
        if k * STEP > FLOWN - 2.0:
            worst_sink, worst_tilt = max(worst_sink, sink), max(worst_tilt, tilt)
    return worst_sink < SUNK and worst_tilt < TILTED


def largest_held(craft: Airframe, rotor: int) -> float:
    """kg, by halving between a fifth of all thrust and all of it."""
    limits = ceiling(craft, SEA_LEVEL_DENSITY)
    high = limits.free_thrust.item() * float(craft.rotor_effectiveness.sum()) / G0
    low = 0.2 * high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(craft, rotor, middle) else (low, middle)
    return 0.5 * (low + high)


def sweep(name: str) -> list[Held]:
    """Every rotor of a shipped airframe."""
    craft = load_airframe(name)
    limits = ceiling(craft, SEA_LEVEL_DENSITY)
    worst = redundancy(craft, limits, 1.0, yaw_kept=False).item() / G0
    return [
        Held(airframe=name, rotor=r, flown_kg=largest_held(craft, r), worst_kg=worst)
        for r in range(craft.rotor_count)
    ]


def main() -> int:
    """Print the table."""
    table = Table("aircraft", "rotor lost", "held, flown", "redundancy = 1", "flown over that")
    for name in AIRFRAMES:
        for one in sweep(name):
            share = f"{one.flown_kg / one.worst_kg:.3f}"
            kg = (f"{one.flown_kg:.1f} kg", f"{one.worst_kg:.1f} kg")
            table.add_row(name, str(one.rotor + 1), *kg, share)
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
