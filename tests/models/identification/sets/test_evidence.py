"""Evidence of small sets against integrals that are worked out numerically."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag
from scipy.stats import norm

from thrustmargin.models.checks.arms.arm_posterior import LossEvidence
from thrustmargin.models.effects.base import Effect, Kind, Parameter, shaping
from thrustmargin.models.identification.rows.candidates import Candidate, Term, TrialEffect
from thrustmargin.models.identification.rows.fast_rows import Reading
from thrustmargin.models.identification.sets import evidence as weighed
from thrustmargin.models.identification.sets.evidence import (
    SetScore,
    ValuePrior,
    is_shape,
    prior_of,
)

#: As the code has them, written down by hand: a change there is to be seen here.
IMPOSSIBLE = -1000000000.0

MAIN = Parameter(name="a", unit="1", lower=-2.0, upper=2.0, scale=0.5, smallest=0.01)
SHAPE = shaping("b", "1", start=0.3, lower=-5.0, upper=5.0, scale=0.4)


def trials(*parameters: Parameter, prior: float = 0.0, at=None) -> TrialEffect:
    effect = Effect(
        name="made",
        kind=Kind.DEMAND,
        parameters=parameters,
        source="",
        apply=lambda *given: given[-1],
    )
    start = np.array([[p.start for p in parameters]])
    free = tuple((k, None) for k in range(len(parameters)))
    one = Candidate(term=Term(effect=effect), start=start, free=free, log_prior=prior)
    return TrialEffect(candidate=one, values=start if at is None else np.array([at]))


def score(prior: ValuePrior, hessian: np.ndarray, gradient: np.ndarray, cost: float) -> SetScore:
    """By J'J (P, P), J'r (P,) and r'r."""
    gram = np.block([[hessian, gradient[:, None]], [np.append(gradient, cost)[None]]])
    return weighed.score(prior, gram)


def test_nothing_has_the_likelihood_of_its_cost():
    assert score(prior_of([]), np.zeros((0, 0)), np.zeros(0), 12.0).log_evidence == -6.0


def test_of_two_main_values_the_coarser_says_how_small_an_effect_can_be():
    other = replace(MAIN, name="c", scale=0.2, smallest=0.02, upper=0.9)  # a tenth of its size
    hessian, gradient = np.diag([400.0, 900.0]), np.array([80.0, -90.0])
    found = score(prior_of([trials(MAIN, other)]), hessian, gradient, 50.0)
    size = np.hypot((0.2 + 1.0 / 20.0) / 0.5, (0.1 + 1.0 / 30.0) / 0.2)
    least, most = 0.1, 2.0 / 0.2
    flat = 1.0 / (2.0 * np.pi * np.log1p(most / least) * (size + least) ** 2) / (0.5 * 0.2)
    by_hand = -0.5 * (50.0 - 80.0 * 0.2 - 90.0 * 0.1) + np.log(2.0 * np.pi / (20.0 * 30.0))
    assert found.log_evidence == pytest.approx(by_hand + np.log(flat), abs=1e-5)


def test_the_first_bad_rotor_is_as_likely_as_any_effect_and_one_beside_it_less():
    def rotor(number):
        one = trials(MAIN, prior=float(np.log(0.005)))
        term = replace(one.candidate.term, rotor=number)
        return replace(one, candidate=replace(one.candidate, term=term))

    other = trials(MAIN, prior=float(np.log(0.02)))
    assert prior_of([rotor(0)]).log_sets == pytest.approx(np.log(0.02))
    assert prior_of([rotor(0), rotor(2)]).log_sets == pytest.approx(np.log(0.02 * 0.005))
    assert prior_of([other]).log_sets == pytest.approx(np.log(0.02))
    assert prior_of([other, rotor(1)]).log_sets == pytest.approx(np.log(0.02**2))


def test_what_an_arm_reports_multiplies_the_density_of_its_rotors_loss():
    """A loss of 0.2 fits the speeds, of which the arm's figures say e³; two curves of it count
    once, by the sum of their means."""
    arm = LossEvidence(loss=np.array([0.0, 0.4]), log_ratio=np.array([0.0, 6.0]))

    def rotor(evidence, *parameters):
        one = trials(*parameters)
        made = replace(one.candidate, arm=evidence, term=replace(one.candidate.term, rotor=1))
        return replace(one, candidate=made)

    def found(evidence):
        other = replace(MAIN, name="c")
        prior = prior_of([rotor(evidence, MAIN, SHAPE), rotor(evidence, MAIN, other)])
        hessian, gradient = np.diag([1e4, 0.0, 1e4, 1e4]), 1e4 * np.array([0.2, 0.0, 0.1, -0.3])
        return score(prior, hessian, gradient, 900.0).log_evidence

    assert found(arm) - found(None) == pytest.approx(15.0 * (0.2 + 0.5 * (0.1 - 0.3)), abs=1e-6)


@pytest.mark.parametrize("at", [0.3, 1.35, 1.0])
@pytest.mark.parametrize(("lower", "upper"), [(0.2, 1.5), (-3.0, 1.5)])
def test_the_evidence_of_one_main_value_by_its_formula(at, lower, upper):
    """A gauge that is right shows 1: its size is how far from it, over the usual 0.25."""
    gauge = replace(MAIN, absent=1.0, start=1.1, lower=lower, upper=upper, scale=0.25)
    error, cost = 0.1, 30.0
    h = 1.0 / error**2
    step = at - 1.1
    found = score(prior_of([trials(gauge)]), np.array([[h]]), np.array([h * step]), cost)
    assert found.step[0] == pytest.approx(step)
    least, most = 0.01 / 0.25, max(upper - 1.0, 1.0 - lower) / 0.25
    size = (abs(at - 1.0) + error) / 0.25
    density = 1.0 / (2.0 * np.log1p(most / least) * (size + least)) / 0.25
    inside = norm.cdf((upper - at) / error) - norm.cdf((lower - at) / error)
    by_hand = -0.5 * (cost - h * step**2) + 0.5 * np.log(2.0 * np.pi / h)
    by_hand += np.log(density) + np.log(inside)
    assert found.log_evidence == pytest.approx(by_hand, abs=1e-6)
    # A shape beside it, of which nothing shows, changes nothing.
    both = prior_of([trials(gauge, SHAPE)])
    free = score(both, np.diag([h, 0.0]), np.array([h * step, 0.0]), cost)
    assert free.log_evidence == pytest.approx(by_hand, abs=1e-6)
    nothing = score(prior_of([]), np.zeros((0, 0)), np.zeros(0), 1.0)
    assert (nothing.step.size, nothing.variance.size) == (0, 0)


@pytest.mark.parametrize("at", [0.3, 0.55, -0.7])
def test_a_shape_that_stands_off_its_start_pays_for_it(at):
    """The likelihood is about where it stands, the prior about where it starts."""
    h, g, cost = 40.0, 6.0, 9.0
    found = score(prior_of([trials(SHAPE, at=[at])]), np.array([[h]]), np.array([g]), cost)

    def density(d):
        likelihood = np.exp(-0.5 * (cost - 2 * g * d + h * d * d))
        return likelihood * norm.pdf(at + d, SHAPE.start, SHAPE.scale)

    whole = quad(density, -3.0, 3.0, points=[g / h], epsabs=1e-14)[0]
    assert found.log_evidence == pytest.approx(np.log(whole), abs=1e-5)
    mean = quad(lambda d: d * density(d), -3.0, 3.0, points=[g / h], epsabs=1e-14)[0] / whole
    assert found.step[0] == pytest.approx(mean, rel=1e-5)


@pytest.mark.parametrize(("at", "outward"), [(5.0, 400.0), (-5.0, -400.0)])
def test_what_a_shape_would_gain_beyond_its_bound_is_no_evidence(at, outward):
    hessian, cost = np.array([[900.0, 90.0], [90.0, 40.0]]), 50.0
    prior = prior_of([trials(MAIN, SHAPE, at=[0.4, at])])
    gradient = np.array([60.0, outward])
    found = score(prior, hessian, gradient, cost)
    # The other value moves as it would if the shape were known to stand there.
    assert found.step == pytest.approx([60.0 / 900.0, 0.0], abs=1e-6)
    pull = -(at - SHAPE.start) / SHAPE.scale**2
    level = score(prior, hessian, np.array([60.0, -pull + 90.0 * 60.0 / 900.0]), cost)
    assert level.step == pytest.approx([60.0 / 900.0, 0.0], abs=1e-6)
    assert found.log_evidence == pytest.approx(level.log_evidence, abs=1e-5)
    assert found.variance == pytest.approx(level.variance)
    # From its bound it comes back as it would from anywhere.
    gradient = np.array([60.0, -outward / 10.0])
    inward = score(prior, hessian, gradient, cost)
    both = hessian + np.diag([0.0, 1.0 / SHAPE.scale**2])
    by_hand = np.linalg.solve(both, gradient + np.array([0.0, pull]))
    assert inward.step == pytest.approx(by_hand)


def test_a_shape_steps_to_its_bound_and_gains_what_it_does_there():
    near = replace(SHAPE, upper=0.5)
    hessian, gradient, cost = np.array([[900.0, 90.0], [90.0, 40.0]]), np.array([60.0, 20.0]), 50.0
    free = score(prior_of([trials(MAIN, SHAPE)]), hessian, gradient, cost)
    assert free.step[1] > 0.2
    found = score(prior_of([trials(MAIN, near)]), hessian, gradient, cost)
    step = np.array([(60.0 - 90.0 * 0.2) / 900.0, 0.2])
    assert found.step == pytest.approx(step, abs=1e-6)

    def gain(of):
        whole = hessian + np.diag([0.0, 1.0 / SHAPE.scale**2])
        return of @ gradient - 0.5 * of @ whole @ of

    def size(of):  # of the main value, whose prior is by its logarithm
        return np.log((abs(of[0]) + np.sqrt(found.variance[0])) / MAIN.scale + 0.02)

    lost = gain(free.step) - gain(step) + size(step) - size(free.step)
    assert free.log_evidence - found.log_evidence == pytest.approx(lost, abs=1e-5)


@pytest.mark.parametrize(("second", "stands"), [(-0.3, None), (0.4, 0.5)])
def test_a_shape_that_another_at_its_bound_moves_beyond_its_own_is_held_too(second, stands):
    shapes = [replace(SHAPE, name=name, start=0.0, lower=-1.0, upper=0.5) for name in "bc"]
    hessian = np.array([[400.0, 380.0], [380.0, 400.0]])
    own = 400.0 + 1.0 / SHAPE.scale**2
    gradient = np.array([[own, 380.0], [380.0, own]]) @ [0.8, second]
    moved = (gradient[1] - 380.0 * 0.5) / own  # of the second, once the first stands at 0.5
    found = score(prior_of([trials(*shapes)]), hessian, gradient, 10.0)
    assert found.step == pytest.approx([0.5, moved if stands is None else stands], abs=1e-6)


def test_effects_that_do_nothing_alike_have_the_product_of_their_evidence():
    narrow = replace(MAIN, upper=0.8, scale=0.1)
    sets = [trials(narrow, at=[0.3]), trials(SHAPE, MAIN, at=[0.5, 0.4]), trials(MAIN, SHAPE)]
    each = [
        (np.array([[500.0]]), np.array([20.0])),
        (np.diag([40.0, 300.0]), np.array([3.0, 5.0])),
        (np.array([[90.0, 10.0], [10.0, 30.0]]), np.array([40.0, 6.0])),
    ]
    alone = [score(prior_of([one]), h, g, 7.0) for one, (h, g) in zip(sets, each, strict=True)]
    hessian = np.asarray(block_diag(*(h for h, _ in each)), dtype=np.float64)
    found = score(prior_of(sets), hessian, np.concatenate([g for _, g in each]), 21.0)
    assert found.log_evidence == pytest.approx(sum(one.log_evidence for one in alone))
    np.testing.assert_allclose(found.step, np.concatenate([one.step for one in alone]))
    np.testing.assert_allclose(found.variance, np.concatenate([one.variance for one in alone]))


def test_either_bound_is_impossible_and_far_beyond_it_too():
    h = np.array([[400.0]])
    for bound in (-2.0, 2.0):
        at = prior_of([trials(MAIN, at=[bound])])
        assert score(at, h, np.array([0.0]), 0.0).log_evidence <= IMPOSSIBLE / 2
    # Steps of 0.1 from a twentieth below the bound: within, by 4 and by 8 standard errors beyond.
    near = prior_of([trials(MAIN, at=[1.95])])
    four, eight = (score(near, h, h[0] * step, 0.0).log_evidence for step in (0.25, 0.45))
    assert four > IMPOSSIBLE / 2 > eight


def test_a_value_shapes_its_effect_if_it_is_a_detail_or_has_no_absent():
    assert is_shape(SHAPE)
    assert is_shape(replace(MAIN, absent=None))
    assert is_shape(replace(MAIN, detail=True))
    assert not is_shape(MAIN)


def test_values_that_no_rows_tell_apart_have_no_evidence():
    same = np.ones((2, 2)) * 1e20
    found = score(prior_of([trials(MAIN, MAIN)]), -same, np.zeros(2), 0.0)
    assert found.log_evidence == IMPOSSIBLE
    np.testing.assert_array_equal(found.step, 0.0)


@pytest.mark.parametrize("at", [0.0, 0.25])
def test_a_reading_weighs_as_a_measurement_of_the_value_beside_the_means(at):
    """Read 0.3 to 0.04: its likelihood over that of nothing, with 1.25 times the noise."""
    h, cost = 400.0, 30.0
    reading = Reading(values=np.array([0.3]), errors=np.array([0.04]), shared=0.0)
    plain = trials(MAIN, at=[at])
    one = replace(plain, candidate=replace(plain.candidate, reading=reading))
    gradient = h * (0.2 - at)  # of means that ask for 0.2, and cost 30 where the value stands
    found = score(prior_of([one]), np.array([[h]]), np.array([gradient]), cost)
    error = 1.25 * 0.04
    both = 1.0 / error**2 + h
    best = (0.3 / error**2 + 0.2 * h) / both
    assert at + found.step[0] == pytest.approx(best)
    assert found.variance[0] == pytest.approx(1.0 / both)

    def likelihood(d):
        means = np.exp(-0.5 * (cost - 2.0 * gradient * (d - at) + h * (d - at) ** 2))
        return means * norm.pdf(d, 0.3, error) / norm.pdf(0.0, 0.3, error)

    whole = quad(likelihood, -1.0, 1.5, points=[best], epsabs=1e-16)[0]
    size = (best + both**-0.5) / 0.5
    flat = 1.0 / (2.0 * np.log1p(4.0 / 0.02) * (size + 0.02)) / 0.5
    assert found.log_evidence == pytest.approx(np.log(whole * flat), abs=1e-6)
