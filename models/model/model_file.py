"""Read and write model files: one safetensors file for all that is known of an aircraft's rotors.

The network's weights are tensors; the rest, the airframe included, is JSON in the metadata, so that
a model needs no other file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.instruments import Thermometer
from thrustmargin.models.effects.compose import EffectRecord
from thrustmargin.models.errors import AirframeError, ModelError
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.model.mode_walk import ModeState
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.network import RotorNetwork
from thrustmargin.models.network.records import GoodFlights, TrainingRecord
from thrustmargin.models.network.validity import Interval, TrainingDomain
from thrustmargin.models.physics.airframe import airframe_from_table, airframe_table
from thrustmargin.models.physics.electric_power import PowerLaw
from thrustmargin.models.physics.forward_flight import ForwardFlight
from thrustmargin.models.whole_file import regular, whole_file

#: schema name in the JSON of a model file
SCHEMA = "thrustmargin.model/1"
METADATA_KEY = "thrustmargin"
#: metadata key of the content's digest, which files of earlier versions lack
DIGEST_KEY = "thrustmargin.sha256"

#: arrays of RotorNetwork other than its layers
STANDARDISATION = ("input_mean", "input_scale", "output_mean", "output_scale")

#: Raised by numpy and safetensors for types and shapes that numpy does not support.
OTHER_TENSORS = (TypeError, ValueError, LookupError, AttributeError, OverflowError)

#: fields of RotorModel that are stored as JSON: key in the file, field, type
JSON_FIELDS: tuple[tuple[str, str, Any], ...] = (
    ("envelope", "training_domain", TrainingDomain | None),
    ("interval", "interval", Interval | None),
    ("effects", "effects", tuple[EffectRecord, ...]),
    ("reference_density", "reference_density", float),
    ("reference_voltage", "reference_voltage", float),
    ("training", "training", TrainingRecord | None),
    ("forward_flight", "forward_flight", ForwardFlight | None),
    ("background_rpm", "background_rpm", tuple[float, ...]),
    ("good_flights", "good_flights", GoodFlights | None),
    ("thermometer", "thermometer", Thermometer | None),
)


def shipped_model() -> RotorModel:
    """Load the model that ships with the package, of the simulated F16. Raises ModelError if it
    is damaged."""
    shipped = resources.files("thrustmargin.models.shipped")
    with resources.as_file(shipped / "default.safetensors") as path:
        return load_model(path)


def model_bytes(model: RotorModel) -> bytes:
    """Return the content of a model file without its digest."""
    from safetensors.numpy import save

    return save(_tensors(model.network), metadata={METADATA_KEY: json.dumps(_metadata(model))})


def _content_digest(text: str, tensors: Mapping[str, np.ndarray]) -> str:
    """Return SHA-256 of the JSON and of every tensor's name, type, shape and numbers."""
    digest = sha256(text.encode())
    for name, array in sorted(tensors.items()):
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def model_digest(model: RotorModel) -> str:
    """Return 16 hexadecimal digits that identify a model."""
    return sha256(model_bytes(model)).hexdigest()[:16]


def save_model(model: RotorModel, path: Path) -> None:
    """Write a model file, replacing an older one atomically.

    Raises ModelError when the file cannot be written; the older file is then unchanged.
    """
    from safetensors.numpy import save

    text, tensors = json.dumps(_metadata(model)), _tensors(model.network)
    metadata = {METADATA_KEY: text, DIGEST_KEY: _content_digest(text, tensors)}
    content = save(tensors, metadata=metadata)
    try:
        with whole_file(path) as draft:
            draft.write_bytes(content)
    except OSError as error:
        raise ModelError(f"cannot write the model file {path}: {error.strerror}") from error


def load_model(path: str | Path | None = None) -> RotorModel:
    """Load a model file; without a path the shipped one, of the simulated F16.

    Raises ModelError when it is missing, damaged or of another schema.

        >>> load_model().airframe.name
        'topxgun-f16-sitl'
    """
    from safetensors import SafetensorError, safe_open

    if path is None:
        return shipped_model()
    path = Path(path)
    try:
        with safe_open(str(regular(path)), framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, *OTHER_TENSORS) as error:
        raise _read_error(path, error) from error
    text = metadata.get(METADATA_KEY, "null")
    if metadata.get(DIGEST_KEY, digest := _content_digest(text, tensors)) != digest:
        raise ModelError(
            f"model file {path} was changed since it was written: its digest differs; take a whole "
            "copy, or train again"
        )
    try:
        return _model(json.loads(text), tensors)
    except (ModelError, AirframeError, ValueError, RecursionError) as error:
        raise ModelError(
            f"model file {path}: {error}; train a new one with: thrustmargin train"
        ) from error


def _read_error(path: Path, error: Exception) -> ModelError:
    """Return the ModelError for a file that cannot be read, with its remedy."""
    if not path.exists():
        return ModelError(f"no model file {path}; make one with: thrustmargin train LOG...")
    if path.is_dir():
        return ModelError(f"{path} is a folder; give the .safetensors file in it")
    reason = error.strerror if isinstance(error, OSError) else error
    return ModelError(f"{path} is not a whole model file ({reason}); give another --model")


def _tensors(network: RotorNetwork | None) -> dict[str, np.ndarray]:
    """Return the arrays of a network by name, as stored in a file; empty for None."""
    if network is None:
        return {}
    layers = {
        f"layer{index}.{kind}": array
        for index, pair in enumerate(zip(network.weights, network.biases, strict=True))
        for kind, array in zip(("weight", "bias"), pair, strict=True)
    }
    return layers | {name: getattr(network, name) for name in STANDARDISATION}


def _network(tensors: dict[str, np.ndarray]) -> RotorNetwork | None:
    """Build a network from its tensors, by name; None without tensors.

    Raise ModelError if a tensor is missing, superfluous or of another type: float64 for the
    standardisation, float32 for the layers.
    """
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
    """Return the JSON part of a model file: all of the model but the network's arrays."""
    return {
        "schema": SCHEMA,
        "airframe": airframe_table(model.airframe),
        **{key: to_json_values(getattr(model, field)) for key, field, _ in JSON_FIELDS},
        **{
            key: to_json_values(known)
            for key, known in (
                ("state", model.state),
                ("power", model.power),
                ("arms", model.arms),
            )
            if known is not None
        },
    }


def _model(data: Any, tensors: dict[str, np.ndarray]) -> RotorModel:
    """Build a model from the JSON and tensors of a file. Raises ModelError or AirframeError if
    they are wrong."""
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise ModelError(f"its schema is {schema!r}, this version reads {SCHEMA!r}")
    later = ("forward_flight", "good_flights", "thermometer", "state", "power", "arms")
    data = {**dict.fromkeys(later), **data}
    missing = sorted({"airframe", *(key for key, _, _ in JSON_FIELDS)} - data.keys())
    if missing or not isinstance(data["airframe"], dict):
        raise ModelError(f"its metadata lacks {(missing or ['airframe'])[0]!r}")
    return RotorModel(
        airframe=airframe_from_table(data["airframe"], "the airframe in it"),
        network=_network(tensors),
        **{field: from_json_values(kind, data[key], key) for key, field, kind in JSON_FIELDS},
        state=from_json_values(ModeState | None, data["state"], "state"),
        power=from_json_values(PowerLaw | None, data["power"], "power"),
        arms=from_json_values(ArmLaw | None, data["arms"], "arms"),
    )
