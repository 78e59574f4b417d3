"""One list of findings: what the vehicle reported, counted and ordered by how grave it is."""

from thrustmargin.gcs_plugin.logs.findings import (
    Finding,
    Severity,
    Spoils,
    event_findings,
    gravest_first,
    names_wrong,
    repeated,
)
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
    assert repeated([order, said, harmless, good]) == [order, said]
    assert names_wrong([order, said]) == ["rotor names cannot be trusted: w"]
    assert names_wrong([said]) == []
