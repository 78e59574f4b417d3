"""Who is asked to look at a rotor that has no name."""

import pytest

from thrustmargin.models.identification.answer.accepted_names import worth_a_look


@pytest.mark.parametrize(
    ("probability", "without_rpm", "with_rpm", "asked"),
    [
        (0.52, 12.0, 10.0, True),
        (0.52, 10.1, 10.0, False),  # flights left out do not bear it out
        (0.99, 10.0, 12.0, False),  # they are predicted better without it
        (0.21, 12.0, 10.0, True),
        (0.19, 12.0, 10.0, False),  # a needless look costs more than to leave it
    ],
)
def test_a_rotor_is_asked_for_where_it_is_likely_and_flights_left_out_bear_it_out(
    probability, without_rpm, with_rpm, asked
):
    assert worth_a_look(probability, without_rpm, with_rpm) is asked
