"""Logs that hold several flights: each is read as if it stood in a file of its own."""

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.dataflash.test_dataflash import ENDS
from tests.gcs_plugin.logs.dataflash.test_dataflash import FLIGHT as BIN
from tests.gcs_plugin.logs.dataflash.test_dataflash import WHOLE as BIN_BYTES
from tests.gcs_plugin.logs.log_files import as_text, frames_of, long_bin
from tests.gcs_plugin.logs.sortie_logs import HEAVY, LIGHT, rebooted, refilled
from tests.gcs_plugin.logs.tlog_files import flight_of, link, stamped, written
from thrustmargin.gcs_plugin.logs import FlightLog, read_log, read_sorties
from thrustmargin.gcs_plugin.wording.check_words import statement_words


def same_flight(found: FlightLog, alone: FlightLog, tolerance: float = 0.0) -> None:
    assert np.count_nonzero(found.track.flying) == np.count_nonzero(alone.track.flying)
    for name in ("rotor_speed_rpm", "tank_kg", "position_ned"):
        a, b = (getattr(log.track, name)[log.track.flying] for log in (found, alone))
        np.testing.assert_allclose(a, b, atol=tolerance, err_msg=name)


def test_a_restart_between_two_flights_makes_two_sorties(tmp_path: Path):
    first, second = read_sorties(rebooted(tmp_path / "day.tlog"))
    same_flight(first, read_log(HEAVY))
    same_flight(second, read_log(LIGHT))
    assert [log.name for log in (first, second)] == [
        "day.tlog sortie 1 of 2",
        "day.tlog sortie 2 of 2",
    ]
    assert [log.track.name for log in (first, second)] == [first.name, second.name]
    assert first.unflown == ()


def test_disarmed_on_the_ground_between_two_flights_makes_two_sorties(tmp_path: Path):
    first, second = read_sorties(refilled(tmp_path / "day.tlog"))
    same_flight(first, read_log(LIGHT), 1e-3)
    same_flight(second, read_log(HEAVY), 1e-3)
    assert second.clock_start_s > 600.0
    assert first.track.start_unix_s is not None
    assert second.track.start_unix_s == pytest.approx(first.track.start_unix_s + 600.0, abs=1.0)


def test_a_listeners_rows_are_divided_likewise(tmp_path: Path):
    for make in (rebooted, refilled):
        assert len(read_sorties(make(tmp_path / "day.tlog"), sampling="hold")) == 2


def test_a_later_sortie_keeps_the_home_that_was_told_before_it(tmp_path: Path):
    beside = tmp_path / "later.tlog"
    beside.write_bytes(refilled(tmp_path / "whole.tlog").read_bytes())
    home, count = 242, 0
    with (path := tmp_path / "day.tlog").open("wb") as file:
        first = len(frames_of(LIGHT))
        for row, frame in enumerate(frames_of(beside)):
            reported = int.from_bytes(frame[15:18], "little") == home
            count += reported
            if not reported or row < first:
                file.write(frame)
    assert count > 1
    first, second = read_sorties(path)
    assert first.track.origin is not None
    assert second.track.origin == first.track.origin


@pytest.mark.slow
def test_boots_of_a_binary_and_a_text_dataflash_log_are_sorties(tmp_path: Path):
    alone = read_log(BIN)
    twice = tmp_path / "two.BIN"
    twice.write_bytes(BIN_BYTES * 2)
    for log in read_sorties(twice):
        same_flight(log, alone)
    assert [log.sortie for log in read_sorties(twice)] == [1, 2]
    names = ("ATT", "ESC", "EV", "ARM", "POS", "NVF", "RCOU", "PARM", "BAT")
    text = as_text(BIN, names)
    (one := tmp_path / "one.log").write_text(text)
    (two := tmp_path / "two.log").write_text(text * 2)
    found = read_sorties(two)
    assert len(found) == 2
    for log in found:
        same_flight(log, read_log(one))
        assert log.parameters == read_log(one).parameters


def test_a_dataflash_log_that_goes_on_after_disarming_holds_two_sorties(tmp_path: Path):
    path = tmp_path / "on.BIN"
    path.write_bytes(long_bin(BIN, 2))
    first, second = read_sorties(path)
    alone = read_log(BIN)
    same_flight(first, alone, 1e-3)
    same_flight(second, alone, 1e-3)


def test_a_boot_on_the_bench_is_said_and_no_sortie(tmp_path: Path):
    path = tmp_path / "bench.BIN"
    path.write_bytes(BIN_BYTES[: ENDS[3000]] + BIN_BYTES)
    (log,) = read_sorties(path)
    assert (log.name, log.sorties) == ("bench.BIN", 1)
    (unflown,) = map(statement_words, log.unflown)
    assert unflown == "no verdict on a stretch without flight, 2.0 s in all"
    # The same of a telemetry log whose first boot was never armed: heartbeats begin disarmed.
    bench = b"".join(frames_of(HEAVY)[:300])
    day = tmp_path / "bench.tlog"
    day.write_bytes(bench + rebooted(tmp_path / "day.tlog").read_bytes())
    found = read_sorties(day)
    assert [log.sortie for log in found] == [1, 2]
    assert "a stretch without flight" in statement_words(found[0].unflown[0])
    # One that holds nothing else is read as before.
    day.write_bytes(bench)
    assert len(read_sorties(day)) == 1


def test_parameters_are_those_of_the_sortie_and_else_those_told_later(tmp_path: Path):
    craft = link()

    def reported(name: bytes, value: float, at: float) -> bytes:
        return stamped(dialect.MAVLink_param_value_message(name, value, 9, 1, 0).pack(craft), at)

    def boot(later: float) -> bytes:
        return flight_of(lambda m: m.pack(craft), 5, later=later)

    data = boot(0.0) + reported(b"MOT_THST_EXPO", 0.5, 15.1)
    data += (
        boot(30.0) + reported(b"MOT_THST_EXPO", 0.7, 45.1) + reported(b"BATT_CAPACITY", 16000, 45.2)
    )
    first, second = read_sorties(written(tmp_path, data))
    assert first.parameters["MOT_THST_EXPO"] == pytest.approx(0.5)
    assert second.parameters["MOT_THST_EXPO"] == pytest.approx(0.7)
    assert first.parameters["BATT_CAPACITY"] == second.parameters["BATT_CAPACITY"] == 16000
