"""The full table of the residual loop on sealed data sets, and what drawing one costs.

The number of data sets is `THRUSTMARGIN_SEALED_SETS` (100); the table is printed.
"""

import os

from rich.console import Console

from tests.undeclared.datasets import build
from tests.undeclared.scorer import score
from tests.undeclared.table import print_table, summary


def test_drawing_a_data_set(benchmark):
    benchmark(build, "rotor_degradation", 5, "trained")


def test_score_of_the_residual_loop(benchmark):
    sets = int(os.environ.get("THRUSTMARGIN_SEALED_SETS", "100"))
    scores = benchmark.pedantic(score, args=(sets, 1), kwargs={"jobs": 2}, rounds=1)
    print_table(scores, Console(width=160))
    benchmark.extra_info.update(summary(scores))
