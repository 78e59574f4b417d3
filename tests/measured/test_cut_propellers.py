"""A real quad with one propeller cut, motor outputs only: which motor, from one log at a time.

Read where THRUSTMARGIN_MEASURED has `cut_propeller_quad`; docs/measured.md has what is known of it.
"""

from pathlib import Path

import pytest

from tests.measured.damaged_rotors import CUT_ROTOR, QUAD
from tests.measured.public_runs import identify, run

pytestmark = [pytest.mark.measured, pytest.mark.slow]


@pytest.fixture(scope="module")
def folder(measured_folder: Path) -> Path:
    folder = measured_folder / "cut_propeller_quad"
    if not folder.is_dir():
        pytest.skip("no cut_propeller_quad in the folder of measured data")
    return folder


@pytest.fixture(scope="module")
def airframe(folder: Path, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("cut") / "quad.toml"
    hover = sorted(folder.glob("good_prop_hover_*.BIN"))
    assert run("airframe", "new", "--hover", *hover, *QUAD, "--out", out).code == 0
    return out


def learnt(folder: Path, airframe: Path, pattern: str, name: str) -> Path:
    """A model of the sound flights whose names have the pattern."""
    logs = sorted(folder.glob(f"good_prop_{pattern}.BIN"))
    out = airframe.with_name(f"{name}.safetensors")
    assert run("train", *logs, "--airframe", airframe, "--out", out).code == 0
    return out


@pytest.fixture(scope="module")
def sound(folder: Path, airframe: Path) -> Path:
    return learnt(folder, airframe, "*", "all")


@pytest.fixture(scope="module")
def of_others(folder: Path, airframe: Path) -> dict[str, Path]:
    """Number of a flight to a model of the two sound flights that have the other number."""
    return {n: learnt(folder, airframe, f"*_{3 - int(n)}", f"without_{n}") for n in "12"}


@pytest.mark.parametrize("log", ["hover_1", "hover_2", "straight_line_1", "straight_line_2"])
def test_a_propeller_cut_by_25_mm_is_said_from_each_log(folder, sound, tmp_path, log):
    said = identify([folder / f"25_mm_cut_{log}.BIN"], "--model", sound, into=tmp_path)
    assert (*said.named, *said.listed) == (CUT_ROTOR,)


def test_four_logs_together_name_the_motor(folder, sound, tmp_path):
    logs = sorted(folder.glob("25_mm_cut_*.BIN"))
    assert identify(logs, "--model", sound, into=tmp_path).named == (CUT_ROTOR,)


@pytest.mark.parametrize("log", ["hover_1", "hover_2", "straight_line_1", "straight_line_2"])
def test_whole_propellers_that_were_not_learnt_from_get_no_name(folder, of_others, tmp_path, log):
    given = [folder / f"good_prop_{log}.BIN"]
    assert identify(given, "--model", of_others[log[-1]], into=tmp_path).effects == ()


@pytest.mark.parametrize("log", ["hover_1", "hover_2", "straight_line_1", "straight_line_2"])
def test_a_cut_of_10_mm_is_inside_what_sound_flights_show(folder, sound, tmp_path, log):
    said = identify([folder / f"10_mm_cut_{log}.BIN"], "--model", sound, into=tmp_path)
    assert said.named == ()
