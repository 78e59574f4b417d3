"""What each reader is given before it is damaged: small files of every kind, and who reads them."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import safetensors.numpy
from rich.console import Console

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.gcs_plugin.logs.test_ulog import px4_log
from tests.lab.fuzz.live_link import watched
from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs, ReadingOptions, with_recorded
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan
from thrustmargin.gcs_plugin.link.signing import read_signing_key
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.bench_table import read_bench
from thrustmargin.gcs_plugin.logs.csv_table import stated_columns, unit_of_column
from thrustmargin.gcs_plugin.logs.parameter_file import read_parameters
from thrustmargin.gcs_plugin.office.season.parts import read_parts
from thrustmargin.mission.field_file import read_field
from thrustmargin.mission.plan import write_plan
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

ROOT = Path(__file__).resolve().parents[3]
F16 = physics_model(load_airframe("topxgun-f16-sitl"))
CORNERS = [[8.0, 47.0], [8.002, 47.0], [8.002, 47.001], [8.0, 47.001], [8.0, 47.0]]
KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>north</name>'
    "<Polygon><outerBoundaryIs><LinearRing><coordinates>"
    + " ".join(f"{x},{y},0" for x, y in CORNERS)
    + "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
)
GEOJSON = json.dumps(
    {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [CORNERS]}}
)
PARTS = (
    "part,aircraft,position,installed_at,removed_at\n"
    "P1,A,propeller 1,2026-01-02,2026-03-02\nP2,A,propeller 1,2026-03-02,\n"
    "M7,A,motor 2,2026-01-02,\n"
)
ISOXML = (
    '<?xml version="1.0"?><ISO11783_TaskData><PFD A="PFD1" C="north"><PLN A="1"><LSG A="1">'
    + "".join(f'<PNT A="2" C="{y}" D="{x}"/>' for x, y in CORNERS)
    + "</LSG></PLN></PFD></ISO11783_TaskData>"
)
OPTIONS = json.dumps(
    Inputs(
        airframe="topxgun-f16-sitl",
        max_utilisation=0.5,
        reading=ReadingOptions(vehicle=1, load=3.0, load_end=1.0, air_temperature_c=20.0),
    ).as_table()
)
COLUMNS = b'time_s = "t"\nvoltage = { column = "V", unit = "mV", offset = 1 }\nairspeed = 3.0\n'
CONDITIONS = json.dumps(
    {
        "conditions": {
            "tank_start_kg": 8.0,
            "density": 1.2,
            "wind_ned": [0.0, 1.0, 0.0],
            "battery": {"voltage": 50.0, "capacity_ah": 16.0},
        }
    }
)
BENCH = "rpm,thrust [N],power [W]\n" + "".join(
    f"{n},{4e-5 * n * n:.3f},{2e-8 * n**3:.2f}\n" for n in range(500, 3000, 250)
)


@dataclass(frozen=True)
class Kind:
    """A kind of input: a whole file, its ending, whether it is text, and its reader."""

    ending: str
    whole: bytes
    text: bool
    read: Callable[[Path], Any]
    every: int = 1  # of so many turns it has one: a flight takes as long as ten plans


def _flown(path: Path) -> Any:
    return analyse(read_log(path, airframe=F16.airframe).track, F16)


def _made(write: Callable[[Path], Any], name: str) -> bytes:
    with TemporaryDirectory() as folder:
        write(path := Path(folder) / name)
        return path.read_bytes()


def _archive(method: int) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", method) as archive:
        archive.writestr("doc.kml", KML)
    return held.getvalue()


def _without_digest(model: bytes) -> bytes:
    """Return a model file of an earlier version: damage in it is read, not refused by a digest."""
    tensors = safetensors.numpy.load(model)
    size = int.from_bytes(model[:8], "little")
    metadata = json.loads(model[8 : 8 + size])["__metadata__"]
    return safetensors.numpy.save(tensors, {"thrustmargin": metadata["thrustmargin"]})


def _options(path: Path) -> Any:
    """Read a recording's options, which have a name of their own beside the log."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "options.json").write_bytes(path.read_bytes())
        (log := Path(folder) / "a.tlog").touch()
        return with_recorded(Inputs(logs=(log,)), Console(file=io.StringIO()))


def _columns(path: Path) -> Any:
    with TemporaryDirectory() as folder:
        (Path(folder) / "columns.toml").write_bytes(path.read_bytes())
        return stated_columns(Path(folder) / "a.csv", unit_of_column)


def kinds() -> Iterator[tuple[str, Kind]]:
    """Name -> each kind."""
    tlog = (ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog").read_bytes()
    yield "tlog", Kind(".tlog", tlog[:90_000], False, _flown, 10)
    for name, given in (("live", True), ("live_own", False)):
        flown = tlog[60_000:170_000]
        yield name, Kind(".tlog", flown, False, partial(watched, model=F16, given=given), 20)
    binary = (ROOT / "sitl_logs/formats/v4_m10_q2.5.BIN").read_bytes()
    yield "bin", Kind(".BIN", binary[:150_000], False, _flown, 10)
    yield "ulg", Kind(".ulg", px4_log(), False, _flown, 10)
    track = read_log(ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog").track.rows(slice(400, 460))
    yield "csv", Kind(".csv", _made(partial(write_csv, track), "a.csv"), True, _flown, 10)
    plan = plan_of(*TWO_LINES)
    yield "plan", Kind(".plan", _made(partial(write_plan, plan), "a.plan"), True, read_plan)
    table = _made(partial(write_plan, plan), "a.waypoints")
    yield "waypoints", Kind(".waypoints", table, True, read_plan)
    for name, text in (("kml", KML), ("geojson", GEOJSON)):
        yield name, Kind(f".{name}", text.encode(), True, read_field)
    airframe = (ROOT / "models/airframes/topxgun-f16.toml").read_bytes()
    yield "airframe", Kind(".toml", airframe, True, load_airframe)
    model = _made(lambda path: save_model(F16, path), "a.safetensors")
    yield "model", Kind(".safetensors", model, False, load_model)
    param = b"MOT_PWM_MIN,1000\nSERVO1_FUNCTION 33\n# why\nBATT_CAPACITY=16000\n"
    yield "parameters", Kind(".param", param, True, read_parameters)
    yield "bench", Kind(".csv", BENCH.encode(), True, read_bench)
    yield "parts", Kind(".csv", PARTS.encode(), True, lambda p: read_parts(p.read_bytes(), p.name))
    for name, method in (("kmz", zipfile.ZIP_DEFLATED), ("kmz_lzma", zipfile.ZIP_LZMA)):
        yield name, Kind(".kmz", _archive(method), False, read_field)
    yield "isoxml", Kind(".xml", ISOXML.encode(), True, read_field)
    yield "options", Kind(".json", OPTIONS.encode(), True, _options)
    yield "columns", Kind(".toml", COLUMNS, True, _columns)
    yield "conditions", Kind(".json", CONDITIONS.encode(), True, partial(read_assumed, plan=ROOT))
    yield "old_model", Kind(".safetensors", _without_digest(model), False, load_model)
    yield "key", Kind(".key", b"ab" * 32, True, read_signing_key)
