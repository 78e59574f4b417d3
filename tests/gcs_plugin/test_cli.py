"""The command line as a whole: exit codes, help, and one line where something does not work."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin import cli
from thrustmargin.gcs_plugin.cli import COMMANDS, command_function, run

MAIN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"
FLIGHT = "sitl_logs/campaign/v4_m16_q2.5.tlog"


def started(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """`thrustmargin` as a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", MAIN, *words],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_function_of_its_name_with_an_example(name: str):
    function = command_function(name)
    assert function.__name__ == name
    assert f"Example: thrustmargin {name}" in (function.__doc__ or "")
    assert " ".join((function.__doc__ or "").split()).startswith(COMMANDS[name])


def test_what_does_not_work_is_one_line_and_exit_1(tmp_path: Path, capsys):
    assert run(["report", str(tmp_path / "none.tlog"), "--out", str(tmp_path / "r.html")]) == 1
    said = capsys.readouterr()
    assert "none.tlog" in said.err
    assert "Traceback" not in said.err


@pytest.mark.parametrize(
    ("typed", "meant"), [("raport", "report"), ("identfy", "identify"), ("Replay", "replay")]
)
def test_a_mistyped_command_is_exit_2_and_the_one_that_is_meant(typed, meant, capsys):
    with pytest.raises(SystemExit) as ended:
        run([typed, "some.tlog"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert f"did you mean {meant}" in said
    assert said.count("\n") == 1
    with pytest.raises(SystemExit):
        run(["xyzzy"])
    assert "did you mean" not in capsys.readouterr().err


def test_help_and_version(capsys):
    from importlib.metadata import version

    assert run(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"  {name}" in said for name in COMMANDS)
    assert run([]) == 2
    assert capsys.readouterr().err == said
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"thrustmargin {version('thrustmargin')}\n"


def test_help_loads_nothing_heavy_and_a_report_no_scipy():
    code = f"{MAIN.replace('main(sys.argv[1:])', '')}from thrustmargin.gcs_plugin.cli import run\n"
    code += "run(['--help']); light = set(sys.modules)\n"
    code += "assert not {'numpy', 'tyro', 'rich', 'pymavlink', 'asyncio'} & light\n"
    code += "try: run(['report', '--help'])\nexcept SystemExit: pass\n"
    code += "assert not {'numpy', 'pymavlink', 'plotly', 'scipy'} & set(sys.modules)\n"
    code += "import thrustmargin.gcs_plugin.reports.margin; assert 'scipy' not in sys.modules\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("asked", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_a_command_computes_with_one_thread_unless_more_are_asked_for(asked, threads):
    """Whatever other libraries are allowed."""
    code = "import sys; from thrustmargin.gcs_plugin.cli import main\n"
    code += "try: main(['fill', '--airframe', 'topxgun-f16'])\nfinally:\n"
    code += "  from threadpoolctl import threadpool_info\n"
    code += "  print({pool['num_threads'] for pool in threadpool_info()}, file=sys.stderr)"
    others = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**others, "OMP_NUM_THREADS": "2", **asked},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == f"{{{min(threads, os.cpu_count() or 1)}}}\n"


def test_json_to_standard_output_is_json_and_nothing_else(sitl_logs, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    flight = str(sitl_logs / "campaign" / "v4_m16_q2.5.tlog")
    for command, look in (
        ("inspect", lambda found: found[0]),
        ("report", lambda found: found["flights"][0]),
    ):
        assert run([command, flight, "--json", "-"]) == 0
        assert look(json.loads(capfd.readouterr().out))
        assert list(tmp_path.iterdir()) == []
    assert run(["report", flight, "--json", "-", "--out", "page.html"]) == 0
    assert json.loads(capfd.readouterr().out)["flights"]
    assert {path.name for path in tmp_path.iterdir()} == {"page.html", "page.json", "page.csv"}


def test_json_never_takes_a_log_as_its_file(sitl_logs, tmp_path, capsys):
    flight = tmp_path / "flight.tlog"
    flight.write_bytes(b"a log that is kept")
    for command in ("inspect", "report"):
        assert run([command, str(sitl_logs / "dev" / "none.tlog"), "--json", str(flight)]) == 2
        assert "end its name in .json" in capsys.readouterr().err
    assert flight.read_bytes() == b"a log that is kept"


@pytest.mark.slow
def test_quiet_says_nothing_but_errors(sitl_logs, tmp_path, monkeypatch, capfd):
    flight = str(sitl_logs / "campaign" / "v4_m16_q2.5.tlog")
    done = started("report", "--quiet", flight, "--out", "r.html", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "r.html").exists()
    assert "--quiet" not in (tmp_path / "r.json").read_text()
    monkeypatch.setenv("THRUSTMARGIN_QUIET", "")  # of this process, until the test ends
    assert run(["inspect", "none.tlog", "--quiet"]) == 1
    assert "none.tlog" in capfd.readouterr().err
    assert run(["inspect", flight, "--json", "-", "--quiet"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)
    assert said.err == ""


@pytest.mark.parametrize(
    "words",
    [
        ("inspect", "{}"),
        ("report", "{}"),
        ("replay", "{}", "--no-browser"),
        ("identify", "{}"),
        ("train", "{}"),
        ("stream", "{}"),
    ],
    ids=lambda words: words[0],
)
@pytest.mark.parametrize("kind", ["missing", "empty", "noise", "folder"])
def test_an_error_names_its_file_once(words, kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "oddfile.tlog"
    if kind == "empty":
        path.write_bytes(b"")
    elif kind == "noise":
        path.write_bytes(bytes(range(256)) * 40)
    elif kind == "folder":
        path.mkdir()
    assert run([word.format(path) for word in words]) == 1
    told = capsys.readouterr().err
    assert told.count("oddfile") == 1, told
    assert "Traceback" not in told


def test_descriptions_of_options_are_wrapped_by_the_terminal_alone():
    described = command_function("report").__doc__ or ""
    assert "without an airframe, the one that ships is used for a flight" in described


def refused(line: str, code: int, folder: Path, monkeypatch, capsys) -> str:
    """What is said of a line that ends with a code, run in a folder."""
    monkeypatch.chdir(folder)
    assert run(line.split()) == code
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "report demo --air-temperature 99",
        "report demo --load -1",
        "report demo --tank barrel",
        "report demo --max-utilisation 2",
        "report demo --out report.txt",
        "fill --airframe topxgun-f16 --air-temperature 99",
        "forecast demo --fill 99",
        "replay demo --port 99999",
        "demo --port 99999",
    ],
)
def test_a_wrong_command_line_is_exit_2_before_any_log_is_read(line, tmp_path, monkeypatch, capsys):
    said = refused(line, 2, tmp_path, monkeypatch, capsys)
    assert said.startswith("thrustmargin: ")
    assert "v4_m16_q2.5" not in said


@pytest.mark.parametrize(
    "line",
    [
        "report none.tlog",
        "report demo --airframe none",
        "report demo --out none/report.html",
        "forecast none.plan --fill 1",
        "forecast demo --fill 1 --sorties none",
        "cover none.kml --swath 5",
    ],
)
def test_what_is_named_and_not_there_is_exit_1(line, tmp_path, monkeypatch, capsys):
    assert "none" in refused(line, 1, tmp_path, monkeypatch, capsys)


@pytest.mark.parametrize("cause", [KeyboardInterrupt(), None])
def test_ctrl_c_in_an_import_is_ctrl_c_and_another_import_error_is_not(cause, monkeypatch, capsys):
    def broken(_: object) -> None:
        raise ImportError("initialization failed") from cause

    monkeypatch.setattr(cli, "_answer", broken)
    if cause is None:
        with pytest.raises(ImportError):
            run(["report"])
        return
    assert run(["report"]) == 130
    assert "stopped" in capsys.readouterr().err
