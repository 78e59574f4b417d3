"""`thrustmargin identify` as a user runs it: answer, JSON, model file, and what it refuses."""

import json
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.models.identification.known_terms import known_term
from tests.models.made_flights import F16, made_flight, made_flights, table
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.workshop.identify.identify import show, write_result
from thrustmargin.gcs_plugin.workshop.identify.identify_result import Result, make_result
from thrustmargin.mission.plan import read_plan
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.result import OneOf
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_model import physics_model

#: As the code has them, written down by hand: a change there is to be seen here.
TAKEOFF = 22

LOSS = 0.08
CURVE = ("--airframe", F16.name)


def written_logs(folder: Path, tracks: list[FlightTrack]) -> list[str]:
    paths = [folder / f"flight{k}.csv" for k in range(len(tracks))]
    for path, track in zip(paths, tracks, strict=True):
        write_csv(replace(track, name=path.name), path)
    return [str(path) for path in paths]


@pytest.fixture(scope="module")
def worn_logs(tmp_path_factory) -> list[str]:
    """Five flights with a worn rotor 1, as CSV."""
    return written_logs(tmp_path_factory.mktemp("worn"), made_flights(5, loss=LOSS))


@pytest.fixture(scope="module")
def done(worn_logs, tmp_path_factory):
    """One run with every output, one of them in place of a file: (folder, printed, told)."""
    folder = tmp_path_factory.mktemp("out")
    (folder / "new.safetensors").write_bytes(b"precious")
    words = [
        *worn_logs[:4],
        *("--held-out", worn_logs[4], "--airframe", F16.name),
        *("--out", str(folder / "new.safetensors"), "--json", str(folder / "found.json")),
        *("--html", str(folder / "found.html"), "--next-flight", str(folder / "next.plan")),
        "--force",
    ]
    with (
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(StringIO()) as printed,
        redirect_stderr(StringIO()) as told,
    ):
        patch.setenv("COLUMNS", "80")
        assert run(["identify", *words]) == 0
    return folder, printed.getvalue(), told.getvalue()


def doubtful_run(worn_logs: list[str], folder: Path) -> tuple[int, str, dict]:
    """Exit code, what is printed and the JSON of logs of which some cannot serve, one in part."""
    broken, short, answer = (folder / n for n in ("broken.csv", "short.csv", "answer.json"))
    broken.write_text("time_s,colour\nnever,blue\n")
    write_csv(made_flight(7, duration=8.0), short)
    track = made_flight(9)
    rpm = track.rotor_speed_rpm.copy()
    rpm[300:400, 2] = rpm[300, 2]
    output = 0.5 + 0.1 * np.sin(track.time_s[:, None] + np.arange(4.0))
    (log,) = written_logs(folder, [replace(track, rotor_speed_rpm=rpm, throttle=output)])
    words = [*worn_logs[:2], str(broken), str(short), *CURVE, "--held-out", log, "--seed", "5"]
    with redirect_stdout(StringIO()) as said:
        code = run(["identify", *words, "--json", str(answer)])
    return code, said.getvalue(), json.loads(answer.read_text())


@pytest.fixture(scope="module")
def doubtful(worn_logs, tmp_path_factory) -> tuple[int, str, dict]:
    return doubtful_run(worn_logs, tmp_path_factory.mktemp("doubtful"))


@pytest.mark.slow
def test_the_first_line_names_part_amount_and_action(done):
    first = done[1].splitlines()[0]
    assert first.startswith("Rotor 1 (front right) makes 8")
    assert first.endswith(
        "): do not fly it before propeller, motor and ESC of rotor 1 were looked at, battery off."
    )


def test_the_tables_fit_a_terminal_of_80_columns(done):
    lines = done[1].splitlines()
    table = lines[next(k for k, line in enumerate(lines) if line.strip().startswith("found ")) :]
    rows = [line for line in table if not line.startswith(("new model", "wrote"))]
    assert max(len(line) for line in rows) <= 80
    text = "\n".join(rows)
    assert "…" not in text
    for word in ("loss", "torque share", "1 front right", "4 rear right", "RMSE after"):
        assert word in text


def test_the_json_has_the_keys_of_its_schema(done):
    told = json.loads((done[0] / "found.json").read_text(encoding="utf-8"))
    assert told["schema"] == "thrustmargin.identify/1"
    assert told["model"] == {
        "in": f"airframe {F16.name}",
        "out": str(done[0] / "new.safetensors"),
    }
    assert [f["role"] for f in told["flights"]] == ["fit"] * 4 + ["held_out"]
    assert {*told["flights"][0]} == {"log", "role", "samples"}
    errors = {"rmse_rpm", "bias_rpm", "r2", "per_rotor_rmse_rpm", "rmse_ci95_rpm"}
    assert set(told["before"]) == set(told["after"]) == errors
    assert len(told["after"]["per_rotor_rmse_rpm"]) == 4
    assert told["after"]["rmse_rpm"] < 0.3 * told["before"]["rmse_rpm"]
    (effect,) = told["effects"]
    assert {
        "name",
        "rotor",
        "parameters",
        "rmse_before_rpm",
        "rmse_after_rpm",
    } <= set(effect)
    assert (effect["name"], effect["rotor"]) == ("rotor_degradation", 1)
    loss = effect["parameters"]["loss"]
    assert loss["unit"] == "1"
    assert loss["ci95"][0] < LOSS < loss["ci95"][1]
    assert {"fraction_of_variance", "mode", "channel"} <= set(told["unexplained"])
    assert told["floor_rpm"] <= told["after"]["rmse_rpm"] * 1.05
    assert told["margin"]["effects"][0]["rotor"] == 1
    assert told["margin"]["all"]["typical_after"] < told["margin"]["all"]["typical_before"]
    assert told["answer"][0] == done[1].splitlines()[0]
    assert told["next_flight"] is None


def test_the_new_model_file_is_one_that_report_and_replay_read(done, worn_logs):
    model = load_model(done[0] / "new.safetensors")
    (effect,) = model.effects
    assert (effect.name, effect.rotor) == ("rotor_degradation", 1)
    assert effect.flights == tuple(Path(p).name for p in worn_logs[:4])
    assert effect.date
    flight = read_log(worn_logs[4], airframe=model.airframe).track
    before, after = (
        np.sqrt(np.mean(analyse(flight, m).residual_rpm ** 2)) for m in (physics_model(F16), model)
    )
    assert after < 0.3 * before


def test_the_page_is_written_and_names_the_flights(done, worn_logs):
    page = (done[0] / "found.html").read_text(encoding="utf-8")
    for path in worn_logs:
        assert Path(path).name in page
    assert "held out" in page


def undecided(tracks: list[FlightTrack]) -> Result:
    """Hidden mass named, and a gauge that would do as well."""
    found = identify(tracks, physics_model(F16), catalogue=table(["extra_mass"]))
    terms = [known_term(key) for key in ("extra_mass", "tank_scale")]
    one = OneOf(terms=tuple(terms), probabilities=(0.6, 0.4))
    return make_result(replace(found, one_of=(one,)), tracks=tracks, mission="next.plan")


def lines_of(capsys) -> tuple[str, str]:
    out, err = capsys.readouterr()
    return out, err


def refused(capsys, *arguments: str, code: int = 1) -> str:
    """The one line with which the command ends, beside what the made flights' logs lack."""
    assert run(["identify", *arguments]) == code
    _, err = lines_of(capsys)
    line = [part for part in err.splitlines() if part and ": log: begins in flight" not in part]
    assert len(line) == 1, err
    assert line[0].startswith("thrustmargin: ")
    return line[0]


def test_the_model_that_is_judged_is_never_overwritten(worn_logs, tmp_path, capsys):
    path = tmp_path / "mine.safetensors"
    save_model(physics_model(F16), path)
    before = path.read_bytes()
    link = tmp_path / "link.safetensors"
    link.symlink_to(path)
    for target in (path, link, tmp_path / "." / "mine.safetensors"):
        said = refused(capsys, *worn_logs, "--model", str(path), "--out", str(target), "--force")
        assert "would overwrite" in said
    assert path.read_bytes() == before


def test_another_file_is_replaced_only_by_force(worn_logs, done, tmp_path, capsys):
    path = tmp_path / "other.safetensors"
    path.write_bytes(b"precious")
    assert "--force" in refused(capsys, *worn_logs[:2], *CURVE, "--out", str(path))
    assert path.read_bytes() == b"precious"
    assert load_model(done[0] / "new.safetensors").effects
    left = ["found.html", "found.json", "new.safetensors"]
    assert sorted(p.name for p in done[0].iterdir()) == left


@pytest.mark.slow
def test_the_next_flight_is_written_as_a_mission_and_never_over_another(tmp_path, capsys):
    """One fill: hidden mass is as good as a wrong gauge, and rotors are not in question."""
    tracks = made_flights(3, hidden_mass=1.0)
    result = undecided(tracks)
    path = tmp_path / "next.plan"
    written = write_result(result, out=None, json=None, html=None, mission=path)
    assert written == [path]
    plan = read_plan(path)
    assert plan.items[0].command == TAKEOFF
    assert plan.home[:2] == (36.65, 116.9)
    show(result, written)
    out, _ = lines_of(capsys)
    assert f"wrote {path}" in out.replace("\n", "")
    before = path.read_bytes()
    logs = written_logs(tmp_path, tracks[:2])
    assert "--force" in refused(capsys, *logs, *CURVE, "--next-flight", str(path))
    assert path.read_bytes() == before


def test_a_next_flight_that_nothing_needs_is_not_written(done):
    assert "no flight would tell more" in done[2]
    assert not (done[0] / "next.plan").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "{folder}/new.bin"], ".html"),
        (["--out-model", "{folder}/new.bin"], ".safetensors"),
        (["--out", "{folder}/none/new.safetensors"], "no folder"),
        (["--html", "{folder}/page.txt"], ".html"),
        (["--next-flight", "{folder}/next.html"], ".plan"),
        (["--json", "{log}"], "end its name in .json"),
        (["--json", "{folder}/a.html"], "end its name in .json"),
        (["--model", "{folder}/none.safetensors"], "no model file"),
        (["--held-out", "{log}"], "same flight"),
        (["--held-out", "{folder}/none.csv"], "no --held-out flight can be used"),
    ],
)
def test_what_cannot_work_is_refused_in_one_line(worn_logs, tmp_path, capsys, options, words):
    filled = [o.format(folder=tmp_path, log=worn_logs[0]) for o in options]
    named = [] if "--model" in filled else ["--airframe", F16.name]
    code = 2 if words.startswith((".", "end its name")) else 1  # of a wrong command line
    assert words in refused(capsys, worn_logs[0], worn_logs[1], *named, *filled, code=code)
    assert list(tmp_path.iterdir()) == []


def test_swapped_motors_are_called_so_and_nothing_is_fitted(sitl_logs, tmp_path, capsys):
    track = read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog", airframe=F16).track
    swapped = replace(track, rotor_speed_rpm=track.rotor_speed_rpm[:, [1, 0, 2, 3]])
    (log,) = written_logs(tmp_path, [swapped])
    said = refused(capsys, log, *CURVE, "--json", str(tmp_path / "found.json"))
    assert "motors 1 and 2 look swapped" in said
    assert "nothing was fitted" in said
    assert not (tmp_path / "found.json").exists()


def test_electrical_rpm_is_called_so(tmp_path, capsys):
    track = made_flight(1)
    pairs = F16.motor_poles / 2
    (log,) = written_logs(tmp_path, [replace(track, rotor_speed_rpm=pairs * track.rotor_speed_rpm)])
    assert "electrical rpm" in refused(capsys, log, *CURVE)


@pytest.mark.slow
def test_rows_in_which_a_sensor_sticks_are_not_used(doubtful):
    *_, unused = doubtful[2]["flights"]
    assert unused["role"] == "held_out"
    assert unused["samples"] < 820  # of 900, less 100 that stick and the ends


@pytest.mark.slow
def test_a_single_flight_says_what_cannot_be_claimed(worn_logs, capsys):
    assert run(["identify", worn_logs[0], *CURVE]) == 0
    out, _ = lines_of(capsys)
    assert "One flight only" in out
    assert "cannot be claimed" in out


def test_logs_that_cannot_serve_are_named_and_the_rest_is_used(doubtful):
    code, out, _ = doubtful
    assert code == 1
    assert "not used: broken.csv: " in out
    assert "not used: short.csv: 80 rows in steady flight" in out
    assert out.startswith("Rotor 1 (front right) makes")


def test_every_log_that_cannot_serve_is_named_when_none_is_left(tmp_path, capsys):
    broken, six = tmp_path / "broken.csv", tmp_path / "six.csv"
    broken.write_text("time_s,colour\nnever,blue\n")
    names = ",".join(f"rotor_speed_rpm_{k}" for k in range(1, 7))
    six.write_text(f"time_s,{names}\n0,1,2,3,4,5,6\n")
    said = refused(capsys, str(broken), str(six), str(tmp_path / "none.tlog"), *CURVE)
    for words in ("no flight can be used; ", "broken.csv: ", "six.csv: 6 rotors", "no such file"):
        assert words in said
    track = made_flight(1)
    rpm = F16.motor_poles / 2 * track.rotor_speed_rpm
    electrical = written_logs(tmp_path, [replace(track, rotor_speed_rpm=rpm)] * 2)
    said = refused(capsys, *electrical, str(broken), *CURVE)
    assert (said.count("electrical rpm"), said.count("likewise")) == (1, 1)


def test_no_log_is_a_wrong_command_line(capsys):
    assert run(["identify"]) == 2
    assert "no log given" in lines_of(capsys)[1]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer(worn_logs, doubtful, tmp_path):
    assert doubtful_run(worn_logs, tmp_path)[2] == doubtful[2]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="looks into the process on Linux")
def test_ctrl_c_leaves_files_whole(worn_logs, tmp_path):
    target = tmp_path / "found.json"
    target.write_text('{"old": true}')
    process = subprocess.Popen(
        [
            *(
                sys.executable,
                "-c",
                "from thrustmargin.gcs_plugin.cli import main; main()",
                "identify",
            ),
            *(*worn_logs, "--airframe", F16.name),
            *("--json", str(target), "--out", str(tmp_path / "new.safetensors")),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[4],
    )
    # Once statistics are loading, the command is at work and not yet done.
    while process.poll() is None and "scipy" not in Path(f"/proc/{process.pid}/maps").read_text():
        time.sleep(0.02)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    assert "stopped" in errors
    assert target.read_text() == '{"old": true}'
    assert [p.name for p in tmp_path.iterdir()] == ["found.json"]
