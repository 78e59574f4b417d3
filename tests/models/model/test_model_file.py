"""Model files: what is saved comes back bit for bit, and damage is said in one line."""

import json
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from tests.models.model.made_models import F16, learnt_model
from thrustmargin.models.errors import ModelError
from thrustmargin.models.model.model_file import (
    load_model,
    save_model,
    shipped_model,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe


def saved(tmp_path, **given):
    path = tmp_path / "model.safetensors"
    save_model(learnt_model(**given), path)
    return path


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b) or (a != a and b != b)  # NaN for NaN


@pytest.mark.parametrize("name", ["topxgun-f16-sitl", "agras-t20", "agras-t40"])
def test_a_saved_model_comes_back_bit_for_bit(name, tmp_path):
    model = learnt_model(load_airframe(name))
    save_model(model, tmp_path / "m.safetensors")
    again = load_model(tmp_path / "m.safetensors")
    for field in fields(model):
        assert same(getattr(model, field.name), getattr(again, field.name)), field.name


def test_a_model_file_needs_no_airframe_file(tmp_path):
    own = replace(F16, name="my-own", title="one of a kind", empty_mass=25.5)
    own = replace(
        own,
        quantities={
            **F16.quantities,
            "empty_mass": replace(F16.quantities["empty_mass"], value=25.5),
        },
    )
    again = load_model(saved(tmp_path, airframe=own)).airframe
    assert (again.name, again.title, again.empty_mass) == ("my-own", "one of a kind", 25.5)
    assert again.quantities["empty_mass"].source == F16.quantities["empty_mass"].source


@pytest.mark.parametrize("field", ["forward_flight", "good_flights"])
def test_a_file_from_before_a_field_is_read_without_it(field, tmp_path):
    path = rewritten(tmp_path, change_metadata=lambda data: data.pop(field))
    assert getattr(load_model(path), field) is None


def test_a_model_without_network_is_saved_too(tmp_path):
    path = tmp_path / "physics.safetensors"
    save_model(physics_model(F16), path)
    again = load_model(path)
    assert again.network is None
    assert again.reference_density == F16.reference_density
    assert "no network" in again.description


def test_effects_are_written_in_the_form_that_identify_reports(tmp_path):
    from safetensors import safe_open

    with safe_open(str(saved(tmp_path)), framework="numpy") as file:
        effects = json.loads(file.metadata()["thrustmargin"])["effects"]
    assert len(effects) == 1
    assert (effects[0]["name"], effects[0]["rotor"]) == ("rotor_degradation", 1)
    assert effects[0]["parameters"]["loss"] == {
        "value": 0.08,
        "unit": "1",
        "ci95": [0.07, 0.30000000000000004],
    }


@pytest.mark.parametrize("step", ["os.fsync", "os.replace"])
def test_a_stopped_save_leaves_the_old_file_whole_and_no_other(step, tmp_path, monkeypatch):
    path = saved(tmp_path)
    before = path.read_bytes()

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(step, stop)
    with pytest.raises(KeyboardInterrupt):
        save_model(physics_model(F16), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_folder_that_is_not_there_is_said_when_saving(tmp_path):
    with pytest.raises(ModelError, match="cannot write the model file"):
        save_model(physics_model(F16), tmp_path / "none" / "m.safetensors")


def test_missing_files_and_folders_are_said(tmp_path):
    with pytest.raises(ModelError, match=r"no model file .*none\.safetensors"):
        load_model(tmp_path / "none.safetensors")
    with pytest.raises(ModelError, match="is a folder"):
        load_model(tmp_path)


@pytest.mark.parametrize("keep", [0, 1, 7, 8, 100, 0.2, 0.5, 0.99])
def test_a_truncated_file_is_refused(keep, tmp_path):
    path = saved(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: keep if isinstance(keep, int) else int(keep * len(content))])
    with pytest.raises(ModelError, match="not a whole model file"):
        load_model(path)


def test_random_bytes_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    for size in (10, 1000, 100_000):
        path = tmp_path / "noise.safetensors"
        path.write_bytes(rng.bytes(size))
        with pytest.raises(ModelError):
            load_model(path)


def test_a_safetensors_file_of_another_program_is_refused(tmp_path):
    path = tmp_path / "other.safetensors"
    save_file({"w": np.zeros(3)}, path)
    with pytest.raises(ModelError, match="its schema is None"):
        load_model(path)


def rewritten(tmp_path, *, change_metadata=None, change_tensors=None):
    """A saved model with its metadata or tensors changed by a function."""
    from safetensors import safe_open

    path = saved(tmp_path)
    with safe_open(str(path), framework="numpy") as file:
        data = json.loads(file.metadata()["thrustmargin"])
    tensors = load_file(path)
    if change_metadata:
        change_metadata(data)
    if change_tensors:
        change_tensors(tensors)
    save_file(tensors, path, metadata={"thrustmargin": json.dumps(data)})
    return path


def put(key, value):
    def change(data):
        data[key] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("schema", "thrustmargin.model/99"), "model/99"),
        (lambda d: d.pop("effects"), "lacks 'effects'"),
        (lambda d: d.pop("airframe"), "lacks 'airframe'"),
        (put("airframe", []), "lacks 'airframe'"),
        (lambda d: d["airframe"]["quantities"].pop("empty_mass"), "empty_mass"),
        (lambda d: d["envelope"].pop("tank_kg"), "envelope.tank_kg is missing"),
        (put("envelope", None), "needs its training domain"),
        (lambda d: d["envelope"].update(airspeed=[1.0]), "envelope.airspeed has 1 entries"),
        (lambda d: d["interval"].update(factor="wide"), "interval.factor is str"),
        (lambda d: d["interval"].update(factor=[1.0]), "interval is not of 4 rotors"),
        (put("reference_density", None), "reference density"),
        (lambda d: d["good_flights"].update(scatter=[1.0]), "good_flights.scatter is not a table"),
        (lambda d: d["good_flights"].update(curve_rpm={"yaw.x": -1.0}), "scatter -1.0 of yaw.x"),
        (lambda d: d["good_flights"].update(mode_scatter_rpm=[1.0]), "1 modes of 4 rotors"),
        (put("reference_density", "thin"), "reference_density is 'thin', not float"),
        (lambda d: d["effects"][0].update(rotor="one"), "not int"),
        (lambda d: d["effects"][0].update(rotor=5), "rotor 5 of 4"),
        (lambda d: d["effects"][0].update(name="magic"), "'magic'"),
        (lambda d: d["effects"][0]["parameters"]["loss"].update(unit="kg"), "loss in '1'"),
        (lambda d: d["airframe"]["rotors"].pop(), "quad-x has 4 rotors, not 3"),
        (
            lambda d: d["airframe"]["rotors"].pop() and d["airframe"].update(layout="tri"),
            "the network has 4 rotors",
        ),
    ],
)
def test_damaged_metadata_is_named(change, message, tmp_path):
    with pytest.raises(ModelError, match=message) as caught:
        load_model(rewritten(tmp_path, change_metadata=change))
    assert "\n" not in str(caught.value)
    assert "model.safetensors" in str(caught.value)


def test_metadata_nested_without_end_is_refused_in_one_line(tmp_path):
    path = saved(tmp_path)
    deep = "[" * 100_000 + "]" * 100_000
    save_file(load_file(path), path, metadata={"thrustmargin": deep})
    with pytest.raises(ModelError, match="recursion"):
        load_model(path)


def fill(name, value):
    def change(tensors):
        tensors[name].flat[0] = value

    return change


def to(name, convert):
    def change(tensors):
        tensors[name] = np.ascontiguousarray(convert(tensors[name]))

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (fill("layer1.weight", np.nan), "not finite"),
        (fill("layer2.bias", np.inf), "not finite"),
        (fill("output_scale", 0.0), "not positive"),
        (to("layer1.weight", lambda w: w[:, :, :50]), "layer 2"),
        (to("layer0.weight", lambda w: w[:, :1]), "layer 1"),
        (to("layer0.weight", lambda w: w.astype(np.float64)), "float64, not float32"),
        (to("output_mean", lambda m: m[:, :3]), "output_mean"),
        (to("input_mean", lambda m: m[0]), "input_mean"),
        (lambda t: t.pop("layer3.bias"), "'layer3.bias' is missing"),
        (put("extra", np.zeros(1)), "'extra' is missing or too many"),
    ],
)
def test_damaged_weights_are_named(change, message, tmp_path):
    with pytest.raises(ModelError, match=message):
        load_model(rewritten(tmp_path, change_tensors=change))


def test_the_shipped_model_is_whole_and_small():
    from importlib import resources

    model = shipped_model()
    assert model.airframe.name == "topxgun-f16-sitl"
    assert model.network is not None
    assert [w.shape[2] for w in model.network.weights[:-1]] == [117, 103, 76]
    assert model.training_domain is not None
    assert len(model.training_domain.flights) == 27
    assert model.training is not None
    assert model.training.config.learning_rate == 0.0006
    size = (resources.files("models") / "shipped" / "default.safetensors").read_bytes()
    assert len(size) < 1_000_000
    assert b"thrustmargin.model/1" in size


def test_one_number_changed_on_the_disk_is_refused(tmp_path):
    """A weight that is another number is as sound a file as before, and predicts otherwise."""
    path = saved(tmp_path)
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    with pytest.raises(ModelError, match="was changed since it was written"):
        load_model(path)


def test_a_changed_note_is_refused_too(tmp_path):
    path = saved(tmp_path)
    data = path.read_bytes()
    name = b'reference_density\\":'
    at = data.index(name) + data[data.index(name) :].index(b".") + 1  # the first decimal
    path.write_bytes(data[:at] + (b"8" if data[at : at + 1] != b"8" else b"7") + data[at + 1 :])
    with pytest.raises(ModelError, match="was changed since it was written"):
        load_model(path)
