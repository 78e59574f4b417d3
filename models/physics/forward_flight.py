"""How thrust at a rotor speed goes with airspeed, by physics: what carries a network on in wind.

    T cos(tilt) = m (g - a_down)                        vertical balance: drag is level
    D = (mu m + rho CdA V / 2) V                        rotor drag and parasite drag
    kappa = 1 + k (1 - v_i/v_h)                         translational lift, by Glauert
    apparent thrust / weight = sqrt(1 + (D/W)^2) / kappa

Rotor drag: Martin and Salaun, "The true role of accelerometer feedback in quadrotor control", 2010.
Drag is read from tilt and acceleration, without rotor speeds; k from rotor speeds against tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats, down_axis
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.flight_phases import training_rows, turning_rows
from thrustmargin.models.physics.smoothing import derivative

LEAST_ROWS = 300  # in straight flight, with attitude
KNOWN_SHARE = 0.95  # of the training rows, whose airspeed the network knows well
SMOOTH_SECONDS = 1.0  # over which velocity is differentiated
HUBER_SHARE = 0.01  # of weight, beyond which a row counts linearly


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardFlight:
    """What forward flight costs and gives, from the training flights."""

    rotor_drag: float  # mu, 1/s: m/s² of slowing down a m/s of airspeed
    drag_area: float  # CdA, m²
    lift_gain: float  # k, 1
    known_airspeed: float  # m/s, up to which the network itself is asked


class Straight(NamedTuple):
    """N rows of straight flight."""

    airspeed: Floats  # m/s
    mass: Floats  # kg
    density: Floats  # kg/m³
    slowing: Floats  # drag over mass along the airspeed, m/s²
    lift: Floats  # rotor force over apparent thrust


def hover_induced_velocity(mass: Floats, density: Floats | float, airframe: Airframe) -> Floats:
    """v_h, m/s, of rotors that carry `mass` kg in air of `density` kg/m³ (momentum theory)."""
    disc = np.pi * airframe.propeller_diameter**2 / 4 * airframe.rotor_count
    return np.sqrt(mass * G0 / (2 * density * disc))


def induced_ratio(airspeed_ratio: Any) -> Any:
    """v_i/v_h at V/v_h, for flight across the disc (Glauert)."""
    square = airspeed_ratio**2
    return np.sqrt(np.sqrt(1.0 + 0.25 * square**2) - 0.5 * square)


def steady_slowing(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: Floats | float
) -> Floats:
    """Drag over mass (N,) m/s² at airspeeds (N,) m/s."""
    return (flight.rotor_drag + 0.5 * density * flight.drag_area / mass * airspeed) * airspeed


def steady_load(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: Floats | float
) -> Floats:
    """Rotor force over weight (N,) in steady level flight: what drag adds to the weight."""
    return np.hypot(1.0, steady_slowing(flight, airspeed, mass, density) / G0)


def thrust_ratio(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: float, airframe: Airframe
) -> Floats:
    """Apparent thrust over weight (N,) in steady flight at `airspeed` (N,) m/s, mass (N,) kg."""
    induced = induced_ratio(airspeed / hover_induced_velocity(mass, density, airframe))
    lift = 1.0 + flight.lift_gain * (1.0 - induced)
    return steady_load(flight, airspeed, mass, density) / lift


def manoeuvre_load(
    flight: ForwardFlight, track: FlightTrack, airframe: Airframe, span: float
) -> Floats:
    """Rotor force over that of steady flight at the airspeed (T,), velocity derived over `span` s.

    Speeding up against drag takes more than both do apart; gusts that no channel reports are not
    in it, so that a wind or drag that is missing stays in the rotor speeds.
    """
    wind = np.where(np.isfinite(track.wind_ned), track.wind_ned, 0.0)
    way = (track.velocity_ned - wind) * np.array([1.0, 1.0, 0.0])
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-3)
    mass, density = airframe.empty_mass + track.tank_kg, track_air(track).density
    slowing = steady_slowing(flight, track.airspeed, mass, density)
    gained = derivative(track.time_s, track.velocity_ned, span)
    force = gained - np.array([0.0, 0.0, G0]) + slowing[:, None] * way
    return np.linalg.norm(force, axis=1) / G0 / steady_load(flight, track.airspeed, mass, density)


def fit_forward_flight(tracks: Sequence[FlightTrack], airframe: Airframe) -> ForwardFlight | None:
    """Drag and lift of the training flights; None where their rows do not show them."""
    parts = [straight_flight(track, airframe) for track in tracks]
    x = Straight(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    if x.airspeed.size < LEAST_ROWS or np.ptp(x.airspeed) < 1.0:
        return None
    per_mass = np.stack([x.airspeed, 0.5 * x.density * x.airspeed**2 / x.mass], axis=1)
    # The air pushes nothing along: neither part of drag is less than none.
    rotor_drag, drag_area = _robust(per_mass, x.slowing, HUBER_SHARE * G0, least=0.0)
    induced = induced_ratio(x.airspeed / hover_induced_velocity(x.mass, x.density, airframe))
    columns = np.stack([np.ones_like(induced), 1.0 - induced], axis=1)
    level, gain = _robust(columns, x.lift, HUBER_SHARE)
    return ForwardFlight(
        rotor_drag=float(rotor_drag),
        drag_area=float(drag_area),
        lift_gain=float(gain / level),
        known_airspeed=float(np.quantile(x.airspeed, KNOWN_SHARE)),
    )


def wind_by_drag(track: FlightTrack, airframe: Airframe, flight: ForwardFlight) -> Floats:
    """(T, 2) m/s north, east: the wind in which drag would tilt the aircraft as it is tilted."""
    _, pushed = _balance(track)
    mass = airframe.empty_mass + track.tank_kg
    linear, square = flight.rotor_drag, 0.5 * track_air(track).density * flight.drag_area / mass
    drag = np.hypot(pushed[:, 0], pushed[:, 1])
    airspeed = 2.0 * drag / (linear + np.sqrt(linear**2 + 4.0 * np.maximum(square * drag, 0.0)))
    way = pushed / np.maximum(drag, 1e-9)[:, None]
    return track.velocity_ned[:, :2] - way * airspeed[:, None]


def _balance(track: FlightTrack) -> tuple[Floats, Floats]:
    """Rotor force over mass (T,), and what of it works against level drag (T, 2), m/s²."""
    gained = derivative(track.time_s, track.velocity_ned, SMOOTH_SECONDS)
    up = -down_axis(track.attitude)
    force = (G0 - gained[:, 2]) / -up[:, 2]
    return force, (force[:, None] * up - gained)[:, :2]


def straight_flight(track: FlightTrack, airframe: Airframe) -> Straight:
    """The straight rows of a flight that report everything."""
    force, pushed = _balance(track)
    wind = np.where(np.isfinite(track.wind_ned), track.wind_ned, 0.0)
    way = (track.velocity_ned - wind)[:, :2]
    speed = np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-3)
    slowing = np.sum(pushed * way, axis=1) / speed
    mass = airframe.empty_mass + track.tank_kg
    density = track_air(track).density
    apparent = airframe.thrust_coefficient * np.sum(
        airframe.rotor_effectiveness * track.rotor_speed_rpm**2, axis=1
    )
    keep = straight_rows(track)
    lift = np.full(mass.shape, np.nan)
    np.divide(mass * force * airframe.reference_density, apparent * density, out=lift, where=keep)
    columns = (track.airspeed, mass, density, slowing, lift)
    keep &= np.isfinite(np.stack(columns)).all(axis=0)
    return Straight(*(c[keep] for c in columns))


def straight_rows(track: FlightTrack) -> Bools:
    """(T,) training rows outside yaw turns."""
    return training_rows(track) & ~turning_rows(track)


def _robust(columns: Floats, wanted: Floats, scale: float, least: float = -np.inf) -> Floats:
    """Coefficients, none below `least`, of a linear fit with Huber's loss at `scale`."""
    from scipy.optimize import least_squares

    start = np.maximum(np.linalg.lstsq(columns, wanted, rcond=None)[0], least)
    fit = least_squares(
        lambda q: columns @ q - wanted, start, bounds=(least, np.inf), loss="huber", f_scale=scale
    )
    return fit.x
