"""The columns of the report's CSV, which its figures draw too, as one table.

Those of the flight have the names and the full numbers of any table (docs/tables.md), so that the
file reads back as the flight.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from thrustmargin.gcs_plugin.logs.csv_table import COLUMNS as OF_TRACK
from thrustmargin.gcs_plugin.logs.csv_table import OF_ROTOR, unit_of_column
from thrustmargin.models.flight import TRACK_CHANNELS, Floats
from thrustmargin.models.model.analysis import FlightAnalysis

_PART = {name: (channel, k) for channel, names in OF_TRACK.items() for k, name in enumerate(names)}
#: name in `rows_of` and in the CSV, unit, decimals (None: all). With _{} behind: a column a rotor.
COLUMNS: tuple[tuple[str, str, int | None], ...] = (
    ("time_s", "s", None),
    ("flying", "0/1", None),
    *((name, unit_of_column(name) or "0/1", None) for name in _PART),
    *((f"{name}_{{}}", TRACK_CHANNELS[name].unit, None) for name in OF_ROTOR),
    ("ground_speed", "m/s", 3),
    ("tank_error_kg", "kg", 3),
    ("density", "kg/m3", 4),
    ("basis", "0 none 1 network 2 physics", 0),
    ("redundancy_yaw_uncontrolled", "1", 4),
    ("redundancy_yaw_kept", "1", 4),
    ("trimmable_loss", "1", 4),
    ("fill_limit_kg", "kg", 3),
    ("fill_one_rotor_out_kg", "kg", 3),
    ("rotor_speed_from_outputs_rpm_{}", "rpm", 1),
    ("rotor_speed_predicted_rpm_{}", "rpm", 1),
    ("rotor_speed_lower_rpm_{}", "rpm", 1),
    ("rotor_speed_upper_rpm_{}", "rpm", 1),
    ("utilisation_{}", "1", 5),
    ("utilisation_from_outputs_{}", "1", 5),
    ("utilisation_predicted_{}", "1", 5),
    ("utilisation_low_{}", "1", 5),
    ("utilisation_high_{}", "1", 5),
)


def rows_of(
    analysis: FlightAnalysis, *, fill_limit_kg: Floats, fill_one_rotor_out_kg: Floats
) -> Mapping[str, Floats]:
    """Return the values of the report's CSV by name, (T,) or (T, R) for T rows and R rotors.

    Names are those of COLUMNS without `_{}`, and "known_utilisation". NaN is unknown. The
    arguments, (T,) kg, become columns of these names.
    """
    track, prediction = analysis.track, analysis.prediction
    of_track = {name: getattr(track, name) for name in ("time_s", "flying", *OF_ROTOR)}
    for name, (channel, part) in _PART.items():
        values = getattr(track, channel)
        of_track[name] = values if values.ndim == 1 else values[:, part]
    of_analysis = ("density", "redundancy_yaw_uncontrolled", "redundancy_yaw_kept")
    used = ("utilisation_predicted", "known_utilisation", "trimmable_loss")
    measured = ~analysis.from_outputs
    by_speed = {"rotor_speed{}_rpm": track.rotor_speed_rpm, "utilisation{}": analysis.utilisation}
    values = {
        **of_track,
        **{key.format(""): np.where(measured, x, np.nan) for key, x in by_speed.items()},
        **{
            key.format("_from_outputs"): np.where(measured, np.nan, x)
            for key, x in by_speed.items()
        },
        **{key: getattr(analysis, key) for key in (*of_analysis, *used)},
        **dict(zip(("utilisation_low", "utilisation_high"), analysis.use_ends, strict=True)),
        "tank_error_kg": track.standard_errors.get("tank_kg", np.full(track.time_s.size, np.nan)),
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
    """Yield (heading with unit, values (T,)) of each CSV column; a rotor has columns of its own.

    `rows` is as `rows_of` returns it. `rotors` is the number of rotors in the file: for a flight
    with fewer rotors the other columns are NaN.
    """
    for name, unit, decimals in COLUMNS:
        values = rows[name.removesuffix("_{}")]
        if decimals is not None:
            values = np.round(values, decimals)
        if values.ndim == 1:
            yield f"{name} [{unit}]", values
            continue
        for rotor in range(rotors):
            known = rotor < values.shape[1]
            column = values[:, rotor] if known else np.full(values.shape[0], np.nan)
            yield f"{name.format(rotor + 1)} [{unit}]", column
