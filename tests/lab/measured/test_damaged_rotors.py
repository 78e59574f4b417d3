"""The scorer of damaged rotors: what counts as right, and that it reads names of files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.measured import damaged_rotors as scorer
from tests.lab.measured.public_runs import Answer, Run, identify, run
from thrustmargin.models.errors import DataError

DONE = Run(words=("identify",), code=0, seconds=1.0, output="", errors="")


def verdict(damaged: set[int], answer: Answer) -> str:
    return scorer.Judged(name="x", damaged=frozenset(damaged), answer=answer).verdict


@pytest.mark.parametrize(
    ("damaged", "named", "listed", "said"),
    [
        ({3}, (3,), (), "named"),
        ({3}, (), (1, 3), "listed"),
        ({3}, (), (1,), "missed"),
        ({3}, (1,), (3,), "wrong"),
        ({3}, (1, 3), (), "wrong"),
        ({1, 2}, (2,), (), "named"),
        (set(), (), (2,), "nothing"),
        (set(), (2,), (), "false"),
    ],
)
def test_a_wrong_rotor_is_wrong_whatever_else_is_right(damaged, named, listed, said):
    effects = tuple(f"rotor_degradation {k}" for k in named)
    answer = Answer(run=DONE, named=named, listed=listed, effects=effects, result={"effects": []})
    assert verdict(damaged, answer) == said


def test_the_rotor_to_look_at_first_is_right_or_wrong_too():
    pointed = Answer(run=DONE, pointed=(1, 3), result={"effects": []})
    assert verdict({3}, pointed) == "pointed"
    assert verdict({2}, pointed) == "missed"
    assert verdict(set(), pointed) == "false"


def test_any_name_on_a_healthy_aircraft_is_false():
    answer = Answer(run=DONE, effects=("extra_mass",), result={"effects": []})
    assert verdict(set(), answer) == "false"


def test_a_command_that_ends_in_a_traceback_or_a_refusal_is_counted_as_that():
    broken = Run(
        words=(),
        code=1,
        seconds=1.0,
        output="",
        errors="Traceback (most recent call last):\nValueError: x",
    )
    refused = Run(words=(), code=1, seconds=1.0, output="", errors="a.csv: no row in flight\n")
    assert verdict({3}, Answer(run=broken)) == "traceback"
    assert verdict({3}, Answer(run=refused)) == "refused: a.csv: no row in flight"


def test_the_rotors_and_the_cut_are_read_from_the_names():
    assert scorer._rotors("cut_M2_1mm_1mm_45mm_M1_1mm_1mm_45mm") == (1, 2)
    assert scorer._rotors("cut_m3_2mm_2mm") == (3,)
    assert scorer._cut("25_mm_cut_hover_1") == 25
    assert scorer._cut("good_prop_hover_1.BIN") == 0


def test_what_the_program_refuses_reaches_the_scorer_in_its_own_words(tmp_path: Path):
    log = tmp_path / "flight.csv"
    log.write_text("a,b\n1,2\n", encoding="utf-8")
    answer = identify([log], "--airframe", "topxgun-f16", into=tmp_path)
    assert answer.run.code != 0
    assert "flight.csv" in answer.run.refusal
    assert run("identify", "--nonsense").code != 0


def test_a_folder_without_healthy_flights_says_so(tmp_path: Path):
    with pytest.raises(DataError, match="no file normal_flight"):
        scorer.find_sessions(tmp_path)
    with pytest.raises(DataError, match="0 logs good_prop"):
        scorer.find_logs(tmp_path)
