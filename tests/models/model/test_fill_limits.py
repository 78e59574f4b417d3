"""The largest fill: each limit against the formula by hand, the least of them, its interval."""

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tests.models.model.made_models import worn_rotor
from thrustmargin.models.model import fill_limits
from thrustmargin.models.model.fill_limits import (
    Fills,
    largest_fills,
    steady_flight,
)
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import Quantity, load_airframe
from thrustmargin.models.physics.margin import ceiling, largest_fill

F16 = load_airframe("topxgun-f16")
G = 9.80665
#: N, one rotor at 3000 rpm in the curve's own air and voltage
FULL = 2.011e-5 * 3000.0**2


def fills(
    airframe=F16,
    density: ArrayLike = F16.reference_density,
    voltage: ArrayLike = 51.8,
    *,
    max_utilisation: float = 0.5,
    rotor_lost: bool = True,
):
    return largest_fills(
        physics_model(airframe),
        density,
        voltage,
        airspeed=0.0,
        max_utilisation=max_utilisation,
        rotor_lost=rotor_lost,
    )


def test_each_limit_is_the_formula_by_hand():
    found = fills(max_utilisation=0.45)
    by_use, by_rotor, by_mass, by_tank = found.by_reason[:, 0]
    assert by_use == pytest.approx(4 * 0.45 * FULL / G - 21.1, abs=1e-6)
    assert by_rotor == pytest.approx(2 * FULL / G - 21.1, abs=1e-6)  # the diagonal pair
    assert by_mass == np.inf
    assert by_tank == 16.0
    assert found.reason == ("utilisation",)
    assert found.largest == pytest.approx([by_use])


def test_thin_air_and_a_low_battery_take_from_the_fill():
    voltages = np.array([51.8, 46.0])
    density = np.array([1.1934, 1.0])
    found = fills(density=density, voltage=voltages)
    by_hand = 2 * FULL * density / 1.1934 * (voltages / 51.8) ** 2 / G - 21.1
    np.testing.assert_allclose(found.by_reason[0], by_hand, atol=1e-6)
    np.testing.assert_allclose(found.by_reason[1], by_hand, atol=1e-6)
    limits = ceiling(F16, density, voltages)
    np.testing.assert_allclose(found.by_reason[0], largest_fill(F16, limits), atol=1e-6)


def test_the_makers_mass_and_the_tank_cap_the_fill():
    stated = dict(F16.quantities) | {"max_takeoff_mass": Quantity(30.0, "kg", "the maker")}
    heavy = fills(replace(F16, quantities=MappingProxyType(stated)))
    assert heavy.reason == ("take-off mass",)
    assert heavy.largest == pytest.approx([8.9])
    strong = fills(replace(F16, max_rotor_speed_rpm=4000.0))
    assert strong.reason == ("tank",)
    assert strong.largest == pytest.approx([16.0])


def test_without_a_rotor_to_lose_only_the_use_counts():
    found = fills(max_utilisation=0.45, rotor_lost=False)
    assert found.by_reason[1, 0] == np.inf
    assert found.largest == pytest.approx([4 * 0.45 * FULL / G - 21.1])


def test_the_interval_is_that_of_what_the_airframe_guesses():
    """The F16's ceiling voltage is guessed: 10 % of thrust, 1.645 times that on either side."""
    found = fills()
    mass = 2 * FULL / G
    assert found.low[1, 0] == pytest.approx(mass * np.exp(-0.1645) - 21.1)
    assert found.high[1, 0] == pytest.approx(mass * np.exp(0.1645) - 21.1)
    assert found.low[0, 0] == pytest.approx(mass / 1.1645 - 21.1)
    assert found.high[0, 0] == pytest.approx(mass / (1 - 0.1645) - 21.1)
    assert found.interval[0] == pytest.approx(found.low[1])
    assert found.interval[1] == pytest.approx([16.0])


def test_the_fill_to_plan_by_is_the_low_end_of_the_least_in_each_air():
    least = np.array([[3.0, np.nan], [4.0, np.nan]])
    found = Fills(by_reason=np.array([[9.0, 5.0], [8.0, 6.0]]), low=least, high=least + 1.0)
    assert found.largest.tolist() == [8.0, 5.0]
    assert found.interval[0].tolist()[0] == 3.0
    assert found.interval[1].tolist()[0] == 4.0
    assert found.sure.tolist() == [3.0, 5.0]  # of no interval the fill itself


def test_half_of_full_thrust_and_a_lost_rotor_are_the_limits_unless_others_are_given():
    found = largest_fills(physics_model(F16), F16.reference_density, 51.8, airspeed=0.0)
    np.testing.assert_array_equal(found.by_reason, fills().by_reason)


def test_the_worst_rotor_is_the_one_that_counts():
    model = replace(physics_model(F16), effects=(worn_rotor(),))
    fill = largest_fills(model, 1.2, 51.8, airspeed=0.0).by_reason[0]
    use = steady_flight(model, 1.2, 51.8, 0.0, fill).utilisation_predicted
    assert np.max(use) == pytest.approx(0.5, abs=1e-3)
    assert np.min(use) < 0.49


def test_an_aircraft_without_a_tank_has_a_limit_of_use_too():
    found = fills(replace(F16, tank_volume_l=0.0), rotor_lost=False)
    assert found.by_reason[0] == pytest.approx(2 * FULL / G - 21.1)
    assert found.largest == pytest.approx([0.0])


def test_flight_into_the_wind_takes_from_the_fill_of_a_model_that_knows_drag():
    model = shipped_model()
    slow, fast = (
        largest_fills(model, model.reference_density, 51.8, airspeed=v).by_reason[0, 0]
        for v in (3.0, 9.0)
    )
    assert slow != pytest.approx(fast, abs=0.05)


@pytest.mark.parametrize(
    ("use", "limit", "kg"),
    [
        (lambda fill: 0.3 + 0.01 * fill, 0.5, 20.0),
        (lambda fill: 0.3 + 0.001 * fill, 0.5, 200.0),  # far above any tank, on by the last slope
        (lambda fill: 0.6 + 0.01 * fill, 0.5, -10.0),  # too heavy when it is empty
        (lambda fill: np.minimum(0.3 + 0.01 * fill, 0.45), 0.4, 10.0),
        (lambda fill: np.where(fill < 12.0, 0.3 + 0.01 * fill, np.nan), 0.5, 20.0),
        (lambda fill: 0.4 + 0.0 * fill, 0.5, np.nan),
        (lambda fill: 0.5 - 0.001 * fill, 0.6, np.nan),
        (lambda fill: np.where(fill == 0.0, 0.4, np.nan), 0.5, np.nan),
        (lambda fill: np.nan * fill, 0.5, np.nan),
    ],
)
def test_a_fill_is_the_largest_where_the_use_grows_to_its_limit(monkeypatch, use, limit, kg):
    def steady(_model, _density, _voltage, _airspeed, fills):
        made = use(fills)[:, None] * [1.0, 0.9]
        return SimpleNamespace(utilisation_predicted=made, utilisation_error=np.zeros_like(made))

    monkeypatch.setattr(fill_limits, "steady_flight", steady)
    found = largest_fills(physics_model(F16), 1.2, 51.8, airspeed=0.0, max_utilisation=limit)
    assert found.by_reason[0, 0] == pytest.approx(kg, nan_ok=True)
