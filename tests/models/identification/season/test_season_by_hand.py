"""A season's sums and what is read from them, against the rows that the sums are of."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.models.made_flights import F16, curve_model, made_flight
from thrustmargin.models.effects import effects_for
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import TrialEffect, predicted_modes
from thrustmargin.models.identification.season.change_points import penalty_of, spread_beyond
from thrustmargin.models.identification.season.flight_sums import (
    FlightEvidence,
    SeasonSums,
    flight_sums,
    from_arrays,
    season_sums,
    to_arrays,
)
from thrustmargin.models.identification.season.season_changes import SeasonChanges, season_changes
from thrustmargin.models.identification.sets.search_space import search_space

LOSS, SHARE = "rotor_degradation.loss@1", "rotor_degradation.torque_share@1"
#: absent, lower, upper, scale, smallest, 1 of a flight's own, 1 of a shape
VALUES = {
    "extra_mass.mass": (0.0, -5.0, 5.0, 1.0, 0.1, 0.0, 0.0),
    "wind.north": (0.0, -9.0, 9.0, 2.0, 0.5, 1.0, 0.0),
    "tank_scale.gain": (1.0, 0.5, 2.0, 0.4, 0.0, 0.0, 0.0),
    LOSS: (0.0, -0.3, 0.7, 0.05, 0.004, 0.0, 0.0),
    SHARE: (0.0, -1.0, 1.0, 0.5, 0.0, 0.0, 1.0),
}
NAMES = tuple(VALUES)
MASS, GAIN = "extra_mass.mass", "tank_scale.gain"
ROWS, PER_VALUE = 200, np.array([4.0, 2.0, 10.0, 100.0, 1.0])


@dataclass(frozen=True)
class Rows:
    """The rows of a flight, in units of their noise: J, the bend of the loss, and the residual."""

    columns: Floats  # (N, q)
    bend: Floats  # (N,)
    residual: Floats  # (N,)
    names: tuple[str, ...] = NAMES

    @property
    def evidence(self) -> FlightEvidence:
        bent = (self.names.index(LOSS),) if LOSS in self.names else ()
        bends = self.bend[:, None][:, : len(bent)]
        whole = np.concatenate([self.columns, bends, self.residual[:, None]], axis=1)
        gram = whole.T @ whole
        return FlightEvidence(
            names=self.names,
            limits=np.array([VALUES[name] for name in self.names]),
            bent=bent,
            gram=gram,
            known=1.25 * np.diag(gram)[: len(self.names)],
            seconds=200.0,
            means=ROWS,
            rotor_count=4,
            of_outputs=False,
        )


def flown(seed: int, noise: float = 1.0, **values: float) -> Rows:
    """A flight with values as its rows show them; a loss bends."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(ROWS, len(NAMES))) * PER_VALUE / np.sqrt(ROWS)
    bend = 50.0 * rng.normal(size=ROWS) / np.sqrt(ROWS)
    at = np.array([values.get(name.partition(".")[0], 0.0) for name in NAMES])
    at[NAMES.index(SHARE)] = 0.0
    loss = at[NAMES.index(LOSS)]
    residual = columns @ at + bend * loss**2 + noise * rng.normal(size=ROWS)
    return Rows(columns, bend, residual)


def place(sums: SeasonSums, name: str) -> int:
    return sums.names.index(name)


def of(flights: list[Rows]) -> SeasonChanges:
    return season_changes(season_sums([one.evidence for one in flights]))


def without_own(one: Rows, of_bent: float = 0.0) -> tuple[Floats, Floats]:
    """[J r] about a loss with the flight's own wind as noise of its usual size: V^-1/2 [J r]."""
    columns = one.columns.copy()
    columns[:, NAMES.index(LOSS)] += 2.0 * of_bent * one.bend
    residual = one.residual + of_bent**2 * one.bend
    wind = columns[:, NAMES.index("wind.north")]
    covariance = np.eye(ROWS) + VALUES["wind.north"][3] ** 2 * np.outer(wind, wind)
    kept = np.delete(columns, NAMES.index("wind.north"), axis=1)
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    return root @ kept, root @ residual


@pytest.mark.parametrize("bent", [0.0, 0.08])
def test_sums_are_those_of_rows_in_which_a_flights_own_values_are_noise(bent):
    flights = [flown(k, rotor_degradation=0.08, wind=1.0 + k) for k in range(3)]
    about = {LOSS: np.full(3, bent)} if bent else {}
    sums = season_sums([one.evidence for one in flights], about)
    assert sums.names == tuple(sorted(set(NAMES) - {"wind.north"}))
    order = [place(sums, name) for name in NAMES if name != "wind.north"]
    for k, one in enumerate(flights):
        columns, residual = without_own(one, bent)
        found = sums.information[k][np.ix_(order, order)]
        np.testing.assert_allclose(found, columns.T @ columns, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(sums.pull[k, order], columns.T @ residual)
        assert sums.squares[k] == pytest.approx(residual @ residual)
        # What is known without model uncertainty: 1.25 of the rows', as steep as at the loss.
        steep = one.columns.copy()
        steep[:, NAMES.index(LOSS)] += 2.0 * bent * one.bend
        rows = np.delete(np.sum(steep**2, axis=0), NAMES.index("wind.north"))
        np.testing.assert_allclose(sums.known[k, order], 1.25 * rows)
    np.testing.assert_allclose(sums.total, sums.information.sum(axis=0))
    assert sums.limits[place(sums, GAIN)].tolist() == list(VALUES[GAIN])
    assert sums.share_of(place(sums, LOSS)) == place(sums, SHARE)
    assert sums.share_of(place(sums, MASS)) is None
    assert {sums.names[k] for k in sums.main} == {MASS, GAIN, LOSS}


def test_a_value_that_a_flight_does_not_know_is_zero_there_and_keeps_its_place():
    rest = [k for k, name in enumerate(NAMES) if name != GAIN]
    one = flown(1)
    part = Rows(one.columns[:, rest], one.bend, one.residual, tuple(NAMES[k] for k in rest))
    sums = season_sums([part.evidence, flown(2).evidence])
    gain, mass = place(sums, GAIN), place(sums, MASS)
    assert not sums.information[0, gain].any()
    assert sums.pull[0, gain] == sums.known[0, gain] == 0.0
    assert sums.information[0, mass, mass] > 0.0 < sums.information[1, gain, gain]
    assert sums.share_of(place(sums, LOSS)) == place(sums, SHARE)
    other = replace(flown(3).evidence, rotor_count=6)
    with pytest.raises(DataError, match="numbers of rotors"):
        season_sums([one.evidence, other])


def test_what_a_flight_says_of_a_value_is_beside_the_seasons_of_all_others():
    flights = [flown(k, extra_mass=0.5, tank_scale=0.1) for k in range(2)]
    sums = season_sums([one.evidence for one in flights])
    mass, gain = place(sums, MASS), place(sums, GAIN)
    curves = np.zeros((2, len(sums.names)))
    curves[:, mass], curves[:, gain] = 0.4, 0.2
    value, error = sums.estimates(mass, curves)
    for k, one in enumerate(flights):
        columns, residual = without_own(one)
        names = [name for name in NAMES if name != "wind.north"]
        own = columns[:, names.index(MASS)]
        left = residual - 0.2 * columns[:, names.index(GAIN)]
        assert value[k] == pytest.approx(own @ left / (own @ own))
        assert error[k] == pytest.approx((own @ own) ** -0.5)
    known = sums.known[:, mass]
    beyond = np.sqrt(error**2 - 1.0 / known)
    np.testing.assert_allclose(sums.uncertainty(mass), beyond)
    less = replace(sums, known=np.zeros_like(sums.known))  # never below nothing
    np.testing.assert_array_equal(less.uncertainty(mass), 0.0)


def test_sums_go_to_arrays_and_back_with_all_that_they_say():
    one = replace(flown(1).evidence, of_outputs=True, means=77, seconds=12.5, rotor_count=6)
    back = from_arrays(to_arrays(one))
    np.testing.assert_array_equal(back.gram, one.gram)
    np.testing.assert_array_equal(back.known, one.known)
    kept = ("names", "bent", "seconds", "means", "rotor_count", "of_outputs")
    assert [getattr(back, k) for k in kept] == [getattr(one, k) for k in kept]
    np.testing.assert_array_equal(back.limit("scale"), [v[3] for v in VALUES.values()])
    assert len(to_arrays(one)["gram"]) == 7 * 8 / 2  # 5 values, a bend and the residual, once each
    for broken in ("known", "limits", "facts", "names"):
        with pytest.raises(DataError):
            from_arrays({**to_arrays(one), broken: np.zeros(3)})
        with pytest.raises(DataError):
            from_arrays({k: v for k, v in to_arrays(one).items() if k != broken})


def test_about_a_loss_rows_are_as_an_aircraft_has_them_that_lost_it():
    one = flown(4, noise=0.0, rotor_degradation=0.1)
    k = NAMES.index(LOSS)
    gram = one.evidence.linearise_at(np.where(np.arange(5) == k, 0.1, 0.0))
    steep = one.columns[:, k] + 0.2 * one.bend
    assert gram[k, k] == pytest.approx(steep @ steep)
    # r + 0.1² Q = (J + 0.2 Q) 0.1, exactly.
    assert gram[k, -1] / gram[k, k] == pytest.approx(0.1)
    assert gram.shape == (6, 6)


def test_columns_of_a_rotor_are_its_loss_how_that_bends_and_how_torque_goes_with_it():
    """By differences of the prediction: slope at no loss, what 10 % of loss do beyond it over
    0.1², and by how much another share of the torque changes the slope."""
    model, track = curve_model(), made_flight(3)
    evidence = flight_sums(model, track)
    space = search_space(model, [track], effects_for(F16))
    (worn,) = (c for c in space.candidates if c.key == "rotor_degradation@3")

    def done(loss: float, share: float) -> Floats:
        return predicted_modes(
            space.reduced, [TrialEffect(candidate=worn, values=np.array([[loss, share]]))]
        )

    def slope(share: float) -> Floats:
        return (done(1e-5, share) - done(-1e-5, share)) / 2e-5

    bend = (done(0.1, 1.0) - done(0.0, 1.0) - 0.1 * slope(1.0)) / 0.1**2
    residual = space.reduced.mode_amplitudes(space.reduced.measured_rpm) - done(0.0, 1.0)
    columns = [slope(1.0), (slope(1.75) - slope(1.0)) / 0.75, bend, residual]
    sums = space.nuisance.sums(np.stack(columns, axis=2))
    expected = space.nuisance.marginalise().reduce(sums)
    loss, share = (
        evidence.names.index(f"rotor_degradation.{of}@3") for of in ("loss", "torque_share")
    )
    at = [loss, share, len(evidence.names) + evidence.bent.index(loss), -1]
    size = np.sqrt(np.diag(expected))
    off = (evidence.gram[np.ix_(at, at)] - expected) / np.outer(size, size)
    np.testing.assert_allclose(off, 0.0, atol=1e-4)
    assert evidence.limits[share].tolist() == [0.0, -1.0, 1.0, 0.75, 0.0, 0.0, 1.0]
    kept = worn.parameters[0]
    by_hand = [0.0, kept.lower, kept.upper, 0.05, 0.004, 0.0, 0.0]
    assert evidence.limits[loss].tolist() == by_hand
    np.testing.assert_allclose(evidence.known[[loss, share]], np.diag(sums[1])[:2], rtol=1e-4)
    time_s = space.reduced.channels.time_s
    assert (evidence.seconds, evidence.means) == (time_s[-1] - time_s[0], time_s.size)
    assert (evidence.rotor_count, evidence.of_outputs) == (4, False)


def least_squares(sums: SeasonSums, free: set[str]) -> Floats:
    """(q,) the means of all main values: `free` ones with their usual size as prior, the others
    with a sound aircraft's, each over the root of the number of flights."""
    flights, main = sums.flights, [int(k) for k in sums.main]
    size = [
        VALUES[sums.names[k]][3]
        if sums.names[k] in free
        else max(VALUES[sums.names[k]][4], 0.05 * VALUES[sums.names[k]][3])
        for k in main
    ]
    prior = np.diag(flights / np.square(size))
    found = np.zeros(len(sums.names))
    found[main] = np.linalg.solve(
        sums.total[np.ix_(main, main)] + prior, sums.pull.sum(axis=0)[main]
    )
    return found


@pytest.mark.parametrize("count", [12, 2])
def test_a_mass_in_all_flights_has_the_mean_of_least_squares_and_an_error_from_flights(count):
    flights = [flown(k, extra_mass=2.5, wind=1.0) for k in range(count)]
    sums = season_sums([one.evidence for one in flights])
    found = season_changes(sums)
    (mass,) = found.shared
    k, main = place(sums, MASS), [int(p) for p in sums.main]
    means = least_squares(sums, {MASS})
    assert (mass.name, mass.instead) == (MASS, ())
    assert mass.value == pytest.approx(means[k])
    # White's sandwich: each flight's own pull is what the mean leaves of it.
    at = main.index(k)
    size = [max(VALUES[n][4], 0.05 * VALUES[n][3]) for n in (sums.names[p] for p in main)]
    size[at] = VALUES[MASS][3]
    bread = np.linalg.inv(sums.total[np.ix_(main, main)] + np.diag(count / np.square(size)))
    left = sums.pull[:, main] - sums.information[:, main][:, :, main] @ means[main]
    variance = (bread @ left.T @ left @ bread)[at, at] * count / (count - 1)
    model = np.median(sums.uncertainty(k))
    assert mass.error == pytest.approx(np.hypot(np.sqrt(variance), model))
    trend = found.trend(MASS)
    assert trend is not None
    np.testing.assert_allclose(trend.curve, means[k])
    assert trend.now == pytest.approx(means[k])
    assert (trend.changes, trend.instead) == ((), ())


@pytest.mark.parametrize("count", [16, 24])
def test_a_trend_is_each_flights_own_estimate_with_errors_as_flights_scatter(count):
    flights = [flown(k, noise=2.0, tank_scale=0.02 * (k % 3)) for k in range(count)]
    flights[5] = flown(50, noise=0.2)
    sums = season_sums([one.evidence for one in flights])
    sums.information[9, :, place(sums, MASS)] = sums.information[9, place(sums, MASS)] = 0.0
    found = season_changes(sums)
    assert found.shared == ()
    means = np.repeat(least_squares(sums, set())[None], count, axis=0)
    for name in (MASS, GAIN, LOSS):
        trend = found.trend(name)
        assert trend is not None
        value, error = sums.estimates(place(sums, name), means)
        known = np.isfinite(value)
        error = np.maximum(error, np.median(error[known]))  # none is surer than the median
        error = error * spread_beyond(value[known], error[known])
        np.testing.assert_allclose(trend.value, value)
        np.testing.assert_allclose(trend.error[known], error[known])
        assert np.isinf(trend.error[~known]).all()
        recent = min(10, known.sum() // 2)  # the last ten, at most half of all
        share = np.sqrt(1.0 / recent + 1.0 / (known.sum() - recent))
        least = np.sqrt(penalty_of(count, 3)) * share * np.median(error[known])
        assert trend.least_seen == pytest.approx(least)
        assert trend.usual == max(VALUES[name][4], 0.05 * VALUES[name][3])
    assert found.trend("nothing.there") is None


@pytest.mark.parametrize("name", [MASS, GAIN, LOSS])
def test_a_step_of_a_value_is_that_values_and_dated(name):
    size = {MASS: 2.5, GAIN: 0.9, LOSS: 0.12}[name]
    key = name.partition(".")[0]
    flights = [flown(k, wind=1.0, **{key: size * (k >= 14)}) for k in range(24)]
    found = of(flights)
    assert [(t.name, [c.ramp for c in t.changes]) for t in found.trends if t.changes] == [
        (name, [False])
    ]
    trend = found.trends[0]
    (change,) = trend.changes
    assert (trend.name, change.flight, change.until) == (name, 14, 24)
    assert change.size == pytest.approx(size, rel=0.15)
    assert trend.now - trend.curve[0] == pytest.approx(size, rel=0.15)
    assert found.shared == ()


def test_a_step_is_counted_over_the_flights_that_say_nothing_of_it_too():
    flights = [flown(k, extra_mass=2.5 * (k >= 14)) for k in range(24)]
    sums = season_sums([one.evidence for one in flights])
    k = place(sums, MASS)
    for silent in (3, 20):
        sums.information[silent, k] = sums.information[silent, :, k] = 0.0
        sums.pull[silent, k] = 0.0
    sums = replace(sums, total=sums.information.sum(axis=0))
    (change,) = season_changes(sums).trends[0].changes
    assert (change.flight, change.until) == (14, 24)


def test_a_mean_that_no_aircraft_has_is_no_finding():
    """A gauge shows 1 where it is right and at most twice that: 0.9 more may be, 1.1 may not."""
    for off, named in ((0.9, [GAIN]), (1.1, [])):
        found = of([flown(k, noise=0.1, tank_scale=off) for k in range(8)])
        assert [one.name for one in found.shared] == named


def alike(one: Rows) -> Rows:
    """A flight in which a gauge's gain of 0.4 does nearly what 1 kg of mass does."""
    columns = one.columns.copy()
    mass, gain = (columns[:, NAMES.index(name)] for name in (MASS, GAIN))
    columns[:, NAMES.index(GAIN)] = 0.02 * gain + 2.5 * mass
    return replace(one, columns=columns)


def test_what_would_explain_these_flights_as_well_is_said_beside_a_change_and_a_mean():
    flights = [alike(flown(k, extra_mass=2.5 * (k >= 14))) for k in range(24)]
    (changed,) = (t for t in of(flights).trends if t.changes)
    assert {changed.name, *changed.instead} == {MASS, GAIN}
    (shared,) = of([alike(flown(k, extra_mass=2.0)) for k in range(12)]).shared
    assert {shared.name, *shared.instead} == {MASS, GAIN}


def test_two_changes_are_two_and_a_mean_beside_them_is_a_third():
    flights = [
        flown(
            k,
            extra_mass=1.5,
            tank_scale=0.9 * (k >= 20),
            rotor_degradation=0.012 * max(0.0, k - 9.0),
        )
        for k in range(30)
    ]
    found = of(flights)
    entries = {t.name: [(c.ramp, c.flight) for c in t.changes] for t in found.trends if t.changes}
    assert set(entries) == {GAIN, LOSS}
    assert entries[GAIN] == [(False, 20)]
    ((ramp, first),) = entries[LOSS]
    assert ramp
    assert first == pytest.approx(10, abs=3)
    loss = found.trend(LOSS)
    assert loss is not None
    assert loss.changes[0].per_flight == pytest.approx(0.012, rel=0.15)
    assert loss.now == loss.curve[-1] == pytest.approx(0.24, rel=0.1)
    assert loss.now > loss.curve[-2] + 0.01
    (mass,) = found.shared
    assert (mass.name, mass.value) == (MASS, pytest.approx(1.5, abs=0.2))
