"""Faults of a plan's structure: each is found in a plan that has it, none in a good one."""

from dataclasses import replace

import pytest

from tests.mission.plans_made import FIRST, SECOND, TWO_LINES, plan_of, spot
from thrustmargin.mission.plan_check import check_plan
from thrustmargin.mission.plan_items import FenceCircle, FencePolygon
from thrustmargin.mission.steps import plan_steps


def faults(plan, **options):
    return {f.fault: f.items for f in check_plan(plan, plan_steps(plan), **options)}


def without(*numbers):
    return [row for k, row in enumerate(TWO_LINES, start=1) if k not in numbers]


def test_a_good_plan_has_none():
    assert faults(plan_of(*TWO_LINES)) == {}


@pytest.mark.parametrize(
    ("rows", "fault", "items"),
    [
        (without(4, 8), "pump never on", ()),
        (without(6, 10)[:-1], "pump never off", (8,)),
        (without(6), "pump on in turns", (6,)),
        (without(10), "pump on at return", (10,)),
        (without(1), "take-off missing", (2,)),
        ([(216, 1.0), *TWO_LINES], "pump on before the first line", (2, 4)),
        ([*TWO_LINES[:-1], (177, 3.0, 1.0), (20,)], "jumps back", (11,)),
        ([*TWO_LINES, (16, spot(FIRST, 11.0))], "never flown", (12,)),
        ([*TWO_LINES[:-1], (16, spot(12.0, 11.0))], "far away", (11,)),
    ],
)
def test_a_fault_is_found_with_its_items(rows, fault, items):
    assert faults(plan_of(*rows)).get(fault) == items


def test_a_long_way_with_the_pump_on_is_no_turn():
    rows = [(22, spot(48.0, 11.0)), (216, 1.0)]
    for k, longitude in enumerate((11.0, 11.0001, 11.0002, 11.001)):
        ends = (FIRST, SECOND) if k % 2 == 0 else (SECOND, FIRST)
        rows += [(16, spot(latitude, longitude)) for latitude in ends]
    found = faults(plan_of(*rows, (216, 0.0), (20,)))
    assert found["pump on between lines"] == (9,)
    assert found["pump on in turns"] == (5, 7)


def test_a_plan_of_a_plane_is_named():
    assert faults(plan_of(*TWO_LINES, vehicle=1)) == {"another vehicle": ()}
    assert faults(plan_of(*TWO_LINES, vehicle=13)) == {}


def test_a_plan_that_sprays_nothing_by_itself_may_be_meant():
    plan = plan_of(*without(4, 6, 8, 10))
    assert "pump never on" not in faults(plan, sprays=False)


def test_heights_of_two_kinds_name_those_of_the_rarer():
    plan = plan_of(*TWO_LINES)
    items = [replace(i, frame=10) if i.number == 7 else i for i in plan.items]
    assert faults(replace(plan, items=tuple(items))) == {"mixed height frames": (7,)}


def at_height(height, *numbers, frame=3):
    """TWO_LINES with the items of these numbers at another height."""
    items = [
        replace(i, frame=frame, parameters=(*i.parameters[:6], height))
        if i.number in numbers
        else i
        for i in plan_of(*TWO_LINES).items
    ]
    return replace(plan_of(*TWO_LINES), items=tuple(items))


@pytest.mark.parametrize(
    ("height", "numbers", "frame", "fault", "above"),
    [
        (0.0, (1, 3, 5), 3, "at the height of home", 0.0),
        (0.4, (5,), 3, "at the height of home", 0.4),
        (505.0, (3, 5), 3, "far above home", 505.0),
        (505.0, (5,), 10, "far above home", 505.0),
        (1005.0, (5,), 0, "far above home by sea level", 505.0),
        (5.0, (5, 7), 0, "below home", -495.0),
    ],
)
def test_heights_that_cannot_be_meant_are_found_with_their_items(
    height, numbers, frame, fault, above
):
    plan = at_height(height, *numbers, frame=frame)
    found = {f.fault: f for f in check_plan(plan, plan_steps(plan))}
    assert found[fault].items == numbers
    assert found[fault].height == pytest.approx(above)
    others = {"at the height of home", "far above home", "below home"} - {fault}
    assert not others & set(found)


def test_heights_of_a_field_on_a_hill_and_of_a_landing_are_meant():
    assert faults(at_height(90.0, 3, 5, 7, 9)) == {}
    assert faults(at_height(-40.0, 3, 5, 7, 9)) == {}
    landing = plan_of(*TWO_LINES[:-1], (21, spot(48.0, 11.0, 0.0)))
    assert "at the height of home" not in faults(landing)
    no_home = replace(at_height(505.0, 5, frame=0), home=(48.0, 11.0, float("nan")))
    assert set(faults(no_home)) == {"mixed height frames"}


def test_a_jump_forward_repeats_nothing():
    rows = [TWO_LINES[0], (177, 4.0, -1.0), (16, spot(12.0, 11.0)), *TWO_LINES[2:]]
    assert faults(plan_of(*rows)) == {}


def box(south, west, north, east, *, inside):
    corners = ((south, west), (south, east), (north, east), (north, west))
    return FencePolygon(inside=inside, corners=corners)


def test_the_fence_is_kept_inside_and_outside():
    plan = plan_of(*TWO_LINES)
    around = box(47.99, 10.99, 48.01, 11.01, inside=True)
    low = box(47.99, 10.99, 48.001, 11.01, inside=True)
    beside = box(48.0012, 11.00005, 48.0013, 11.01, inside=False)
    assert faults(replace(plan, fence=(around,))) == {}
    assert faults(replace(plan, fence=(low,))) == {"fence crossed": (5, 7, 9)}
    assert faults(replace(plan, fence=(around, beside))) == {"fence crossed": (9,)}
    # ArduPilot stays in every area, others in any.
    assert faults(replace(plan, fence=(around, low))) == {"fence crossed": (5, 7, 9)}
    assert faults(replace(plan, fence=(around, low), firmware=12)) == {}
    far = FenceCircle(inside=True, centre=(48.0, 11.0), radius=120.0)
    assert faults(replace(plan, fence=(far,))) == {"fence crossed": (5, 7, 9)}
    tree = FenceCircle(inside=False, centre=(48.001, 10.9999), radius=9.0)
    assert faults(replace(plan, fence=(tree,))) == {"fence crossed": (5,)}


def test_a_fence_that_crosses_itself_is_named_and_the_others_are_checked():
    bow = FencePolygon(
        inside=True, corners=((47.9, 10.9), (48.1, 11.1), (48.1, 10.9), (47.9, 11.1))
    )
    tree = FenceCircle(inside=False, centre=(48.001, 10.9999), radius=9.0)
    found = faults(plan_of(*TWO_LINES, fence=(bow, tree)))
    assert found == {"fence crosses itself": (), "fence crossed": (5,)}


def test_the_date_line_and_the_pole_are_places():
    east, west = spot(10.0, 179.9999), spot(10.0, -179.9999)
    up = (22, (0.0, 0.0, 3.0))
    line = plan_of(up, (216, 0.0), (16, east), (16, west), home=(10.0, 179.9995, 0.0))
    assert faults(line, sprays=False) == {}
    pole = plan_of(up, (16, spot(90.0, 0.0)), (16, spot(90.0, 170.0)), home=(89.9999, 0.0, 0.0))
    assert faults(pole, sprays=False) == {}
