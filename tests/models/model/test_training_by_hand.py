"""Steps of training on a table of eight rows of three flights, counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import made_flights
from tests.models.model.test_training import sorties
from thrustmargin.models.errors import DataError
from thrustmargin.models.model import training
from thrustmargin.models.model.training import (
    TrainSettings,
    condition_scores,
    held_out_speeds,
    split_score,
    train,
    training_domain,
)
from thrustmargin.models.network.network import (
    NetConfig,
    NetworkFit,
    RotorNetwork,
    ensemble_speed,
    fit_network,
)
from thrustmargin.models.network.records import Samples, Split, gather, turning_rows
from thrustmargin.models.network.validity import calibrate, measure_coverage
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.forward_flight import fit_forward_flight

NAN = float("nan")
FLIGHT = np.array([0, 0, 0, 1, 1, 1, 2, 2])
TABLE = Samples(
    airspeed=np.array([2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 5.0, 1.0]),
    tank_kg=np.array([9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0]),
    rotor_speed_rpm=1000.0 + np.arange(16.0).reshape(8, 2),
    flight=FLIGHT,
    flights=("a", "b", "c"),
    density=np.array([1.2, 1.2, 1.2, 1.1, 1.1, 1.1, 1.0, 1.0]),
    height_agl=np.full(8, NAN),
    wind_speed=np.array([NAN, 3.0, 1.0, NAN, NAN, NAN, 2.0, NAN]),
    voltage=np.array([NAN, 50.0, 48.0, 52.0, NAN, NAN, NAN, NAN]),
    spraying=np.array([1.0, 1.0, 0.0, 0.0, NAN, NAN, 1.0, 0.0]),
    turning=np.array([0.0, 1.0, 0.0, 0.0, NAN, 1.0, 0.0, 0.0]),
)


def constant(speed: float) -> NetworkFit:
    """A network that answers `speed` for rotor 1 and 2 rpm more for rotor 2."""
    network = RotorNetwork(
        weights=(np.zeros((1, 2, 2), dtype=np.float32),),
        biases=(np.zeros((1, 2), dtype=np.float32),),
        input_mean=np.zeros((1, 2)),
        input_scale=np.ones((1, 2)),
        output_mean=np.array([[speed, speed + 2.0]]),
        output_scale=np.ones((1, 2)),
    )
    losses = np.array([0.5, 0.3, 0.4])
    return NetworkFit(network=network, training_loss=losses, validation_loss=losses)


def leaving_out(*flights: int) -> Split:
    out = np.flatnonzero(np.isin(FLIGHT, flights))
    rest = np.flatnonzero(~np.isin(FLIGHT, flights))
    return Split(training=rest[1:], validation=rest[:1], test=out)


def test_a_flight_is_predicted_by_the_mean_of_the_members_that_left_it_out():
    members = [constant(1000.0), constant(1100.0), constant(1400.0)]
    splits = [leaving_out(0), leaving_out(1), leaving_out(1, 2)]
    found = held_out_speeds(TABLE, members, splits)
    # flight 0 by the first, flight 1 by the second and third, flight 2 by the third
    by_hand = np.repeat([1000.0, 1250.0, 1400.0], [3, 3, 2])
    np.testing.assert_allclose(found, np.stack([by_hand, by_hand + 2.0], axis=1))


def test_scores_of_a_split_are_of_its_own_rows():
    split = Split(training=np.arange(4), validation=np.array([4, 5]), test=np.array([6, 7]))
    found = split_score("flights", TABLE, split, constant(1000.0))
    # Rotor 1 is 0, 2, .. 14 above 1000 and rotor 2 one less than that plus two.
    for scored, rows in (
        (found.training, (0, 4)),
        (found.validation, (4, 6)),
        (found.test, (6, 8)),
    ):
        error = np.arange(*rows) * 2.0
        both = np.stack([error, error - 1.0])
        assert scored.rmse_per_rotor_rpm == pytest.approx(np.sqrt(np.mean(both**2, axis=1)))
        about_its_mean = np.arange(*rows) * 2.0 - np.mean(np.arange(*rows) * 2.0)
        r2 = 1.0 - np.sum(both**2, axis=1) / np.sum(about_its_mean**2)
        assert scored.r2_per_rotor == pytest.approx(r2)
        assert scored.rows == rows[1] - rows[0]
    assert (found.epochs, found.best_epoch, found.lowest_loss) == (3, 2, 0.3)


def test_conditions_take_the_rows_that_they_name():
    predicted = TABLE.rotor_speed_rpm - np.arange(8.0)[:, None]  # row k is k rpm off
    found = {c.condition: c.score for c in condition_scores(TABLE, predicted, 0)}
    rows = {
        "all rows": [0, 1, 2, 3, 4, 5, 6, 7],
        "pump on": [0, 1, 6],
        "outside yaw turns": [0, 2, 3, 6, 7],
        "in yaw turns": [1, 5],
        "mean of rotors": [0, 1, 2, 3, 4, 5, 6, 7],
    }
    assert list(found) == list(rows)
    for name, expected in rows.items():
        by_hand = np.sqrt(np.mean(np.square(expected)))
        assert found[name].rmse_per_rotor_rpm == pytest.approx(
            [by_hand] * (1 if "mean" in name else 2)
        )
    nothing_sprayed = replace(TABLE, spraying=np.full(8, NAN))
    assert "pump on" not in {c.condition for c in condition_scores(nothing_sprayed, predicted, 0)}


def test_the_mean_of_rotors_forgives_what_they_exchange():
    predicted = TABLE.rotor_speed_rpm + np.array([50.0, -50.0])
    found = {c.condition: c.score for c in condition_scores(TABLE, predicted, 0)}
    assert found["all rows"].rmse_per_rotor_rpm == pytest.approx([50.0, 50.0])
    assert found["mean of rotors"].rmse_per_rotor_rpm == pytest.approx([0.0], abs=1e-9)


def test_the_training_domain_is_from_the_lowest_to_the_highest_known():
    domain = training_domain(TABLE)
    assert domain.airspeed == (1.0, 5.0)
    assert domain.tank_kg == (2.0, 9.0)
    assert domain.density == (1.0, 1.2)
    assert domain.wind_speed == (1.0, 3.0)
    assert np.isnan(domain.height_agl).all()
    assert domain.flights == ("a", "b", "c")
    one_height = replace(TABLE, height_agl=np.array([7.0] + [NAN] * 7))
    assert training_domain(one_height).height_agl == (7.0, 7.0)


def test_what_the_paper_prints_and_the_usual_settings():
    # Drones 2024, 8, 246.
    assert training.PAPER_R2 == (0.728, 0.719, 0.726)
    assert (training.PAPER_LOWEST_LOSS, training.PAPER_BEST_EPOCH) == (0.27, 147)
    usual = TrainSettings()
    assert (usual.members, usual.seed, usual.coverage) == (5, 0, 0.9)


def test_networks_are_named_and_counted_from_one():
    settings = TrainSettings(members=3)
    assert settings.names() == [
        "split by samples",
        "split by flights",
        "member 1 of 3",
        "member 2 of 3",
        "member 3 of 3",
    ]


def test_settings_reach_the_training():
    airframe = load_airframe("topxgun-f16-sitl")
    tracks = sorties(10)
    settings = TrainSettings(
        splits=("flights",),
        members=3,
        seed=4,
        coverage=0.8,
        net=NetConfig(hidden=(3,), max_epochs=1),
    )
    trained = train(tracks, airframe, settings, date="2025-06-01", version="")
    model = trained.model
    assert model.description.endswith("from 10 flights, trained 2025-06-01")
    assert model.interval is not None
    assert model.training is not None
    assert model.network is not None
    assert model.interval.coverage == 0.8
    assert model.interval.flights == 10
    assert model.interval.measured is not None
    assert (model.training.seed, model.training.members) == (4, 3)
    assert [w.shape[2] for w in model.network.weights[:-1]] == [3]
    # The interval is that of flights left out, about the spread of all members.
    samples = gather(tracks)
    left_out = np.full(samples.rotor_speed_rpm.shape, NAN)
    for fold in trained.folds:
        rows = np.isin(samples.flight, fold.flights)
        assert fold.model.network is not None
        asked = samples.airspeed[rows], samples.tank_kg[rows]
        left_out[rows] = ensemble_speed(fold.model.network, *asked)[0]
    spread = ensemble_speed(model.network, samples.airspeed, samples.tank_kg)[1]
    shown = (samples.rotor_speed_rpm - left_out, spread, samples.airspeed, samples.flight)
    assert model.interval.factor == pytest.approx(calibrate(*shown, coverage=0.8).factor)
    by_hand = measure_coverage(*shown, coverage=0.8)
    assert by_hand is not None
    assert model.interval.measured.width_rpm == pytest.approx(by_hand.width_rpm)
    assert model.training.rows - model.training.learnt_rows == sum(
        int(turning_rows(t)[(t.time_s > 7.5) & (t.time_s < 50.5)].sum()) for t in tracks
    )
    other = train(tracks, airframe, replace(settings, seed=5), date="", version="").model
    assert other.network is not None
    assert not np.array_equal(other.network.weights[0], model.network.weights[0])
    # Members differ by their seeds and rows.
    first, second, third = model.network.weights[0]
    assert not np.array_equal(first, second)
    assert not np.array_equal(second, third)


@pytest.mark.parametrize(
    "turning",
    [
        {0, 1, 2, 3},
        {0},  # all that two of three members would be stopped by
        {1},  # all that one member would learn from
    ],
)
def test_members_that_have_nothing_but_turns_cannot_be_made(turning):
    spinning = [
        replace(t, angular_rate_frd=np.tile([0.0, 0.0, 1.0 * (k in turning)], (t.time_s.size, 1)))
        for k, t in enumerate(sorties(4))
    ]
    settings = TrainSettings(members=3, net=NetConfig(max_epochs=1))
    with pytest.raises(
        DataError, match="no row outside yaw turns; give flights with straight legs"
    ):
        train(spinning, load_airframe("topxgun-f16-sitl"), settings, date="", version="")


def test_each_network_begins_from_its_own_seed(monkeypatch):
    seeds = []

    def seen(*args, seed, **given):
        seeds.append(seed)
        return fit_network(*args, seed=seed, **given)

    monkeypatch.setattr(training, "fit_network", seen)
    settings = TrainSettings(members=3, seed=4, net=NetConfig(hidden=(2,), max_epochs=1))
    train(sorties(4), load_airframe("topxgun-f16-sitl"), settings, date="", version="")
    assert seeds == [4, 4, 5, 6, 7]  # two splits, then the members
    seeds.clear()
    members = replace(settings, splits=())
    train(sorties(4), load_airframe("topxgun-f16-sitl"), members, date="", version="")
    assert seeds == [5, 6, 7]  # the same members, as `learn` makes them


def test_a_fold_knows_nothing_of_the_flights_that_it_leaves_out():
    """Each flight is faster than the one before: what is known of airspeeds gives it away."""
    airframe = load_airframe("topxgun-f16-sitl")
    tracks = [
        replace(t, airspeed=t.airspeed + 3.0 * k, pressure=np.full(t.time_s.size, 9e4 + 2e3 * k))
        for k, t in enumerate(made_flights(4))
    ]
    settings = TrainSettings(splits=(), members=4, net=NetConfig(hidden=(2,), max_epochs=1))
    folds = train(tracks, airframe, settings, date="", version="").folds
    assert sorted(f for fold in folds for f in fold.flights) == [0, 1, 2, 3]
    for fold in folds:
        rest = [t for k, t in enumerate(tracks) if k not in fold.flights]
        alone, samples = fit_forward_flight(rest, airframe), gather(rest)
        assert alone is not None
        assert fold.model.forward_flight == alone
        assert fold.model.reference_density == float(np.median(samples.density))
        assert fold.model.training_domain is not None
        assert fold.model.training_domain.flights == samples.flights
        assert fold.model.training_domain.airspeed == training_domain(samples).airspeed
