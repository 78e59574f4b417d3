"""The base of a rotor speed model: its network where that knows, else weight and thrust curve."""

import numpy as np
import pytest

from tests.models.model.made_models import F16, learnt_model, network
from thrustmargin.models.errors import ModelError
from thrustmargin.models.physics.forward_flight import thrust_ratio


def test_beyond_what_it_knows_a_network_is_carried_on_by_drag_and_lift():
    model = learnt_model()
    tank = np.full(3, 8.0)
    edge, near, far = model.extrapolated_speed(np.array([5.0, 5.0 + 1e-6, 12.0]), tank)
    assert np.allclose(near, edge, rtol=1e-5)
    assert model.forward_flight is not None
    mass = F16.empty_mass + tank[:2]
    at = thrust_ratio(
        model.forward_flight, np.array([5.0, 12.0]), mass, model.reference_density, F16
    )
    assert np.allclose((far / edge) ** 2, at[1] / at[0])
    held = learnt_model(forward_flight=None)
    assert np.array_equal(*held.extrapolated_speed(np.array([6.0, 12.0]), tank[:2]))


def test_a_network_of_another_rotor_count_is_refused():
    with pytest.raises(ModelError, match="6 rotors"):
        learnt_model(network=network(6))


def test_base_speed_is_the_network_inside_and_the_weight_outside():
    model = learnt_model(effects=())
    airspeed = np.array([3.0, 12.0, np.nan, 3.0])
    tank = np.array([8.0, 8.0, 8.0, np.nan])
    speeds = model.base_speed(airspeed, tank)
    hover = np.sqrt((F16.empty_mass + 8.0) * 9.80665 / 4 / model.thrust_coefficient)
    np.testing.assert_allclose(speeds[1], hover)
    assert np.all(np.abs(speeds[0] - hover) > 1e-3)
    assert np.isnan(speeds[2:]).all()
    thrust = model.thrust_coefficient * model.base_speed(airspeed, tank) ** 2
    np.testing.assert_allclose(thrust[1].sum(), (F16.empty_mass + 8.0) * 9.80665)
