"""`thrustmargin train` as a user runs it: the table, the files, the refusals."""

import csv
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.made_sources import sent
from tests.models.made_flights import F16, level_flight, made_flight, made_flights
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.workshop.learn.model_figures import loss_figure, write_loss_curves
from thrustmargin.gcs_plugin.workshop.learn.train import (
    network_can_learn,
    select_flights,
    train,
    training_run,
)
from thrustmargin.gcs_plugin.workshop.learn.training_tables import (
    interval_sentence,
    training_tables,
)
from thrustmargin.models.errors import AirframeError, DataError, LogError
from thrustmargin.models.identification.good_flights import standard_effects
from thrustmargin.models.model import training
from thrustmargin.models.model.model_file import load_model, shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.model.training import LossCurve, TrainSettings
from thrustmargin.models.network.network import NetConfig
from thrustmargin.models.network.validity import Interval, MeasuredCoverage
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.provenance import Meaning


@pytest.fixture
def few_logs(sitl_logs):
    names = ("v2_m16_q3.5", "v4_m10_q2.5", "v6_m4_q1.5", "v6_m16_q2.5")
    return tuple(sitl_logs / "campaign" / f"{name}.tlog" for name in names)


def halved(path, folder):
    """The first part of a recording: a minute and a half of flight."""
    (folder / "logs").mkdir(exist_ok=True)
    (folder / "logs" / path.name).write_bytes(path.read_bytes()[:380_000])
    return folder / "logs" / path.name


def rendered(parts) -> str:
    from rich.console import Console

    console = Console(width=80, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    for part in parts:
        console.print(part)
    return console.export_text()


@pytest.mark.slow
def test_four_flights_make_a_model_with_its_table_and_loss_curves(
    few_logs, tmp_path, capsys, monkeypatch
):
    # All that belongs to every aircraft would take most of the time, once for each flight left out.
    monkeypatch.setattr(standard_effects, "STANDARD", ("air_density", "manoeuvre_moment"))
    out = tmp_path / "own.safetensors"
    broken = tmp_path / "broken.tlog"
    broken.write_bytes(b"\x00" * 5000)
    short = read_log(few_logs[0]).track
    few_logs = [halved(path, tmp_path) for path in few_logs]
    begins = int(np.flatnonzero(training_rows(short))[0])
    write_csv(short.rows(slice(0, begins + 60)), tmp_path / "short.csv")
    logs = (*few_logs, broken, tmp_path / "short.csv")
    # One log is broken and left out, which the code says.
    assert train(logs, airframe="topxgun-f16-sitl", out_model=out, max_epochs=2, members=3) == 1
    text = capsys.readouterr().out
    assert "left out: broken.tlog" in text
    assert "left out: v2_m16_q3.5.tlog: 60 rows in steady flight" in text
    for said in ("the paper", "0.728", "samples, as the paper", "rotor 4", "mean of rotors"):
        assert said in text
    assert text.startswith("usable: rotor speed to ")
    assert text.splitlines()[-1].endswith("thrustmargin learn LOGS --aircraft NAME")
    assert "in turns (RMS on 4 flights" in " ".join(text.split())
    assert "Student's t from 4 flights" in " ".join(text.split())
    model = load_model(out)
    assert "manoeuvre_moment" in {e.name for e in model.effects}
    assert model.good_flights is not None
    assert model.good_flights.flights == 4
    assert model.training_domain is not None
    assert model.training_domain.flights == tuple(path.name for path in few_logs)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "broken.tlog",
        "logs",
        "own.loss.csv",
        "own.loss.svg",
        "own.safetensors",
        "short.csv",
    ]


def test_the_table_shows_the_models_own_figures_beside_the_papers():
    model = shipped_model()
    text = rendered(training_tables(model))
    assert "…" not in text  # everything fits 80 columns
    assert model.training is not None
    by_samples, by_flight = model.training.splits
    paper = next(line for line in text.splitlines() if line.startswith(" the paper"))
    assert paper.split()[2:] == ["0.728", "0.719", "0.726", "0.27", "147"]
    for label, split in (("samples, as the paper", by_samples), ("flights", by_flight)):
        row = next(line for line in text.splitlines() if line.startswith(f" {label} "))
        sets = (split.training, split.validation, split.test)
        assert row.removeprefix(f" {label}").split()[:4] == [
            *(f"{part.r2:.3f}" for part in sets),
            f"{split.lowest_loss:.3f}",
        ]
        assert f"{split.best_epoch} of {split.epochs}" in row
        for r2 in split.test.r2_per_rotor:
            assert f"{r2:.3f}" in text
    assert f"{model.training.left_out[0].score.r2:.3f}" in text


def test_a_model_without_network_is_described_by_its_own_words():
    assert training_tables(physics_model(load_airframe("topxgun-f16"))) == [
        "weight and thrust curve of TopXGun F16 (quad, 16 L), no network"
    ]


def test_the_interval_is_told_with_what_it_held():
    interval = Interval(
        coverage=0.9,
        flights=12,
        airspeed=(0.0, 1.0),
        scatter_rpm=((1.0,), (1.0,)),
        factor=(1.0,),
        measured=MeasuredCoverage(
            per_rotor=(0.92,), per_flight=(0.95,) * 11 + (0.59,), mean=0.92, width_rpm=123.4
        ),
    )
    sentence = interval_sentence(interval)
    assert "held 92.0 % (worst flight 59 %, 1 of 12 flights below 90 %)" in sentence
    assert "mean width 123 rpm" in sentence


def test_loss_curves_are_drawn_and_written_as_they_were(tmp_path):
    curves = [
        LossCurve(
            name=f"member {k}",
            training_loss=np.array([1.0, 0.5, 0.4]),
            validation_loss=np.array([1.1, 0.45 + k, 0.6 + k]),
            best_epoch=2,
        )
        for k in range(4)
    ]
    table, figure = write_loss_curves(curves, tmp_path / "m.safetensors")
    rows = list(csv.DictReader(table.open()))
    assert len(rows) == 12
    assert [r["kept"] for r in rows[:3]] == ["0", "1", "0"]
    assert float(rows[4]["validation_loss"]) == 1.45
    assert ET.parse(figure).getroot().tag.endswith("svg")
    drawn = loss_figure(curves).data
    assert [trace.get("yaxis", "y") for trace in drawn[::3]] == ["y", "y2", "y3", "y4"]
    np.testing.assert_allclose(drawn[4]["y"], curves[1].validation_loss)
    assert (drawn[5]["x"], drawn[5]["y"]) == ([2], [1.45])


def test_a_model_file_that_is_there_is_not_replaced_unasked(few_logs, tmp_path):
    out = tmp_path / "own.safetensors"
    out.write_bytes(b"precious")
    with pytest.raises(DataError, match="already there; give another --out-model, or --force"):
        train(few_logs, out_model=out, max_epochs=1)
    assert out.read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"out_model": "model.bin"}, DataError, "end its name in .safetensors"),
        ({"out_model": "nowhere/m.safetensors"}, DataError, "no folder"),
        ({"members": 2}, DataError, "--members 2 is not between 3 and"),
        ({"max_epochs": 0}, DataError, "--max-epochs 0 is not between 1 and"),
        ({"airframe": "zeppelin"}, AirframeError, "no airframe 'zeppelin'"),
        ({"airframe": "agras-t40"}, LogError, "no flight can be used; .*4 rotors.*likewise "),
    ],
)
def test_what_cannot_be_trained_is_said_before_the_work(given, error, message, few_logs, tmp_path):
    given = {"out_model": "m.safetensors"} | given
    given["out_model"] = tmp_path / given["out_model"]
    with pytest.raises(error, match=message):
        train(few_logs, **given)
    assert list(tmp_path.iterdir()) == []


def test_too_few_flights_and_no_flights_end_with_one_line(few_logs, tmp_path, capsys):
    out = ["--out", str(tmp_path / "m.safetensors")]
    assert run(["train", *map(str, few_logs[:2]), *out]) == 1
    error = capsys.readouterr().err
    assert "2 flights with usable rows" in error
    assert error.count("\n") == 1
    assert run(["train", *out]) == 2


def test_no_network_is_trained_where_neither_airspeed_nor_tank_varies():
    still = level_flight()
    assert not network_can_learn([still])
    assert network_can_learn([still, replace(still, tank_kg=still.tank_kg - 1.0)])
    fast = replace(still, airspeed=still.airspeed + 3.0)
    assert network_can_learn([still, fast])
    over_ground = sent("GPS", meaning=Meaning.GROUND_SPEED)
    unmeasured = [replace(one, sources={"airspeed": over_ground}) for one in (still, fast)]
    assert not network_can_learn(unmeasured)
    assert not network_can_learn([replace(still, rotor_speed_rpm=0.0 * still.rotor_speed_rpm)])


def test_a_flight_with_swapped_motors_is_not_learnt_from(sitl_logs):
    track = read_log(sitl_logs / "campaign/v4_m16_q2.5.tlog").track
    swapped = replace(track, name="b", rotor_speed_rpm=track.rotor_speed_rpm[:, [1, 0, 2, 3]])
    model = physics_model(load_airframe("topxgun-f16-sitl"))
    kept, unfit = select_flights([track, swapped], model)
    assert kept == [track]
    assert [one.name for one in unfit] == ["b"]
    assert unfit[0].reason.startswith("motors 1 and 2 look swapped against airframe topxgun")


def test_only_logs_that_cannot_be_read_end_the_work_with_each_reason(tmp_path):
    broken = tmp_path / "broken.tlog"
    broken.write_bytes(b"\x00" * 5000)
    with pytest.raises(LogError, match=r"no flight can be used; broken\.tlog: .*; other\.tlog: "):
        train((broken, tmp_path / "other.tlog"), out_model=tmp_path / "m.safetensors")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="looks into the process on Linux")
def test_ctrl_c_ends_a_training_without_leaving_a_file(few_logs, tmp_path):
    out = tmp_path / "m.safetensors"
    code = "from thrustmargin.gcs_plugin.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "train", *map(str, few_logs), "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
    )
    # While torch is loading, which takes seconds and must not be broken off in its midst.
    while process.poll() is None and "torch" not in Path(f"/proc/{process.pid}/maps").read_text():
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("sound", [3, 2])
def test_a_flight_with_a_weak_rotor_teaches_no_model(sound, monkeypatch, capsys):
    monkeypatch.setattr(standard_effects, "STANDARD", ("air_density",))
    fitted, fit = [], training.train

    def counted(tracks, *others, **options):
        fitted.append([track.name for track in tracks])
        return fit(tracks, *others, **options)

    monkeypatch.setattr(training, "train", counted)
    flights = [*made_flights(sound), made_flight(40, loss=0.08, rotor=2, name="worn.csv")]
    quick = TrainSettings(splits=("flights",), members=3, net=NetConfig(max_epochs=1))
    console = Console(width=400)
    if sound == 2:
        few = "worn.csv: Rotor 3 front left .* less thrust.*leaves 2 of the 3 sound flights"
        with pytest.raises(DataError, match=few):
            training_run(flights, F16, quick, console)
        return
    run = training_run(flights, F16, quick, console)
    assert [track.name for track in run.tracks] == [one.name for one in flights[:3]]
    assert fitted == [[one.name for one in flights[:3]]]  # once, and never on the weak one
    (left,) = run.unfit
    assert left.name == "worn.csv"
    assert "less thrust, beside a model of the other flights" in left.reason
    assert run.model.good_flights is not None
    assert run.model.good_flights.flights == 3
    assert "made without worn.csv: Rotor 3 front left" in capsys.readouterr().out
