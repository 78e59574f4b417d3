"""What is read from a season's sums, on sums whose every entry is given."""

import numpy as np
import pytest
from scipy.stats import norm

from tests.models.identification.season.test_season_by_hand import (
    GAIN,
    LOSS,
    MASS,
    NAMES,
    SHARE,
    VALUES,
    Rows,
    flown,
    place,
    without_own,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.change_points import penalty_of
from thrustmargin.models.identification.season.flight_sums import SeasonSums, season_sums
from thrustmargin.models.identification.season.season_changes import (
    SeasonModel,
    joint_fit,
    relinearise,
    season_changes,
)

#: absent, lower, upper, scale, smallest, 1 of a flight's own, 1 of a shape
PLAIN = (0.0, -100.0, 100.0, 10.0, 0.0, 0.0, 0.0)

#: Columns of the limits of a value, in the order in which a season keeps them.
UPPER, SCALE, SMALLEST = 2, 3, 4


def sums_of(values: Floats, alike: Floats | None = None, noise: Floats | float = 0.5) -> SeasonSums:
    """Flights that show values (F, q) with a standard error of 1 each, beside noise (q,) that is
    the same up and down; effects are as `alike` (q, q) as their correlation says."""
    flights, size = values.shape
    alike = np.eye(size) if alike is None else alike
    up_and_down = noise * np.where(np.arange(flights) % 2, 1.0, -1.0)[:, None]
    return SeasonSums(
        names=tuple(f"value.{k}" for k in range(size)),
        limits=np.array([PLAIN] * size),
        information=np.repeat(alike[None], flights, axis=0),
        pull=values @ alike + up_and_down,
        squares=np.einsum("fi,ij,fj->f", values, alike, values) + 100.0,
        known=np.repeat(np.diag(alike)[None], flights, axis=0),
        total=flights * alike,
        rotor_count=4,
        evidence=(),
        bent={},
    )


def test_of_one_season_eight_values_are_found():
    first = np.arange(10, 20)  # each of ten values steps at a flight of its own
    values = np.where(np.arange(30)[:, None] >= first, 30.0, 0.0)
    found = season_changes(sums_of(values))
    assert [len(t.changes) for t in found.trends] == [1] * 8 + [0] * 2


@pytest.mark.parametrize("at", [0, 1])
@pytest.mark.parametrize(
    ("size", "alike", "as_well"),
    # A step of half of 40 flights has 10 size² of the squares, of which another takes alike².
    [(3.0, 0.9, True), (3.0, 0.89, False), (20.0, 0.976, True), (20.0, 0.974, False)],
)
def test_another_does_as_well_up_to_18_squares_or_a_twentieth(size, alike, as_well, at):
    values = np.zeros((40, 2))
    values[20:, at] = size
    sums = sums_of(values, np.array([[1.0, alike], [alike, 1.0]]))
    sums.limits[:, SMALLEST] = 1e3  # means may be anything
    gain = 10.0 * size**2
    assert (gain * (1.0 - alike**2) < max(18.0, 0.05 * gain)) == as_well
    changed = season_changes(sums).trends[0]
    assert [c.flight for c in changed.changes] == [20]
    assert changed.instead == ((f"value.{1 - at}",) if as_well else ())


def test_a_change_is_taken_anew_beside_those_that_are_found_after_it():
    """Alone, the first of two that are alike would have the step of the other too."""
    t, alike = np.arange(40), np.array([[1.0, 0.6], [0.6, 1.0]])
    values = np.stack([np.where(t >= 12, 20.0, 0.0), np.where(t >= 28, 12.0, 0.0)], axis=1)
    found = season_changes(sums_of(values, alike))
    assert [(len(x.changes), x.changes[0].flight) for x in found.trends] == [(1, 12), (1, 28)]
    for trend, size in zip(found.trends, (20.0, 12.0), strict=True):
        steps = np.diff(trend.curve)
        assert steps[trend.changes[0].flight - 1] == pytest.approx(size, abs=0.5)
        assert np.count_nonzero(np.abs(steps) > 1e-9) == 1


#: of noise of one standard error up and down: flights scatter so much more than their errors say
SLOW_FACTOR = 4.0 / np.sqrt(6.0) / norm.ppf(0.75)


def test_a_mean_goes_when_others_that_are_found_after_it_explain_it():
    """What two others make looks most like the first. Beside them it takes 0.155 x 14² = 30 of the
    squares of a flight; as flights scatter that is worth 5, and 15 are asked for."""
    alike = np.array([[1.0, 0.65, 0.65], [0.65, 1.0, 0.0], [0.65, 0.0, 1.0]])
    sums = sums_of(np.repeat([[14.0, 60.0, 60.0]], 40, axis=0), alike, noise=1.0)
    found = season_changes(sums)
    assert [one.name for one in found.shared] == ["value.1", "value.2"]
    without = joint_fit(sums, SeasonModel(shared=frozenset({1, 2})))[0]
    for k, trend in enumerate(sorted(found.trends, key=lambda one: one.name)):
        np.testing.assert_allclose(trend.curve, without[:, k])


@pytest.mark.parametrize(("part", "named"), [(0.98, False), (1.02, True)])
def test_a_mean_is_weighed_as_by_one_flight_that_scatters_as_flights_do(part, named):
    """What a sound aircraft has, 0.5, takes a fifth of the squares; 10, the usual size, all but a
    hundredth. The next one scatters by its errors, and half the size is enough."""
    least = SLOW_FACTOR * np.sqrt(penalty_of(40, 2) / (1.0 / 1.01 - 0.2))
    values = np.full((40, 2), [part * least, 0.5 * least])
    found = season_changes(sums_of(values, noise=np.array([1.0, 0.1])))
    assert [one.name for one in found.shared] == ["value.0"] * named + ["value.1"]
    assert all(not trend.changes for trend in found.trends)


@pytest.mark.parametrize(("size", "named"), [(4.38, False), (4.52, True)])
def test_a_mean_stands_out_of_what_the_model_is_uncertain_by(size, named):
    """All of the error is of the model, 1: nine tenths of the size, by a usual one of 3, are to be
    4.00 of it, which they are of 4.45. The next one is named in any case."""
    sums = sums_of(np.full((40, 2), [size, 20.0]), noise=0.1)
    sums.limits[:, SCALE] = 3.0
    sums.known[:] = 1e12
    assert np.sqrt(penalty_of(40, 2)) == pytest.approx(4.0, abs=0.01)
    found = season_changes(sums)
    assert [one.name for one in found.shared] == ["value.0"] * named + ["value.1"]


def test_one_flight_alone_is_a_season_of_means():
    found = season_changes(sums_of(np.array([[30.0, 0.0]])))
    (mean,) = found.shared
    assert (mean.name, mean.value) == ("value.0", pytest.approx(29.5 / 1.01))
    left = 29.5 - mean.value  # over the information and the prior: by how much its flight is off
    assert mean.error == pytest.approx(left / 1.01)
    assert [np.isnan(trend.least_seen) for trend in found.trends] == [True, True]
    assert season_sums([flown(1).evidence]).rotor_count == 4


def test_a_mean_beside_a_step_is_that_of_the_flights_before_it():
    values = np.repeat([20.0, 30.0], 20)[:, None]
    found = season_changes(sums_of(values))
    assert [c.flight for c in found.trends[0].changes] == [20]
    (mean,) = found.shared
    assert mean.value == pytest.approx(20.0, abs=0.5)
    assert found.trends[0].now == pytest.approx(30.0, abs=0.5)


@pytest.mark.parametrize(("part", "changes"), [(0.98, 0), (1.02, 1)])
def test_a_step_is_weighed_by_all_flights_whatever_mean_it_would_make(part, changes):
    """Of 20 and 20 flights a step is known to the root of a tenth of a flight's error."""
    least = SLOW_FACTOR * np.sqrt(penalty_of(40, 1) / 10.0)
    values = np.repeat([0.0, part * least], 20)[:, None]
    sums = sums_of(values, noise=1.0)
    sums.limits[:, SMALLEST] = 1e3  # means may be anything
    sums.limits[:, UPPER] = 0.1
    (trend,) = season_changes(sums).trends
    assert len(trend.changes) == changes


def bent_season(loss: float, bend: float) -> SeasonSums:
    """Flights without noise that all lost thrust, of which what a loss d does goes with
    d + bend d²."""
    flights = []
    for k in range(6):
        one = flown(k)
        columns = np.zeros_like(one.columns)
        columns[:, NAMES.index(LOSS)] = lost = one.columns[:, NAMES.index(LOSS)]
        flights.append(Rows(columns, bend * lost, (loss + bend * loss**2) * lost))
    return season_sums([one.evidence for one in flights])


def test_sums_are_made_anew_until_they_are_about_what_was_lost():
    """Newton's steps: 0.3 + 9 x 0.3² = 1.11, 0.58, 0.36, 0.304, 0.30002."""
    sums = bent_season(0.3, 9.0)
    found = SeasonModel(shared=frozenset({place(sums, LOSS)}))
    assert relinearise(sums, found).bent[LOSS] == pytest.approx(0.304, abs=0.001)
    again = relinearise(relinearise(relinearise(sums, found), found), found)
    assert again.bent[LOSS] == pytest.approx(0.3, abs=5e-4)
    assert relinearise(again, found) is again


@pytest.mark.parametrize("changes", [True, False])
def test_a_torque_share_goes_with_its_loss_and_is_known_to_a_half(changes):
    """All values at once by least squares on rows; what is usual are rows of their own."""
    flights = [flown(k, extra_mass=2.0, rotor_degradation=0.02 * k) for k in range(6)]
    loss = np.array([0.0, 0.0, 0.1, 0.12, 0.12, 0.2])
    sums = season_sums([one.evidence for one in flights], {LOSS: loss})
    k, mass = place(sums, LOSS), place(sums, MASS)
    if changes:
        found = SeasonModel(shared=frozenset({mass}), shapes={k: loss})
    else:  # a loss in all flights: the share goes with its mean
        found = SeasonModel(shared=frozenset({mass, k}))
    names = [name for name in NAMES if name != "wind.north"]
    usual = {name: max(VALUES[name][4], 0.05 * VALUES[name][3]) for name in (GAIN, LOSS, MASS)}
    free = {MASS} if changes else {MASS, LOSS}
    usual |= {name: VALUES[name][3] for name in free}
    over = [(name, np.ones(6), size / np.sqrt(6.0)) for name, size in usual.items()]
    over += [(LOSS, loss, np.inf)] if changes else []
    over += [(SHARE, loss if changes else np.full(6, 0.09), 0.75)]
    rows, wanted = [], []
    for f, one in enumerate(flights):
        columns, residual = without_own(one, loss[f])
        rows.append(np.stack([columns[:, names.index(n)] * c[f] for n, c, _ in over], axis=1))
        wanted.append(residual)
    rows.append(np.diag([1.0 / size for _, _, size in over]))
    wanted.append(np.zeros(len(over)))
    whole, right = np.concatenate(rows), np.concatenate(wanted)
    sizes = np.linalg.lstsq(whole, right)[0]
    curves, left = joint_fit(sums, found)
    for name in (*usual, SHARE):
        by_hand = sum(s * c for s, (n, c, _) in zip(sizes, over, strict=True) if n == name)
        np.testing.assert_allclose(curves[:, place(sums, name)], by_hand, rtol=1e-6, atol=1e-9)
    assert left == pytest.approx(np.sum((right - whole @ sizes) ** 2))


@pytest.mark.parametrize(("loss", "named"), [(0.065, [MASS]), (0.095, [MASS, LOSS])])
def test_a_mean_that_the_form_of_another_may_make_is_not_named(loss, named):
    """Half of what 4 kg do looks like a loss of 40 %, of which the form is known to 5 %: the season
    asks for 3.9 times that, 8 % of thrust."""
    flights = []
    for k in range(20):
        one = flown(k, noise=0.5)
        columns = one.columns.copy()
        columns[:, NAMES.index(SHARE)] = 0.0
        lost, own = columns[:, NAMES.index(LOSS)], columns[:, NAMES.index(MASS)]
        columns[:, NAMES.index(MASS)] = 0.1 * lost + np.sqrt(3.0) * 10.0 / 4.0 * own
        made = 4.0 * columns[:, NAMES.index(MASS)] + loss * lost
        flights.append(Rows(columns, 0.0 * one.bend, one.residual + made))
    sums = season_sums([one.evidence for one in flights])
    k, mass = place(sums, LOSS), place(sums, MASS)
    leak = 4.0 * sums.total[k, mass] / sums.total[k, k]
    assert np.sqrt(penalty_of(20, 3)) * 0.05 * leak == pytest.approx(0.08, rel=0.05)
    assert sorted(one.name for one in season_changes(sums).shared) == sorted(named)
