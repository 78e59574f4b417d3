"""Which PX4 topic gives which channel: the table, and the few that need more than scaling."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import asked_by_quaternion, attitude_from_quaternion
from thrustmargin.gcs_plugin.mavlink.rules import Columns, Rule, Signal, in_si, quantity
from thrustmargin.gcs_plugin.telemetry.resample import in_time_order
from thrustmargin.gcs_plugin.telemetry.signals import Signals, collected
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind

#: Fields of one topic by name, (n,) or, for what the log has element by element, (n, k).
Topic = Mapping[str, NDArray[Any]]


def _attitude(topic: Columns) -> Floats:
    return attitude_from_quaternion(*in_si(topic, "q", "1").T)


def _asked_attitude(topic: Columns) -> Floats:
    return asked_by_quaternion(in_si(topic, "q_d", "1"))


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


_PLACE = ("lat", "lon", "alt")
_ANGLES = ("roll_body", "pitch_body")
_ARMED = 2  # arming_state
_AIR, _WARM = "vehicle_air_data", Meaning.BOARD_TEMPERATURE
_DISTANCE = ("dist_bottom", "dist_bottom_valid")
_REF = ("ref_lat", "ref_lon", "ref_alt")
_WIND = ("windspeed_north", "windspeed_east")
_POSITION, _BATTERY, _FUEL = "vehicle_local_position", "battery_status", "fuel_tank_status"
_GPS = "vehicle_gps_position"
_ABOVE_ORIGIN = "height above the estimator's origin, not above the crop"
#: Preferred sources first. A source needs all its fields. Batteries and tanks are all read, of
#: other topics the first instance.
RULES: tuple[Rule, ...] = (
    Rule("vehicle_attitude", ("q",), "attitude", convert=_attitude),
    Rule("vehicle_attitude_setpoint", ("q_d",), "asked_attitude", convert=_asked_attitude),
    Rule("vehicle_attitude_setpoint", _ANGLES, "asked_attitude", "rad"),
    Rule("vehicle_angular_velocity", ("xyz",), "angular_rate_frd", "rad/s"),
    Rule("sensor_combined", ("gyro_rad",), "angular_rate_frd", "rad/s"),
    Rule("vehicle_acceleration", ("xyz",), "specific_force_frd", "m/s/s"),
    Rule("sensor_combined", ("accelerometer_m_s2",), "specific_force_frd", "m/s/s"),
    Rule(_POSITION, ("x", "y", "z"), "position_ned", "m", note="from the estimator's origin"),
    Rule(_POSITION, ("vx", "vy", "vz"), "velocity_ned", "m/s"),
    Rule(_GPS, ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), "velocity_ned", "m/s", note="GPS"),
    Rule(_POSITION, _REF, "ekf_origin", convert=_origin),
    Rule("home_position", _PLACE, "home", convert=_home),
    Rule("vehicle_global_position", ("alt",), "altitude", "m"),
    Rule(_POSITION, ("ref_alt", "z", "z_global"), "altitude", convert=_altitude),
    Rule(_POSITION, _DISTANCE, "height_agl", convert=_ground_distance, note="above ground"),
    Rule(_POSITION, ("z",), "height_agl", convert=_height, note=_ABOVE_ORIGIN),
    Rule("vehicle_land_detected", ("landed",), "landed", convert=_landed),
    Rule("actuator_armed", ("armed",), "armed"),
    Rule(
        "vehicle_status",
        ("arming_state",),
        "armed",
        convert=lambda t: 1.0 * (t["arming_state"] == _ARMED),
    ),
    Rule("airspeed_validated", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("airspeed", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("wind", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule("wind_estimate", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule(_AIR, ("baro_pressure_pa",), "pressure", "Pa"),
    Rule(_AIR, ("ambient_temperature",), "temperature", "degC", unknown=(0,)),
    Rule(_AIR, ("baro_temp_celcius",), "temperature", "degC", meaning=_WARM, unknown=(0,)),
    Rule(_BATTERY, ("voltage_v",), "battery_voltage", "V", unknown=(0.0,)),
    Rule(_BATTERY, ("current_a",), "battery_current", "A", unknown=(-1.0,)),
    Rule(_BATTERY, ("remaining",), "battery_percent", "share", unknown=(-1.0,)),
    Rule(_BATTERY, ("discharged_mah",), "battery_consumed", "mAh", unknown=(-1.0,)),
    Rule(_BATTERY, ("cell_count",), "battery_cells", unknown=(0,)),
    Rule(_BATTERY, ("capacity",), "battery_capacity", "mAh", unknown=(0,)),
    Rule(_FUEL, ("remaining_fuel",), "fuel_remaining", "ml"),
    Rule(_FUEL, ("percent_remaining",), "fuel_percent", "%", unknown=tuple(range(101, 256))),
)
#: Fields that a log has element by element, and how many there are.
VECTORS = {"q": 4, "q_d": 4, "xyz": 3, "gyro_rad": 3, "accelerometer_m_s2": 3, "control": 12}
_EVERY_INSTANCE = (_BATTERY, _FUEL)
#: Topics that are read.
TOPICS = (
    *dict.fromkeys(rule.message for rule in RULES),
    "esc_status",
    "actuator_motors",
    "actuator_outputs",
)


def with_vectors(topic: Topic) -> Topic:
    """The topic with its vectors as columns (n, k) besides their elements."""
    vectors = {}
    for field, width in VECTORS.items():
        elements = [f"{field}[{i}]" for i in range(width)]
        if all(name in topic for name in elements):
            vectors[field] = np.stack([topic[name] for name in elements], axis=-1)
    return {**topic, **vectors}


def ulog_signals(topics: Mapping[str, list[Topic]]) -> Signals:
    """Signals of every topic by name (each a list of its instances) but for the motors'."""
    signals = [signal for rule in RULES for signal in _by_rule(rule, topics)]
    return collected(signals)


def _by_rule(rule: Rule, topics: Mapping[str, list[Topic]]) -> Iterator[Signal]:
    every = rule.message in _EVERY_INSTANCE
    for number, topic in enumerate(topics.get(rule.message, [])[: None if every else 1]):
        if all(name in topic for name in rule.fields):
            index = number if every else None
            source = replace(rule.source, kind=SourceKind.TOPIC).of_instance(index)
            yield topic_signal(rule.channel, source, topic, quantity(rule, topic), index)


def topic_source(
    topic: str, field: str, unit: str = "", meaning: Meaning = Meaning.AS_NAMED
) -> Provenance:
    """The source that is one field of a topic."""
    return Provenance(
        kind=SourceKind.TOPIC, name=topic, fields=(field,), unit=unit, meaning=meaning
    )


def topic_signal(
    channel: str, source: Provenance, topic: Topic, values: Floats, index: int | None = None
) -> Signal:
    """The Signal of `values` (n,) or (n, k) at the topic's own times."""
    time_s = in_si(topic, "timestamp", "1") * 1e-6
    return Signal(channel, source, *in_time_order(time_s, values), index)
