"""Model how thrust at a rotor speed depends on airspeed, to extrapolate a network in wind.

    T cos(tilt) = m (g - a_down)                        vertical balance: drag is level
    D = (mu m + rho CdA V / 2) V                        rotor drag and parasite drag
    kappa = 1 + k (1 - v_i/v_h)                         translational lift, by Glauert
    apparent thrust / weight = sqrt(1 + (D/W)^2) / kappa

Rotor drag: Martin and Salaun, "The true role of accelerometer feedback in quadrotor control", 2010.
Drag is fitted to tilt and acceleration, without rotor speeds; k to rotor speeds against tilt.
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
KNOWN_SHARE = 0.95  # quantile of training airspeeds up to which the network is used
SMOOTH_SECONDS = 1.0  # over which velocity is differentiated
HUBER_SHARE = 0.01  # share of weight, beyond which the loss is linear


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardFlight:
    """Drag and lift in forward flight, fitted to the training flights."""

    rotor_drag: float  # mu, 1/s: drag over mass and airspeed
    drag_area: float  # CdA, m²
    lift_gain: float  # k, 1
    known_airspeed: float  # m/s, up to which the network itself is used


class Straight(NamedTuple):
    """Channels of N rows of straight flight, all finite."""

    airspeed: Floats  # m/s
    mass: Floats  # kg
    density: Floats  # kg/m³
    slowing: Floats  # m/s², drag over mass along the airspeed
    lift: Floats  # rotor force over apparent thrust


def hover_induced_velocity(mass: Floats, density: Floats | float, airframe: Airframe) -> Floats:
    """Return v_h, m/s, of rotors that carry `mass` kg in air of `density` kg/m³ (momentum
    theory)."""
    disc = np.pi * airframe.propeller_diameter**2 / 4 * airframe.rotor_count
    return np.sqrt(mass * G0 / (2 * density * disc))


def induced_ratio(airspeed_ratio: Any) -> Any:
    """Return v_i/v_h at V/v_h, for flight across the disc (Glauert)."""
    square = airspeed_ratio**2
    return np.sqrt(np.sqrt(1.0 + 0.25 * square**2) - 0.5 * square)


def steady_slowing(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: Floats | float
) -> Floats:
    """Return drag over mass (N,) m/s² at airspeeds (N,) m/s and masses (N,) kg."""
    return (flight.rotor_drag + 0.5 * density * flight.drag_area / mass * airspeed) * airspeed


def steady_load(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: Floats | float
) -> Floats:
    """Return rotor force over weight (N,) in steady level flight, drag included."""
    return np.hypot(1.0, steady_slowing(flight, airspeed, mass, density) / G0)


def thrust_ratio(
    flight: ForwardFlight, airspeed: Floats, mass: Floats, density: float, airframe: Airframe
) -> Floats:
    """Return apparent thrust over weight (N,) in steady flight at `airspeed` (N,) m/s, mass (N,)
    kg."""
    induced = induced_ratio(airspeed / hover_induced_velocity(mass, density, airframe))
    lift = 1.0 + flight.lift_gain * (1.0 - induced)
    return steady_load(flight, airspeed, mass, density) / lift


def manoeuvre_load(
    flight: ForwardFlight, track: FlightTrack, airframe: Airframe, span: float
) -> Floats:
    """Return the rotor force (T,) divided by that of steady flight at the same airspeed.

    Velocity is differentiated over `span` s. Acceleration and drag are added as vectors. An unknown
    wind counts as 0, so that its drag remains in the residual of the rotor speeds.
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
    """Fit drag and lift of forward flight to the training flights.

    None with too few rows or too small a range of airspeed.
    """
    parts = [straight_flight(track, airframe) for track in tracks]
    x = Straight(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    if x.airspeed.size < LEAST_ROWS or np.ptp(x.airspeed) < 1.0:
        return None
    per_mass = np.stack([x.airspeed, 0.5 * x.density * x.airspeed**2 / x.mass], axis=1)
    # Drag never accelerates, so neither part is negative.
    rotor_drag, drag_area = _huber_fit(per_mass, x.slowing, HUBER_SHARE * G0, least=0.0)
    induced = induced_ratio(x.airspeed / hover_induced_velocity(x.mass, x.density, airframe))
    columns = np.stack([np.ones_like(induced), 1.0 - induced], axis=1)
    level, gain = _huber_fit(columns, x.lift, HUBER_SHARE)
    return ForwardFlight(
        rotor_drag=float(rotor_drag),
        drag_area=float(drag_area),
        lift_gain=float(gain / level),
        known_airspeed=float(np.quantile(x.airspeed, KNOWN_SHARE)),
    )


def wind_by_drag(track: FlightTrack, airframe: Airframe, flight: ForwardFlight) -> Floats:
    """Return the wind (T, 2), m/s, north and east, whose drag would explain the aircraft's tilt.

    It is the velocity of the air, so it points where the air moves to. NaN where tilt, velocity or
    mass is unknown.
    """
    _, pushed = _balance(track)
    mass = airframe.empty_mass + track.tank_kg
    linear, square = flight.rotor_drag, 0.5 * track_air(track).density * flight.drag_area / mass
    drag = np.hypot(pushed[:, 0], pushed[:, 1])
    airspeed = 2.0 * drag / (linear + np.sqrt(linear**2 + 4.0 * np.maximum(square * drag, 0.0)))
    way = pushed / np.maximum(drag, 1e-9)[:, None]
    return track.velocity_ned[:, :2] - way * airspeed[:, None]


def _balance(track: FlightTrack) -> tuple[Floats, Floats]:
    """Return rotor force over mass (T,), m/s², and its part (T, 2) against level drag, m/s²."""
    gained = derivative(track.time_s, track.velocity_ned, SMOOTH_SECONDS)
    up = -down_axis(track.attitude)
    force = (G0 - gained[:, 2]) / -up[:, 2]
    return force, (force[:, None] * up - gained)[:, :2]


def straight_flight(track: FlightTrack, airframe: Airframe) -> Straight:
    """Return airspeed, mass, density, deceleration by drag and lift ratio in rows of straight
    flight.

    All are (n,) in SI; the lift ratio is thrust needed over thrust by the rotor speeds. Rows with
    any of the five unknown are left out. An unknown wind counts as 0.
    """
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
    """Flag the training rows (T,) outside yaw turns."""
    return training_rows(track) & ~turning_rows(track)


def _huber_fit(columns: Floats, target: Floats, scale: float, least: float = -np.inf) -> Floats:
    """Return the coefficients (k,), at least `least`, of a linear fit of `target` (T,) by
    `columns` (T, k) with Huber's loss at `scale`."""
    from scipy.optimize import least_squares

    start = np.maximum(np.linalg.lstsq(columns, target, rcond=None)[0], least)
    fit = least_squares(
        lambda q: columns @ q - target, start, bounds=(least, np.inf), loss="huber", f_scale=scale
    )
    return fit.x
