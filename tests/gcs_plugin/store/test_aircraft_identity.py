"""Who flew, by what each kind of log says of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.log_files import other_flight
from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.gcs_plugin.mavlink.frame import checksum_rows
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.store.season_store import aircraft_identity, firmware
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights

TLOG = ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog"
SERIAL = bytes.fromhex("3b0032001451383438323735")


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return read_log(TLOG)


def version_frame(system: int) -> bytes:
    """A stamped AUTOPILOT_VERSION of a vehicle with SERIAL."""
    (layout,) = (one for one in layouts().values() if one.name == "AUTOPILOT_VERSION")
    fields = np.zeros(1, layout.dtype)
    fields["uid2"][0, : len(SERIAL)] = np.frombuffer(SERIAL, np.uint8)
    body = fields.tobytes()
    head = bytes([0xFD, len(body), 0, 0, 0, system, 1, *layout.id.to_bytes(3, "little")])
    rows = np.frombuffer(head[1:] + body, np.uint8)[None, :]
    sealed = checksum_rows(rows, np.array([layout.crc_extra], np.uint8)).astype("<u2").tobytes()
    return TLOG.read_bytes()[:8] + head + body + sealed


def test_what_is_given_then_serial_then_board_then_system_id(log: FlightLog):
    texts = ((0.0, "ArduCopter V4.5.7 (2a3dc4b7)"), (0.0, "CubeOrange 0032003B 34385114 35373238"))
    by_text = replace(log, messages=texts, parameters={"BRD_SERIAL_NUM": 12.0})
    assert aircraft_identity(by_text).name == f"serial-{SERIAL.hex()}"
    assert aircraft_identity(by_text, "seven").by == "given"
    assert firmware(by_text) == "ArduCopter V4.5.7 (2a3dc4b7)"
    board = replace(log, parameters={"BRD_SERIAL_NUM": 12.0})
    assert (aircraft_identity(board).name, aircraft_identity(board).by) == (
        "board-12",
        "board number",
    )
    assert (aircraft_identity(log).name, aircraft_identity(log).by) == ("sysid-1", "system id")
    assert firmware(log) is None
    assert aircraft_identity(replace(log, vehicles=())).by == "not known"


def test_the_serial_of_a_telemetry_log_is_that_of_the_boot_text(tmp_path: Path):
    path = tmp_path / "a.tlog"
    path.write_bytes(version_frame(1) + TLOG.read_bytes())
    assert read_log(path).hardware_id == SERIAL.hex()
    assert aircraft_identity(read_log(path)).name == f"serial-{SERIAL.hex()}"


def test_a_log_of_two_vehicles_holds_a_flight_of_each(tmp_path: Path):
    path = tmp_path / "telemetry.tlog"
    path.write_bytes(TLOG.read_bytes() + other_flight(TLOG, later_us=600_000_000, system=2))
    flights = season_flights(path, "f" * 16, IngestSettings(store=""), name=path.name)
    assert {f.aircraft: f.summary["flight"][16:] for f in flights} in (
        {"sysid-1": "", "sysid-2": "-2"},
        {"sysid-2": "", "sysid-1": "-1"},
    )
    first, second = sorted(flights, key=lambda f: f.aircraft)
    later = second.summary["started_unix_s"] - first.summary["started_unix_s"]
    assert later == pytest.approx(600.0, abs=0.1)
    assert first.summary["worst_margin"] == pytest.approx(second.summary["worst_margin"])
