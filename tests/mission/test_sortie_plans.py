"""A plan split into sorties sprays the same lines, each once, and goes dry in between."""

from dataclasses import replace
from itertools import pairwise

import pytest

from tests.mission.plans_made import FIRST, SECOND, TWO_LINES, plan_of, spot
from thrustmargin.mission.plan import read_plan, write_plan
from thrustmargin.mission.plan_check import check_plan
from thrustmargin.mission.sortie_plans import line_ends, split_plan
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.errors import PlanError


def sprayed(plan):
    """Start and end of each way with the pump on."""
    steps = plan_steps(plan).steps
    return [
        (a.place[:2], b.place[:2]) for a, b in pairwise(steps) if b.pump and a.place and b.place
    ]


def test_a_sortie_ends_at_a_line_end_and_the_next_goes_on_from_there(tmp_path):
    plan = plan_of(*TWO_LINES)
    steps = plan_steps(plan)
    assert line_ends(plan, steps) == (2,)
    first, second = split_plan(plan, steps, [2])
    assert sprayed(first) + sprayed(second) == sprayed(plan)
    assert [i.command for i in second.items][:4] == [22, 178, 216, 16]
    assert second.items[3].place == spot(SECOND, 11.0)  # the line end before
    assert [i.number for i in second.items] == list(range(1, len(second.items) + 1))
    for k, sortie in enumerate((first, second)):
        assert check_plan(sortie, plan_steps(sortie)) == ()
        assert sortie.items[-1].command == 20
        write_plan(sortie, tmp_path / f"sortie_{k}.plan")
        assert read_plan(tmp_path / f"sortie_{k}.plan").items == sortie.items


def test_a_pump_that_runs_on_through_turns_runs_again_from_the_line_end():
    plan = plan_of(*[row for k, row in enumerate(TWO_LINES, start=1) if k not in (6, 8)])
    steps = plan_steps(plan)
    assert line_ends(plan, steps) == (2, 3)
    first, second = split_plan(plan, steps, [2])
    assert sprayed(first) + sprayed(second) == sprayed(plan)


def test_jumps_are_unrolled():
    plan = plan_of(*TWO_LINES[:-1], (177, 3.0, 1.0), (20,))
    steps = plan_steps(plan)
    parts = split_plan(plan, steps, [4, 6])
    assert [way for part in parts for way in sprayed(part)] == sprayed(plan)
    assert all(item.command != 177 for part in parts for item in part.items)


def test_a_plan_without_a_pump_is_split_at_bends_and_gets_none():
    rows = [row for row in TWO_LINES if row[0] != 216]
    plan = plan_of(*rows)
    first, second = split_plan(plan, plan_steps(plan), [2])
    assert all(item.command != 216 for part in (first, second) for item in part.items)


@pytest.mark.parametrize(
    ("refill_after", "moved", "words"),
    [
        ([3], {}, "item 7 is no line end; a refill is at the end of a line"),
        ([99], {}, "item 99 is no line end"),
        (
            [2],
            {"home": (48.1, 11.0, 0.0)},
            r"home, where to refill, is 11.0 km from the nearest place.*within 3 km",
        ),
        ([2], {"home": (-48.0, -169.0, 0.0)}, "km from the nearest place"),
    ],
)
def test_what_cannot_be_split_is_refused(refill_after, moved, words):
    plan = replace(plan_of(*TWO_LINES), **moved)
    with pytest.raises(PlanError, match=words):
        split_plan(plan, plan_steps(plan), refill_after)


def test_a_plan_that_jumps_to_itself_is_not_split():
    plan = plan_of(*TWO_LINES[:-1], (177, 11.0, 1.0), (16, spot(FIRST, 11.0)))
    with pytest.raises(PlanError, match="item 11 is a jump to itself"):
        split_plan(plan, plan_steps(plan), [2])
