"""Prediction says what each row rests on, and never invents a number."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import Basis, RotorModel, physics_model, predict
from thrustmargin.models.network.network import ensemble_speed
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.physics.thrust import thrust_from_speed

G0 = 9.80665  # m/s²


F16 = load_airframe("topxgun-f16-sitl")
SEA_LEVEL = 1.22405  # kg/m³, inside the range of the training


@pytest.fixture(scope="module")
def model() -> RotorModel:
    return shipped_model()


def flight(airspeed, tank_kg, rotors=4) -> FlightTrack:
    airspeed, tank_kg = np.broadcast_arrays(
        np.asarray(airspeed, dtype=np.float64), np.asarray(tank_kg, dtype=np.float64)
    )
    return FlightTrack.of(
        name="made up",
        time_s=np.arange(airspeed.size, dtype=np.float64),
        rotor_count=rotors,
        airspeed=airspeed,
        tank_kg=tank_kg,
    )


def air(track, density=SEA_LEVEL):
    return np.broadcast_to(np.asarray(density, dtype=np.float64), track.time_s.shape)


def test_inside_the_training_domain_it_is_the_network_with_its_interval(model):
    track = flight([0.5, 4.0, 6.0], [16.0, 10.0, 2.0])
    predicted = predict(model, track, air(track))
    speed, _ = ensemble_speed(model.network, track.airspeed, track.tank_kg)
    assert predicted.basis.tolist() == [Basis.NETWORK] * 3
    np.testing.assert_allclose(predicted.rotor_speed_rpm, speed, rtol=1e-6)
    assert predicted.coverage == 0.9
    assert np.all(predicted.lower_rpm < speed)
    assert np.all(predicted.upper_rpm > speed)
    np.testing.assert_allclose(predicted.thrust, model.thrust_coefficient * speed**2)


@pytest.mark.parametrize("density", [0.9, 1.0, 1.3])
def test_in_other_air_it_is_the_network_by_the_root_of_density(model, density):
    track = flight([4.0, 4.0], [10.0, 2.0])
    speed, _ = ensemble_speed(model.network, track.airspeed, track.tank_kg)
    predicted = predict(replace(model, effects=()), track, air(track, density))
    assert predicted.basis.tolist() == [Basis.PHYSICS] * 2
    by_hand = speed * np.sqrt(1.225 / density)
    np.testing.assert_allclose(predicted.rotor_speed_rpm, by_hand, rtol=1e-3)
    # The interval there is twice that of the training.
    inside = predict(replace(model, effects=()), track, air(track))
    half = predicted.upper_rpm - predicted.rotor_speed_rpm
    assert np.all(half > 1.5 * (inside.upper_rpm - inside.rotor_speed_rpm))
    assert predicted.coverage == 0.9


@pytest.mark.parametrize(
    ("vary", "low", "high"), [("density", 1.16, 1.29), ("tank_kg", 15.0, 17.0)]
)
def test_the_edge_of_the_training_is_no_step(model, vary, low, high):
    count = 400
    rows = {"density": SEA_LEVEL, "tank_kg": 10.0} | {vary: np.linspace(low, high, count)}
    track = flight(np.full(count, 4.0), rows["tank_kg"])
    predicted = predict(model, track, air(track, rows["density"]))
    assert {int(b) for b in predicted.basis} == {Basis.NETWORK, Basis.PHYSICS}
    half = (predicted.upper_rpm - predicted.rotor_speed_rpm)[:, 0]
    assert half.max() > 1.9 * half.min()
    assert np.abs(np.diff(half)).max() < 0.06 * half.min()
    speed = predicted.rotor_speed_rpm[:, 0]
    assert np.abs(np.diff(speed)).max() < 0.001 * speed.min()


def test_beyond_its_airspeeds_drag_counts_and_is_less_sure(model):
    track = flight([6.0, 12.0, 18.0, 24.0], [10.0] * 4)
    predicted = predict(model, track, air(track))
    assert predicted.basis.tolist() == [Basis.NETWORK, *[Basis.PHYSICS] * 3]
    assert np.all(np.diff(predicted.rotor_speed_rpm.mean(axis=1)) > 0.0)
    assert np.all(np.diff((predicted.upper_rpm - predicted.lower_rpm).mean(axis=1)) > 0.0)


def test_without_a_network_every_row_is_physics():
    track = flight([0.0, 4.0], [16.0, 0.0])
    predicted = predict(physics_model(F16), track, air(track))
    assert predicted.basis.tolist() == [Basis.PHYSICS] * 2
    np.testing.assert_allclose(predicted.thrust.sum(axis=1), (F16.empty_mass + track.tank_kg) * G0)


def test_a_coaxial_rotor_in_the_wash_carries_its_smaller_share():
    aircraft = load_airframe("agras-t40")
    assert np.unique(aircraft.rotor_effectiveness).size > 1
    track = flight([3.0], [20.0], rotors=aircraft.rotor_count)
    predicted = predict(physics_model(aircraft), track, air(track))
    assert np.ptp(predicted.rotor_speed_rpm) == pytest.approx(0.0)
    np.testing.assert_allclose(predicted.thrust.sum(), (aircraft.empty_mass + 20.0) * G0)
    free = thrust_from_speed(
        predicted.rotor_speed_rpm,
        coefficient=aircraft.thrust_coefficient,
        density=SEA_LEVEL,
        reference_density=aircraft.reference_density,
    )
    np.testing.assert_allclose(predicted.thrust / free, aircraft.rotor_effectiveness[None])


def test_a_missing_input_gives_no_number(model):
    track = flight([np.nan, 4.0, 4.0, 4.0], [10.0, np.nan, 10.0, 10.0])
    density = np.array([SEA_LEVEL, SEA_LEVEL, np.nan, SEA_LEVEL])
    for chosen, missing in ((model, [0, 1, 2]), (physics_model(F16), [1, 2])):
        predicted = predict(chosen, track, density)
        assert (predicted.basis[missing] == Basis.NONE).all()
        assert predicted.basis[3] != Basis.NONE
        for array in (predicted.rotor_speed_rpm, predicted.thrust, predicted.lower_rpm):
            assert np.isnan(array[missing]).all()
        assert np.isfinite(predicted.rotor_speed_rpm[3]).all()


def test_many_rows_give_what_single_rows_give(model):
    rng = np.random.default_rng(0)
    track = flight(rng.uniform(0, 12, 200), rng.uniform(0, 18, 200))
    density = rng.uniform(1.18, 1.27, 200)
    together = predict(model, track, density)
    assert {int(b) for b in together.basis} == {Basis.NETWORK, Basis.PHYSICS}
    for row in range(0, 200, 7):
        alone = predict(model, track.rows(slice(row, row + 1)), density[row : row + 1])
        assert alone.basis[0] == together.basis[row]
        for name in ("rotor_speed_rpm", "thrust", "lower_rpm", "upper_rpm"):
            np.testing.assert_allclose(
                getattr(alone, name)[0], getattr(together, name)[row], rtol=1e-4
            )


def test_an_empty_flight_gives_empty_arrays(model):
    track = flight(np.empty(0), np.empty(0))
    predicted = predict(model, track, np.empty(0))
    assert predicted.rotor_speed_rpm.shape == (0, 4)
    assert predicted.basis.shape == (0,)


def test_another_rotor_count_is_refused(model):
    track = flight([3.0], [5.0], rotors=6)
    with pytest.raises(AirframeError, match="6 rotors, but the model is for topxgun-f16-sitl"):
        predict(model, track, air(track))


def test_heavier_turns_faster(model):
    tanks = np.linspace(1.0, 15.0, 8)
    track = flight(4.0, tanks)
    predicted = predict(model, track, air(track))
    assert np.all(np.diff(predicted.rotor_speed_rpm.mean(axis=1)) > 0)


def test_an_identified_effect_is_in_the_prediction():
    mass = Identified(value=2.0, unit="kg", ci95=(1.5, 2.5))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavier = replace(physics_model(F16), effects=(record,))
    track = flight([2.0, 4.0], [5.0, 12.0])
    predicted = predict(heavier, track, air(track))
    same_load = predict(physics_model(F16), flight([2.0, 4.0], [7.0, 14.0]), air(track))
    np.testing.assert_allclose(predicted.rotor_speed_rpm, same_load.rotor_speed_rpm, rtol=5e-4)


@pytest.mark.parametrize(
    ("airspeed", "tank", "density"),
    [(12.0, 10.0, SEA_LEVEL), (4.0, 17.0, SEA_LEVEL), (4.0, 10.0, 1.0)],
)
def test_outside_the_training_domain_the_effects_are_there_too(model, airspeed, tank, density):
    mass = Identified(value=5.0, unit="kg", ci95=(4.5, 5.5))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavier = replace(model, effects=(*model.effects, record))
    track = flight([airspeed], [tank])
    before, after = (predict(m, track, air(track, density)) for m in (model, heavier))
    assert after.basis.tolist() == before.basis.tolist() == [Basis.PHYSICS]
    total = F16.empty_mass + tank
    np.testing.assert_allclose(
        after.rotor_speed_rpm, before.rotor_speed_rpm * np.sqrt((total + 5.0) / total)
    )


def test_outside_the_training_domain_air_counts_once(model):
    values = {"temperature_offset": (0.0, "K"), "torque_share": (1.0, "1")}
    record = EffectRecord(
        name="air_density",
        rotor=None,
        parameters={k: Identified(value=v, unit=u, ci95=(v, v)) for k, (v, u) in values.items()},
    )
    following = replace(model, effects=(record,))
    thin = replace(flight([12.0], [10.0]), pressure=np.array([80_000.0]))
    density = track_air(thin).density
    assert density[0] < 1.05
    predicted = predict(following, thin, density)
    plain = predict(replace(model, effects=()), thin, density)
    assert predicted.basis.tolist() == [Basis.PHYSICS]
    np.testing.assert_allclose(predicted.rotor_speed_rpm, plain.rotor_speed_rpm, rtol=1e-6)
