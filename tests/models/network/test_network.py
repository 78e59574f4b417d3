"""The network: the paper's shape, early stopping as it says, numpy and torch with one answer."""

import numpy as np
import pytest

from thrustmargin.models.errors import DataError, ModelError
from thrustmargin.models.network.network import (
    EarlyStopping,
    NetConfig,
    RotorNetwork,
    build_torch_network,
    ensemble_speed,
    fit_network,
    member_speeds,
    stack_networks,
)

#: As the code has them, written down by hand: a change there is to be seen here.
CHUNK_ROWS = 4096

QUICK = NetConfig(max_epochs=3, batch_size=64)


def flights_like_rows(rows=600, rotors=4, seed=0):
    """Inputs (N, 2) and rotor speeds (N, R) that follow the weight, with a little noise."""
    rng = np.random.default_rng(seed)
    inputs = np.stack([rng.uniform(0, 6, rows), rng.uniform(0, 16, rows)], axis=1)
    speed = np.sqrt((21.1 + inputs[:, 1]) * 9.80665 / rotors / 2.011e-5) - 10.0 * inputs[:, 0]
    noise = rng.normal(0.0, 8.0, (rows, rotors))
    return inputs, speed[:, None] + noise + 3.0 * np.arange(rotors)


def quick_fit(rotors=4, seed=0, config=QUICK, **given):
    inputs, speeds = flights_like_rows(rotors=rotors)
    rows = np.arange(len(inputs))
    return fit_network(
        inputs,
        speeds,
        training=rows[:400],
        validation=rows[400:],
        config=config,
        seed=seed,
        **given,
    )


@pytest.mark.parametrize("rotors", [3, 4, 6, 8])
def test_the_network_has_the_papers_layers_for_any_number_of_rotors(rotors):
    network = quick_fit(rotors).network
    assert [w.shape[2] for w in network.weights[:-1]] == [117, 103, 76]
    assert [w.shape for w in network.weights] == [
        (1, 2, 117),
        (1, 117, 103),
        (1, 103, 76),
        (1, 76, rotors),
    ]
    assert {a.dtype for a in (*network.weights, *network.biases)} == {np.dtype(np.float32)}
    assert network.rotor_count == rotors


def test_settings_are_the_papers():
    config = NetConfig()
    assert (config.learning_rate, config.patience, config.delta) == (0.0006, 30, 0.001)


def test_numpy_and_torch_give_the_same_rotor_speeds():
    import torch

    network = quick_fit().network
    net = build_torch_network(4, NetConfig())
    linear = [layer for layer in net if hasattr(layer, "weight")]
    with torch.no_grad():
        for layer, weight, bias in zip(linear, network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weight[0].T.copy()))
            layer.bias.copy_(torch.from_numpy(bias[0]))
    rng = np.random.default_rng(1)
    inputs = np.stack([rng.uniform(0, 9, 5000), rng.uniform(0, 16, 5000)], axis=1)
    standard = (inputs - network.input_mean[0]) / network.input_scale[0]
    with torch.no_grad():
        out = net(torch.from_numpy(standard.astype(np.float32))).numpy()
    by_torch = out * network.output_scale[0] + network.output_mean[0]
    by_numpy = member_speeds(network, inputs[:, 0], inputs[:, 1])[0]
    np.testing.assert_allclose(by_numpy, by_torch, rtol=1e-5)


def test_a_batch_gives_what_single_rows_give_across_the_chunks():
    network = stack_networks([quick_fit(seed=s).network for s in (0, 1)])
    rng = np.random.default_rng(2)
    airspeed, tank = rng.uniform(0, 6, CHUNK_ROWS + 7), rng.uniform(0, 16, CHUNK_ROWS + 7)
    batch, spread = ensemble_speed(network, airspeed, tank)
    for row in (0, 5, CHUNK_ROWS - 1, CHUNK_ROWS, CHUNK_ROWS + 6):
        one, one_spread = ensemble_speed(network, airspeed[row : row + 1], tank[row : row + 1])
        np.testing.assert_allclose(batch[row], one[0], rtol=1e-5)
        np.testing.assert_allclose(spread[row], one_spread[0], rtol=1e-2, atol=1e-2)


def test_the_ensemble_is_the_mean_of_its_members_and_their_sample_deviation():
    networks = [quick_fit(seed=s).network for s in (0, 1, 2)]
    stacked = stack_networks(networks)
    airspeed, tank = np.array([1.0, 5.0]), np.array([3.0, 12.0])
    each = np.stack([member_speeds(n, airspeed, tank)[0] for n in networks])
    mean, spread = ensemble_speed(stacked, airspeed, tank)
    np.testing.assert_allclose(mean, each.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(spread, each.std(axis=0, ddof=1), rtol=1e-3)
    assert np.all(spread > 0)
    np.testing.assert_array_equal(member_speeds(stacked, airspeed, tank)[1], each[1])
    assert np.all(ensemble_speed(networks[1], airspeed, tank)[1] == 0.0)


def stopped_after(losses, patience, delta):
    """Number of losses after which early stopping ends a training."""
    state = EarlyStopping(patience=patience, delta=delta)
    for epoch, loss in enumerate(losses, 1):
        state = state.next_epoch(loss)
        if state.stop:
            return epoch
    return None


def test_early_stopping_waits_patience_epochs_after_the_last_fall_by_more_than_delta():
    falling = [1.0, 0.5, 0.25]
    assert stopped_after(falling + [0.25] * 40, patience=30, delta=0.001) == 3 + 30
    creeping = [0.25 - 0.00002 * k for k in range(40)]  # 0.0008 in all: never counts
    assert stopped_after(falling + creeping, patience=30, delta=0.001) == 3 + 30
    late = [0.25] * 29 + [0.2489] + [0.2489] * 40  # 0.0011 lower on the 29th: starts over
    assert stopped_after(falling + late, patience=30, delta=0.001) == 3 + 30 + 30
    exact = [1.0, 0.5, 0.5]  # a fall by exactly delta does not count
    assert stopped_after(exact, patience=2, delta=0.5) == 3
    assert stopped_after([1.0 / (k + 1) for k in range(20)], patience=3, delta=0.001) is None


def test_a_fit_stops_by_that_law_and_keeps_the_weights_of_its_lowest_loss():
    config = NetConfig(patience=12, delta=0.02, max_epochs=200, batch_size=16, learning_rate=0.01)
    seen = []
    fit = quick_fit(config=config, on_epoch=lambda epoch, loss: seen.append((epoch, loss)))
    assert fit.epochs == stopped_after(fit.validation_loss, patience=12, delta=0.02)
    assert [loss for _, loss in seen] == list(fit.validation_loss)
    assert [epoch for epoch, _ in seen] == list(range(1, fit.epochs + 1))
    inputs, speeds = flights_like_rows()
    predicted = member_speeds(fit.network, inputs[400:, 0], inputs[400:, 1])[0]
    loss = np.mean(((predicted - speeds[400:]) / fit.network.output_scale[0]) ** 2)
    assert loss == pytest.approx(fit.lowest_loss, rel=1e-4)
    assert fit.best_epoch < fit.epochs  # so the last weights are not those
    assert fit.lowest_loss == min(fit.validation_loss)
    assert fit.validation_loss[fit.best_epoch - 1] == fit.lowest_loss


def test_it_learns_a_known_law_to_the_noise():
    config = NetConfig(max_epochs=150, batch_size=32)
    fit = quick_fit(config=config)
    inputs, speeds = flights_like_rows(seed=9)
    predicted = member_speeds(fit.network, inputs[:, 0], inputs[:, 1])[0]
    error = np.sqrt(np.mean((predicted - speeds) ** 2))
    assert error < 11.0  # the noise is 8 rpm


def test_the_same_seed_gives_the_same_weights_and_leaves_torch_as_it_was():
    import torch

    torch.manual_seed(123)
    before = torch.get_rng_state()
    threads = torch.get_num_threads()
    first, again, other = (quick_fit(seed=s).network for s in (5, 5, 6))
    assert torch.equal(before, torch.get_rng_state())
    assert torch.get_num_threads() == threads
    for a, b, c in zip(first.weights, again.weights, other.weights, strict=True):
        np.testing.assert_array_equal(a, b)
        assert not np.array_equal(a, c)


def test_missing_inputs_and_empty_sets_are_refused():
    inputs, speeds = flights_like_rows(rows=20)
    rows, none = np.arange(20), np.arange(0)
    with pytest.raises(DataError, match="0 validation rows"):
        fit_network(inputs, speeds, training=rows, validation=none, config=QUICK, seed=0)
    with pytest.raises(DataError, match="0 training and 20 validation rows"):
        fit_network(inputs, speeds, training=none, validation=rows, config=QUICK, seed=0)
    inputs[3, 1] = np.nan
    with pytest.raises(DataError, match="missing airspeed, tank or rotor speed"):
        fit_network(inputs, speeds, training=rows, validation=rows, config=QUICK, seed=0)


def test_shapes_that_do_not_fit_together_are_refused():
    network = quick_fit().network
    parts = {
        "weights": network.weights,
        "biases": network.biases,
        "input_mean": network.input_mean,
        "input_scale": network.input_scale,
        "output_mean": network.output_mean,
        "output_scale": network.output_scale,
    }
    RotorNetwork(**parts)
    for broken, message in (
        ({"weights": network.weights[:3]}, "3 layers"),
        ({"weights": (*network.weights[:1], *network.weights[2:], network.weights[1])}, "layer 2"),
        ({"biases": (network.biases[0][:, :5], *network.biases[1:])}, "layer 1 has biases"),
        ({"biases": (np.zeros((9, 9)), *network.biases[1:])}, "layer 1 has biases"),
        ({"output_mean": network.output_mean[:, :3]}, "output_mean"),
        ({"input_mean": network.input_mean[0]}, "input_mean"),
        ({"input_scale": 0.0 * network.input_scale}, "not positive"),
        ({"output_mean": np.nan * network.output_mean}, "not finite"),
    ):
        with pytest.raises(ModelError, match=message):
            RotorNetwork(**{**parts, **broken})
