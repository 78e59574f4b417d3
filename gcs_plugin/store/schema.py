"""What the store keeps of a flight: every column, its unit and what it means, in one place.

`docs/fleet.md` shows these tables. A figure that is unknown is null, never 0. Aircraft and month
are no columns of the files but names of their folders, as `aircraft=A/month=2026-05`, which
duckdb, polars and pandas read as columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.store.row_table import column_units

if TYPE_CHECKING:
    import pyarrow as pa

#: Columns of rotors are for so many in every file, so that all files have the same; null beyond.
ROTORS = 12


@dataclass(frozen=True, slots=True)
class StoredColumn:
    """One column: `kind` is number, whole, text, words (a list of text) or rotors (of numbers)."""

    name: str
    unit: str
    words: str
    kind: str = "number"


def _columns(lines: str) -> tuple[StoredColumn, ...]:
    """A column a line: name | kind | unit | what it is."""
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
tank_source | text | | where the load is known from
takeoff_mass_kg | number | kg | of the aircraft with its liquid
speed_source | text | | where rotor speeds are known from
airspeed_source | text | | where the airspeed is known from
verdict | text | | damaged, lost, battery, no_thrust, critical, over, order, near, under, unknown
verdict_reason | text | | the verdict in words, or why there is none
action | text | | what to do next, as the report says it
limit | number | 1 | largest thrust utilisation that is allowed
worst_margin | number | 1 | least thrust margin of a rotor; null where a prediction alone is good
worst_margin_low | number | 1 | lower end of its 90 % interval
worst_rotor | whole | | which rotor, from 1
worst_time_s | number | s | when, from the first row
worst_doing | text | | what the aircraft was doing then
mean_margin | number | 1 | mean of the worst rotor's margin in flight
rows_above_limit_s | number | s | in flight above the limit, turns and gusts with it
lasting_above_limit_s | number | s | in flight with what lasts above the limit
measured_share | number | 1 | of the flight with measured rotor speeds
redundancy_min | number | 1 | least thrust that can be held without one rotor, over the weight
not_survivable_s | number | s | in flight with that below 1
fill_kg | number | kg | largest fill that keeps every limit on this battery
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
alarms | words | | what the live alarms of rotors and motors would have said
notes | words | | what had to be assumed in reading
missing_channels | words | | channels that the log lacks
unmeasured | words | | rotor speed readings that are none, and why
bytes_skipped | whole | B | of damaged places
damaged_places | whole | | in the log
frames_missing | whole | | by MAVLink's sequence numbers
silences | whole | | pauses over 1 s without a message
longest_silence_s | number | s | the longest of them
clock_jumps | whole | | restarts while recording
sums_reason | text | | why the flight has no sums; null where it has
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
#: Columns of rows before those of `row_table`.
ROW_HEAD = _columns("""
flight | text | | as in flights
unix_s | number | s | Unix time; null where the log does not say
clock_s | number | s | the vehicle's clock
time_s | number | s | since the flight's first row
""")


def arrow_schema(columns: tuple[StoredColumn, ...]) -> pa.Schema:
    """The columns as an Arrow schema."""
    import pyarrow as pa

    array = pa.struct({"name": pa.string(), "shape": pa.list_(pa.int32()), "data": pa.binary()})
    kinds = {
        "number": pa.float64(),
        "whole": pa.int64(),
        "text": pa.string(),
        "words": pa.list_(pa.string()),
        "rotors": pa.list_(pa.float64()),
        "arrays": pa.list_(array),
        "single": pa.float32(),
        "bool": pa.bool_(),
        "small": pa.int8(),
    }
    # No unit or word in the files: in one of few rows they would outweigh the figures.
    return pa.schema([pa.field(c.name, kinds[c.kind]) for c in columns])


def row_columns() -> Iterator[StoredColumn]:
    """Every column of the 10 Hz rows; those of a flight are single precision: sensors have less."""
    yield from ROW_HEAD
    kinds = {"flying": "bool", "basis": "small"}
    for name, unit in column_units(ROTORS).items():
        yield StoredColumn(name, unit, "", kinds.get(name, "single"))


def table_schema(table: str) -> pa.Schema:
    """The schema of `flights`, `rows`, `sums` or `rejected`."""
    columns = {"flights": FLIGHTS, "sums": SUMS, "rejected": REJECTED}
    return arrow_schema(columns[table] if table in columns else tuple(row_columns()))
