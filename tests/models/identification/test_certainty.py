"""What is asked of a person follows from probability and from what an error costs."""

import pytest

from thrustmargin.models.identification.certainty import COSTS, Cost


@pytest.mark.parametrize(("needless", "missed", "least"), [(1.0, 4.0, 0.2), (2.0, 2.0, 0.5)])
def test_an_action_is_asked_for_from_where_it_costs_less_than_to_leave_it(needless, missed, least):
    cost = Cost(needless=needless, missed=missed)
    assert cost.action_threshold == pytest.approx(least)
    # Just there both cost the same: (1 - p) needless = p missed.
    assert cost.expected_cost(least) == pytest.approx(least * missed)
    assert cost.expected_cost(1.0) == 0.0


def test_a_propeller_is_looked_at_sooner_than_an_instrument_is_set():
    assert COSTS["rotor"].action_threshold == pytest.approx(0.2)
    assert COSTS["instrument"].action_threshold == pytest.approx(0.5)
