"""The terminal's table: what is known, what is old, what is wrong, and no markup from outside."""

import io
import math
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.console import Console

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent, AlarmState
from thrustmargin.gcs_plugin.live.console import (
    Bell,
    EventPrinter,
    Screen,
    kilograms,
    minutes,
    percent,
    status_lines,
    vehicle_cells,
)
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
CRITICAL = 2
NOTICE = 5
WARNING = 4

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


def flown(rpm: int = 1700, seconds: float = 3.0) -> tuple[Fleet, Vehicle]:
    fleet, vehicle = Fleet(MODEL), Vehicle(3)
    for _ in range(round(seconds * 10)):
        fleet.take(vehicle.tick(rpm=(rpm,) * 4))
        fleet.updates()
    return fleet, vehicle


def test_a_row_has_the_margin_of_the_worst_rotor_and_how_old_it_is():
    fleet, vehicle = flown()
    cells = vehicle_cells(fleet.vehicles[3], vehicle.stamp_us, 0.5)
    assert cells[0].plain == "3"
    # The ESCs report 50 V: 3000 rpm at 58.8 V.
    assert f"{1 - (1700 * 58.8 / 50 / 3000) ** 2:.0%}" in cells[1].plain
    assert cells[1].style == "green"
    assert cells[1].plain.isascii()
    assert "[" not in cells[1].plain
    assert cells[-1].plain == "0.0 s"
    low = vehicle_cells(fleet.vehicles[3], vehicle.stamp_us, 0.6)[1]
    assert low.style == "bold red"


def test_an_old_row_is_marked_old_in_every_number_and_has_no_colour_left():
    fleet, vehicle = flown()
    cells = vehicle_cells(fleet.vehicles[3], vehicle.stamp_us + 10 * SECOND, 0.5)
    known = [cell for cell in cells[1:-1] if cell.plain != "-"]
    assert len(known) >= 4
    assert all(cell.plain.startswith("~") and cell.style == "dim" for cell in known)
    assert "OLD 10.0 s" in cells[-1].plain


@pytest.mark.slow
def test_a_link_that_loses_half_does_not_flicker():
    """Motor outputs that come four times a second, every other one lost at random."""
    fleet, vehicle = flown()
    rng = np.random.default_rng(5)
    said = set()
    for tick in range(600):
        fleet.take([f for f in vehicle.tick() if rng.random() < 0.5])
        if tick % 3 == 0 and rng.random() < 0.5:
            outputs = dialect.MAVLink_servo_output_raw_message(
                vehicle.boot_ms * 1000 % 2**32, 0, *([1500] * 8), *([0] * 8)
            )
            fleet.take([vehicle.frame(outputs)])
        fleet.updates()
        said.add(fleet.vehicles[3].stale(vehicle.stamp_us))
    assert said == {""}


def test_a_field_that_is_no_longer_reported_is_named_with_its_age():
    fleet, vehicle = flown()
    watch = fleet.vehicles[3]
    assert watch.stale(vehicle.stamp_us) == ""
    for _ in range(80):
        # All but the tank (fourth) and the airspeed (third).
        parts = vehicle.tick()
        fleet.take([parts[n] for n in range(len(parts)) if n not in (2, 3)])
    assert math.isnan(fleet.updates()[-1].analysis.track.tank_kg[-1])
    assert watch.stale(vehicle.stamp_us) == ("no longer reported: airspeed (8 s), tank level (8 s)")
    # A silent vehicle is reported as a whole.
    assert watch.stale(vehicle.stamp_us + 10 * SECOND) == ""


def test_a_narrow_terminal_cuts_no_number(monitor):
    fleet, vehicle = flown()
    vehicle.stamp_us = monitor.now_us()
    fleet.take(vehicle.tick())
    fleet.updates()
    monitor.fleet = fleet
    for width in (80, 110, 160):
        text = printed(monitor, width)
        assert "…" not in text
        for words in ("left", "predicted", "10.0 kg", "r1"):
            assert words in text
        assert re.search(r"\d\.\d s", text)  # its age, by the clock
        assert ("by thrust" in text) == (width >= 110)


def test_a_vehicle_silent_on_the_ground_leaves_and_one_silent_in_flight_never_does():
    fleet, vehicle = flown()
    watch = fleet.vehicles[3]
    later = vehicle.stamp_us + 600 * SECOND
    assert watch.flying
    assert not watch.has_left(later)
    fleet.take([as_frame(vehicle.landed(1), vehicle.stamp_us)])
    fleet.take(vehicle.tick(rpm=(0,) * 4))
    fleet.updates()
    assert not watch.has_left(vehicle.stamp_us + 59 * SECOND)
    assert watch.has_left(vehicle.stamp_us + 61 * SECOND)


def test_without_a_terminal_every_event_is_a_line_with_its_time(monitor):
    said: list[str] = []
    printer = EventPrinter(monitor, said.append)
    fleet, vehicle = flown(rpm=2300)
    for event in fleet.vehicles[3].last.events:  # type: ignore[union-attr]
        printer.on_event(3, event)
    alarm = Alarm("margin", None, 4, "Thrust left 39%", 0.0)
    printer.on_event(3, AlarmEvent(alarm, AlarmState.CLEARED, 0.0, unix_s=1e9))
    printer.on_round(fleet, vehicle.stamp_us)
    printer.on_round(fleet, vehicle.stamp_us)
    printer.on_note(3, "the vehicle restarted", vehicle.stamp_us * 1e-6)
    # What is asked for in vain is a line once, however its rate changes.
    watch = fleet.vehicles[3]
    for came in ({"WIND": (0.2, 1.0)}, {"WIND": (0.0, 1.0)}, {}, {"WIND": (0.1, 1.0)}):
        watch.not_followed = came
        printer.on_round(fleet, vehicle.stamp_us)
    *said, in_vain = said
    assert "vehicle 3: does not send as asked: WIND 0.2 of 1 Hz" in in_vain
    airframe_match = "vehicle 3: the vehicle restarted"
    times, words = zip(*((line[:19], line[20:]) for line in said), strict=True)
    assert list(words) == ["vehicle 3: Thrust left 39%", "vehicle 3: heard", airframe_match]
    local = [time.mktime(time.strptime(stamp, "%Y-%m-%d %H:%M:%S")) for stamp in times]
    first_s, now_s = (int(us * 1e-6) for us in (fleet.vehicles[3].link.first_us, vehicle.stamp_us))
    assert local == [1e9, first_s, now_s]
    assert first_s < now_s


def test_unknown_numbers_are_dashes():
    assert [percent(math.nan), kilograms(math.nan), minutes(math.nan)] == ["-"] * 3
    assert minutes(math.inf) == "not"
    assert minutes(125.0) == "2:05"


@pytest.fixture
def monitor():
    made = LiveMonitor(MODEL, MonitorSettings(urls=("udpin:127.0.0.1:0",)))
    yield made
    made.close()


def printed(monitor: LiveMonitor, width: int = 160) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(Screen(monitor))
    return console.export_text()


def test_the_screen_names_alarms_problems_and_the_tanks_source(monitor):
    assert "no vehicle heard yet on udpin:127.0.0.1:0" in printed(monitor)
    fleet, vehicle = flown(rpm=2300, seconds=8.0)
    vehicle.stamp_us = monitor.now_us()
    fleet.take(vehicle.tick(rpm=(2300,) * 4))
    fleet.updates()
    monitor.fleet = fleet
    text = printed(monitor)
    assert "Thrust left" in text
    assert "tank by NAMED_VALUE_FLOAT TANK" in text


def test_what_was_found_is_not_gone_with_the_vehicle(monitor, monkeypatch):
    vehicle = Vehicle(7)
    for _ in range(30):
        monitor.fleet.take(vehicle.tick(rpm=(1700,) * 4))
        monitor.fleet.updates()
    monitor._newest_us = vehicle.stamp_us
    monkeypatch.setattr(monitor, "now_us", lambda: vehicle.stamp_us + 90 * SECOND)
    watch = monitor.fleet.vehicles[7]
    track = watch.last.analysis.track
    stands = replace(track, flying=np.zeros_like(track.flying))
    watch.last = replace(watch.last, analysis=replace(watch.last.analysis, track=stands))
    shown = printed(monitor)
    assert "no vehicle heard yet" not in shown
    assert "vehicle 7 was last heard at" in shown
    assert f"vehicle 7: {watch.last.answer.line}" in " ".join(shown.split())


def test_a_recording_that_does_not_go_on_is_told_first(monitor, tmp_path):
    from thrustmargin.gcs_plugin.live.recording.recorder import RecorderStatus

    fine = RecorderStatus(
        folder=tmp_path,
        frames=10,
        bytes=100,
        rows=5,
        frames_lost=0,
        rows_lost=0,
        trouble="",
    )
    status = replace(monitor.status(), recorder=fine)
    assert f"recording to {tmp_path}: 10 messages, 5 samples" in status_lines(status)
    full = replace(fine, trouble="No space left on device", frames_lost=7)
    lines = status_lines(replace(status, recorder=full, kernel_drops=3))
    assert any(
        line.startswith("NOT RECORDING: No space left on device (7 messages lost)")
        for line in lines
    )
    assert "3 dropped by the system" in lines[0]


def test_the_bell_rings_for_what_asks_for_a_hand_and_not_for_notes():
    rung = []
    bell = Bell(lambda: rung.append(True))
    for severity in (CRITICAL, WARNING, NOTICE):
        alarm = Alarm("margin", None, severity, "Margin 12 %", 3.0)
        bell.on_event(1, AlarmEvent(alarm, AlarmState.CLEARED, 3.0))
        bell.on_event(
            1, AlarmEvent(replace(alarm, state=AlarmState.CLEARED), AlarmState.ACTIVE, 4.0)
        )
    assert len(rung) == 2
