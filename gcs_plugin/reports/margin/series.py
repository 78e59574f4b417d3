"""The rows of a flight as a report shows and writes them.

`COLUMNS` names every column of the CSV with its unit: one source for the file and the figures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis

#: Words for thrustmargin.models.model.analysis.Basis, by its number.
BASIS_WORDS = ("none", "network", "physics")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """T rows and R rotors of one flight; NaN where unknown."""

    time_s: Floats  # (T,)
    airborne: Bools  # (T,)
    north: Floats  # (T,) m
    east: Floats  # (T,) m
    height_agl: Floats  # (T,) m
    ground_speed: Floats  # (T,) m/s
    airspeed: Floats  # (T,) m/s
    tank_kg: Floats  # (T,)
    spraying: Floats  # (T,) 0..1
    voltage: Floats  # (T,) V
    density: Floats  # (T,) kg/m³
    basis: NDArray[np.int8]  # (T,) thrustmargin.models.model.analysis.Basis
    redundancy_yaw_free: Floats  # (T,)
    redundancy_yaw_kept: Floats  # (T,)
    trimmable_loss: Floats  # (T,)
    fill_limit_kg: Floats  # (T,) largest fill for the limit of capacity use
    fill_one_rotor_out_kg: Floats  # (T,) largest fill for redundancy 1, heading given up
    rotor_speed_rpm: Floats  # (T, R) measured
    rotor_speed_predicted_rpm: Floats  # (T, R)
    rotor_speed_lower_rpm: Floats  # (T, R)
    rotor_speed_upper_rpm: Floats  # (T, R)
    capacity_use: Floats  # (T, R) measured
    capacity_use_predicted: Floats  # (T, R)

    @property
    def rotor_count(self) -> int:
        return self.capacity_use.shape[1]

    @property
    def residual_rpm(self) -> Floats:
        """(T, R) measured minus predicted rotor speed."""
        return self.rotor_speed_rpm - self.rotor_speed_predicted_rpm


#: attribute of Series, name in the CSV, unit, decimals. `{}` in a name: a column a rotor.
COLUMNS: tuple[tuple[str, str, str, int], ...] = (
    ("time_s", "time", "s", 3),
    ("airborne", "airborne", "0/1", 0),
    ("north", "north", "m", 2),
    ("east", "east", "m", 2),
    ("height_agl", "height above ground", "m", 2),
    ("ground_speed", "ground speed", "m/s", 3),
    ("airspeed", "airspeed", "m/s", 3),
    ("tank_kg", "tank", "kg", 3),
    ("spraying", "spraying", "0..1", 2),
    ("voltage", "pack voltage", "V", 3),
    ("density", "air density", "kg/m3", 4),
    ("basis", "prediction basis", "0 none 1 network 2 physics", 0),
    ("redundancy_yaw_free", "redundancy heading given up", "1", 4),
    ("redundancy_yaw_kept", "redundancy heading kept", "1", 4),
    ("trimmable_loss", "trimmable loss", "1", 4),
    ("fill_limit_kg", "largest fill for the limit", "kg", 3),
    ("fill_one_rotor_out_kg", "largest fill for one rotor out", "kg", 3),
    ("rotor_speed_rpm", "rotor {} speed measured", "rpm", 1),
    ("rotor_speed_predicted_rpm", "rotor {} speed predicted", "rpm", 1),
    ("rotor_speed_lower_rpm", "rotor {} speed predicted lower", "rpm", 1),
    ("rotor_speed_upper_rpm", "rotor {} speed predicted upper", "rpm", 1),
    ("capacity_use", "rotor {} capacity use measured", "1", 5),
    ("capacity_use_predicted", "rotor {} capacity use predicted", "1", 5),
)


def series_of(
    analysis: FlightAnalysis, *, fill_limit_kg: Floats, fill_one_rotor_out_kg: Floats
) -> Series:
    """The rows of an analysis; the two fills are (T,) kg."""
    track, prediction = analysis.track, analysis.prediction
    return Series(
        time_s=track.time_s,
        airborne=track.flying,
        north=track.position_ned[:, 0],
        east=track.position_ned[:, 1],
        height_agl=track.height_agl,
        ground_speed=np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1]),
        airspeed=track.airspeed,
        tank_kg=track.tank_kg,
        spraying=track.spraying,
        voltage=track.voltage,
        density=analysis.density,
        basis=prediction.basis,
        redundancy_yaw_free=analysis.redundancy_yaw_free,
        redundancy_yaw_kept=analysis.redundancy_yaw_kept,
        trimmable_loss=analysis.trimmable_loss,
        fill_limit_kg=fill_limit_kg,
        fill_one_rotor_out_kg=fill_one_rotor_out_kg,
        rotor_speed_rpm=track.rotor_speed_rpm,
        rotor_speed_predicted_rpm=prediction.rotor_speed_rpm,
        rotor_speed_lower_rpm=prediction.lower_rpm,
        rotor_speed_upper_rpm=prediction.upper_rpm,
        capacity_use=analysis.capacity_use,
        capacity_use_predicted=analysis.capacity_use_predicted,
    )


def csv_columns(series: Series, rotors: int | None = None) -> Iterator[tuple[str, Floats]]:
    """(header with its unit, (T,) rounded values) of each CSV column.

    `rotors` pads with empty columns where flights of several airframes share one file.
    """
    rows = series.time_s.size
    for attribute, name, unit, decimals in COLUMNS:
        values = np.asarray(getattr(series, attribute), dtype=np.float64)
        if values.ndim == 1:
            yield f"{name} [{unit}]", np.round(values, decimals)
            continue
        for rotor in range(rotors or series.rotor_count):
            column = values[:, rotor] if rotor < values.shape[1] else np.full(rows, np.nan)
            yield f"{name.format(rotor + 1)} [{unit}]", np.round(column, decimals)
