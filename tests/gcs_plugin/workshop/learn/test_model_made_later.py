"""An aircraft that one log made known gets its model when three sound flights are learnt."""

from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.hangar import Hangar, NotTaught

CAMPAIGN = Path("sitl_logs/campaign")
FIRST = CAMPAIGN / "v4_m16_q1.5.tlog"
OWNER = (
    *("--mass", "21.1", "--wheelbase", "1.6", "--tank-litres", "16", "--propeller", "24x8"),
    *("--power-set", "other", "--max-thrust-kgf", "18.45"),
)


def learn(hangar: Hangar, *words: str) -> int:
    return run(["learn", *words, "--aircraft", "f16", "--hangar", str(hangar.folder)])


@pytest.fixture
def hangar(tmp_path: Path) -> Hangar:
    """A hangar with an aircraft that one flight made known: too few for a model."""
    made = Hangar(tmp_path / "hangar")
    assert learn(made, str(FIRST), *OWNER, "--max-speed-rpm", "3000") == 0
    return made


def report(hangar: Hangar, log: Path, *words: str) -> int:
    page = str(hangar.folder.parent / "page.html")
    own = ("--aircraft", "f16", "--hangar", str(hangar.folder), "--out", page)
    return run(["report", str(log), *own, *words])


def test_a_flight_beside_its_airframe_alone_teaches_nothing_and_that_is_said(hangar, capsys):
    capsys.readouterr()
    assert learn(hangar, str(FIRST)) == 0
    said = capsys.readouterr().out
    assert "f16: no flight has made its model" in said
    assert "learn three sound flights or more together: thrustmargin learn LOGS" in said
    (row,) = hangar.load("f16").flights
    assert row.not_taught is NotTaught.MODEL
    assert report(hangar, CAMPAIGN / "v4_m4_q3.5.tlog") == 0
    said = capsys.readouterr().out
    assert "(A WORN ROTOR WOULD NOT HAVE SHOWN)" in said.splitlines()[0]
    assert "aircraft f16: no flight has taught its model yet" in said
    assert len(hangar.load("f16").flights) == 2
    assert hangar.load("f16").sound_flights == ()


def test_a_figure_that_was_stated_wrong_is_stated_again(tmp_path, capsys):
    hangar = Hangar(tmp_path / "hangar")
    assert learn(hangar, str(FIRST), *OWNER, "--max-speed-rpm", "4500") == 0
    said = capsys.readouterr()
    assert "NO VERDICT; nothing learnt" in said.out
    remedy = "make the aircraft again, with its mass, size and motors: `thrustmargin learn LOGS"
    assert remedy in " ".join(said.err.split())
    assert learn(hangar, str(FIRST), *OWNER, "--max-speed-rpm", "3000") == 0
    assert "THRUST LEFT NEAR THE 50 % LIMIT" in capsys.readouterr().out
    assert "value = 3000.0" in hangar.load("f16").airframe_file.read_text("utf-8")


@pytest.mark.slow
def test_three_sound_flights_make_its_model_and_a_weak_rotor_is_found(hangar, capsys):
    worn = Path("sitl_logs/dev/worn_prop_1.tlog")
    assert report(hangar, worn, "--no-learn") == 0
    assert "WOULD NOT HAVE SHOWN" in capsys.readouterr().out.splitlines()[0]
    three = [str(CAMPAIGN / f"v4_m{mass}_q2.5.tlog") for mass in (4, 10, 16)]
    assert learn(hangar, *three) == 0
    assert "f16: known from 3 flights on 1 day" in capsys.readouterr().out
    known = hangar.load("f16")
    assert [row.trained for row in known.flights].count(True) == 3
    assert report(hangar, worn, "--no-learn") == 0
    assert "worn_prop_1.tlog: ROTOR 1, FRONT RIGHT: 8 % LESS THRUST" in capsys.readouterr().out
    # What flights have made is not made again by the way.
    model, airframe = known.model_file.read_bytes(), known.airframe_file.read_bytes()
    assert learn(hangar, str(FIRST), *OWNER, "--max-speed-rpm", "3300") == 1
    assert "add --again" in capsys.readouterr().err
    assert learn(hangar, str(FIRST), *OWNER, "--max-speed-rpm", "3300", "--again") == 1
    assert "f16 stays as it was: 1 flight with usable rows" in capsys.readouterr().err
    assert known.model_file.read_bytes() == model
    assert known.airframe_file.read_bytes() == airframe
    assert hangar.load("f16").flights == known.flights
