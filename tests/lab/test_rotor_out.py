"""Redundancy of 1 is the load that a simulated flight still holds without its worst rotor."""

import pytest

from tests.lab.rotor_out import holds
from thrustmargin.models.physics.airframe import load_airframe


@pytest.mark.parametrize(("name", "worst", "kg"), [("agras-t20", 0, 54.0), ("agras-t40", 0, 145.9)])
def test_what_redundancy_allows_is_held_and_what_it_does_not_falls(name, worst, kg):
    """4 of 6 rotors of 13.5 kgf; `kg` is what `report` calls a redundancy of 1."""
    craft = load_airframe(name)
    assert holds(craft, worst, 0.97 * kg)
    assert not holds(craft, worst, 1.03 * kg)


def test_the_lower_rotor_of_a_pair_leaves_more_than_the_upper():
    """The lower one of a coaxial pair makes less, so it is missed less."""
    assert holds(load_airframe("agras-t40"), 4, 1.03 * 145.9)
