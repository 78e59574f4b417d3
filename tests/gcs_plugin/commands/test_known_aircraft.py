"""An aircraft that is known: recognised by its log, predicted by its state, taught by landings."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from tests.kinds_of_logs import KINDS
from tests.known_aircraft import BOARD_LOG, hangar_with_north
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.hangar import Event, Hangar

LOGS = Path("sitl_logs")
LOG = LOGS / "campaign/v4_m16_q2.5.tlog"
WORN = LOGS / "onset/worn_prop_onset.tlog"


@pytest.fixture
def hangar(tmp_path: Path) -> Hangar:
    """A hangar with the simulated F16 under the name north, as its shipped model predicts it."""
    return hangar_with_north(tmp_path / "hangar")


def reported(hangar: Hangar, *words: str) -> dict:
    """The report of a log as JSON, of an aircraft of the hangar."""
    out = hangar.folder.parent / "r.json"
    assert run(["report", *words, "--hangar", str(hangar.folder), "--json", str(out)]) == 0
    return json.loads(out.read_text())["flights"][0]


def test_a_named_aircraft_is_predicted_by_its_state_and_taught_once(hangar, capsys):
    reported(hangar, str(LOG), "--aircraft", "north")
    assert "aircraft north: no flight has taught its model yet" in capsys.readouterr().out
    (first,) = hangar.load("north").flights
    assert first.log_name == LOG.name
    assert first.not_taught is None
    assert first.coverage > 0.85
    assert abs(first.offsets.offset[0]) < 0.01  # the shipped model is of this aircraft
    reported(hangar, str(LOG), "--aircraft", "north")
    assert hangar.load("north").flights == (first,)  # the same flight once, not by its own lesson


def test_a_flight_with_a_bad_rotor_is_named_as_before_and_teaches_nothing(hangar, capsys):
    reported(hangar, str(WORN), "--aircraft", "north")
    said = capsys.readouterr().out
    assert "ROTOR 3, FRONT LEFT: 12 % LESS THRUST" in said
    known = hangar.load("north")
    assert known.flights[0].not_taught == "a bad part"
    assert known.lessons == ()


def test_nothing_is_written_where_nothing_may_be_learnt(hangar, capsys):
    reported(hangar, str(LOG), "--aircraft", "north", "--no-learn")
    assert "aircraft north" in capsys.readouterr().out
    assert hangar.load("north").flights == ()


def test_a_log_with_the_marks_of_a_known_aircraft_needs_no_option(hangar, capsys):
    reported(hangar, str(BOARD_LOG))
    assert "aircraft north" in capsys.readouterr().out
    assert len(hangar.load("north").flights) == 1


def test_a_log_that_may_be_of_it_is_asked_for_and_read_as_before(hangar, capsys):
    reported(hangar, str(LOG))  # a station's recording with few parameters
    said = capsys.readouterr()
    assert "its aircraft may be that of north" in said.err
    assert "the flight fits it (4 rotors" in said.out
    assert hangar.load("north").flights == ()


def test_a_repair_is_noted_and_a_flight_forgotten_by_its_log(hangar, capsys):
    reported(hangar, str(LOG), "--aircraft", "north")
    place = ["--hangar", str(hangar.folder)]
    assert run(["aircraft", "north", "--changed", "propeller 3", "--on", "2026-05-31", *place]) == 0
    assert [event.changed for event in hangar.load("north").events] == ["propeller 3"]
    capsys.readouterr()
    assert run(["aircraft", "north", *place]) == 0
    said = capsys.readouterr().out
    assert "changed: propeller 3" in said
    assert LOG.name in said
    assert run(["aircraft", "north", "--forget", LOG.name, *place]) == 0
    assert hangar.load("north").flights == ()
    assert run(["aircraft", "north", "--forget", LOG.name, *place]) == 1
    assert run(["aircraft", "north", "--changed", "x", "--on", "soon", *place]) == 1
    assert run(["aircraft", *place]) == 0
    assert "north: 0 flights" in capsys.readouterr().out


def test_fill_and_replay_take_the_aircraft_by_its_name(hangar, capsys):
    place = ["--aircraft", "north", "--hangar", str(hangar.folder)]
    assert run(["fill", *place, "--air-temperature", "15"]) == 0
    assert "kg" in capsys.readouterr().out
    assert run(["fill", "--aircraft", "south", "--hangar", str(hangar.folder)]) == 1
    assert "no aircraft south" in capsys.readouterr().err


def test_fill_and_forecast_name_the_last_flight_that_they_know(hangar, capsys, tmp_path):
    place = ["--aircraft", "north", "--hangar", str(hangar.folder)]
    files = [tmp_path / "fill.json", tmp_path / "forecast.json"]
    assert run(["fill", *place, "--json", str(files[0])]) == 0
    assert json.loads(files[0].read_text())["known_from"]["last_log"] is None
    reported(hangar, str(LOG), "--aircraft", "north")
    capsys.readouterr()
    plan = str(LOG.with_name("v4_m4_q2.5.tlog"))
    assert run(["fill", *place, "--json", str(files[0])]) == 0
    assert run(["forecast", plan, "--fill", "4", *place, "--json", str(files[1])]) == 0
    said = " ".join(capsys.readouterr().out.split())
    begun = datetime.fromtimestamp(hangar.load("north").flights[0].started_unix_s, UTC)
    known = (
        f"ircraft north, known from 1 flight; its last flight with a verdict is {LOG.name} of "
        f"{begun:%Y-%m-%d}: what came after it is not known"
    )
    assert said.count(known) == 2
    for file in files:
        assert json.loads(file.read_text())["known_from"] == {
            "aircraft": "north",
            "flights": 1,
            "days": 1,
            "last_log": LOG.name,
            "last_flight": begun.isoformat(timespec="seconds"),
        }


def test_a_flown_mission_is_kept_beside_its_forecast_and_shown(hangar, capsys):
    reported(hangar, str(LOG), "--aircraft", "north")
    (row,) = hangar.load("north").flights
    assert row.mission is not None
    assert row.mission.seconds.flown == pytest.approx(row.mission.seconds.said, rel=0.1)
    assert row.mission.leg_use.flown == pytest.approx(row.mission.leg_use.said, abs=0.05)
    capsys.readouterr()
    assert run(["aircraft", "north", "--hangar", str(hangar.folder)]) == 0
    said = capsys.readouterr().out
    assert f"{LOG.name}: its forecast said" in said
    assert "at rest before take-off" in said


def test_the_last_flight_of_an_aircraft_is_heard_by_fill_and_forecast(hangar, capsys):
    """Until a repair is noted there is no fill; then it is a condition."""
    place = ["--aircraft", "north", "--hangar", str(hangar.folder)]
    reported(hangar, str(WORN), "--aircraft", "north")
    capsys.readouterr()
    bad = "a rotor or motor was bad in its last flight, worn_prop_onset.tlog (rotor 3)"
    assert run(["fill", *place, "--air-temperature", "15"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"No fill before it was looked at: {bad}\n")
    assert "Fill at most" not in said
    plan = ["forecast", str(LOG.with_name("v4_m4_q2.5.tlog")), "--fill", "4", *place]
    assert run([*plan, "--json", str(hangar.folder.parent / "f.json")]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"DO NOT TAKE OFF WITH 4.0 kg (4.0 L): {bad}\n")
    assert "propeller, motor and ESC of rotor 3 were looked at" in said.splitlines()[1]
    made = json.loads((hangar.folder.parent / "f.json").read_text())
    assert made["verdict"]["level"] == "damaged"
    assert made["fill_kg"] is None
    name = ["aircraft", "north", "--hangar", str(hangar.folder)]
    assert run([*name, "--changed", "propeller 3"]) == 0
    capsys.readouterr()
    assert run(plan) == 0
    said = capsys.readouterr().out
    assert "ONLY IF WHAT WAS BAD IN AN EARLIER FLIGHT WAS REPAIRED: " in said.splitlines()[0]
    assert run(["fill", *place, "--air-temperature", "15"]) == 0
    assert "ONLY IF WHAT WAS BAD IN AN EARLIER FLIGHT WAS REPAIRED." in capsys.readouterr().out


def test_what_the_last_flight_left_open_is_a_condition_of_fill_and_forecast(
    hangar, capsys, tmp_path
):
    place = ["--aircraft", "north", "--hangar", str(hangar.folder)]
    ends = KINDS["truncated"](tmp_path)
    reported(hangar, str(ends), "--aircraft", "north")
    capsys.readouterr()
    open_ = "ITS LAST FLIGHT WENT WELL (A PART OF IT IS NOT IN THE LOG)"
    assert run(["fill", *place, "--air-temperature", "15"]) == 0
    assert f" ONLY IF {open_}. " in " ".join(capsys.readouterr().out.split())
    assert run(["forecast", str(LOG.with_name("v4_m4_q2.5.tlog")), "--fill", "4", *place]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith(f"TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF {open_}: ")


def test_the_mission_of_a_damaged_flight_counts_for_no_forecast(hangar, capsys):
    reported(hangar, str(LOGS / "dev/worn_prop_1.tlog"), "--aircraft", "north")
    known = hangar.load("north")
    assert known.flights[0].mission is not None
    assert known.flights_before(float("inf")) == ()
    capsys.readouterr()
    assert run(["aircraft", "north", "--hangar", str(hangar.folder)]) == 0
    said = capsys.readouterr().out
    assert "do not fly: a rotor or motor was bad in its last flight" in said
    (line,) = [one for one in said.splitlines() if "its forecast said" in one]
    assert line.endswith("; counts for no forecast: a bad part")


HEAVIER = [str(LOGS / f"dev/extra_mass_{k}.tlog") for k in (1, 2)]


def test_a_change_is_said_first_searched_by_itself_and_stays_until_noted(hangar, capsys):
    place = ["--aircraft", "north", "--hangar", str(hangar.folder)]
    sound = [str(LOGS / f"campaign/v{k}_m10_q2.5.tlog") for k in (2, 4)]
    assert run(["report", *sound, *place, "--json", str(hangar.folder.parent / "s.json")]) == 0
    said = reported(hangar, HEAVIER[0], "--aircraft", "north")["verdict"]
    assert said["facts"][0]["label"] == "changed"
    change = said["change"]
    assert change["kind"] == "offset"
    (mode,) = change["modes"]
    assert mode["mode"] == "collective"
    assert mode["faster"] == [1, 2, 3, 4]
    assert 70.0 < mode["low_rpm"] < mode["rpm"] < mode["high_rpm"] < 110.0
    assert change["since_log"] == "extra_mass_1.tlog"
    assert change["mass_kg"] == pytest.approx(3.0, abs=0.2)  # that simulation carried 3 kg
    found = change["explanation"]
    assert found["kind"] == "named"
    (effect,) = found["effects"]
    assert effect["effect"] == "extra_mass"
    assert effect["low"] < 3.0 < effect["high"]
    assert found["error_after_rpm"] < 0.3 * found["error_before_rpm"]
    # The state has followed it by now, but nobody has said what it is.
    again = reported(hangar, HEAVIER[1], "--aircraft", "north", "--no-learn")["verdict"]["change"]
    assert again["since_log"] == "extra_mass_1.tlog"
    assert again["mass_kg"] == pytest.approx(3.0, abs=0.3)
    capsys.readouterr()
    assert run(["aircraft", "north", *place[2:]]) == 0
    assert "as if it were 3 kg" in capsys.readouterr().out
    noted = hangar.load("north").flights[-1].started_unix_s + 1.0
    hangar.add_event("north", Event(unix_s=noted, changed="pump"))
    after = reported(hangar, HEAVIER[1], "--aircraft", "north", "--no-learn")["verdict"]["change"]
    assert after is None
