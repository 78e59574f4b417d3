"""The timeline of a report: vehicle, engineer and program in one order, and nothing acts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.gcs_plugin.logs.tlog_files import STAMPED
from tests.gcs_plugin.reports.margin.report_flight import HOSTILE, LOG, flight, log
from tests.gcs_plugin.reports.margin.test_run_ups import late, written
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.anonymous import anonymous
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.render import html_text, json_text
from thrustmargin.gcs_plugin.telemetry.recording import EngineerNote
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, VehicleEvent

THRUST = VehicleEvent(EventKind.THRUST_LOSS, 60.0, "2", "Potential Thrust Loss (2)")


def test_entries_of_all_three_are_in_order_of_time():
    events = (THRUST, VehicleEvent(EventKind.EKF, 5.0, "", "EKF variance"))
    notes = (EngineerNote(30.0, "hum"), EngineerNote(-3.0, "battery in"))
    flown = flight(late(3, 1.3), events=events, engineer_notes=notes)
    made = json.loads(json_text(build_report([flown]), "r.csv"))["flights"][0]
    assert [(one["source"], one["text"]) for one in made["timeline"]] == [
        ("notes", "battery in"),
        ("vehicle", "estimator: EKF variance"),
        (
            "program",
            "motor 3 front left turned 1.3 s after the others: check its ESC, leads and bearing",
        ),
        ("notes", "hum"),
        ("vehicle", "thrust loss: Potential Thrust Loss (2)"),
    ]
    assert made["notes"] == [
        {"time_s": 30.0, "text": "hum"},
        {"time_s": -3.0, "text": "battery in"},
    ]
    thrust = made["vehicle_said"][1]
    assert (thrust["kind"], thrust["motors"], thrust["times_s"]) == ("thrust loss", [2], [60.0])
    assert thrust["corroboration"] in ("follows", "hardest")
    assert thrust["words"]


def test_a_flight_without_reports_and_notes_has_no_such_section(tmp_path: Path):
    page = html_text(build_report([flight(events=())]), written(tmp_path))
    assert "What was reported, in order of time" not in page


def test_nothing_that_a_log_or_a_note_contains_acts_on_the_page(tmp_path: Path):
    events = (VehicleEvent(EventKind.THRUST_LOSS, 60.0, "2", HOSTILE),)
    flown = flight(events=events, engineer_notes=(EngineerNote(30.0, HOSTILE),))
    page = html_text(build_report([flown]), written(tmp_path))
    assert "What was reported, in order of time" in page
    assert page.count("&lt;img src=x onerror=alert(2)&gt;") >= 3  # facts, and twice the timeline
    assert "<img src=x" not in page
    assert "<script>alert(1)" not in page


def test_an_anonymous_report_has_no_notes():
    assert (
        anonymous(*flight(engineer_notes=(EngineerNote(1.0, "Ann"),)), "x")[1].engineer_notes == ()
    )


@pytest.mark.parametrize("command", ["report", "inspect"])
def test_notes_beside_the_log_or_named_are_read_and_bad_ones_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
):
    flown = tmp_path / LOG.name
    flown.write_bytes(b"".join(STAMPED[:4000]))
    out = ["--json", str(tmp_path / "r.json")]
    notes = tmp_path / "notes.csv"
    notes.write_text("time,text\n2,hum from arm 3\n", encoding="utf-8")

    def listed() -> str:
        return (tmp_path / "r.json").read_text("utf-8")

    assert run([command, str(flown), *out]) == 0
    assert "hum from arm 3" in listed()
    notes.write_text("when,what\n2,hum\n", encoding="utf-8")
    run([command, str(flown), *out])
    said = " ".join(capsys.readouterr().err.split())
    assert "not read: notes.csv: its first line must be time,text" in said
    assert run([command, str(flown), *out, "--notes", str(notes)]) != 0
    other = tmp_path / "mine.csv"
    other.write_text("time,text\n3,loud\n", encoding="utf-8")
    assert run([command, str(flown), *out, "--notes", str(other)]) == 0
    assert "loud" in listed()
    both = [command, str(flown), str(LOG), *out, "--notes", str(other)]
    assert run(both) != 0
    assert "--notes are of one log" in capsys.readouterr().err


def test_the_log_keeps_its_own_fields():
    assert log().engineer_notes == ()
