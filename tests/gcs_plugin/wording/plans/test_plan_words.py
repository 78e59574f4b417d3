"""Words of plans: every reason and every fault has its own, and what to do."""

from typing import get_args

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.wording.plans.plan_words import (
    FAULTS,
    NOT_UNDERSTOOD,
    coverage_words,
    fault_words,
    not_understood_words,
)
from thrustmargin.mission.coverage.coverage_plan import Coverage
from thrustmargin.mission.coverage.spray_lines import LinesInOrder
from thrustmargin.mission.plan_check import PlanFault
from thrustmargin.mission.plan_items import NotUnderstood, Touched, Why


def test_every_reason_and_every_fault_has_words():
    assert set(NOT_UNDERSTOOD) == set(get_args(Why))
    assert set(FAULTS) == set(get_args(PlanFault))


def test_an_item_is_named_with_its_number_its_command_and_what_it_touches():
    touches: tuple[Touched, ...] = ("distance", "time")
    one = NotUnderstood(item=12, command=42, why="unknown command", touches=touches)
    assert not_understood_words(one) == (
        "item 12 (MAV_CMD 42): what this command does is not known; take it out, or allow for it "
        "(touches distance, time)"
    )


def test_a_fault_lists_its_first_items():
    assert fault_words("pump never on", ()) == (
        "the pump is never switched on; add DO_SPRAYER at the start of a line"
    )
    assert fault_words("pump on in turns", [4]).startswith("item 4: the pump stays on in turns; ")
    high = fault_words("far above home", [2, 4], 505.3)
    assert high == "items 2, 4: up to 505 m above home; is it meant above the sea?"
    assert "up to 495 m below home" in fault_words("below home", [2], -495.0)
    assert fault_words("at the height of home", [1, 2], 0.0).startswith("items 1, 2: 0 m above")
    many = fault_words("fence crossed", range(1, 13))
    assert many.startswith("items 1, 2, 3, 4, 5 and 7 more: the way leaves the geofence; ")


@pytest.mark.parametrize(
    ("spacing", "apart"), [((4.0, 4.05), "4.00 to 4.05 m"), ((4.0, 4.004), "4.00 m")]
)
def test_a_route_is_said_in_hectares_lines_and_kilometres(spacing: tuple[float, ...], apart: str):
    lines = LinesInOrder(
        lines=np.zeros((30, 2, 2)), heading_deg=(179.8, 0.1, 45.0), spacing=spacing, cells=1
    )
    said = coverage_words(
        Coverage(
            plan=plan_of(*TWO_LINES),
            lines=lines,
            field_area=120_000.0,
            spray_area=100_000.0,
            sprayed_area=99_000.0,
            sprayed_length=25_000.0,
            transit_length=1234.0,
            ways_outside=2,
            home_given=True,
            elsewhere=("trees.kml",),
        )
    )
    assert said == (
        "Field 12.00 ha, to spray 10.00 ha, under the swaths 99.0 % of that.",
        f"30 lines, {apart} apart, heading 0°, 45°.",
        "Sprayed way 25.00 km, between lines 1.23 km with the pump off.",
        "Ways between lines that leave the field: 2.",
        "trees.kml has nothing in the field.",
    )
