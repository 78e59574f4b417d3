"""Heights of a written .plan as QGroundControl shows them, and circles of its fence."""

import json
from pathlib import Path

import pytest

from tests.mission.plans_made import HOME, item
from thrustmargin.mission.plan import read_plan, write_plan
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.models.errors import PlanError

WAYPOINT, SPEED = 16, 178


def written(tmp_path: Path, *, frame: int, command: int = WAYPOINT) -> dict[str, object]:
    """The second item of a written plan, which has this frame."""
    place = (48.001, 11.0, 25.0)
    items = (item(1, 22, at=place), item(2, command, at=place, frame=frame))
    write_plan(MissionPlan(items=items, home=HOME, firmware=3), tmp_path / "a.plan")
    return json.loads((tmp_path / "a.plan").read_text())["mission"]["items"][1]


@pytest.mark.parametrize(("frame", "mode"), [(3, 1), (0, 2), (10, 4)])
def test_a_height_is_shown_above_home_sea_or_ground_as_its_frame_says(
    tmp_path: Path, frame: int, mode: int
):
    """MAV_FRAME 3 above home, 0 above the sea, 10 above ground; AltitudeMode 1, 2, 4."""
    made = written(tmp_path, frame=frame)
    assert (made["Altitude"], made["AltitudeMode"]) == (25.0, mode)


def test_what_has_no_height_is_shown_with_none(tmp_path: Path):
    assert "Altitude" not in written(tmp_path, frame=2)  # numbers without a unit
    assert "Altitude" not in written(tmp_path, frame=3, command=SPEED)


@pytest.mark.parametrize("centre", [(91.0, 8.5), (47.0, 181.0)])
def test_a_circle_of_a_fence_that_is_nowhere_is_refused(
    tmp_path: Path, centre: tuple[float, float]
):
    written(tmp_path, frame=3)
    content = json.loads((tmp_path / "a.plan").read_text())
    content["geoFence"]["circles"] = [{"circle": {"center": list(centre), "radius": 25.0}}]
    (tmp_path / "b.plan").write_text(json.dumps(content))
    with pytest.raises(PlanError, match="circle"):
        read_plan(tmp_path / "b.plan")
