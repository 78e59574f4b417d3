"""The load's swing, worked out from the aircraft's motion alone, against where the load really was.

`models.effects.demand.slung_load` knows the aircraft's accelerometer and attitude and a cable
length, and nothing of the load. The data set has the load by motion capture, which no fit has used.

The load's mass m_l also follows from a plain regression of the rotors' thrust, as a yardstick:

    a S / g = m n + m_l (pull - n) + S (b1 J + b2 V²)

n is the load factor |f|/g, pull the cable's tension along the thrust axis in weights of the load;
J, V and S as in `thrust_check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.lab.measured.crazyflie import MeasuredFlight
from tests.lab.measured.thrust_check import DIAMETER, flow
from thrustmargin.models.effects.demand_effects import force_ned, swing
from thrustmargin.models.flight import Floats, down_axis

G0 = 9.80665  # m/s²


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SwingCheck:
    """How well the swing is told, over flights; angles in degrees."""

    apart: float  # root mean square angle between worked-out and measured direction
    apart_if_hanging: float  # the same for a load that hangs along apparent gravity
    swing_largest: float  # largest angle of the load from the vertical
    distance: float  # median m from the aircraft to the load by motion capture
    mass: float  # kg of the load by plain regression on the worked-out swing
    mass_by_capture: float  # kg likewise on the measured one


def check_swing(flights: Sequence[MeasuredFlight], cable: float, coefficient: float) -> SwingCheck:
    """Compare over all flights for a cable of `cable` m; `coefficient` is a in N/rpm²."""
    worked_out = [swing(f.track, np.array([cable])).pull[:, 0] for f in flights]
    apart, hanging, largest, distance = [], [], [], []
    for flight in flights:
        measured = unit(flight.load_ned)
        apart.append(angle_deg(measured, computed(flight, cable)))
        hanging.append(angle_deg(measured, _apparent_gravity(flight)))
        largest.append(angle_deg(measured, np.array([0.0, 0.0, 1.0])))
        distance.append(np.linalg.norm(flight.load_ned, axis=1))

    def together(parts: list[Floats]) -> Floats:
        values = np.concatenate(parts)
        return values[np.isfinite(values)]

    return SwingCheck(
        apart=float(np.sqrt(np.mean(together(apart) ** 2))),
        apart_if_hanging=float(np.sqrt(np.mean(together(hanging) ** 2))),
        swing_largest=float(np.max(together(largest))),
        distance=float(np.median(together(distance))),
        mass=_load_mass(flights, worked_out, coefficient),
        mass_by_capture=_load_mass(flights, [_captured_pull(f) for f in flights], coefficient),
    )


def _load_mass(
    flights: Sequence[MeasuredFlight], pulls: Sequence[Floats], coefficient: float
) -> float:
    """Least squares over all rows with every channel; kg."""
    columns, thrust = [], []
    for flight, pull in zip(flights, pulls, strict=True):
        track = flight.track
        climb, across = flow(track.attitude, track.velocity_ned)
        squares = np.sum(track.rotor_speed_rpm**2, axis=1)
        ratio = climb * 60.0 / (np.sqrt(squares / track.rotor_count) * DIAMETER)
        factor = np.linalg.norm(track.specific_force_frd, axis=1) / G0
        lift = coefficient * squares / G0
        columns.append(np.stack([factor, pull - factor, lift * ratio, lift * across**2], axis=1))
        thrust.append(lift)
    x, y = np.concatenate(columns), np.concatenate(thrust)
    good = np.isfinite(x).all(axis=1) & np.isfinite(y)
    return float(np.linalg.lstsq(x[good], y[good], rcond=None)[0][1])


def _captured_pull(flight: MeasuredFlight) -> Floats:
    """Tension along the thrust axis in weights of the load, from its measured direction, (T,)."""
    force, down = force_ned(flight.track)
    direction = unit(flight.load_ned)
    rate = np.gradient(direction, flight.track.time_s, axis=0)
    length = float(np.nanmedian(np.linalg.norm(flight.load_ned, axis=1)))
    tension = length * np.sum(rate**2, axis=1) - np.sum(direction * force, axis=1)
    return tension * np.sum(direction * down, axis=1) / G0


def computed(flight: MeasuredFlight, cable: float) -> Floats:
    """Direction to the load in NED, (T, 3), from the aircraft's own motion."""
    return swing(flight.track, np.array([cable])).direction_ned[:, 0]


def unit(vectors: Floats) -> Floats:
    """Vectors (T, 3) at length 1."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def angle_deg(first: Floats, second: Floats) -> Floats:
    """Angle between unit vectors, (T,) deg."""
    return np.degrees(np.arccos(np.clip(np.sum(first * second, axis=1), -1.0, 1.0)))


def _apparent_gravity(flight: MeasuredFlight) -> Floats:
    """Where a load hangs that does not swing: (T, 3), very long ago settled on a very short cable.

    That is the direction opposite to the aircraft's specific force, its own down axis in essence.
    """
    return down_axis(flight.track.attitude)
