"""What a vehicle does along a plan: orders hold, jumps are followed, the rest is named."""

import math
import time
from dataclasses import replace

import pytest

from tests.mission.plans_made import TWO_LINES, plan_of, spot
from thrustmargin.mission.steps import PumpOutput, plan_steps, pump_output, pump_switch

NORTH, SOUTH = spot(48.001, 11.0), spot(48.0, 11.0)


def whys(*rows, **fields):
    return [(n.item, n.why) for n in plan_steps(plan_of(*rows, **fields)).not_understood]


def test_speed_and_pump_hold_until_the_next_order():
    found = plan_steps(plan_of(*TWO_LINES))
    assert [s.kind for s in found.steps] == ["take-off", "fly", "fly", "fly", "fly", "return"]
    assert [s.item for s in found.steps] == [1, 3, 5, 7, 9, 11]
    assert [s.speed for s in found.steps] == [None, 4.0, 4.0, 4.0, 4.0, 4.0]
    assert [s.pump for s in found.steps] == [None, None, True, False, True, False]
    assert found.not_understood == ()
    assert found.pump_at_end is False


def test_climb_and_descent_have_speeds_of_their_own_and_minus_two_ends_an_order():
    found = plan_steps(
        plan_of((178, 2, 1.5), (178, 3, 0.7), (178, 0, 6), (16, NORTH), (178, 1, -2), (16, NORTH))
    )
    first, second = found.steps
    assert (first.speed, first.climb_speed, first.descent_speed) == (6.0, 1.5, 0.7)
    assert (second.speed, second.climb_speed) == (None, 1.5)
    assert whys((178, 7, 3.0), (16, NORTH)) == [(1, "unknown command")]


def test_waits_circles_splines_and_headings():
    found = plan_steps(
        plan_of(
            (16, 4.0, NORTH),
            (19, 9.0, NORTH),
            (18, 2.0, 0.0, -15.0, NORTH),
            (82, 1.0, NORTH),
            (93, 12.0),
            (115, 90.0),
            (16, NORTH),
            (16, NORTH),
        )
    ).steps
    assert [s.kind for s in found] == ["fly", "fly", "turns", "spline", "wait", "fly", "fly"]
    assert [s.wait_s for s in found] == [4.0, 9.0, 0.0, 1.0, 12.0, 0.0, 0.0]
    assert (found[2].turns, found[2].radius) == (2.0, 15.0)
    assert [s.heading_deg for s in found[4:]] == [None, 90.0, None]


def test_only_px4_turns_to_the_fourth_parameter_of_a_waypoint():
    row = (16, 0.0, 0.0, 0.0, 45.0, NORTH)
    assert plan_steps(plan_of(row, firmware=12)).steps[0].heading_deg == 45.0
    assert plan_steps(plan_of(row, firmware=3)).steps[0].heading_deg is None


def test_a_jump_is_followed_as_often_as_it_says():
    found = plan_steps(plan_of((22,), (16, NORTH), (177, 2.0, 3.0), (20,)))
    assert [s.item for s in found.steps] == [1, 2, 2, 2, 2, 4]
    assert [s.index for s in found.steps] == [0, 1, 2, 3, 4, 5]
    tagged = plan_steps(plan_of((600, 7.0), (16, NORTH), (601, 7.0, 2.0)))
    assert [s.item for s in tagged.steps] == [2, 2, 2]


@pytest.mark.parametrize("repeats", [-1.0, 1.0, 30000.0])
def test_a_jump_forward_leaves_items_out_and_the_rest_is_flown(repeats):
    rows = ((22,), (177, 4.0, repeats), (16, NORTH), (16, SOUTH), (16, NORTH), (20,))
    found = plan_steps(plan_of(*rows))
    assert [s.item for s in found.steps] == [1, 4, 5, 6]
    assert not found.not_understood


def test_a_jump_forward_in_a_repetition_is_taken_each_time():
    rows = ((22,), (16, NORTH), (177, 5.0, -1.0), (16, SOUTH), (16, NORTH), (177, 2.0, 2.0), (20,))
    found = plan_steps(plan_of(*rows))
    assert [s.item for s in found.steps] == [1, *(2, 5) * 3, 7]
    endless = plan_steps(plan_of(*rows[:5], (177, 2.0, -1.0)))
    assert [w.item for w in endless.not_understood] == [6]


def test_an_inner_jump_counts_anew_but_for_ardupilot():
    nested = ((16, NORTH), (177, 1.0, 1.0), (177, 1.0, 1.0))
    assert len(plan_steps(plan_of(*nested, firmware=12)).steps) == 4
    assert len(plan_steps(plan_of(*nested, firmware=3)).steps) == 3


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ((177, 2.0, 5.0), "jump to itself"),
        ((177, 99.0, 5.0), "jump to nothing"),
        ((177, float("nan"), 5.0), "jump to nothing"),
        ((177, 1.0, -1.0), "jump without end"),
        ((177, 1.0, 1e9), "jump without end"),
    ],
)
def test_a_jump_that_leads_nowhere_or_never_ends_is_named_at_once(row, why):
    began = time.process_time()
    assert [w for _, w in whys((16, NORTH), row, (16, NORTH))] == [why]
    assert time.process_time() - began < 2.0


def test_a_jump_that_is_never_done_with_is_not_flown_at_all():
    found = plan_steps(plan_of((16, NORTH), (16, SOUTH), (177, 1.0, 65535.0), (20,)))
    assert [s.item for s in found.steps] == [1, 2]
    often = plan_steps(plan_of((16, NORTH), (16, SOUTH), (177, 1.0, 3000.0), (20,)))
    assert len(often.steps) == 6003
    assert not often.not_understood


@pytest.mark.parametrize(
    ("row", "why", "touches"),
    [
        ((9999,), "unknown command", ("distance", "time", "load")),
        ((34, 10.0, NORTH), "unknown command", ("distance", "time", "load")),
        ((17, NORTH), "waits without end", ("distance", "time", "load")),
        ((18, 2.0, NORTH), "loiter without a radius", ("distance", "time", "load")),
        ((93, -1.0, 12.0), "waits for a time of day", ("time", "load")),
        ((114, 5.0), "delays what follows", ("load", "heading")),
        ((115, 10.0, 0.0, 1.0, 1.0), "points the nose", ("heading",)),
        ((201, NORTH), "points the nose", ("heading",)),
        ((179, NORTH), "changes the return", ("distance", "time", "load")),
        ((193,), "waits for the ground station", ("time", "load")),
        ((211,), "drops a load", ("load",)),
        ((183, 9.0, 1900.0), "an output that may be the pump", ("load",)),
    ],
)
def test_what_is_not_understood_is_named_with_the_figures_it_touches(row, why, touches):
    (found,) = plan_steps(plan_of((22,), row)).not_understood
    assert (found.item, found.command, found.why, found.touches) == (2, row[0], why, touches)


def test_a_cameras_commands_have_no_part():
    assert whys((22,), (206, 25.0), (2000,), (530,), (205,), (16, NORTH)) == []


def test_nothing_is_flown_after_the_return_or_an_endless_wait():
    for last in ((20,), (17, NORTH)):
        assert len(plan_steps(plan_of((22,), last, (16, NORTH))).steps) == 2


def test_the_pump_hangs_where_the_parameters_say():
    reversed_at_9 = {
        **{"SERVO9_FUNCTION": 22.0, "SERVO9_MIN": 1000.0, "SERVO9_MAX": 2000.0},
        **{"SERVO9_REVERSED": 1.0, "SERVO1_FUNCTION": 33.0},
    }
    pump = pump_output(reversed_at_9)
    assert pump == PumpOutput(servo=9, off_us=2000.0, on_us=1000.0, known=True)
    rows = ((183, 9.0, 1000.0), (16, NORTH), (183, 9.0, 2000.0), (16, NORTH), (183, 8.0, 1500.0))
    found = plan_steps(plan_of(*rows), pump)
    assert [s.pump for s in found.steps] == [True, False]
    assert found.not_understood == ()
    assert pump_output({}) == PumpOutput()
    unknown = plan_steps(plan_of((183, 8.0, 1500.0)), pump_output({"SERVO1_FUNCTION": 33.0}))
    assert unknown.not_understood == ()


@pytest.mark.parametrize(
    "pump", [PumpOutput(), PumpOutput(servo=7, on_us=1700.0, off_us=1200.0), PumpOutput(relay=2)]
)
def test_a_switch_is_understood_as_what_it_was_made_for(pump):
    def fly(number: int):
        return replace(plan_of((16, NORTH)).items[0], number=number)

    items = (pump_switch(pump, on=True), fly(2), pump_switch(pump, on=False), fly(4))
    found = plan_steps(replace(plan_of((22,)), items=items), pump)
    assert [s.pump for s in found.steps] == [True, False]
    assert found.not_understood == ()


@pytest.mark.parametrize(
    ("row", "height"),
    [
        ((22, (0.0, 0.0, 7.0)), 7.0),
        ((22, (math.nan, math.nan, 7.0)), 7.0),
        ((16, (0.0, 0.0, 9.0)), 9.0),
        ((16, (0.0, 0.0, 0.0)), math.nan),  # stays as high as it is
        ((20, (0.0, 0.0, 7.0)), math.nan),  # a return has none of its own
    ],
)
def test_a_height_may_be_given_without_a_place(row, height):
    (step,) = plan_steps(plan_of(row)).steps
    assert step.place is None
    assert step.height == pytest.approx(height, nan_ok=True)
