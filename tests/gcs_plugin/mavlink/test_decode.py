"""Units, unknown values and conventions of the MAVLink table, and the layouts under it."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from thrustmargin.gcs_plugin.mavlink.decode import (
    MAVLINK_RULES,
    attitude_from_quaternion,
)
from thrustmargin.gcs_plugin.mavlink.frame import checksum_rows
from thrustmargin.gcs_plugin.mavlink.layouts import layout_table, layouts
from thrustmargin.gcs_plugin.mavlink.rules import decode, quantity

OF_MESSAGE = {layout.name: layout for layout in layouts().values()}


def rows(message: str, size: int = 1, **fields) -> np.ndarray:
    table = np.zeros(size, dtype=OF_MESSAGE[message].dtype)
    for name, value in fields.items():
        table[name] = value
    return table


def rule_for(message: str, channel: str):
    return next(r for r in MAVLINK_RULES if (r.message, r.channel) == (message, channel))


def channel(message: str, name: str, **fields) -> np.ndarray:
    table = rows(message, **fields)
    return next(values for _, _, values in decode(rule_for(message, name), table))


def test_every_rule_names_fields_that_its_message_has():
    for rule in MAVLINK_RULES:
        names = OF_MESSAGE[rule.message].dtype.names
        assert names is not None
        assert set(rule.fields) <= set(names), rule
        assert rule.index is None or rule.index in names


def test_units_of_the_table_are_those_of_the_mavlink_definition():
    checked = 0
    for rule in MAVLINK_RULES:
        message = dialect.mavlink_map.get(OF_MESSAGE[rule.message].id)
        if message is None or rule.convert is not None:
            continue
        units = [rule.unit] * len(rule.fields) if isinstance(rule.unit, str) else rule.unit
        for name, unit in zip(rule.fields, units, strict=True):
            stated = message.fieldunits_by_name.get(name)
            if stated is not None:
                assert unit == stated, (rule.message, name)
                checked += 1
    assert checked > 30


def test_a_row_decodes_the_same_alone_as_in_a_batch():
    rng = np.random.default_rng(1)
    for message in {rule.message for rule in MAVLINK_RULES}:
        layout = OF_MESSAGE[message].dtype
        raw = rng.integers(0, 256, (20, layout.itemsize), dtype=np.uint8)
        table = raw.view(layout).reshape(20)
        for rule in (r for r in MAVLINK_RULES if r.message == message):
            with np.errstate(all="ignore"):
                together = quantity(rule, table)
                alone = np.concatenate([quantity(rule, table[i : i + 1]) for i in range(20)])
            np.testing.assert_array_equal(together, alone, err_msg=str(rule))


def test_wind_from_the_north_blows_to_the_south():
    from_north = channel("WIND", "wind_ned", direction=0.0, speed=5.0)
    np.testing.assert_allclose(from_north, [[-5.0, 0.0, 0.0]], atol=1e-9)
    from_east = channel("WIND", "wind_ned", direction=90.0, speed=5.0)
    np.testing.assert_allclose(from_east, [[0.0, -5.0, 0.0]], atol=1e-9)


@pytest.mark.filterwarnings("error")
def test_what_is_infinite_is_unknown():
    wind = channel("WIND", "wind_ned", size=2, direction=[np.inf, 0.0], speed=[1.0, 2.0])
    np.testing.assert_array_equal(np.isfinite(wind), [[False, False, True], [True, True, True]])
    level = channel("NAMED_VALUE_FLOAT", "named_value", size=3, value=[-np.inf, 7.0, np.inf])
    np.testing.assert_array_equal(level, [np.nan, 7.0, np.nan])


def test_a_pack_above_65_volts_is_summed_over_its_cells():
    cells = np.full(10, 65535)
    cells[:2] = (65534, 4466)
    assert channel("BATTERY_STATUS", "battery_voltage", voltages=cells)[0] == pytest.approx(70.0)
    more = np.array([4000, 0, 0, 0])
    volts = channel("BATTERY_STATUS", "battery_voltage", voltages=cells, voltages_ext=more)
    assert volts[0] == pytest.approx(74.0)
    unused = np.array([4000, 65535, 65534, 0])  # 65535 is no cell, 65534 mV is one
    volts = channel("BATTERY_STATUS", "battery_voltage", voltages=cells, voltages_ext=unused)
    assert volts[0] == pytest.approx(74.0 + 65.534)


def test_batteries_of_one_message_are_distinguished_by_id():
    table = rows("BATTERY_STATUS", 4)
    table["id"] = [0, 1, 0, 1]
    table["battery_remaining"] = [90, 60, 89, 59]
    found = {
        index: values.tolist()
        for index, _, values in decode(rule_for("BATTERY_STATUS", "battery_percent"), table)
    }
    assert found == {0: [90.0, 89.0], 1: [60.0, 59.0]}


def test_quaternion_gives_the_angles_that_made_it():
    roll, pitch, yaw = 0.3, -0.4, 2.5
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    angles = attitude_from_quaternion(*(np.array([v]) for v in (w, x, y, z)))
    np.testing.assert_allclose(angles, [[roll, pitch, yaw]], atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_nose_straight_up_or_down_has_a_pitch_whatever_the_rounding(side):
    half = np.full(1, np.sqrt(0.5) * (1.0 + 1e-6))  # a little over the unit
    (angles,) = attitude_from_quaternion(half, 0.0 * half, side * half, 0.0 * half)
    assert angles[1] == side * np.pi / 2


def test_layouts_have_the_size_that_pymavlink_packs():
    longer = {42: 12}  # MISSION_CURRENT ends with three ids of 4 bytes since 2023
    for number, message in dialect.mavlink_map.items():
        size = layouts()[number].dtype.itemsize
        assert size == message.unpacker.size + longer.get(number, 0)
        assert layouts()[number].crc_extra == message.crc_extra


@pytest.mark.parametrize(
    ("name", "number", "size", "crc_extra", "offsets"),
    [
        ("ESC_INFO", 290, 46, 251, {"time_usec": 0}),
        ("ESC_STATUS", 291, 57, 10, {"rpm": 8, "voltage": 24, "current": 40, "index": 56}),
        (
            "BATTERY_STATUS_V2",
            369,
            24,
            151,
            {"capacity_consumed": 8, "temperature": 20, "id": 22, "percent_remaining": 23},
        ),
        ("BATTERY_INFO", 372, 140, 26, {"full_charge_capacity": 36, "id": 44, "name": 90}),
        (
            "FUEL_STATUS",
            371,
            26,
            10,
            {"remaining_fuel": 8, "flow_rate": 12, "fuel_type": 20, "id": 24},
        ),
    ],
)
def test_messages_that_pymavlink_lacks_have_their_published_layout(
    name, number, size, crc_extra, offsets
):
    layout = layouts()[number]
    assert (layout.name, layout.dtype.itemsize, layout.crc_extra) == (name, size, crc_extra)
    assert layout.dtype.fields is not None
    for field, offset in offsets.items():
        assert layout.dtype.fields[field][1] == offset
    assert layout_table().size[number] == size


@pytest.mark.parametrize("length", [1, 2, 5, 14, 37, 64, 255])
def test_checksum_agrees_with_pymavlinks(length):
    rng = np.random.default_rng(length)
    table = rng.integers(0, 256, (50, length), dtype=np.uint8)
    extra = rng.integers(0, 256, 50, dtype=np.uint8)
    expected = []
    for row, last in zip(table, extra, strict=True):
        crc = dialect.x25crc(row.tobytes())
        crc.accumulate(bytes([last]))
        expected.append(crc.crc)
    assert checksum_rows(table, extra).tolist() == expected
