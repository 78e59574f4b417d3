"""Cells, capacity and nominal voltage that the battery itself states, and what they decide."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import live_rows, log_frames
from tests.gcs_plugin.logs.log_files import UlogWriter
from tests.gcs_plugin.logs.test_ulog import written as ulog_written
from tests.gcs_plugin.logs.tlog_files import STAMPED, link, written
from tests.made_sources import sent
from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.gcs_plugin.mavlink.frame import checksum
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.checks.plausible import comparisons
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.vehicle_facts import StatedBattery, VehicleFacts

F16 = load_airframe("topxgun-f16-sitl")  # 51.8 V: 14 cells


def info(cells: int, *, kind: int = 1, nominal: float = 51.8, number: int = 0) -> bytes:
    """BATTERY_INFO, which pymavlink does not have: id 372, CRC_EXTRA 26; 16 Ah by design."""
    floats = [0.0] * 5 + [nominal, 0.0, 0.0, 16.0, 15.0]
    payload = struct.pack("<10f2H5B9s32s50s", *floats, 3, 0, number, 1, kind, 95, cells, *[b""] * 3)
    body = bytes([len(payload), 0, 0, 1, 1, 1]) + (372).to_bytes(3, "little") + payload
    return b"\xfd" + body + checksum(body, 26).to_bytes(2, "little")


def smart_info(cells: int) -> bytes:
    """SMART_BATTERY_INFO, what it was before; 16 Ah by its specification."""
    message = dialect.MAVLink_smart_battery_info_message(
        *(0, 1, 1, 16_000, -1, 0, b"", b"", 0, 0, 0, 0), cells_in_series=cells
    )
    return bytes(message.pack(link()))


def flight(tmp_path, frame: bytes, *, at: int = 300):
    stamp = STAMPED[at][:8]
    return written(tmp_path, b"".join([*STAMPED[:at], stamp + frame, *STAMPED[at:6000]]))


def voltage_of(log: FlightLog, track: FlightTrack | None = None):
    found = comparisons(log.track if track is None else track, F16, log.facts, log.parameters)
    return next(c for c in found if c.check == "voltage")


@pytest.mark.parametrize(
    ("frame", "name", "nominal"),
    [(info(14), "BATTERY_INFO", 51.8), (smart_info(14), "SMART_BATTERY_INFO", 0.0)],
)
def test_what_it_states_is_a_fact_with_its_source(tmp_path, frame, name, nominal):
    facts = read_log(flight(tmp_path, frame), airframe=F16).facts
    stated = facts.battery
    assert (stated.cells, stated.capacity_mah) == (14, 16_000.0)
    assert stated.nominal_voltage == pytest.approx(nominal)
    assert (stated.source.name, stated.source.instance) == (name, "0")
    assert (
        f"battery of 14 cells, {'51.8 V, ' if nominal else ''}16000 mAh by {name}"
        in statement_words(facts.statement)
    )


def test_a_listener_has_the_same(tmp_path):
    path = flight(tmp_path, info(12))
    _, heard = live_rows(log_frames(path)[:2500], F16, piece=100)
    assert heard.facts.battery == read_log(path, airframe=F16).facts.battery
    assert heard.facts.battery.cells == 12


@pytest.mark.parametrize(("cells", "verdict"), [(14, "close"), (13, "contradicts")])
def test_a_pack_of_other_cells_is_no_pack_of_the_airframe(tmp_path, cells, verdict):
    log = read_log(flight(tmp_path, info(cells)), airframe=F16)
    assert voltage_of(log).verdict == verdict
    assert ("3.98 V a cell" in statement_words(voltage_of(log).found)) == (cells == 13)
    unknown = replace(log.track, voltage=np.full_like(log.track.voltage, np.nan))
    assert voltage_of(log, unknown).verdict == ("contradicts" if cells == 13 else "unknown")


@pytest.mark.parametrize(
    "frame",
    [
        info(6),  # 56 V in flight are not of six cells: the statement is wrong, not the aircraft
        info(16, kind=2),  # LiFePO4
        info(0, nominal=0.0),
        info(6, number=1),  # another battery
    ],
)
def test_what_says_nothing_of_the_cells_flown_on_decides_nothing(tmp_path, frame):
    log = read_log(flight(tmp_path, frame), airframe=F16)
    assert voltage_of(log).verdict == "close"
    found = reported_airframe(log.parameters, 57.0, facts=log.facts).quantities["nominal_voltage"]
    assert found.value == pytest.approx(51.8)
    assert "INFO" not in found.source


def test_an_airframe_is_made_with_the_cells_that_it_states():
    stated = StatedBattery(cells=12, source=sent("BATTERY_INFO cells_in_series"))
    facts = VehicleFacts(battery=stated)
    for parameters in ({"MOT_BAT_VOLT_MAX": 25.2}, {"BAT1_N_CELLS": 6.0}):
        found = reported_airframe(parameters, 49.0, facts=facts).quantities["nominal_voltage"]
        assert found.value == pytest.approx(44.4)  # 12 of 3.7 V
        assert not found.guessed
        assert found.source == "12 cells of 3.7 V, by BATTERY_INFO cells_in_series"
    # A setting that the voltage forbids counts for nothing either.
    found = reported_airframe({"BAT1_N_CELLS": 6.0}, 49.0).quantities["nominal_voltage"]
    assert found.value == pytest.approx(44.4)


def test_px4_writes_it_into_its_own_log(tmp_path):
    log = UlogWriter()
    fields = [("float", "voltage_v"), ("float", "current_a")]
    fields += [("uint16_t", "capacity"), ("uint8_t", "cell_count")]
    log.topic("battery_status", fields, "2fHB")
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    for tick in range(40):
        log.row("vehicle_attitude", 100.0 + tick / 10, 1.0, 0.0, 0.0, 0.0)
        log.row("battery_status", 100.0 + tick / 10, 24.0, 1.0, 5000, 6)
    stated = read_log(ulog_written(tmp_path, log.bytes())).facts.battery
    assert (stated.cells, stated.capacity_mah) == (6, 5000.0)
    assert source_words(stated.source) == "battery_status cell_count of id 0"
