"""RotorModel: all that is known about one aircraft's rotor speeds, in one file.

A model is an airframe, a network with the envelope of its training and its interval, or no network,
and the effects that were identified on top. The file is safetensors: the weights as tensors, the
rest as JSON in its metadata, the airframe included, so that it needs no other file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.models.effects.base import Placed, look_of
from thrustmargin.models.effects.stored import EffectRecord, placed_from
from thrustmargin.models.errors import AirframeError, ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.json_values import from_json_values, to_json_values
from thrustmargin.models.network.conformal import Interval
from thrustmargin.models.network.ensemble import RotorNetwork, ensemble_speed
from thrustmargin.models.network.records import TrainingRecord
from thrustmargin.models.network.training_domain import Envelope
from thrustmargin.models.physics.airframe import Airframe, airframe_from_table, airframe_table
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio
from thrustmargin.models.physics.margin import weight
from thrustmargin.models.physics.thrust import speed_from_thrust
from thrustmargin.models.whole_file import whole_file

#: what the JSON in a model file says it is
SCHEMA = "thrustmargin.model/1"
METADATA_KEY = "thrustmargin"

#: arrays of RotorNetwork beside its layers
STANDARDISATION = ("input_mean", "input_scale", "output_mean", "output_scale")

#: fields of RotorModel that are kept as JSON, and what they are
JSON_FIELDS: dict[str, Any] = {
    "envelope": Envelope | None,
    "interval": Interval | None,
    "effects": tuple[EffectRecord, ...],
    "reference_density": float,
    "reference_voltage": float,
    "training": TrainingRecord | None,
    "forward_flight": ForwardFlight | None,
    "background_rpm": tuple[float, ...],
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorModel:
    """The rotor speed model of one aircraft; without a network it is weight and thrust curve."""

    airframe: Airframe
    network: RotorNetwork | None = None
    envelope: Envelope | None = None  # of the network
    interval: Interval | None = None  # of the network
    effects: tuple[EffectRecord, ...] = ()
    reference_density: float  # kg/m³, median of the training flights, else the airframe's
    reference_voltage: float  # V, likewise; NaN unknown
    training: TrainingRecord | None = None
    forward_flight: ForwardFlight | None = None  # carries the network on beyond known airspeeds
    background_rpm: tuple[float, ...] = ()  # spread of good flights' mean residual, by mode

    def __post_init__(self) -> None:
        if (self.network is None) != (self.envelope is None):
            raise ModelError("a network and the envelope of its training belong together")
        rotors = self.airframe.rotor_count
        if self.network is not None and self.network.rotor_count != rotors:
            raise ModelError(
                f"the network has {self.network.rotor_count} rotors, airframe "
                f"{self.airframe.name} has {rotors}"
            )
        if self.interval is not None and {len(self.interval.factor)} | {
            len(row) for row in self.interval.scatter_rpm
        } != {rotors}:
            raise ModelError(f"the interval is not of {rotors} rotors")
        placed_from(self.effects, rotors)
        if not self.reference_density > 0.0:
            raise ModelError(f"reference density {self.reference_density} must be above 0")

    def __repr__(self) -> str:
        effects = ", ".join(item.effect.key for item in self.placed) or "none"
        return f"RotorModel: {self.description}\n  effects: {effects}"

    @property
    def placed(self) -> tuple[Placed, ...]:
        """The identified effects, ready to compose."""
        return placed_from(self.effects, self.airframe.rotor_count)

    @property
    def look_back_s(self) -> float:
        """s before a row that its prediction looks at, in rows of 0.1 s; follows from effects."""
        return look_of(self.placed)[0]

    @property
    def look_ahead_s(self) -> float:
        """s after a row until which its prediction may still change."""
        return look_of(self.placed)[1]

    @property
    def thrust_coefficient(self) -> float:
        """N/rpm² of a free rotor in air of the model's reference density (Eq. 1 and 4)."""
        airframe = self.airframe
        return airframe.thrust_coefficient * self.reference_density / airframe.reference_density

    @property
    def description(self) -> str:
        """The model in words for people."""
        if self.envelope is None or self.network is None:
            return f"weight and thrust curve of {self.airframe.title}, no network"
        trained = f", trained {self.training.date}" if self.training else ""
        return (
            f"network of {self.network.members} members for {self.airframe.title} from "
            f"{len(self.envelope.flights)} flights{trained}"
        )

    def base_speed(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """(N, R) rpm for airspeeds (N,) m/s and tank masses (N,) kg, in reference air.

        The network where its training covers airspeed and tank, else weight and thrust curve; no
        effect is applied. NaN where an input is.
        """
        speeds = hover_speed(self.airframe, tank_kg, np.full(tank_kg.shape, self.reference_density))
        speeds[~np.isfinite(airspeed)] = np.nan
        if self.network is not None and self.envelope is not None:
            inside = self.envelope.covers_inputs(airspeed, tank_kg)
            speeds[inside] = ensemble_speed(self.network, airspeed[inside], tank_kg[inside])[0]
        return speeds

    def held_speed(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """(N, R) rpm like `base_speed`, without its jump at the edge of the training.

        Beyond what the network knows it is held at its edge, and carried on from there by physics:
        the weight, and drag and lift of forward flight, so that an effect fitted on top sees no
        step of the model's own.
        """
        if self.network is None or self.envelope is None:
            return self.base_speed(airspeed, tank_kg)
        near = np.clip(tank_kg, *self.envelope.tank_kg)
        slow = np.clip(airspeed, self.envelope.airspeed[0], self.known_airspeed)
        ratio = weight(self.airframe, tank_kg) / weight(self.airframe, near)
        if self.forward_flight is not None:
            ratio = ratio * self._forward(airspeed, tank_kg) / self._forward(slow, near)
        return self.base_speed(slow, near) * np.sqrt(ratio)[:, None]

    @property
    def known_airspeed(self) -> float:
        """m/s, up to which the network itself is asked in `held_speed`."""
        if self.envelope is None:
            return float("nan")
        top = self.envelope.airspeed[1]
        return top if self.forward_flight is None else min(self.forward_flight.known_airspeed, top)

    def _forward(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        assert self.forward_flight is not None
        mass = self.airframe.empty_mass + tank_kg
        return thrust_ratio(
            self.forward_flight, airspeed, mass, self.reference_density, self.airframe
        )

    def base_apparent_thrust(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """(N, R) N: a0 N² of `base_speed`, with a0 at the model's reference density."""
        return self.thrust_coefficient * self.base_speed(airspeed, tank_kg) ** 2


def hover_speed(airframe: Airframe, tank_kg: Floats, density: Floats) -> Floats:
    """(N, R) rpm at which the rotors carry the weight in hover, in air of `density` (N,) kg/m³.

    All rotors turn alike, so each carries a share of the weight by its effectiveness; Eq. 4.
    """
    speed = speed_from_thrust(
        weight(airframe, tank_kg) / airframe.rotor_effectiveness.sum(),
        coefficient=airframe.thrust_coefficient,
        density=density,
        reference_density=airframe.reference_density,
    )
    return np.repeat(speed[:, None], airframe.rotor_count, axis=1)


def physics_model(airframe: Airframe) -> RotorModel:
    """The model with no network: weight and thrust curve of the airframe."""
    return RotorModel(
        airframe=airframe,
        reference_density=airframe.reference_density,
        reference_voltage=airframe.nominal_voltage,
    )


def shipped_model() -> RotorModel:
    """The model that comes with the package, of the simulated F16; ModelError if it is damaged."""
    shipped = resources.files("thrustmargin.models.shipped")
    with resources.as_file(shipped / "default.safetensors") as path:
        return load_model(path)


def save_model(model: RotorModel, path: Path) -> None:
    """Write a model file; an older file of that name is replaced in one step or stays whole.

    Raises ModelError when the file cannot be written.
    """
    from safetensors.numpy import save

    content = save(_tensors(model.network), metadata={METADATA_KEY: json.dumps(_metadata(model))})
    try:
        with whole_file(path) as draft:
            draft.write_bytes(content)
    except OSError as error:
        raise ModelError(f"cannot write the model file {path}: {error.strerror}") from error


def load_model(path: str | Path | None = None) -> RotorModel:
    """Read a model file; without a path the one that ships, of the simulated F16.

    Raises ModelError when it is missing, damaged or of another kind.

        >>> load_model().airframe.name
        'topxgun-f16-sitl'
    """
    from safetensors import SafetensorError, safe_open

    if path is None:
        return shipped_model()
    path = Path(path)
    try:
        with safe_open(str(path), framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise _unreadable(path, error) from error
    try:
        return _model(json.loads(metadata.get(METADATA_KEY, "null")), tensors)
    except (ModelError, AirframeError, ValueError, RecursionError) as error:
        raise ModelError(
            f"model file {path}: {error}; train a new one with: thrustmargin train"
        ) from error


def _unreadable(path: Path, error: Exception) -> ModelError:
    if not path.exists():
        return ModelError(f"no model file {path}; make one with: thrustmargin train LOG...")
    if path.is_dir():
        return ModelError(f"{path} is a folder; give the .safetensors file in it")
    return ModelError(f"{path} is not a whole model file ({error}); give another --model")


def _tensors(network: RotorNetwork | None) -> dict[str, np.ndarray]:
    if network is None:
        return {}
    layers = {
        f"layer{index}.{kind}": array
        for index, pair in enumerate(zip(network.weights, network.biases, strict=True))
        for kind, array in zip(("weight", "bias"), pair, strict=True)
    }
    return layers | {name: getattr(network, name) for name in STANDARDISATION}


def _network(tensors: dict[str, np.ndarray]) -> RotorNetwork | None:
    if not tensors:
        return None
    depth = sum(name.endswith(".weight") for name in tensors)
    layers = [f"layer{i}.{kind}" for i in range(depth) for kind in ("weight", "bias")]
    if tensors.keys() != {*layers, *STANDARDISATION}:
        wrong = sorted(tensors.keys() ^ {*layers, *STANDARDISATION})[0]
        raise ModelError(f"tensor {wrong!r} is missing or too many")
    for name, array in tensors.items():
        want = np.float64 if name in STANDARDISATION else np.float32
        if array.dtype != want:
            raise ModelError(f"tensor {name!r} is {array.dtype}, not {np.dtype(want)}")
    return RotorNetwork(
        weights=tuple(tensors[f"layer{i}.weight"] for i in range(depth)),
        biases=tuple(tensors[f"layer{i}.bias"] for i in range(depth)),
        **{name: tensors[name] for name in STANDARDISATION},
    )


def _metadata(model: RotorModel) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "airframe": airframe_table(model.airframe),
        **{name: to_json_values(getattr(model, name)) for name in JSON_FIELDS},
    }


def _model(data: Any, tensors: dict[str, np.ndarray]) -> RotorModel:
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise ModelError(f"its schema is {schema!r}, this version reads {SCHEMA!r}")
    data = {"forward_flight": None, **data}
    missing = sorted({"airframe", *JSON_FIELDS} - data.keys())
    if missing or not isinstance(data["airframe"], dict):
        raise ModelError(f"its metadata lacks {(missing or ['airframe'])[0]!r}")
    return RotorModel(
        airframe=airframe_from_table(data["airframe"], "the airframe in it"),
        network=_network(tensors),
        **{name: from_json_values(kind, data[name], name) for name, kind in JSON_FIELDS.items()},
    )
