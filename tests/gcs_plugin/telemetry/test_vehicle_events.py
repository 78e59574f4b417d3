"""What a vehicle reports of itself: texts as ArduPilot and PX4 send them, and ArduPilot's ERR."""

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.vehicle_events import (
    EventKind,
    VehicleEvent,
    arming_events,
    error_events,
    parameter_events,
    text_events,
)

NAN = float("nan")


@pytest.mark.parametrize(
    ("text", "kind", "subject"),
    [
        ("Potential Thrust Loss (3)", "thrust loss", "3"),
        ("Yaw Imbalance 62%", "yaw imbalance", ""),
        ("Crash: Disarming: AngErr=65>30, Accel=1.1<3.0", "crash", ""),
        ("Battery 2 is critical 39.90V used 12000 mAh", "battery failsafe", "2"),
        ("Battery Failsafe", "battery failsafe", ""),
        ("Vibration compensation ON", "vibration", ""),
        ("Vibration compensation OFF", "resolved", ""),
        ("GCS Failsafe", "ground station failsafe", ""),
        ("GCS Failsafe Cleared", "resolved", ""),
        ("[commander] Critical failure detected: terminate flight", "flight terminated", ""),
        ("Attitude failure detected", "attitude failure", ""),
        ("[failsafe] Attitude failure detected\t", "attitude failure", ""),
    ],
)
def test_texts_by_their_beginnings(text: str, kind: str, subject: str):
    assert list(text_events([(7.0, text)])) == [VehicleEvent(EventKind(kind), 7.0, subject, text)]


@pytest.mark.parametrize(
    "text", ["", "Mission: 4 WP", "No Potential Thrust Loss (3)", "Frame: QUAD/X", "crashing waves"]
)
def test_texts_that_say_nothing_of_it(text: str):
    assert list(text_events([(7.0, text)])) == []


def test_errors_by_ardupilots_table():
    part = np.array([6.0, 6.0, 12.0, 12.0, 25.0, 24.0, 99.0, NAN])
    code = np.array([1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 1.0])
    found = list(error_events(np.arange(8.0), part, code))
    assert [(str(e.kind), e.subject, e.time_s) for e in found] == [
        ("battery failsafe", "battery failsafe", 0.0),
        ("resolved", "battery failsafe", 1.0),
        ("crash", "crash check", 2.0),
        ("lost control", "crash check", 3.0),
        ("thrust loss", "thrust loss check", 4.0),
        ("estimator", "EKF primary core", 5.0),  # core 0 is a core, not an end
        ("other", "subsystem 99", 6.0),
    ]
    assert found[2].text == "ERR 12 1"


def test_arming_is_told_where_it_changes():
    armed = Signal("armed", sent("HEARTBEAT x"), np.arange(6.0), np.array([0.0, 1, 1, NAN, 0, 0]))
    found = [(e.kind, e.time_s) for e in arming_events(armed)]
    assert found == [(EventKind.ARMED, 1.0), (EventKind.DISARMED, 4.0)]
    assert list(arming_events(None)) == []


def test_a_parameter_that_numbers_rest_on_is_an_event_when_it_changes():
    sent_values = [
        (0.0, "MOT_SPIN_MIN", 0.15),
        (1.0, "WP_SPD", 5.0),
        (2.0, "MOT_SPIN_MIN", 0.15),
        (3.0, "WP_SPD", 9.0),
        (4.0, "MOT_THST_HOVER", 0.2),
        (5.0, "MOT_THST_HOVER", 0.3),
        (6.0, "MOT_SPIN_MIN", 0.5),
        (7.0, "MOT_SPIN_MIN", NAN),
    ]
    (event,) = parameter_events(sent_values)
    text = "0.15 to 0.5; the whole log is read by the last"
    assert event == VehicleEvent(EventKind.PARAMETER, 6.0, "MOT_SPIN_MIN", text)
    (by_first,) = parameter_events(sent_values, first=True)
    assert by_first.text.endswith("by the first")
