"""`thrustmargin install` as it is called."""

from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run


@pytest.mark.parametrize(
    ("what", "files"),
    [
        ("mission-planner", ["thrustmargin.cs"]),
        ("vehicle-sender", ["margin_inputs.lua"]),
        ("vehicle-check", ["takeoff_check.lua"]),
        ("companion", ["Dockerfile", "bar.html", "cockpit_extras.json", "thrustmargin.service"]),
    ],
)
def test_its_files_are_copied_and_said(tmp_path: Path, capsys, what: str, files: list[str]):
    assert run(["install", what, str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert {p.name for p in tmp_path.iterdir()} >= set(files)
    for name in files:
        assert f"wrote {tmp_path / name}" in said
        assert (tmp_path / name).stat().st_size > 100
    assert "next: " in said


def test_a_file_of_the_user_is_kept_unless_forced(tmp_path: Path, capsys):
    mine = tmp_path / "thrustmargin.cs"
    mine.write_text("mine")
    assert run(["install", "mission-planner", str(tmp_path)]) == 1
    assert "already there" in capsys.readouterr().err
    assert mine.read_text() == "mine"
    assert run(["install", "mission-planner", str(tmp_path), "--force"]) == 0
    assert "MARGIN_ROT" in mine.read_text()


def test_a_folder_that_is_none_is_one_line(tmp_path: Path, capsys):
    assert run(["install", "vehicle-sender", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
