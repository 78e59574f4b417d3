"""Outputs without a model of sound flights name no cause of what stands all the time."""

from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import FROM_OUTPUTS
from tests.models.known_effects import known_effect
from tests.models.made_flights import curve_model, made_flight
from thrustmargin.gcs_plugin.workshop.identify.identify_words import (
    nothing_missing_words,
    standing_words,
)
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.output_shares import is_constant_share
from thrustmargin.models.identification.rows.problem import assemble_flight
from thrustmargin.models.model.rotor_model import model_channels, physics_model, table_of
from thrustmargin.models.physics.airframe import load_airframe

NAMES = ("front right", "rear left", "front left", "rear right")


SOUND = (0.0, 0.0, 0.0, 0.0)


def flights(*off: float, count: int = 3):
    """Flights by outputs alone, each rotor's equivalent speed off by a share of itself."""
    found = []
    for k in range(count):
        track = made_flight(k, duration=60.0)
        speed = track.rotor_speed_rpm * (1.0 + np.array(off))
        sources = {"rotor_speed_rpm": FROM_OUTPUTS}
        found.append(replace(track, rotor_speed_rpm=speed, sources=sources))
    return found


def effects(found):
    return {f.term.effect.name for f in found.found}


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize(
    "off",
    [
        (-0.04, 0.015, 0.0, 0.02),  # motors of a sound quad that differ
        (0.09, -0.03, -0.04, -0.01),  # a propeller cut on rotor 1
        (-0.03, 0.03, -0.03, 0.03),  # a centre of gravity aft
    ],
)
def test_no_cause_is_named_and_the_difference_is_reported(off, count):
    found = identify(flights(*off, count=count), curve_model())
    assert not effects(found) & {"rotor_degradation", "cg_offset", "yaw_trim"}
    assert (found.mentioned, found.one_of) == ((), ())
    terms = {term.effect.name for one in found.alternatives for term in one.terms}
    assert not terms & {"rotor_degradation", "cg_offset", "yaw_trim"}
    shares = found.constant_shares
    assert shares is not None
    mean = np.mean([f.rotor_speed_rpm.mean() for f in flights(*SOUND, count=count)])
    assert np.array(shares.rotor_rpm) / mean == pytest.approx(
        np.array(off) - np.mean(off), abs=3e-3
    )
    assert np.shape(shares.per_flight_rpm) == (count, 4)
    assert shares.trim is not None


def test_each_cause_makes_the_difference_by_itself():
    """A rotor that lacks 15 % with no more torque than it had, as outputs would show it."""
    found = identify(flights(0.05, -0.014, -0.018, -0.018), curve_model()).constant_shares
    assert found is not None
    by_rotor = {one.rotor: one for one in found.weak_rotors}
    # Yaw tells the direction of rotation: rotors 1 and 2 turn one way, 3 and 4 the other.
    assert set(by_rotor) <= {0, 1}
    model = curve_model()
    problem = assemble_flight(model, flights(*SOUND)[0])
    assert found.trim is not None
    for one in (found.trim, *found.weak_rotors):
        cg = known_effect("cg_offset")
        made = [Placed(effect=cg, rotor=None, values={"x": one.cg_x, "y": one.cg_y})]
        if one.rotor is None:
            yaw = known_effect("yaw_trim")
            made.append(Placed(effect=yaw, rotor=None, values={"moment": one.yaw_moment}))
        else:
            values = {"loss": one.loss, "torque_share": 1.0}
            loss = known_effect("rotor_degradation")
            made.append(Placed(effect=loss, rotor=one.rotor, values=values))
            assert one.loss_range[0] <= one.loss <= one.loss_range[1]
        change = (problem.speeds(made) - problem.speeds()).mean(axis=0)
        assert change == pytest.approx(np.array(found.rotor_rpm), abs=0.15 * max(found.rotor_rpm))


def test_a_model_of_sound_flights_names_the_rotor():
    taught = replace(curve_model(), background_rpm=(12.0,) * 4)
    weak = identify(flights(0.09, -0.03, -0.03, -0.03), taught)
    assert weak.constant_shares is None
    assert [f.term.rotor for f in weak.found if f.term.effect.name == "rotor_degradation"] == [0]


def test_of_flights_that_differ_the_one_that_differs_most_is_reported():
    """Sound first and damaged later: that it changed is said, and of which flight."""
    given = [*flights(*SOUND, count=3), *flights(0.09, -0.03, -0.03, -0.03, count=4)[3:]]
    found = identify(given, curve_model())
    assert not effects(found) & {"rotor_degradation", "cg_offset", "yaw_trim"}
    shares = found.constant_shares
    assert shares is not None
    assert shares.flight == 3
    assert int(np.argmax(shares.rotor_rpm)) == 0
    assert f"most in {given[3].name}" in standing_words(shares, NAMES, found.problem.names)[0]


def test_what_is_too_small_to_matter_is_not_reported():
    found = identify(flights(0.004, -0.004, 0.004, -0.004), curve_model())
    assert found.constant_shares is None
    assert nothing_missing_words(found).endswith("cannot clear a rotor")


def test_measured_speeds_are_not_concerned():
    found = identify([made_flight(k, loss=0.08) for k in range(3)], curve_model())
    assert found.constant_shares is None
    assert "rotor_degradation" in effects(found)


@pytest.mark.parametrize("airframe", ["topxgun-f16-sitl", "agras-t20", "agras-t40"])
def test_of_any_layout_a_weak_rotor_is_a_constant_and_a_step_is_not(airframe):
    """The mixer answers a weak rotor in roll, pitch and yaw, with four, six or eight rotors."""
    model = physics_model(load_airframe(airframe))
    rows, count = np.zeros(40), model.airframe.rotor_count
    track = made_flight(0, duration=4.0)
    x = model_channels(
        model,
        replace(
            type(track).of(name="h", time_s=np.arange(40.0), rotor_count=count, airspeed=rows),
            tank_kg=rows + 5.0,
        ),
    )
    table = table_of(model)
    weak = Placed(
        effect=known_effect("rotor_degradation"), rotor=1, values={"loss": 0.1, "torque_share": 1.0}
    )
    change = (rotor_speed_rpm(table, [weak], x) - rotor_speed_rpm(table, [], x))[:, :, None]
    flight = np.zeros(40, dtype=np.intp)
    assert is_constant_share(change, flight)
    late = change * (np.arange(40) >= 24)[:, None, None]
    assert not is_constant_share(late, flight)
    # From flight to flight weight and battery are placed anew: constant in each is no step.
    assert is_constant_share(late, (np.arange(40) >= 24).astype(np.intp))


def test_its_sentences_say_both_sizes_and_two_ways_to_find_out():
    found = identify(flights(0.05, -0.014, -0.018, -0.018), curve_model()).constant_shares
    assert found is not None
    first, second = standing_words(found, NAMES, ("a", "b", "c"))
    assert "cannot tell a weak rotor from a shifted centre of gravity or trim" in first
    assert "sound flights" in first
    assert "of one direction of rotation" in first
    assert "yaw moment of" in second
    assert "less thrust of rotor 1 (front right)" in second
