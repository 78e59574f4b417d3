"""A rotor speed model whose every number can be worked out by hand.

The aircraft: empty 20 kg, tank 10 kg, T = 2e-5 N² in air of 1.2 kg/m³, four equal rotors. Its
network has two members without hidden layers, N_i = 1800 -+ 20 - 30 V + 25 m + 10 i rpm (V in m/s,
m in kg, i from 0), learnt from 1 to 5 m/s and 2 to 8 kg in air of 1.2 kg/m³.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.models.known_effects import known_effect
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse, worst_rotor
from thrustmargin.models.model.rotor_model import Basis, RotorModel, physics_model, predict
from thrustmargin.models.network.network import RotorNetwork
from thrustmargin.models.network.validity import Interval, TrainingDomain
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio

NAN, G0 = float("nan"), 9.80665
AIRFRAME: Airframe = replace(
    load_airframe("topxgun-f16-sitl"),
    empty_mass=20.0,
    tank_volume_l=10.0,
    liquid_density=1.0,
    thrust_coefficient=2e-5,
    reference_density=1.2,
    max_rotor_speed_rpm=3000.0,
    ceiling_voltage=50.0,
    ceiling_voltage_exponent=1.0,
    nominal_voltage=45.0,
)
DRAG = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=4.0)


def linear_network() -> RotorNetwork:
    two = np.ones((2, 1))
    return RotorNetwork(
        weights=(np.tile(np.array([[-30.0] * 4, [25.0] * 4], dtype=np.float32), (2, 1, 1)),),
        biases=(
            np.array(
                [[-20.0 + 10.0 * i for i in range(4)], [20.0 + 10.0 * i for i in range(4)]],
                dtype=np.float32,
            ),
        ),
        input_mean=0.0 * two * np.ones(2),
        input_scale=two * np.ones(2),
        output_mean=1800.0 * two * np.ones(4),
        output_scale=two * np.ones(4),
    )


def learnt(**given) -> RotorModel:
    parts = {
        "airframe": AIRFRAME,
        "network": linear_network(),
        "training_domain": TrainingDomain(
            airspeed=(1.0, 5.0),
            tank_kg=(2.0, 8.0),
            density=(1.2, 1.2),
            height_agl=(NAN, NAN),
            wind_speed=(NAN, NAN),
            flights=("one",),
        ),
        "interval": Interval(
            coverage=0.9,
            flights=9,
            airspeed=(1.0, 5.0),
            scatter_rpm=((10.0,) * 4, (30.0,) * 4),
            factor=(2.0, 2.0, 2.0, 1.0),
        ),
        "reference_density": 1.2,
        "reference_voltage": 50.0,
        **given,
    }
    return RotorModel(**parts)


def network_rpm(airspeed: float, tank_kg: float) -> np.ndarray:
    return 1800.0 - 30.0 * airspeed + 25.0 * tank_kg + 10.0 * np.arange(4)


def flight(airspeed, tank_kg, **given) -> FlightTrack:
    airspeed = np.asarray(airspeed, dtype=float)
    return FlightTrack.of(
        name="rows",
        time_s=np.arange(airspeed.size) / 10.0,
        rotor_count=4,
        airspeed=airspeed,
        tank_kg=np.asarray(tank_kg, dtype=float),
        **given,
    )


def recorded(key: str, rotor: int | None = None, **values: float) -> EffectRecord:
    known = known_effect(key)
    return EffectRecord(
        name=known.name,
        variant=known.variant,
        rotor=rotor,
        parameters={
            p.name: Identified(value=values.get(p.name, 0.0), unit=p.unit, ci95=(NAN, NAN))
            for p in known.parameters
        },
    )


def hover_rpm(mass: float, density: float = 1.2, rotors: float = 4.0) -> float:
    """sqrt(m g / (rotors x 2e-5 x rho/1.2))"""
    return float(np.sqrt(mass * G0 / (rotors * 2e-5 * density / 1.2)))


def test_inside_its_training_it_is_the_network_with_its_interval():
    # Members lie 20 rpm each side: a spread of 28.284 rpm, times z(0.95) = 1.644854. Scatter at
    # 3 m/s is half way, 20. Half width 2 sqrt(20² + 46.52²), and once that for rotor 4.
    predicted = predict(learnt(), flight([3.0], [4.0]), np.array([1.2]))
    np.testing.assert_allclose(predicted.rotor_speed_rpm, [network_rpm(3.0, 4.0)], rtol=1e-6)
    half = np.hypot(20.0, stats.norm.ppf(0.95) * 20.0 * np.sqrt(2.0)) * np.array([2, 2, 2, 1])
    np.testing.assert_allclose(predicted.upper_rpm - predicted.rotor_speed_rpm, [half], rtol=1e-5)
    np.testing.assert_allclose(predicted.rotor_speed_rpm - predicted.lower_rpm, [half], rtol=1e-5)
    assert predicted.coverage == 0.9
    assert predicted.basis.tolist() == [Basis.NETWORK]
    np.testing.assert_allclose(predicted.thrust, 2e-5 * predicted.rotor_speed_rpm**2)


def test_no_interval_goes_below_standing_still():
    interval = learnt().interval
    assert interval is not None
    wide = replace(interval, factor=(100.0,) * 4)
    predicted = predict(learnt(interval=wide), flight([3.0], [4.0]), np.array([1.2]))
    np.testing.assert_array_equal(predicted.lower_rpm, 0.0)
    assert np.all(predicted.upper_rpm > 5000.0)


def test_without_a_network_the_interval_holds_where_flights_have_been():
    # Where the tank was flown; of an unknown airspeed, which no network asks for, as at 0 m/s.
    domain = learnt().training_domain
    assert domain is not None
    model = learnt(network=None, training_domain=replace(domain, airspeed=(NAN, NAN)))
    rows = flight([3.0, NAN, 3.0, 3.0], [4.0, 4.0, 9.0, 4.0])
    found = predict(model, rows, np.array([1.2, 1.2, 1.2, NAN]))
    wide = np.array([[40.0, 40.0, 40.0, 20.0]])  # twice 20 rpm at 3 m/s, once for rotor 4
    by_hand = np.concatenate([wide, wide / 2.0, np.full((2, 4), NAN)])
    np.testing.assert_allclose(found.upper_rpm - found.rotor_speed_rpm, by_hand)
    assert found.coverage == 0.9
    assert found.basis.tolist() == [Basis.PHYSICS] * 3 + [Basis.NONE]
    nowhere = predict(model, flight([3.0], [9.0]), np.array([1.2]))
    assert np.isnan(nowhere.coverage)
    for without in (learnt(network=None, interval=None), physics_model(AIRFRAME)):
        assert np.isnan(predict(without, rows, np.full(4, 1.2)).upper_rpm).all()


def test_outside_its_training_the_network_at_its_edge_is_extrapolated_by_physics():
    # 9 kg, 6 m/s and air of 1.1 and 0.9 kg/m³ are each outside. Without forward flight the airspeed
    # is held at its edge; N goes with the root of the weight, and of the air.
    track = flight([3.0, 6.0, 3.0, 3.0], [9.0, 4.0, 4.0, 4.0])
    density = np.array([1.2, 1.2, 1.1, 0.9])
    predicted = predict(learnt(), track, density)
    by_hand = [
        network_rpm(3.0, 8.0) * np.sqrt(29.0 / 28.0),
        network_rpm(5.0, 4.0),
        network_rpm(3.0, 4.0) * np.sqrt(1.2 / 1.1),
        network_rpm(3.0, 4.0) * np.sqrt(1.2 / 0.9),
    ]
    np.testing.assert_allclose(predicted.rotor_speed_rpm, by_hand, rtol=1e-6)
    assert predicted.basis.tolist() == [Basis.PHYSICS] * 4
    assert predicted.coverage == 0.9
    # Twice the scatter of 20 rpm at 3 m/s and of 30 at 5, by the factors 2, 2, 2, 1; beside it
    # 1.645 x 10 % of what the weight beyond the edge adds.
    half = predicted.upper_rpm - predicted.rotor_speed_rpm
    np.testing.assert_allclose(half[1], 2.0 * 30.0 * np.array([2, 2, 2, 1]))
    np.testing.assert_allclose(half[3], 2.0 * 20.0 * np.array([2, 2, 2, 1]))
    added = network_rpm(3.0, 8.0) * (np.sqrt(29.0 / 28.0) - 1.0)
    np.testing.assert_allclose(
        half[0], np.hypot(40.0 * np.array([2, 2, 2, 1]), 1.644854 * 0.1 * added), rtol=1e-5
    )


def test_an_aircraft_without_a_tank_turns_faster_with_a_payload():
    # N goes with the root of the weight, also where effects are on top: 20 kg empty, 5 and 12 more.
    bare = replace(AIRFRAME, tank_volume_l=0.0)
    model = replace(physics_model(bare), effects=(recorded("load_factor"),))
    assert bare.tank_capacity_kg == 0.0
    found = predict(model, flight([0.0, 0.0, 0.0], [0.0, 5.0, 12.0]), np.full(3, 1.2))
    by_hand = found.rotor_speed_rpm[0] * np.sqrt(np.array([20.0, 25.0, 32.0]) / 20.0)[:, None]
    np.testing.assert_allclose(found.rotor_speed_rpm, by_hand, rtol=1e-6)


@pytest.mark.parametrize("missing", ["airspeed", "tank_kg", "density"])
def test_a_row_without_an_input_has_nothing(missing):
    track, density = flight([3.0, 3.0], [4.0, 4.0]), np.array([1.2, 1.2])
    values = density if missing == "density" else getattr(track, missing)
    values[1] = NAN
    for model in (learnt(), physics_model(AIRFRAME)):
        predicted = predict(model, track, density)
        if missing == "airspeed" and model.network is None:  # the weight is that at any speed
            assert predicted.basis[1] == Basis.PHYSICS
            np.testing.assert_array_equal(predicted.thrust[1], predicted.thrust[0])
            continue
        assert predicted.basis[1] == Basis.NONE
        assert np.isfinite(predicted.rotor_speed_rpm[0]).all()
        for of in (predicted.rotor_speed_rpm, predicted.upper_rpm, predicted.thrust):
            assert np.isnan(of[1]).all()


def test_a_model_in_other_air_knows_its_own_coefficient():
    # 2e-5 x 1.0/1.2
    thin = learnt(reference_density=1.0)
    assert thin.thrust_coefficient == pytest.approx(2e-5 / 1.2)
    apparent = thin.thrust_coefficient * thin.base_speed(np.array([3.0]), np.array([4.0])) ** 2
    np.testing.assert_allclose(apparent, [2e-5 / 1.2 * network_rpm(3.0, 4.0) ** 2], rtol=1e-6)
    # Beyond its inputs: the weight in that air.
    speed = thin.base_speed(np.array([9.0, NAN]), np.array([4.0, 4.0]))
    np.testing.assert_allclose(speed[0], hover_rpm(24.0, 1.0))
    assert np.isnan(speed[1]).all()


def test_a_network_held_at_its_edge_goes_on_by_weight():
    # 9.5 kg is held at 8 kg and carries 29.5 instead of 28 kg; 7 m/s is held at 5, 0.2 at 1.
    model = learnt()
    assert model.known_airspeed == 5.0
    found = model.extrapolated_speed(np.array([3.0, 7.0, 0.2, 3.0]), np.array([9.5, 4.0, 4.0, 0.0]))
    by_hand = np.stack(
        [
            network_rpm(3.0, 8.0) * np.sqrt(29.5 / 28.0),
            network_rpm(5.0, 4.0),
            network_rpm(1.0, 4.0),
            network_rpm(3.0, 2.0) * np.sqrt(20.0 / 22.0),
        ]
    )
    np.testing.assert_allclose(found, by_hand, rtol=1e-6)


def test_drag_and_lift_carry_it_on_from_where_its_airspeed_is_well_known():
    model = learnt(forward_flight=DRAG)
    assert model.known_airspeed == 4.0
    assert learnt(forward_flight=replace(DRAG, known_airspeed=6.0)).known_airspeed == 5.0
    mass = np.array([24.0, 24.0])
    at = thrust_ratio(DRAG, np.array([4.0, 7.0]), mass, 1.2, AIRFRAME)
    found = model.extrapolated_speed(np.array([7.0]), np.array([4.0]))
    np.testing.assert_allclose(found[0], network_rpm(4.0, 4.0) * np.sqrt(at[1] / at[0]), rtol=1e-6)
    # Slower than the training: held at its lowest airspeed, and carried back from there.
    at = thrust_ratio(DRAG, np.array([1.0, 0.0]), mass, 1.2, AIRFRAME)
    found = model.extrapolated_speed(np.array([0.0]), np.array([4.0]))
    np.testing.assert_allclose(found[0], network_rpm(1.0, 4.0) * np.sqrt(at[1] / at[0]), rtol=1e-6)
    # Heavier too: weight over weight, and each airspeed at its own mass.
    heavy = thrust_ratio(DRAG, np.array([7.0]), np.array([29.5]), 1.2, AIRFRAME)
    edge = thrust_ratio(DRAG, np.array([4.0]), np.array([28.0]), 1.2, AIRFRAME)
    found = model.extrapolated_speed(np.array([7.0]), np.array([9.5]))
    by_hand = network_rpm(4.0, 8.0) * np.sqrt(29.5 / 28.0 * heavy / edge)
    np.testing.assert_allclose(found[0], by_hand, rtol=1e-6)


def test_weak_rotors_turn_faster_all_alike():
    # 1 + 1 + 0.5 + 0.5: three free rotors carry the weight
    weak = replace(AIRFRAME, rotor_effectiveness=np.array([1.0, 1.0, 0.5, 0.5]))
    predicted = predict(physics_model(weak), flight([0.0], [4.0]), np.array([0.9]))
    np.testing.assert_allclose(predicted.rotor_speed_rpm, hover_rpm(24.0, 0.9, rotors=3.0))
    np.testing.assert_allclose(predicted.thrust / (24.0 * G0), [[1 / 3, 1 / 3, 1 / 6, 1 / 6]])


def whole_flight(**given) -> FlightTrack:
    channels = {
        "pressure": np.full(2, 101_325.0 * 1.2 / 1.225),
        "altitude": np.zeros(2),
        "voltage": np.array([50.0, 40.0]),
        "rotor_speed_rpm": np.array([[1500.0, 1800.0, 1500.0, 1500.0]] * 2),
        **given,
    }
    return flight([0.0, 0.0], [4.0, 4.0], **channels)


def test_a_flight_through_the_model_by_hand():
    # Ceiling 3000 rpm at 50 V and 2400 at 40 V: 180 and 115.2 N a rotor in air of 1.2 kg/m³.
    found = analyse(whole_flight(), physics_model(AIRFRAME))
    np.testing.assert_allclose(found.density, 1.2, rtol=1e-5)
    np.testing.assert_allclose(found.max_rotor_speed_rpm, [3000.0, 2400.0])
    np.testing.assert_allclose(found.max_thrust[:, 0], [180.0, 115.2], rtol=1e-5)
    # 1500 rpm: 45 N, a quarter of 180 N; 1800 rpm: 64.8 N, 0.36 of it and 0.5625 of 115.2 N.
    np.testing.assert_allclose(found.thrust, [[45.0, 64.8, 45.0, 45.0]] * 2, rtol=1e-5)
    np.testing.assert_allclose(found.margin[0], [0.75, 0.64, 0.75, 0.75])
    np.testing.assert_allclose(found.margin[1], 1.0 - np.array([1.5, 1.8, 1.5, 1.5]) ** 2 / 5.76)
    # 24 kg: 58.8399 N a rotor, 0.326888 and 0.510763 of the ceiling.
    np.testing.assert_allclose(found.weight, 24.0 * G0)
    np.testing.assert_allclose(found.margin_predicted[:, 2], [0.673112, 0.489237], atol=1e-5)
    np.testing.assert_allclose(found.residual_rpm[0, 1], 1800.0 - hover_rpm(24.0), rtol=1e-4)
    # A diagonal pair holds 2 x 180 and 2 x 115.2 N of 235.3596 N.
    np.testing.assert_allclose(found.redundancy_yaw_uncontrolled, [1.529574, 0.978927], rtol=2e-5)
    np.testing.assert_allclose(found.redundancy_yaw_kept, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.trimmable_loss, [0.673112, 0.489237], atol=2e-5)


def test_a_hidden_mass_and_a_worn_rotor_are_part_of_the_aircraft():
    model = replace(
        physics_model(AIRFRAME),
        effects=(
            recorded("extra_mass", mass=6.0),
            recorded("rotor_degradation", rotor=2, loss=0.2, torque_share=1.0),
            recorded("rotor_degradation", rotor=2, loss=0.5, torque_share=1.0),
        ),
    )
    found = analyse(whole_flight(), model)
    np.testing.assert_allclose(found.weight, 30.0 * G0)
    # Rotor 2 makes 0.8 x 0.5 of its thrust: 0.4 x 64.8 N, of at most 0.4 x 180 N.
    np.testing.assert_allclose(found.thrust[0], [45.0, 25.92, 45.0, 45.0], rtol=1e-5)
    np.testing.assert_allclose(found.max_thrust[0], [180.0, 72.0, 180.0, 180.0], rtol=1e-5)
    np.testing.assert_allclose(found.prediction.thrust[0].sum(), 30.0 * G0, rtol=1e-5)
    assert model.airframe.empty_mass == 20.0  # the model's own airframe stays


def test_air_that_is_known_to_be_warm_is_thin_on_every_line():
    air = recorded("air_density", temperature_offset=20.0, torque_share=1.0)
    model = replace(physics_model(AIRFRAME), effects=(air,))
    found = analyse(whole_flight(), model)
    density = 1.2 * 288.15 / 308.15
    np.testing.assert_allclose(found.density, density, rtol=1e-5)
    assert "+20 K" in statement_words(found.density_basis)
    np.testing.assert_allclose(found.thrust[0, 0], 45.0 * density / 1.2, rtol=1e-5)
    # The network's own range of densities is no limit for a model that follows density itself.
    for effects, basis in (((), Basis.PHYSICS), ((air,), Basis.NETWORK)):
        one = predict(learnt(effects=effects), flight([3.0], [4.0]), np.array([1.0]))
        assert one.basis.tolist() == [basis]


def test_in_unknown_air_there_is_no_number_even_if_the_model_follows_the_air():
    air = recorded("air_density", temperature_offset=20.0, torque_share=1.0)
    for model in (learnt(effects=(air,)), replace(physics_model(AIRFRAME), effects=(air,))):
        for airspeed in (3.0, 9.0):  # inside its training and outside
            found = predict(model, flight([airspeed], [4.0]), np.array([NAN]))
            assert found.basis.tolist() == [Basis.NONE]
            assert np.isnan(found.rotor_speed_rpm).all()


@pytest.mark.parametrize(
    ("badness", "value", "rotor"),
    [(None, [3.0, 5.0, NAN], [2.0, 0.0, NAN]), ("smallest", [1.0, 5.0, NAN], [0.0, 0.0, NAN])],
)
def test_the_worst_rotor_of_each_row(badness, value, rotor):
    values = np.array([[1.0, 2.0, 3.0], [5.0, NAN, NAN], [NAN, NAN, NAN]])
    values = np.concatenate([values, values])
    worst, which = worst_rotor(values, None if badness is None else -values)
    np.testing.assert_array_equal(worst, value * 2)
    np.testing.assert_array_equal(which, rotor * 2)
    # Of what is not known to be bad no rotor is the worst, and of no rotor none.
    for unknown in (worst_rotor(values, np.full(values.shape, NAN)), worst_rotor(values[:, :0])):
        np.testing.assert_array_equal(unknown, np.full((2, 6), NAN))


def test_a_model_in_words():
    title = AIRFRAME.title
    assert physics_model(AIRFRAME).description == f"weight and thrust curve of {title}, no network"
    assert learnt().description == f"network of 2 members for {title} from 1 flights"
    assert np.isnan(physics_model(AIRFRAME).known_airspeed)


def test_a_network_without_its_training_domain_is_no_model():
    with pytest.raises(ModelError, match="needs its training domain"):
        learnt(training_domain=None)


def test_a_model_without_network_says_what_it_has_from_flights():
    words = f"weight and thrust curve of {AIRFRAME.title}, no network, with what 1 flights show"
    model = learnt(network=None)
    assert model.description == words
    # Where it was flown it is the weight too, whatever the airspeed.
    airspeed, tank = np.array([3.0, 9.0, NAN]), np.array([4.0, 4.0, 9.0])
    by_hand = np.repeat([[hover_rpm(24.0)], [hover_rpm(24.0)], [hover_rpm(29.0)]], 4, axis=1)
    np.testing.assert_allclose(model.base_speed(airspeed, tank), by_hand)
    np.testing.assert_allclose(model.extrapolated_speed(airspeed, tank), by_hand)


def test_an_interval_is_of_as_many_rotors_as_the_aircraft_has():
    interval = learnt().interval
    assert interval is not None
    for wrong in (
        replace(interval, factor=(1.0,) * 3),
        replace(interval, scatter_rpm=((10.0,) * 4, (30.0,) * 3)),
    ):
        with pytest.raises(ModelError, match="the interval is not of 4 rotors"):
            learnt(interval=wrong)
    for density in (0.0, -1.0, NAN):
        with pytest.raises(ModelError, match="must be above 0"):
            learnt(reference_density=density)
    assert learnt(reference_density=0.05).reference_density == 0.05
