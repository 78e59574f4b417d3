"""A library of manoeuvres, and the flight that each would produce: simple kinematics at 10 Hz.

Frames: `_ned` from the origin of the flights; speeds are over ground, along the heading. Heights,
speeds, distances and fills stay within those of flights that were flown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats, Origin
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import steady_slowing
from thrustmargin.models.physics.smoothing import running_mean

STEP_S = 0.1  # between two rows of a manoeuvre
ACCELERATION = 2.0  # m/s², as gentle as an autopilot flies a mission
SMOOTH_ROWS = 10  # over which a change of speed or of turn rate begins and ends
HOVER_S, LEG_S = 30.0, 20.0  # of a hover, of a leg at most
#: s and m/s: a shorter leg or a slower climb carries no information
LEAST_LEG_S, LEAST_SPEED = 6.0, 0.3
SIDE_S = 4.0  # of a square, between its corners
TURN_RATE = np.radians(45.0)  # rad/s at most
LOW_FILL = 0.1  # of the largest fill flown: "nearly empty"
OF_THE_AIR = ("pressure", "temperature", "altitude")
#: channels that describe the flight
FLOWN = (
    *("velocity_ned", "position_ned", "wind_ned", "angular_rate_frd"),
    *("tank_kg", "height_agl", "voltage", *OF_THE_AIR),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownLimits:
    """Ranges in which this aircraft has flown, with the air and battery of those flights."""

    origin: Origin | None
    place_ne: tuple[float, float]  # m, the middle of where it flew
    reach: float  # m, half the extent of where it flew
    height: tuple[float, float]  # m above the ground, lowest and highest
    speed: float  # m/s over ground
    climb: float  # m/s
    turn_rate: float  # rad/s
    fill_kg: tuple[float, float]  # least and largest fill to fly with; NaN without a tank
    minutes: float  # the longest flight
    wind_ne: tuple[float, float]  # m/s, velocity of the air; 0 unknown
    voltage: tuple[float, float]  # V, fresh and used; NaN unknown
    typical: dict[str, float]  # pressure Pa, temperature K, altitude m AMSL; NaN unknown

    @classmethod
    def from_tracks(cls, tracks: Sequence[FlightTrack]) -> Self:
        """Measure the limits of manoeuvres on the rows in flight of all tracks: place, height,
        speeds, turn rate, fills, wind, voltage.

        Most are quantiles, in SI; NaN where unknown, but 0 for place, reach and wind. `minutes` is
        the longest flight. Raise DataError without a row in flight.
        """
        origins, durations = [], []
        flown: dict[str, list[Floats]] = {name: [] for name in FLOWN}
        for track in tracks:  # one at a time: the tracks of a season need not fit in memory
            if track.flying.any():
                track = track.rows(track.flying)
                origins.append(track.origin)
                durations.append(track.duration)
                for name, parts in flown.items():
                    parts.append(getattr(track, name))
        if not durations:
            raise DataError("no row of the flights is in flight, so no manoeuvre can be bounded")

        def every(channel: str) -> Floats:
            """Return a channel of all flights."""
            return np.concatenate(flown[channel])

        def ends(values: Floats, low: float, high: float) -> tuple[float, float]:
            """Return two quantiles of the finite values; NaN without any."""
            known = values[np.isfinite(values)]
            if not known.size:
                return np.nan, np.nan
            return float(np.quantile(known, low)), float(np.quantile(known, high))

        velocity, position, wind = every("velocity_ned"), every("position_ned"), every("wind_ned")
        sides = [ends(position[:, k], 0.01, 0.99) for k in (0, 1)]
        fills = ends(every("tank_kg"), 0.0, 1.0)
        return cls(
            origin=next((origin for origin in origins if origin is not None), None),
            place_ne=tuple(np.nan_to_num(np.mean(sides, axis=1)).tolist()),
            reach=float(np.nan_to_num(np.max(np.ptp(sides, axis=1)) / 2)),
            height=ends(every("height_agl"), 0.05, 0.95),
            speed=ends(np.hypot(velocity[:, 0], velocity[:, 1]), 0.0, 0.98)[1],
            climb=ends(np.abs(velocity[:, 2]), 0.0, 0.98)[1],
            turn_rate=ends(np.abs(every("angular_rate_frd")[:, 2]), 0.0, 0.99)[1],
            fill_kg=(min(fills[0], LOW_FILL * fills[1]), fills[1]),
            minutes=max(durations) / 60.0,
            wind_ne=tuple(np.nan_to_num([ends(wind[:, k], 0.5, 0.5)[0] for k in (0, 1)]).tolist()),
            voltage=ends(every("voltage"), 0.95, 0.05),
            typical={name: ends(every(name), 0.5, 0.5)[0] for name in OF_THE_AIR},
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A part of a manoeuvre with one command: fly ahead, climb, turn, or hover (all 0)."""

    seconds: float
    speed: float = 0.0  # m/s over ground, along the heading
    climb: float = 0.0  # m/s
    turn: float = 0.0  # rad/s of heading, positive to the right


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """A manoeuvre in pieces, to be flown once at each of its fills."""

    name: str
    #: of hover: s; of legs and speed steps: lower and higher speed, m/s; of climb: lowest and
    #: highest height, m
    numbers: tuple[float, ...]
    load: str  # "full", "nearly empty", "both", or "" for an aircraft without a tank
    pieces: tuple[Piece, ...]
    height: float  # m above the ground at which it begins
    heading: float  # rad from north at which it begins
    fills_kg: tuple[float, ...]  # 0 for an aircraft without a tank

    @property
    def minutes(self) -> float:
        """Return the duration of the manoeuvre, flown once at each fill."""
        return len(self.fills_kg) * sum(piece.seconds for piece in self.pieces) / 60.0


def manoeuvres(limits: FlownLimits) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres to choose from, each for three loads: full, nearly empty, and both in
    turn.

    An aircraft that was not flown with liquid has one load, 0 kg. Headings are into the wind.
    """
    low, high = limits.height
    middle = (low + high) / 2
    upwind = float(np.arctan2(-limits.wind_ne[1], -limits.wind_ne[0]))
    least, largest = limits.fill_kg
    fills = {"": (0.0,)}
    if largest > 0.0:
        fills = {
            "full": (largest,),
            "nearly empty": (least,),
            "both": (largest, least),
        }
    choices = []
    for name, numbers, height, pieces in _library(limits, low, middle):
        for load, kg in fills.items():
            choices.append(
                Manoeuvre(
                    name=name,
                    numbers=numbers,
                    load=load,
                    pieces=pieces,
                    height=height,
                    heading=upwind,
                    fills_kg=kg,
                )
            )
    return tuple(choices)


def lightest_manoeuvres(every: Sequence[Manoeuvre]) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres with the least fill alone and without quick changes of speed.

    These are acceptable for an aircraft that may have a bad rotor.
    """
    least = min((kg for one in every for kg in one.fills_kg), default=0.0)
    return tuple(one for one in every if set(one.fills_kg) == {least} and one.name != "speed steps")


def _library(
    limits: FlownLimits, low: float, middle: float
) -> list[tuple[str, tuple[float, ...], float, tuple[Piece, ...]]]:
    """List each manoeuvre within the limits: name, numbers, first height (m) and pieces.

    The numbers (s, m/s or m) serve for its description. `low` is the lowest height, `middle` the
    middle one, m. Manoeuvres for which the limits leave too little room or speed are left out.
    """
    rate = float(np.clip(np.nan_to_num(limits.turn_rate), 0.1, TURN_RATE))
    around = Piece(seconds=np.pi / rate, turn=rate)
    library: list[tuple[str, tuple[float, ...], float, tuple[Piece, ...]]] = [
        ("hover", (HOVER_S,), middle, (Piece(seconds=HOVER_S),))
    ]
    speed = min(limits.speed, 2.0 * limits.reach / LEAST_LEG_S)
    if speed > LEAST_SPEED:
        pieces: list[Piece] = []
        for pace in (speed / 2, speed):
            leg = Piece(seconds=min(LEG_S, 2.0 * limits.reach / pace), speed=pace)
            pieces += [leg, _stop_piece(pace), around, leg, _stop_piece(pace), around]
        library.append(("legs", (speed / 2, speed), middle, tuple(pieces)))
        short = min(LEG_S, 2.0 * limits.reach / speed) / 3
        steps = [Piece(seconds=short, speed=s * speed) for s in (0.5, 1.0, 0.5)]
        back = (*steps, _stop_piece(speed), around)
        library.append(("speed steps", (speed / 2, speed), middle, (*back, *back)))
        pace, corner = speed / 2, np.pi / 2 / rate
        sides = [
            piece
            for way in (1.0, -1.0)
            for piece in 4
            * [Piece(seconds=SIDE_S, speed=pace), _stop_piece(pace), _corner_piece(corner, way)]
        ]
        library.append(("squares", (), middle, tuple(sides)))
    climb = min(limits.climb, 2.0)
    if climb > LEAST_SPEED and limits.height[1] - low > LEAST_LEG_S * climb / 2:
        up = Piece(seconds=(limits.height[1] - low) / climb, climb=climb)
        down = Piece(seconds=up.seconds, climb=-climb)
        hold = Piece(seconds=5.0)
        ends = (low, limits.height[1])
        library.append(("climb and descent", ends, low, (hold, up, hold, down) * 2))
    return library


def _stop_piece(speed: float) -> Piece:
    """Return a piece in which the aircraft decelerates from `speed` to a stop."""
    return Piece(seconds=speed / ACCELERATION)


def _corner_piece(seconds: float, way: float) -> Piece:
    """Return a quarter turn that lasts `seconds` s; `way` is its sign: 1 right, -1 left."""
    return Piece(seconds=seconds, turn=way * np.pi / 2 / seconds)


def corners_ned(manoeuvre: Manoeuvre, limits: FlownLimits) -> Floats:
    """Return the start of each piece and the end of the last, (pieces + 1, 3), m NED.

    The path is centred on the place `limits.place_ne`. Down is 0 at the ground of the origin, which
    counts as level.
    """
    heading, corner = manoeuvre.heading, np.array([0.0, 0.0, -manoeuvre.height])
    corners = [corner]
    for piece in manoeuvre.pieces:
        step = piece.speed * np.array([np.cos(heading), np.sin(heading), 0.0])
        corner = corner + piece.seconds * (step - np.array([0.0, 0.0, piece.climb]))
        heading += piece.seconds * piece.turn
        corners.append(corner)
    path = np.array(corners)
    middle = (path[:, :2].min(axis=0) + path[:, :2].max(axis=0)) / 2
    path[:, :2] += np.array(limits.place_ne) - middle
    return path


def flown_track(
    manoeuvre: Manoeuvre, model: RotorModel, limits: FlownLimits, fill_kg: float
) -> FlightTrack:
    """Simulate the manoeuvre in the flights' usual air and wind, with all channels but rotor speeds
    and outputs.

    Rows are STEP_S s apart. `fill_kg` is in the tank throughout, NaN if unknown; the voltage falls
    as over the longest flight of `limits`.
    """
    pieces = manoeuvre.pieces
    ends = np.cumsum([p.seconds for p in pieces])
    time_s = np.arange(0.0, ends[-1], STEP_S)
    which = np.minimum(np.searchsorted(ends, time_s, side="right"), len(pieces) - 1)

    def ordered(name: str, rate: float) -> Floats:
        """Return a commanded rate (T,), limited in slope by `rate` and smoothed."""
        commanded = np.array([getattr(p, name) for p in pieces])[which]
        reached, now = np.empty_like(commanded), 0.0
        for k, value in enumerate(commanded):
            now += np.clip(value - now, -rate * STEP_S, rate * STEP_S)
            reached[k] = now
        return running_mean(reached, SMOOTH_ROWS, padding="edge")

    speed, climb = ordered("speed", ACCELERATION), ordered("climb", ACCELERATION)
    heading = manoeuvre.heading + np.cumsum(ordered("turn", 2.0)) * STEP_S
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), -climb], axis=1)
    wind = np.array([*limits.wind_ne, 0.0])
    through_air = velocity[:, :2] - wind[:2]
    airspeed = np.hypot(*through_air.T)
    mass = model.airframe.empty_mass + np.nan_to_num(fill_kg)
    slowing = np.zeros_like(airspeed)
    if model.forward_flight is not None:
        slowing = steady_slowing(
            model.forward_flight, airspeed, np.full_like(airspeed, mass), model.reference_density
        )
    force = np.gradient(velocity, STEP_S, axis=0) - np.array([0.0, 0.0, G0])
    attitude = _attitude(force, through_air, slowing, heading)
    position = np.cumsum(velocity, axis=0) * STEP_S
    position += corners_ned(manoeuvre, limits)[0]
    body = Rotation.from_euler("ZYX", attitude[:, ::-1])
    spin = (body[:-1].inv() * body[1:]).as_rotvec() / STEP_S
    rows = np.ones(time_s.size)
    fresh, used = limits.voltage
    typical = limits.typical
    return FlightTrack.of(
        name=manoeuvre.name,
        time_s=time_s,
        rotor_count=model.airframe.rotor_count,
        position_ned=position,
        velocity_ned=velocity,
        attitude=attitude,
        angular_rate_frd=np.concatenate([spin, spin[-1:]]),
        specific_force_frd=body.inv().apply(force),
        airspeed=airspeed,
        wind_ned=rows[:, None] * wind,
        tank_kg=rows * fill_kg,
        voltage=fresh - (fresh - used) * time_s / (60.0 * limits.minutes),
        pressure=rows * typical["pressure"],
        temperature=rows * typical["temperature"],
        altitude=rows * typical["altitude"],
        height_agl=-position[:, 2],
        origin=limits.origin,
    )


def _attitude(force: Floats, through_air: Floats, slowing: Floats, heading: Floats) -> Floats:
    """Return roll, pitch, yaw (T, 3), rad, at which the rotors produce a force and carry level
    drag.

    `force` (T, 3) is m/s² NED, weight included; `through_air` (T, 2) the velocity through the air,
    `slowing` (T,) its deceleration by drag, m/s²; `heading` (T,) rad.
    """
    way = through_air / np.maximum(np.linalg.norm(through_air, axis=1, keepdims=True), 1e-3)
    lift = force + np.column_stack([slowing[:, None] * way, np.zeros_like(slowing)])
    down = -lift / np.linalg.norm(lift, axis=1, keepdims=True)
    forward = np.cos(heading) * down[:, 0] + np.sin(heading) * down[:, 1]
    lateral = np.cos(heading) * down[:, 1] - np.sin(heading) * down[:, 0]
    return np.stack([-np.arcsin(lateral), np.arctan2(forward, down[:, 2]), heading], axis=1)
