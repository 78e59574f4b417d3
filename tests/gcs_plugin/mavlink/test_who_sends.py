"""Who is a vehicle; and frames that came again, among those that only look like it."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.tlog_files import stamped
from tests.gcs_plugin.mavlink.test_frame_verdicts import second
from thrustmargin.gcs_plugin.mavlink.scan import scan
from thrustmargin.gcs_plugin.mavlink.who_sends import FLIGHT_DATA, copies, of_vehicles

PADDING = 512  # bytes behind the data that a scan may look at


def found(*frames: tuple[int, int, float]) -> list[int]:
    """Rows that are copies, of frames (sequence number, first byte, s)."""
    data = b"".join(
        stamped(second(bytes([say]) + bytes(7) + b"\x03", sequence=n % 256), t)
        for n, say, t in frames
    )
    log = scan(np.frombuffer(data + bytes(PADDING), np.uint8).copy(), len(data))
    assert log.start.size == len(frames)
    return np.flatnonzero(copies(log)).tolist()


def counted(numbers, *, hz: float = 100.0) -> list[tuple[int, int, float]]:
    return [(n, n % 7, k / hz) for k, n in enumerate(numbers)]


@pytest.mark.parametrize("late", [1, 2, 40, 120])
def test_every_copy_is_found_however_late(late):
    frames = [*counted(range(600))]
    again = [(n, say, t + (late - 0.5) / 300) for n, say, t in frames]
    both = sorted([(*f, 0) for f in frames] + [(*f, 1) for f in again], key=lambda f: f[2])
    marked = found(*(f[:3] for f in both))
    assert marked == [row for row, f in enumerate(both) if f[3]]


def test_the_same_bytes_when_the_numbers_begin_anew_are_no_copy():
    still = [(n, 5, n / 1000) for n in range(600)]  # 256 frames are 0.256 s
    assert found(*still) == []
    # A hundred of them lost.
    assert found(*still[:100], *still[200:]) == []


def test_one_number_with_other_bytes_or_long_after_is_no_copy():
    assert found((1, 5, 0.0), (1, 6, 0.1), (1, 5, 0.3)) == []
    assert found((1, 5, 0.0), (1, 5, 0.49), (2, 5, 0.5)) == [1]
    assert found((1, 5, 0.0), (1, 5, 0.51), (2, 5, 0.6)) == []


def test_a_sender_that_does_not_count_sends_no_copies():
    assert found(*((0, max(k - 3, 0) % 5, k / 10) for k in range(60))) == []


#: Every type of MAV_TYPE that flies, drives or swims by itself.
VEHICLES = [
    "GENERIC",
    "FIXED_WING",
    "QUADROTOR",
    "COAXIAL",
    "HELICOPTER",
    "AIRSHIP",
    "FREE_BALLOON",
    "ROCKET",
    "GROUND_ROVER",
    "SURFACE_BOAT",
    "SUBMARINE",
    "HEXAROTOR",
    "OCTOROTOR",
    "TRICOPTER",
    "FLAPPING_WING",
    "KITE",
    "VTOL_DUOROTOR",
    "VTOL_QUADROTOR",
    "VTOL_TILTROTOR",
    "VTOL_RESERVED2",
    "VTOL_RESERVED3",
    "VTOL_RESERVED4",
    "VTOL_RESERVED5",
    "PARAFOIL",
    "DODECAROTOR",
    "DECAROTOR",
    "GENERIC_MULTIROTOR",
    "SPACECRAFT_ORBITER",
    "GROUND_QUADRUPED",
    "VTOL_GYRODYNE",
]


@pytest.mark.parametrize("number", range(49))
def test_the_type_says_whether_it_is_one(number):
    name = dialect.enums["MAV_TYPE"][number].name.removeprefix("MAV_TYPE_")
    beat = {"type": np.array([number] * 2), "autopilot": np.array([3, 8])}
    assert of_vehicles(beat).tolist() == [name in VEHICLES, False]


def test_flight_data_are_no_reports_of_a_radio_or_a_battery():
    assert {30, 31, 32, 33, 36, 291, 11030} <= set(FLIGHT_DATA)
    assert not {0, 109, 147, 166, 251, 369} & set(FLIGHT_DATA)
