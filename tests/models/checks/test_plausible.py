"""What a flight says against an airframe, and by what it is recognised as one of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.plausible import comparisons, recognition
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.vehicle_facts import VehicleFacts

ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16-sitl")
LOG = read_log(ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog", airframe=F16)
TRACK, FACTS, PARAMETERS = LOG.track, LOG.facts, LOG.parameters


def verdicts(track=TRACK, airframe=F16, facts=FACTS, parameters=PARAMETERS) -> dict[str, str]:
    return {c.check: c.verdict for c in comparisons(track, airframe, facts, parameters)}


def doubts_of(track, airframe, facts, parameters) -> tuple[str, ...]:
    found = comparisons(track, airframe, facts, parameters)
    return tuple(statement_words(c.found) for c in found if c.verdict == "contradicts")


def known_as(track=TRACK, airframe=F16, facts=FACTS, parameters=PARAMETERS) -> str:
    return ", ".join(
        map(statement_words, recognition(comparisons(track, airframe, facts, parameters)))
    )


def lacking(*channels: str):
    return replace(TRACK, **{c: np.full_like(getattr(TRACK, c), np.nan) for c in channels})


def test_a_flight_of_the_airframe_is_recognised_by_rotors_voltage_and_weight():
    words = known_as()
    assert words == "4 rotors by FRAME_CLASS 1, 56.0 V, rotors at 1,840 rpm for 28 kg within 1 %"


@pytest.mark.parametrize("name", ["agras-t20", "agras-t40", "crazyflie-rpm"])
def test_it_is_not_one_of_another_airframe(name):
    other = load_airframe(name)
    assert doubts_of(TRACK, other, FACTS, PARAMETERS)
    assert known_as(airframe=other) == ""


@pytest.mark.parametrize("stretch", [1.0, 1.04, 1.07, 0.96])
@pytest.mark.parametrize("volts", [48.5, 58.8])
def test_wear_a_hidden_load_and_an_empty_battery_do_not_hide_the_airframe(stretch, volts):
    # 8 % less thrust of every propeller is 4 % of speed; 3 kg on an empty F16 are 7 %.
    speeds = TRACK.rotor_speed_rpm * stretch
    track = replace(TRACK, rotor_speed_rpm=speeds, voltage=np.full_like(TRACK.voltage, volts))
    # The autopilot makes up for a low battery: these outputs are of the one that was flown.
    assert known_as(replace(track, throttle=np.full_like(TRACK.throttle, np.nan)))


@pytest.mark.parametrize("stretch", [0.88, 1.2])
def test_speeds_that_are_off_are_no_likeness(stretch):
    track = replace(TRACK, rotor_speed_rpm=TRACK.rotor_speed_rpm * stretch)
    assert verdicts(track)["rotor speed"] == "fits"
    silent = np.full_like(TRACK.throttle, np.nan)
    assert known_as(replace(track, throttle=silent)) == ""


def test_full_or_empty_the_tank_speaks_for_itself():
    assert "for 21 to 37 kg" in known_as(lacking("tank_kg"))


@pytest.mark.parametrize(
    ("volts", "verdict"),
    [(16.0, "contradicts"), (39.0, "contradicts"), (44.4, "fits"), (70.0, "contradicts")],
)
def test_a_battery_of_other_cells_contradicts(volts, verdict):
    found = verdicts(replace(TRACK, voltage=np.full_like(TRACK.voltage, volts)))
    assert found["voltage"] == verdict
    # What rests on a voltage that cannot be would only say the same again.
    assert ("motor output" in found) == (verdict != "contradicts")


def test_a_contradicting_voltage_says_how_far_the_same_battery_goes():
    half = replace(TRACK, voltage=np.full_like(TRACK.voltage, 0.5 * F16.nominal_voltage))
    (words,) = doubts_of(half, F16, FACTS, PARAMETERS)
    assert "50 % of the" in words
    assert words.endswith("; the same battery stays within 78 % to 122 %")
    just = replace(TRACK, voltage=np.full_like(TRACK.voltage, 0.778 * F16.nominal_voltage))
    (words,) = doubts_of(just, F16, FACTS, PARAMETERS)
    assert "77.8 % of the" in words  # not 78, which it says would do
    (fits,) = (c for c in comparisons(TRACK, F16, FACTS, PARAMETERS) if c.check == "voltage")
    assert statement_words(fits.found).endswith("of airframe topxgun-f16-sitl")


def test_another_number_of_rotors_ends_the_comparison():
    six = replace(FACTS, rotor_count=6, rotor_evidence="FRAME_CLASS 2")
    assert doubts_of(TRACK, F16, six, PARAMETERS) == (
        "6 rotors by FRAME_CLASS 2; airframe topxgun-f16-sitl has 4",
    )


def test_a_number_of_rotors_that_nothing_reports_is_no_doubt_and_no_ground():
    assert doubts_of(TRACK, F16, VehicleFacts(), PARAMETERS) == ()
    assert known_as(facts=VehicleFacts()) == ""


def test_a_plane_is_a_doubt_and_a_quadplane_is_not_recognised():
    plane = VehicleFacts(kind="plane", evidence="MAV_TYPE 1")
    assert "is a plane" in doubts_of(TRACK, F16, plane, PARAMETERS)[0]
    both = replace(FACTS, kind="quadplane", evidence="MAV_TYPE 20")
    assert doubts_of(TRACK, F16, both, PARAMETERS) == ()
    assert known_as(facts=both) == ""


def test_a_vehicle_that_says_two_numbers_of_motors_is_no_known_aircraft():
    facts = VehicleFacts(rotor_count=4, rotor_evidence="x", rotor_conflict="6 by MAV_TYPE 13")
    found = comparisons(TRACK, F16, facts, {})
    assert found[0].verdict == "contradicts"
    assert "but 6 by MAV_TYPE 13" in statement_words(found[0].found)
    assert recognition(found) == ()


def test_motors_in_other_places_are_a_doubt():
    plus = {**PARAMETERS, "FRAME_TYPE": 0.0}
    words = doubts_of(TRACK, F16, FACTS, plus)
    assert words[0].startswith("FRAME_CLASS 1 and FRAME_TYPE 0 are quad-plus, which puts")
    # The same shape in another order: motor 2 is front left.
    assert doubts_of(TRACK, F16, FACTS, {**PARAMETERS, "FRAME_TYPE": 13.0})


def test_electrical_rpm_is_a_doubt():
    words = doubts_of(
        replace(TRACK, rotor_speed_rpm=14 * TRACK.rotor_speed_rpm), F16, FACTS, PARAMETERS
    )
    assert "electrical rpm" in words[0]


def test_speeds_beyond_the_ceiling_are_a_doubt_for_long_and_not_for_a_moment():
    fast = TRACK.rotor_speed_rpm.copy()
    fast[600:620] = 3500.0
    assert "rotor speed limit" not in verdicts(replace(TRACK, rotor_speed_rpm=fast))
    fast[600:1100, 2] = 3500.0
    assert verdicts(replace(TRACK, rotor_speed_rpm=fast))["rotor speed limit"] == "contradicts"


@pytest.mark.parametrize("factor", [0.5, 0.7, 1.4])
def test_one_esc_that_reads_otherwise_than_the_others_is_named(factor):
    odd = replace(TRACK, rotor_speed_rpm=TRACK.rotor_speed_rpm * [1.0, factor, 1.0, 1.0])
    (words,) = (
        statement_words(c.found)
        for c in comparisons(odd, F16, FACTS, PARAMETERS)
        if c.check == "one ESC"
    )
    assert words.startswith(f"rotor 2 reads {factor:.2f} times the speed")
    assert "one ESC" not in verdicts()
    # A worn or another propeller, and a battery that hangs forward.
    for like in ([1.0, 1.1, 1.0, 1.0], [1.12, 0.88, 1.12, 0.88]):
        assert "one ESC" not in verdicts(
            replace(TRACK, rotor_speed_rpm=TRACK.rotor_speed_rpm * like)
        )
    # With outputs that ask for as much more it is no wonder.
    asked = replace(odd, throttle=TRACK.throttle * [1.0, factor, 1.0, 1.0])
    assert "one ESC" not in verdicts(asked)


def test_the_one_rotor_beyond_its_ceiling_is_named():
    for factors, named in (([1.0, 2.0, 1.0, 1.0], "rotor 2 turns"), ([2.0] * 4, "a rotor turns")):
        fast = replace(TRACK, rotor_speed_rpm=TRACK.rotor_speed_rpm * factors)
        found = comparisons(fast, F16, FACTS, PARAMETERS)
        (words,) = (statement_words(c.found) for c in found if c.check == "rotor speed limit")
        assert words.startswith(named)


@pytest.mark.parametrize("output", [0.85, 1.15, np.nan])
def test_without_a_load_speeds_recognise_only_as_the_outputs_drive_them(output):
    # From empty to full the weight of an F16 fits many aircraft, its motors do not.
    track = replace(lacking("tank_kg"), throttle=TRACK.throttle * output)
    assert verdicts(track)["rotor speed"] == "fits"
    assert known_as(track) == ""


def test_without_rotor_speeds_outputs_recognise_only_with_a_known_load():
    assert "motor outputs of 67 % for 28 kg" in known_as(lacking("rotor_speed_rpm"))
    assert known_as(lacking("rotor_speed_rpm", "tank_kg")) == ""
    assert known_as(lacking("rotor_speed_rpm", "throttle")) == ""


def test_outputs_that_could_not_lift_the_weight_are_a_doubt():
    low = replace(lacking("rotor_speed_rpm"), throttle=np.full_like(TRACK.throttle, 0.28))
    assert verdicts(low)["motor output"] == "contradicts"


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (SourceKind.STATED, "which weighs 28 kg with the load that is stated"),
        (SourceKind.AIRFRAME, "which weighs 28 kg with the load that is stated"),
        (SourceKind.MESSAGE, "which weighs 28 kg by the gauge"),
    ],
)
def test_a_weight_is_by_the_gauge_only_where_there_is_one(kind, said):
    low = replace(
        lacking("rotor_speed_rpm"),
        throttle=np.full_like(TRACK.throttle, 0.28),
        sources={**TRACK.sources, "tank_kg": Provenance(kind=kind, name="--load 8")},
    )
    (words,) = (w for w in doubts_of(low, F16, FACTS, PARAMETERS) if "motor outputs" in w)
    assert said in words
    assert ("gauge" in words) == (kind is SourceKind.MESSAGE)


def test_what_was_inferred_with_the_airframe_is_no_evidence_for_it():
    guessed = replace(
        TRACK,
        standard_errors={
            "rotor_speed_rpm": np.full_like(TRACK.rotor_speed_rpm, 30.0),
            "tank_kg": np.full_like(TRACK.tank_kg, 1.0),
        },
    )
    found = verdicts(guessed)
    assert found["rotor speed"] == "unknown"
    assert known_as(guessed) == ""


def test_a_flight_on_the_ground_says_nothing():
    ground = replace(TRACK, flying=np.zeros_like(TRACK.flying))
    assert doubts_of(ground, F16, FACTS, PARAMETERS) == ()
    assert known_as(ground) == ""
