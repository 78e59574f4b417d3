"""The residual loop on sealed data sets, a small draw of the full score.

The full table is `python -m tests.undeclared.scorer --sets 100 --jobs 2`.
"""

import pytest
from rich.console import Console

from tests.undeclared.scorer import score
from tests.undeclared.table import print_table, summary

SMALL_DRAW = (
    "none",
    "rotor_degradation",
    "extra_mass",
    "cg_offset",
    "climb_inflow",
    "half-tank step",
)


@pytest.mark.slow
def test_the_loop_names_what_is_missing_and_nothing_else():
    scores = score(len(SMALL_DRAW), seed=301, only=SMALL_DRAW, jobs=2)
    print_table(scores, Console(width=160))
    figures = summary(scores)
    assert sum(bool(s.wrong) for s in scores) <= 1
    assert figures["right_name_or_twin"]["share"] >= 0.8
    assert figures["error_ratio"]["median"] <= 1.35
