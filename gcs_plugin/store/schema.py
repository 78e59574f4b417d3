"""Define the columns of the season's store, and of the 10 Hz rows that recordings share with it.

The rows of a flight have each channel of its FlightTrack (vectors as _n _e _d, _x _y _z or _roll
_pitch _yaw, rotors as _1 _2 ...), the standard errors of channels that may be inferred (_error),
`flying`, and the results of the analysis. Units are SI.

`docs/fleet.md` shows these tables with units and meanings. An unknown value is null, never 0.
Aircraft and month are not in the files: they are the names of the folders, such as
`aircraft=A/month=2026-05`, which duckdb, polars and pandas show as columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.models.flight import TRACK_CHANNELS, Floats

if TYPE_CHECKING:
    import pyarrow as pa

    from thrustmargin.models.model.analysis import FlightAnalysis


Columns = dict[str, np.ndarray]
#: Channels that may be inferred; their standard errors have columns of their own.
INFERRED = ("rotor_speed_rpm", "tank_kg")
#: Columns of the analysis with a value for each rotor -> their unit.
OF_ROTORS = {
    "predicted_rpm": "rpm",
    "lower_rpm": "rpm",
    "upper_rpm": "rpm",
    "margin": "1",
    "margin_predicted": "1",
}
#: Columns of the analysis with one value for the vehicle -> their unit.
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
    """Return column name -> unit of the stored rows, in order, for an aircraft with `rotors`
    rotors.

    After the channels come the errors of inferred ones (`..._error`), `flying`, and the columns of
    each rotor, from 1, and of the vehicle.
    """
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
    """Return column name -> values of the rows selected by the slice `rows`, as `column_units`
    names them.
    """
    track, prediction = analysis.track, analysis.prediction
    rotors = track.rotor_count
    table: Columns = {}
    for channel, column in TRACK_CHANNELS.items():
        _add_columns(table, column.column_names(channel, rotors), getattr(track, channel)[rows])
    for channel in INFERRED:  # standard errors, 0 where it was measured
        error = track.standard_errors.get(channel, np.zeros_like(getattr(track, channel)))
        names = TRACK_CHANNELS[channel].column_names(channel, rotors)
        _add_columns(table, [f"{name}_error" for name in names], error[rows])
    table["flying"] = track.flying[rows]
    values = (
        prediction.rotor_speed_rpm,
        prediction.lower_rpm,
        prediction.upper_rpm,
        analysis.margin,
        analysis.margin_predicted,
    )
    for name, value in zip(OF_ROTORS, values, strict=True):
        _add_columns(table, [f"{name}_{k + 1}" for k in range(rotors)], value[rows])
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


def _add_columns(table: Columns, names: list[str], values: Floats) -> None:
    """Add `values` (T,) or (T, N) to `table` as one column for each of the N names."""
    columns = values[:, None] if values.ndim == 1 else values
    for number, name in enumerate(names):
        table[name] = columns[:, number]


#: Rotors that every file has columns for, so that all files have the same columns.
ROTORS = 12


@dataclass(frozen=True, slots=True)
class StoredColumn:
    """A column: its name, unit, meaning, and the kind of its values.

    `kind` is "number", "whole", "text", "bool", or a list: "words" (of text), "wholes" or "rotors"
    (of numbers). Rows also have "single" and "small" (8 bits), sums "arrays".
    """

    name: str
    unit: str
    words: str
    kind: str = "number"


def _columns(lines: str) -> tuple[StoredColumn, ...]:
    """Parse one column per line: name | kind | unit | meaning."""
    parts = ([p.strip() for p in line.split("|")] for line in lines.strip().splitlines())
    return tuple(StoredColumn(name, unit, words, kind) for name, kind, unit, words in parts)


FLIGHTS = _columns("""
flight | text | | 16 hexadecimal digits of the log's SHA-256; -N: vehicle; -sortie-N: later sortie
started_unix_s | number | s | first row, Unix time
log_name | text | | name of the file that was read
log_format | text | | tlog, DataFlash, ULog, CSV
log_bytes | whole | B | its size
software | text | | version of thrustmargin that read it
aircraft_by | text | | what names the aircraft: given, serial, board number, system id, not known
board | text | | serial number of the autopilot, or board number
system_id | whole | | MAVLink system id
autopilot | text | | ArduPilot, PX4, unknown
firmware | text | | as the autopilot reports it
airframe | text | | name of the airframe; null where it is not known
airframe_basis | text | | given, recognised, not known
model_digest | text | | the rotor speed model that predicted; null without a verdict's ground
rotor_count | whole | | rotors
layout | text | | of the motors, as the autopilot reports it
duration_s | number | s | first row to last
flying_s | number | s | off the ground
distance_m | number | m | over ground
spraying_s | number | s | with the pump on
sprayed_distance_m | number | m | over ground with the pump on
hectares | number | ha | sprayed, each place once
hectares_at_least | number | ha | in its place where place or pump is not known of a part
litres | number | L | that left the tank
tank_start_kg | number | kg | at the start of the flight
tank_end_kg | number | kg | at its end
tank_error_kg | number | kg | standard error where the load was inferred
tank_source | text | | where the load is known from; of `answer`
takeoff_mass_kg | number | kg | of the aircraft with its liquid
speed_source | text | | where rotor speeds are known from; of `answer`
airspeed_source | text | | where the airspeed is known from; of `answer`
verdict | text | | damaged, lost, battery, no_thrust, critical, over, order, near, under, unknown
verdict_reason | text | | the verdict in words, or why there is none; of `answer`
action | text | | what to do next, as the report says it; of `answer`
limit | number | 1 | largest thrust utilisation that is allowed
worst_margin | number | 1 | least thrust margin of a rotor; null where a prediction alone is good
worst_margin_low | number | 1 | lower end of its 90 % interval
worst_rotor | whole | | which rotor, from 1
worst_time_s | number | s | when, from the first row
worst_doing | text | | what the aircraft was doing then; of `answer`
mean_margin | number | 1 | mean of the worst rotor's margin in flight
rows_above_limit_s | number | s | in flight above the limit, turns and gusts with it
lasting_above_limit_s | number | s | in flight with what lasts above the limit
measured_share | number | 1 | of the flight with measured rotor speeds
redundancy_min | number | 1 | least thrust that can be held without one rotor, over the weight
not_survivable_s | number | s | in flight with that below 1
fill_kg | number | kg | largest fill that is safe, as the action says it
fill_limit_kg | number | kg | fill at which a limit is met on this battery
fill_low_kg | number | kg | lower end of its 90 % interval
margin_by_rotor | rotors | 1 | least margin of each rotor
speed_ratio | rotors | 1 | median of measured over predicted speed of each rotor in flight
prediction_bias_rpm | number | rpm | mean of measured minus predicted rotor speed
prediction_rmse_rpm | number | rpm | root mean square of it
voltage_start | number | V | median of the first tenth of the flight
voltage_end | number | V | median of the last tenth
voltage_min | number | V | least in flight
current_median | number | A | in flight
battery_ohm | number | ohm | fall of voltage with current, from rest into flight, drain taken out
battery_ohm_error | number | ohm | its standard error
airspeed_median | number | m/s | in flight
ground_speed_median | number | m/s | in flight
wind_speed_median | number | m/s | in flight
height_agl_max | number | m | above ground
density_median | number | kg/m³ | of the air
latitude_deg | number | deg | where the flight's north and east are 0
longitude_deg | number | deg | where the flight's north and east are 0
alarms | words | | what the live alarms of rotors and motors would have said; of `answer`
notes | words | | what had to be assumed in reading, in English
missing_channels | words | | channels that the log lacks
unmeasured | words | | rotor speed readings that are none, and why, in English
bytes_skipped | whole | B | of damaged places
damaged_places | whole | | in the log
frames_missing | whole | | by MAVLink's sequence numbers
silences | whole | | pauses over 1 s without a message
longest_silence_s | number | s | the longest of them
clock_jumps | whole | | restarts while recording
sums_reason | text | | why the flight has no sums: no_verdict, no_evidence; null where it has
row_version | whole | | 2: words are made when they are read; null in older rows
answer | text | | JSON of the verdict, of which words are made: levels, faults, fill, sources
levels | words | | all verdicts that apply, the gravest first
action_kinds | words | | what to do next, by kind: look_at_rotors, fill_at_most, do_not_fly
fault_kinds | words | | of each bad rotor or motor: propeller, motor, stopped
fault_rotors | wholes | | rotor, from 1, of each of these; null in older rows without an answer
caveats | words | | what it left open: tank gauge, rotor speeds, part of the flight not in the log
suspects | wholes | | all rotors, from 1, that were found bad or of which one was
reason_kinds | words | | why there is no verdict, by kind: aircraft_not_known, predicted_alone
doing_kinds | words | | what the aircraft was doing at the worst moment, by kind
findings | text | | JSON of what spoils names or numbers: check, level, time_s, values
no_flight_of | wholes | | other vehicles in the log, of which no flight was made
use_lasting | number | 1 | largest lasting thrust utilisation; from here on of known aircraft alone
use_lasting_low | number | 1 | lower end of its 90 % interval
use_lasting_high | number | 1 | upper end of its 90 % interval
rest_voltage | number | V | before take-off
mean_power | number | W | in flight
power_coefficient | number | W/rpm³ | of electric power, in air of the model's reference density
charge_used_ah | number | Ah | in flight
mission | text | | JSON of its mission against its forecast
coverage | number | 1 | of rotor speeds inside the interval of the state before the flight
bias | number | 1 | mean of ln measured over predicted speed
change | text | | JSON of how it differs from the flights before it, rotors from 0
offsets | text | | JSON of the offsets of its modes from the model as it was made
arms | text | | JSON of the figures of each arm: power, resistance, heat, vibration
bad_arms | wholes | | arms, from 0, of which a part may have been bad
not_taught | text | | why it taught nothing; null where it taught
trained | bool | | whether the model was made from it
""")
SUMS = _columns("""
flight | text | | as in flights
started_unix_s | number | s | as in flights
model_digest | text | | the model that the sums are about
arrays | arrays | | name, shape, little-endian float64 of each array (season/flight_sums)
""")
REJECTED = _columns("""
log_name | text | | name of the file
content | text | | first 16 hexadecimal digits of its SHA-256; null where it cannot be read at all
reason | text | | why no flight was made of it
when_unix_s | number | s | when it was tried last
""")
#: First columns of the rows; those of `column_units` follow.
ROW_HEAD = _columns("""
flight | text | | as in flights
unix_s | number | s | Unix time; null where the log does not say
clock_s | number | s | the vehicle's clock
time_s | number | s | since the flight's first row
""")


def arrow_schema(columns: tuple[StoredColumn, ...]) -> pa.Schema:
    """Return the Arrow schema of `columns`, with names and types but without units and meanings."""
    import pyarrow as pa

    array = pa.struct({"name": pa.string(), "shape": pa.list_(pa.int32()), "data": pa.binary()})
    kinds = {
        "number": pa.float64(),
        "whole": pa.int64(),
        "text": pa.string(),
        "words": pa.list_(pa.string()),
        "wholes": pa.list_(pa.int64()),
        "rotors": pa.list_(pa.float64()),
        "arrays": pa.list_(array),
        "single": pa.float32(),
        "bool": pa.bool_(),
        "small": pa.int8(),
    }
    # No unit or word in the files: in one of few rows they would outweigh the figures.
    return pa.schema([pa.field(c.name, kinds[c.kind]) for c in columns])


def row_columns() -> Iterator[StoredColumn]:
    """Yield name, unit and type of each column of the stored 10 Hz rows, for ROTORS rotors.

    Flight data are in single precision: no sensor has more.
    """
    yield from ROW_HEAD
    kinds = {"flying": "bool", "basis": "small"}
    for name, unit in column_units(ROTORS).items():
        yield StoredColumn(name, unit, "", kinds.get(name, "single"))


def table_schema(table: str) -> pa.Schema:
    """Return the Arrow schema of `flights`, `rows`, `sums` or `rejected`."""
    columns = {"flights": FLIGHTS, "sums": SUMS, "rejected": REJECTED}
    return arrow_schema(columns[table] if table in columns else tuple(row_columns()))
