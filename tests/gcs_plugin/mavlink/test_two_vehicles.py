"""Two vehicles of one id differ in something all along; one vehicle's noise does not leap back."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.tlog_files import link, stamped
from thrustmargin.gcs_plugin.mavlink.scan import scan
from thrustmargin.gcs_plugin.mavlink.who_sends import two_of_one_id

PADDING = 512  # bytes behind the data that a scan may look at
NOISE = np.random.default_rng(5)


def position(tick: int, off: float):
    place = (520_000_000 + 10 * tick + int(off), 50_000_000, 0, 0, 0, 0, 0, 0)
    return dialect.MAVLink_global_position_int_message(tick, *place)


def outputs(tick: int, off: float, port: int = 0):
    us = round(1500.0 + off)
    return dialect.MAVLink_servo_output_raw_message(tick, port, *[us] * 8)


def battery(_: int, off: float, number: int = 0):
    cells = [round(50_000.0 + off), *[0xFFFF] * 9]
    return dialect.MAVLink_battery_status_message(number, 0, 1, 2500, cells, 0, 0, 0, 80)


def heading(tick: int, off: float):
    # Through north, where it leaps from pi to -pi in one vehicle too.
    yaw = (0.002 * tick - 0.3 + np.radians(off)) % (2.0 * np.pi) - np.pi
    return dialect.MAVLink_attitude_message(tick, 0, 0, yaw, 0, 0, 0)


def seen(*messages) -> str:
    craft = link()
    data = b"".join(stamped(m.pack(craft), 10.0 + k / 20) for k, m in enumerate(messages))
    log = scan(np.frombuffer(data + bytes(PADDING), np.uint8).copy(), len(data))
    assert log.start.size == len(messages)
    return two_of_one_id(log, np.ones(log.start.size, dtype=np.bool_))


#: What is said, and by how much two differ: more than one does, in the unit of the message.
SIGNS = [
    (position, "two places", 185.0, 215.0),
    (outputs, "two sets of motor outputs", 20.0, 21.0),
    (battery, "two battery voltages", 200.0, 201.0),
    (heading, "two headings", 0.85, 1.15),  # it turns by 0.11 deg between two
]


@pytest.mark.parametrize(("make", "says", "little", "much"), SIGNS)
def test_what_two_vehicles_say_by_turns_leaps_to_and_fro(make, says, little, much):
    assert seen(*(make(tick, much * (tick % 2)) for tick in range(300))) == says
    assert seen(*(make(tick, little * (tick % 2)) for tick in range(300))) == ""
    # One that goes elsewhere once, or is restless at random, is one.
    assert seen(*(make(tick, 50.0 * much * (tick > 150)) for tick in range(300))) == ""
    assert seen(*(make(tick, 9.0 * much * NOISE.standard_normal()) for tick in range(300))) == ""


def test_two_batteries_and_two_boards_of_outputs_are_of_one_vehicle():
    assert seen(*(battery(tick, 900.0 * (tick % 2), tick % 2) for tick in range(300))) == ""
    assert seen(*(outputs(tick, 300.0 * (tick % 2), tick % 2) for tick in range(300))) == ""


def test_too_few_messages_say_nothing():
    assert seen(*(battery(tick, 900.0 * (tick % 2)) for tick in range(101))) == ""
    assert seen(*(battery(tick, 900.0 * (tick % 2)) for tick in range(102))) != ""
