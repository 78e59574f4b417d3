"""Model files: what is saved comes back bit for bit, and damage is said in one line."""

import json
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.errors import ModelError
from thrustmargin.models.model.rotor_model import (
    METADATA_KEY,
    SCHEMA,
    RotorModel,
    load_model,
    physics_model,
    save_model,
    shipped_model,
)
from thrustmargin.models.network.conformal import Interval
from thrustmargin.models.network.ensemble import RotorNetwork
from thrustmargin.models.network.training_domain import Envelope
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio

F16 = load_airframe("topxgun-f16-sitl")


def network(rotors=4, members=2, seed=0) -> RotorNetwork:
    rng = np.random.default_rng(seed)
    widths = (2, 117, 103, 76, rotors)
    pairs = list(pairwise(widths))
    return RotorNetwork(
        weights=tuple(rng.normal(0, 0.1, (members, a, b)).astype(np.float32) for a, b in pairs),
        biases=tuple(rng.normal(0, 0.1, (members, b)).astype(np.float32) for _, b in pairs),
        input_mean=np.tile([3.0, 8.0], (members, 1)),
        input_scale=np.tile([2.0, 4.0], (members, 1)),
        output_mean=np.full((members, rotors), 1900.0),
        output_scale=rng.uniform(100, 200, (members, rotors)),
    )


def worn_rotor(**given) -> EffectRecord:
    """Rotor 1 with 8 % less thrust, with every parameter that the effect has."""
    effect = BY_KEY["rotor_degradation"]
    parameters = {
        p.name: Identified(value=p.start, unit=p.unit, ci95=(p.lower, p.upper))
        for p in effect.parameters
    }
    loss = Identified(value=0.08, unit="1", ci95=(0.07, 0.1 + 0.2))
    return EffectRecord(
        **{"name": effect.name, "rotor": 1, "parameters": {**parameters, "loss": loss}, **given}
    )


def learnt_model(airframe: Airframe = F16, **given) -> RotorModel:
    rotors = airframe.rotor_count
    defaults = {
        "airframe": airframe,
        "network": network(rotors),
        "envelope": Envelope(
            airspeed=(0.0, 6.0),
            tank_kg=(1.0, 16.0),
            density=(1.22, 1.23),
            height_agl=(2.9, 3.1),
            wind_speed=(np.nan, np.nan),
            flights=("a.tlog", "b.tlog"),
        ),
        "interval": Interval(
            coverage=0.9,
            flights=2,
            airspeed=(0.0, 6.0),
            scatter_rpm=((100.0,) * rotors, (20.0,) * rotors),
            factor=(1.1,) * rotors,
        ),
        "effects": (worn_rotor(),),
        "forward_flight": ForwardFlight(
            rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=5.0
        ),
        "reference_density": 1.2240448906210113,
        "reference_voltage": np.nan,
    }
    return RotorModel(**{**defaults, **given})


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


def test_beyond_what_it_knows_a_network_is_carried_on_by_drag_and_lift():
    model = learnt_model()
    tank = np.full(3, 8.0)
    edge, near, far = model.held_speed(np.array([5.0, 5.0 + 1e-6, 12.0]), tank)
    assert np.allclose(near, edge, rtol=1e-5)
    assert model.forward_flight is not None
    mass = F16.empty_mass + tank[:2]
    at = thrust_ratio(
        model.forward_flight, np.array([5.0, 12.0]), mass, model.reference_density, F16
    )
    assert np.allclose((far / edge) ** 2, at[1] / at[0])
    held = learnt_model(forward_flight=None)
    assert np.array_equal(*held.held_speed(np.array([6.0, 12.0]), tank[:2]))


def test_a_file_from_before_forward_flight_is_read_without_it(tmp_path):
    path = rewritten(tmp_path, change_metadata=lambda data: data.pop("forward_flight"))
    assert load_model(path).forward_flight is None


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
        effects = json.loads(file.metadata()[METADATA_KEY])["effects"]
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
        data = json.loads(file.metadata()[METADATA_KEY])
    tensors = load_file(path)
    if change_metadata:
        change_metadata(data)
    if change_tensors:
        change_tensors(tensors)
    save_file(tensors, path, metadata={METADATA_KEY: json.dumps(data)})
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
        (put("envelope", None), "belong together"),
        (lambda d: d["envelope"].update(airspeed=[1.0]), "envelope.airspeed has 1 entries"),
        (lambda d: d["interval"].update(factor="wide"), "interval.factor is str"),
        (lambda d: d["interval"].update(factor=[1.0]), "interval is not of 4 rotors"),
        (put("reference_density", None), "reference density"),
        (put("reference_density", "thin"), "reference_density is 'thin', not float"),
        (lambda d: d["effects"][0].update(rotor="one"), "not int"),
        (lambda d: d["effects"][0].update(rotor=5), "rotor 5 of 4"),
        (lambda d: d["effects"][0].update(name="magic"), "'magic'"),
        (lambda d: d["effects"][0]["parameters"]["loss"].update(unit="kg"), "loss in '1'"),
        (lambda d: d["airframe"]["rotors"].pop(), "the network has 4 rotors"),
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
    save_file(load_file(path), path, metadata={METADATA_KEY: deep})
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


def test_a_network_of_another_rotor_count_is_refused():
    with pytest.raises(ModelError, match="6 rotors"):
        learnt_model(network=network(6))


def test_the_envelope_covers_its_ranges_and_a_stated_bit_more():
    envelope = learnt_model().envelope
    assert envelope is not None
    airspeed = np.array([0.0, 6.2, 6.3, np.nan, 3.0, 3.0, 3.0])
    tank = np.array([1.0, 16.2, 8.0, 8.0, 0.7, 0.8, 8.0])
    assert envelope.covers_inputs(airspeed, tank).tolist() == [
        True,
        True,
        False,
        False,
        False,
        True,
        True,
    ]
    density = np.array([1.20, 1.19, 1.25, 1.26, np.nan])
    still = np.full(5, 3.0)
    covered = envelope.covers(still, still, density)
    assert covered.tolist() == [True, False, True, False, False]


def test_base_speed_is_the_network_inside_and_the_weight_outside():
    model = learnt_model(effects=())
    airspeed = np.array([3.0, 12.0, np.nan, 3.0])
    tank = np.array([8.0, 8.0, 8.0, np.nan])
    speeds = model.base_speed(airspeed, tank)
    hover = np.sqrt((F16.empty_mass + 8.0) * 9.80665 / 4 / model.thrust_coefficient)
    np.testing.assert_allclose(speeds[1], hover)
    assert np.all(np.abs(speeds[0] - hover) > 1e-3)
    assert np.isnan(speeds[2:]).all()
    np.testing.assert_allclose(
        model.base_apparent_thrust(airspeed, tank)[1].sum(), (F16.empty_mass + 8.0) * 9.80665
    )


def test_the_shipped_model_is_whole_and_small():
    from importlib import resources

    model = shipped_model()
    assert model.airframe.name == "topxgun-f16-sitl"
    assert model.network is not None
    assert model.network.hidden == (117, 103, 76)
    assert model.envelope is not None
    assert len(model.envelope.flights) == 27
    assert model.training is not None
    assert model.training.config.learning_rate == 0.0006
    size = (resources.files("models") / "shipped" / "default.safetensors").read_bytes()
    assert len(size) < 1_000_000
    assert SCHEMA == "thrustmargin.model/1"
