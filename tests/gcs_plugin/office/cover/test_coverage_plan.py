"""Routes over fields: as long as area and swath say by hand, dry between lines, round obstacles."""

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.mission.fields_made import PLANE, SHAPES, comb, outline, rectangle
from thrustmargin.gcs_plugin.office.cover.coverage_plan import CoverageOrder, cover_field
from thrustmargin.mission.plan import read_plan, waypoints_text, write_plan
from thrustmargin.mission.plan_check import check_plan
from thrustmargin.mission.steps import PumpOutput, plan_steps
from thrustmargin.models.errors import PlanError

ORDER = CoverageOrder(swath=4.0, speed=5.0, height=3.0)


def ways(plan, pump=None):
    """(K, 2, 2) ways in (east, north) m and whether the pump is on along each."""
    flown = [s for s in plan_steps(plan, pump).steps if s.kind == "fly"]
    places = np.array([s.place[:2] for s in flown if s.place])
    points = shapely.get_coordinates(PLANE.to_plane(shapely.LineString(places[:, ::-1])))
    lines = np.stack([points[:-1], points[1:]], axis=1)
    return lines, np.array([bool(s.pump) for s in flown[1:]])


def lengths(lines):
    return np.hypot(*np.moveaxis(lines[:, 1] - lines[:, 0], -1, 0))


@pytest.mark.parametrize("heading", [None, 0.0, 37.0])
@pytest.mark.parametrize("name", sorted(SHAPES))
def test_the_sprayed_way_is_area_over_swath(name, heading):
    shapes, area = SHAPES[name]
    found = cover_field(outline(*shapes), replace(ORDER, heading_deg=heading))
    lines, on = ways(found.plan)
    assert found.field_area == pytest.approx(area, rel=2e-3)
    assert lengths(lines[on]).sum() == pytest.approx(area / 4.0, rel=0.02)
    assert found.sprayed_length == pytest.approx(lengths(lines[on]).sum(), rel=1e-3)
    assert found.transit_length == pytest.approx(lengths(lines[~on]).sum(), rel=0.01)
    assert found.sprayed_area > 0.97 * area
    steps = plan_steps(found.plan)
    assert steps.not_understood == ()
    assert check_plan(found.plan, steps) == ()


@pytest.mark.parametrize("name", sorted({*SHAPES} - {"split"}))
def test_no_way_leaves_the_field_or_crosses_its_hole(name):
    shapes, _ = SHAPES[name]
    found = cover_field(outline(*shapes), ORDER)
    lines, _ = ways(found.plan)
    assert found.ways_outside == 0
    assert shapely.covers(shapes[0].buffer(0.1), shapely.linestrings(lines)).all()


def test_between_parts_the_way_leaves_the_field_once():
    assert cover_field(outline(*SHAPES["split"][0]), ORDER).ways_outside == 1


def test_the_heading_of_a_long_field_is_along_it():
    found = cover_field(outline(rectangle(500.0, 40.0)), ORDER)
    assert found.lines.heading_deg[0] == pytest.approx(90.0, abs=0.01)
    assert len(found.lines.lines) == 10
    turned = shapely.affinity.rotate(rectangle(500.0, 40.0), 30.0)  # counter-clockwise
    assert cover_field(outline(turned), ORDER).lines.heading_deg[0] == pytest.approx(60.0, abs=0.1)


def test_a_headland_is_kept_free():
    found = cover_field(outline(rectangle()), replace(ORDER, headland=20.0, heading_deg=90.0))
    lines, on = ways(found.plan)
    # 260 m by 160 m are left, in lines 4 m apart
    assert lengths(lines[on]).sum() == pytest.approx(260.0 * 40, rel=1e-3)
    ground = lines.reshape(-1, 2)
    assert ground.min(axis=0) == pytest.approx([20.0, 22.0], abs=0.1)
    assert ground.max(axis=0) == pytest.approx([280.0, 178.0], abs=0.1)


def test_obstacles_are_flown_around_and_zones_over_with_the_pump_off():
    pylon, pond = rectangle(20, 30, at=(100, 80)), rectangle(40, 40, at=(200, 60))
    found = cover_field(
        outline(rectangle()),
        replace(ORDER, heading_deg=90.0, clearance=3.0),
        obstacles=outline(pylon),
        no_spray=outline(pond),
    )
    lines, on = ways(found.plan)
    drawn = np.array(shapely.linestrings(lines))
    assert not shapely.intersects(pylon.buffer(2.9), drawn).any()
    assert not shapely.intersects(pond.buffer(-0.1), drawn[on]).any()
    assert shapely.intersects(pond.buffer(-0.1), drawn[~on]).sum() >= 10
    by_hand = (60_000.0 - 26.0 * 36.0 - 1600.0) / 4.0
    assert lengths(lines[on]).sum() == pytest.approx(by_hand, rel=0.02)


@pytest.mark.parametrize(
    "pump", [PumpOutput(servo=9, on_us=1800.0, off_us=1000.0), PumpOutput(relay=1)]
)
def test_the_pump_is_switched_where_it_hangs(pump):
    found = cover_field(outline(rectangle(100, 20)), replace(ORDER, pump=pump, px4=True))
    assert all(item.command != 216 for item in found.plan.items)
    lines, on = ways(found.plan, pump)
    assert lengths(lines[on]).sum() == pytest.approx(500.0, rel=0.01)
    assert math.isnan(found.plan.items[2].parameters[3])  # PX4: no heading is ordered


def test_heights_are_above_home_or_above_the_ground():
    for above_ground, frame in ((False, 3), (True, 10)):
        plan = cover_field(outline(rectangle()), replace(ORDER, above_ground=above_ground)).plan
        places = [i for i in plan.items if i.place]
        assert {i.frame for i in places} == {frame}
        assert {i.parameters[6] for i in places} == {3.0}


def test_a_home_on_the_other_side_of_the_world_is_refused():
    for home in ((49.0, 11.0, 0.0), (-48.0, -169.0, 0.0)):
        with pytest.raises(PlanError, match="km from the field"):
            cover_field(outline(rectangle()), ORDER, home=home)


def test_obstacles_and_zones_that_lie_elsewhere_are_named():
    field, tree = outline(rectangle()), rectangle(5, 5, at=(100, 80))
    away = replace(outline(rectangle(5, 5, at=(900, 0))), name="trees.kml")
    assert cover_field(field, ORDER, obstacles=away).elsewhere == ("trees.kml",)
    assert cover_field(field, ORDER, obstacles=outline(tree), no_spray=away).elsewhere == (
        "trees.kml",
    )
    assert cover_field(field, ORDER, obstacles=outline(tree)).elsewhere == ()


@pytest.mark.parametrize("ending", ["plan", "waypoints"])
def test_what_is_written_is_read_back(tmp_path: Path, ending: str):
    plan = cover_field(outline(rectangle()), ORDER, home=(48.0, 11.0, 512.5)).plan
    path = tmp_path / f"field.{ending}"
    write_plan(plan, path)
    again = read_plan(path)
    assert again.items == plan.items
    assert again.home == plan.home


def test_pymavlinks_loader_reads_the_same_items(tmp_path: Path):
    from pymavlink.mavwp import MAVWPLoader

    plan = cover_field(outline(rectangle()), ORDER, home=(48.0, 11.0, 512.5)).plan
    path = tmp_path / "field.waypoints"
    path.write_text(waypoints_text(plan))
    loader = MAVWPLoader()
    assert loader.load(str(path)) == len(plan.items) + 1
    for k, item in enumerate(plan.items, start=1):
        theirs = loader.wp(k)
        assert theirs is not None
        assert (theirs.seq, theirs.command, theirs.frame) == (k, item.command, item.frame)
        values = (theirs.param1, theirs.param2, theirs.param3, theirs.param4)
        assert (*values, theirs.x, theirs.y, theirs.z) == item.parameters


@pytest.mark.parametrize(
    ("area", "order", "words"),
    [
        (rectangle(), replace(ORDER, headland=150.0), "nothing is left of the field to fly"),
        (rectangle(5000, 5000), replace(ORDER, swath=0.1), "makes 50000 lines of the field"),
        (rectangle(), replace(ORDER, swath=math.nan), "sprays nothing; give its width in m"),
        (comb(2500), ORDER, "into over 16000 pieces; simplify it"),
        (comb(2500), replace(ORDER, swath=8.0), "over 1000 cells; simplify it"),
    ],
)
def test_what_cannot_be_sprayed_is_refused_soon(area, order, words):
    field = outline(area)
    began = time.monotonic()
    with pytest.raises(PlanError, match=words):
        cover_field(field, order)
    assert time.monotonic() - began < 4.0  # 2 s alone on the machine


def test_500_hectares_take_a_few_seconds():
    field = outline(rectangle(2500.0, 2000.0))
    began = time.monotonic()
    found = cover_field(field, replace(ORDER, swath=5.0, heading_deg=0.0))
    assert time.monotonic() - began < 5.0
    assert len(found.lines.lines) == 500
