"""Define and fit the rotor speed network of the paper, for any number of rotors.

    N = f(V, m):  V airspeed [m/s], m liquid in the tank [kg]  ->  N_1..N_R rotor speeds [rpm]

Fully connected, 117 / 103 / 76 hidden units, ReLU, linear output; AdamW, learning rate 0.0006,
early stopping with patience 30 and delta 0.001 on the validation loss (Han et al., Drones 2024, 8,
246). The loss is the mean square of standardised rotor speeds, so that loss is about 1 - R². The
paper does not print the batch size, the weight decay, the initialisation and the largest number of
epochs: here 256, 0.01, PyTorch's own and 1000.

Fitting needs torch, which is imported inside functions because that takes seconds; prediction is
numpy, M members as one batch of matrices. Results equal torch's to float32.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import DataError, ModelError, require
from thrustmargin.models.flight import Floats

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
        """Return True if `patience` epochs passed without a better validation error."""
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
    """Fit one network to the rows `training`, stopped early on the rows `validation` (row indices).

    `inputs` (N, 2) are airspeed, m/s, and tank, kg; `rotor_speed_rpm` is (N, R); both finite. The
    same seed, data and settings give the same weights: one thread, and torch's global state is
    restored. `on_epoch` is called after each epoch. Raise DataError when either set of rows is
    empty or a value is not finite.
    """
    if training.size == 0 or validation.size == 0:
        raise DataError(
            f"{training.size} training and {validation.size} validation rows; give longer flights"
        )
    if not (np.all(np.isfinite(inputs)) and np.all(np.isfinite(rotor_speed_rpm))):
        raise DataError("rows with a missing airspeed, tank or rotor speed cannot be fitted")
    require("train", "torch")
    with _interrupt_deferred():
        import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return _fit(inputs, rotor_speed_rpm, training, validation, config, on_epoch)
    finally:
        torch.set_num_threads(threads)


@contextmanager
def _interrupt_deferred() -> Iterator[None]:
    """Defer a Ctrl-C until the block has ended.

    An exception in the midst of loading torch's libraries aborts the process without a message.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread alone
        return
    caught: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if caught:
        signal.raise_signal(signal.SIGINT)


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
    """Fit one network with torch, whose random generator the caller has seeded.

    `inputs` (T, k) and `rotor_speed_rpm` (T, R) are standardised by the training rows; `training`
    and `validation` are row indices. `on_epoch`, if not None, is called with the epoch's number,
    from 1, and validation loss. Training stops early by the patience of `config`. The weights are
    those of the epoch with the least validation loss.
    """
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


Float32s = NDArray[np.float32]

#: rows that go through the layers at once; bounds the memory of long flights.
CHUNK_ROWS = 4096


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorNetwork:
    """M networks of one shape with their standardisation: inputs (V, m), outputs R rotors.

    Raises ModelError when shapes do not match or a number is not finite.
    """

    weights: tuple[Float32s, ...]  # each (M, units in, units out)
    biases: tuple[Float32s, ...]  # each (M, units out)
    input_mean: Floats  # (M, 2) m/s, kg
    input_scale: Floats  # (M, 2)
    output_mean: Floats  # (M, R) rpm
    output_scale: Floats  # (M, R)

    def __post_init__(self) -> None:
        if self.input_mean.ndim != 2:
            raise ModelError(f"input_mean has shape {self.input_mean.shape}; needs (members, 2)")
        members, width = self.input_mean.shape
        if width != 2 or not self.weights or len(self.weights) != len(self.biases):
            raise ModelError(f"network of {len(self.weights)} layers and {width} inputs; needs 2")
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True), 1):
            if weight.ndim != 3 or weight.shape[:2] != (members, width):
                raise ModelError(
                    f"layer {layer} has weights {weight.shape}; needs ({members}, {width}, units)"
                )
            width = weight.shape[2]
            if bias.shape != (members, width):
                raise ModelError(f"layer {layer} has biases {bias.shape}; needs {members, width}")
        for name in ("output_mean", "output_scale", "input_scale"):
            want = (members, 2 if name == "input_scale" else width)
            if getattr(self, name).shape != want:
                raise ModelError(f"{name} has shape {getattr(self, name).shape}; needs {want}")
        for array in (*self.weights, *self.biases, *self._standardisation()):
            if not np.all(np.isfinite(array)):
                raise ModelError("the network has weights that are not finite numbers")
        if np.any(self.input_scale <= 0) or np.any(self.output_scale <= 0):
            raise ModelError("the network has a standardisation scale that is not positive")

    def _standardisation(self) -> tuple[Floats, ...]:
        """Return the arrays that standardise inputs and outputs."""
        return self.input_mean, self.input_scale, self.output_mean, self.output_scale

    @property
    def members(self) -> int:
        """Return the number of networks, M."""
        return self.input_mean.shape[0]

    @property
    def rotor_count(self) -> int:
        """Return the number of rotors, R."""
        return self.output_mean.shape[1]


def stack_networks(networks: Sequence[RotorNetwork]) -> RotorNetwork:
    """Combine the members of `networks`, in order, into one ensemble."""
    return _combine(np.concatenate, *networks)


def _combine(
    make: Callable[[Sequence[np.ndarray]], np.ndarray], *networks: RotorNetwork
) -> RotorNetwork:
    """Return a network each of whose arrays is `make` of the corresponding arrays of all
    `networks`.
    """

    def combine_field(name: str) -> Any:
        """Apply `make` to the arrays (or tuples of arrays) named `name` of all networks."""
        arrays = [getattr(network, name) for network in networks]
        if isinstance(arrays[0], tuple):
            return tuple(make(layer) for layer in zip(*arrays, strict=True))
        return make(arrays)

    return RotorNetwork(**{f.name: combine_field(f.name) for f in fields(RotorNetwork)})


def member_speeds(network: RotorNetwork, airspeed: Floats, tank_kg: Floats) -> Floats:
    """Return the rotor speeds (M, N, R), rpm, that each of M members predicts for N rows.

    `airspeed` (N,) is in m/s, `tank_kg` (N,) in kg.
    """
    inputs = np.stack(
        [np.asarray(airspeed, dtype=np.float64), np.asarray(tank_kg, dtype=np.float64)], axis=-1
    )
    out = np.empty((network.members, len(inputs), network.rotor_count))
    for start in range(0, len(inputs), CHUNK_ROWS):
        part = slice(start, start + CHUNK_ROWS)
        out[:, part] = _forward(network, inputs[part])
    return out


def _forward(network: RotorNetwork, inputs: Floats) -> Floats:
    """Return the rotor speeds (M, N, R) rpm for inputs (N, 2); the layers are in float32 as in
    training."""
    hidden = (inputs - network.input_mean[:, None]) / network.input_scale[:, None]
    hidden = hidden.astype(np.float32)
    last = len(network.weights) - 1
    for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        hidden = hidden @ weight
        hidden += bias[:, None]
        if layer < last:
            np.maximum(hidden, 0.0, out=hidden)
    return hidden * network.output_scale[:, None] + network.output_mean[:, None]


def ensemble_speed(
    network: RotorNetwork, airspeed: Floats, tank_kg: Floats
) -> tuple[Floats, Floats]:
    """Return mean and spread of the members: two (N, R) arrays in rpm for N rows.

    The spread is the sample standard deviation over members, the model's own uncertainty of its
    mean function; 0 for a single member. It does not include the scatter of the rotors themselves.
    """
    speeds = member_speeds(network, airspeed, tank_kg)
    if network.members == 1:
        return speeds[0], np.zeros_like(speeds[0])
    return speeds.mean(axis=0), speeds.std(axis=0, ddof=1)
