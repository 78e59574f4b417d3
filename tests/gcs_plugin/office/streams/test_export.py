"""`thrustmargin export` as a user runs it: what it refuses. What it writes: reports/streams."""

import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.models import errors
from thrustmargin.models.errors import InstallError


@pytest.mark.parametrize(
    ("words", "said", "code"),
    [
        ([], "nothing to write; give --mcap FILE, --layout FILE or --grafana FILE", 2),
        (["--mcap", "f.txt"], "cannot write f.txt; end its name in .mcap", 2),
        (["--layout", "absent/l.json"], "no folder absent", 1),
    ],
)
def test_what_cannot_be_written_is_refused_before_reading(
    words, said, code, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert run(["export", str(LOG), *words]) == code
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_several_logs_is_asked_for_one(capsys, tmp_path):
    assert run(["export", str(LOG.parent), "--mcap", str(tmp_path / "f.mcap")]) == 2
    assert "name the one to write" in capsys.readouterr().err


def test_a_log_that_cannot_be_read_leaves_no_file(capsys, tmp_path):
    bad, out = tmp_path / "bad.tlog", tmp_path / "f.mcap"
    bad.write_bytes(b"nothing of a flight")
    assert run(["export", str(bad), "--mcap", str(out)]) == 1
    assert "bad.tlog" in capsys.readouterr().err
    assert not out.exists()


def test_a_missing_library_is_named_with_what_installs_it(monkeypatch):
    monkeypatch.setattr(errors, "find_spec", {"numpy": True}.get)
    errors.require("export", "numpy")
    with pytest.raises(InstallError, match=r"needs mcap.* pip install .*\[streams\]"):
        errors.require("export --mcap", "mcap")
