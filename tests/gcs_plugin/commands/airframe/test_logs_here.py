"""A folder of logs: `airframe new` finds those of every format that is read."""

from pathlib import Path

from thrustmargin.gcs_plugin.commands.airframe.questions import logs_here


def test_logs_of_every_format_are_found_and_the_tables_of_reports_are_not(tmp_path: Path):
    names = ("a.BIN", "b.log", "c.tlog", "d.ulg", "e.ulog", "e.csv", "e.json", "e.html")
    for name in names:
        (tmp_path / name).touch()
    assert [path.name for path in logs_here(tmp_path)] == [*names[:5]]
