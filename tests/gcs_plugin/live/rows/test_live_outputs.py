"""A vehicle whose ESCs do not report, watched live: a margin from motor outputs, marked as such."""

import re
from functools import cache

import numpy as np

from tests.gcs_plugin.live.live_vehicle import ROOT, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log

LOG = ROOT / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
ESC, OUTPUTS = 11030, 36  # ESC_TELEMETRY_1_TO_4, SERVO_OUTPUT_RAW


@cache
def watched(
    piece: int, share: float = 1.0, outputs: float = 1.0
) -> tuple[list[Update], list[AlarmEvent], VehicleMonitor]:
    """Updates of a share of the flight without its ESC messages, so many frames a round.

    Motor outputs come in the first share `outputs` of the flight.
    """
    monitor = VehicleMonitor(1, MODEL, WatchSettings())
    frames = [f for f in log_frames(LOG) if f.system == 1 and f.id != ESC]
    frames = [
        f
        for n, f in enumerate(frames[: round(share * len(frames))])
        if f.id != OUTPUTS or n < outputs * len(frames)
    ]
    updates: list[Update] = []
    for first in range(0, len(frames), piece):
        for frame in frames[first : first + piece]:
            monitor.take(frame)
        updates += monitor.updates()
    updates += monitor.updates(final=True)
    return updates, [event for update in updates for event in update.events], monitor


def rows(updates: list[Update], of: str) -> np.ndarray:
    return np.concatenate([getattr(u.analysis, of)[u.first :] for u in updates])


def test_the_margin_is_within_its_interval_of_the_measured_one():
    updates, _, _ = watched(200, 0.5)
    time_s = np.concatenate([u.analysis.track.time_s[u.first :] for u in updates])
    speed = np.concatenate([u.analysis.track.rotor_speed_rpm[u.first :] for u in updates])
    error = rows(updates, "utilisation_error")
    use = rows(updates, "utilisation")
    true = read_log(LOG, airframe=AIRFRAME, sampling="hold").track
    measured = true.rotor_speed_rpm[
        np.searchsorted(true.time_s, time_s - 1e-6).clip(0, true.time_s.size - 1)
    ]
    known = np.isfinite(use) & (measured > 0.0)
    share = (measured / speed) ** 2
    inside = np.abs(share - 1.0)[known] * use[known] <= 1.645 * error[known]
    assert known.sum() > 2500
    assert inside.mean() > 0.9


def test_it_is_marked_and_no_rotor_is_accused():
    updates, events, _ = watched(200, 0.5)
    last = updates[-1]
    assert any("rotor speeds from motor outputs (SERVO_OUTPUT_RAW" in r for r in last.remarks)
    assert {e.alarm.name for e in events if e.raised} <= {"margin"}
    texts = {e.alarm.text for e in events if e.raised and e.alarm.name == "margin"}
    assert texts
    assert all(re.search(r"[Tt]hrust left \d+% \(\d+-\d+\)", t) and len(t) <= 50 for t in texts)
    assert not np.isfinite(rows(updates, "residual_rpm")).all()


def test_the_cuts_between_rounds_do_not_matter():
    few, many = watched(200, 0.2)[0], watched(31, 0.2)[0]
    for name in ("utilisation", "utilisation_error"):
        np.testing.assert_allclose(rows(few, name), rows(many, name), rtol=1e-6)


def test_lost_outputs_are_not_called_lost_escs():
    _, events, _ = watched(200, 0.5, 0.4)
    texts = [e.alarm.text for e in events if e.alarm.name == "rotor speeds"]
    assert texts == ["No motor outputs: thrust left unknown"]
