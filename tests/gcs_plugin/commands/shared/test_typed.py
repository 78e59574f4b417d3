"""What may be written in more than one way: the bundled flight, a limit, a folder of logs; help."""

from pathlib import Path

import pytest

from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.options import UsageError, require_logs
from thrustmargin.gcs_plugin.commands.shared.typed import as_read
from thrustmargin.models.errors import DataError

BUNDLED = ROOT / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"


@pytest.mark.parametrize(
    ("line", "read"),
    [
        ("report a --load 6 kg --load-end 1,5kg", "report a --load 6 --load-end 1.5"),
        ("report a --load=6kg", "report a --load=6"),
        (
            "airframe new --mass 21.5KG --tank-litres 16 l",
            "airframe new --mass 21.5 --tank-litres 16",
        ),
        ("forecast a --fill 6 l --wind 2", "forecast a --fill 6l --wind 2"),
        ("report a --load 6 lb", "report a --load 6 lb"),
        ("report a --load kg", "report a --load kg"),
        ("report a.tlog --max-utilisation 50%", "report a.tlog --max-utilisation 0.5"),
        ("report a.tlog --max-utilisation 47.5 %", "report a.tlog --max-utilisation 0.475"),
        ("fill --max-utilisation=60%", "fill --max-utilisation=0.6"),
        ("fill --max-utilisation 0.4", "fill --max-utilisation 0.4"),
        ("fill --max-utilisation half", "fill --max-utilisation half"),
        ("fill --name 50%", "fill --name 50%"),
        ("demo --port 8080", "demo --port 8080"),
        ("identify a --out m.safetensors", "identify a --out-model m.safetensors"),
        ("identify a --html=a.html", "identify a --out a.html"),
        ("identify a --out a.html", "identify a --out a.html"),
        ("train a --out=m.safetensors", "train a --out-model m.safetensors"),
        ("report a --out a.html", "report a --out a.html"),
        ("report --anonymise demo", f"report --anonymise {BUNDLED}"),
        ("airframe new --from demo --name demo", f"airframe new --from {BUNDLED} --name demo"),
    ],
)
def test_a_word_is_read_as_it_is_meant(line, read, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert as_read(line.split(" ")) == read.split(" ")


@pytest.mark.parametrize("command", ["forecast", "monitor", "airframe new", "record", "train"])
def test_help_names_no_default_that_is_none(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        run([*command.split(), "--help"])
    out = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "default:" in out  # others are there
    assert "(default: None)" not in out


def test_a_limit_in_one_word_may_have_a_space():
    assert as_read(["fill", "--max-utilisation", "50 %"]) == ["fill", "--max-utilisation", "0.5"]


def test_a_folder_of_the_users_own_is_meant_before_the_bundled_flight(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demo").mkdir()
    assert as_read(["report", "demo"]) == ["report", "demo"]


def test_a_folder_is_all_logs_in_it_in_the_order_of_people(tmp_path):
    for name in ("10.BIN", "2.BIN", "day 2/a.tlog", "notes.md", "report.csv", "report.html"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = [str(path.relative_to(tmp_path)) for path in require_logs([tmp_path])]
    assert found == ["2.BIN", "10.BIN", str(Path("day 2/a.tlog"))]
    assert require_logs([Path("x.BIN")]) == (Path("x.BIN"),)
    by_pattern = require_logs([tmp_path / "*.BIN", tmp_path / "day*"])
    assert [path.name for path in by_pattern] == ["2.BIN", "10.BIN", "a.tlog"]
    with pytest.raises(DataError, match=r"no log at .*\*\.ulg"):
        require_logs([tmp_path / "*.ulg"])


def test_nothing_to_work_on_is_said(tmp_path):
    with pytest.raises(DataError, match=f"no log in {tmp_path}"):
        require_logs([tmp_path])
    with pytest.raises(UsageError, match="no log given"):
        require_logs([])


@pytest.mark.parametrize("command", ["report", "fill", "airframe new", "monitor", "identify"])
def test_help_has_no_none_where_an_option_may_be_left_out(command, capsys):
    with pytest.raises(SystemExit):
        run([*command.split(), "--help"])
    shown = capsys.readouterr().out
    assert "{None}" not in shown
    assert "PATH" in shown or "STR" in shown


@pytest.mark.parametrize(
    "command", ["report demo", "fill --airframe topxgun-f16", "learn demo --store x"]
)
def test_a_limit_that_is_none_is_a_wrong_command_line_everywhere(command, capsys):
    assert run([*command.split(), "--max-utilisation", "150%"]) == 2
    assert "such as 0.5 or 50%" in capsys.readouterr().err


def test_a_replay_of_a_folder_with_several_logs_lists_them(tmp_path, capsys):
    for name in ("2.tlog", "10.tlog"):
        (tmp_path / name).touch()
    assert run(["replay", str(tmp_path)]) == 2
    assert "name one of them: 2.tlog, 10.tlog" in capsys.readouterr().err
