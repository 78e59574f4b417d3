"""The folder of known aircraft: whole after a crash, with two writers, and a full disk."""

import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.store.aircraft_marks import Marks
from thrustmargin.gcs_plugin.store.hangar import (
    AircraftFlight,
    Event,
    Hangar,
    NotTaught,
    open_hangar,
)
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.mode_walk import FlightOffsets
from thrustmargin.models.model.model_misfit import Caveat

DAY = 86_400.0


def row(name: str, day: float, offset: float = 0.0, **others) -> AircraftFlight:
    offsets = FlightOffsets(
        flight=name, start_unix_s=day * DAY, longitude_deg=0.0,
        offset=(offset, 0.0, 0.0, 0.0), error=(0.001,) * 4, rows=500,
    )  # fmt: skip
    return AircraftFlight(
        flight=name, log_name=f"{name}.tlog", started_unix_s=day * DAY, offsets=offsets, **others
    )


@pytest.fixture
def hangar(tmp_path: Path) -> Hangar:
    made = Hangar(tmp_path / "hangar")
    made.keep("north", [Marks(board="01")], made_unix_s=0.0, training=["t"])
    made.add_flight("north", row("t", 1.2, trained=True))
    return made


def test_what_was_kept_is_read_again(hangar: Hangar):
    hangar.add_flight("north", row("b", 4.2, 0.02))
    hangar.add_flight("north", row("a", 3.2, 0.01, verdict="under"))
    hangar.add_event("north", Event(unix_s=3.9 * DAY, changed="propeller 3"))
    known = hangar.load("north")
    assert [one.flight for one in known.flights] == ["t", "a", "b"]
    assert known.flights[1] == row("a", 3.2, 0.01, verdict="under")
    assert known.events == (Event(unix_s=3.9 * DAY, changed="propeller 3"),)
    assert known.days == 3
    assert hangar.names() == ("north",)


def test_a_late_log_takes_its_place_by_its_date(hangar: Hangar):
    for name, day, offset in (("b", 4.2, 0.05), ("a", 3.2, 0.01)):
        hangar.add_flight("north", row(name, day, offset))
    known = hangar.load("north")
    assert [flight.flight for flight in known.lessons] == ["a", "b"]
    assert known.state_before(4.0 * DAY, 4).offset[0] < 0.0101


def test_a_flight_that_may_not_teach_moves_no_state(hangar: Hangar):
    before = hangar.load("north").state_before(9.2 * DAY, 4)
    hangar.add_flight("north", row("bad", 5.2, 0.2, not_taught=NotTaught.FAULT))
    after = hangar.load("north").state_before(9.2 * DAY, 4)
    assert after.offset == before.offset


def test_a_lesson_is_taken_once_and_undone_whole(hangar: Hangar):
    before = hangar.load("north")
    hangar.add_flight("north", row("a", 3.2, 0.03))
    once = hangar.load("north")
    hangar.add_flight("north", row("a", 3.2, 0.03))
    assert hangar.load("north") == once
    assert hangar.forget("north", "a")
    assert hangar.load("north") == before
    assert not hangar.forget("north", "a")


def test_an_unknown_aircraft_is_refused_with_those_that_are_known(hangar: Hangar):
    with pytest.raises(DataError, match=r"no aircraft south .* known: north"):
        hangar.load("south")
    with pytest.raises(DataError, match="letters, digits"):
        hangar.load("../south")


def test_a_damaged_file_is_named(hangar: Hangar):
    path = hangar.folder / "aircraft/north/flights/a.json"
    path.write_text('{"schema": "thrustmargin.aircraft-flight/1", "flight": 3}')
    with pytest.raises(DataError, match=r"flights/a\.json: .*log_name is missing"):
        hangar.load("north")
    path.write_text('{"schema": "thrustmargin.aircraft-flight/9"}')
    with pytest.raises(DataError, match="this version reads"):
        hangar.load("north")


WRITER = """
import sys
from pathlib import Path
from tests.gcs_plugin.store.test_hangar import row
from thrustmargin.gcs_plugin.store.hangar import Hangar
hangar = Hangar(Path(sys.argv[1]))
print("writes", flush=True)
for k in range(100_000):
    hangar.add_flight("north", row(f"{sys.argv[2]}{k % 20}", 3.0 + 0.01 * (k % 20), 0.001 * k))
"""


def test_killed_writers_leave_every_file_whole(hangar: Hangar):
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, str(hangar.folder), name],
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[3],
        )
        for name in ("a", "a")
    ]
    for one in writers:
        assert one.stdout is not None
        one.stdout.readline()
    folder = hangar.folder / "aircraft/north/flights"
    ends = time.monotonic() + 60.0
    while len(list(folder.glob("a*.json"))) < 20 and time.monotonic() < ends:
        time.sleep(0.01)
    for one in writers:
        one.kill()
        one.communicate()
    assert len(hangar.load("north").flights) == 21


def test_a_disk_that_refuses_loses_nothing(hangar: Hangar, monkeypatch):
    before = hangar.load("north")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(DataError, match=r"cannot write .*No space left"):
        hangar.add_flight("north", row("a", 3.2))
    monkeypatch.undo()
    assert hangar.load("north") == before
    assert not list((hangar.folder / "aircraft/north/flights").glob(".*"))


def test_the_hangar_is_the_folder_given_else_that_of_the_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("THRUSTMARGIN_HANGAR", str(tmp_path / "named"))
    assert open_hangar().folder == tmp_path / "named"
    assert open_hangar(tmp_path / "given").folder == tmp_path / "given"
    monkeypatch.delenv("THRUSTMARGIN_HANGAR")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert open_hangar().folder == tmp_path / "thrustmargin" / "hangar"


def test_a_row_holds_numbers_and_kinds_alone(hangar: Hangar):
    hangar.add_flight("north", row("a", 3.2, not_taught=NotTaught.LOAD))
    text = (hangar.folder / "aircraft/north/flights/a.json").read_text()
    kept = json.loads(text)
    assert kept["not_taught"] == "the load is not the one reported"
    assert kept["offsets"]["offset"] == [0.0, 0.0, 0.0, 0.0]


def test_power_and_battery_are_those_of_the_trusted_flights_before(hangar: Hangar):
    for name, day, watts, ohm, why in (
        ("a", 3.2, 1.0e-8, 0.02, None),
        ("b", 4.2, 4.0e-8, 0.02, NotTaught.LOAD),
        ("bad", 4.5, 9.0e-8, 0.09, NotTaught.FAULT),
        ("later", 9.2, 9.0e-8, 0.09, None),
    ):
        hangar.add_flight(
            "north",
            row(name, day, power_coefficient=watts, battery_ohm=ohm, battery_ohm_error=0.001,
                rest_voltage=50.0 + day, not_taught=why),
        )  # fmt: skip
    known = hangar.load("north")
    law = known.power_before(5.0 * DAY)
    assert law is not None
    assert [one.flight for one in law.flights] == ["a", "b"]
    assert law.coefficient == pytest.approx(2.0e-8)
    battery = known.battery_before(5.0 * DAY)
    assert battery.rest_voltage == pytest.approx(53.7)
    assert battery.resistance == pytest.approx(0.02)
    assert known.power_before(2.0 * DAY) is None  # the flight it was trained on has no current


def test_a_row_of_an_older_version_is_read(hangar: Hangar):
    hangar.add_flight("north", row("a", 3.2))
    path = hangar.folder / "aircraft/north/flights/a.json"
    kept = json.loads(path.read_text())
    for later in ("battery_ohm", "battery_ohm_error", "charge_used_ah"):
        del kept[later]
    path.write_text(json.dumps(kept))
    known = hangar.load("north")
    assert known.flights[-1].flight == "a"
    assert math.isnan(known.flights[-1].battery_ohm)
    assert math.isnan(known.battery_before().resistance)


@pytest.mark.parametrize(
    ("level", "noted", "sound", "grounds", "left_open"),
    [
        ("damaged", False, False, True, False),
        ("damaged", True, False, False, True),
        ("damaged", False, True, False, True),
        ("damaged", True, True, False, False),
        ("lost", False, True, True, False),
        ("battery", True, True, False, False),
        ("critical", False, False, False, False),
    ],
)
def test_a_bad_flight_grounds_until_a_repair_is_noted_and_flown(
    hangar: Hangar, level, noted, sound, grounds, left_open
):
    bad = row("a", 3.2, verdict=level, suspects=(3,), not_taught=NotTaught.FAULT)
    hangar.add_flight("north", bad)
    if noted:
        hangar.add_event("north", Event(unix_s=3.9 * DAY, changed="propeller 3"))
    if sound:
        hangar.add_flight("north", row("b", 4.2, verdict="under"))
    made = hangar.load("north").clearance()
    assert (made.level == level) is grounds
    assert (made.rotors == (3,)) is grounds
    assert bool(made.conditions) is left_open


def test_what_the_last_flight_did_not_show_is_open(hangar: Hangar):
    unread = row("a", 3.2, verdict="unknown", not_taught=NotTaught.NO_VERDICT)
    hangar.add_flight("north", unread)
    assert hangar.load("north").clearance().caveats == ("weak rotors not looked for",)
    hangar.add_flight("north", row("b", 4.2, verdict="under"))
    assert not hangar.load("north").clearance().conditions
    ends = row("c", 5.2, verdict="under", caveats=(Caveat.UNSEEN, Caveat.GAUGE))
    hangar.add_flight("north", ends)
    assert hangar.load("north").clearance().caveats == (Caveat.UNSEEN, Caveat.GAUGE)


def test_a_row_of_an_earlier_version_keeps_the_rotors_of_its_faults(hangar: Hangar):
    old = row("a", 3.2, verdict="damaged", fault_kinds=("propeller",), suspects=(3,))
    assert old.fault_rotors == (3,)
    pair = row("b", 4.2, fault_kinds=("propeller",), fault_rotors=(2,), suspects=(2, 4))
    hangar.add_flight("north", pair)
    kept = hangar.load("north").flights[-1]
    assert (kept.fault_rotors, kept.suspects) == ((2,), (2, 4))
