"""A recorded flight without its ESC telemetry: the same report, marked, with an honest interval."""

import csv
import json

import pytest

from tests.stripped_logs import without
from thrustmargin.gcs_plugin.cli import run

ENDS = "low", "high"


@pytest.fixture(scope="module")
def reports(tmp_path_factory, sitl_logs):
    """JSON and CSV of the report of a flight, whole and without its ESC messages."""
    folder = tmp_path_factory.mktemp("outputs")
    whole = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    silent = without(whole, folder / "silent.tlog", "ESC_TELEMETRY_1_TO_4")
    made = []
    for log in (whole, silent):
        out = folder / f"{log.stem}.html"
        assert run(["report", str(log), "--out", str(out), "--airframe", "topxgun-f16-sitl"]) == 0
        with out.with_suffix(".csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        made.append((json.loads(out.with_suffix(".json").read_text()), rows, out.read_text()))
    return made


@pytest.mark.slow
def test_the_verdict_is_that_of_the_measured_speeds_or_cannot_tell(reports):
    (whole, *_), (silent, *_) = reports
    told = silent["flights"][0]["verdict"]["level"]
    assert told in (whole["flights"][0]["verdict"]["level"], "near")


def test_the_full_answer_is_within_the_interval(reports):
    (_, measured, _), (_, inferred, _) = reports
    inside = total = 0
    for one, other in zip(measured, inferred, strict=False):
        for rotor in range(1, 5):
            use = other[f"utilisation_from_outputs_{rotor} [1]"]
            if use and one["flying [0/1]"] == "1":
                low, high = (float(other[f"utilisation_{end}_{rotor} [1]"]) for end in ENDS)
                inside += low <= float(one[f"utilisation_{rotor} [1]"]) <= high
                total += 1
    assert total > 6000
    assert inside / total > 0.9


def test_nothing_that_was_inferred_is_called_measured(reports):
    _, (report, rows, page) = reports
    flight = report["flights"][0]
    assert not any(row["rotor_speed_rpm_1 [rpm]"] for row in rows)
    assert any(row["rotor_speed_from_outputs_rpm_1 [rpm]"] for row in rows)
    assert flight["verdict"]["speed_basis"] == "from motor outputs"
    assert "from motor outputs" in flight["verdict"]["basis"]
    assert {moment["basis"] for moment in flight["moments"]} == {"from motor outputs"}
    assert "cannot check the prediction" in flight["accuracy"]["words"]
    assert "least left, from motor outputs" in page
    assert "least left, measured" not in page
