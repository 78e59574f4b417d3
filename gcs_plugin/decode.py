"""From MAVLink fields to channels in SI: the home of degE7, cV, cA, mG, mrad/s, hPa and cdegC.

`MAVLINK_RULES` is the table, for logs and for live links alike; see `gcs_plugin.rules`.

Channels that do not go into a FlightTrack as they are: `geodetic` (latitude °, longitude °,
altitude m), `home` and `ekf_origin` (the same), `landed` (MAV_LANDED_STATE), `servo_us`
(16 outputs), `esc_rpm`, `esc_voltage`, `esc_current`, `esc_failure` (by output number from 0; the
last is ESC_FAILURE_FLAGS), `battery_voltage`, `battery_current`, `battery_percent`,
`battery_consumed` (by battery id; mAh, in a tank ml), `named_value` (by name), `fuel_remaining`,
`fuel_percent`, `fuel_maximum` (by id).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from gcs_plugin.rules import UNITS as UNITS
from gcs_plugin.rules import Columns as Columns
from gcs_plugin.rules import Rule as Rule
from gcs_plugin.rules import Signal as Signal
from gcs_plugin.rules import decode as decode
from gcs_plugin.rules import quantity as quantity
from models.flight import Bools, Floats


def attitude_from_quaternion(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw in rad (Z-Y-X) of the quaternion that turns body into NED."""
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=-1)


def _attitude_quaternion(columns: Columns) -> Floats:
    w, x, y, z = (columns[f"q{i}"].astype(np.float64) for i in (1, 2, 3, 4))
    return attitude_from_quaternion(w, x, y, z)


def _wind_from_direction(columns: Columns) -> Floats:
    # ArduPilot sends where the wind comes from, and the length of the whole vector as speed.
    direction = np.radians(columns["direction"].astype(np.float64))
    down = columns["speed_z"].astype(np.float64)
    speed = columns["speed"].astype(np.float64)
    level = np.sqrt(np.maximum(speed**2 - down**2, 0.0))
    return np.stack([-level * np.cos(direction), -level * np.sin(direction), down], axis=-1)


def _battery_voltage(columns: Columns) -> Floats:
    # A pack above 65.5 V is spread over several cells; 65535 and (in the extension) 0 are unused.
    cells = columns["voltages"].astype(np.float64)
    more = columns["voltages_ext"].astype(np.float64)
    used = cells != 65535
    total = np.where(used, cells, 0.0).sum(axis=-1) + np.where(more < 65535, more, 0.0).sum(axis=-1)
    return np.where(used.any(axis=-1), total * 1e-3, np.nan)


def _downward_distance(columns: Columns) -> Floats:
    # Orientation 25 is MAV_SENSOR_ROTATION_PITCH_270: straight down. At or beyond the sensor's
    # limits a reading says only "too near" or "too far".
    reading = columns["current_distance"].astype(np.float64)
    inside = (reading > columns["min_distance"]) & (reading < columns["max_distance"])
    return np.where(inside & (columns["orientation"] == 25), reading * 1e-2, np.nan)


def esc_rpm(columns: Columns) -> Floats:
    """(n, 4) rpm of ESC_TELEMETRY; NaN where the ESC has never been heard (count 0 and rpm 0)."""
    rpm = columns["rpm"].astype(np.float64)
    return np.where((rpm == 0) & (columns["count"] == 0), np.nan, rpm)


def esc_silent(columns: Columns) -> Bools:
    """(n, 4) True where ESC_TELEMETRY has rpm 0 and its counter stands still: nothing was heard.

    The first row has no counter before it and is never called silent.
    """
    rpm, count = columns["rpm"], columns["count"]
    still = np.zeros(rpm.shape, dtype=np.bool_)
    still[1:] = count[1:] == count[:-1]
    return still & (rpm == 0)


def _liquid(field: str) -> Callable[[Columns], Floats]:
    # Only fuel type 1 is a liquid in ml; others are shares of one, or a gas in Pa.
    def convert(columns: Columns) -> Floats:
        return np.where(columns["fuel_type"] == 1, columns[field].astype(np.float64), np.nan)

    return convert


def _unless_silent(field: str, factor: float) -> Callable[[Columns], Floats]:
    def convert(columns: Columns) -> Floats:
        value = columns[field].astype(np.float64) * factor
        return np.where(columns["count"] == 0, np.nan, value)

    return convert


#: ESC messages with four ESCs each -> number of the first output, counted from 0.
ESC_TELEMETRY_FIRST: Mapping[str, int] = MappingProxyType(
    {f"ESC_TELEMETRY_{n + 1}_TO_{n + 4}": n for n in range(0, 32, 4)}
)

_SERVOS = tuple(f"servo{n}_raw" for n in range(1, 17))


def _esc_rules() -> tuple[Rule, ...]:
    rules = []
    for name in ESC_TELEMETRY_FIRST:
        rules += [
            Rule(message=name, channel="esc_rpm", fields=("rpm",), convert=esc_rpm),
            Rule(
                message=name,
                channel="esc_voltage",
                fields=("voltage",),
                convert=_unless_silent("voltage", UNITS["cV"][0]),
            ),
            Rule(
                message=name,
                channel="esc_current",
                fields=("current",),
                convert=_unless_silent("current", UNITS["cA"][0]),
            ),
        ]
    return tuple(rules)


#: MAVLink, preferred sources first. ESC_STATUS carries the number of its first ESC in `index`.
MAVLINK_RULES: tuple[Rule, ...] = (
    Rule(message="ATTITUDE", channel="attitude", fields=("roll", "pitch", "yaw"), unit="rad"),
    Rule(
        message="ATTITUDE_QUATERNION",
        channel="attitude",
        fields=("q1", "q2", "q3", "q4"),
        convert=_attitude_quaternion,
    ),
    Rule(
        message="ATTITUDE",
        channel="angular_rate_frd",
        fields=("rollspeed", "pitchspeed", "yawspeed"),
        unit="rad/s",
    ),
    Rule(
        message="ATTITUDE_QUATERNION",
        channel="angular_rate_frd",
        fields=("rollspeed", "pitchspeed", "yawspeed"),
        unit="rad/s",
    ),
    Rule(
        message="HIGHRES_IMU",
        channel="specific_force_frd",
        fields=("xacc", "yacc", "zacc"),
        unit="m/s/s",
        index="id",
        only=0,
    ),
    Rule(
        message="RAW_IMU",
        channel="specific_force_frd",
        fields=("xacc", "yacc", "zacc"),
        unit="mG",
        index="id",
        only=0,
        words="RAW_IMU xacc, yacc, zacc (in mG, as ArduPilot sends them)",
    ),
    Rule(
        message="SCALED_IMU",
        channel="specific_force_frd",
        fields=("xacc", "yacc", "zacc"),
        unit="mG",
    ),
    Rule(
        message="GLOBAL_POSITION_INT",
        channel="geodetic",
        fields=("lat", "lon", "alt"),
        unit=("degE7", "degE7", "mm"),
    ),
    Rule(
        message="HOME_POSITION",
        channel="home",
        fields=("latitude", "longitude", "altitude"),
        unit=("degE7", "degE7", "mm"),
    ),
    Rule(
        message="GPS_GLOBAL_ORIGIN",
        channel="ekf_origin",
        fields=("latitude", "longitude", "altitude"),
        unit=("degE7", "degE7", "mm"),
    ),
    Rule(
        message="LOCAL_POSITION_NED",
        channel="position_ned",
        fields=("x", "y", "z"),
        unit="m",
        words="LOCAL_POSITION_NED x, y, z (from the autopilot's own origin)",
    ),
    Rule(
        message="LOCAL_POSITION_NED", channel="velocity_ned", fields=("vx", "vy", "vz"), unit="m/s"
    ),
    Rule(
        message="GLOBAL_POSITION_INT",
        channel="velocity_ned",
        fields=("vx", "vy", "vz"),
        unit="cm/s",
    ),
    Rule(message="GLOBAL_POSITION_INT", channel="altitude", fields=("alt",), unit="mm"),
    Rule(message="VFR_HUD", channel="altitude", fields=("alt",), unit="m"),
    Rule(
        message="DISTANCE_SENSOR",
        channel="height_agl",
        fields=("current_distance",),
        convert=_downward_distance,
        words="DISTANCE_SENSOR current_distance (rangefinder, looking down)",
    ),
    Rule(
        message="RANGEFINDER",
        channel="height_agl",
        fields=("distance",),
        unit="m",
        unknown=(0.0,),
        words="RANGEFINDER distance",
    ),
    Rule(
        message="GLOBAL_POSITION_INT",
        channel="height_agl",
        fields=("relative_alt",),
        unit="mm",
        words="GLOBAL_POSITION_INT relative_alt (height above home, not above the crop)",
    ),
    Rule(message="VFR_HUD", channel="airspeed", fields=("airspeed",), unit="m/s"),
    Rule(
        message="WIND_COV",
        channel="wind_ned",
        fields=("wind_x", "wind_y", "wind_z"),
        unit="m/s",
        words="WIND_COV wind_x, wind_y, wind_z (NED vector)",
    ),
    Rule(
        message="WIND",
        channel="wind_ned",
        fields=("direction", "speed", "speed_z"),
        convert=_wind_from_direction,
        words="WIND direction, speed (direction it comes from, turned round)",
    ),
    Rule(
        message="BATTERY_STATUS",
        channel="battery_voltage",
        fields=("voltages",),
        index="id",
        convert=_battery_voltage,
    ),
    Rule(
        message="BATTERY_STATUS",
        channel="battery_current",
        fields=("current_battery",),
        unit="cA",
        index="id",
        unknown=(-1,),
    ),
    Rule(
        message="BATTERY_STATUS",
        channel="battery_percent",
        fields=("battery_remaining",),
        unit="%",
        index="id",
        unknown=(-1,),
    ),
    Rule(
        message="BATTERY_STATUS",
        channel="battery_consumed",
        fields=("current_consumed",),
        unit="mAh",
        index="id",
        unknown=(-1,),
    ),
    Rule(
        message="SYS_STATUS",
        channel="voltage",
        fields=("voltage_battery",),
        unit="mV",
        unknown=(65535, 0),
    ),
    Rule(
        message="SYS_STATUS",
        channel="current",
        fields=("current_battery",),
        unit="cA",
        unknown=(-1,),
    ),
    Rule(message="SCALED_PRESSURE", channel="pressure", fields=("press_abs",), unit="hPa"),
    Rule(message="HIGHRES_IMU", channel="pressure", fields=("abs_pressure",), unit="hPa"),
    Rule(
        message="SCALED_PRESSURE",
        channel="temperature",
        fields=("temperature",),
        unit="cdegC",
        words="SCALED_PRESSURE temperature (of the autopilot's board: warmer than the air)",
    ),
    Rule(
        message="HIGHRES_IMU",
        channel="temperature",
        fields=("temperature",),
        unit="degC",
        words="HIGHRES_IMU temperature (of the autopilot's board: warmer than the air)",
    ),
    Rule(message="EXTENDED_SYS_STATE", channel="landed", fields=("landed_state",), unknown=(0,)),
    Rule(
        message="SERVO_OUTPUT_RAW",
        channel="servo_us",
        fields=_SERVOS,
        unit="us",
        unknown=(65535,),
    ),
    *_esc_rules(),
    Rule(message="ESC_STATUS", channel="esc_rpm", fields=("rpm",), unit="rpm", index="index"),
    Rule(message="ESC_STATUS", channel="esc_voltage", fields=("voltage",), unit="V", index="index"),
    Rule(message="ESC_STATUS", channel="esc_current", fields=("current",), unit="A", index="index"),
    Rule(message="ESC_INFO", channel="esc_failure", fields=("failure_flags",), index="index"),
    Rule(message="NAMED_VALUE_FLOAT", channel="named_value", fields=("value",)),
    Rule(
        message="FUEL_STATUS",
        channel="fuel_remaining",
        fields=("remaining_fuel",),
        index="id",
        convert=_liquid("remaining_fuel"),
    ),
    Rule(
        message="FUEL_STATUS",
        channel="fuel_percent",
        fields=("percent_remaining",),
        unit="%",
        index="id",
        unknown=(255,),
    ),
    Rule(
        message="FUEL_STATUS",
        channel="fuel_maximum",
        fields=("maximum_fuel",),
        index="id",
        convert=_liquid("maximum_fuel"),
    ),
)
