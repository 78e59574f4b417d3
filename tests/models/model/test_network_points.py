"""The network's points of Figure 10, worked out from a network of one linear layer."""

import numpy as np
import pytest

from thrustmargin.models.errors import ModelError
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.model.training import network_points
from thrustmargin.models.network.network import RotorNetwork
from thrustmargin.models.network.validity import TrainingDomain
from thrustmargin.models.physics.airframe import load_airframe

G0 = 9.80665  # m/s²


F16 = load_airframe("topxgun-f16")


def linear_model(density: float = 1.15) -> RotorModel:
    """A network without hidden layers: N_i = 1600 - 20 V + 33 m + 10 i, learnt up to 5 m/s."""
    network = RotorNetwork(
        weights=(np.array([[[-20.0] * 4, [33.0] * 4]], dtype=np.float32),),
        biases=(np.array([[0.0, 10.0, 20.0, 30.0]], dtype=np.float32),),
        input_mean=np.zeros((1, 2)),
        input_scale=np.ones((1, 2)),
        output_mean=np.full((1, 4), 1600.0),
        output_scale=np.ones((1, 4)),
    )
    nothing = (float("nan"), float("nan"))
    domain = TrainingDomain(
        airspeed=(0.0, 5.0),
        tank_kg=(0.0, 16.0),
        density=(density, density),
        height_agl=nothing,
        wind_speed=nothing,
        flights=("one",),
    )
    return RotorModel(
        airframe=load_airframe("topxgun-f16-sitl"),
        network=network,
        training_domain=domain,
        reference_density=density,
        reference_voltage=58.8,
    )


def test_network_points_are_what_the_network_says_in_the_air_of_the_curve():
    points = network_points(F16, linear_model())
    assert points.airspeed.tolist() == [2.0, 2.0, 2.0, 4.0, 4.0, 4.0]
    tank_kg = np.array([4.0, 10.0, 16.0] * 2)
    assert points.title == "TopXGun F16, simulated (quad, 16 L)"
    assert points.left_out == 3  # 6 m/s is beyond what it learnt
    said = 1600.0 - 20.0 * points.airspeed + 33.0 * tank_kg
    expected = (said[:, None] + [0.0, 10.0, 20.0, 30.0]) * np.sqrt(1.15 / 1.225)
    np.testing.assert_allclose(points.rotor_speed_rpm, expected, rtol=1e-6)
    np.testing.assert_allclose(points.load, (21.1 + tank_kg) * G0 / 4)


def test_a_model_of_another_aircraft_or_without_a_network_gives_no_points(
    monkeypatch: pytest.MonkeyPatch,
):
    with pytest.raises(ModelError, match="made for topxgun-f16-sitl, not for agras-t20"):
        network_points(load_airframe("agras-t20"), linear_model())
    with pytest.raises(ModelError, match="no network that covers"):
        network_points(F16, physics_model(F16))
    monkeypatch.setattr(f"{network_points.__module__}.FIGURE_AIRSPEEDS", (9.0,))
    with pytest.raises(ModelError, match="no network that covers"):
        network_points(F16, linear_model())
