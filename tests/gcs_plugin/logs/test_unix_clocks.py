"""Messages whose `time_usec` is Unix time, beside those whose clock counts from boot."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import live_rows, log_frames
from tests.gcs_plugin.logs.tlog_files import UNIX, link, stamped, written
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.tlog import tlog_boots
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16-sitl")
SECONDS = 20


def flight(unix_from_s: float) -> bytes:
    """10 Hz; RAW_IMU and SERVO_OUTPUT_RAW count from boot, and Unix time from `unix_from_s` on."""
    made, out = link(), []
    for tick in range(SECONDS * 10):
        t = 10.0 + tick / 10
        boot = int(t * 1000)
        usec = UNIX + 77_000_000 + boot * 1000 if t >= unix_from_s else boot * 1000
        messages = [
            dialect.MAVLink_heartbeat_message(2, 3, 209, 0, 4, 3),
            dialect.MAVLink_raw_imu_message(usec, 0, 0, -1000 - tick, 0, 0, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_attitude_message(boot, 0.01, 0.02, 0.03, 0, 0, 0),
            dialect.MAVLink_servo_output_raw_message(usec % 2**32, 0, *([1500 + tick] * 16)),
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [5600] * 4, [1500] * 4, [1] * 4, [1900 + tick] * 4, [tick + 1] * 4
            ),
        ]
        out += [stamped(m.pack(made), t + 0.05) for m in messages]
    return b"".join(out)


@pytest.mark.parametrize("unix_from_s", [0.0, 17.05, 100.0])
def test_two_bases_are_one_flight_with_every_time_right(tmp_path, unix_from_s):
    path = written(tmp_path, flight(unix_from_s))
    found = next(tlog_boots(path))
    expected = 10.0 + np.arange(SECONDS * 10) / 10
    for name in ("RAW_IMU", "ATTITUDE", "SERVO_OUTPUT_RAW", "ESC_TELEMETRY_1_TO_4"):
        np.testing.assert_allclose(found.streams[name].time_s, expected, atol=0.002)
    assert not found.quality.clock_jumps
    track = read_log(path).track
    assert track.time_s[-1] == pytest.approx(19.9, abs=0.05)
    assert np.isfinite(track.specific_force_frd[:, 2]).mean() > 0.98


@pytest.mark.parametrize("unix_from_s", [0.0, 17.05])
def test_a_listener_has_the_same(tmp_path, unix_from_s):
    path = written(tmp_path, flight(unix_from_s))
    heard, _ = live_rows(log_frames(path), F16)
    assert heard is not None
    assert heard.boot == 0
    track = read_log(path, sampling="hold").track
    same = heard.track.time_s.size
    assert same > 190
    np.testing.assert_array_equal(heard.track.specific_force_frd, track.specific_force_frd[:same])
