"""A plan flown in time: rows against sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, Used, energy_home, fly_plan
from thrustmargin.mission.forecast.way import course, plan_legs, way_leg
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.errors import PlanError
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model, predict

LIMITS = flight_limits({"ATC_ACCEL_Y_MAX": 2500.0, "ATC_RATE_Y_MAX": 45.0, "WP_ACC": 1.5})
MODEL = shipped_model()
GIVEN = PlanConditions(fill_kg=10.0, density=1.225)


def flown(*rows, limits=LIMITS, given=GIVEN, renewed=None, **plan):
    made = plan_of(*(rows or TWO_LINES), **plan)
    legs = plan_legs(made, plan_steps(made), limits)
    return fly_plan("a plan", course(legs, limits), MODEL, given, renewed=renewed)


def span(flight, kind):
    found = [s for s in flight.course.spans if s.kind == kind]
    assert found
    return found


def test_it_starts_and_ends_on_the_ground_at_home():
    place = flown().track.position_ned
    assert np.abs(place[0]).max() == 0.0
    assert np.abs(place[-1]).max() < 0.05


def test_time_is_that_of_the_way_and_its_stops():
    """A line of 111.2 m at 4 m/s takes 27.8 s, and speeding up and braking 1.3 s each more."""
    flight = flown()
    line = [t for t in flight.course.legs if t.leg.item == 5]
    assert line[0].profile.seconds == pytest.approx(111.2 / 4.0 + 4.0 / 1.5 + 1.5 + 0.79, abs=0.5)


def test_it_leans_into_speeding_up_and_into_the_wind():
    track = flown().track
    row = int(np.argmax(track.velocity_ned[1:, 0] - track.velocity_ned[:-1, 0]))
    assert track.attitude[row, 1] < math.radians(-5.0)
    windy = flown(given=replace(GIVEN, wind_ned=(0.0, 6.0, 0.0))).track
    middle = np.flatnonzero(np.hypot(*windy.velocity_ned[:, :2].T) > 3.99)
    north = middle[windy.velocity_ned[middle, 0] > 3.9]
    assert np.median(windy.airspeed[north]) == pytest.approx(math.hypot(4.0, 6.0), abs=0.05)
    assert np.all(windy.attitude[north[5:-5], 0] < math.radians(-2.0))  # pushed east, leans west


def test_the_nose_turns_at_the_line_end_and_that_takes_thrust():
    flight = flown()
    use = np.max(predict(MODEL, flight.track, flight.density).thrust, axis=1)
    turn, line = span(flight, "turn"), span(flight, "leg")
    longest = max(line, key=lambda s: s.last - s.first)
    most = max(use[s.first : s.last].max() for s in turn)
    assert most > 1.15 * np.median(use[longest.first : longest.last])
    assert np.abs(flight.track.angular_rate_frd[:, 2]).max() == pytest.approx(
        math.radians(45.0), rel=0.05
    )


def test_on_a_straight_line_it_is_steady_flight():
    flight = flown()
    longest = max(span(flight, "leg"), key=lambda s: s.last - s.first)
    row = (longest.first + longest.last) // 2
    speed = predict(MODEL, flight.track, flight.density).rotor_speed_rpm[row]
    steady = steady_flight(MODEL, 1.225, 51.8, 4.0, flight.track.tank_kg[row : row + 1])
    assert speed == pytest.approx(steady.prediction.rotor_speed_rpm[0], rel=0.004)


def test_the_tank_falls_with_the_pump_on_only():
    flight = flown(given=replace(GIVEN, flow=0.05))
    sprayed = flight.sprayed_kg[-1]
    lines = 2 * 111.2 / 4.0
    assert sprayed == pytest.approx(0.05 * lines, rel=0.06)
    assert flight.track.tank_kg[-1] == pytest.approx(10.0 - sprayed)
    off = flight.track.spraying == 0.0
    assert np.all(np.diff(flight.sprayed_kg)[off[:-1]] == 0.0)


def test_litres_a_hectare_are_by_the_way_sprayed():
    """15 L/ha with 5 m: 7.5 g a metre."""
    flight = flown(given=replace(GIVEN, flow_per_metre=0.0075))
    assert flight.sprayed_kg[-1] == pytest.approx(0.0075 * 2 * 111.2, rel=0.03)


def test_an_empty_tank_stays_empty_and_a_refill_fills_it():
    given = replace(GIVEN, fill_kg=2.0, flow=0.05)
    assert flown(given=given).track.tank_kg[-1] == 0.0
    legs = [t.leg.item for t in flown().course.legs]
    refilled = flown(given=given, renewed={legs.index(5) + 1: Used(0.0, 0.0)}).track
    assert refilled.tank_kg[-1] > 0.5


def test_a_plan_that_flies_nowhere_is_refused():
    with pytest.raises(PlanError, match="flies nowhere"):
        flown((178, 1.0, 4.0))


def test_spans_cover_every_row_once():
    flight = flown()
    assert flight.course.spans[0].first == 0
    assert flight.course.spans[-1].last == flight.track.time_s.size
    assert all(
        a.last == b.first
        for a, b in zip(flight.course.spans, flight.course.spans[1:], strict=False)
    )


@pytest.mark.parametrize("rise", [0.0, 100.0])
def test_a_line_that_climbs_takes_the_liquid_of_its_length_over_ground(rise: float):
    end = np.array([200.0, 0.0, -rise])
    limits = replace(LIMITS, climb_acceleration=2.5)
    leg = way_leg(limits, 1, np.zeros(3), end, speed=4.0, stops=True, pump=True)
    assert leg is not None
    sprayed = fly_plan(
        "by hand", course([leg], limits), MODEL, replace(GIVEN, flow=0.04)
    ).sprayed_kg
    # 0.04 kg/s at 4 m/s is 0.01 kg a metre over ground: 2 kg, less the ends slower than 1 m/s.
    assert sprayed[-1] == pytest.approx(2.0, abs=0.03)


@pytest.mark.parametrize(("bend_deg", "turns"), [(14.5, 0), (15.5, 1)])
def test_a_way_that_bends_by_15_degrees_turns(bend_deg: float, turns: int):
    bend = math.radians(bend_deg)
    corner = np.array([60.0, 0.0, -3.0])
    ends = (np.array([0.0, 0.0, -3.0]), corner)
    beyond = corner + 60.0 * np.array([math.cos(bend), math.sin(bend), 0.0])
    legs = [way_leg(LIMITS, 1, *ends), way_leg(LIMITS, 2, corner, beyond, stops=True)]
    found = course([leg for leg in legs if leg is not None], LIMITS).spans
    assert [s.kind for s in found].count("turn") == turns


@pytest.mark.parametrize("offset", [0.0, 12.0])
def test_a_model_that_follows_air_is_flown_in_the_air_of_the_day(offset: float):
    """At one thrust N² rho is constant, on the way, on the way home and in steady flight."""
    parameters = {
        name: Identified(value=value, unit=unit, ci95=(value, value))
        for name, value, unit in (("temperature_offset", offset, "K"), ("torque_share", 1.0, "1"))
    }
    record = EffectRecord(name="air_density", rotor=None, parameters=parameters)
    model = replace(physics_model(MODEL.airframe), effects=(record,))
    thick, thin = model.reference_density, 0.81 * model.reference_density
    plan = plan_of(*TWO_LINES)
    way = course(plan_legs(plan, plan_steps(plan), LIMITS), LIMITS)

    def speed(density: float) -> float:
        made = fly_plan("a plan", way, model, replace(GIVEN, density=density))
        return float(np.mean(made.rotor_speed_rpm))

    assert speed(thin) == pytest.approx(speed(thick) / 0.9, rel=1e-3)
    still = (0.0, 0.0, 0.0)
    place, fill = np.array([[0.0, 100.0, -10.0]]), np.array([8.0])
    home = [
        energy_home(place, fill, np.array([rho]), LIMITS, model, still)[0] for rho in (thin, thick)
    ]
    assert home[0] == pytest.approx(home[1] / 0.9, rel=1e-3)  # rho N³
    steady = [
        steady_flight(model, rho, math.nan, 0.0, fill).prediction.rotor_speed_rpm[0, 0]
        for rho in (thin, thick)
    ]
    assert steady[0] == pytest.approx(steady[1] / 0.9, rel=1e-3)
