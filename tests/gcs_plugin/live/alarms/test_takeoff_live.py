"""The alarm before take-off on recorded flights whose ESC telemetry was changed at the start."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from tests.gcs_plugin.live.live_vehicle import log_frames
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.models.model.model_file import shipped_model

ESC = "ESC_TELEMETRY_1_TO_4"
#: s of the recorded flight's own clock: all four turn, its skids leave the ground, and in flight.
TURN, LIFTS, FLIES = 8.0, 12.4, 13.1
Change = Callable[[float, list[int]], list[int]]


def changed(log: Path, out: Path, change: Change, *, rate_hz: float, until_s: float = 20.0) -> Path:
    """Copy the first seconds of a flight with its rotor speeds changed, a function of s and rpm."""
    source, last, first = mavutil.mavlink_connection(str(log)), -np.inf, None
    sender = mavlink.MAVLink(None)
    with out.open("wb") as file:
        while (message := source.recv_msg()) is not None:
            now = message._timestamp
            data, kind = message.get_msgbuf(), message.get_type()
            if kind == ESC:
                first = now if first is None else first
                if now - last < 1.0 / rate_hz - 1e-3:
                    continue
                last = now
                message.rpm = change(now - first, list(message.rpm))
                sender.srcSystem, sender.srcComponent = (
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                )
                sender.seq = message.get_seq()
                data = message.pack(sender)
            if first is not None and now - first > until_s:
                break
            file.write(struct.pack(">Q", int(now * 1e6)) + bytes(data))
    source.close()
    return out


def watched(log: Path, every: int = 40) -> tuple[list[Update], list[AlarmEvent]]:
    """Hear a recording as a link gives it, some frames at a time."""
    model = shipped_model()
    monitor = VehicleMonitor(1, model, WatchSettings(airframe_given=True))
    updates: list[Update] = []
    for count, frame in enumerate(log_frames(log)):
        if frame.system == 1:
            monitor.take(frame)
        if count % every == 0:
            updates += monitor.updates()
    updates += monitor.updates()
    events = [event for update in updates for event in update.events]
    return updates, [event for event in events if event.alarm.name == "take-off"]


def start_s(updates: list[Update]) -> float:
    """Vehicle's clock of the first row."""
    return float(updates[0].clock_s[0])


@pytest.fixture(scope="module")
def sound(sitl_logs: Path) -> Path:
    return sitl_logs / "campaign" / "v2_m10_q1.5.tlog"


@pytest.mark.parametrize("hz", [2.0, 10.0])
def test_a_sound_start_raises_nothing_and_has_its_check(sound: Path, tmp_path: Path, hz: float):
    made = changed(sound, tmp_path / "sound.tlog", lambda _, rpm: rpm, rate_hz=hz)
    updates, events = watched(made)
    assert events == []
    check = updates[-1].takeoff
    assert check is not None
    assert (check.findings, check.reporting, check.ended) == ((), 4, True)


@pytest.mark.parametrize("hz", [2.0, 10.0])
def test_a_late_motor_is_said_before_the_skids_leave_the_ground(
    sound: Path, tmp_path: Path, hz: float
):
    def late(time_s: float, rpm: list[int]) -> list[int]:
        return [*rpm[:2], 0 if time_s < TURN + 1.5 else rpm[2], rpm[3]]

    updates, events = watched(changed(sound, tmp_path / "late.tlog", late, rate_hz=hz))
    raised = [event for event in events if event.raised]
    assert len(raised) == 1
    alarm = raised[0].alarm
    assert (alarm.severity, alarm.rotors) == (2, (3,))
    assert alarm.text == "DO NOT LIFT: motor 3 does not turn"
    assert raised[0].time_s - start_s(updates) < TURN + 1.6 < LIFTS
    texts = {a.text for update in updates for a in update.alarms if a.name == "take-off"}
    assert "DO NOT LIFT: motor 3 turns late (1.5 s)" in texts
    assert not any(a.name == "take-off" for a in updates[-1].alarms)


def test_a_motor_without_propeller_is_said_before_the_skids_leave_the_ground(
    sound: Path, tmp_path: Path
):
    def bare(_: float, rpm: list[int]) -> list[int]:
        return [rpm[0], round(rpm[1] * (1.5 if rpm[1] > 600 else 1.0)), *rpm[2:]]

    updates, events = watched(changed(sound, tmp_path / "bare.tlog", bare, rate_hz=10.0))
    raised = [event for event in events if event.raised]
    assert raised[0].alarm.text == "DO NOT LIFT: motor 2 too fast: propeller?"
    assert raised[0].time_s - start_s(updates) < LIFTS + 0.2


def test_the_alarm_lasts_into_the_flight_in_other_words_and_ends(sound: Path, tmp_path: Path):
    def late(time_s: float, rpm: list[int]) -> list[int]:
        return [*rpm[:2], 0 if time_s < TURN + 1.0 else rpm[2], rpm[3]]

    updates, events = watched(changed(sound, tmp_path / "late.tlog", late, rate_hz=10.0))
    aloft = {
        alarm.text
        for update in updates
        if update.analysis.track.flying[-1]
        for alarm in update.alarms
        if alarm.name == "take-off"
    }
    assert aloft == {"Motor 3 turned late (1.0 s): land"}
    assert [event.kind for event in events] == ["raised", "cleared"]
    assert events[1].time_s - start_s(updates) == pytest.approx(FLIES + 5.0, abs=1.0)
