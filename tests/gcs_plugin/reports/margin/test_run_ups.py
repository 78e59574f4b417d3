"""The report's part on the run-up: numbers in the JSON, words on the page, yaw authority."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import flight, log, model, without
from thrustmargin.gcs_plugin.logs.findings import Severity, takeoff_findings
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.events import takeoff_rows, yaw_rows
from thrustmargin.gcs_plugin.reports.margin.render import Written, html_text, json_text
from thrustmargin.models.flight import FlightTrack


def late(motor: int, seconds: float) -> FlightTrack:
    """The recorded flight with one motor, from 1, that begins to turn so many s later."""
    track = log().track
    speeds = track.rotor_speed_rpm.copy()
    first = track.time_s[np.argmax((speeds > 30.0).all(axis=1))]
    speeds[track.time_s < first + seconds, motor - 1] = 0.0
    return flight(rotor_speed_rpm=speeds)[0].track


def written(tmp_path) -> Written:
    return Written(html=tmp_path / "r.html", json=tmp_path / "r.json", csv=tmp_path / "r.csv")


def test_a_sound_flight_has_its_run_up_as_data():
    made = json.loads(json_text(build_report([flight()]), "r.csv"))
    (start,) = made["flights"][0]["takeoff"]
    assert start["findings"] == []
    assert [(m["motor"], m["name"], m["state"]) for m in start["motors"]] == [
        (1, "front right", "turns"),
        (2, "rear left", "turns"),
        (3, "front left", "turns"),
        (4, "rear right", "turns"),
    ]
    assert start["lift_s"] - start["begin_s"] == pytest.approx(5.1, abs=0.2)
    assert start["mass_kg"] == pytest.approx(start["stated_kg"], rel=0.05)
    assert start["sag_resistance"] == pytest.approx(0.025, abs=0.003)
    redundancy = made["flights"][0]["redundancy"]
    assert 0.5 < redundancy["yaw_reserve_min"] < redundancy["yaw_reserve_median"] <= 1.0


def test_a_late_motor_is_in_the_findings_and_on_the_page(tmp_path):
    flown = flight(late(3, 1.3))
    (start,) = takeoff_rows(flown[0])
    (found,) = start["findings"]
    assert (found["kind"], found["motors"], found["forbids"]) == ("late", [3], True)
    assert found["value"] == pytest.approx(1.3, abs=0.11)
    words = "motor 3 front left turned 1.3 s after the others: check its ESC, leads and bearing"
    assert found["words"] == words
    report = build_report([flown])
    (finding,) = [f for f in report.flights[0].json["findings"] if f.check == "take-off"]
    assert (finding.level, finding.words) == (Severity.GRAVE, words)
    page = html_text(report, written(tmp_path))
    assert "Before take-off" in page
    assert page.replace("\N{NO-BREAK SPACE}", " ").count(words) >= 2  # among the facts, and below


def test_without_rotor_speeds_it_says_not_known():
    flown = without("rotor_speed_rpm")
    (start,) = takeoff_rows(flown[0])
    assert {m["state"] for m in start["motors"]} == {"not known"}
    (finding,) = takeoff_findings(flown[0].track, model().airframe)
    assert finding.level is Severity.UNKNOWN
    assert finding.words.startswith("no rotor speed is reported: not known whether the motors turn")
    assert np.isnan(yaw_rows(flown[0])["yaw_reserve_min"])


def test_a_standing_yaw_moment_takes_yaw_authority():
    track = log().track
    spin = model().airframe.rotor_spin
    pulled = track.rotor_speed_rpm * np.where(spin > 0, 1.15, 0.83)
    before, after = (
        yaw_rows(flight(rotor_speed_rpm=speeds)[0])
        for speeds in (
            track.rotor_speed_rpm,
            pulled,
        )
    )
    assert before["yaw_reserve_median"] > 0.95
    assert after["yaw_reserve_median"] < 0.75
    assert track.flying[np.searchsorted(track.time_s, before["yaw_reserve_min_time_s"])]
