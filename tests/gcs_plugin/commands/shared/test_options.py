"""What several commands check alike: the limit of thrust utilisation, and places to write."""

from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.options import (
    OutputFile,
    check_outputs,
    check_utilisation,
)
from thrustmargin.models.errors import DataError


@pytest.mark.parametrize("command", ["report", "monitor"])
def test_the_old_limit_is_no_option(command, capsys):
    """It was thrust in use in one command and margin in the other: no value may pass for either."""
    with pytest.raises(SystemExit, match="2"):
        run([command, "a.tlog", "--limit", "0.6"])
    assert "--limit" in capsys.readouterr().err


@pytest.mark.parametrize("value", [0.0, 1.0, 50.0, -0.5, float("nan")])
def test_a_limit_that_is_no_share_is_refused(value):
    with pytest.raises(DataError, match=r"--max-utilisation .* is not a share"):
        check_utilisation(value)


def test_a_result_needs_a_place_that_harms_nothing(tmp_path: Path):
    log, there = tmp_path / "flight.csv", tmp_path / "there.json"
    log.touch()
    there.touch()
    (tmp_path / "link.csv").symlink_to(log)
    html = (".html", ".htm")
    check_outputs(
        [OutputFile("--out", tmp_path / "r.HTML", html), OutputFile("--json", None)], inputs=[]
    )
    check_outputs([OutputFile("--json", there)], inputs=[log])
    for outputs, message in (
        ([OutputFile("--out", tmp_path / "r.pdf", html)], "end its name in .html or .htm"),
        ([OutputFile("--out", tmp_path / "none" / "r.html")], "no folder .*none; .* another --out"),
        ([OutputFile("--csv", log)], "would overwrite .*flight.csv.* another --csv"),
        ([OutputFile("--csv", tmp_path / "link.csv")], "would overwrite .*flight.csv"),
        ([OutputFile("--out", tmp_path / "a"), OutputFile("--json", tmp_path / "a")], "twice"),
        ([OutputFile("--out", there, keep=True)], "already there; give another --out, or --force"),
    ):
        with pytest.raises(DataError, match=message):
            check_outputs(outputs, inputs=[log])
