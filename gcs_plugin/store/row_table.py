"""Rows of an analysed flight as one table, every column one number, SI units: recordings and store.

Columns: each channel of a FlightTrack (vectors as _n _e _d, _x _y _z or _roll _pitch _yaw, rotors
as _1 _2 ...), the standard errors of channels that may be inferred (_error), `flying`, then what
the analysis made of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.models.flight import TRACK_CHANNELS, Floats

if TYPE_CHECKING:  # a question to the store needs no model
    from thrustmargin.models.model.analysis import FlightAnalysis

Columns = dict[str, np.ndarray]
#: Channels that may be inferred, each with columns of its standard error.
INFERRED = ("rotor_speed_rpm", "tank_kg")
#: Rotor columns of the analysis, and their unit.
OF_ROTORS = {
    "predicted_rpm": "rpm",
    "lower_rpm": "rpm",
    "upper_rpm": "rpm",
    "margin": "1",
    "margin_predicted": "1",
}
#: Plain columns of the analysis, and their unit.
OF_VEHICLE = {
    "basis": "0 none 1 network 2 physics",
    "density": "kg/m³",
    "max_rotor_speed_rpm": "rpm",
    "weight": "N",
    "redundancy_yaw_kept": "1",
    "redundancy_yaw_free": "1",
    "trimmable_loss": "1",
}


def column_units(rotors: int) -> dict[str, str]:
    """Name of each column, in order, for so many rotors -> its unit."""
    units: dict[str, str] = {}
    for channel, column in TRACK_CHANNELS.items():
        units |= dict.fromkeys(column.column_names(channel, rotors), column.unit)
    for channel in INFERRED:
        column = TRACK_CHANNELS[channel]
        units |= {f"{n}_error": column.unit for n in column.column_names(channel, rotors)}
    units["flying"] = "off the ground"
    for name, unit in OF_ROTORS.items():
        units |= {f"{name}_{k + 1}": unit for k in range(rotors)}
    return units | OF_VEHICLE


def analysis_columns(analysis: FlightAnalysis, rows: slice) -> Columns:
    """The columns of `column_units` for the rotors of the flight, each (rows,)."""
    track, prediction = analysis.track, analysis.prediction
    rotors = track.rotor_count
    table: Columns = {}
    for channel, column in TRACK_CHANNELS.items():
        _spread(table, column.column_names(channel, rotors), getattr(track, channel)[rows])
    for channel in INFERRED:  # standard errors, 0 where it was measured
        error = track.standard_errors.get(channel, np.zeros_like(getattr(track, channel)))
        names = TRACK_CHANNELS[channel].column_names(channel, rotors)
        _spread(table, [f"{name}_error" for name in names], error[rows])
    table["flying"] = track.flying[rows]
    values = (
        prediction.rotor_speed_rpm,
        prediction.lower_rpm,
        prediction.upper_rpm,
        analysis.margin,
        analysis.margin_predicted,
    )
    for name, value in zip(OF_ROTORS, values, strict=True):
        _spread(table, [f"{name}_{k + 1}" for k in range(rotors)], value[rows])
    values = (
        prediction.basis,
        analysis.density,
        analysis.max_rotor_speed_rpm,
        analysis.weight,
        analysis.redundancy_yaw_kept,
        analysis.redundancy_yaw_uncontrolled,
        analysis.trimmable_loss,
    )
    return table | {n: value[rows] for n, value in zip(OF_VEHICLE, values, strict=True)}


def _spread(table: Columns, names: list[str], values: Floats) -> None:
    columns = values[:, None] if values.ndim == 1 else values
    for number, name in enumerate(names):
        table[name] = columns[:, number]
