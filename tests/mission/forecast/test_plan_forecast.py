"""What the model says of a plan: the same answer as of a flight."""

import math
import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.mission.plans_made import FIRST, HOME, SECOND, TWO_LINES, plan_of, spot
from thrustmargin.mission.forecast.battery import FlightBattery, formula_coefficient
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.errors import PlanError
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.electric_power import FlightPower, PowerLaw

MODEL = shipped_model()
PARAMETERS = {"ATC_ACCEL_Y_MAX": 2500.0, "ATC_RATE_Y_MAX": 45.0, "WP_ACC": 1.5}
DAY = TakeOff(
    fill_kg=6.0, flow=0.04, battery=FlightBattery(capacity_ah=16.0), air_temperature=288.0
)


@cache
def outlook(*rows, day=DAY, **options):
    plan = plan_of(*(rows or TWO_LINES))
    return forecast(plan, MODEL, day, parameters=PARAMETERS, **options)


def test_light_may_fly_and_full_may_not():
    assert outlook().level is FlightLevel.UNDER
    heavy = outlook(day=replace(DAY, fill_kg=16.0))
    assert heavy.level.gravity <= FlightLevel.OVER.gravity


def test_the_largest_fill_keeps_the_limit_and_more_does_not():
    most = outlook().largest_fill_kg
    assert 8.0 < most < 16.0
    assert outlook(day=replace(DAY, fill_kg=most)).level is FlightLevel.UNDER
    assert outlook(day=replace(DAY, fill_kg=most + 0.4)).level is not FlightLevel.UNDER


def test_the_weakest_place_is_a_turn_and_its_parts_are_named():
    weakest = outlook().weakest
    assert weakest is not None
    assert weakest.kind == "turn"
    assert weakest.manoeuvre > 0.1
    assert weakest.load > 0.05
    assert weakest.wind == pytest.approx(0.0, abs=1e-9)
    windy = outlook(day=replace(DAY, wind=12.0, wind_from_deg=0.0)).weakest
    assert windy is not None
    assert windy.wind != 0.0


def test_turns_of_an_aircraft_without_a_known_yaw_inertia_are_left_out_and_named():
    bare = physics_model(MODEL.airframe)
    made = forecast(plan_of(*TWO_LINES), bare, DAY, parameters=PARAMETERS)
    assert made.turns_left_out
    known = outlook().weakest
    assert made.weakest is not None
    assert known is not None
    assert made.weakest.utilisation < 0.8 * known.utilisation
    assert not outlook().turns_left_out
    north = ((22, spot(*HOME[:2])), (16, spot(FIRST, 11.0)), (16, spot(SECOND, 11.0)))
    straight = forecast(plan_of(*north), bare, DAY, parameters=PARAMETERS)
    assert not straight.turns_left_out


def test_a_wind_from_nowhere_is_the_worst_of_all():
    any_way = outlook(day=replace(DAY, wind=8.0))
    assert "worst wind" in any_way.assumed
    named = [outlook(day=replace(DAY, wind=8.0, wind_from_deg=d)) for d in (0.0, 90.0, 180.0)]
    peaks = [made.weakest.utilisation for made in named if made.weakest]
    assert any_way.weakest is not None
    assert any_way.weakest.utilisation >= max(peaks) - 1e-9


def test_thin_air_and_a_weak_battery_take_from_the_fill():
    most = outlook().largest_fill_kg
    assert outlook(day=replace(DAY, altitude=2500.0)).largest_fill_kg < most - 1.0
    weak = replace(DAY, battery=FlightBattery(voltage=50.0, capacity_ah=16.0))
    assert outlook(day=weak).largest_fill_kg < most - 1.0


def test_a_tank_that_does_not_last_is_refilled_at_a_line_end():
    made = outlook(day=replace(DAY, fill_kg=1.5))
    assert [s.last_item for s in made.needs.sorties] == [5, 11]
    assert made.needs.short_of == ""
    assert sum(s.kg for s in made.needs.sorties) == pytest.approx(made.flight.sprayed_kg[-1])
    assert outlook(day=replace(DAY, fill_kg=0.3)).needs.short_of == "tank"


def test_a_battery_that_does_not_last_is_no_answer_but_that():
    made = outlook(day=replace(DAY, battery=FlightBattery(capacity_ah=1.0)))
    assert made.level is FlightLevel.BATTERY


def test_a_battery_that_may_not_last_is_too_close():
    """Between what the formula says of its power and half as much again."""
    needed = sum(s.energy_wh for s in outlook().needs.sorties)
    assert outlook().level is FlightLevel.UNDER
    tight = FlightBattery(capacity_ah=1.1 * needed / 51.8 / 0.75, resistance=0.02)
    made = outlook(day=replace(DAY, battery=tight))
    assert made.expected_needs.short_of == ""
    assert len(made.expected_needs.sorties) == 1
    assert len(made.needs.sorties) == 2  # a refill before it may run out
    assert made.needs.short_of == "battery"
    assert made.battery_unsure
    assert made.level is FlightLevel.NEAR
    enough = FlightBattery(capacity_ah=2.0 * needed / 51.8 / 0.75, resistance=0.02)
    assert outlook(day=replace(DAY, battery=enough)).level is FlightLevel.UNDER
    measured = PowerLaw(
        flights=tuple(FlightPower(flight=str(k), day=k, coefficient=8.7e-8) for k in range(9))
    )
    law = replace(MODEL, power=measured)
    sure = forecast(plan_of(*TWO_LINES), law, DAY, parameters=PARAMETERS)
    low, high = (end / sure.energy_wh[0] for end in sure.energy_wh[1:])
    assert 0.9 < low < 1.0 < high < 1.1
    assert sure.energy_wh[0] == pytest.approx(
        needed * 8.7e-8 / formula_coefficient(MODEL), rel=0.001
    )
    assert "efficiency" not in sure.assumed


def test_what_is_not_known_is_said():
    bare = forecast(plan_of(*TWO_LINES), MODEL, TakeOff(fill_kg=6.0))
    assert {"limits", "no capacity", "no wind", "no flow", "usual air"} <= set(bare.assumed)
    assert "limits" in outlook().assumed
    assert not {"no capacity", "no flow", "usual air"} & set(outlook().assumed)


@pytest.mark.parametrize(
    ("stated", "of_home", "taken"),
    [(300.0, 500.0, 300.0), (math.nan, 500.0, 500.0), (math.nan, math.nan, 0.0)],
)
def test_home_is_as_high_as_stated_or_as_in_the_plan_or_at_the_sea(
    stated: float, of_home: float, taken: float
):
    plan = plan_of(*TWO_LINES, home=(*HOME[:2], of_home))
    made = forecast(plan, MODEL, replace(DAY, altitude=stated), parameters=PARAMETERS)
    assert made.flight.track.origin is not None
    assert made.flight.track.origin.altitude == taken


def test_what_is_not_understood_is_kept_with_its_number():
    rows = [*TWO_LINES[:3], (4711, 1.0), *TWO_LINES[3:]]
    assert [n.item for n in outlook(*rows).not_understood] == [4]


def test_the_loss_of_a_rotor_is_survivable_below_what_the_answer_needs():
    heavy = outlook(day=replace(DAY, fill_kg=14.0, flow=0.1))
    below = heavy.survivable_below_kg
    assert 5.0 < below < 14.0
    track, lost = heavy.flight.track, heavy.advised.analysis.redundancy_yaw_uncontrolled
    assert (lost[track.tank_kg < below] >= 1.0).all()
    assert (lost[track.tank_kg > below + 1.0] < 1.0).any()


def test_with_a_fill_whose_every_row_survives_it_is_survivable_from_take_off_on():
    """Though the battery falls, so that at the end less than this fill would survive."""
    light = outlook(day=replace(DAY, fill_kg=5.0))
    assert light.survivable_below_kg == pytest.approx(5.0)


def test_a_climb_is_a_climb():
    made = outlook((22, spot(48.0, 11.0, 20.0)), (16, spot(48.0005, 11.0, 20.0)), (21,))
    kinds = [leg.kind for leg in made.legs]
    assert kinds[0] == "climb"
    assert kinds[-1] == "climb"
    assert math.isclose(sum(leg.seconds for leg in made.legs), made.flight.track.duration)


def test_a_nose_that_asks_for_more_than_the_rotors_have_gives_way():
    """270 °/s² is ArduPilot's default, and no sprayer has the moment for it."""
    strong = {"ATC_RAT_YAW_P": 1.5}  # asks for it at once
    heavy = replace(DAY, fill_kg=12.0, altitude=1800.0)
    made = forecast(plan_of(*TWO_LINES), MODEL, heavy, parameters=strong)
    assert made.weakest is not None
    assert made.weakest.utilisation <= 1.0
    assert made.limits.yaw_acceleration < math.radians(200.0)
    assert "nose gives way" in made.assumed
    assert "nose gives way" not in outlook().assumed


def lines(count):
    rows = [*TWO_LINES[:2]]
    for k in range(count):
        ends = (48.0005, 48.0015) if k % 2 == 0 else (48.0015, 48.0005)
        east = 11.0 + k * 5e-5
        rows += [(16, spot(ends[0], east)), (216, 1.0), (16, spot(ends[1], east)), (216, 0.0)]
    return [*rows, (20,)]


def test_what_is_new_late_in_a_long_plan_is_flown_where_it_is():
    """Fast legs after 40 min, of which the first 5 show nothing."""
    late = [
        (178, 1.0, 9.0, -1.0),
        *((16, spot(48.0005, 11.006 + 2e-3 * k)) for k in range(3)),
        (20,),
    ]
    made = outlook(*lines(90)[:-1], *late)
    assert "alike" in made.assumed
    first = len(lines(90)) + 1  # that of the order of speed is the one before
    assert {leg.item for leg in made.legs} >= {first, first + 1, first + 2}
    track = made.flight.track
    fast = np.hypot(*track.velocity_ned[:, :2].T) > 8.5
    assert fast.any()
    # Of a degree of longitude there are 74.6 km here.
    assert 700.0 < track.position_ned[fast, 1].max() < 750.0


def test_a_part_begins_with_what_tank_and_battery_have_given_by_then():
    made = outlook(*lines(100))
    track = made.flight.track
    jumps = np.flatnonzero(np.linalg.norm(np.diff(track.position_ned, axis=0), axis=1) > 20.0)
    assert jumps.size
    # The way home is the last part: the tank is that of the end, and so is the place.
    ends_with = made.needs.sorties[-1]
    assert track.tank_kg[-1] == pytest.approx(6.0 - ends_with.kg, abs=0.1)
    assert np.hypot(*track.position_ned[-1, :2]) < 1.0


def test_of_a_long_plan_the_first_part_is_flown_and_the_rest_is_counted():
    short, double, long = (outlook(*lines(count)) for count in (10, 20, 100))
    assert "first part" not in short.assumed
    assert "alike" in long.assumed
    assert 300.0 < long.flight.track.duration < 1000.0
    sprayed, ten_lines = short.flight.sprayed_kg[-1], double.flight_s - short.flight_s
    assert sum(s.kg for s in long.needs.sorties) == pytest.approx(10 * sprayed, rel=0.04)
    assert long.flight_s == pytest.approx(short.flight_s + 9 * ten_lines, rel=0.04)
    assert long.needs.sorties[-1].last_item == len(lines(100))


@pytest.mark.slow
def test_two_thousand_lines_no_two_alike_take_seconds():
    """2 to 3 s of a processor that is left alone."""
    rows = lines(2000)
    for k, row in enumerate(rows):
        if row[0] == 16:
            latitude, *rest = row[-1]
            rows[k] = (16, (latitude + 1e-7 * (k * k % 4001), *rest))
    begun = time.process_time()
    made = outlook(*rows)
    assert time.process_time() - begun < 8.0
    assert len(made.needs.sorties) > 50


@pytest.mark.parametrize(
    "row",
    [(16, 1e6, spot(48.0005, 11.0)), (16, spot(-48.0, -169.0)), (178, 1.0, 0.001, -1.0)],
    ids=["waits for days", "on the other side of the Earth", "hardly moves"],
)
def test_what_no_battery_lasts_is_refused_at_once(row):
    begun = time.process_time()
    with pytest.raises(
        PlanError, match=r"the way to item \d+ with its wait takes|item 2 is \d+ km"
    ):
        outlook(TWO_LINES[0], row, (16, spot(48.001, 11.0)), (20,))
    assert time.process_time() - begun < 1.0


def test_a_peak_is_no_surer_than_flights_were_flown():
    """5 % of it, and 1.645 of that to either side."""
    for leg in outlook().legs:
        half = 0.5 * (leg.interval[1] - leg.interval[0])
        assert half >= 1.645 * 0.05 * leg.utilisation_peak - 1e-9
