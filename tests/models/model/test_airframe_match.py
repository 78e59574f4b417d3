"""Given, recognised or not known: when a margin is claimed, and that nothing leaks when not."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.flight_channels import with_rotor_count
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import (
    airframe_match_words,
    described_words,
    no_verdict_words,
    remedy_words,
    statement_words,
)
from thrustmargin.models.model.airframe_match import AirframeMatch, match_airframe, unknown_aircraft
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.motor_layouts import motor_layouts
from thrustmargin.models.statement import state
from thrustmargin.models.vehicle_facts import VehicleFacts

ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16-sitl")
LOG = read_log(ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog", airframe=F16)
SMALL = replace(LOG.track, voltage=np.full_like(LOG.track.voltage, 16.0))


def match_log(track=LOG.track, *, given: bool):
    return match_airframe(track, F16, LOG.facts, LOG.parameters, given=given)


def unlike_words(made: AirframeMatch) -> str:
    assert made.unlike is not None
    return statement_words(made.unlike)


def test_an_airframe_that_nobody_gave_is_taken_when_it_is_recognised_and_this_is_said():
    found = match_log(given=False)
    assert (found.basis, found.no_verdict) == ("recognised", ())
    assert airframe_match_words(found).startswith(
        "airframe topxgun-f16-sitl: nobody named it, and the flight fits it (4 rotors by FRAME"
    )
    assert described_words(found) == airframe_match_words(found)
    assert "name one with" in remedy_words(found)


def test_without_grounds_there_is_no_airframe_and_the_reason_and_the_command_are_said():
    found = match_log(SMALL, given=False)
    assert found.basis == "not known"
    assert no_verdict_words(found) == ["this aircraft is not known: no airframe was given"]
    assert "not recognised as one of topxgun-f16-sitl: 16.0 V in flight" in unlike_words(found)
    assert f"`thrustmargin airframe new --from {SMALL.name}`" in remedy_words(found)


def test_the_reason_is_the_first_thing_that_is_not_close():
    silent = replace(LOG.track, voltage=np.full(LOG.track.time_s.size, np.nan))
    assert ": no battery voltage in flight" in unlike_words(match_log(silent, given=False))


def test_of_several_contradictions_the_first_is_the_reason_and_a_given_airframe_hears_all():
    plus = {**LOG.parameters, "FRAME_TYPE": 0.0}
    unknown = match_airframe(SMALL, F16, LOG.facts, plus, given=False)
    assert ": FRAME_CLASS 1 and FRAME_TYPE 0 are quad-plus" in unlike_words(unknown)
    given = match_airframe(SMALL, F16, LOG.facts, plus, given=True)
    assert [words.split()[0] for words in no_verdict_words(given)] == ["FRAME_CLASS", "16.0"]


def test_what_is_guessed_of_the_airframe_and_widens_the_margin_is_said():
    real = load_airframe("topxgun-f16")
    found = match_airframe(LOG.track, real, LOG.facts, LOG.parameters, given=True)
    assert airframe_match_words(found).endswith(
        "given; guessed in it: voltage of the largest rotor speed"
    )


def test_a_given_airframe_stays_unless_something_speaks_against_it():
    assert match_log(given=True).no_verdict == ()
    nothing = replace(LOG.track, flying=np.zeros_like(LOG.track.flying))
    assert match_log(nothing, given=True).no_verdict == ()
    doubted = match_log(SMALL, given=True)
    assert doubted.basis == "given"
    assert "16.0 V" in no_verdict_words(doubted)[0]
    assert described_words(doubted) == f"NO VERDICT: {no_verdict_words(doubted)[0]}"
    assert "name another with --airframe" in remedy_words(doubted)


def test_a_voltage_of_no_battery_of_the_airframe_asks_for_voltmeter_and_cells():
    """An airframe made anew from the same log has the same voltage: no way out."""
    remedy = remedy_words(match_log(SMALL, given=True))
    assert remedy.startswith("set the voltmeter's scale right")
    assert "--cells COUNT" in remedy
    hexacopter = replace(LOG.facts, rotor_count=6)
    other = match_airframe(SMALL, F16, hexacopter, LOG.parameters, given=True)
    assert remedy_words(other).startswith("set right what reads wrong")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rotors", [0, 4, 6])
def test_no_number_of_a_withheld_analysis_needs_an_airframe(rotors):
    track = LOG.track
    if rotors != 4:
        track = with_rotor_count(track, rotors)
    facts = VehicleFacts(rotor_count=rotors, rotor_evidence="a test")
    doubted = match_airframe(SMALL, F16, facts, {}, given=True)
    flight = analyse(
        track,
        physics_model(F16),
        airframe_match=replace(doubted, no_verdict=(state("no voltage"),)),
    )
    plain = {"track", "model", "airframe_match", "start", "density_error", "density_given"}
    plain |= {"density", "density_basis", "voltage_basis", "beyond_gauge_kg", "bad_part", "change"}
    for field in fields(flight):
        if field.name == "prediction":
            assert not flight.prediction.basis.any()
        elif field.name not in plain:
            assert np.isnan(getattr(flight, field.name)).all(), field.name
    assert flight.model is unknown_aircraft(rotors)
    assert flight.voltage_basis == state("no airframe")
    assert flight.model.airframe.rotor_count == rotors


@pytest.mark.parametrize(("rotors", "layout"), [(4, "quad-x"), (6, "hexa-x"), (8, "octo-x")])
def test_an_unknown_aircraft_is_drawn_as_the_usual_one_with_so_many_rotors(rotors, layout):
    airframe, usual = unknown_aircraft(rotors).airframe, motor_layouts()[layout]
    np.testing.assert_array_equal(airframe.rotor_position_frd[:, :2], usual.place)
    np.testing.assert_array_equal(airframe.rotor_position_frd[:, 2], np.zeros(rotors))
    np.testing.assert_array_equal(airframe.rotor_spin, usual.spin)
    assert airframe.rotor_names == tuple(f"motor {k}" for k in range(1, rotors + 1))
    # Discs on arms of 1 m that are seen, and do not reach over the body's centre.
    assert 0.5 < airframe.propeller_diameter < 1.0


def test_rotors_of_a_layout_without_a_name_are_drawn_evenly_round_the_nose():
    places = unknown_aircraft(5).airframe.rotor_position_frd
    bearing = np.degrees(np.arctan2(places[:, 1], places[:, 0])) % 360.0
    np.testing.assert_allclose(bearing, [36.0, 108.0, 180.0, 252.0, 324.0])
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 1.0)
