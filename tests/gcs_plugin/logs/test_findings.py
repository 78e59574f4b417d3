"""One list of findings: what the vehicle reported, counted and ordered by how grave it is."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import log, model
from thrustmargin.gcs_plugin.logs.findings import (
    Finding,
    Severity,
    Spoils,
    event_findings,
    gravest_first,
    names_wrong,
    report_findings,
)
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, VehicleEvent


def finding(check: str, level: str, **more) -> Finding:
    return Finding(check=check, level=Severity(level), words="w", **more)


def test_events_of_one_kind_are_one_finding_dated_by_the_first():
    events = [
        VehicleEvent(EventKind.ARMED, 1.0),
        VehicleEvent(EventKind.VIBRATION, 20.0, "", "Vibration compensation ON"),
        VehicleEvent(EventKind.THRUST_LOSS, 83.0, "3", "Potential Thrust Loss (3)"),
        VehicleEvent(EventKind.THRUST_LOSS, 84.0, "3", "Potential Thrust Loss (3)"),
        VehicleEvent(EventKind.RESOLVED, 90.0, "battery failsafe", "ERR 6 0"),
    ]
    vibration, thrust = event_findings(events)
    assert (vibration.level, thrust.level) == (Severity.WARNING, Severity.GRAVE)
    assert (thrust.time_s, thrust.values) == (83.0, {"count": 2.0})
    assert thrust.words == (
        "thrust loss (motor or part 3: Potential Thrust Loss (3)) at 1:23, 2 times"
    )
    assert gravest_first([vibration, thrust]) == (thrust, vibration)


def test_a_report_repeats_what_makes_it_wrong_and_what_the_vehicle_said():
    order = finding("motor order", "warning", spoils=Spoils.ROTOR_NAMES)
    said = finding("vehicle reported", "warning", time_s=3.0)
    harmless = finding("time", "warning")
    good = finding("motor order", "ok", spoils=Spoils.ROTOR_NAMES)
    assert report_findings([order, said, harmless, good]) == [order, said]
    assert names_wrong([order, said]) == ["rotor names cannot be trusted: w"]
    assert names_wrong([said]) == []


@pytest.mark.parametrize("shaken", [4.0, 6.0])
def test_vibration_is_strong_from_5_metres_a_second_squared_on(shaken: float):
    """To and fro by so much in every row is its standard deviation."""
    track = log().track
    rows = track.time_s.size
    force = np.tile([0.0, 0.0, -9.8], (rows, 1))
    force[:, 0] = np.where(np.arange(rows) % 2, shaken, -shaken)
    made = replace(log(), track=replace(track, specific_force_frd=force))
    (found,) = (
        f for f in inspect_log(made, model().airframe).findings if f.check == "accelerometer"
    )
    assert ("strong vibration, 6 m/s²" in found.words) == (shaken > 5.0)
    assert (found.level is Severity.WARNING) == (shaken > 5.0)
