"""Where numbers come from: words made of data, and no number that hangs on a word."""

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.flight_channels import assert_same_channels
from tests.gcs_plugin.logs.csv_files import write_csv
from tests.made_sources import sent
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, analysis_for_verdict
from thrustmargin.models.model.inferred.load_inference import fill_channels
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.provenance import NOT_REPORTED, Meaning, Provenance, SourceKind, stated
from thrustmargin.models.statement import state

#: What logic once looked for in sentences.
TEMPTING = (
    "stated: 3 kg",
    "from motor outputs (an assumed exponent)",
    "inferred from hover thrust",
    "ground speed: no airspeed sensor",
    "of the autopilot's board: warmer than the air",
    "actuator_motors control",
)


def tempted(source: Provenance, number: int) -> Provenance:
    """The same facts, in words of something else."""
    words = TEMPTING[number % len(TEMPTING)]
    parts = tuple(tempted(part, number + 1) for part in source.parts)
    return replace(
        source, name=words, fields=(), remarks=(state("as written", text=words),), parts=parts
    )


def judged(track: FlightTrack, parameters) -> FlightAnalysis:
    model = shipped_model()
    return analysis_for_verdict(
        analyse(fill_channels(track, identified_airframe(model), parameters), model)
    )


def numbers_of(analysis: FlightAnalysis) -> dict[str, np.ndarray]:
    found = {f.name: getattr(analysis, f.name) for f in fields(analysis)}
    return {n: v for n, v in found.items() if isinstance(v, np.ndarray) and v.dtype.kind == "f"}


@pytest.mark.parametrize("without", [(), ("rotor_speed_rpm",), ("tank_kg",), ("airspeed",)])
def test_other_words_change_no_number(without, sitl_logs):
    log = read_log(sitl_logs / "campaign/v4_m16_q2.5.tlog")
    track = log.track.rows(slice(0, 900))
    silent = {n: np.full_like(getattr(track, n), np.nan) for n in without}
    track = replace(track, **silent)
    sources = {c: tempted(s, k) for k, (c, s) in enumerate(track.sources.items())}
    one = numbers_of(judged(track, log.parameters))
    other = numbers_of(judged(replace(track, sources=sources, name="stated"), log.parameters))
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


@pytest.mark.parametrize(
    "name", ["ground speed.csv", "actuator_motors_0.csv", "stated from motor outputs.csv"]
)
def test_a_file_of_another_name_is_the_same_flight(name, sitl_logs, tmp_path):
    track = read_log(sitl_logs / "campaign/v4_m16_q2.5.tlog").track.rows(slice(0, 600))
    unsaid = replace(track, sources={}, notes=())
    write_csv(unsaid, tmp_path / "flight.csv")
    (tmp_path / name).write_bytes((tmp_path / "flight.csv").read_bytes())
    one, other = (read_log(tmp_path / n).track for n in ("flight.csv", name))
    assert one.sources == other.sources
    first, second = (numbers_of(judged(t, {})) for t in (one, other))
    for channel, values in first.items():
        np.testing.assert_array_equal(values, second[channel], err_msg=channel)
    assert_same_channels(one, other)


def test_words_are_made_of_the_facts():
    battery = Provenance(
        kind=SourceKind.MESSAGE, name="BATTERY_STATUS", fields=("voltages",), unit="mV"
    )
    assert source_words(battery.of_instance(1)) == "BATTERY_STATUS voltages of id 1"
    assert battery.of_instance(None) is battery
    assert source_words(battery.remarked(state("pitot"), state("level"))) == (
        "BATTERY_STATUS voltages (pitot; level)"
    )
    over_ground = sent("GPS Spd", meaning=Meaning.GROUND_SPEED)
    assert source_words(over_ground) == "GPS Spd (ground speed: no airspeed and no wind reported)"
    assert source_words(stated(state("outside", celsius=8.0))) == "stated: 8 °C outside"
    column = Provenance(kind=SourceKind.COLUMN, name="tank_kg")
    assert source_words(column) == "column tank_kg"
    both = Provenance(kind=SourceKind.MESSAGE, parts=(sent("A rpm"), sent("B rpm")))
    assert source_words(both) == "A rpm, B rpm"
    outputs = Provenance(
        kind=SourceKind.INFERRED, meaning=Meaning.MOTOR_OUTPUTS, parts=(sent("ESC RPM"),)
    )
    assert source_words(outputs) == "ESC RPM; from motor outputs"
    assert source_words(NOT_REPORTED) == "not in the log"


#: Names of text for people, and what logic would do to look into it.
TEXTS = {"words", "remarks", "notes", "sources", "described", "brief"}
LOOKS = {"startswith", "endswith", "split", "partition", "find", "index", "removeprefix"}
#: The edge, which puts sentences together: a lead-in that is said already is left out.
EDGE = "gcs_plugin/wording/"


def texts_in(node: ast.AST) -> bool:
    return any(isinstance(n, ast.Attribute) and n.attr in TEXTS for n in ast.walk(node))


def looked_into(tree: ast.AST) -> list[int]:
    """Lines on which a text for people decides something."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in LOOKS and texts_in(node.func.value):
                found.append(node.lineno)
        elif isinstance(node, ast.Compare):
            literal = isinstance(node.left, (ast.Constant, ast.JoinedStr)) and (
                not isinstance(node.left, ast.Constant) or isinstance(node.left.value, str)
            )
            inside = isinstance(node.ops[0], (ast.In, ast.NotIn)) and literal
            same = isinstance(node.ops[0], (ast.Eq, ast.NotEq))
            sides = [node.left, *node.comparators]
            texts = [n for n in sides if isinstance(n, ast.Attribute) and n.attr in TEXTS]
            if (inside and texts_in(node.comparators[0]) and not _keys(node)) or (same and texts):
                found.append(node.lineno)
    return found


def _keys(node: ast.Compare) -> bool:
    """Whether a channel's name is looked up among the sources, whose keys are names."""
    right = node.comparators[0]
    return isinstance(right, ast.Attribute) and right.attr == "sources"


def test_no_code_looks_into_a_text_for_people():
    root = Path(__file__).parents[2]
    for folder in ("models", "mission", "gcs_plugin"):
        for file in sorted((root / folder).rglob("*.py")):
            name = file.relative_to(root).as_posix()
            if not name.startswith(EDGE):
                lines = looked_into(ast.parse(file.read_text(encoding="utf-8")))
                assert not lines, f"{name} looks into a text for people on line {lines}"


@pytest.mark.parametrize(
    "line",
    [
        'x = "pump" in source_words(track.sources["tank_kg"])',
        'x = airframe_match.words.startswith("airframe")',
        'x = order.words == "unclear"',
        'x = "late" in statement_words(log.track.notes[0])',
    ],
)
def test_a_look_into_a_text_is_found(line):
    assert looked_into(ast.parse(line)) == [1]
    assert looked_into(ast.parse('x = "tank_kg" in track.sources')) == []


def test_remarks_are_read_back_as_they_were_written_and_texts_of_earlier_versions_too():
    whose = state("capacity set", name="BATT_CAPACITY", ml=16000.0)
    source = stated(state("tank by percent", whose=whose))
    assert from_json_values(Provenance, to_json_values(source), "x") == source
    older = {"kind": "stated", "remarks": ["8 kg at the start"]}
    assert source_words(from_json_values(Provenance, older, "x")) == "stated: 8 kg at the start"
    for wrong in ({"kind": "constant", "values": [["a", True]]}, {"kind": "constant", "b": 1}, 7):
        with pytest.raises(ValueError, match="x"):
            from_json_values(Provenance, {"kind": "stated", "remarks": [wrong]}, "x")
