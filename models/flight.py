"""Define FlightTrack, the one table of a flight that live, replay, report and fitting share.

Frames: `_ned` is north, east, down from `origin`; `_frd` is forward, right, down of the body.
Attitude is roll, pitch, yaw of the body against NED (aerospace order Z-Y-X). Every channel is an
array with one row for each time; NaN where it was not reported or is stale. `sources` has the
source of each channel, as data. A channel that was inferred from others, not measured, has its
standard error in `standard_errors`, in the channel's own shape and unit.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Literal, Self

import numpy as np
import pymap3d
from numpy.typing import NDArray

from thrustmargin.models.errors import TrackError
from thrustmargin.models.provenance import NOT_REPORTED, Provenance
from thrustmargin.models.statement import Statement

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


#: A pause of the log longer than this many usual steps is not counted as time of the row before.
LONGEST_STEP = 2.5
#: s that a row can represent at most, for tables with very few rows.
LONGEST_ROW = 5.0


@dataclass(frozen=True, slots=True)
class TrackChannel:
    """One float channel of a FlightTrack: its shape, its unit, and how reports become rows."""

    unit: str  # as shown to people
    max_age: float  # s after which a report is not used any more
    low: float  # a number outside low..high cannot be true; ranges are wide and catch damage only
    high: float
    axes: tuple[str, ...] = ()  # names of its columns; () for a plain (T,) array
    per_rotor: bool = False  # (T, R)
    kind: Literal["linear", "angle", "state"] = "linear"  # a state is held, never interpolated
    direct: bool = False  # its rows come from one signal, that of the best source
    averaged: bool = False  # affected by vibration: faster reports are averaged over a row

    def shape(self, rows: int, rotor_count: int) -> tuple[int, ...]:
        """Return the shape, (T,), (T, n) or (T, R), for a number of rows and rotors."""
        if self.per_rotor:
            return (rows, rotor_count)
        return (rows, len(self.axes)) if self.axes else (rows,)

    def column_names(self, name: str, rotor_count: int) -> list[str]:
        """Return the channel's column names in a table: `name_1`, ... by rotor, `name_AXIS` or
        `name`."""
        if self.per_rotor:
            return [f"{name}_{k + 1}" for k in range(rotor_count)]
        return [f"{name}_{axis}" for axis in self.axes] or [name]


_NED, _FRD = ("n", "e", "d"), ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")

#: Every float channel of a FlightTrack, in the order of screens and files.
TRACK_CHANNELS: Mapping[str, TrackChannel] = MappingProxyType(
    {
        "position_ned": TrackChannel("m", 1.0, -1e6, 1e6, _NED),
        "velocity_ned": TrackChannel("m/s", 1.0, -200.0, 200.0, _NED, direct=True),
        "attitude": TrackChannel("rad", 0.5, -7.0, 7.0, _ANGLES, kind="angle", direct=True),
        "asked_attitude": TrackChannel(
            "rad", 1.0, -7.0, 7.0, ("roll", "pitch"), kind="angle", direct=True
        ),
        "angular_rate_frd": TrackChannel("rad/s", 0.5, -100.0, 100.0, _FRD, direct=True),
        "specific_force_frd": TrackChannel(
            "m/s²", 0.5, -500.0, 500.0, _FRD, direct=True, averaged=True
        ),
        "airspeed": TrackChannel("m/s", 1.0, 0.0, 200.0, direct=True),
        "wind_ned": TrackChannel("m/s", 5.0, -100.0, 100.0, _NED, direct=True),
        # A gauge's zero drifts by some tenths of a kilogram; -1 is "not known" to many senders.
        "tank_kg": TrackChannel("kg", 3.0, -0.5, 1000.0),
        "rotor_speed_rpm": TrackChannel("rpm", 0.5, -100_000.0, 100_000.0, per_rotor=True),
        "throttle": TrackChannel("0..1", 0.5, 0.0, 1.0, per_rotor=True),
        # Of each motor's ESC. Its voltage and current change within a second, heat in many.
        "esc_voltage": TrackChannel("V", 1.0, 0.0, 1000.0, per_rotor=True),
        "esc_current": TrackChannel("A", 1.0, -500.0, 2000.0, per_rotor=True),
        "esc_temperature": TrackChannel("K", 5.0, 180.0, 600.0, per_rotor=True),
        "motor_temperature": TrackChannel("K", 5.0, 180.0, 600.0, per_rotor=True),
        # Of the body, once per revolution of each rotor; of recorded flights with fast IMU samples.
        "vibration_per_rev": TrackChannel("m/s²", 5.0, 0.0, 500.0, per_rotor=True),
        # Of recorded flights: the share of an ESC's frames that is lost, and how the body shakes.
        "esc_lost": TrackChannel("0..1", 8.0, 0.0, 1.0, per_rotor=True),
        "vibration": TrackChannel("m/s²", 5.0, 0.0, 500.0),
        "clipping": TrackChannel("1", 5.0, 0.0, 1e10),
        "voltage": TrackChannel("V", 3.0, 0.0, 1000.0),
        "current": TrackChannel("A", 3.0, -2000.0, 5000.0),
        "pressure": TrackChannel("Pa", 5.0, 10_000.0, 120_000.0, direct=True),
        "temperature": TrackChannel("K", 5.0, 180.0, 420.0, direct=True),
        "altitude": TrackChannel("m", 1.0, -1000.0, 30_000.0, direct=True),
        "height_agl": TrackChannel("m", 1.0, -1000.0, 10_000.0, direct=True),
        "spraying": TrackChannel("0/1", 2.0, 0.0, 1.0, kind="state"),
    }
)


_ROWS = ("time_s", *TRACK_CHANNELS, "flying")  # fields of a FlightTrack with one row a time


@lru_cache(maxsize=64)
def _shapes(rows: int, rotor_count: int) -> Mapping[str, tuple[int, ...]]:
    """Map each channel's name to its array shape, for `rows` rows and `rotor_count` rotors."""
    return {name: column.shape(rows, rotor_count) for name, column in TRACK_CHANNELS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """The place of NED zero: geodetic WGS84 latitude and longitude in degrees, altitude in m
    AMSL."""

    latitude_deg: float
    longitude_deg: float
    altitude: float

    def geodetic(self, ned: Floats) -> Floats:
        """Convert places (..., 3) in m from here to latitude, longitude (degrees) and altitude
        (m)."""
        here = self.latitude_deg, self.longitude_deg, self.altitude
        north, east, down = np.moveaxis(ned, -1, 0)
        return np.stack(pymap3d.ned2geodetic(north, east, down, *here), axis=-1)

    def ned(self, geodetic: Floats) -> Floats:
        """Convert latitude, longitude (degrees) and altitude (m) (..., 3) to m from here, NED."""
        here = self.latitude_deg, self.longitude_deg, self.altitude
        latitude, longitude, altitude = np.moveaxis(geodetic, -1, 0)
        return np.stack(pymap3d.geodetic2ned(latitude, longitude, altitude, *here), axis=-1)


#: Unix times that the date of a flight can have, 2000 to 2100; an unset clock has others.
DATES = (946_684_800.0, 4_102_444_800.0)


def known_date(unix_s: float | None) -> float | None:
    """Return the Unix time, s; None where it is unknown or outside DATES."""
    return unix_s if unix_s is not None and DATES[0] <= unix_s < DATES[1] else None


class FlyingBy(StrEnum):
    """The evidence that decided which rows of a flight are off the ground."""

    GIVEN = "given"  # with the flight, by its author
    LANDED_STATE = "landed state"  # of the autopilot
    ROTOR_SPEEDS = "rotor speeds"
    MOTOR_OUTPUTS = "motor outputs"
    HEIGHT = "height"
    #: No row flies, for one of the following reasons.
    DISARMED = "disarmed"
    IDLE_OUTPUTS = "idle outputs"
    CONSTANT_OUTPUTS = "constant outputs"
    SLOW_ROTORS = "slow rotors"  # they never carry half of the empty weight
    NEVER_ROSE = "never rose"  # motors ran up in the log, and it was never higher than before
    HELD = "held"  # on a bench or in hands, with its motors on
    NOT_KNOWN = "not known"  # nothing in the flight shows it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class FlightTrack:
    """One flight of one vehicle as arrays of T rows and R rotors; NaN where unreported.

    Raises TrackError when a shape disagrees or `time_s` is not finite and strictly increasing.
    """

    name: str
    time_s: Floats  # (T,) s since the flight's start; a live window begins later
    position_ned: Floats  # (T, 3) m
    velocity_ned: Floats  # (T, 3) m/s over ground
    attitude: Floats  # (T, 3) rad: roll, pitch, yaw
    asked_attitude: Floats  # (T, 2) rad: commanded roll, pitch
    angular_rate_frd: Floats  # (T, 3) rad/s
    specific_force_frd: Floats  # (T, 3) m/s², (0, 0, -g) at rest
    airspeed: Floats  # (T,) m/s
    wind_ned: Floats  # (T, 3) m/s, velocity of the air
    tank_kg: Floats  # (T,) kg of liquid
    rotor_speed_rpm: Floats  # (T, R) measured, in the autopilot's motor order
    throttle: Floats  # (T, R) motor output, 0 idle to 1 full
    esc_voltage: Floats  # (T, R) V at the ESC's end of its lead
    esc_current: Floats  # (T, R) A that the ESC draws from the battery
    esc_temperature: Floats  # (T, R) K
    motor_temperature: Floats  # (T, R) K
    vibration_per_rev: Floats  # (T, R) m/s², amplitude at the frequency at which each rotor turns
    esc_lost: Floats  # (T, R) share of an ESC's frames that is lost
    vibration: Floats  # (T,) m/s², level of vibration by the autopilot's own filter
    clipping: Floats  # (T,) times that the accelerometer was at its limit, since the start
    voltage: Floats  # (T,) V of the battery
    current: Floats  # (T,) A of the battery
    pressure: Floats  # (T,) Pa static
    temperature: Floats  # (T,) K of the sensor, which sits in the autopilot and reads warm
    altitude: Floats  # (T,) m AMSL
    height_agl: Floats  # (T,) m above ground
    spraying: Floats  # (T,) 1 pump on, 0 off, NaN unknown
    flying: Bools  # (T,) off the ground
    flying_by: FlyingBy = FlyingBy.GIVEN
    origin: Origin | None = None
    start_unix_s: float | None = None
    sources: Mapping[str, Provenance] = field(default_factory=dict)
    notes: tuple[Statement, ...] = ()  # of the reader
    statements: tuple[Statement, ...] = ()  # of the checks
    standard_errors: Mapping[str, Floats] = field(default_factory=dict)  # of inferred channels

    def __post_init__(self) -> None:
        time_s = self.time_s
        if time_s.ndim != 1:
            raise TrackError(f"{self.name}: time_s has shape {time_s.shape}; it must be (T,)")
        # In increasing times only the first and the last can be infinite.
        grows = np.count_nonzero(time_s[1:] > time_s[:-1]) == max(time_s.size - 1, 0)
        if not grows or not np.isfinite(time_s[:: max(time_s.size - 1, 1)]).all():
            raise TrackError(f"{self.name}: time_s must be finite and increase from row to row")
        speeds = self.rotor_speed_rpm.shape
        if len(speeds) != 2:
            raise TrackError(f"{self.name}: rotor_speed_rpm has shape {speeds}; it must be (T, R)")
        for channel, want in _shapes(time_s.size, speeds[1]).items():
            got = getattr(self, channel).shape
            if got != want:
                raise TrackError(f"{self.name}: {channel} has shape {got}; it must be {want}")
        for channel, errors in self.standard_errors.items():
            if errors.shape != (want := getattr(self, channel).shape):
                raise TrackError(
                    f"{self.name}: standard error of {channel} has shape {errors.shape}; it must "
                    f"be {want}"
                )
        if self.flying.shape != time_s.shape:
            raise TrackError(
                f"{self.name}: flying has shape {self.flying.shape}; it must be {time_s.shape}"
            )

    @classmethod
    def of(cls, *, name: str, time_s: Floats, rotor_count: int, **given: object) -> Self:
        """Build a track with the channels in `given` and NaN in all others (`flying`: all True).

        `time_s` (T,) is s. `rotor_count` sets the shape (T, R) of absent rotor channels; 0 is for a
        flight that reports nothing of its rotors. Raise TrackError, as the class does, for channels
        that do not fit.
        """
        rows = np.asarray(time_s).size
        for channel, shape in _shapes(rows, rotor_count).items():
            if channel not in given:
                given[channel] = np.full(shape, np.nan, dtype=np.float64)
        given.setdefault("flying", np.ones(rows, dtype=np.bool_))
        return cls(name=name, time_s=np.asarray(time_s, dtype=np.float64), **given)  # type: ignore[arg-type]

    def __repr__(self) -> str:
        silent = [name for name in TRACK_CHANNELS if not self.reports(name)]
        listed = textwrap.shorten(f"not reported: {', '.join(silent)}", 150, placeholder=" ...")
        without = f"\n  {listed}" if silent else ""
        return (
            f"FlightTrack {self.name}: {self.time_s.size} rows of {self.rotor_count} rotors in "
            f"{self.duration:.1f} s{without}"
        )

    @property
    def rotor_count(self) -> int:
        """Return the number of rotors, R."""
        return self.rotor_speed_rpm.shape[1]

    @property
    def duration(self) -> float:
        """Return the seconds from the first row to the last; 0 for fewer than two rows."""
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size > 1 else 0.0

    @property
    def row_seconds(self) -> Floats:
        """Return the seconds (T,) that each row represents: the step to the next row.

        Steps are limited to LONGEST_STEP usual ones, so that pauses of the log do not count. The
        last one is 0, so that the parts of a log add up to the whole.
        """
        if self.time_s.size < 2:
            return np.zeros(self.time_s.size)
        steps = np.diff(self.time_s)
        usual = min(float(np.median(steps)), LONGEST_ROW)
        return np.minimum(np.append(steps, 0.0), LONGEST_STEP * usual)

    @property
    def flying_s(self) -> float:
        """Return the s off the ground, without pauses of the log."""
        return float(self.row_seconds[self.flying].sum())

    def reports(self, channel: str) -> bool:
        """Return True if the channel has at least one number."""
        return bool(np.any(np.isfinite(getattr(self, channel))))

    def source(self, channel: str) -> Provenance:
        """Return the source of a channel; of kind ABSENT where nothing reported it."""
        return self.sources.get(channel, NOT_REPORTED)

    def measured(self, channel: str) -> Floats:
        """Return the values of `channel`, with NaN where they were inferred and not measured."""
        values, error = getattr(self, channel), self.standard_errors.get(channel)
        return values if error is None else np.where(error > 0.0, np.nan, values)

    def followed_by(self, later: FlightTrack, first: int = 0) -> FlightTrack:
        """Return the rows from `first` on and those of `later` as one track, with the metadata of
        `later`.

        Raises TrackError unless time increases.
        """
        return join_tracks([(self, slice(first, None)), (later, slice(None))])

    def _error_of(self, channel: str) -> Floats:
        """Return the standard error of a channel in its shape; 0 where it was measured."""
        return self.standard_errors.get(channel, np.zeros_like(getattr(self, channel)))

    def rows(self, which: slice | Bools | NDArray[np.intp]) -> Self:
        """Return the track with only the rows chosen by a slice, mask or index array."""
        arrays = {name: getattr(self, name)[which] for name in _ROWS}
        errors = {channel: error[which] for channel, error in self.standard_errors.items()}
        return replace(self, standard_errors=errors, **arrays)


def join_tracks(parts: Sequence[tuple[FlightTrack, slice | NDArray[np.intp]]]) -> FlightTrack:
    """Concatenate the chosen rows of the tracks as one track, with the metadata of the last.

    Raises TrackError unless time increases.
    """
    arrays = {
        name: np.concatenate([getattr(track, name)[rows] for track, rows in parts])
        for name in _ROWS
    }
    errors = {
        channel: np.concatenate([track._error_of(channel)[rows] for track, rows in parts])
        for channel in dict.fromkeys(c for track, _ in parts for c in track.standard_errors)
    }
    return replace(parts[-1][0], standard_errors=errors, **arrays)


def body_axes(attitude: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the NED unit vectors (T, 3) of the body axes forward, right, down.

    `attitude` (T, 3) is roll, pitch, yaw, rad.
    """
    roll, pitch, yaw = attitude.T
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    forward = np.stack([cp * cy, cp * sy, -sp], axis=1)
    right = np.stack([sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp], axis=1)
    down = np.stack([cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp], axis=1)
    return forward, right, down


def down_axis(attitude: Floats) -> Floats:
    """Return the NED unit vectors (T, 3) of the body's down axis, from roll, pitch, yaw (T, 3)
    rad."""
    return body_axes(attitude)[2]
