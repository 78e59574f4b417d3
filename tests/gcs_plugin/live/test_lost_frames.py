"""An ESC that loses frames of its telemetry, on a link and in the file of the same frames."""

from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from tests.gcs_plugin.logs.log_files import with_rotor_speeds
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.flight_arms import flight_arm_answer

LOG = ROOT / "sitl_logs" / "campaign" / "v4_m10_q2.5.tlog"


def pauses(rows: int) -> np.ndarray:
    """2 s in every 15 s, of messages at 10 Hz."""
    return np.arange(rows) % 150 < 20


def without_answer(speeds: np.ndarray) -> np.ndarray:
    """Speeds in which the third ESC does not answer in the pauses, as ArduPilot reports it."""
    changed = speeds.copy()
    changed[pauses(len(speeds)), 2] = 0.0
    return changed


def not_counted(counts: np.ndarray) -> np.ndarray:
    """Counters of reports that stand in the pauses of the third ESC."""
    changed, number = counts.copy(), np.arange(len(counts))
    paused = pauses(len(counts))
    last = np.maximum(number - number % 150 - 1, 0)  # before the pause
    changed[paused, 2] = counts[last[paused], 2]
    return changed


@pytest.fixture
def lossy(tmp_path: Path) -> Path:
    path = tmp_path / "lossy.tlog"
    path.write_bytes(with_rotor_speeds(LOG, not_counted, field="count"))
    path.write_bytes(with_rotor_speeds(path, without_answer))
    return path


def alarms_of(path: Path) -> list[tuple[str, int | None]]:
    monitor, events = VehicleMonitor(1, MODEL, WatchSettings()), []
    frames = [frame for frame in log_frames(path) if frame.system == 1]
    for first in range(0, len(frames), 500):
        for frame in frames[first : first + 500]:
            monitor.take(frame)
        events += [event for update in monitor.updates() for event in update.events]
    return [
        (event.alarm.name, event.alarm.rotor)
        for event in events
        if event.raised and event.alarm.name in ("frames", "shaking", "esc", "desync")
    ]


def test_lost_frames_of_one_esc_are_of_that_esc_live_and_in_the_file(lossy):
    answer = flight_arm_answer(analyse(read_log(lossy, airframe=AIRFRAME).track, MODEL))
    assert [(one.arm, one.causes[0].cause) for one in answer.findings] == [(2, Cause.TELEMETRY)]
    assert alarms_of(lossy) == [("frames", 3)]


def test_a_sound_link_raises_none():
    assert alarms_of(LOG) == []
