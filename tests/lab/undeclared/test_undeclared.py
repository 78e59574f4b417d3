"""The residual loop on a small draw of data whose cause it is not told.

The full tables: `python -m tests.lab.undeclared.scorer --help`.
"""

import pytest

from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.scorer import Case, score_one
from tests.lab.undeclared.subject import trained_model

#: Plain sizes: a name that goes wrong here is wrong for any user. Small ones are the scorer's.
PLAIN = {"rotor": 0.08, "cg": 0.02, "jet": 0.01}


@pytest.mark.slow
def test_plain_changes_are_named_and_nothing_else(tmp_path_factory):
    models = tmp_path_factory.mktemp("models")
    trained_model(CRAFTS[0], models, flights=6)  # in half of the time
    plan = {"none": None, **PLAIN}
    cases = [
        Case(seed=77, kind=kind, craft=CRAFTS[0], models=models, compare=False, size=size)
        for kind, size in plan.items()
    ]
    scores = list(map(score_one, cases))
    wrong = [(s.kind, s.wrong, s.failed) for s in scores]
    assert [w for w in wrong if w[1] or w[2]] == []
    assert [
        (s.kind, s.verdicts) for s in scores if "missed" in s.verdicts and s.kind != "jet"
    ] == []
