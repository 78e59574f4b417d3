"""Which model comes of a model file and an airframe, and when the two disagree."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.models.made_flights import F16, made_flight
from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs, chosen_model, starting_model
from thrustmargin.gcs_plugin.commands.shared.log_flights import listed, matching_logs, read_logs
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.model_file import save_model, shipped_model
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe

OTHER = "agras-t20"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "t20.safetensors"
    save_model(physics_model(load_airframe(OTHER)), path)
    return path


def kind(model: RotorModel) -> tuple[str, bool]:
    """Name of its airframe, and whether it has learnt anything."""
    return model.airframe.name, model.network is not None


SHIPPED = shipped_model().airframe.name


def test_without_a_wish_the_shipped_model_is_used_and_judged():
    judged, words = starting_model(Inputs())
    assert kind(chosen_model(None, None)) == kind(judged) == (SHIPPED, True)
    assert words == "shipped"


def test_the_shipped_models_own_airframe_keeps_its_network_but_is_judged_without_it():
    judged, words = starting_model(Inputs(airframe=SHIPPED))
    assert kind(chosen_model(None, SHIPPED)) == (SHIPPED, True)
    assert kind(judged) == (SHIPPED, False)
    assert words == f"airframe {SHIPPED}"


def test_another_airframe_alone_means_its_weight_and_thrust_curve():
    assert (
        kind(chosen_model(None, OTHER))
        == kind(starting_model(Inputs(airframe=OTHER))[0])
        == (OTHER, False)
    )


def test_a_file_is_used_with_no_airframe_or_its_own(file):
    for airframe in (None, OTHER):
        assert chosen_model(file, airframe).airframe.name == OTHER
        assert starting_model(Inputs(model=file, airframe=airframe))[1] == str(file)


@pytest.mark.parametrize("choose", [Inputs.rotor_model, starting_model])
def test_a_file_and_an_airframe_that_disagree_are_refused(file, choose):
    with pytest.raises(DataError, match=f"a model of {OTHER}, not of topxgun-f16"):
        choose(Inputs(model=file, airframe="topxgun-f16"))


def test_a_reason_that_many_logs_share_is_said_once():
    alike = [UnusedLog(name=f"f{k}.csv", reason=f"f{k} has {k}.5 rotors") for k in range(6)]
    short = UnusedLog(name="short.csv", reason="3 s are too few")
    assert listed([alike[0], short]) == "f0.csv: f0 has 0.5 rotors; short.csv: 3 s are too few"
    said = "f0.csv: f0 has 0.5 rotors (likewise f1.csv, f2.csv, f3.csv"
    assert listed([*alike[:4], short]) == f"{said}); short.csv: 3 s are too few"
    assert listed(alike) == f"{said} and 2 more)"


def test_a_file_that_keeps_the_name_of_the_shipped_airframe_is_not_ignored(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('extends = "topxgun-f16-sitl"\n')
    assert chosen_model(None, str(own)).network is not None
    weight = 'empty_mass = { value = 16.9, unit = "kg", source = "scales" }\n'
    own.write_text(f'extends = "topxgun-f16-sitl"\n[quantities]\n{weight}')
    model = chosen_model(None, str(own))
    assert (model.airframe.empty_mass, model.network) == (16.9, None)


@pytest.mark.parametrize("lost", [True, False])
def test_what_follows_a_loss_of_control_is_not_learnt_from_and_that_is_said(tmp_path, lost):
    track = made_flight(0, duration=90.0)
    # With a barometer at one height nothing would have turned over.
    track = replace(track, pressure=np.full_like(track.pressure, np.nan))
    attitude = track.attitude.copy()
    if lost:
        attitude[track.time_s >= 60.0, 0] = np.radians(120.0)
    write_csv(replace(track, attitude=attitude), tmp_path / "flight.csv")
    told, unused, model = io.StringIO(), [], physics_model(F16)
    console = Console(file=told, width=200)
    inputs = Inputs(logs=(tmp_path / "flight.csv",), airframe="topxgun-f16-sitl")
    read = read_logs(inputs, unused, console, model=model)
    (log,) = matching_logs(read, unused, console)
    assert unused == []
    assert log.track.time_s[log.track.flying].max() == pytest.approx(58.9 if lost else 89.9)
    words = (
        "flight.csv: control was lost (tilted up to 120 ° at 1:00): what follows 1:00 is left out"
    )
    assert (words in told.getvalue()) is lost


def test_a_log_that_ends_in_flight_is_learnt_from_and_its_end_is_named(tmp_path):
    whole = made_flight(0, duration=90.0)
    landed = replace(whole, flying=whole.time_s < 80.0)
    printed = {}
    for name, track in (("cut", whole), ("landed", landed)):
        write_csv(track, tmp_path / f"{name}.csv")
        said = io.StringIO()
        console = Console(file=said, width=200)
        inputs = Inputs(logs=(tmp_path / f"{name}.csv",), airframe="topxgun-f16-sitl")
        read = read_logs(inputs, [], console, model=physics_model(F16))
        assert len(list(matching_logs(read, [], console))) == 1
        printed[name] = said.getvalue()
    assert "ends in flight, at 1:29: the rest is unseen" in printed["cut"]
    assert "ends in flight" not in printed["landed"]


@pytest.mark.parametrize("given", [True, False])
def test_a_log_without_a_flight_says_so_and_asks_for_no_airframe(tmp_path, given):
    track = made_flight(0, duration=90.0)
    still = replace(track, flying=np.zeros(track.time_s.size, dtype=bool))
    write_csv(still, tmp_path / "bench.csv")
    unused, console = [], Console(file=io.StringIO())
    airframe = "topxgun-f16-sitl" if given else None
    inputs = Inputs(logs=(tmp_path / "bench.csv",), airframe=airframe)
    read = read_logs(inputs, unused, console, model=physics_model(F16))
    assert list(matching_logs(read, unused, console)) == []
    assert [one.reason for one in unused] == [
        "by this log it never left the ground: as the table says"
    ]
