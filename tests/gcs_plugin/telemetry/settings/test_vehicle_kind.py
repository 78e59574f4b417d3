"""What kind of vehicle it is, by each thing it can say of itself; by hand."""

import math

import pytest

from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import motor_outputs, whole_number
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.wording.check_words import statement_words, value_words
from thrustmargin.models.vehicle_facts import VehicleFacts

FOUR = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}
REAR = {f"SERVO{n}_FUNCTION": 28.0 + n for n in range(5, 9)}


@pytest.mark.parametrize(
    ("text", "kind", "evidence"),
    [
        ("ArduCopter V4.5.7 (2a3dc4b7)", "multirotor", "ArduCopter V4.5.7"),
        ("APM:Copter V3.3 (acf7b8a2)", "multirotor", "APM:Copter V3.3"),
        ("ArduPlane V4.3.0beta1 (abc)", "plane", "ArduPlane V4.3.0"),
        ("APM:Plane V3.8.0", "plane", "APM:Plane V3.8.0"),
        ("ArduRover V4.2.3", "rover", "ArduRover V4.2.3"),
        ("ArduSub V4.1.0", "submarine", "ArduSub V4.1.0"),
        ("Blimp V4.4.0", "airship", "Blimp V4.4.0"),
    ],
)
def test_a_program_introduces_itself(text, kind, evidence):
    facts = vehicle_facts({}, texts=("Free RAM: 1331", text, "ArduPlane is not this"))
    assert (facts.kind, value_words(facts.evidence)) == (kind, f"boot text '{evidence}'")
    assert facts.rotor_count == 0
    assert vehicle_facts({}, texts=("upgrade from ArduPlane V4",)).kind == "unknown"


@pytest.mark.parametrize(
    ("mav_type", "kind", "rotors"),
    [
        # The types of MAV_TYPE in common.xml.
        *((k, "plane", 0) for k in (1, 16, 17, 28)),
        (2, "multirotor", 4),
        *((k, "helicopter", 0) for k in (3, 4)),
        (5, "antenna tracker", 0),
        *((k, "airship", 0) for k in (7, 8)),
        *((k, "other vehicle", 0) for k in (9, 18, 26)),
        (10, "rover", 0),
        (11, "boat", 0),
        (12, "submarine", 0),
        (13, "multirotor", 6),
        (14, "multirotor", 8),
        (15, "multirotor", 3),
        *((k, "quadplane", 0) for k in range(19, 26)),
        *((k, "unknown", 0) for k in (6, 27)),
        (43, "multirotor", 0),
        (29, "multirotor", 12),
        (35, "multirotor", 10),
        (0, "unknown", 0),
        (-1, "unknown", 0),
        (None, "unknown", 0),
    ],
)
def test_a_heartbeat_names_the_type(mav_type, kind, rotors):
    facts = vehicle_facts({}, mav_type=mav_type)
    assert (facts.kind, facts.rotor_count) == (kind, rotors)


@pytest.mark.parametrize(
    ("parameters", "kind", "rotors"),
    [
        # PX4
        ({"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 6}, "multirotor", 6),
        ({"CA_AIRFRAME": 8, "CA_ROTOR_COUNT": 12}, "multirotor", 12),
        ({"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 13}, "multirotor", 0),
        ({"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "CA_ROTOR0_AX": -0.51}, "multirotor", 3),
        ({"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "CA_ROTOR0_AX": -0.49}, "multirotor", 4),
        ({"CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 1}, "plane", 0),
        *(({"CA_AIRFRAME": k, "CA_ROTOR_COUNT": 4}, "quadplane", 4) for k in (2, 3, 4)),
        *(({"CA_AIRFRAME": k, "CA_ROTOR_COUNT": 4}, "rover", 0) for k in (5, 6, 13)),
        ({"CA_AIRFRAME": 7, "CA_ROTOR_COUNT": 8}, "submarine", 0),
        ({"CA_AIRFRAME": 9, "CA_ROTOR_COUNT": 4}, "unknown", 4),
        *(({"CA_AIRFRAME": k, "CA_ROTOR_COUNT": 1}, "helicopter", 0) for k in (10, 11, 12)),
        *(({"CA_AIRFRAME": k, "CA_ROTOR_COUNT": 1}, "other vehicle", 0) for k in (14, 15)),
        ({"CA_AIRFRAME": 2, "CA_ROTOR_COUNT": 5, "CA_ROTOR4_AX": 1.0}, "quadplane", 4),
        ({"SYS_AUTOSTART": 4001}, "multirotor", 0),
        *(({"SYS_AUTOSTART": 1000 * k}, "multirotor", 0) for k in (4, 5, 6, 7, 8, 9, 11, 12, 14)),
        *(({"SYS_AUTOSTART": 1000 * k + 100}, "plane", 0) for k in (2, 3)),
        ({"SYS_AUTOSTART": 13000}, "quadplane", 0),
        *(({"SYS_AUTOSTART": 1000 * k}, "helicopter", 0) for k in (15, 16)),
        *(({"SYS_AUTOSTART": 1000 * k}, "rover", 0) for k in (50, 51, 52, 53)),
        ({"SYS_AUTOSTART": 60100}, "submarine", 0),
        *(({"SYS_AUTOSTART": 1000 * k}, "unknown", 0) for k in (1, 10, 17, 54, 61)),
        # ArduPilot without its boot text
        ({"TECS_CLMB_MAX": 5.0}, "plane", 0),
        ({"ATC_STR_RAT_P": 0.2, "FRAME_CLASS": 1.0}, "rover", 0),
        ({"ATC_STR_RAT_P": 0.2, "FRAME_CLASS": 2.0}, "boat", 0),
        ({"JS_GAIN_DEFAULT": 0.5, **FOUR}, "submarine", 0),
        ({"MOT_SPIN_MIN": 0.15, "FRAME_CLASS": 3.0}, "multirotor", 8),
        ({"MOT_SPIN_MIN": 0.15, "FRAME_CLASS": 6.0, **FOUR}, "helicopter", 0),
        ({"FRAME_CLASS": 13.0}, "helicopter", 0),
        ({"FRAME_CLASS": 1.0, **FOUR, **REAR}, "unknown", 4),
        # Quadplanes: the hover motors must be found among the outputs
        ({"TECS_CLMB_MAX": 5.0, "Q_ENABLE": 1.0, "Q_FRAME_CLASS": 1.0, **REAR}, "quadplane", 4),
        ({"TECS_CLMB_MAX": 5.0, "Q_ENABLE": 1.0, "Q_FRAME_CLASS": 1.0}, "quadplane", 0),
        ({"TECS_CLMB_MAX": 5.0} | {f"SERVO{n}_FUNCTION": 32.0 + n for n in (1, 2)}, "plane", 0),
        (
            {"TECS_CLMB_MAX": 5.0} | {f"SERVO{n}_FUNCTION": 32.0 + n for n in (1, 2, 3)},
            "quadplane",
            3,
        ),
        ({"TECS_CLMB_MAX": 5.0, "Q_ENABLE": 0.0, "Q_FRAME_CLASS": 1.0}, "plane", 0),
        ({}, "unknown", 0),
    ],
)
def test_parameters_tell_where_nothing_else_does(parameters, kind, rotors):
    facts = vehicle_facts(parameters)
    assert (facts.kind, facts.rotor_count) == (kind, rotors)
    assert bool(facts.evidence) == (kind != "unknown")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1.5, 1e300])
def test_a_parameter_that_is_no_whole_number_is_none(value):
    damaged = {"FRAME_CLASS": value, "SERVO1_FUNCTION": value, "Q_ENABLE": value}
    assert whole_number(damaged, "FRAME_CLASS") in (None, int(1e300))
    assert motor_outputs(damaged) == {}
    facts = vehicle_facts({**damaged, "CA_ROTOR_COUNT": value, "SYS_AUTOSTART": value})
    assert (facts.kind, facts.rotor_count) == ("unknown", 0)


def test_a_copter_program_flies_helicopters_too():
    facts = vehicle_facts({}, mav_type=4, texts=("ArduCopter V4.5.7",))
    assert (facts.kind, facts.evidence) == ("helicopter", "MAV_TYPE 4")
    for count, words in ((4, "CA_ROTOR_COUNT"), (5, "CA_ROTORn_AX")):
        given = {"CA_AIRFRAME": 2, "CA_ROTOR_COUNT": count, "CA_ROTOR4_AX": 1.0}
        assert vehicle_facts(given).rotor_evidence == words


def test_the_frame_text_tells_the_rotors():
    texts = ("ArduCopter V4.5.7", "Frame: HEXA/X")
    facts = vehicle_facts({}, texts=texts)
    assert (facts.rotor_count, value_words(facts.rotor_evidence)) == (6, "text 'Frame: HEXA/X'")
    assert vehicle_facts({}, texts=("ArduCopter V4.5.7", "Frame: UNSUPPORTED")).rotor_count == 0


@pytest.mark.parametrize(
    ("parameters", "mav_type", "count", "conflict"),
    [
        (FOUR, 13, 4, "6 by MAV_TYPE 13"),
        (FOUR | {"FRAME_CLASS": 2.0}, None, 4, "6 by FRAME_CLASS 2"),
        ({"FRAME_CLASS": 1.0}, 13, 4, "6 by MAV_TYPE 13"),
        (FOUR | {"FRAME_CLASS": 1.0}, 14, 4, "8 by MAV_TYPE 14"),
        # Outputs beyond those of the frame are spare; a frame of any matrix has the type of a quad.
        ({f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 7)}, 2, 6, ""),
        (FOUR | {"FRAME_CLASS": 1.0}, 2, 4, ""),
        (FOUR, 0, 4, ""),
        # PX4's type is set apart from its rotors.
        ({"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 6}, 2, 6, ""),
    ],
)
def test_two_numbers_of_rotors_are_both_said(parameters, mav_type, count, conflict):
    facts = vehicle_facts(parameters, mav_type=mav_type)
    assert (facts.rotor_count, value_words(facts.rotor_conflict)) == (count, conflict)
    words = statement_words(facts.statement)
    assert words.endswith(f", but {conflict}") if conflict else "but" not in words


def refusal_words(facts: VehicleFacts, name: str) -> str:
    refusal = facts.refusal(name)
    assert refusal is not None
    return statement_words(refusal)


def test_what_is_refused_and_in_which_words():
    plane = vehicle_facts({}, texts=("ArduPlane V4.3.0",))
    assert refusal_words(plane, "north.BIN") == (
        "north.BIN: this is a plane (by boot text 'ArduPlane V4.3.0'), "
        "and thrustmargin is for multirotors"
    )
    hidden = vehicle_facts({"Q_FRAME_CLASS": 1.0}, mav_type=20)
    assert "nothing says which outputs are its hover motors" in refusal_words(hidden, "x")
    quad = vehicle_facts(FOUR, mav_type=2)
    assert (quad.refusal("x"), statement_words(quad.statement)) == (
        None,
        "multirotor by MAV_TYPE 2; 4 rotors by SERVOn_FUNCTION",
    )
    words = statement_words(vehicle_facts({}).statement)
    assert words == "kind of vehicle: not reported; rotors: not reported"
