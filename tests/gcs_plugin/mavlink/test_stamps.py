"""Stamps of a computer whose clock is set, by hand; and a recording with them as it is played."""

import struct
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames, steadied

S = 1_000_000
NAN = float("nan")


def steady(stamps_s: list[float], boot_s: list[float], system: list[int] | None = None):
    stamps = np.round(np.array(stamps_s) * S).astype(np.int64)
    systems = np.ones(stamps.size) if system is None else np.array(system)
    found = steadied(stamps, np.array(boot_s) * 1000.0, systems.astype(np.uint8))
    return (found / S).tolist()


@pytest.mark.parametrize(
    ("stamps", "boot", "right"),
    [
        # An hour ahead and back again; the vehicle's clock runs on.
        ([0, 1, 3602, 3603, 4], [50, 51, 52, 53, 54], [0, 1, 2, 3, 4]),
        ([0, 1, -3598, -3597, 4], [50, 51, 52, 53, 54], [0, 1, 2, 3, 4]),
        # Half a minute without a message is a silence.
        ([0, 1, 31, 32], [50, 51, 81, 82], [0, 1, 31, 32]),
        # The messages at the leap have no clock of their own.
        ([0, 1, 3602, 3603], [50, NAN, NAN, 53], [0, 1, 2, 3]),
        # A restart: nothing says how long it took.
        ([0, 1, 31, 32], [50, 51, 5, 6], [0, 1, 31, 32]),
        # No clock at all: a step back takes no time, a step ahead may be a silence.
        ([0, 5, -60, 90], [NAN] * 4, [0, 5, 5, 155]),
        # Copies of a second link, a quarter of a second late, are left as they are.
        ([0, 1, 0.75, 1.75], [50, 51, 51, 52], [0, 1, 0.75, 1.75]),
        ([7], [50], [7]),
    ],
)
def test_a_clock_that_is_set_makes_no_leap(stamps, boot, right):
    assert steady(stamps, boot) == pytest.approx(right)


def test_the_clock_is_that_of_one_vehicle():
    found = steady([0, 1, 3602, 3603], [50, 51, 900, 53], [1, 1, 2, 1])
    assert found == pytest.approx([0, 1, 2, 3])


@pytest.mark.parametrize("leap_s", [-3600, 3600])
def test_a_recording_with_a_leap_and_back_is_played_as_it_was_heard(tmp_path: Path, leap_s: int):
    vehicle = Vehicle()
    frames = [frame for _ in range(100) for frame in vehicle.tick()]
    written = b""
    for frame in frames:
        away = 3 * S < frame.stamp_us - frames[0].stamp_us < 6 * S
        written += struct.pack(">Q", frame.stamp_us + away * leap_s * S) + frame.data
    (tmp_path / "leap.tlog").write_bytes(written)
    found = [stamp_us for stamp_us, _ in stamped_frames(tmp_path / "leap.tlog")]
    off = np.array(found) - np.array([frame.stamp_us for frame in frames])
    assert np.abs(off).max() < 0.2 * S
