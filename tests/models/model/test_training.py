"""Training: honest rows, splits that share nothing, intervals that hold, and the shipped model."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.reports.margin.summary import model_use
from thrustmargin.models.errors import AirframeError, DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model, shipped_model
from thrustmargin.models.model.rotor_model import Basis, predict
from thrustmargin.models.model.training import TrainSettings, slow_rows, train
from thrustmargin.models.network.network import NetConfig, fit_network
from thrustmargin.models.network.records import (
    gather,
    member_splits,
    split_by_flight,
    split_by_samples,
)
from thrustmargin.models.network.validity import (
    calibrate,
    flights_needed,
    hierarchical_quantile,
    measure_coverage,
    student_quantile,
)
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.physics.flight_phases import training_rows, turning_rows
from thrustmargin.models.scores import error_terms, r2

F16 = load_airframe("topxgun-f16-sitl")
QUICK = TrainSettings(net=NetConfig(max_epochs=2), members=3)


def sortie(seed=0, name="sortie", seconds=60.0, rotors=4) -> FlightTrack:
    """Take-off, level flight at 3 m with a yaw turn from 30 to 33 s, landing; 10 Hz."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 0.1)
    height = np.interp(time_s, [2, 8, seconds - 10, seconds - 2], [0.0, 3.0, 3.0, 0.0])
    velocity = np.zeros((time_s.size, 3))
    velocity[:, 2] = -np.gradient(height, time_s)
    tank = np.interp(time_s, [8, seconds - 10], [rng.uniform(8, 16), rng.uniform(1, 7)])
    rate = np.zeros((time_s.size, 3))
    rate[(time_s >= 30) & (time_s < 33), 2] = 0.5
    speed = np.sqrt((21.1 + tank) * 9.80665 / rotors / 2.011e-5)
    return FlightTrack.of(
        name=name,
        time_s=time_s,
        rotor_count=rotors,
        height_agl=height,
        velocity_ned=velocity,
        airspeed=np.full(time_s.size, rng.uniform(2, 6)),
        tank_kg=tank,
        angular_rate_frd=rate,
        pressure=np.full(time_s.size, 101_325.0),
        rotor_speed_rpm=speed[:, None] + rng.normal(0, 8, (time_s.size, rotors)),
        flying=height > 0.2,
    )


def sorties(count):
    return [sortie(seed, name=f"flight {seed}") for seed in range(count)]


@pytest.mark.parametrize(("rate", "every"), [(10.0, 1), (25.0, 1), (50.0, 2), (100.0, 4)])
def test_a_network_learns_from_twenty_five_rows_a_second_at_most(rate, every):
    first, slow = sortie(), sortie(1, name="slow")
    fast = replace(first, time_s=first.time_s * 10.0 / rate)
    samples = gather([fast, slow])
    keep = slow_rows([fast, slow], samples)
    of_fast = np.flatnonzero(samples.flight == 0)
    assert np.flatnonzero(keep[of_fast]).tolist() == list(range(0, of_fast.size, every))
    assert keep[samples.flight == 1].all()


@pytest.mark.slow
def test_every_network_of_a_fast_table_is_fitted_to_its_slow_rows(monkeypatch):
    tracks = [replace(t, time_s=t.time_s / 10.0) for t in sorties(4)]  # 100 Hz
    rows, used = gather(tracks).flight.size, []

    def counted(*given, training, validation, **settings):
        used.append(training.size + validation.size)
        return fit_network(*given, training=training, validation=validation, **settings)

    monkeypatch.setattr("thrustmargin.models.model.training.fit_network", counted)
    train(tracks, F16, QUICK, date="2026-01-01", version="0")
    assert len(used) == 2 + QUICK.members
    assert max(used) < 0.3 * rows


def test_take_off_and_landing_are_not_learnt_from():
    track = sortie()
    kept = track.time_s[training_rows(track)]
    assert kept[0] == pytest.approx(8.0, abs=0.2)
    assert kept[-1] == pytest.approx(50.0, abs=0.2)
    assert np.all(np.diff(kept) < 0.11)  # the yaw turn stays


def test_climbs_between_level_parts_stay():
    track = sortie()
    climb = track.velocity_ned.copy()
    climb[(track.time_s > 20) & (track.time_s < 25), 2] = -2.0
    np.testing.assert_array_equal(
        training_rows(replace(track, velocity_ned=climb)), training_rows(track)
    )


def test_the_height_stands_in_for_an_unreported_climb_rate():
    track = sortie()
    blind = replace(track, velocity_ned=np.full_like(track.velocity_ned, np.nan))
    assert np.count_nonzero(training_rows(blind) != training_rows(track)) <= 4
    nothing = replace(blind, height_agl=np.full_like(track.height_agl, np.nan))
    np.testing.assert_array_equal(training_rows(nothing), track.flying)


@pytest.mark.parametrize("channel", ["airspeed", "tank_kg", "rotor_speed_rpm"])
def test_rows_with_an_unknown_input_or_output_are_left_out(channel):
    track = sortie()
    values = getattr(track, channel).copy()
    values[300:310] = np.nan
    kept = training_rows(replace(track, **{channel: values}))
    assert not kept[300:310].any()
    assert np.count_nonzero(kept != training_rows(track)) == 10


def test_a_rotor_at_zero_is_not_learnt_from():
    track = sortie()
    speeds = track.rotor_speed_rpm.copy()
    speeds[300:310, 2] = 0.0
    assert not training_rows(replace(track, rotor_speed_rpm=speeds))[300:310].any()


def test_a_yaw_turn_counts_with_a_second_on_either_side():
    track = sortie()
    times = track.time_s[turning_rows(track)]
    assert times[0] == pytest.approx(29.0, abs=0.11)
    assert times[-1] == pytest.approx(33.9, abs=0.11)


def test_gathered_rows_know_their_flight_and_one_flight_twice_is_refused():
    tracks = sorties(3)
    samples = gather(tracks)
    assert samples.flights == ("flight 0", "flight 1", "flight 2")
    for index, track in enumerate(tracks):
        np.testing.assert_array_equal(
            samples.tank_kg[samples.flight == index], track.tank_kg[training_rows(track)]
        )
    with pytest.raises(DataError, match="copy and flight 1 are the same flight"):
        gather([*tracks, replace(tracks[1], name="copy")])
    assert gather([replace(t, name="x") for t in tracks]).flights == ("x", "x (2)", "x (3)")


def test_why_no_row_is_usable_is_said():
    bare = FlightTrack.of(name="bare", time_s=np.arange(10.0), rotor_count=4)
    with pytest.raises(DataError, match=r"rotor speeds \(ESC telemetry\), airspeed, a tank level"):
        gather([bare])
    parked = replace(sortie(), flying=np.zeros(600, dtype=np.bool_))
    with pytest.raises(DataError, match="none is steadily in the air"):
        gather([parked])


@pytest.mark.parametrize("flights", [3, 4, 10, 27])
@pytest.mark.parametrize("seed", [0, 1])
def test_sets_split_by_flight_share_no_flight_and_cover_all(flights, seed):
    samples = gather(sorties(flights))
    splits = [split_by_flight(samples, seed), *member_splits(samples, 5, seed)]
    for split in (*splits, *member_splits(samples, 3, seed)):
        sets = [
            set(samples.flight[rows]) for rows in (split.training, split.validation, split.test)
        ]
        assert all(sets)
        assert sum(len(s) for s in sets) == len(set.union(*sets)) == flights
    left_out = [set(samples.flight[s.test]) for s in splits[1:]]
    assert set.union(*left_out) == set(range(flights))
    if flights >= 5:
        assert sum(len(s) for s in left_out) == flights  # each by one member


def test_a_split_by_samples_is_70_15_15_of_rows_with_none_twice():
    samples = gather(sorties(4))
    split = split_by_samples(samples, 0)
    sizes = np.array([split.training.size, split.validation.size, split.test.size])
    np.testing.assert_allclose(sizes / samples.flight.size, [0.70, 0.15, 0.15], atol=0.001)
    rows = np.concatenate([split.training, split.validation, split.test])
    np.testing.assert_array_equal(np.sort(rows), np.arange(samples.flight.size))
    for part in (split.training, split.validation, split.test):
        assert set(samples.flight[part]) == {0, 1, 2, 3}


def test_splits_follow_the_seed():
    samples = gather(sorties(8))
    for make in (split_by_samples, split_by_flight):
        np.testing.assert_array_equal(make(samples, 1).test, make(samples, 1).test)
        assert not np.array_equal(make(samples, 1).test, make(samples, 2).test)


def test_an_ensemble_of_two_is_refused():
    with pytest.raises(DataError, match="2 members"):
        member_splits(gather(sorties(4)), 2, 0)


def test_two_flights_are_too_few_to_split_by_flight():
    with pytest.raises(DataError, match=r"2 flights with usable rows \(flight 0, flight 1\)"):
        train(sorties(2), F16, QUICK, date="2025-06-01", version="0")


def test_the_airframe_must_have_the_flights_rotors():
    with pytest.raises(AirframeError, match="4 rotors, airframe agras-t40 has 8"):
        train(sorties(3), load_airframe("agras-t40"), QUICK, date="2025-06-01", version="0")


def from_outputs(track: FlightTrack) -> FlightTrack:
    return replace(track, standard_errors={"rotor_speed_rpm": 0.02 * track.rotor_speed_rpm})


@pytest.mark.slow
def test_speeds_from_motor_outputs_are_learnt_from_alone_and_the_model_remembers(tmp_path):
    inferred = [from_outputs(track) for track in sorties(3)]
    with pytest.raises(DataError, match=r"two kinds.*measured; .*from motor outputs"):
        train([*sorties(3)[:2], inferred[2]], F16, QUICK, date="2025-06-01", version="0")
    model = train(inferred, F16, QUICK, date="2025-06-01", version="0").model
    save_model(model, tmp_path / "m.safetensors")
    kept = load_model(tmp_path / "m.safetensors")
    assert kept.training is not None
    assert kept.training.speed == "from motor outputs"
    assert kept.description.endswith("on rotor speeds from motor outputs")
    measured, same = (model_use(analyse(t, kept)) for t in (sorties(1)[0], inferred[0]))
    assert "it learnt from rotor speeds from motor outputs" in measured["model_words"][-1]
    assert not any("learnt from" in words for words in same["model_words"])


@pytest.mark.slow
def test_training_keeps_its_settings_and_fills_the_model(tmp_path):
    tracks, seen = sorties(6), []
    result = train(
        tracks, F16, QUICK, date="2025-06-01", version="1.2", progress=lambda *e: seen.append(e)
    )
    model = result.model
    assert [c.name for c in result.curves] == QUICK.names()
    assert [name for name, epoch, _ in seen if epoch == 1] == QUICK.names()
    assert model.network is not None
    assert model.network.members == 3
    assert model.training_domain is not None
    assert model.training_domain.flights == tuple(t.name for t in tracks)
    assert model.training is not None
    assert (model.training.date, model.training.version) == ("2025-06-01", "1.2")
    assert [s.split for s in model.training.splits] == ["samples", "flights"]
    assert model.training.left_out[0].score.flights == 6
    assert model.reference_density == pytest.approx(1.225, abs=0.001)
    assert np.isnan(model.reference_voltage)
    save_model(model, tmp_path / "m.safetensors")
    assert to_json_values(load_model(tmp_path / "m.safetensors").training) == to_json_values(
        model.training
    )
    again = train(tracks, F16, QUICK, date="2025-06-01", version="1.2").model
    for a, b in zip(weights(model), weights(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert again.interval == model.interval


def test_each_fold_is_made_of_the_other_flights_alone():
    tracks = [FlightTrack.of(name="empty", time_s=np.arange(9.0), rotor_count=4), *sorties(6)]
    folds = train(tracks, F16, QUICK, date="", version="").folds
    assert sorted(f for fold in folds for f in fold.flights) == [1, 2, 3, 4, 5, 6]
    tracks[folds[0].flights[0]] = sortie(99, name="another")
    kept = []
    for number, fold in enumerate(train(tracks, F16, QUICK, date="", version="").folds):
        assert fold.flights == folds[number].flights
        domain = fold.model.training_domain
        assert domain is not None
        assert set(domain.flights).isdisjoint(tracks[f].name for f in fold.flights)
        pairs = zip(weights(fold.model), weights(folds[number].model), strict=True)
        same = all(np.array_equal(a, b) for a, b in pairs)
        kept.append(same and domain == folds[number].model.training_domain)
    assert kept[0]  # what has not seen the other flight is the same model
    assert not any(kept[1:])


def test_members_learn_nothing_from_yaw_turns_but_are_judged_on_them():
    def bent(track):
        speeds = track.rotor_speed_rpm.copy()
        speeds[turning_rows(track)] += [400.0, 400.0, -400.0, -400.0]
        return replace(track, rotor_speed_rpm=speeds)

    plain = train(sorties(9), F16, QUICK, date="", version="").model
    turned = train([bent(t) for t in sorties(9)], F16, QUICK, date="", version="").model
    for a, b in zip(weights(plain), weights(turned), strict=True):
        np.testing.assert_array_equal(a, b)
    assert turned.training is not None
    scores = {c.condition: c.score for c in turned.training.left_out}
    assert scores["in yaw turns"].bias_per_rotor_rpm[0] > 300.0
    assert scores["in yaw turns"].bias_per_rotor_rpm[3] < -300.0
    assert turned.interval is not None
    assert plain.interval is not None
    assert max(map(max, turned.interval.scatter_rpm)) > max(map(max, plain.interval.scatter_rpm))


def weights(model):
    assert model.network is not None
    return model.network.weights


def exchangeable_flights(rng, flights, rows=80):
    """Residuals of flights that each have their own bias and scatter: correlated within."""
    flight = np.repeat(np.arange(flights), rows)
    bias = rng.normal(0, 15, flights)[flight]
    scatter = rng.uniform(5, 30, flights)[flight]
    airspeed = rng.uniform(0, 6, flight.size)
    slow = np.where(airspeed < 2, 3.0, 1.0)
    residual = ((bias + scatter * rng.normal(size=flight.size)) * slow)[:, None] * np.ones(2)
    return residual, np.full((flight.size, 2), 2.0), airspeed, flight


def test_the_interval_holds_its_coverage_on_new_exchangeable_flights():
    rng = np.random.default_rng(3)
    held, by_rows = [], []
    for _ in range(60):
        residual, spread, airspeed, flight = exchangeable_flights(rng, 13)
        new = flight == 12
        interval = calibrate(
            residual[~new], spread[~new], airspeed[~new], flight[~new], coverage=0.9
        )
        half = interval.half_width_rpm(airspeed[new], spread[new])
        held.append(np.mean(np.abs(residual[new]) <= half))
        by_rows.append(np.mean(np.abs(residual[new]) <= half / np.array(interval.factor)))
    # 0.9 x 13/12 is the quantile in use; two standard errors of 60 flights of scattered coverage
    margin = 2 * np.std(held) / np.sqrt(len(held))
    assert np.mean(held) > 0.9 - margin
    assert np.mean(held) < 0.99
    assert np.mean(by_rows) < np.mean(held)  # ignoring the flights would promise too much


def test_measured_coverage_is_of_flights_left_out():
    rng = np.random.default_rng(4)
    residual, spread, airspeed, flight = exchangeable_flights(rng, 20)
    measured = measure_coverage(residual, spread, airspeed, flight, coverage=0.9)
    assert measured is not None
    assert len(measured.per_flight) == 20
    assert measured.mean == pytest.approx(np.mean(measured.per_flight))
    out = flight == 7
    alone = calibrate(residual[~out], spread[~out], airspeed[~out], flight[~out], coverage=0.9)
    half = alone.half_width_rpm(airspeed[out], spread[out])
    assert measured.per_flight[7] == np.mean(np.abs(residual[out]) <= half)


def test_the_interval_widens_where_the_aircraft_scatters_and_where_members_disagree():
    rng = np.random.default_rng(5)
    residual, spread, airspeed, flight = exchangeable_flights(rng, 12)
    interval = calibrate(residual, spread, airspeed, flight, coverage=0.9)
    slow, fast = interval.half_width_rpm(np.array([1.0, 5.0]), np.zeros((2, 2)))
    assert np.all(slow > 2.0 * fast)
    torn = interval.half_width_rpm(np.array([5.0]), np.full((1, 2), 100.0))
    assert np.all(torn > 164.0)


def test_no_interval_is_made_up_from_too_few_flights():
    assert [flights_needed(c) for c in (0.5, 0.8, 0.9, 0.95)] == [1, 4, 9, 19]
    rng = np.random.default_rng(6)
    for flights, finite, measured in ((2, 0, 0), (3, 1, 0), (4, 1, 1), (8, 1, 1), (9, 1, 0)):
        residual, spread, airspeed, flight = exchangeable_flights(rng, flights)
        interval = calibrate(residual, spread, airspeed, flight, coverage=0.9)
        assert np.isfinite(interval.factor).all() == finite
        assert np.isfinite(interval.half_width_rpm(airspeed, spread)).all() == finite
        known = measure_coverage(residual, spread, airspeed, flight, coverage=0.9)
        assert (known is not None) == measured


def test_few_flights_weigh_alike_and_get_students_t():
    scores, flight = np.array([3.0, 3.0, 0.0, 4.0]), np.array([0, 0, 1, 2])
    # mean squares 9, 0, 16 of the flights, and t of 3 degrees of freedom at 95 %: 2.353363
    expected = 2.353363 * (25.0 / 3.0) ** 0.5
    assert student_quantile(scores, flight, 0.9) == pytest.approx(expected, rel=1e-6)
    assert student_quantile(scores[:3], flight[:3], 0.9) == np.inf


@pytest.mark.parametrize(("flights", "steady"), [(3, True), (5, True), (3, False), (5, False)])
def test_the_interval_of_few_flights_holds_its_coverage(flights, steady):
    """Flights off by one normal draw get just the coverage, others no less."""
    rng = np.random.default_rng(8)
    held = []
    for _ in range(400):
        flight = np.repeat(np.arange(flights + 1), 20)
        scores = np.abs(rng.normal(0, 15, flights + 1)[flight])
        if not steady:
            scores = np.abs(rng.uniform(5, 30, flights + 1)[flight] * rng.normal(size=flight.size))
        new = flight == flights
        held.append(np.mean(scores[new] <= student_quantile(scores[~new], flight[~new], 0.9)))
    error = np.std(held) / np.sqrt(len(held))
    assert np.mean(held) > 0.9 - 2.0 * error
    if steady:
        assert np.mean(held) < 0.9 + 2.0 * error


def test_a_flight_weighs_one_however_many_rows_it_has():
    scores = np.concatenate([np.full(1000, 1.0), [2.0], [3.0], [4.0]])
    flight = np.concatenate([np.zeros(1000, dtype=np.intp), [1, 2, 3]])
    assert hierarchical_quantile(scores, flight, 0.2) == 1.0
    assert hierarchical_quantile(scores, flight, 0.3) == 2.0
    assert hierarchical_quantile(scores, flight, 0.6) == 3.0
    assert hierarchical_quantile(scores, flight, 0.8) == 4.0
    assert hierarchical_quantile(scores, flight, 0.81) == np.inf


def test_the_shipped_model_predicts_the_recorded_flights_better_than_their_mean(sitl_logs):
    model = shipped_model()
    parts = []
    for name in ("v2_m4_q1.5", "v4_m10_q2.5", "v4_m16_q2.5", "v6_m10_q3.5"):
        track = read_log(sitl_logs / "campaign" / f"{name}.tlog").track
        rows = training_rows(track)
        predicted = predict(model, track, track_air(track).density)
        assert (predicted.basis[rows] == Basis.NETWORK).mean() > 0.99
        measured, speed = track.rotor_speed_rpm[rows], predicted.rotor_speed_rpm[rows]
        assert r2(error_terms(measured, speed).sum(axis=0)).min() > 0.0
        parts.append((measured, speed))
        straight = rows & ~turning_rows(track)
        error = (track.rotor_speed_rpm - predicted.rotor_speed_rpm)[straight]
        assert np.sqrt(np.mean(error**2)) < 25.0
    measured, speed = (np.concatenate(side) for side in zip(*parts, strict=True))
    assert r2(error_terms(measured, speed).sum(axis=0)).min() > 0.5


def test_the_shipped_models_interval_holds_on_a_flight_outside_the_campaign(sitl_logs):
    track = read_log(sitl_logs / "onset" / "reference.tlog").track
    predicted = predict(shipped_model(), track, track_air(track).density)
    rows = training_rows(track) & (predicted.basis == Basis.NETWORK)
    assert rows.sum() > 500
    inside = (track.rotor_speed_rpm >= predicted.lower_rpm) & (
        track.rotor_speed_rpm <= predicted.upper_rpm
    )
    assert inside[rows].mean() > 0.85
