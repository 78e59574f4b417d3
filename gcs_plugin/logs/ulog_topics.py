"""Which PX4 topic gives which channel: the table, and the few that need more than scaling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import attitude_from_quaternion
from thrustmargin.gcs_plugin.mavlink.rules import UNITS, Signal
from thrustmargin.gcs_plugin.telemetry.resample import in_time_order
from thrustmargin.gcs_plugin.telemetry.signals import Signals, collected
from thrustmargin.models.flight import Floats

#: PX4's output function of motor 1; motors 2 to 12 follow.
MOTOR_1 = 101

_FROM_ORIGIN = " from the estimator's origin"
_WARM_BAROMETER = " (of the barometer: warmer than the air)"
_LEVEL_WIND = {"windspeed_north", "windspeed_east"}

Topic = Mapping[str, NDArray[Any]]

#: (topic, fields, channel, unit, words that follow), preferred first. A field that the topic has
#: element by element stands for its three elements.
_RULES: tuple[tuple[str, tuple[str, ...], str, str, str], ...] = (
    ("vehicle_angular_velocity", ("xyz",), "angular_rate_frd", "rad/s", ""),
    ("sensor_combined", ("gyro_rad",), "angular_rate_frd", "rad/s", ""),
    ("vehicle_acceleration", ("xyz",), "specific_force_frd", "m/s/s", ""),
    ("sensor_combined", ("accelerometer_m_s2",), "specific_force_frd", "m/s/s", ""),
    ("vehicle_local_position", ("x", "y", "z"), "position_ned", "m", _FROM_ORIGIN),
    ("vehicle_local_position", ("vx", "vy", "vz"), "velocity_ned", "m/s", ""),
    ("vehicle_global_position", ("alt",), "altitude", "m", ""),
    ("airspeed_validated", ("true_airspeed_m_s",), "airspeed", "m/s", ""),
    ("airspeed", ("true_airspeed_m_s",), "airspeed", "m/s", ""),
    ("vehicle_air_data", ("baro_pressure_pa",), "pressure", "Pa", ""),
    ("vehicle_air_data", ("ambient_temperature",), "temperature", "degC", ""),
    ("vehicle_air_data", ("baro_temp_celcius",), "temperature", "degC", _WARM_BAROMETER),
)
#: Topics that are read.
TOPICS = (
    *dict.fromkeys(rule[0] for rule in _RULES),
    "vehicle_attitude",
    "esc_status",
    "actuator_motors",
    "battery_status",
    "fuel_tank_status",
    "wind",
    "wind_estimate",
    "vehicle_land_detected",
    "home_position",
    "vehicle_gps_position",
)


def _signal(
    channel: str, source: str, topic: Topic, values: Floats, index: int | None = None
) -> Signal:
    time_s = topic["timestamp"].astype(np.float64) * 1e-6
    return Signal(channel, source, *in_time_order(time_s, values), index)


def _columns(topic: Topic, field: str) -> list[str]:
    return [field] if field in topic else [f"{field}[{i}]" for i in range(3)]


def _si(topic: Topic, name: str, unit: str) -> Floats:
    factor, offset = UNITS[unit]
    return topic[name].astype(np.float64) * factor + offset


def ulog_signals(topics: Mapping[str, list[Topic]]) -> tuple[Signals, list[str]]:
    """Signals of every topic by name (each a list of its instances), and notes."""
    signals: list[Signal] = []
    notes: list[str] = []
    for name, fields, channel, unit, more in _RULES:
        for topic in topics.get(name, [])[:1]:
            columns = [column for field in fields for column in _columns(topic, field)]
            if all(column in topic for column in columns):
                parts = [_si(topic, column, unit) for column in columns]
                values = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
                words = f"{name} {', '.join(fields)}{more}"
                signals.append(_signal(channel, words, topic, values))
    first = {name: group[0] for name, group in topics.items()}
    for name, needed, method in _METHODS:
        if name in first and all(field in first[name] for field in needed):
            signals += method(first[name])
    for number, topic in enumerate(topics.get("battery_status", [])):
        signals += _battery(topic, number)
    for number, topic in enumerate(topics.get("fuel_tank_status", [])):
        signals += _fuel(topic, number)
    if "esc_status" in first:
        made, remarks = _escs(first["esc_status"])
        signals += made
        notes += remarks
    signals += _airspeed_by_wind(first)
    return collected(signals), notes


def _attitude(topic: Topic) -> list[Signal]:
    w, x, y, z = (_si(topic, f"q[{i}]", "1") for i in range(4))
    return [_signal("attitude", "vehicle_attitude q", topic, attitude_from_quaternion(w, x, y, z))]


def _height_and_origin(topic: Topic) -> list[Signal]:
    made = []
    if "dist_bottom_valid" in topic and "dist_bottom" in topic:
        distance = np.where(topic["dist_bottom_valid"] > 0, _si(topic, "dist_bottom", "m"), np.nan)
        words = "vehicle_local_position dist_bottom (above ground)"
        made.append(_signal("height_agl", words, topic, distance))
    words = "vehicle_local_position -z (height above the estimator's origin, not above the crop)"
    made.append(_signal("height_agl", words, topic, -_si(topic, "z", "m")))
    if all(f"ref_{n}" in topic for n in ("lat", "lon", "alt")):
        place = np.stack([_si(topic, f"ref_{n}", "1") for n in ("lat", "lon", "alt")], axis=-1)
        known = (np.abs(place[:, :2]) > 0).any(axis=1) & np.isfinite(place).all(axis=1)
        place[~known] = np.nan
        made.append(_signal("ekf_origin", "vehicle_local_position ref", topic, place))
        if "z_global" in topic:
            amsl = np.where(topic["z_global"] > 0, place[:, 2] - _si(topic, "z", "m"), np.nan)
            words = "vehicle_local_position ref_alt less z"
            made.append(_signal("altitude", words, topic, amsl))
    return made


def _home(topic: Topic) -> list[Signal]:
    place = np.stack([_si(topic, name, "1") for name in ("lat", "lon", "alt")], axis=-1)
    if "valid_hpos" in topic:
        place[topic["valid_hpos"] == 0] = np.nan
    return [_signal("home", "home_position", topic, place)]


def _landed(topic: Topic) -> list[Signal]:
    state = np.where(topic["landed"] > 0, 1.0, 2.0)
    return [_signal("landed", "vehicle_land_detected landed", topic, state)]


def _throttle(topic: Topic) -> list[Signal]:
    made = []
    for number in range(12):
        name = f"control[{number}]"
        if name in topic and np.isfinite(topic[name]).any():
            values = np.clip(_si(topic, name, "1"), 0.0, 1.0)
            made.append(_signal("throttle", "actuator_motors control", topic, values, number))
    return made


def _wind(topic: Topic) -> list[Signal]:
    north, east = _si(topic, "windspeed_north", "m/s"), _si(topic, "windspeed_east", "m/s")
    wind = np.stack([north, east, np.zeros(north.size)], axis=-1)
    return [_signal("wind_ned", "wind windspeed_north, windspeed_east (level)", topic, wind)]


def _airspeed_by_wind(first: Mapping[str, Topic]) -> list[Signal]:
    ground, air = first.get("vehicle_local_position"), first.get("wind", first.get("wind_estimate"))
    if ground is None or air is None:
        return []
    if not {"vx", "vy", "vz"} <= ground.keys() or not air.keys() >= _LEVEL_WIND:
        return []
    when = ground["timestamp"].astype(np.float64)
    blown, order = np.unique(air["timestamp"].astype(np.float64), return_index=True)
    parts = [
        _si(ground, v, "m/s") - np.interp(when, blown, _si(air, w, "m/s")[order])
        for v, w in (("vx", "windspeed_north"), ("vy", "windspeed_east"))
    ]
    speed = np.sqrt(parts[0] ** 2 + parts[1] ** 2 + _si(ground, "vz", "m/s") ** 2)
    words = "vehicle_local_position velocity less wind (estimator)"
    return [_signal("airspeed", words, ground, speed)]


def _battery(topic: Topic, number: int) -> list[Signal]:
    of = f" of id {number}"
    made = []
    for field, channel, factor, unknown in (
        ("voltage_v", "battery_voltage", 1.0, 0.0),
        ("current_a", "battery_current", 1.0, -1.0),
        ("remaining", "battery_percent", 100.0, -1.0),
        ("discharged_mah", "battery_consumed", 1.0, -1.0),
    ):
        if field in topic:
            raw = _si(topic, field, "1")
            values = np.where(raw == unknown, np.nan, raw * factor)
            made.append(_signal(channel, f"battery_status {field}{of}", topic, values, number))
    return made


def _fuel(topic: Topic, number: int) -> list[Signal]:
    made = []
    for field, channel in (
        ("remaining_fuel", "fuel_remaining"),
        ("percent_remaining", "fuel_percent"),
        ("maximum_fuel_capacity", "fuel_maximum"),
    ):
        if field in topic:
            values = _si(topic, field, "1")
            if channel == "fuel_percent":
                values = np.where(values > 100, np.nan, values)
            source = f"fuel_tank_status {field} of id {number}"
            made.append(_signal(channel, source, topic, values, number))
    return made


def _escs(topic: Topic) -> tuple[list[Signal], list[str]]:
    """ESC channels by motor number from 0, whatever their place in the message."""
    made: list[Signal] = []
    notes: list[str] = []
    seen: dict[int, int] = {}
    # Logs from before 2021 have no functions, or zeros: then the place is the motor.
    named = any(
        np.any(topic.get(f"esc[{place}].actuator_function", np.zeros(1)) >= MOTOR_1)
        for place in range(12)
    )
    for place in range(12):
        if f"esc[{place}].esc_rpm" not in topic:
            break
        rpm = _si(topic, f"esc[{place}].esc_rpm", "rpm")
        if named:
            motor = int(topic.get(f"esc[{place}].actuator_function", np.zeros(1))[-1]) - MOTOR_1
            if not 0 <= motor < 12:
                continue
        else:
            motor = place
            if not np.any(rpm != 0):
                continue
        if motor in seen:
            continue
        twin = next((m for m, p in seen.items() if _same(topic, p, place)), None)
        if twin is not None and np.any(rpm != 0):
            notes.append(f"esc_status {place + 1} repeats motor {twin + 1} and is left out")
            continue
        seen[motor] = place
        online = topic.get("esc_online_flags")
        if online is not None:
            rpm = np.where((online.astype(np.int64) >> place) & 1, rpm, np.nan)
        made.append(_signal("esc_rpm", "esc_status esc_rpm", topic, rpm, motor))
        for field, channel, unit in (
            ("esc_voltage", "esc_voltage", "V"),
            ("esc_current", "esc_current", "A"),
        ):
            name = f"esc[{place}].{field}"
            if name in topic:
                made.append(
                    _signal(channel, f"esc_status {field}", topic, _si(topic, name, unit), motor)
                )
    stated = int(topic["esc_count"].max(initial=0)) if "esc_count" in topic else 0
    if stated and stated != len(seen):
        notes.append(f"esc_status says {stated} ESCs; {len(seen)} of them are motors that report")
    return made, notes


def _same(topic: Topic, one: int, other: int) -> bool:
    return bool(np.array_equal(topic[f"esc[{one}].esc_rpm"], topic[f"esc[{other}].esc_rpm"]))


#: Topics that need more than scaling: the fields without which they say nothing, and what is done.
_METHODS: tuple[tuple[str, tuple[str, ...], Callable[[Topic], list[Signal]]], ...] = (
    ("vehicle_attitude", ("q[0]", "q[1]", "q[2]", "q[3]"), _attitude),
    ("vehicle_local_position", ("z",), _height_and_origin),
    ("home_position", ("lat", "lon", "alt"), _home),
    ("vehicle_land_detected", ("landed",), _landed),
    ("actuator_motors", (), _throttle),
    ("wind", ("windspeed_north", "windspeed_east"), _wind),
    ("wind_estimate", ("windspeed_north", "windspeed_east"), _wind),
)
