"""Where the pump is on in a plan that does not switch it."""

import math

import pytest

from tests.mission.plans_made import FIRST, HOME, SECOND, TWO_LINES, plan_of, spot
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast, sortie_plans
from thrustmargin.mission.pump_rule import spray_lines, with_pump_rule
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.errors import PlanError
from thrustmargin.models.model.model_file import shipped_model

#: Without the orders of the pump: TWO_LINES as most spray planners write it.
UNSWITCHED = tuple(row for row in TWO_LINES if row[0] != 216)


def on_at(plan, rule):
    steps, _ = with_pump_rule(plan, plan_steps(plan), rule)
    return [step.item for step in steps.steps if step.pump]


def field(rows, lines=8, *, degrees=0.0001, length=0.001, speed=None):
    """Lines east of each other, there and back; `rows` before them."""
    places = []
    for line in range(lines):
        ends = [FIRST, FIRST + length]
        for latitude in ends if line % 2 == 0 else ends[::-1]:
            places.append((16, spot(latitude, 11.0 + line * degrees)))
    ordered = () if speed is None else ((178, 1.0, speed, -1.0),)
    return plan_of((22, spot(*HOME[:2])), *rows, *ordered, *places, (20,))


def test_always_is_from_the_first_place_to_the_last():
    plan = plan_of(*UNSWITCHED)
    assert on_at(plan, "always") == [4, 5, 6]  # not on the ways from and to home


def test_lines_are_those_that_the_plan_itself_would_switch():
    switched = plan_steps(plan_of(*TWO_LINES))
    found = spray_lines(plan_of(*TWO_LINES), switched)
    assert found.spraying.tolist() == [bool(step.pump) for step in switched.steps]
    assert found.count == 2
    assert found.spacing == pytest.approx(7.46, abs=0.02)
    assert on_at(plan_of(*UNSWITCHED), "lines") == [4, 6]


def test_a_line_of_several_places_is_one_line():
    rows = [(22, spot(*HOME[:2]))]
    rows += [(16, spot(FIRST + k * 0.0002, 11.0)) for k in range(6)]
    rows += [(16, spot(FIRST + k * 0.0002, 11.0001)) for k in range(5, -1, -1)]
    found = spray_lines(plan_of(*rows, (20,)), plan_steps(plan_of(*rows, (20,))))
    assert found.count == 2
    assert found.spraying.sum() == 10


def test_a_way_at_another_speed_is_no_line():
    """A transit beside the lines, at the spacing of lines, is flown faster."""
    transit = [
        (178, 1.0, 9.0, -1.0),
        (16, spot(FIRST, 10.9999)),
        (16, spot(FIRST + 0.001, 10.9999)),
    ]
    plan = field(transit, speed=4.0)
    steps = plan_steps(plan)
    found = spray_lines(plan, steps)
    assert found.count == 8
    fast = [k for k, step in enumerate(steps.steps) if step.speed == 9.0]
    assert not found.spraying[fast].any()


def test_a_slanted_way_across_the_field_is_no_line():
    plan = field([(16, spot(FIRST, 11.0004)), (16, spot(FIRST + 0.001, 11.0))])
    steps = plan_steps(plan)
    slanted = next(k for k, s in enumerate(steps.steps) if s.item == 3)
    assert not spray_lines(plan, steps).spraying[slanted]


def test_turns_of_a_field_with_short_lines_stay_off():
    plan = field([], lines=12, degrees=0.00006, length=0.00008)  # 8.9 m lines, 4.5 m apart
    found = spray_lines(plan, plan_steps(plan))
    assert found.count == 12
    assert found.spraying.sum() == 12


@pytest.mark.parametrize(
    "places",
    [
        [spot(FIRST, 11.0), spot(SECOND, 11.0)],  # one line
        [spot(FIRST, 11.0), spot(SECOND, 11.0), spot(SECOND, 11.002)],  # an angle
    ],
)
def test_without_lines_beside_each_other_the_error_names_the_other_rule(places):
    plan = plan_of((22, spot(*HOME[:2])), *((16, place) for place in places), (20,))
    assert math.isnan(spray_lines(plan, plan_steps(plan)).spacing)
    with pytest.raises(PlanError, match=r"no spray lines are found.*give --pump always"):
        with_pump_rule(plan, plan_steps(plan), "lines")


def test_a_forecast_sprays_by_the_rule_and_says_so():
    plan, day = plan_of(*UNSWITCHED), TakeOff(fill_kg=6.0, flow=0.04)
    dry = forecast(plan, shipped_model(), day)
    assert dry.needed_kg == 0.0
    assert dry.pump_never_on
    wet = forecast(plan, shipped_model(), day, pump_rule="lines")
    itself = forecast(plan_of(*TWO_LINES), shipped_model(), day)
    assert wet.needed_kg == pytest.approx(itself.needed_kg, rel=0.02)
    assert not wet.pump_never_on
    assert wet.assumed["pump lines stated"] == ("2", "7.5")
    always = forecast(plan, shipped_model(), day, pump_rule="always")
    assert always.needed_kg > wet.needed_kg
    assert "pump always stated" in always.assumed


def test_a_plan_that_switches_its_pump_takes_no_rule():
    with pytest.raises(PlanError, match=r"itself switches the pump.*leave out --pump lines"):
        forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=6.0), pump_rule="lines")


def test_sorties_of_such_a_plan_do_not_switch_the_pump_either():
    day = TakeOff(fill_kg=1.5, flow=0.04)
    made = forecast(plan_of(*UNSWITCHED), shipped_model(), day, pump_rule="lines")
    plans = sortie_plans(made)
    assert len(plans) > 1
    assert not [item for one in plans for item in one.items if item.command in (183, 216)]
