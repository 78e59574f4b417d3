"""What several commands check alike: the limit of thrust utilisation, and places to write."""

from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.options import (
    OutputFile,
    check_outputs,
    check_utilisation,
    refuse_renamed,
)
from thrustmargin.models.errors import DataError


@pytest.mark.parametrize(
    ("argv", "same"),
    [
        (["report", "a.tlog", "--limit", "0.6"], "thrust in use of --limit 0.6 write {} 0.6"),
        (["report", "--limit=0.4", "a.tlog"], "thrust in use of --limit 0.4 write {} 0.4"),
        (["monitor", "--limit", "0.6"], "thrust margin of --limit 0.6 write {} 0.4"),
        (["monitor", "--limit=0.45"], "thrust margin of --limit 0.45 write {} 0.55"),
        (["monitor", "--limit"], "thrust margin of --limit 0.5 write {} 0.5"),
    ],
)
def test_the_old_limit_ends_with_its_new_name_and_the_same_value(argv, same, capsys):
    """Thrust in use in one command and margin in the other: a silent change would be dangerous."""
    assert run(argv) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert same.format("--max-utilisation") in said.err


def test_other_commands_and_values_are_left_alone():
    for argv in ([], ["stream", "--limit", "1"], ["report", "a--limit.tlog", "--out", "b.html"]):
        refuse_renamed(argv)


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
