"""A manoeuvre as a mission: bounded by what was flown, and read back as written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from tests.models.made_flights import made_flights
from thrustmargin.gcs_plugin.workshop.identify.manoeuvre_plan import manoeuvre_plan
from thrustmargin.mission.plan import read_plan, write_plan
from thrustmargin.models.errors import PlanError
from thrustmargin.models.identification.next_flight.manoeuvres import FlownLimits, manoeuvres

#: As the code has them, written down by hand: a change there is to be seen here.
CHANGE_SPEED = 178
RETURN_TO_LAUNCH = 20
TAKEOFF = 22
WAYPOINT = 16

LOWEST = 2.0  # m above home
LIMITS = replace(FlownLimits.from_tracks(made_flights(3)), height=(3.0, 20.0), climb=2.0)
LIBRARY = {m.name: m for m in manoeuvres(LIMITS)}


@pytest.mark.parametrize("name", LIBRARY)
def test_a_written_plan_reads_back_and_stays_where_the_flights_were(name: str, tmp_path: Path):
    plan = manoeuvre_plan(LIBRARY[name], LIMITS)
    write_plan(plan, tmp_path / "next.plan")
    read = read_plan(tmp_path / "next.plan")
    assert [i.command for i in read.items] == [i.command for i in plan.items]
    assert [read.items[k].command for k in (0, -1)] == [TAKEOFF, RETURN_TO_LAUNCH]
    places = np.array([i.place for i in read.items if i.place is not None])
    north, east, _ = pymap3d.geodetic2ned(
        places[:, 0], places[:, 1], read.home[2], read.home[0], read.home[1], read.home[2]
    )
    middle = np.array(LIMITS.place_ne)
    far = np.hypot(north - middle[0], east - middle[1]).max()
    assert far < np.hypot(1.0, 1.0) * LIMITS.reach + 1.0
    assert places[:, 2].min() >= LOWEST
    assert places[:, 2].max() <= LIMITS.height[1] + 0.5
    speeds = [i.parameters[1] for i in read.items if i.command == CHANGE_SPEED]
    assert max(speeds, default=0.0) <= LIMITS.speed


def test_a_hover_waits_half_a_minute_at_one_place():
    items = manoeuvre_plan(LIBRARY["hover"], LIMITS, repeats=3).items
    waits = [i.parameters[0] for i in items if i.command == WAYPOINT]
    assert waits == [30.0, 30.0, 30.0]


def test_speed_steps_change_speed_along_one_line():
    items = manoeuvre_plan(LIBRARY["speed steps"], LIMITS).items
    speeds = [i.parameters[1] for i in items if i.command == CHANGE_SPEED]
    assert speeds == pytest.approx(np.array([0.5, 1.0, 0.5, 1.0, 0.5]) * LIMITS.speed)


@pytest.mark.parametrize(("heights", "lowest"), [((0.3, 20.0), 2.0), ((0.3, 1.5), 0.9)])
def test_a_mission_keeps_two_metres_but_where_flights_were_lower(heights, lowest):
    limits = replace(LIMITS, height=heights, climb=0.35)
    climb = next(m for m in manoeuvres(limits) if m.name == "climb and descent")
    places = [i.place for i in manoeuvre_plan(climb, limits).items]
    assert min(p[2] for p in places if p is not None) == pytest.approx(lowest, abs=1e-3)


def test_flights_without_a_position_give_no_mission():
    with pytest.raises(PlanError, match="no position"):
        manoeuvre_plan(LIBRARY["hover"], replace(LIMITS, origin=None))
