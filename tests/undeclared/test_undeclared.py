"""The residual loop on sealed data sets, a small draw of the full score.

The full table is `python -m tests.undeclared.scorer --sets 100 --jobs 2`.
"""

import pytest
from rich.console import Console

from tests.undeclared.scorer import score
from tests.undeclared.table import print_table, summary

SMALL_DRAW = (
    "none",
    "rotor_degradation/onset",
    "extra_mass",
    "cg_offset",
    "climb_inflow",
    "sensor_lag",
    "half-tank step",
    "wandering sensor",
)


@pytest.mark.slow
def test_the_loop_names_what_is_missing_and_nothing_else():
    scores = score(len(SMALL_DRAW), seed=301, only=SMALL_DRAW, source="curve", jobs=2)
    print_table(scores, Console(width=160))
    figures = summary(scores)
    assert [(s.kind, s.wrong) for s in scores if s.wrong] == []
    assert figures["right_name_or_twin"]["share"] == 1.0
    assert figures["outside_unexplained"]["share"] == 1.0
    assert figures["error_ratio"]["median"] <= 1.1
