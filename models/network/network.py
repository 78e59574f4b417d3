"""Define and fit the rotor speed network of the paper, for any number of rotors.

    N = f(V, m):  V airspeed [m/s], m liquid in the tank [kg]  ->  N_1..N_R rotor speeds [rpm]

Fully connected, 117 / 103 / 76 hidden units, ReLU, linear output; AdamW, learning rate 0.0006,
early stopping with patience 30 and delta 0.001 on the validation loss (Han et al., Drones 2024, 8,
246). The loss is the mean square of standardised rotor speeds, so that loss is about 1 - R². The
paper does not print the batch size, the weight decay, the initialisation and the largest number of
epochs: here 256, 0.01, PyTorch's own and 1000.

Fitting needs torch, which is imported inside functions because that takes seconds; prediction is
plain numpy, in `ensemble`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import DataError, require
from thrustmargin.models.flight import Floats
from thrustmargin.models.network.ensemble import Float32s, RotorNetwork

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class NetConfig:
    """The settings of the network and of its training; the fit does not change them."""

    hidden: tuple[int, ...] = (117, 103, 76)
    learning_rate: float = 6e-4
    weight_decay: float = 0.01
    batch_size: int = 256
    patience: int = 30  # epochs without a better validation loss
    delta: float = 0.001  # a loss counts as better when it is lower by more than this
    max_epochs: int = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class EarlyStopping:
    """The state of early stopping: stop if the loss has not fallen by more than `delta` for
    `patience` epochs."""

    patience: int
    delta: float
    best: float = float("inf")
    waited: int = 0

    def next_epoch(self, loss: float) -> EarlyStopping:
        """Return the state after one more epoch with this validation loss."""
        if loss < self.best - self.delta:
            return replace(self, best=loss, waited=0)
        return replace(self, waited=self.waited + 1)

    @property
    def stop(self) -> bool:
        """Return whether training should stop."""
        return self.waited >= self.patience


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NetworkFit:
    """The result of one fit: the network at its lowest validation loss, and the loss of each
    epoch."""

    network: RotorNetwork  # one member
    training_loss: Floats  # (E,) mean over the batches of each epoch
    validation_loss: Floats  # (E,) after each epoch

    @property
    def epochs(self) -> int:
        """Return the number of epochs until early stopping."""
        return self.validation_loss.size

    @property
    def best_epoch(self) -> int:
        """Return the epoch of the lowest validation loss, counted from 1."""
        return int(np.argmin(self.validation_loss)) + 1

    @property
    def lowest_loss(self) -> float:
        """Return the lowest validation loss."""
        return float(np.min(self.validation_loss))


#: called after each epoch with its number from 1 and its validation loss.
OnEpoch = Callable[[int, float], None]


def fit_network(
    inputs: Floats,
    rotor_speed_rpm: Floats,
    *,
    training: Rows,
    validation: Rows,
    config: NetConfig,
    seed: int,
    on_epoch: OnEpoch | None = None,
) -> NetworkFit:
    """Fit one network to the rows `training`, stopped early on the rows `validation`.

    inputs (N, 2): airspeed m/s and tank kg; rotor_speed_rpm (N, R); both finite. The same seed,
    data and settings give the same weights: one thread, and torch's global state is restored.
    Raises DataError when either set of rows is empty or the inputs are not finite.
    """
    if training.size == 0 or validation.size == 0:
        raise DataError(
            f"{training.size} training and {validation.size} validation rows; give longer flights"
        )
    if not (np.all(np.isfinite(inputs)) and np.all(np.isfinite(rotor_speed_rpm))):
        raise DataError("rows with a missing airspeed, tank or rotor speed cannot be fitted")
    require("train", "torch")
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return _fit(inputs, rotor_speed_rpm, training, validation, config, on_epoch)
    finally:
        torch.set_num_threads(threads)


def _scale(rows: Floats) -> Floats:
    """Return the standard deviation of each column; 1 where a column is constant, for safe
    division."""
    scale = rows.std(axis=0)
    return np.where(scale > 1e-9, scale, 1.0)


def _fit(
    inputs: Floats,
    rotor_speed_rpm: Floats,
    training: Rows,
    validation: Rows,
    config: NetConfig,
    on_epoch: OnEpoch | None,
) -> NetworkFit:
    """Fit one network with torch, seeded by the caller."""
    import torch

    input_mean, input_scale = inputs[training].mean(axis=0), _scale(inputs[training])
    output_mean, output_scale = (
        rotor_speed_rpm[training].mean(axis=0),
        _scale(rotor_speed_rpm[training]),
    )

    def standard(rows: Rows) -> tuple[Any, Any]:
        """Return standardised inputs and outputs of some rows as tensors."""
        x = (inputs[rows] - input_mean) / input_scale
        y = (rotor_speed_rpm[rows] - output_mean) / output_scale
        return torch.from_numpy(x.astype(np.float32)), torch.from_numpy(y.astype(np.float32))

    x, y = standard(training)
    x_validation, y_validation = standard(validation)
    net = build_torch_network(rotor_speed_rpm.shape[1], config)
    optimiser = torch.optim.AdamW(
        net.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
    )
    stopping = EarlyStopping(patience=config.patience, delta=config.delta)
    training_loss: list[float] = []
    validation_loss: list[float] = []
    best = _copy_weights(net)
    while not stopping.stop and len(validation_loss) < config.max_epochs:
        total = torch.zeros(())
        for batch in torch.randperm(training.size).split(config.batch_size):
            optimiser.zero_grad()
            loss = torch.nn.functional.mse_loss(net(x[batch]), y[batch])
            loss.backward()
            optimiser.step()
            total += loss.detach() * batch.numel()
        with torch.no_grad():
            now = float(torch.nn.functional.mse_loss(net(x_validation), y_validation))
        if not validation_loss or now < min(validation_loss):
            best = _copy_weights(net)
        training_loss.append(float(total) / training.size)
        validation_loss.append(now)
        stopping = stopping.next_epoch(now)
        if on_epoch is not None:
            on_epoch(len(validation_loss), now)
    network = RotorNetwork(
        weights=best[0],
        biases=best[1],
        input_mean=input_mean[None],
        input_scale=input_scale[None],
        output_mean=output_mean[None],
        output_scale=output_scale[None],
    )
    return NetworkFit(
        network=network,
        training_loss=np.array(training_loss),
        validation_loss=np.array(validation_loss),
    )


def build_torch_network(rotor_count: int, config: NetConfig) -> Any:
    """Build the untrained `torch.nn.Sequential`: 2 inputs, the hidden layers with ReLU, R
    outputs."""
    import torch

    layers: list[Any] = []
    width = 2
    for units in config.hidden:
        layers += [torch.nn.Linear(width, units), torch.nn.ReLU()]
        width = units
    return torch.nn.Sequential(*layers, torch.nn.Linear(width, rotor_count))


def _copy_weights(net: Any) -> tuple[tuple[Float32s, ...], tuple[Float32s, ...]]:
    """Copy the weights (1, in, out) and biases (1, out) of a torch network."""
    linear = [layer for layer in net if hasattr(layer, "weight")]
    weights = tuple(np.ascontiguousarray(m.weight.detach().numpy().T)[None].copy() for m in linear)
    biases = tuple(m.bias.detach().numpy()[None].copy() for m in linear)
    return weights, biases
