"""FlightTrack: the one table of a flight that live, replay, report and fitting share.

Frames: `_ned` is north, east, down from `origin`; `_frd` is forward, right, down of the body.
Attitude is roll, pitch, yaw of the body against NED (aerospace order Z-Y-X).
Every channel is an array with one row a time; NaN where it was not reported or is stale.
`sources` remembers for each channel which message it came from, in words for people.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import TrackError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Columns of each float channel: a number, or "R" for one a rotor; 0 means a plain (T,) array.
CHANNEL_COLUMNS: Mapping[str, int | str] = MappingProxyType(
    {
        "position_ned": 3,
        "velocity_ned": 3,
        "attitude": 3,
        "angular_rate_frd": 3,
        "specific_force_frd": 3,
        "airspeed": 0,
        "wind_ned": 3,
        "tank_kg": 0,
        "rotor_speed_rpm": "R",
        "throttle": "R",
        "voltage": 0,
        "current": 0,
        "pressure": 0,
        "temperature": 0,
        "altitude": 0,
        "height_agl": 0,
        "spraying": 0,
    }
)

#: Unit of each float channel as shown to people.
CHANNEL_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "position_ned": "m",
        "velocity_ned": "m/s",
        "attitude": "rad",
        "angular_rate_frd": "rad/s",
        "specific_force_frd": "m/s²",
        "airspeed": "m/s",
        "wind_ned": "m/s",
        "tank_kg": "kg",
        "rotor_speed_rpm": "rpm",
        "throttle": "0..1",
        "voltage": "V",
        "current": "A",
        "pressure": "Pa",
        "temperature": "K",
        "altitude": "m",
        "height_agl": "m",
        "spraying": "0/1",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where NED zero is: geodetic WGS84 latitude and longitude in degrees, altitude in m AMSL."""

    latitude_deg: float
    longitude_deg: float
    altitude: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightTrack:
    """One flight of one vehicle as arrays of T rows and R rotors; NaN where unreported.

    Raises TrackError when a shape disagrees or `time_s` is not finite and strictly increasing.
    """

    name: str
    time_s: Floats  # (T,) s since the first row
    position_ned: Floats  # (T, 3) m
    velocity_ned: Floats  # (T, 3) m/s over ground
    attitude: Floats  # (T, 3) rad: roll, pitch, yaw
    angular_rate_frd: Floats  # (T, 3) rad/s
    specific_force_frd: Floats  # (T, 3) m/s², (0, 0, -g) at rest
    airspeed: Floats  # (T,) m/s
    wind_ned: Floats  # (T, 3) m/s, the way the air moves
    tank_kg: Floats  # (T,) kg of liquid
    rotor_speed_rpm: Floats  # (T, R) measured, in the autopilot's motor order
    throttle: Floats  # (T, R) motor output, 0 idle to 1 full
    voltage: Floats  # (T,) V of the pack
    current: Floats  # (T,) A of the pack
    pressure: Floats  # (T,) Pa static
    temperature: Floats  # (T,) K of the sensor, which sits in the autopilot and reads warm
    altitude: Floats  # (T,) m AMSL
    height_agl: Floats  # (T,) m above ground
    spraying: Floats  # (T,) 1 pump on, 0 off, NaN unknown
    flying: Bools  # (T,) off the ground
    origin: Origin | None = None
    start_unix_s: float | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time_s = self.time_s
        if time_s.ndim != 1:
            raise TrackError(f"{self.name}: time_s has shape {time_s.shape}; it must be (T,)")
        if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0):
            raise TrackError(f"{self.name}: time_s must be finite and increase from row to row")
        speeds = self.rotor_speed_rpm.shape
        if len(speeds) != 2:
            raise TrackError(f"{self.name}: rotor_speed_rpm has shape {speeds}; it must be (T, R)")
        for channel in CHANNEL_COLUMNS:
            want = _shape(channel, time_s.size, rotor_count=speeds[1])
            got = getattr(self, channel).shape
            if got != want:
                raise TrackError(f"{self.name}: {channel} has shape {got}; it must be {want}")
        if self.flying.shape != time_s.shape:
            raise TrackError(
                f"{self.name}: flying has shape {self.flying.shape}; it must be {time_s.shape}"
            )

    @classmethod
    def of(cls, *, name: str, time_s: Floats, rotor_count: int, **given: object) -> Self:
        """A track with the channels in `given` and NaN in all others (`flying`: all True).

        `rotor_count` 0 is for a flight that tells nothing of its rotors. Raises as FlightTrack.
        """
        rows = np.asarray(time_s).size
        for channel in CHANNEL_COLUMNS:
            shape = _shape(channel, rows, rotor_count=rotor_count)
            given.setdefault(channel, np.full(shape, np.nan, dtype=np.float64))
        given.setdefault("flying", np.ones(rows, dtype=np.bool_))
        return cls(name=name, time_s=np.asarray(time_s, dtype=np.float64), **given)  # type: ignore[arg-type]

    @property
    def rotor_count(self) -> int:
        return self.rotor_speed_rpm.shape[1]

    @property
    def duration(self) -> float:
        """Seconds from the first row to the last; 0 for fewer than two rows."""
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size > 1 else 0.0

    def reports(self, channel: str) -> bool:
        """True when the channel has at least one number."""
        return bool(np.any(np.isfinite(getattr(self, channel))))

    def rows(self, which: slice | Bools | NDArray[np.intp]) -> Self:
        """The same track with only the rows chosen by a slice, mask or index array."""
        arrays = {
            f.name: getattr(self, f.name)[which]
            for f in fields(self)
            if f.name in CHANNEL_COLUMNS or f.name in ("time_s", "flying")
        }
        return replace(self, **arrays)


def _shape(channel: str, rows: int, *, rotor_count: int) -> tuple[int, ...]:
    columns = CHANNEL_COLUMNS[channel]
    if columns == 0:
        return (rows,)
    return (rows, rotor_count if columns == "R" else int(columns))
