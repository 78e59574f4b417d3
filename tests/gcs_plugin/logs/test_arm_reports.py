"""What logs report of lost frames and of the level of vibration, in the formats that have it."""

import numpy as np
import pytest
from pymavlink import mavutil

from tests.gcs_plugin.live.live_vehicle import ROOT
from tests.gcs_plugin.logs.log_files import DataFlashWriter
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import RULES as DATAFLASH_RULES
from thrustmargin.gcs_plugin.logs.ulog_topics import ulog_motors, ulog_signals, with_vectors
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind

BINARY = ROOT / "sitl_logs" / "formats" / "v4_m10_q2.5.BIN"
TIME_US = np.arange(0, 50) * 100_000


def test_a_dataflash_log_has_the_level_of_its_first_sensor_and_no_lost_frame():
    levels, counts = [], []
    reader = mavutil.mavlink_connection(str(BINARY))
    while (row := reader.recv_match(type="VIBE")) is not None:
        if row.IMU == 0:
            levels.append((row.VibeX**2 + row.VibeY**2 + row.VibeZ**2) ** 0.5)
            counts.append(row.Clip)
    track = read_log(BINARY).track
    assert np.nanmedian(track.vibration) == pytest.approx(np.median(levels), rel=0.1)
    assert np.nanmax(track.clipping) == max(counts)
    assert np.nanmax(track.esc_lost) == 0.0


def test_an_error_rate_of_dataflash_is_in_per_cent():
    class Columns:
        def number(self, name: str) -> np.ndarray:
            return {"Err": np.array([0.0, 12.5])}[name]

    (rule,) = (rule for rule in DATAFLASH_RULES if rule.channel == "esc_error_rate")
    assert rule.convert is not None
    assert rule.convert(Columns()).tolist() == [0.0, 0.125]  # type: ignore[arg-type]


def test_a_warning_of_extended_telemetry_is_the_vehicles_own_report_of_that_esc(tmp_path):
    """The third ESC: an alert, a warning, stress alone, the same warning again, an error."""
    made = DataFlashWriter()
    made.parameters(FRAME_CLASS=1, **{f"SERVO{k}_FUNCTION": 32 + k for k in (1, 2, 3, 4)})
    made.message("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw")
    made.message("ESC", "QBff", "TimeUS,Instance,RPM,RawRPM")
    made.message("EDT2", "QBBBB", "TimeUS,Instance,Stress,MaxStress,Status")
    for row in range(200):
        at = 1_000_000 + 100_000 * row
        made.row("ATT", at, 0, 0, 0)
        for esc in range(4):
            made.row("ESC", at + 1, esc, 2000.0 + row % 7, 2000.0 + row % 7)
    statuses = {3: 2 | 4, 5: 2 | 8, 7: 1, 8: 2 | 8, 10: 2, 12: 1 | 2 | 16}
    for second, status in statuses.items():
        made.row("EDT2", second * 1_000_000, 2, 10, 3, status)
    path = tmp_path / "edt2.BIN"
    path.write_bytes(made.binary())
    events = [e for e in read_log(path).events if e.kind is EventKind.ESC_FAILURE]
    assert [(e.subject, e.text) for e in events] == [
        ("3", "EDT2 status 0x8"),
        ("3", "EDT2 status 0x10"),
    ]


def test_px4_has_its_metric_the_sum_of_three_axes_and_a_counter_of_each_esc():
    count = np.arange(50)
    imu = {
        "timestamp": TIME_US,
        "accel_vibration_metric": np.full(50, 0.25),
        **{f"accel_clipping[{axis}]": count * axis for axis in range(3)},
    }
    signals = ulog_signals({"vehicle_imu_status": [with_vectors(imu)]})
    assert signals["vibration"][0].values.tolist() == [0.25] * 50
    assert signals["clipping"][0].values.tolist() == (3.0 * count).tolist()
    escs = {"timestamp": TIME_US}
    for place in range(4):
        escs[f"esc[{place}].esc_rpm"] = np.full(50, 2000)
        escs[f"esc[{place}].esc_rpm"][0] = 1990 + place  # none repeats another
        escs[f"esc[{place}].esc_errorcount"] = count * place
    motors = ulog_motors({"esc_status": [escs]}, {})
    errors = [s for s in motors.signals if s.channel == "esc_errors"]
    assert [(s.index, s.values[-1]) for s in errors] == [(0, 0), (1, 49), (2, 98), (3, 147)]
