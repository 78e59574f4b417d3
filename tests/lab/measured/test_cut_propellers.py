"""A real quad with one propeller cut, motor outputs only: which motor, from one log at a time.

Read where THRUSTMARGIN_MEASURED has `cut_propeller_quad`; docs/measured.md has what is known of it.
"""

from pathlib import Path

import pytest

from tests.lab.measured.damaged_rotors import CUT_ROTOR, QUAD
from tests.lab.measured.public_runs import identify, run

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


def learnt(folder: Path, airframe: Path, without: str = "") -> Path:
    logs = [log for log in sorted(folder.glob("good_prop_*.BIN")) if log.stem != without]
    out = airframe.with_name(f"without-{without}.safetensors")
    assert run("train", *logs, "--airframe", airframe, "--out", out).code == 0
    return out


@pytest.fixture(scope="module")
def sound(folder: Path, airframe: Path) -> Path:
    return learnt(folder, airframe)


@pytest.mark.parametrize("log", ["hover_1", "hover_2", "straight_line_1", "straight_line_2"])
def test_a_propeller_cut_by_25_mm_is_said_from_each_log(folder, sound, tmp_path, log):
    said = identify([folder / f"25_mm_cut_{log}.BIN"], "--model", sound, into=tmp_path)
    assert (*said.named, *said.listed) == (CUT_ROTOR,)


def test_four_logs_together_name_the_motor(folder, sound, tmp_path):
    logs = sorted(folder.glob("25_mm_cut_*.BIN"))
    assert identify(logs, "--model", sound, into=tmp_path).named == (CUT_ROTOR,)


# All four, each by a model of its own: `make measured` (damaged_rotors.py).
@pytest.mark.parametrize("log", ["hover_1", "straight_line_1"])
def test_whole_propellers_that_were_not_learnt_from_get_no_name(folder, airframe, tmp_path, log):
    name = f"good_prop_{log}"
    model = learnt(folder, airframe, without=name)
    assert identify([folder / f"{name}.BIN"], "--model", model, into=tmp_path).effects == ()


@pytest.mark.parametrize("log", ["hover_1", "hover_2", "straight_line_1", "straight_line_2"])
def test_a_cut_of_10_mm_is_inside_what_sound_flights_show(folder, sound, tmp_path, log):
    said = identify([folder / f"10_mm_cut_{log}.BIN"], "--model", sound, into=tmp_path)
    assert said.named == ()
