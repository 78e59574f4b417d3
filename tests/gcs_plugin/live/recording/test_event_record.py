"""Events have the time at which they happened, however many messages are analysed in one go."""

import json
import time
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, write_log
from tests.gcs_plugin.live.monitored import MODEL, recording_in
from thrustmargin.gcs_plugin.live.console import EventPrinter
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.mavlink.frame import Frame

BEGAN = 1_700_000_000  # Unix s


def flown(vehicle: Vehicle, seconds: int) -> list[Frame]:
    return [frame for _ in range(10 * seconds) for frame in vehicle.tick()]


def watched(frames: list[Frame], folder: Path, **watch) -> tuple[list[tuple], list[str]]:
    """(s since BEGAN, vehicle, event, first words) as recorded, and the lines that are printed."""
    path, printed = write_log(folder / "flight.tlog", frames), []
    settings = MonitorSettings(
        urls=(str(path),), record=folder / "out", watch=WatchSettings(**watch)
    )
    monitor = LiveMonitor(MODEL, settings)
    monitor.outputs.append(EventPrinter(monitor, printed.append))
    with monitor:
        monitor.wait(100.0)
    lines = (recording_in(folder / "out") / "events.jsonl").read_text().splitlines()
    events = [
        (e["unix_s"] - BEGAN, e["vehicle"], e["event"], e["text"]) for e in map(json.loads, lines)
    ]
    return events, printed


def at(events: list[tuple], words: str, kind: str) -> list[float]:
    """s at which events of a kind with these words were."""
    return [when for when, _, event, text in events if event == kind and words in text]


@pytest.mark.slow
def test_a_lost_link_a_restart_and_what_is_printed_have_their_own_times(tmp_path):
    vehicle = Vehicle(clock_s=500.0, unix_s=BEGAN)
    frames = flown(vehicle, 20)
    vehicle.stamp_us += 30 * SECOND  # nothing is heard
    vehicle.clock_s += 30.0
    frames += flown(vehicle, 20)
    vehicle.clock_s = 2.0
    frames += flown(vehicle, 300)
    events, printed = watched(frames, tmp_path)
    assert at(events, "", "appeared") == pytest.approx([0.1], abs=0.01)
    # Said after three seconds of silence, although nothing was there to look at it until 50.1 s.
    assert at(events, "Telemetry lost", "raised") == pytest.approx([23.0], abs=0.01)
    assert at(events, "restarted", "note") == pytest.approx([70.1], abs=0.01)
    stamps = [time.mktime(time.strptime(line[:19], "%Y-%m-%d %H:%M:%S")) for line in printed]
    said = {line[20:]: stamp - BEGAN for line, stamp in zip(printed, stamps, strict=True)}
    assert said["vehicle 1: heard"] == 0
    assert said["vehicle 1: the vehicle restarted: its clock went from 570 s to 2 s"] == 70
    assert said["vehicle 1: Telemetry lost in flight: fly by sight"] == 23
    assert said["vehicle 1: airframe topxgun-f16-sitl, given"] < 6


def test_a_vehicle_leaves_a_minute_after_it_was_last_heard_and_returns_when_it_is(tmp_path):
    leaving, staying = Vehicle(1, unix_s=BEGAN), Vehicle(2, unix_s=BEGAN)
    frames = []
    for second in range(200):
        if not 20 <= second < 150:
            frames += leaving.tick(1.0)
        else:
            leaving.clock_s += 1.0
            leaving.stamp_us += SECOND
        frames += staying.tick(1.0)
    events, _ = watched(frames, tmp_path)
    assert at(events, "vehicle 1", "left") == [80.0]
    assert at(events, "vehicle 1", "returned") == [151.0]
    assert at(events, "vehicle 2", "left") == []
