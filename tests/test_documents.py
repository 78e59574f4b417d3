"""The commands of docs/your-aircraft.md run as they stand there."""

import os
import re
import shlex
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.models.physics.airframe import load_airframe

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs/your-aircraft.md").read_text(encoding="utf-8")


def commands(variable: str | None = None) -> list[list[str]]:
    """Words of each command of the blocks that use the folder `variable`, or none."""
    blocks = re.findall(r"```console\n(.*?)```", TEXT, re.S)
    mine = [
        b for b in blocks if (f"${variable}/" in b if variable else "$" not in b.replace("$ ", ""))
    ]
    lines = "".join(mine).replace("\\\n", " ").splitlines()
    return [shlex.split(os.path.expandvars(line))[2:] for line in lines if line.startswith("$ ")]


@pytest.fixture
def somewhere(tmp_path, monkeypatch) -> Path:
    """A folder of a user's own, beside the bundled flights."""
    (tmp_path / "sitl_logs").symlink_to(ROOT / "sitl_logs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_of_commands_is_run_by_a_test():
    found = sum(len(commands(v)) for v in (None, "QUIVER", "QUAD", "HEXA"))
    assert found == len(re.findall(r"^\$ thrustmargin", TEXT, re.M)) >= 15


def test_the_route_on_bundled_flights_ends_in_a_checked_airframe_and_a_report(somewhere, capsys):
    for words in commands():
        if words[0] != "identify":
            assert run(words) == 0, words
    craft = load_airframe("my-f16.toml")
    assert craft.thrust_coefficient * 1.225 / craft.reference_density == pytest.approx(
        2.011e-5, rel=0.015
    )
    assert "look" not in capsys.readouterr().out
    assert (somewhere / "my-f16.html").exists()


@pytest.mark.slow
def test_the_route_on_bundled_flights_ends_in_a_model_that_knows_the_worn_propeller(
    somewhere, capsys
):
    for words in commands():
        assert run(words) == 0, words
    assert "a weak rotor 1 (front right)" in capsys.readouterr().out
    assert (somewhere / "my-f16.safetensors").exists()


@pytest.mark.slow
@pytest.mark.measured
@pytest.mark.usefixtures("somewhere")
@pytest.mark.parametrize(
    ("variable", "folder"),
    [
        ("QUIVER", "quiver_pt1"),
        ("QUAD", "cut_propeller_quad"),
        ("HEXA", "../sitl_logs/hexa"),
    ],
)
def test_the_routes_on_measured_flights_run(variable, folder, measured_folder, monkeypatch):
    if not (measured_folder / folder).is_dir():
        pytest.skip(f"no {folder} in the folder of measured data")
    monkeypatch.setenv(variable, str((measured_folder / folder).resolve()))
    for words in commands(variable):
        assert run(words) == 0, words
