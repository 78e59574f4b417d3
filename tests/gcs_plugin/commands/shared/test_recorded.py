"""A recording read again with no option says what the monitor said with its options."""

import io
import json
import shutil
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import first_part
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs, ReadingOptions, with_recorded
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError

LOG = Path("sitl_logs/campaign/v4_m4_q2.5.tlog")


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Path:
    """A recording that the monitor itself made."""
    folder = tmp_path_factory.mktemp("recorded")
    log = first_part(LOG, 60.0, tmp_path_factory.mktemp("log"))
    options = "--airframe topxgun-f16-sitl --load 2.5 --air-temperature 31 --max-utilisation 0.4"
    line = ["monitor", str(log), "--no-view", "--record", str(folder), *options.split()]
    assert run(line) == 0
    (made,) = folder.iterdir()
    return made


def reported(log: Path, out: Path, *options: str) -> tuple[dict, dict]:
    assert run(["report", str(log), "--json", str(out), *options]) == 0
    flight = json.loads(out.read_text("utf-8"))["flights"][0]
    return flight["verdict"], flight


@pytest.mark.slow
def test_a_report_of_a_recording_takes_its_options_and_says_so(session, tmp_path, capsys):
    log = session / "telemetry.tlog"
    verdict, _ = reported(log, tmp_path / "a.json")
    assert "--airframe topxgun-f16-sitl --max-utilisation 0.4 --load 2.5" in capsys.readouterr().err
    options = "--airframe topxgun-f16-sitl --load 2.5 --air-temperature 31 --max-utilisation 0.4"
    bare = shutil.copy(log, tmp_path / "bare.tlog")
    assert verdict == reported(bare, tmp_path / "b.json", *options.split())[0]
    assert verdict != reported(bare, tmp_path / "c.json")[0]
    assert "as recorded" not in capsys.readouterr().err


def test_what_the_user_gives_is_never_replaced(session):
    said = io.StringIO()
    logs = (session / "telemetry.tlog",)
    stated = {"max_utilisation": 0.5, "reading": ReadingOptions(load=7.0)}
    user = Inputs(logs=logs, airframe="other", **stated)
    assert with_recorded(user, Terminal(file=said)) == user
    assert said.getvalue() == ""
    mine = with_recorded(Inputs(logs=logs, max_utilisation=0.6), Terminal(file=said, width=500))
    assert (mine.limit, mine.airframe, mine.reading.load) == (0.6, "topxgun-f16-sitl", 2.5)
    assert "--max-utilisation" not in said.getvalue()


def test_an_inspection_takes_them_too(session, capsys):
    assert run(["inspect", str(session / "telemetry.tlog")]) == 0
    heard = capsys.readouterr()
    assert "as recorded" in heard.err
    assert "airframe topxgun-f16-sitl, given" in heard.out


def test_recordings_with_other_options_are_not_mixed_silently(session, tmp_path):
    bare = Path(shutil.copy(session / "telemetry.tlog", tmp_path / "bare.tlog"))
    with pytest.raises(DataError, match="one of these recordings at a time"):
        with_recorded(Inputs(logs=(session / "telemetry.tlog", bare)), Terminal(file=io.StringIO()))


def options(**changed: object) -> str:
    reading = {"vehicle": None, "tank": "auto", "load": None} | changed
    own = {k: reading.pop(k) for k in ("model", "airframe", "max_utilisation") if k in reading}
    whole = {"model": None, "airframe": "topxgun-f16-sitl", "max_utilisation": 0.5}
    return json.dumps(whole | own | {"reading": reading})


def test_options_of_every_kind_are_taken(tmp_path):
    (tmp_path / "options.json").write_text(options(vehicle=3, load=2, air_temperature_c=20.5))
    log = Path(shutil.copy(LOG, tmp_path / "telemetry.tlog"))
    taken = with_recorded(Inputs(logs=(log,)), Terminal(file=io.StringIO()))
    assert (taken.reading.vehicle, taken.reading.load) == (3, 2.0)
    assert (taken.limit, taken.airframe) == (0.5, "topxgun-f16-sitl")


@pytest.mark.parametrize(
    "text",
    [
        *("{", "[]", '{"model": 1}', "[" * 5000),
        *(options(vehicle=[]), options(load=[3.0]), options(load="3"), options(load={})),
        *(options(vehicle=True), options(vehicle=999), options(load=float("nan"))),
        *(options(tank="NaN"), options(tank=[]), options(colour="red")),
        *(options(max_utilisation=[0.5]), options(max_utilisation=50), options(model=[])),
        *(options(airframe=7), options(max_utilisation=float("nan"))),
    ],
)
def test_options_that_cannot_be_read_are_named_and_not_passed_over(tmp_path, text):
    (tmp_path / "options.json").write_text(text)
    log = Path(shutil.copy(LOG, tmp_path / "telemetry.tlog"))
    with pytest.raises(DataError, match=r"options\.json does not hold"):
        with_recorded(Inputs(logs=(log,)), Terminal(file=io.StringIO()))
