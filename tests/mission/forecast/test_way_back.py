"""The way home against sums by hand."""

import math
from functools import cache

import numpy as np
import pytest

from tests.mission.plans_made import HOME, plan_of, spot
from thrustmargin.mission.forecast.battery import FlightBattery, rotor_power
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import (
    PlanConditions,
    PlanFlight,
    energy_back,
    energy_home,
    fly_plan,
    way_back,
)
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.mission.forecast.way import course, plan_legs
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()
PARAMETERS = {"WP_SPD": 5.0, "RTL_ALT_M": 3.0, "WP_ACC": 1.5}
LIMITS = flight_limits(PARAMETERS)
#: North by 1,112 m and back, at 3 m.
FAR = plan_of(
    (22, spot(*HOME[:2])), (16, spot(HOME[0] + 0.01, 11.0)), (16, spot(HOME[0] + 1e-5, 11.0)), (20,)
)


@cache
def flight(north: float = 0.0) -> PlanFlight:
    legs = plan_legs(FAR, plan_steps(FAR), LIMITS)
    given = PlanConditions(fill_kg=8.0, density=1.225, wind_ned=(north, 0.0, 0.0))
    return fly_plan("far", course(legs, LIMITS), MODEL, given)


def watts(airspeed: float) -> float:
    made = steady_flight(MODEL, 1.225, math.nan, airspeed, np.array([8.0])).prediction
    return float(rotor_power(MODEL.airframe, made.thrust, made.rotor_speed_rpm)[0])


@pytest.mark.parametrize(("north", "airspeed"), [(0.0, 5.0), (4.0, 9.0), (-4.0, 1.0)])
def test_energy_from_the_far_end_is_power_times_time(north: float, airspeed: float):
    made = flight(north)
    far = int(np.argmax(made.track.position_ned[:, 0]))
    back = energy_back(made, LIMITS, MODEL, (north, 0.0, 0.0))
    # 1,112 m at 5 m/s; over home 5 s, then 3 m down at 0.5 m/s.
    by_hand = 222.4 * watts(airspeed) + 11.0 * watts(abs(north))
    assert back[far] * 3600.0 == pytest.approx(by_hand, rel=0.01)


@pytest.mark.parametrize(
    ("away", "height", "up"),
    [
        (4.0, 2.0, 12.0),  # near home no higher than three times the distance
        (9.9, 2.0, 29.7),
        (100.0, 2.0, 30.0),  # from elsewhere up to the height of a return
        (4.0, 20.0, 20.0),  # none goes down before it is over home
        (100.0, 45.0, 45.0),
    ],
)
def test_a_way_home_climbs_to_the_height_of_a_return_but_stays_in_the_cone_about_home(
    away: float, height: float, up: float
):
    limits = flight_limits({"WP_SPD": 6.0, "RTL_SPEED_MS": 5.0, "RTL_ALT_M": 30.0})
    place, still = np.array([[0.0, -away, -height]]), (0.0, 0.0, 0.0)
    (found,) = energy_home(place, np.array([8.0]), np.array([1.225]), limits, MODEL, still)
    # Up at 2.5 m/s, down at 1.5 m/s to 10 m and at 0.5 m/s from there; 5 s over home.
    hover_s = (up - height) / 2.5 + (up - 10.0) / 1.5 + 10.0 / 0.5 + 5.0
    by_hand = hover_s * watts(0.0) + away / 5.0 * watts(5.0)
    assert found * 3600.0 == pytest.approx(by_hand, rel=0.001)


def test_on_the_ground_there_is_no_way_home():
    assert energy_back(flight(), LIMITS, MODEL, (0.0, 0.0, 0.0))[0] == 0.0


def test_home_is_out_of_reach_where_used_and_way_home_are_more_than_there_is():
    made = flight()
    back = energy_back(made, LIMITS, MODEL, (0.0, 0.0, 0.0))
    far = int(np.argmax(made.track.position_ned[:, 0]))
    both = float(made.energy_wh[far] + back[far])
    found = way_back(made, made.energy_wh, back, 0.5 * both)
    # Out and back are alike, so half of the energy is half of the distance.
    assert found.distance == pytest.approx(556.0, abs=30.0)
    assert made.track.time_s[far] * 0.4 < found.time_s < made.track.time_s[far] * 0.6
    assert found.spare_wh < 0.0
    enough = way_back(made, made.energy_wh, back, 1.2 * both)
    assert math.isnan(enough.time_s)
    assert 0.0 < enough.spare_wh < 0.25 * both


def test_the_way_home_goes_by_the_upper_end_of_its_energy():
    made = flight()
    back = energy_back(made, LIMITS, MODEL, (0.0, 0.0, 0.0))
    far = int(np.argmax(made.track.position_ned[:, 0]))
    both = float(made.energy_wh[far] + back[far])
    half = math.log(1.5) / 1.645  # the interval is from two thirds to half as much again
    found = way_back(made, made.energy_wh, back, 0.6 * both, error=half)
    sure = way_back(made, made.energy_wh, back, 0.4 * both)
    assert found.time_s == sure.time_s
    assert found.distance == sure.distance
    assert found.time_s < found.expected_time_s < found.latest_time_s
    close = way_back(made, made.energy_wh, back, 1.2 * both, error=half)
    assert math.isfinite(close.time_s)
    assert math.isnan(close.expected_time_s)
    assert close.spare_wh < 0.0 < close.expected_spare_wh < close.most_spare_wh


def test_an_unknown_battery_leaves_it_unknown():
    made = flight()
    back = energy_back(made, LIMITS, MODEL, (0.0, 0.0, 0.0))
    assert math.isnan(way_back(made, made.energy_wh, back, math.nan).spare_wh)


def test_a_sortie_that_ends_at_a_refill_has_energy_for_the_way_there_and_home():
    rows = [(22, spot(*HOME[:2])), (216, 1.0)]
    for k in range(8):
        ends = (HOME[0] + 0.002, HOME[0] + 0.004)
        rows += [(16, spot(ends[(k + m) % 2], 11.0 + 1e-4 * k)) for m in (0, 1)]
    plan = plan_of(*rows, (216, 0.0), (20,))

    def asked(capacity_ah: float):
        day = TakeOff(fill_kg=8.0, flow=0.001, battery=FlightBattery(capacity_ah=capacity_ah))
        # A nose that turns gently: no voltage of these makes it turn slower still.
        gentle = PARAMETERS | {"ATC_ACCEL_Y_MAX": 2500.0}
        return forecast(plan, MODEL, day, parameters=gentle)

    first = asked(100.0)
    whole = first.needs
    assert len(whole.sorties) == 1
    usable = 0.6 * whole.sorties[0].energy_wh
    # Nobody measured the power: it may be half as much again, which must not run out either.
    most = math.exp(1.645 * first.flight.power_error)
    assert 1.5 < most < 1.6
    split = asked(most * usable / 0.75 / 51.8).needs
    assert len(split.sorties) > 1
    assert not split.short_of
    assert max(s.energy_wh for s in split.sorties) <= usable
    # More than the whole: each refill takes a way home and a way out.
    assert sum(s.energy_wh for s in split.sorties) > whole.sorties[0].energy_wh
