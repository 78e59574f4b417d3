"""The route over a field, in sentences."""

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.office.cover.cover_words import coverage_words
from thrustmargin.gcs_plugin.office.cover.coverage_plan import Coverage
from thrustmargin.gcs_plugin.office.cover.spray_lines import LinesInOrder


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
