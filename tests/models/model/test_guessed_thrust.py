"""What a guess in an airframe file adds to the error of the largest thrust."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from thrustmargin.models.model.fill_limits import before_take_off, largest_fills
from thrustmargin.models.model.inferred.utilisation_error import (
    ceiling_variance,
    largest_thrust_variance,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

T20 = load_airframe("agras-t20")  # the maker prints its thrust; curve and speed are guessed from it


def with_quantity(craft, name, **changes):
    quantity = replace(craft.quantities[name], **changes)
    found = MappingProxyType({**craft.quantities, name: quantity})
    return replace(craft, quantities=found, **{name: quantity.value})


def test_a_curve_and_a_speed_guessed_from_one_thrust_count_once():
    """0.1 of the data sheet and 0.1 of its voltage."""
    assert largest_thrust_variance(T20) == pytest.approx(0.02)
    apart = with_quantity(T20, "max_rotor_speed_rpm", value=1.2 * T20.max_rotor_speed_rpm)
    assert largest_thrust_variance(apart) == pytest.approx(0.03)
    guessed = with_quantity(T20, "nameplate_max_thrust", guessed=True)
    assert largest_thrust_variance(guessed) == pytest.approx(0.03)


def test_by_rotor_speed_such_a_curve_counts_too():
    """The speed at the data sheet's thrust follows from the curve."""
    assert ceiling_variance(T20, np.array(50.0)) == pytest.approx(0.03)
    measured = with_quantity(T20, "thrust_coefficient", guessed=False)
    assert ceiling_variance(measured, np.array(50.0)) == pytest.approx(0.02)


def test_a_guess_counts_with_its_own_error():
    surer = with_quantity(T20, "max_rotor_speed_rpm", thrust_error=0.02)
    assert largest_thrust_variance(surer) == pytest.approx(0.02**2 + 0.1**2)


def test_a_surer_ceiling_gives_more_to_fill_and_a_guessed_one_names_the_climb():
    fills = [
        before_take_off(
            largest_fills(physics_model(craft), 1.2, 51.8, airspeed=0.0), physics_model(craft)
        )
        for craft in (T20, with_quantity(T20, "max_rotor_speed_rpm", thrust_error=0.02))
    ]
    assert fills[0].kg < fills[1].kg
    assert fills[0].limit_kg == pytest.approx(fills[1].limit_kg)
    assert fills[0].ceiling_guessed
    measured = with_quantity(T20, "max_rotor_speed_rpm", guessed=False)
    known = largest_fills(physics_model(measured), 1.2, 51.8, airspeed=0.0)
    assert not before_take_off(known, physics_model(measured)).ceiling_guessed
