"""Reports of a vehicle beside what its log shows: which motor, control, yaw, or nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs.findings import Finding, Severity, event_findings
from thrustmargin.gcs_plugin.logs.log_answer import statement_words, with_statements
from thrustmargin.gcs_plugin.logs.vehicle_statements import (
    Corroboration,
    VehicleStatement,
    vehicle_statements,
)
from thrustmargin.gcs_plugin.telemetry.vehicle_events import (
    EventKind,
    VehicleEvent,
    flag_events,
    text_events,
)
from thrustmargin.gcs_plugin.wording.language import speaking
from thrustmargin.gcs_plugin.wording.vehicle_words import KINDS, corroboration_words
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.rotor_faults import FaultEpisode

TIME = np.arange(0.0, 60.0, 0.1)


def flown(outputs: list[float], speeds: list[float]) -> FlightTrack:
    rows = (TIME.size, 1)
    return FlightTrack.of(
        name="made",
        time_s=TIME,
        rotor_count=len(outputs),
        throttle=np.tile(outputs, rows),
        rotor_speed_rpm=np.tile(np.array(speeds, dtype=float), rows),
    )


SOUND = flown([0.6] * 6, [3000.0] * 6)
HARDEST = flown([0.6] * 5 + [0.9], [3000.0] * 5 + [4200.0])
FIVE_IS_WEAK = flown([0.6, 0.6, 0.6, 0.6, 0.62, 0.9], [3000, 3000, 3000, 3000, 2200, 3900])


def said(*texts: tuple[float, str]) -> list[VehicleEvent]:
    return list(text_events(texts))


def one(events: list[VehicleEvent], track: FlightTrack, **more: Any) -> VehicleStatement:
    (statement,) = vehicle_statements(events, track, **more)
    return statement


def weak(rotor: int, begin_s: float, end_s: float | None = None) -> FaultEpisode:
    fault = RotorFault(kind="propeller", rotor=rotor, size=0.12, lower=0.1, upper=0.14)
    return FaultEpisode(begin_s=begin_s, end_s=end_s, fault=fault)


THRUST = said((30.0, "Potential Thrust Loss (6)"))


def test_the_vehicle_names_the_motor_that_works_hardest_and_speeds_another():
    found = one(THRUST, FIVE_IS_WEAK)
    assert (found.corroboration, found.named, found.found) == (
        Corroboration.OTHER_MOTOR,
        (5,),
        (4,),
    )
    assert statement_words(found, None) == (
        "the vehicle names motor 6; speeds say 5: 6 works harder because 5 gives less"
    )


def test_a_fault_that_was_found_near_the_report_decides():
    other = one(THRUST, HARDEST, faults=[weak(4, 40.0)])
    assert (other.corroboration, other.found) == (Corroboration.OTHER_MOTOR, (4,))
    same = one(THRUST, HARDEST, faults=[weak(5, 20.0)])
    assert (same.corroboration, same.found) == (Corroboration.AGREES, (5,))
    assert statement_words(same, None) == "the log says the same: motor 6"
    long_over = one(THRUST, HARDEST, faults=[weak(4, 0.0, -5.0)])
    assert long_over.corroboration is Corroboration.HARDEST


def test_a_sound_motor_that_works_hardest_is_not_blamed():
    found = one(THRUST, HARDEST)
    assert (found.corroboration, found.found) == (Corroboration.HARDEST, ())
    words = statement_words(found, None)
    assert words.startswith("motor 6 had the highest output, 90 %, and its speed follows")
    assert words.endswith("nothing shows that it is bad")


def test_when_all_motors_are_near_full_output_none_is_blamed():
    assert one(THRUST, flown([0.93] * 6, [4300.0] * 6)).corroboration is Corroboration.ALL_HARD


def test_without_speeds_it_is_not_compared():
    found = one(THRUST, flown([0.6] * 6, [float("nan")] * 6))
    assert found.corroboration is Corroboration.NOT_COMPARED


def test_exchanged_motors_make_the_name_worthless():
    outputs = [0.35, 0.6, 0.9, 0.7]
    speeds = [4000.0 * share**0.9 for share in (0.9, 0.6, 0.35, 0.7)]
    found = one(said((30.0, "Potential Thrust Loss (3)")), flown(outputs, speeds))
    assert (found.corroboration, found.found) == (Corroboration.EXCHANGED, (0, 2))
    assert "motors 1 and 3 each follow" in statement_words(found, None)


def test_a_report_without_a_motor_gets_the_one_that_the_log_shows():
    event = [VehicleEvent(EventKind.MOTOR_FAILURE, 30.0)]
    assert one(event, FIVE_IS_WEAK).corroboration is Corroboration.MOTOR_FOUND
    assert one(event, SOUND).corroboration is Corroboration.FOLLOWS


def test_a_crash_report_beside_the_control_that_was_lost_or_kept():
    crash = said((30.0, "Crash: Disarming: AngErr=95>30, Accel=1.0<3.0"))
    lost = [LossOfControl(kind=LossKind.SPUN, time_s=29.0, value=7.0)]
    assert one(crash, SOUND, losses=lost).corroboration is Corroboration.CONTROL_LOST
    kept = one(crash, SOUND)
    assert kept.corroboration is Corroboration.CONTROL_KEPT
    assert statement_words(kept, None) == "the log shows no loss of control"


def test_yaw_imbalance_beside_the_yaw_authority_that_was_left():
    event = said((30.0, "Yaw Imbalance 87%"))
    reserve = np.where(np.abs(TIME - 30.0) < 6.0, 0.2, 0.9)
    found = one(event, SOUND, yaw_reserve=reserve)
    assert (found.corroboration, found.value) == (Corroboration.YAW, pytest.approx(0.2))
    assert statement_words(found, None) == "20 % of the yaw authority was left then"
    assert one(event, SOUND).corroboration is Corroboration.NOT_COMPARED


def test_reports_of_other_parts_are_listed_without_a_view():
    found = one(said((30.0, "EKF variance: pos horiz, vel"), (35.0, "EKF variance")), SOUND)
    assert (found.corroboration, found.times_s) == (Corroboration.NOTHING, (30.0, 35.0))
    assert statement_words(found, None) == ""


def test_an_error_code_that_repeats_a_text_is_one_report():
    code = VehicleEvent(EventKind.THRUST_LOSS, 30.4, "thrust loss check", "ERR 25 1")
    assert [s.text for s in vehicle_statements([*THRUST, code], SOUND)] == [
        "Potential Thrust Loss (6)"
    ]
    later = VehicleEvent(EventKind.THRUST_LOSS, 50.0, "thrust loss check", "ERR 25 1")
    assert len(vehicle_statements([*THRUST, later], SOUND)) == 2


def test_arming_and_what_is_over_is_no_report():
    events = [
        VehicleEvent(EventKind.ARMED, 1.0),
        VehicleEvent(EventKind.RESOLVED, 2.0, "EKF check", "ERR 16 0"),
        VehicleEvent(EventKind.PARAMETER, 3.0, "MOT_SPIN_MIN", "0.1 to 0.2"),
    ]
    assert vehicle_statements(events, SOUND) == ()


def test_a_motor_that_the_aircraft_does_not_have_is_not_named():
    assert one(said((30.0, "Potential Thrust Loss (9)")), SOUND).named == ()


def test_findings_get_what_the_log_shows_behind_them():
    findings = [*event_findings(THRUST), Finding("file", Severity.OK, "none damaged")]
    made = with_statements(findings, vehicle_statements(THRUST, FIVE_IS_WEAK), None)
    assert made[0].words.endswith("because 5 gives less")
    assert made[0].words.startswith(findings[0].words)
    assert made[1] == findings[1]
    # The event is matched, not its sentence: other words of the finding change nothing.
    renamed = [replace(findings[0], words="Meldung des Fahrzeugs")]
    (again,) = with_statements(renamed, vehicle_statements(THRUST, FIVE_IS_WEAK), None)
    assert again.words.startswith("Meldung des Fahrzeugs: ")


@pytest.mark.parametrize("beside", [b for b in Corroboration if b is not Corroboration.NOTHING])
def test_every_view_has_words_in_german(beside: Corroboration):
    given: dict[str, Any] = {"named": (5,), "found": (4,), "value": 0.9, "losses": "x"}
    english = corroboration_words(beside, **given)
    with speaking("de"):
        german = corroboration_words(beside, **given)
    assert english
    assert german != english
    assert "{" not in english + german


def test_every_kind_of_report_has_a_title():
    rest = {EventKind.ARMED, EventKind.DISARMED, EventKind.RESOLVED, EventKind.PARAMETER}
    assert set(KINDS) == {kind.value for kind in EventKind if kind not in rest}


def test_a_flag_is_an_event_each_time_that_a_bit_is_newly_set():
    time_s = np.arange(7.0)
    flags = np.array([0, 1, 1, 5, np.nan, 0, 1])
    made = list(flag_events(EventKind.ESC_FAILURE, time_s, flags, "3", "failure flags"))
    assert [(event.time_s, event.text) for event in made] == [
        (1.0, "failure flags 0x1"),
        (3.0, "failure flags 0x5"),
        (6.0, "failure flags 0x1"),
    ]
    assert {(event.kind, event.subject) for event in made} == {(EventKind.ESC_FAILURE, "3")}
