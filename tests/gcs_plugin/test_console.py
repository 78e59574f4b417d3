"""The terminal's table: what is known, what is old, what is wrong, and no markup from outside."""

import math
from dataclasses import replace

import pytest
from rich.console import Console

from gcs_plugin.console import (
    kilograms,
    minutes,
    percent,
    screen,
    status_lines,
    vehicle_cells,
)
from gcs_plugin.fleet import Fleet
from gcs_plugin.monitor import Monitor, MonitorSettings
from models.airframe import load_airframe
from models.rotor_model import physics_model
from tests.gcs_plugin.live_vehicle import SECOND, Vehicle

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


def flown(rpm: int = 1700, seconds: float = 8.0) -> tuple[Fleet, Vehicle]:
    fleet, vehicle = Fleet(MODEL), Vehicle(3)
    for _ in range(round(seconds * 10)):
        fleet.take(vehicle.tick(rpm=(rpm,) * 4))
        fleet.updates()
    return fleet, vehicle


def test_a_row_has_the_margin_of_the_worst_rotor_and_how_old_it_is():
    fleet, vehicle = flown()
    cells = vehicle_cells(fleet.vehicles[3], vehicle.stamp_us, 0.5)
    assert cells[0] == "3"
    # The ESCs report 50 V: 3000 rpm at 58.8 V.
    assert f"{1 - (1700 * 58.8 / 50 / 3000) ** 2:.0%}" in cells[1]
    assert "green" in cells[1]
    assert "red" in vehicle_cells(fleet.vehicles[3], vehicle.stamp_us, 0.6)[1]
    assert cells[-1] == "0.0 s"


def test_an_old_row_is_called_old_in_every_number():
    fleet, vehicle = flown()
    cells = vehicle_cells(fleet.vehicles[3], vehicle.stamp_us + 10 * SECOND, 0.5)
    assert all("old" in cell for cell in cells[1:-1] if cell != "-")
    assert cells[-1] == "10.0 s"


def test_unknown_numbers_are_dashes():
    assert [percent(math.nan), kilograms(math.nan), minutes(math.nan)] == ["-"] * 3
    assert minutes(math.inf) == "not"
    assert minutes(125.0) == "2:05"


@pytest.fixture
def monitor():
    made = Monitor(MODEL, MonitorSettings(urls=("udpin:127.0.0.1:0",)))
    yield made
    made.close()


def printed(monitor: Monitor) -> str:
    console = Console(width=160, file=open("/dev/null", "w"), record=True)  # noqa: SIM115
    console.print(screen(monitor))
    return console.export_text()


def test_the_screen_names_alarms_problems_and_the_tanks_source(monitor):
    assert "no vehicle heard yet on udpin:127.0.0.1:0" in printed(monitor)
    fleet, vehicle = flown(rpm=2300)
    vehicle.stamp_us = monitor.now_us()
    fleet.take(vehicle.tick(rpm=(2300,) * 4))
    fleet.updates()
    monitor.fleet = fleet
    text = printed(monitor)
    assert "Thrust margin" in text
    assert "tank by NAMED_VALUE_FLOAT TANK" in text


def test_a_recording_that_does_not_go_on_is_told_first(monitor, tmp_path):
    from gcs_plugin.recorder import RecorderStatus

    fine = RecorderStatus(
        folder=tmp_path,
        frames=10,
        bytes=100,
        rows=5,
        frames_lost=0,
        rows_lost=0,
        frames_dropped=0,
        trouble="",
        slowest_sync_s=0.0,
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
