"""Every unit and every line of the MAVLink table, against values worked out by hand."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.decode import ESC_TELEMETRY_FIRST, MAVLINK_RULES, esc_silent
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.rules import Rule, decode, in_si, quantity
from thrustmargin.gcs_plugin.wording.check_words import source_words

DTYPES = {layout.name: layout.dtype for layout in layouts().values()}
NAN = math.nan

#: What 12345 on the wire is in SI.
IN_SI = {
    "1": 12345.0,
    "%": 12345.0,
    "degE7": 0.0012345,
    "latlon deg": 12345.0,
    "rad": 12345.0,
    "rad/s": 12345.0,
    "mrad/s": 12.345,
    "deg": 215.460896,
    "deg/s": 215.460896,
    "m": 12345.0,
    "cm": 123.45,
    "mm": 12.345,
    "m/s": 12345.0,
    "cm/s": 123.45,
    "m/s/s": 12345.0,
    "mG": 121.0630943,
    "V": 12345.0,
    "mV": 12.345,
    "cV": 123.45,
    "A": 12345.0,
    "cA": 123.45,
    "mAh": 12345.0,
    "Pa": 12345.0,
    "hPa": 1234500.0,
    "K": 12345.0,
    "degC": 12618.15,
    "cdegC": 396.6,
    "rpm": 12345.0,
    "us": 12345.0,
    "ms": 12.345,
    "ml": 12345.0,
    "share": 1_234_500.0,
    "Ah": 12_345_000.0,
}


def test_every_unit_becomes_si_by_its_factor():
    units = (r.unit if isinstance(r.unit, tuple) else (r.unit,) for r in MAVLINK_RULES)
    assert set().union(*units) <= set(IN_SI)
    raw = {"x": np.array([12345], dtype=np.int32)}
    for unit, expected in IN_SI.items():
        found = quantity(Rule("M", ("x",), "c", unit), raw)
        assert found.dtype == np.float64
        assert found.tolist() == pytest.approx([expected], rel=1e-8), unit


#: (message, channel) -> fields on the wire, the channel in SI.
VALUES: dict[tuple[str, str], tuple[Mapping[str, object], Any]] = {
    ("ATTITUDE", "attitude"): ({"roll": 0.1, "pitch": -0.2, "yaw": 3.0}, [0.1, -0.2, 3.0]),
    # A quarter turn to the right: q = (cos 45°, 0, 0, sin 45°).
    ("ATTITUDE_QUATERNION", "attitude"): ({"q1": 0.5**0.5, "q4": 0.5**0.5}, [0, 0, math.pi / 2]),
    ("ATTITUDE_TARGET", "asked_attitude"): (
        {"q": [math.cos(0.1), math.sin(0.1), 0.0, 0.0], "type_mask": 7},
        [0.2, 0.0],
    ),
    ("NAV_CONTROLLER_OUTPUT", "asked_attitude"): (
        {"nav_roll": 90.0, "nav_pitch": -45.0},
        [math.pi / 2, -math.pi / 4],
    ),
    ("ATTITUDE", "angular_rate_frd"): (
        {"rollspeed": 0.1, "pitchspeed": 0.2, "yawspeed": -0.3},
        [0.1, 0.2, -0.3],
    ),
    ("ATTITUDE_QUATERNION", "angular_rate_frd"): (
        {"rollspeed": 0.1, "pitchspeed": 0.2, "yawspeed": -0.3},
        [0.1, 0.2, -0.3],
    ),
    ("HIGHRES_IMU", "specific_force_frd"): ({"xacc": 1, "yacc": 2, "zacc": -9.5}, [1, 2, -9.5]),
    ("RAW_IMU", "specific_force_frd"): (
        {"xacc": 100, "yacc": 200, "zacc": -1000},
        [0.980665, 1.96133, -9.80665],
    ),
    ("SCALED_IMU", "specific_force_frd"): (
        {"xacc": 100, "yacc": 200, "zacc": -1000},
        [0.980665, 1.96133, -9.80665],
    ),
    ("GLOBAL_POSITION_INT", "geodetic"): (
        {"lat": 366500000, "lon": -1169000000, "alt": 8066},
        [36.65, -116.9, 8.066],
    ),
    ("HOME_POSITION", "home"): (
        {"latitude": 366500000, "longitude": -1169000000, "altitude": 5000},
        [36.65, -116.9, 5.0],
    ),
    ("GPS_GLOBAL_ORIGIN", "ekf_origin"): (
        {"latitude": 366500000, "longitude": -1169000000, "altitude": 5000},
        [36.65, -116.9, 5.0],
    ),
    ("LOCAL_POSITION_NED", "position_ned"): ({"x": 1.5, "y": 2.5, "z": -3.0}, [1.5, 2.5, -3.0]),
    ("LOCAL_POSITION_NED", "velocity_ned"): ({"vx": 1.5, "vy": 2.5, "vz": -3.0}, [1.5, 2.5, -3]),
    ("GLOBAL_POSITION_INT", "velocity_ned"): ({"vx": 150, "vy": -25, "vz": 5}, [1.5, -0.25, 0.05]),
    ("GLOBAL_POSITION_INT", "altitude"): ({"alt": 8066}, 8.066),
    ("VFR_HUD", "altitude"): ({"alt": 8.5}, 8.5),
    ("DISTANCE_SENSOR", "height_agl"): (
        {"current_distance": 310, "min_distance": 20, "max_distance": 5000, "orientation": 25},
        3.1,
    ),
    ("RANGEFINDER", "height_agl"): ({"distance": 3.25}, 3.25),
    ("GLOBAL_POSITION_INT", "height_agl"): ({"relative_alt": 3010}, 3.01),
    ("VFR_HUD", "airspeed"): ({"airspeed": 4.5}, 4.5),
    ("WIND_COV", "wind_ned"): ({"wind_x": 3.0, "wind_y": -4.0, "wind_z": 0.5}, [3.0, -4.0, 0.5]),
    # 5 m/s in all, 3 m/s of it down: 4 m/s level, from the east.
    ("WIND", "wind_ned"): ({"direction": 90.0, "speed": 5.0, "speed_z": 3.0}, [0, -4.0, 3.0]),
    ("BATTERY_STATUS", "battery_voltage"): ({"voltages": [3700] * 10}, 37.0),
    ("BATTERY_STATUS", "battery_current"): ({"current_battery": 5650}, 56.5),
    ("BATTERY_STATUS", "battery_percent"): ({"battery_remaining": 87}, 87.0),
    ("BATTERY_STATUS", "battery_consumed"): ({"current_consumed": 1234}, 1234.0),
    ("BATTERY_STATUS_V2", "battery_voltage"): ({"voltage": 55.5}, 55.5),
    ("BATTERY_STATUS_V2", "battery_current"): ({"current": -56.5}, -56.5),
    ("BATTERY_STATUS_V2", "battery_percent"): ({"percent_remaining": 87}, 87.0),
    ("BATTERY_STATUS_V2", "battery_consumed"): ({"capacity_consumed": 1.25}, 1250.0),
    ("BATTERY_INFO", "battery_cells"): ({"cells_in_series": 14, "type": 1}, 14.0),
    ("SMART_BATTERY_INFO", "battery_cells"): ({"cells_in_series": 12, "type": 3}, 12.0),
    ("BATTERY_INFO", "battery_nominal"): ({"nominal_voltage": 51.8}, 51.8),
    ("BATTERY_INFO", "battery_capacity"): ({"design_capacity": 16.0}, 16_000.0),
    ("SMART_BATTERY_INFO", "battery_capacity"): ({"capacity_full_specification": 9000}, 9000.0),
    ("SYS_STATUS", "voltage"): ({"voltage_battery": 58800}, 58.8),
    ("SYS_STATUS", "current"): ({"current_battery": 5650}, 56.5),
    ("SCALED_PRESSURE", "pressure"): ({"press_abs": 1013.25}, 101325.0),
    ("HIGHRES_IMU", "pressure"): ({"abs_pressure": 1013.25}, 101325.0),
    ("SCALED_PRESSURE", "temperature"): ({"temperature": 1500}, 288.15),
    ("HIGHRES_IMU", "temperature"): ({"temperature": 15.0}, 288.15),
    ("EXTENDED_SYS_STATE", "landed"): ({"landed_state": 2}, 2.0),
    ("HEARTBEAT", "armed"): ({"base_mode": 128 + 64 + 1, "autopilot": 3}, 1.0),
    ("MISSION_CURRENT", "mission_item"): ({"seq": 7}, 7.0),
    ("SERVO_OUTPUT_RAW", "servo_us"): (
        {f"servo{n}_raw": 1000 + n for n in range(1, 17)},
        [1000 + n for n in range(1, 17)],
    ),
    ("ACTUATOR_OUTPUT_STATUS", "servo_us"): (
        {"actuator": [1000.5 + n for n in range(32)]},
        [1000.5 + n for n in range(32)],
    ),
    ("ESC_STATUS", "esc_rpm"): ({"rpm": [1, -2, 3, 4]}, [1, -2, 3, 4]),
    ("ESC_STATUS", "esc_voltage"): ({"voltage": [50.5] * 4}, [50.5] * 4),
    ("ESC_STATUS", "esc_current"): ({"current": [9.5] * 4}, [9.5] * 4),
    ("ESC_INFO", "esc_failure"): ({"failure_flags": [0, 1, 2, 4]}, [0, 1, 2, 4]),
    ("ESC_INFO", "esc_temperature"): (
        {"temperature": [2500, 0, 32767, -500]},
        [298.15, NAN, NAN, 268.15],
    ),
    ("ESC_INFO", "esc_errors"): ({"error_count": [0, 7, 1, 70_000]}, [0, 7, 1, 70_000]),
    ("VIBRATION", "vibration"): (
        {"vibration_x": 2.0, "vibration_y": 3.0, "vibration_z": 6.0},
        7.0,
    ),
    ("VIBRATION", "clipping"): ({"clipping_0": 12}, 12.0),
    ("NAMED_VALUE_FLOAT", "named_value"): ({"value": 9.25}, 9.25),
    ("FUEL_STATUS", "fuel_remaining"): ({"remaining_fuel": 9500.0, "fuel_type": 1}, 9500.0),
    ("FUEL_STATUS", "fuel_percent"): ({"percent_remaining": 60}, 60.0),
}
for _name in ESC_TELEMETRY_FIRST:
    _four = {"rpm": [1900, 0, 2000, 0], "count": [1, 0, 2, 3]}
    VALUES[_name, "esc_rpm"] = (_four, [1900, NAN, 2000, 0])
    VALUES[_name, "esc_voltage"] = ({**_four, "voltage": [5880] * 4}, [58.8, NAN, 58.8, 58.8])
    VALUES[_name, "esc_current"] = ({**_four, "current": [1550] * 4}, [15.5, NAN, 15.5, 15.5])
    _warm = {**_four, "temperature": [40, 40, 0, 25]}
    VALUES[_name, "esc_temperature"] = (_warm, [313.15, NAN, NAN, 298.15])

#: The rules whose messages carry a number of the sensor, battery or first ESC.
INDEXED = {
    ("HIGHRES_IMU", "specific_force_frd"): ("id", 0),
    ("RAW_IMU", "specific_force_frd"): ("id", 0),
    ("BATTERY_STATUS", "battery_voltage"): ("id", None),
    ("BATTERY_STATUS", "battery_current"): ("id", None),
    ("BATTERY_STATUS", "battery_percent"): ("id", None),
    ("BATTERY_STATUS", "battery_consumed"): ("id", None),
    ("BATTERY_STATUS_V2", "battery_voltage"): ("id", None),
    ("BATTERY_STATUS_V2", "battery_current"): ("id", None),
    ("BATTERY_STATUS_V2", "battery_percent"): ("id", None),
    ("BATTERY_STATUS_V2", "battery_consumed"): ("id", None),
    ("BATTERY_INFO", "battery_cells"): ("id", None),
    ("SMART_BATTERY_INFO", "battery_cells"): ("id", None),
    ("BATTERY_INFO", "battery_nominal"): ("id", None),
    ("BATTERY_INFO", "battery_capacity"): ("id", None),
    ("SMART_BATTERY_INFO", "battery_capacity"): ("id", None),
    ("SERVO_OUTPUT_RAW", "servo_us"): ("port", None),
    ("ESC_STATUS", "esc_rpm"): ("index", None),
    ("ESC_STATUS", "esc_voltage"): ("index", None),
    ("ESC_STATUS", "esc_current"): ("index", None),
    ("ESC_INFO", "esc_failure"): ("index", None),
    ("ESC_INFO", "esc_temperature"): ("index", None),
    ("ESC_INFO", "esc_errors"): ("index", None),
    ("FUEL_STATUS", "fuel_remaining"): ("id", None),
    ("FUEL_STATUS", "fuel_percent"): ("id", None),
}

#: Wire values that mean "not known".
UNKNOWN = {
    ("RANGEFINDER", "height_agl"): (0.0,),
    ("BATTERY_STATUS", "battery_current"): (-1,),
    ("BATTERY_STATUS", "battery_percent"): (-1,),
    ("BATTERY_STATUS", "battery_consumed"): (-1,),
    ("BATTERY_STATUS_V2", "battery_percent"): (255,),
    ("BATTERY_INFO", "battery_nominal"): (0,),
    ("BATTERY_INFO", "battery_capacity"): (0,),
    ("SMART_BATTERY_INFO", "battery_capacity"): (-1,),
    ("SYS_STATUS", "voltage"): (65535, 0),
    ("SYS_STATUS", "current"): (-1,),
    ("SCALED_PRESSURE", "temperature"): (0,),
    ("HIGHRES_IMU", "temperature"): (0,),
    ("EXTENDED_SYS_STATE", "landed"): (0,),
    ("SERVO_OUTPUT_RAW", "servo_us"): (65535,),
    ("FUEL_STATUS", "fuel_percent"): (255,),
}


def table(message: str, fields: Mapping[str, Any]) -> np.ndarray:
    rows = np.zeros(1, dtype=DTYPES[message])
    for name, value in fields.items():
        rows[name] = value
    return rows


@pytest.mark.parametrize("rule", MAVLINK_RULES, ids=lambda r: f"{r.message} {r.channel}")
def test_every_line_of_the_table_gives_its_channel_in_si(rule):
    fields, expected = VALUES[rule.message, rule.channel]
    found = quantity(rule, table(rule.message, fields))[0]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_the_table_has_each_line_once_and_the_right_numbers_and_codes():
    assert [(r.message, r.channel) for r in MAVLINK_RULES if r.index is not None] == list(INDEXED)
    assert len({(r.message, r.channel) for r in MAVLINK_RULES}) == len(MAVLINK_RULES) == len(VALUES)
    for rule in MAVLINK_RULES:
        key = (rule.message, rule.channel)
        assert (rule.index, rule.only) == INDEXED.get(key, (None, None))
        assert rule.unknown == UNKNOWN.get(key, ())


@pytest.mark.parametrize(("key", "codes"), UNKNOWN.items(), ids=str)
def test_codes_for_unknown_are_nan_and_their_neighbours_are_not(key, codes):
    rule = next(r for r in MAVLINK_RULES if (r.message, r.channel) == key)
    for code in codes:
        rows = table(rule.message, dict.fromkeys(rule.fields, code))
        assert np.isnan(quantity(rule, rows)).all()
        near = dict.fromkeys(rule.fields, 1 if code in (0, -1) else code - 1)
        assert np.isfinite(quantity(rule, table(rule.message, near))).all()


def test_preferred_sources_come_first():
    order = {}
    for rule in MAVLINK_RULES:
        order.setdefault(rule.channel, []).append(rule.message)
    assert order["attitude"] == ["ATTITUDE", "ATTITUDE_QUATERNION"]
    assert order["specific_force_frd"] == ["HIGHRES_IMU", "RAW_IMU", "SCALED_IMU"]
    assert order["velocity_ned"] == ["LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"]
    assert order["height_agl"] == ["DISTANCE_SENSOR", "RANGEFINDER", "GLOBAL_POSITION_INT"]
    assert order["wind_ned"] == ["WIND_COV", "WIND"]
    assert order["pressure"] == ["SCALED_PRESSURE", "HIGHRES_IMU"]


def test_a_source_in_words_names_message_fields_and_note():
    assert source_words(Rule("M", ("a", "b"), "c").source) == "M a, b"
    assert source_words(Rule("M", ("a",), "c", note="in mG").source) == (
        "M a (in mG, as ArduPilot sends them)"
    )


def test_rows_are_given_by_number_and_only_the_wanted_one_where_one_is_wanted():
    columns = {"n": np.array([2, 0, 2]), "x": np.array([10.0, 20.0, 30.0])}
    every = Rule("M", ("x",), "c", "cm", index="n")
    first = Rule("M", ("x",), "d", "cm", index="n", only=0)
    found = [
        (rule.channel, number, columns["n"][rows].tolist(), values.tolist())
        for rule in (every, first)
        for number, rows, values in decode(rule, columns)
    ]
    assert found == [("c", 0, [0], [0.2]), ("c", 2, [2, 2], [0.1, 0.3]), ("d", 0, [0], [0.2])]
    ((number, rows, values),) = decode(Rule("N", ("x",), "e"), columns)
    assert (number, rows) == (None, slice(None))
    assert values.tolist() == [10.0, 20.0, 30.0]


def test_several_fields_may_have_several_units_and_the_raw_columns_stay():
    columns = {"a": np.array([100.0]), "b": np.array([200.0])}
    rule = Rule("M", ("a", "b"), "c", ("cm", "degC"))
    assert quantity(rule, columns).tolist() == [[1.0, 473.15]]
    assert columns["a"].tolist() == [100.0]


def test_quaternion_angles_are_those_of_turns_about_one_axis():
    rule = next(r for r in MAVLINK_RULES if r.message == "ATTITUDE_QUATERNION")
    half = math.sin(0.2), math.cos(0.2)
    for axis, field in enumerate(("q2", "q3", "q4")):
        angles = quantity(rule, table(rule.message, {"q1": half[1], field: half[0]}))[0]
        np.testing.assert_allclose(angles, np.eye(3)[axis] * 0.4, atol=1e-6)


def test_a_battery_with_no_cell_has_no_voltage_and_unused_cells_do_not_count():
    rule = next(r for r in MAVLINK_RULES if r.channel == "battery_voltage")

    def volts(cells, more):
        return quantity(rule, table("BATTERY_STATUS", {"voltages": cells, "voltages_ext": more}))[0]

    assert math.isnan(volts([65535] * 10, [0] * 4))
    assert volts([65534, 1000] + [65535] * 8, [65535] * 4) == pytest.approx(66.534)
    assert volts([4000] * 10, [65534, 65535, 1, 0]) == pytest.approx(105.535)


def test_a_rangefinder_at_its_limits_gives_no_height():
    rule = next(r for r in MAVLINK_RULES if r.message == "DISTANCE_SENSOR")

    def height(reading, orientation=25):
        fields = {"current_distance": reading, "min_distance": 20, "max_distance": 500}
        return quantity(rule, table(rule.message, {**fields, "orientation": orientation}))[0]

    assert [height(21), height(499)] == pytest.approx([0.21, 4.99])
    assert np.isnan([height(20), height(500), height(19), height(501)]).all()
    assert np.isnan([height(100, 24), height(100, 26), height(100, 0)]).all()


def test_wind_with_more_fall_than_speed_has_no_level_part():
    rule = next(r for r in MAVLINK_RULES if r.message == "WIND")
    wind = quantity(rule, table("WIND", {"direction": 0.0, "speed": 1.0, "speed_z": -2.0}))
    np.testing.assert_allclose(wind, [[0.0, 0.0, -2.0]], atol=1e-12)


def test_fuel_of_another_kind_than_a_liquid_is_not_ml():
    rule = next(r for r in MAVLINK_RULES if r.channel == "fuel_remaining")
    for kind in (0, 2):
        said = {"remaining_fuel": 5.0, "fuel_type": kind}
        assert np.isnan(quantity(rule, table("FUEL_STATUS", said)))


def test_an_esc_is_silent_when_it_reports_zero_and_counts_nothing_new():
    name = "ESC_TELEMETRY_1_TO_4"
    rows = np.zeros(3, dtype=DTYPES[name])
    rows["rpm"] = [[0, 0, 5, 0], [0, 0, 5, 5], [0, 5, 5, 0]]
    rows["count"] = [[1, 1, 1, 1], [1, 2, 1, 1], [1, 2, 1, 1]]
    assert esc_silent(rows).tolist() == [
        [False, False, False, False],
        [True, False, False, False],
        [True, False, False, True],
    ]


def test_esc_messages_begin_at_every_fourth_output():
    assert list(ESC_TELEMETRY_FIRST.values()) == [0, 4, 8, 12, 16, 20, 24, 28]
    assert list(ESC_TELEMETRY_FIRST)[2] == "ESC_TELEMETRY_9_TO_12"


def test_a_signalling_nan_of_a_damaged_file_is_no_warning():
    raw = np.array([0x7F800001, 0x3F800000] * 40, dtype=np.uint32).view(np.float32)
    assert np.isnan(in_si({"x": raw}, "x", "m")[0])
    assert in_si({"x": raw}, "x", "m")[1] == 1.0
