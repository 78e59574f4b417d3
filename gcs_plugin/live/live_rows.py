"""Live rows of one vehicle: where each channel stands in them, and the table they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.live.tank import TankReading
from thrustmargin.models.flight import FlightTrack, Floats, Origin

#: Place of each channel in a row's values; a position comes as latitude, longitude (deg), altitude.
COLUMNS: Mapping[str, int | slice] = MappingProxyType(
    {
        "attitude": slice(0, 3),
        "angular_rate_frd": slice(3, 6),
        "specific_force_frd": slice(6, 9),
        "velocity_ned": slice(9, 12),
        "wind_ned": slice(12, 15),
        "geodetic": slice(15, 18),
        "position_ned": slice(18, 21),
        "airspeed": 21,
        "altitude": 22,
        "height_agl": 23,
        "pressure": 24,
        "temperature": 25,
        "voltage": 26,
        "current": 27,
        "tank_kg": 28,
        "spraying": 29,
    }
)
FIXED = 30  # columns before those of the rotors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """One row of one vehicle before it is a FlightTrack."""

    clock_s: float  # vehicle's clock, s since boot
    stamp_us: int  # ground's clock at the report that made the row
    boot: int
    values: Floats  # (30 + 2 R,) the channels as `COLUMNS` places them, then rotors, then throttles
    flying: bool
    rotors_heard: bool  # at least one rotor speed is known
    tank: TankReading
    esc_failures: tuple[int, ...]  # ESC_FAILURE_FLAGS of each rotor; empty when none are reported
    sources: dict[str, str] = field(repr=False)


def track_of(
    samples: Sequence[Sample], *, name: str, rotor_count: int, origin: Origin | None, start_s: float
) -> FlightTrack:
    """Rows as a FlightTrack; `start_s` is the vehicle's clock at the track's time 0."""
    table = np.stack([s.values for s in samples])
    channels: dict[str, Any] = {
        name: table[:, place] for name, place in COLUMNS.items() if name != "geodetic"
    }
    channels["rotor_speed_rpm"] = table[:, FIXED : FIXED + rotor_count]
    channels["throttle"] = table[:, FIXED + rotor_count :]
    if origin is not None:
        latitude, longitude, altitude = table[:, COLUMNS["geodetic"]].T
        ned = np.column_stack(
            pymap3d.geodetic2ned(
                np.where((latitude == 0) & (longitude == 0), np.nan, latitude),
                longitude,
                altitude,
                origin.latitude_deg,
                origin.longitude_deg,
                origin.altitude,
            )
        )
        local = channels["position_ned"]
        channels["position_ned"] = np.where(np.isfinite(ned), ned, local)
    return FlightTrack.of(
        name=name,
        time_s=np.array([s.clock_s - start_s for s in samples]),
        rotor_count=rotor_count,
        flying=np.array([s.flying for s in samples], dtype=np.bool_),
        origin=origin,
        start_unix_s=samples[0].stamp_us * 1e-6,
        sources=samples[-1].sources,
        **channels,
    )
