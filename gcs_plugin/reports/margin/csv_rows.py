"""The columns of the report's CSV, which its figures draw too, as one table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis

#: key of `rows_of`, name in the CSV, unit, decimals. `{}` in a name: a column a rotor.
COLUMNS: tuple[tuple[str, str, str, int], ...] = (
    ("time_s", "time", "s", 3),
    ("airborne", "airborne", "0/1", 0),
    ("north", "north", "m", 2),
    ("east", "east", "m", 2),
    ("height_agl", "height above ground", "m", 2),
    ("ground_speed", "ground speed", "m/s", 3),
    ("airspeed", "airspeed", "m/s", 3),
    ("tank_kg", "tank", "kg", 3),
    ("tank_error_kg", "tank standard error where inferred", "kg", 3),
    ("spraying", "spraying", "0..1", 2),
    ("voltage", "pack voltage", "V", 3),
    ("density", "air density", "kg/m3", 4),
    ("basis", "prediction basis", "0 none 1 network 2 physics", 0),
    ("redundancy_yaw_uncontrolled", "redundancy heading given up", "1", 4),
    ("redundancy_yaw_kept", "redundancy heading kept", "1", 4),
    ("trimmable_loss", "trimmable loss", "1", 4),
    ("fill_limit_kg", "largest fill for the limit", "kg", 3),
    ("fill_one_rotor_out_kg", "largest fill for one rotor out", "kg", 3),
    ("rotor_speed_rpm", "rotor {} speed measured", "rpm", 1),
    ("rotor_speed_from_outputs_rpm", "rotor {} speed from motor outputs", "rpm", 1),
    ("rotor_speed_predicted_rpm", "rotor {} speed predicted", "rpm", 1),
    ("rotor_speed_lower_rpm", "rotor {} speed predicted lower", "rpm", 1),
    ("rotor_speed_upper_rpm", "rotor {} speed predicted upper", "rpm", 1),
    ("utilisation", "rotor {} capacity use measured", "1", 5),
    ("utilisation_from_outputs", "rotor {} capacity use from motor outputs", "1", 5),
    ("utilisation_predicted", "rotor {} capacity use predicted", "1", 5),
    ("utilisation_error", "rotor {} capacity use standard error", "1", 5),
)


def rows_of(
    analysis: FlightAnalysis, *, fill_limit_kg: Floats, fill_one_rotor_out_kg: Floats
) -> Mapping[str, Floats]:
    """Key of COLUMNS, or "known_utilisation" -> its (T,) or (T, R) values, NaN where unknown.

    The fills are (T,) kg.
    """
    track, prediction = analysis.track, analysis.prediction
    of_track = ("time_s", "height_agl", "airspeed", "tank_kg", "spraying", "voltage")
    of_analysis = ("density", "redundancy_yaw_uncontrolled", "redundancy_yaw_kept")
    used = ("utilisation_predicted", "known_utilisation", "utilisation_error", "trimmable_loss")
    measured = ~analysis.from_outputs
    by_speed = {"rotor_speed{}_rpm": track.rotor_speed_rpm, "utilisation{}": analysis.utilisation}
    values = {
        **{key: getattr(track, key) for key in of_track},
        **{key.format(""): np.where(measured, x, np.nan) for key, x in by_speed.items()},
        **{
            key.format("_from_outputs"): np.where(measured, np.nan, x)
            for key, x in by_speed.items()
        },
        **{key: getattr(analysis, key) for key in (*of_analysis, *used)},
        "airborne": track.flying,
        "tank_error_kg": track.standard_errors.get("tank_kg", np.full(track.time_s.size, np.nan)),
        "north": track.position_ned[:, 0],
        "east": track.position_ned[:, 1],
        "ground_speed": np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1]),
        "basis": prediction.basis,
        "fill_limit_kg": fill_limit_kg,
        "fill_one_rotor_out_kg": fill_one_rotor_out_kg,
        "rotor_speed_predicted_rpm": prediction.rotor_speed_rpm,
        "rotor_speed_lower_rpm": prediction.lower_rpm,
        "rotor_speed_upper_rpm": prediction.upper_rpm,
    }
    return {key: np.asarray(value, dtype=np.float64) for key, value in values.items()}


def csv_columns(rows: Mapping[str, Floats], rotors: int) -> Iterator[tuple[str, Floats]]:
    """(header with its unit, (T,) rounded values) of each CSV column.

    `rotors` pads with empty columns where flights of several airframes share one file.
    """
    for key, name, unit, decimals in COLUMNS:
        values = rows[key]
        if values.ndim == 1:
            yield f"{name} [{unit}]", np.round(values, decimals)
            continue
        for rotor in range(rotors):
            known = rotor < values.shape[1]
            column = values[:, rotor] if known else np.full(values.shape[0], np.nan)
            yield f"{name.format(rotor + 1)} [{unit}]", np.round(column, decimals)
