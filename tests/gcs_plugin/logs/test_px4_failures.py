"""What PX4 and ESCs report of failures, from logs written by the formats' definitions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.gcs_plugin.live.live_vehicle import log_frames, write_log
from tests.gcs_plugin.live.test_live_is_the_file import with_esc_reports
from tests.gcs_plugin.logs.log_files import UlogWriter
from tests.gcs_plugin.logs.tlog_files import FLIGHT
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.px4_failures import px4_failure_events
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind

MOTORS = (101, 102, 103, 104)


def px4_log(*, mask: int, imbalanced: bool, failures: tuple[int, ...] = (0, 0, 0, 0)) -> bytes:
    """Six seconds from 100 s on; from 103 s on the detector and ESCs report what is given.

    ESC place k drives motor 4 - k.
    """
    log = UlogWriter()
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    log.topic("actuator_motors", [("float[12]", "control")], "12f")
    log.topic("esc_status", [("uint8_t", "esc_count"), ("esc_report[8]", "esc")], "B" + "iBH" * 8)
    log.part("esc_report:int32_t esc_rpm;uint8_t actuator_function;uint16_t failures;")
    flags = ("fd_roll", "fd_motor", "fd_imbalanced_prop")
    fields = [*(("uint8_t", name) for name in flags), ("float", "imbalanced_prop_metric")]
    log.topic("failure_detector_status", [*fields, ("uint16_t", "motor_failure_mask")], "BBBfH")
    for tick in range(60):
        t, late = 100.0 + tick / 10, tick >= 30
        log.row("vehicle_attitude", t, 1.0, 0.0, 0.0, 0.0)
        log.row("actuator_motors", t, *[0.5] * 4, *[float("nan")] * 8)
        escs: list[int] = []
        for function, failed in zip(MOTORS[::-1], failures, strict=True):
            escs += [3000 + tick, function, failed * late]
        log.row("esc_status", t, 4, *escs, *[0] * 12)
        now = mask * late
        log.row("failure_detector_status", t, 0, now != 0, imbalanced and late, 0.31 * late, now)
    return log.bytes()


def events_of(folder: Path, data: bytes) -> list[tuple[EventKind, str, float, str]]:
    path = folder / "made.ulg"
    path.write_bytes(data)
    log = read_log(path)
    return [(event.kind, event.subject, round(event.time_s, 1), event.text) for event in log.events]


def test_a_mask_of_motors_names_each_once(tmp_path: Path):
    assert events_of(tmp_path, px4_log(mask=0b1010, imbalanced=False)) == [
        (EventKind.MOTOR_FAILURE, "2", 3.0, "failure_detector_status motor_failure_mask 0x1"),
        (EventKind.MOTOR_FAILURE, "4", 3.0, "failure_detector_status motor_failure_mask 0x1"),
    ]


def test_an_imbalanced_propeller_has_its_metric(tmp_path: Path):
    words = "failure_detector_status fd_imbalanced_prop, imbalanced_prop_metric 0.31"
    assert events_of(tmp_path, px4_log(mask=0, imbalanced=True)) == [
        (EventKind.IMBALANCE, "", 3.0, words)
    ]


def test_an_esc_that_fails_is_named_by_its_motor_not_by_its_place(tmp_path: Path):
    made = events_of(tmp_path, px4_log(mask=0, imbalanced=False, failures=(0, 0, 0, 4)))
    assert made == [(EventKind.ESC_FAILURE, "1", 3.0, "esc_status failures 0x4")]


def test_a_sound_flight_reports_nothing(tmp_path: Path):
    assert events_of(tmp_path, px4_log(mask=0, imbalanced=False)) == []


def test_without_a_mask_the_flag_is_the_report():
    topic = {"timestamp": np.arange(4) * 1_000_000, "fd_motor": np.array([0, 0, 1, 1])}
    (event,) = px4_failure_events({"failure_detector_status": [topic]})
    assert (event.kind, event.subject, event.time_s) == (EventKind.MOTOR_FAILURE, "", 2.0)
    assert px4_failure_events({}) == ()


def test_failure_flags_of_escs_in_a_telemetry_log_are_reports_by_motor(tmp_path: Path):
    frames = with_esc_reports(log_frames(FLIGHT)[:9000])
    log = read_log(write_log(tmp_path / "flight.tlog", frames), vehicle=1)
    failed = [event for event in log.events if event.kind is EventKind.ESC_FAILURE]
    assert [(event.subject, event.text) for event in failed] == [("3", "failure flags 0x10")]
    assert 0.3 < failed[0].time_s / log.track.time_s[-1] < 0.6
