"""Convert MAVLink fields, in degE7, cV, cA, mG, mrad/s, hPa and cdegC, to channels in SI.

`MAVLINK_RULES` is the table, for logs and for live links alike; see `mavlink.rules`.

Channels that do not go into a FlightTrack as they are: `geodetic` (latitude °, longitude °,
altitude m), `home` and `ekf_origin` (the same), `landed` (MAV_LANDED_STATE), `armed` (1 or 0),
`mission_item` (that is flown), `servo_us` (16 outputs, by port from 0), `esc_rpm`, `esc_voltage`,
`esc_current`, `esc_errors`, `esc_failure` (by output number from 0; the last is ESC_FAILURE_FLAGS),
`battery_voltage`, `battery_current`, `battery_percent`, `battery_consumed` (by battery id; mAh, in
a tank ml), `battery_cells` (in series), `battery_capacity` (mAh), `battery_nominal` (V; these by
battery id, too), `named_value` (by name), `fuel_remaining`, `fuel_percent` (by id).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Columns, Rule, in_si
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.provenance import Meaning


def attitude_from_quaternion(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Return roll, pitch, yaw (n, 3), rad (Z-Y-X), of unit quaternions that rotate body into NED.

    `w`, `x`, `y` and `z` are their components (n,).
    """
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=-1)


def commanded_by_quaternion(wxyz: Floats) -> Floats:
    """Return the demanded roll and pitch (n, 2), rad, of quaternions w, x, y, z (n, 4).

    NaN for a zero quaternion, which is no demand.
    """
    stated = np.any(wxyz != 0.0, axis=1, keepdims=True)
    return np.where(stated, attitude_from_quaternion(*wxyz.T)[:, :2], np.nan)


def _asked_attitude(columns: Columns) -> Floats:
    # Bit 7 of type_mask: no attitude is asked for.
    ignored = columns["type_mask"] & 128 > 0
    return commanded_by_quaternion(np.where(ignored[:, None], 0.0, columns["q"].astype(np.float64)))


def _wind_from_direction(columns: Columns) -> Floats:
    # ArduPilot sends where the wind comes from, and the length of the whole vector as speed.
    direction = np.radians(columns["direction"].astype(np.float64))
    down = columns["speed_z"].astype(np.float64)
    speed = columns["speed"].astype(np.float64)
    level = np.sqrt(np.maximum(speed**2 - down**2, 0.0))
    return np.stack([-level * np.cos(direction), -level * np.sin(direction), down], axis=-1)


def _battery_voltage(columns: Columns) -> Floats:
    # More than 65.5 V is spread over several cells; 65535 and (in the extension) 0 are unused.
    cells = columns["voltages"].astype(np.float64)
    further = columns["voltages_ext"].astype(np.float64)
    used = cells != 65535
    total = np.where(used, cells, 0.0).sum(axis=-1) + np.where(further < 65535, further, 0.0).sum(
        axis=-1
    )
    return np.where(used.any(axis=-1), total * 1e-3, np.nan)


def _downward_distance(columns: Columns) -> Floats:
    # Orientation 25 is MAV_SENSOR_ROTATION_PITCH_270: straight down. At or beyond the sensor's
    # limits a reading says only "too near" or "too far".
    reading = columns["current_distance"].astype(np.float64)
    inside = (reading > columns["min_distance"]) & (reading < columns["max_distance"])
    return np.where(inside & (columns["orientation"] == 25), reading * 1e-2, np.nan)


def esc_rpm(columns: Columns) -> Floats:
    """Return the speeds (n, 4), rpm, of n ESC_TELEMETRY messages, whose fields `columns` maps by
    name.

    NaN while an ESC has never answered (count and rpm 0).
    """
    rpm = columns["rpm"].astype(np.float64)
    return np.where((rpm == 0) & (columns["count"] == 0), np.nan, rpm)


def esc_silent(columns: Columns) -> Bools:
    """Flag (n, 4) where ESC_TELEMETRY has rpm 0 and an unchanged counter: the ESC did not answer.

    `columns` maps the messages' fields by name, in order of time. The first row has no earlier
    counter and is never flagged.
    """
    rpm, count = columns["rpm"], columns["count"]
    still = np.zeros(rpm.shape, dtype=np.bool_)
    still[1:] = count[1:] == count[:-1]
    return still & (rpm == 0)


def _armed(columns: Columns) -> Floats:
    # MAV_MODE_FLAG_SAFETY_ARMED, of an autopilot; 8 is MAV_AUTOPILOT_INVALID, a component without.
    armed = (columns["base_mode"] & 128 > 0).astype(np.float64)
    return np.where(columns["autopilot"] == 8, np.nan, armed)


def _liquid(columns: Columns) -> Floats:
    # Only fuel type 1 is a liquid in ml; others are shares of one, or a gas in Pa.
    millilitres = columns["remaining_fuel"].astype(np.float64)
    return np.where(columns["fuel_type"] == 1, millilitres, np.nan)


def _lithium_cells(columns: Columns) -> Floats:
    # MAV_BATTERY_TYPE 2 and 4 are LiFePO4 and NiMH, whose cells have another voltage; 0 is unknown.
    cells = columns["cells_in_series"].astype(np.float64)
    return np.where(np.isin(columns["type"], (2, 4)) | (cells == 0), np.nan, cells)


def _unless_silent(field: str, unit: str) -> Callable[[Columns], Floats]:
    def convert(columns: Columns) -> Floats:
        return np.where(columns["count"] == 0, np.nan, in_si(columns, field, unit))

    return convert


def _esc_temperature(columns: Columns) -> Floats:
    # A whole number of °C; 0 is what an ESC without a sensor sends.
    kelvin = in_si(columns, "temperature", "degC")
    return np.where((columns["count"] == 0) | (columns["temperature"] == 0), np.nan, kelvin)


def _esc_info_temperature(columns: Columns) -> Floats:
    # INT16_MAX is "not known"; 0 is what an ESC without a sensor sends.
    raw = columns["temperature"]
    kelvin = in_si(columns, "temperature", "cdegC")
    return np.where((raw == 32767) | (raw == 0), np.nan, kelvin)


def _vibration(columns: Columns) -> Floats:
    # ArduPilot sends three axes in m/s²; PX4 its accelerometer as z, and small numbers besides.
    axes = [in_si(columns, name, "1") for name in _VIBRATION]
    return np.sqrt(np.sum(np.square(axes), axis=0))


#: ESC messages with four ESCs each -> number of the first output, counted from 0.
ESC_TELEMETRY_FIRST: Mapping[str, int] = MappingProxyType(
    {f"ESC_TELEMETRY_{n + 1}_TO_{n + 4}": n for n in range(0, 32, 4)}
)

_VIBRATION = ("vibration_x", "vibration_y", "vibration_z")
_PLACE = ("degE7", "degE7", "mm")
_RATES, _FORCE = ("rollspeed", "pitchspeed", "yawspeed"), ("xacc", "yacc", "zacc")
_T, _WARM = ("temperature",), Meaning.BOARD_TEMPERATURE
_AS_SENT, _OWN_ORIGIN = "in mG", "from own origin"
_DISTANCE, _DOWN = ("current_distance",), "downward rangefinder"
_TURNED = "direction turned round"
_QUATERNION = ("q1", "q2", "q3", "q4")
_SERVOS = tuple(f"servo{n}_raw" for n in range(1, 17))


_ESCS = tuple(
    Rule(name, (field,), f"esc_{field}", convert=convert)
    for name in ESC_TELEMETRY_FIRST
    for field, convert in (
        ("rpm", esc_rpm),
        ("voltage", _unless_silent("voltage", "cV")),
        ("current", _unless_silent("current", "cA")),
        ("temperature", _esc_temperature),
    )
)


def _by_id(message: str, *rows: tuple[str, str, str, tuple[int, ...]]) -> tuple[Rule, ...]:
    """Return one rule for each of `rows`: field, channel, unit and values for "not known".

    The channel is indexed by the message's field `id`.
    """
    return tuple(
        Rule(message, (field,), channel, unit, index="id", unknown=unknown)
        for field, channel, unit, unknown in rows
    )


_CELLS = tuple(
    Rule(name, ("cells_in_series",), "battery_cells", index="id", convert=_lithium_cells)
    for name in ("BATTERY_INFO", "SMART_BATTERY_INFO")
)
#: MAVLink, preferred sources first. ESC_STATUS carries the number of its first ESC in `index`.
MAVLINK_RULES: tuple[Rule, ...] = (
    Rule("ATTITUDE", ("roll", "pitch", "yaw"), "attitude", "rad"),
    Rule(
        "ATTITUDE_QUATERNION",
        _QUATERNION,
        "attitude",
        convert=lambda c: attitude_from_quaternion(*(in_si(c, q, "1") for q in _QUATERNION)),
    ),
    Rule("ATTITUDE_TARGET", ("q", "type_mask"), "asked_attitude", convert=_asked_attitude),
    Rule("NAV_CONTROLLER_OUTPUT", ("nav_roll", "nav_pitch"), "asked_attitude", "deg"),
    Rule("ATTITUDE", _RATES, "angular_rate_frd", "rad/s"),
    Rule("ATTITUDE_QUATERNION", _RATES, "angular_rate_frd", "rad/s"),
    Rule("HIGHRES_IMU", _FORCE, "specific_force_frd", "m/s/s", index="id", only=0),
    Rule("RAW_IMU", _FORCE, "specific_force_frd", "mG", index="id", only=0, note=_AS_SENT),
    Rule("SCALED_IMU", _FORCE, "specific_force_frd", "mG"),
    Rule("GLOBAL_POSITION_INT", ("lat", "lon", "alt"), "geodetic", _PLACE),
    Rule("HOME_POSITION", ("latitude", "longitude", "altitude"), "home", _PLACE),
    Rule("GPS_GLOBAL_ORIGIN", ("latitude", "longitude", "altitude"), "ekf_origin", _PLACE),
    Rule("LOCAL_POSITION_NED", ("x", "y", "z"), "position_ned", "m", note=_OWN_ORIGIN),
    Rule("LOCAL_POSITION_NED", ("vx", "vy", "vz"), "velocity_ned", "m/s"),
    Rule("GLOBAL_POSITION_INT", ("vx", "vy", "vz"), "velocity_ned", "cm/s"),
    Rule("GLOBAL_POSITION_INT", ("alt",), "altitude", "mm"),
    Rule("VFR_HUD", ("alt",), "altitude", "m"),
    Rule("DISTANCE_SENSOR", _DISTANCE, "height_agl", convert=_downward_distance, note=_DOWN),
    Rule("RANGEFINDER", ("distance",), "height_agl", "m", unknown=(0.0,)),
    Rule("GLOBAL_POSITION_INT", ("relative_alt",), "height_agl", "mm", meaning=Meaning.ABOVE_HOME),
    Rule("VFR_HUD", ("airspeed",), "airspeed", "m/s"),
    Rule("WIND_COV", ("wind_x", "wind_y", "wind_z"), "wind_ned", "m/s", note="NED vector"),
    Rule("WIND", ("direction", "speed"), "wind_ned", convert=_wind_from_direction, note=_TURNED),
    Rule("BATTERY_STATUS", ("voltages",), "battery_voltage", index="id", convert=_battery_voltage),
    *_by_id(
        "BATTERY_STATUS",
        ("current_battery", "battery_current", "cA", (-1,)),
        ("battery_remaining", "battery_percent", "%", (-1,)),
        ("current_consumed", "battery_consumed", "mAh", (-1,)),
    ),
    # Unknown is NaN in these, and 255 %.
    *_by_id(
        "BATTERY_STATUS_V2",
        ("voltage", "battery_voltage", "V", ()),
        ("current", "battery_current", "A", ()),
        ("percent_remaining", "battery_percent", "%", (255,)),
        ("capacity_consumed", "battery_consumed", "Ah", ()),
    ),
    *_CELLS,
    *_by_id(
        "BATTERY_INFO",
        ("nominal_voltage", "battery_nominal", "V", (0,)),
        ("design_capacity", "battery_capacity", "Ah", (0,)),
    ),
    *_by_id(
        "SMART_BATTERY_INFO", ("capacity_full_specification", "battery_capacity", "mAh", (-1,))
    ),
    Rule("SYS_STATUS", ("voltage_battery",), "voltage", "mV", unknown=(65535, 0)),
    Rule("SYS_STATUS", ("current_battery",), "current", "cA", unknown=(-1,)),
    Rule("SCALED_PRESSURE", ("press_abs",), "pressure", "hPa"),
    Rule("HIGHRES_IMU", ("abs_pressure",), "pressure", "hPa"),
    # 0.00 °C is what a board without a sensor sends; no real one stays at it.
    Rule("SCALED_PRESSURE", _T, "temperature", "cdegC", meaning=_WARM, unknown=(0,)),
    Rule("HIGHRES_IMU", _T, "temperature", "degC", meaning=_WARM, unknown=(0,)),
    Rule("EXTENDED_SYS_STATE", ("landed_state",), "landed", unknown=(0,)),
    Rule("HEARTBEAT", ("base_mode",), "armed", convert=_armed),
    Rule("MISSION_CURRENT", ("seq",), "mission_item"),
    Rule("SERVO_OUTPUT_RAW", _SERVOS, "servo_us", "us", index="port", unknown=(65535,)),
    Rule("ACTUATOR_OUTPUT_STATUS", ("actuator",), "servo_us", "us"),
    *_ESCS,
    Rule("ESC_STATUS", ("rpm",), "esc_rpm", "rpm", index="index"),
    Rule("ESC_STATUS", ("voltage",), "esc_voltage", "V", index="index"),
    Rule("ESC_STATUS", ("current",), "esc_current", "A", index="index"),
    Rule("ESC_INFO", ("failure_flags",), "esc_failure", index="index"),
    Rule(
        "ESC_INFO",
        ("temperature",),
        "esc_temperature",
        convert=_esc_info_temperature,
        index="index",
    ),
    Rule("ESC_INFO", ("error_count",), "esc_errors", index="index"),
    Rule("VIBRATION", _VIBRATION, "vibration", convert=_vibration),
    Rule("VIBRATION", ("clipping_0",), "clipping"),
    Rule("NAMED_VALUE_FLOAT", ("value",), "named_value"),
    Rule("FUEL_STATUS", ("remaining_fuel",), "fuel_remaining", index="id", convert=_liquid),
    Rule("FUEL_STATUS", ("percent_remaining",), "fuel_percent", "%", index="id", unknown=(255,)),
)
