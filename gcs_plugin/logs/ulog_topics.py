"""Which PX4 topic gives which channel: the table, and the few that need more than scaling."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import attitude_from_quaternion
from thrustmargin.gcs_plugin.mavlink.rules import Columns, Rule, Signal, in_si, quantity
from thrustmargin.gcs_plugin.telemetry.resample import in_time_order
from thrustmargin.gcs_plugin.telemetry.signals import Signals, collected, speed_through_air
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.atmosphere import BOARD_READING

#: PX4's output function of motor 1; motors 2 to 12 follow.
MOTOR_1 = 101
#: vehicle_status.arming_state of an armed vehicle.
ARMED = 2

#: Fields of one topic by name, (n,) or, for what the log has element by element, (n, k).
Topic = Mapping[str, NDArray[Any]]


def _attitude(topic: Columns) -> Floats:
    return attitude_from_quaternion(*in_si(topic, "q", "1").T)


def _ground_distance(topic: Columns) -> Floats:
    return np.where(topic["dist_bottom_valid"] > 0, in_si(topic, "dist_bottom", "m"), np.nan)


def _origin(topic: Columns) -> Floats:
    place = np.stack([in_si(topic, f"ref_{n}", "1") for n in ("lat", "lon", "alt")], axis=-1)
    known = (np.abs(place[:, :2]) > 0).any(axis=1) & np.isfinite(place).all(axis=1)
    place[~known] = np.nan
    return place


def _altitude(topic: Columns) -> Floats:
    above_origin = in_si(topic, "ref_alt", "m") - in_si(topic, "z", "m")
    return np.where(topic["z_global"] > 0, above_origin, np.nan)


def _level_wind(topic: Columns) -> Floats:
    north, east = (in_si(topic, f"windspeed_{way}", "m/s") for way in ("north", "east"))
    return np.stack([north, east, np.zeros(north.size)], axis=-1)


def _home(topic: Any) -> Floats:
    place = np.stack([in_si(topic, name, "1") for name in _PLACE], axis=-1)
    if "valid_hpos" in topic:
        place[topic["valid_hpos"] == 0] = np.nan
    return place


def _height(topic: Columns) -> Floats:
    return -in_si(topic, "z", "m")


def _landed(topic: Columns) -> Floats:
    return np.where(topic["landed"] > 0, 1.0, 2.0)


def _status_armed(topic: Columns) -> Floats:
    return (topic["arming_state"] == ARMED).astype(np.float64)


def _fuel_percent(topic: Columns) -> Floats:
    percent = in_si(topic, "percent_remaining", "%")
    return np.where(percent > 100, np.nan, percent)


_PLACE = ("lat", "lon", "alt")
_REF = ("ref_lat", "ref_lon", "ref_alt")
_WIND = ("windspeed_north", "windspeed_east")
_POSITION, _BATTERY, _FUEL = "vehicle_local_position", "battery_status", "fuel_tank_status"
_ABOVE_ORIGIN = "height above the estimator's origin, not above the crop"
_WARM_BAROMETER = f"of the barometer: {BOARD_READING}"
#: Preferred sources first. A source needs all its fields. Batteries and tanks are all read, of
#: other topics the first instance.
RULES: tuple[Rule, ...] = (
    Rule("vehicle_attitude", ("q",), "attitude", convert=_attitude),
    Rule("vehicle_angular_velocity", ("xyz",), "angular_rate_frd", "rad/s"),
    Rule("sensor_combined", ("gyro_rad",), "angular_rate_frd", "rad/s"),
    Rule("vehicle_acceleration", ("xyz",), "specific_force_frd", "m/s/s"),
    Rule("sensor_combined", ("accelerometer_m_s2",), "specific_force_frd", "m/s/s"),
    Rule(_POSITION, ("x", "y", "z"), "position_ned", "m", note="from the estimator's origin"),
    Rule(_POSITION, ("vx", "vy", "vz"), "velocity_ned", "m/s"),
    Rule(_POSITION, _REF, "ekf_origin", convert=_origin),
    Rule("home_position", _PLACE, "home", convert=_home),
    Rule("vehicle_global_position", ("alt",), "altitude", "m"),
    Rule(_POSITION, ("ref_alt", "z", "z_global"), "altitude", convert=_altitude),
    Rule(
        _POSITION,
        ("dist_bottom", "dist_bottom_valid"),
        "height_agl",
        convert=_ground_distance,
        note="above ground",
    ),
    Rule(_POSITION, ("z",), "height_agl", convert=_height, note=_ABOVE_ORIGIN),
    Rule("vehicle_land_detected", ("landed",), "landed", convert=_landed),
    Rule("actuator_armed", ("armed",), "armed"),
    Rule("vehicle_status", ("arming_state",), "armed", convert=_status_armed),
    Rule("airspeed_validated", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("airspeed", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("wind", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule("wind_estimate", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule("vehicle_air_data", ("baro_pressure_pa",), "pressure", "Pa"),
    Rule("vehicle_air_data", ("ambient_temperature",), "temperature", "degC", unknown=(0,)),
    Rule(
        "vehicle_air_data",
        ("baro_temp_celcius",),
        "temperature",
        "degC",
        note=_WARM_BAROMETER,
        unknown=(0,),
    ),
    Rule(_BATTERY, ("voltage_v",), "battery_voltage", "V", unknown=(0.0,)),
    Rule(_BATTERY, ("current_a",), "battery_current", "A", unknown=(-1.0,)),
    Rule(_BATTERY, ("remaining",), "battery_percent", "share", unknown=(-1.0,)),
    Rule(_BATTERY, ("discharged_mah",), "battery_consumed", "mAh", unknown=(-1.0,)),
    Rule(_FUEL, ("remaining_fuel",), "fuel_remaining", "ml"),
    Rule(_FUEL, ("percent_remaining",), "fuel_percent", convert=_fuel_percent),
)
#: Fields that a log has element by element, and how many there are.
VECTORS = {"q": 4, "xyz": 3, "gyro_rad": 3, "accelerometer_m_s2": 3, "control": 12}
_EVERY_INSTANCE = (_BATTERY, _FUEL)
#: Topics that are read.
TOPICS = (
    *dict.fromkeys(rule.message for rule in RULES),
    "esc_status",
    "actuator_motors",
    "vehicle_gps_position",
)


def with_vectors(topic: Topic) -> Topic:
    """The topic with its vectors as columns (n, k) besides their elements."""
    vectors = {}
    for field, width in VECTORS.items():
        elements = [f"{field}[{i}]" for i in range(width)]
        if all(name in topic for name in elements):
            vectors[field] = np.stack([topic[name] for name in elements], axis=-1)
    return {**topic, **vectors}


def ulog_signals(topics: Mapping[str, list[Topic]]) -> tuple[Signals, list[str]]:
    """Signals of every topic by name (each a list of its instances), and notes."""
    signals = [signal for rule in RULES for signal in _by_rule(rule, topics)]
    notes: list[str] = []
    first = {name: group[0] for name, group in topics.items()}
    if "actuator_motors" in first:
        signals += _throttle(first["actuator_motors"])
    if "esc_status" in first:
        made, remarks = _escs(first["esc_status"])
        signals += made
        notes += remarks
    signals += _airspeed_by_wind(first)
    return collected(signals), notes


def _by_rule(rule: Rule, topics: Mapping[str, list[Topic]]) -> Iterator[Signal]:
    every = rule.message in _EVERY_INSTANCE
    for number, topic in enumerate(topics.get(rule.message, [])[: None if every else 1]):
        if all(name in topic for name in rule.fields):
            words = f"{rule.source} of id {number}" if every else rule.source
            values = quantity(rule, topic)
            yield _signal(rule.channel, words, topic, values, number if every else None)


def _signal(
    channel: str, source: str, topic: Topic, values: Floats, index: int | None = None
) -> Signal:
    time_s = in_si(topic, "timestamp", "1") * 1e-6
    return Signal(channel, source, *in_time_order(time_s, values), index)


def _throttle(topic: Topic) -> list[Signal]:
    if "control" not in topic:
        return []
    duty = np.clip(in_si(topic, "control", "1"), 0.0, 1.0)
    return [
        _signal("throttle", "actuator_motors control", topic, duty[:, motor], motor)
        for motor in np.flatnonzero(np.isfinite(duty).any(axis=0)).tolist()
    ]


def _airspeed_by_wind(first: Mapping[str, Topic]) -> list[Signal]:
    ground, air = first.get(_POSITION), first.get("wind", first.get("wind_estimate"))
    if ground is None or air is None:
        return []
    if not {"vx", "vy", "vz"} <= ground.keys() or not set(_WIND) <= air.keys():
        return []
    velocity = np.stack([in_si(ground, v, "m/s") for v in ("vx", "vy", "vz")], axis=-1)
    speed = speed_through_air(ground["timestamp"], velocity, air["timestamp"], _level_wind(air))
    words = "vehicle_local_position velocity less wind (estimator)"
    return [_signal("airspeed", words, ground, speed)]


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
        rpm = in_si(topic, f"esc[{place}].esc_rpm", "rpm")
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
        for field, unit in (("esc_voltage", "V"), ("esc_current", "A")):
            if (name := f"esc[{place}].{field}") in topic:
                values = in_si(topic, name, unit)
                made.append(_signal(field, f"esc_status {field}", topic, values, motor))
    stated = int(topic["esc_count"].max(initial=0)) if "esc_count" in topic else 0
    if stated and stated != len(seen):
        notes.append(f"esc_status says {stated} ESCs; {len(seen)} of them are motors that report")
    return made, notes


def _same(topic: Topic, one: int, other: int) -> bool:
    return bool(np.array_equal(topic[f"esc[{one}].esc_rpm"], topic[f"esc[{other}].esc_rpm"]))
