"""Networks of two units, worked out by hand."""

from dataclasses import fields

import numpy as np
import pytest

from thrustmargin.models.network.network import (
    NetConfig,
    RotorNetwork,
    ensemble_speed,
    fit_network,
    member_speeds,
    stack_networks,
)

#: As the code has them, written down by hand: a change there is to be seen here.
CHUNK_ROWS = 4096


def small(offset: float = 0.0) -> RotorNetwork:
    """Two hidden units and two rotors; `offset` in standard units moves the first rotor."""
    return RotorNetwork(
        weights=(
            np.array([[[1.0, -1.0], [0.5, 2.0]]], dtype=np.float32),
            np.array([[[2.0, 0.0], [1.0, 3.0]]], dtype=np.float32),
        ),
        biases=(
            np.array([[0.0, -4.0]], dtype=np.float32),
            np.array([[1.0 + offset, -1.0]], dtype=np.float32),
        ),
        input_mean=np.array([[1.0, 2.0]]),
        input_scale=np.array([[2.0, 4.0]]),
        output_mean=np.array([[100.0, 1000.0]]),
        output_scale=np.array([[10.0, 50.0]]),
    )


#: V = 3, m = 10: x = ((3-1)/2, (10-2)/4) = (1, 2); units 1 + 1 = 2 and -1 + 4 - 4 = -1, cut to 0;
#: outputs 2 x 2 + 1 = 5 and -1; speeds 100 + 50 = 150 and 1000 - 50 = 950.
#: V = 3, m = 18: x = (1, 4); units 1 + 2 = 3 and -1 + 8 - 4 = 3; outputs 6 + 3 + 1 = 10 and 9 - 1
#: = 8; speeds 200 and 1400. The last layer is not cut: V = -3, m = 2: x = (-2, 0), units -2 -> 0
#: and 2 - 4 -> 0; outputs 1 and -1; 110 and 950.
BY_HAND = np.array([[150.0, 950.0], [200.0, 1400.0], [110.0, 950.0]])
AIRSPEED, TANK = np.array([3.0, 3.0, -3.0]), np.array([10.0, 18.0, 2.0])


def test_a_forward_pass_by_hand():
    np.testing.assert_allclose(member_speeds(small(), AIRSPEED, TANK), BY_HAND[None], rtol=1e-6)
    assert (small().members, small().rotor_count) == (1, 2)


def test_mean_and_spread_of_two_members_by_hand():
    # Offsets of 0 and 2 standard units are 0 and 20 rpm: mean + 10, deviation 20/sqrt(2).
    both = stack_networks([small(), small(2.0)])
    assert both.members == 2
    mean, spread = ensemble_speed(both, AIRSPEED, TANK)
    np.testing.assert_allclose(mean - BY_HAND, np.tile([10.0, 0.0], (3, 1)), rtol=1e-4)
    np.testing.assert_allclose(spread, np.tile([20.0 / np.sqrt(2.0), 0.0], (3, 1)), rtol=1e-5)
    second = member_speeds(both, AIRSPEED, TANK)[1]
    np.testing.assert_allclose(second - BY_HAND, np.tile([20.0, 0.0], (3, 1)), rtol=1e-4)
    mean, spread = ensemble_speed(small(), AIRSPEED, TANK)
    np.testing.assert_allclose(mean, BY_HAND, rtol=1e-6)
    np.testing.assert_array_equal(spread, 0.0)


@pytest.mark.parametrize("rows", [0, 1, CHUNK_ROWS, CHUNK_ROWS + 1, 2 * CHUNK_ROWS + 3])
def test_long_flights_go_through_in_parts_with_the_same_answer(rows):
    airspeed, tank = np.linspace(0.0, 6.0, rows), np.linspace(16.0, 0.0, rows)
    speeds = member_speeds(small(), airspeed, tank)
    assert speeds.shape == (1, rows, 2)
    x = np.stack([(airspeed - 1.0) / 2.0, (tank - 2.0) / 4.0])
    units = np.maximum([x[0] + 0.5 * x[1], -x[0] + 2.0 * x[1] - 4.0], 0.0)
    np.testing.assert_allclose(
        speeds[0].T,
        [110.0 + 20.0 * units[0] + 10.0 * units[1], 950.0 + 150.0 * units[1]],
        rtol=1e-5,
    )


def test_stacking_keeps_every_member_and_field_in_order():
    both = stack_networks([small(1.0), stack_networks([small(2.0), small(3.0)])])
    for index in range(3):
        alone = small(index + 1.0)
        for f in fields(RotorNetwork):
            got, want = getattr(both, f.name), getattr(alone, f.name)
            layers = zip(got, want, strict=True) if isinstance(got, tuple) else [(got, want)]
            for a, b in layers:
                np.testing.assert_array_equal(a[index : index + 1], b)


def test_inputs_that_never_vary_are_not_divided_by_zero():
    inputs = np.column_stack([np.full(60, 3.0), np.linspace(0.0, 16.0, 60)])
    speeds = np.column_stack([1500.0 + inputs[:, 1], np.full(60, 1700.0)])
    rows = np.arange(60)
    config = NetConfig(hidden=(4,), max_epochs=1)
    network = fit_network(
        inputs, speeds, training=rows, validation=rows, config=config, seed=0
    ).network
    assert network.input_scale[0, 0] == 1.0
    assert network.output_scale[0, 1] == 1.0
    assert network.input_mean[0] == pytest.approx([3.0, 8.0])
    assert network.output_mean[0] == pytest.approx([1508.0, 1700.0])
    # Evenly spaced 0..16: the standard deviation of 60 points is 16 sqrt((60+1)/(12 x 59)).
    by_hand = 16.0 * np.sqrt(61.0 / (12.0 * 59.0))
    assert network.input_scale[0, 1] == pytest.approx(by_hand)
    assert network.output_scale[0, 0] == pytest.approx(by_hand)


def test_losses_are_mean_squares_in_standard_units_over_all_rows():
    """With a learning rate of 0 the weights stay, so both losses are those of the returned net."""
    rng = np.random.default_rng(4)
    inputs = np.column_stack([rng.uniform(0, 6, 90), rng.uniform(0, 16, 90)])
    speeds = 1500.0 + 30.0 * inputs + rng.normal(0, 5, (90, 2))
    training, validation = np.arange(70), np.arange(70, 90)
    config = NetConfig(hidden=(5,), max_epochs=2, batch_size=32, learning_rate=0.0)
    fit = fit_network(
        inputs, speeds, training=training, validation=validation, config=config, seed=1
    )
    for rows, losses in ((training, fit.training_loss), (validation, fit.validation_loss)):
        predicted = member_speeds(fit.network, inputs[rows, 0], inputs[rows, 1])[0]
        loss = np.mean(((predicted - speeds[rows]) / speeds[training].std(axis=0)) ** 2)
        np.testing.assert_allclose(losses, [loss, loss], rtol=1e-4)
    assert (fit.epochs, fit.best_epoch) == (2, 1)
