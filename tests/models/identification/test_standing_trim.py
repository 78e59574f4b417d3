"""A split of the pairs is a trim of the aircraft before it is a fault of one rotor."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, QUICK, curve_model, made_flight, made_flights, table
from thrustmargin.gcs_plugin.wording.identify_answer import open_questions
from thrustmargin.models.effects.rotor_degradation import ROTOR_DEGRADATION
from thrustmargin.models.identification.candidate import Scored, _chips
from thrustmargin.models.identification.fit import Evaluator, fit_terms
from thrustmargin.models.identification.identify import identify
from thrustmargin.models.identification.problem import airspeed_is_ground_speed, assemble
from thrustmargin.models.identification.standing_trim import unflyable
from thrustmargin.models.identification.surrogates import p_value
from thrustmargin.models.identification.terms import Term

TABLE = ("rotor_degradation", "yaw_trim", "cg_offset", "extra_mass")


def split(track, pairs: float, along: float):
    """Thrust of the counter-clockwise pair up by `pairs`, of the front rotors by `along`."""
    more = 1.0 + pairs * F16.rotor_spin + along * np.sign(F16.rotor_position_frd[:, 0])
    return replace(track, rotor_speed_rpm=track.rotor_speed_rpm * np.sqrt(more))


def test_a_split_of_the_pairs_is_a_yaw_trim_and_no_rotor():
    flights = [split(t, -0.12, -0.03) for t in made_flights(3)]
    found = identify(flights, curve_model(), config=QUICK, catalogue=table(TABLE))
    assert {f.term.key for f in found.found} == {"yaw_trim", "cg_offset"}
    moment = next(f for f in found.found if f.term.key == "yaw_trim").value[0, 0]
    weight = np.mean([(F16.empty_mass + t.tank_kg.mean()) * 9.80665 for t in flights])
    assert moment == pytest.approx(-0.12 * weight * F16.torque_ratio, rel=0.15)


def test_a_worn_rotor_stays_a_worn_rotor():
    flights = made_flights(3, loss=0.12, rotor=3)
    found = identify(flights, curve_model(), config=QUICK, catalogue=table(TABLE))
    assert [(f.term.effect.name, f.term.rotor) for f in found.found] == [("rotor_degradation", 3)]


def test_a_loss_that_nobody_could_have_flown_with_is_no_name_and_said_so():
    """At full tank the F16 can be flown with (1 - u) 2 of a rotor's thrust gone, u its use."""
    problem = assemble(curve_model(), [made_flight(0, loss=0.3)])
    evaluator = Evaluator(problem)
    term = Term(effect=ROTOR_DEGRADATION, rotor=0)
    fit = fit_terms(evaluator, (term,), scales=np.ones(4))
    scored = Scored(term=term, fit=fit, held_out=np.zeros(1), gain=1.0)
    assert unflyable(problem, scored) is None
    heavy = replace(problem.model, airframe=replace(F16, max_rotor_speed_rpm=2050.0))
    loss = unflyable(replace(problem, model=heavy), scored)
    assert loss is not None
    assert loss.rotor == 0
    assert loss.loss == pytest.approx(0.3, abs=0.02)
    x = problem.channels
    load = np.median(x.total_mass) * 9.80665 / 4
    ceiling = F16.thrust_coefficient * 2050.0**2 * np.median(x.density) / F16.reference_density
    ceiling *= min(np.median(x.voltage) / F16.ceiling_voltage, 1.0) ** 2
    assert loss.most == pytest.approx(2.0 * (1.0 - load / ceiling), abs=1e-3)
    found = identify(made_flight(0), curve_model(), config=QUICK, catalogue=table(["extra_mass"]))
    (line,) = open_questions(replace(found, unflyable=(loss,)))
    assert line.startswith("Rotor 1 (front right) would have to make 30 % less thrust")
    assert "level the motors, swap two propellers" in line


def test_a_chip_is_a_loss_and_does_not_come_anew_in_most_flights():
    assert _chips(np.array([0.0, 0.1, 0.02]), per_flight=True)
    assert not _chips(np.array([0.0, -0.1, 0.02]), per_flight=True)
    assert not _chips(np.array([0.08, 0.1, 0.02]), per_flight=True)
    assert _chips(np.array([0.1, 0.1, 0.1]), per_flight=False)
    assert _chips(np.array([0.1]), per_flight=True)


def test_an_airspeed_is_speed_over_ground_where_its_source_says_so():
    """Still air that was measured, as in a hall with motion capture, is no missing wind."""
    track = made_flight(0)
    still = np.zeros((track.time_s.size, 3))
    assert not airspeed_is_ground_speed(replace(track, wind_ned=still))
    named = {"airspeed": "XKF1 velocity (EKF; ground speed: no wind is estimated)"}
    assert airspeed_is_ground_speed(replace(track, sources=named))


def test_a_chance_that_is_no_number_counts_against_the_effect():
    assert p_value(2.0, np.array([1.0, 3.0, np.nan, 0.0])) == pytest.approx(3 / 5)
