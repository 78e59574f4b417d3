"""The command line as a whole: exit codes, and one line where something does not work."""

from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import COMMANDS, command_function, run


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_function_of_its_name_with_an_example(name: str):
    function = command_function(name)
    assert function.__name__ == name
    assert f"Example: thrustmargin {name}" in (function.__doc__ or "")


def test_what_does_not_work_is_one_line_and_exit_1(tmp_path: Path, capsys):
    assert run(["report", str(tmp_path / "none.tlog"), "--out", str(tmp_path / "r.html")]) == 1
    said = capsys.readouterr()
    assert "none.tlog" in said.err
    assert "Traceback" not in said.err


def test_a_wrong_command_line_is_exit_2(capsys):
    with pytest.raises(SystemExit) as ended:
        run(["raport"])
    assert ended.value.code == 2
    assert "raport" in capsys.readouterr().err
