"""Evaluate trained networks in plain numpy, M members as one batch of matrices.

    N = f(V, m):  V airspeed [m/s], m liquid in the tank [kg]  ->  N_1..N_R rotor speeds [rpm]

Results equal torch's to float32; `network` trains the weights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats

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

    @property
    def hidden(self) -> tuple[int, ...]:
        """Return the units of each hidden layer."""
        return tuple(w.shape[2] for w in self.weights[:-1])

    def member(self, index: int) -> RotorNetwork:
        """Return one of the networks, by its index from 0, as an ensemble of one."""
        return _combine(lambda arrays: arrays[0][index : index + 1], self)


def stack_networks(networks: Sequence[RotorNetwork]) -> RotorNetwork:
    """Combine the members of all given networks into one ensemble, in order."""
    return _combine(np.concatenate, *networks)


def _combine(
    make: Callable[[Sequence[np.ndarray]], np.ndarray], *networks: RotorNetwork
) -> RotorNetwork:
    """Apply `make` to the corresponding arrays of all networks, and return the network of the
    results."""

    def combine_field(name: str) -> Any:
        """Apply `make` to one array of all networks."""
        arrays = [getattr(network, name) for network in networks]
        if isinstance(arrays[0], tuple):
            return tuple(make(layer) for layer in zip(*arrays, strict=True))
        return make(arrays)

    return RotorNetwork(**{f.name: combine_field(f.name) for f in fields(RotorNetwork)})


def member_speeds(network: RotorNetwork, airspeed: Floats, tank_kg: Floats) -> Floats:
    """Return the rotor speeds (M, N, R) rpm that each member predicts for N rows of airspeed and
    tank."""
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
