"""From weighed sets to names, on sets whose weights are given by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from tests.models.identification.known_terms import curve_term, known_term
from tests.models.known_effects import known_effect
from thrustmargin.models.identification.answer.posterior import EffectEstimate, posterior_of
from thrustmargin.models.identification.rows.candidates import Term, TrialEffect, candidate
from thrustmargin.models.identification.sets.evidence import SetScore
from thrustmargin.models.identification.sets.linear_sets import EffectSet
from thrustmargin.models.identification.sets.set_search import Search

MASS, GAUGE, CG = (candidate(known_term(k), 1) for k in ("extra_mass", "tank_scale", "cg_offset"))
LOSS = candidate(known_term("rotor_degradation", rotor=2), 1)
LAST = candidate(known_term("rotor_degradation", rotor=3), 1)
SINCE = candidate(known_term("rotor_degradation:since", rotor=2), 1)
TRIM = candidate(known_term("yaw_trim"), 1)
ARMS = [candidate(known_term("yaw_trim:tilted arm", rotor=r), 1) for r in (0, 2)]
ALL = [MASS, GAUGE, CG, LOSS, LAST, SINCE, TRIM, *ARMS]
PITCH, TURN = (candidate(curve_term("pitch", k), 1) for k in ("airspeed", "yaw_rate"))


def a_set(weight: float, **values: tuple[float, float]) -> EffectSet:
    """A set: the first value of each effect and its standard error by name."""
    names = {"mass": 0, "gauge": 1, "cg": 2, "loss": 3, "last": 4, "since": 5}
    names |= {"trim": 6, "first arm": 7, "third arm": 8}
    key = frozenset(names[n] for n in values)
    trials, errors = [], []
    for n in sorted(values, key=lambda name: names[name]):
        one = ALL[names[n]]
        start = one.start.copy()
        start[0, 0] = values[n][0]
        trials.append(TrialEffect(candidate=one, values=start))
        errors += [values[n][1]] + [0.1] * (len(one.free) - 1)
    scored = SetScore(
        log_evidence=float(np.log(weight)), step=np.zeros(len(errors)), variance=np.square(errors)
    )
    return EffectSet(
        key=key,
        trials=tuple(trials),
        set_score=scored,
        residual=np.zeros((1, 4)),
    )


def answer_of(*sets: EffectSet):
    search: Any = SimpleNamespace(fitted={s.key: s for s in sets}, candidates=ALL)
    return posterior_of(search)


def test_what_nearly_all_weight_holds_is_named():
    found = answer_of(
        a_set(0.60, loss=(0.08, 0.01)), a_set(0.36, loss=(0.08, 0.01), mass=(1.0, 0.2)), a_set(0.04)
    )
    assert found.weights == pytest.approx([0.60, 0.36, 0.04])
    assert found.named_candidates() == [3]
    assert found.probability([3]) == pytest.approx(0.96)
    assert found.probability([0]) == pytest.approx(0.36)


def test_a_rotor_is_named_though_it_may_be_weak_from_the_start_or_since_a_moment():
    """By the likeliest of the two, with what both hold of the weight, and not said once more."""
    found = answer_of(
        a_set(0.40, loss=(0.15, 0.01)),
        a_set(0.54, since=(0.15, 0.01)),
        a_set(0.03, since=(0.15, 0.01), mass=(1.0, 0.2)),
        a_set(0.03),
    )
    assert found.named_candidates() == [5]
    assert found.estimate(5).probability == pytest.approx(0.97)
    assert found.one_of([5]) == ()
    assert found.mentioned([5]) == ()


def test_two_rotors_or_two_effects_of_which_one_is_there_are_no_name():
    rotors = answer_of(a_set(0.5, loss=(0.15, 0.01)), a_set(0.5, last=(0.15, 0.01)))
    assert rotors.named_candidates() == []
    assert rotors.estimate(3).probability == pytest.approx(0.5)
    assert (
        answer_of(a_set(0.5, mass=(1.0, 0.2)), a_set(0.5, cg=(0.1, 0.01))).named_candidates() == []
    )


@pytest.mark.parametrize(
    ("weights", "named", "either"),
    [
        ((0.02, 0.96, 0.02), [7], []),
        # Some arm is tilted or all motors lean: the moment is certain, the arm is not.
        ((0.30, 0.45, 0.25), [6], []),
        # It is an arm, and these flights do not show which.
        ((0.01, 0.59, 0.40), [], [["yaw_trim of rotor 1", "yaw_trim of rotor 3"]]),
    ],
)
def test_a_tilted_arm_is_named_where_it_is_certain_which(weights, named, either):
    keys = ("trim", "first arm", "third arm")
    sets = [a_set(w, **{k: (0.05, 0.002)}) for k, w in zip(keys, weights, strict=True)]
    found = answer_of(*sets)
    assert found.named_candidates() == named
    assert [[t.words for t in one.terms] for one in found.one_of(named)] == either
    assert found.mentioned([]) == ()  # no rotor is weak
    assert found.gaining_rotors() == frozenset()


def test_both_that_nearly_all_weight_holds_are_named():
    both = answer_of(a_set(0.97, loss=(0.15, 0.01), since=(0.05, 0.01)), a_set(0.03))
    assert both.named_candidates() == [3, 5]


def test_a_rotor_with_more_thrust_is_distinguished_from_a_weak_one():
    found = answer_of(
        a_set(0.6, last=(0.05, 0.01), since=(-0.07, 0.01)),
        a_set(0.3, loss=(0.1, 0.01)),
        a_set(0.1, mass=(-1.0, 0.2)),
    )
    assert found.gaining_rotors() == {2}  # "since" is likelier than "loss", on one rotor
    assert answer_of(a_set(1.0, loss=(0.1, 0.01))).gaining_rotors() == frozenset()


def test_what_enters_a_model_without_a_name_is_of_the_most_probable_set():
    """Pitch along airspeed, pitch along yaw rate, a mass, or nothing."""
    more = [*ALL[:6], PITCH, TURN]

    def members(*weights: float) -> list[int]:
        of = ({6}, {7}, {0}, set())
        sets = [
            replace(a_set(w), key=frozenset(key), trials=tuple(more[c].initial_effect for c in key))
            for w, key in zip(weights, of, strict=True)
        ]
        search = Search.__new__(Search)  # it needs no flights here
        search.candidates, search.fitted = more, {one.key: one for one in sets}
        return posterior_of(search).unnamed_members()

    assert members(0.3, 0.28, 0.1, 0.32) == []
    assert members(0.3, 0.32, 0.1, 0.28) == [7]
    assert members(0.52, 0.02, 0.1, 0.36) == [6]
    assert members(0.1, 0.1, 0.55, 0.25) == [0]


def test_a_size_that_may_be_nothing_is_no_name():
    assert answer_of(a_set(1.0, mass=(0.3, 0.2))).named_candidates() == []
    assert answer_of(a_set(1.0, mass=(0.5, 0.2))).named_candidates() == [0]
    assert answer_of(a_set(1.0, gauge=(0.9, 0.02))).named_candidates() == [1]
    assert answer_of(a_set(1.0, gauge=(1.03, 0.02))).named_candidates() == []


def test_values_are_averaged_over_the_sets_with_what_lies_between_them():
    found = answer_of(a_set(0.75, mass=(1.0, 0.2)), a_set(0.25, mass=(2.0, 0.4), cg=(0.02, 0.001)))
    estimate = found.estimate(0)
    assert estimate.value[0, 0] == pytest.approx(1.25)
    # .75 x .04 + .25 x .16 within the sets, .75 x .25 x 1² between them
    assert estimate.error[0, 0] ** 2 == pytest.approx(0.07 + 0.1875)


def test_a_value_is_a_step_away_from_where_its_set_was_linearised():
    one = a_set(1.0, mass=(1.0, 0.2))
    one = replace(one, set_score=replace(one.set_score, step=np.array([0.5])))
    search: Any = SimpleNamespace(fitted={one.key: one}, candidates=ALL)
    estimate = posterior_of(search, 0.15).estimate(0)
    assert estimate.value[0, 0] == pytest.approx(1.5)
    assert estimate.error[0, 0] == pytest.approx(0.2)
    assert (estimate.steepness, posterior_of(search).estimate(0).steepness) == (0.15, 0.0)
    plain = replace(posterior_of(search).estimate(0), steepness=0.0)
    finest = known_effect("extra_mass").parameters[0]
    half = norm.ppf(0.975) * plain.error + finest.resolution + plain.value * finest.accuracy
    np.testing.assert_allclose(plain.half_width, half)


def test_one_of_two_where_only_together_they_hold_the_weight():
    found = answer_of(a_set(0.55, mass=(1.0, 0.2)), a_set(0.42, gauge=(1.1, 0.02)), a_set(0.03))
    assert found.named_candidates() == []
    (group,) = found.one_of([])
    assert [t.effect.name for t in group.terms] == ["extra_mass", "tank_scale"]
    assert group.probabilities == pytest.approx((0.55, 0.42))


def test_a_choice_is_one_whatever_else_is_there():
    found = answer_of(
        a_set(0.55, mass=(1.0, 0.2), cg=(0.02, 0.001)),
        a_set(0.42, gauge=(1.1, 0.02), cg=(0.02, 0.001)),
        a_set(0.03, cg=(0.02, 0.001)),
    )
    (group,) = found.one_of([2])
    assert [t.effect.name for t in group.terms] == ["extra_mass", "tank_scale"]


def test_what_mostly_comes_together_is_no_choice_and_what_has_no_weight_is_in_none():
    both = a_set(0.82, mass=(1.0, 0.2), gauge=(1.1, 0.02))
    found = answer_of(both, a_set(0.12, mass=(1.0, 0.2)), a_set(0.06, gauge=(1.1, 0.02)))
    assert found.one_of([3]) == ()
    slight = [a_set(0.94, mass=(1.0, 0.5)), a_set(0.03, gauge=(1.1, 0.02)), a_set(0.03)]
    assert answer_of(*slight).one_of([]) == ()


def test_a_choice_is_one_also_beside_what_is_likelier_but_has_no_name():
    """The moment beside them holds most of the weight and comes with either."""
    found = answer_of(
        a_set(0.5, mass=(1.0, 0.2), cg=(0.02, 0.001)),
        a_set(0.4, gauge=(1.1, 0.02), cg=(0.02, 0.001)),
        a_set(0.06, mass=(1.0, 0.2)),
        a_set(0.04),
    )
    (group,) = found.one_of([])
    assert [t.effect.name for t in group.terms] == ["extra_mass", "tank_scale"]


def test_one_alone_whose_size_may_be_nothing_is_not_one_of_several():
    assert answer_of(a_set(1.0, mass=(0.3, 0.2))).one_of([]) == ()


def test_a_rotor_that_has_weight_is_mentioned_and_a_named_one_is_not_said_twice():
    listed = answer_of(a_set(0.9), a_set(0.1, loss=(0.03, 0.01)))
    ((rotor, likeliest),) = listed.mentioned([])
    assert (rotor.rotor, likeliest) == (2, 3)
    assert rotor.probability == pytest.approx(0.1)
    assert rotor.ci95 == pytest.approx((0.03 - 0.0196, 0.03 + 0.0196), abs=1e-4)
    assert listed.mentioned([3]) == ()
    assert answer_of(a_set(0.97), a_set(0.03, loss=(0.03, 0.01))).mentioned([]) == ()


def test_alternatives_are_the_sets_with_weight_likeliest_first():
    found = answer_of(a_set(0.2, mass=(1.0, 0.2)), a_set(0.78), a_set(0.02, cg=(0.02, 0.001)))
    assert [(len(a.terms), round(a.probability, 2)) for a in found.alternatives()] == [
        (0, 0.78),
        (1, 0.2),
    ]


def test_an_interval_has_the_error_the_finest_step_and_the_share_that_no_rows_lessen():
    parameter = replace(known_effect("extra_mass").parameters[0], resolution=0.05, accuracy=0.02)
    effect = replace(known_effect("extra_mass"), parameters=(parameter,))
    values = np.array([[2.0], [-3.0]])
    estimate = EffectEstimate(
        candidate=0,
        term=Term(effect=effect),
        probability=1.0,
        value=values,
        error=np.array([[0.1], [0.2]]),
        steepness=0.15,
    )
    z = norm.ppf(0.975)
    share = 0.02 + z * 0.15
    by_hand = [[z * 0.1 + 0.05 + 2.0 * share], [z * 0.2 + 0.05 + 3.0 * share]]
    np.testing.assert_allclose(estimate.half_width, by_hand)
    # What says when or how, and not how much, is as good as before by a curve that is off.
    detail = replace(effect, parameters=(replace(parameter, detail=True),))
    fine = replace(estimate, term=Term(effect=detail))
    by_hand = [[z * 0.1 + 0.05 + 2.0 * 0.02], [z * 0.2 + 0.05 + 3.0 * 0.02]]
    np.testing.assert_allclose(fine.half_width, by_hand)


@pytest.mark.parametrize(("weight", "names"), [(0.949, []), (0.951, [0])])
def test_a_name_needs_95_percent_of_the_weight(weight, names):
    found = answer_of(a_set(weight, mass=(2.0, 0.1)), a_set(1.0 - weight))
    assert found.named_candidates() == names


@pytest.mark.parametrize(("times", "names"), [(1.95, []), (1.97, [0]), (-1.95, []), (-1.97, [0])])
def test_a_name_is_clear_of_nothing_by_1_96_standard_errors(times, names):
    assert answer_of(a_set(1.0, mass=(0.2 * times, 0.2))).named_candidates() == names


@pytest.mark.parametrize(("both", "groups"), [(0.49, 1), (0.51, 0)])
def test_a_choice_has_half_of_the_weight_on_just_one(both, groups):
    together = a_set(both, mass=(2.0, 0.1), gauge=(1.2, 0.02))
    rest = (1.0 - both) / 2.0
    found = answer_of(together, a_set(rest, mass=(2.0, 0.1)), a_set(rest, gauge=(1.2, 0.02)))
    assert len(found.one_of([])) == groups


@pytest.mark.parametrize(("weight", "listed"), [(0.049, 0), (0.051, 1)])
def test_a_twentieth_of_the_weight_is_mentioned(weight, listed):
    found = answer_of(a_set(1.0 - weight), a_set(weight, loss=(0.03, 0.01)))
    assert len(found.mentioned([])) == listed
    assert len(found.alternatives()) == 1 + listed


def law_error(c: int, k: int) -> float:
    """0.03 kg of a mass alone."""
    return 0.03 if (c, k) == (0, 0) else 0.0


def excluded(value: float, error: float, *sets: EffectSet, named=()):
    """What is excluded where each effect alone beside the best set would have this value."""

    def score(key: frozenset[int]) -> SetScore:
        free = sum(len(ALL[c].free) for c in key)
        first = np.zeros(free)
        first[0] = value
        return SetScore(log_evidence=0.0, step=first, variance=np.full(free, error**2))

    trials = []
    for one in ALL:
        absent = one.start.copy()
        for k, p in enumerate(one.parameters):
            absent[:, k] = p.start if p.absent is None else p.absent
        trials.append(TrialEffect(candidate=one, values=absent))
    linear: Any = SimpleNamespace(score=score, trials=trials, law_error=law_error)
    return {e.term.effect.name: e for e in answer_of(*sets).excluded(linear, named)}


def test_a_size_is_excluded_above_its_value_and_1_645_standard_errors():
    for value in (0.3, -0.3):
        found = excluded(value, 0.2, a_set(1.0))["extra_mass"]
        assert found.above == pytest.approx(0.3 + norm.ppf(0.95) * np.hypot(0.2, 0.03))
        assert (found.parameter, found.unit) == ("mass", "kg")
    # A gauge that is right has 1: what is excluded is how far from it.
    assert excluded(0.1, 0.02, a_set(1.0))["tank_scale"].above == pytest.approx(
        0.1 + norm.ppf(0.95) * 0.02
    )
    # Of two values as main as each other, as of a shifted load, none is the size.
    assert "cg_offset" not in excluded(0.1, 0.02, a_set(1.0))


def test_a_detail_is_no_size_and_a_value_that_is_never_absent_neither():
    """Beside the mass a value that says when, and one that is something in any case."""
    first = MASS.term.effect.parameters[0]
    more = (
        replace(first, name="when", detail=True, absent=0.0),
        replace(first, name="other", absent=None),
    )
    effect = replace(MASS.term.effect, parameters=(first, *more))
    made = candidate(Term(effect=effect), 1)
    scored = SetScore(log_evidence=0.0, step=np.array([0.3, 9.0, 9.0]), variance=np.full(3, 0.04))
    search: Any = SimpleNamespace(fitted={frozenset(): a_set(1.0)}, candidates=[made])
    linear: Any = SimpleNamespace(
        law_error=law_error,
        score=lambda *_: scored,
        trials=[TrialEffect(candidate=made, values=np.zeros((1, 3)))],
    )
    (one,) = posterior_of(search).excluded(linear, [])
    assert (one.parameter, one.above) == (
        "mass",
        pytest.approx(0.3 + norm.ppf(0.95) * np.hypot(0.2, 0.03)),
    )
    trials = TrialEffect(candidate=made, values=np.array([[0.1, 9.0, 9.0]]))
    still = replace(scored, step=np.zeros(3))
    sure = replace(a_set(1.0), key=frozenset({0}), trials=(trials,), set_score=still)
    search.fitted = {sure.key: sure}
    assert posterior_of(search).named_candidates() == []


@pytest.mark.parametrize(("of_bound", "said"), [(0.999, True), (1.001, False)])
def test_a_size_that_cannot_be_is_not_excluded(of_bound, said):
    """Flights that show nothing of a delay exclude one "above 40,000,000,000 s"."""
    (gain,) = known_effect("tank_scale").parameters
    most = max(gain.upper - 1.0, 1.0 - gain.lower)
    error = of_bound * most / norm.ppf(0.95)
    assert ("tank_scale" in excluded(0.0, error, a_set(1.0))) is said


def test_what_is_named_or_has_weight_is_not_excluded():
    assert "extra_mass" not in excluded(0.1, 0.02, a_set(1.0), named=[0])
    seen = (a_set(0.94), a_set(0.06, mass=(1.0, 0.3)))
    assert "extra_mass" not in excluded(0.1, 0.02, *seen)


def test_a_rotor_without_weight_does_not_end_the_list():
    sets = (a_set(0.87), a_set(0.03, loss=(0.03, 0.01)), a_set(0.1, last=(0.04, 0.01)))
    assert [m.rotor for m, _ in answer_of(*sets).mentioned([])] == [3]


def test_values_of_single_flights_are_averaged_flight_by_flight():
    """A gauge's zero is of each flight: steps of 0.1 and 0.3 kg from 1 and 2 kg, and no step of
    0.5 and 1 kg in the set beside it, which weighs a quarter."""
    zero = candidate(known_term("tank_zero"), 2)
    assert [flight for _, flight in zero.free] == [0, 1]

    def at(weight: float, values, steps, key) -> EffectSet:
        scored = SetScore(
            log_evidence=float(np.log(weight)),
            step=np.array(steps),
            variance=np.array([0.01, 0.04, 9.0][: len(steps)]),
        )
        trials = [TrialEffect(candidate=zero, values=np.array(values)[:, None])]
        if len(key) > 1:
            trials.append(TrialEffect(candidate=MASS, values=np.zeros((2, 1))))
        return EffectSet(
            key=frozenset(key),
            trials=tuple(trials),
            set_score=scored,
            residual=np.zeros((1, 4)),
        )

    sets = [at(0.75, [1.0, 2.0], [0.1, 0.3], {0}), at(0.25, [0.5, 1.0], [0.0, 0.0, 5.0], {0, 1})]
    search: Any = SimpleNamespace(fitted={s.key: s for s in sets}, candidates=[zero, MASS])
    found = posterior_of(search).estimate(0)
    np.testing.assert_allclose(found.value[:, 0], [0.75 * 1.1 + 0.125, 0.75 * 2.3 + 0.25])
    between = 0.75 * 0.25 * np.array([1.1 - 0.5, 2.3 - 1.0]) ** 2
    np.testing.assert_allclose(found.error[:, 0] ** 2, np.array([0.01, 0.04]) + between)


def test_a_loss_that_is_mentioned_is_that_of_the_flight_that_shows_most():
    onset = candidate(known_term("rotor_degradation:onset", rotor=1), 3)
    values = onset.start.copy()
    values[:, 0] = [0.02, 0.09, 0.05]
    errors = np.array([0.01 if k == 0 else 0.0 for k, _ in onset.free], dtype=np.float64)
    scored = SetScore(log_evidence=float(np.log(0.2)), step=0.0 * errors, variance=errors**2)
    rare = EffectSet(
        key=frozenset({0}),
        trials=(TrialEffect(candidate=onset, values=values),),
        set_score=scored,
        residual=np.zeros((1, 4)),
    )
    sets = [rare, a_set(0.8)]
    search: Any = SimpleNamespace(fitted={s.key: s for s in sets}, candidates=[onset])
    ((rotor, _),) = posterior_of(search).mentioned([])
    assert (rotor.rotor, rotor.loss) == (1, pytest.approx(0.09))
    assert rotor.probability == pytest.approx(0.2)
    p = onset.term.effect.parameters[0]
    half = norm.ppf(0.975) * 0.01 + p.resolution + 0.09 * p.accuracy
    assert rotor.ci95 == pytest.approx((0.09 - half, 0.09 + half))


def test_what_is_excluded_beside_a_set_is_read_at_its_own_place():
    """Beside mass (one value) and a shifted load (two) a loss is the fourth value."""

    def score(key: frozenset[int]) -> SetScore:
        count = sum(len(ALL[c].free) for c in key)
        places = np.arange(1.0, count + 1.0, dtype=np.float64)
        return SetScore(log_evidence=0.0, step=0.01 * places, variance=(0.001 * places) ** 2)

    trials = [one.initial_effect for one in ALL]
    linear: Any = SimpleNamespace(score=score, trials=trials, law_error=law_error)
    best = a_set(1.0, mass=(1.0, 0.1), cg=(0.02, 0.001))
    found = answer_of(best).excluded(linear, [0, 2])
    loss = next(e for e in found if e.term.rotor == 2)
    start = LOSS.start[0, 0]
    assert loss.above == pytest.approx(start + 0.04 + norm.ppf(0.95) * 0.004)
    gauge = next(e for e in found if e.term.effect.name == "tank_scale")
    off = abs(GAUGE.start[0, 0] + 0.02 - 1.0)  # second, after the mass; right is 1
    assert gauge.above == pytest.approx(off + norm.ppf(0.95) * 0.002)


def test_values_are_those_that_the_names_have_by_themselves():
    """They predict without the rest, and are as uncertain as its absence moves them."""
    both = a_set(0.97, loss=(0.20, 0.01), cg=(0.02, 0.001))
    alone = a_set(0.03, loss=(0.15, 0.005))
    (found,) = answer_of(both, alone).estimates([3])
    among = 0.97 * 0.20 + 0.03 * 0.15
    assert found.value[0, 0] == pytest.approx(0.15)
    assert found.error[0, 0] == pytest.approx(np.hypot(0.005, among - 0.15))
    assert found.probability == pytest.approx(1.0)
    assert answer_of(both, alone).estimates([]) == []
    (whole, shift) = answer_of(both).estimates([3, 2])
    assert (whole.candidate, shift.candidate) == (2, 3)
    assert shift.value[0, 0] == pytest.approx(0.20)
    assert shift.error[0, 0] == pytest.approx(0.01)


def test_values_are_those_beside_what_is_said_to_be_either_one_or_the_other():
    """Hidden mass that has no name of its own would be taken for a loss."""
    whole = a_set(0.94, loss=(0.05, 0.01), mass=(1.0, 0.2))
    found = answer_of(whole, a_set(0.06, loss=(0.08, 0.01)))
    (alone,) = found.estimates([3])
    assert alone.value[0, 0] == pytest.approx(0.08)
    (mass,) = (c for c in whole.key if c != 3)
    (beside,) = found.estimates([3], {mass})
    assert beside.value[0, 0] == pytest.approx(0.05)


def test_a_name_that_by_itself_may_be_nothing_is_none():
    """A loss of 0.20 beside another effect and of 0.07 without it is known to 0.13; the values of a
    shifted centre of gravity likewise."""
    loss = (a_set(0.97, loss=(0.20, 0.01), cg=(0.02, 0.001)), a_set(0.03, loss=(0.07, 0.005)))
    assert answer_of(*loss).estimates([3]) == []
    shift = (a_set(0.97, loss=(0.20, 0.01), cg=(0.02, 0.001)), a_set(0.03, cg=(0.005, 0.001)))
    assert answer_of(*shift).estimates([2]) == []
    clear = (a_set(0.97, loss=(0.20, 0.01), cg=(0.02, 0.001)), a_set(0.03, cg=(0.015, 0.001)))
    (found,) = answer_of(*clear).estimates([2])
    assert found.value[0, 0] == pytest.approx(0.015)
    unclear = (a_set(0.97, loss=(0.20, 0.01), cg=(0.02, 0.001)), a_set(0.03, cg=(0.001, 0.001)))
    assert answer_of(*unclear).estimates([2]) == []
    # What is left is found again without what fell.
    three = a_set(0.96, loss=(0.20, 0.01), last=(0.10, 0.01), cg=(0.02, 0.001))
    two = a_set(0.02, loss=(0.07, 0.005), last=(0.12, 0.01))
    one = a_set(0.02, last=(0.11, 0.01))
    (left,) = answer_of(three, two, one).estimates([3, 4])
    assert (left.candidate, left.value[0, 0]) == (4, pytest.approx(0.11))


def test_a_set_of_the_names_alone_is_fitted_where_the_search_has_none():
    both = a_set(0.98, loss=(0.20, 0.01), cg=(0.02, 0.001))
    rare = a_set(0.02, loss=(0.50, 0.01), mass=(1.0, 0.2))
    alone = a_set(1.0, loss=(0.15, 0.005))
    asked = []

    def fit_near(key, near):
        asked.append((key, near[3].values[0, 0]))
        return alone

    fitted = {both.key: both, rare.key: rare}
    search: Any = SimpleNamespace(fitted=fitted, candidates=ALL, fit_near=fit_near)
    (found,) = posterior_of(search).estimates([3])
    assert asked == [(frozenset({3}), 0.20)]
    assert found.value[0, 0] == pytest.approx(0.15)


@pytest.mark.parametrize(("along", "named"), [(0.20, [3]), (0.10, [])])
def test_a_rotor_is_named_by_a_steady_loss_and_one_along_a_channel_together(along, named):
    """A cause without a name is none; of the same rotor it counts for the loss."""
    uneven = candidate(curve_term("rotor", "airspeed", rotor=2), 1)
    errors = np.full(len(uneven.free), 0.01)
    other = EffectSet(
        key=frozenset({len(ALL)}),
        trials=(TrialEffect(candidate=uneven, values=uneven.start + 0.05),),
        set_score=SetScore(
            log_evidence=float(np.log(along)), step=0.0 * errors, variance=errors**2
        ),
        residual=np.zeros((1, 4)),
    )
    sets = [a_set(0.78, loss=(0.08, 0.01)), other, a_set(0.22 - along)]
    search: Any = SimpleNamespace(fitted={s.key: s for s in sets}, candidates=[*ALL, uneven])
    found = posterior_of(search)
    assert found.named_candidates() == named
    assert found.estimate(3).probability == pytest.approx(0.78 + along)
    assert found.one_of([]) == ()


def test_a_knot_that_no_flight_reaches_is_as_the_last_that_one_does():
    """Its error is that of its prior, 0.02; the first knot rests at 0 and is none of the free."""
    curve = candidate(curve_term("pitch", "airspeed"), 2)
    curve = replace(curve, free=((1, None), (2, None), (3, None)))
    values = curve.start.copy()
    values[:, :4] = 0.0, 0.004, 0.03, 0.002

    def estimate(*errors: float) -> list[float]:
        one = EffectSet(
            key=frozenset({0}),
            trials=(TrialEffect(candidate=curve, values=values),),
            set_score=SetScore(log_evidence=0.0, step=np.zeros(3), variance=np.square(errors)),
            residual=np.zeros((1, 4)),
        )
        search: Any = SimpleNamespace(fitted={one.key: one}, candidates=[curve])
        found = posterior_of(search).estimate(0)
        assert np.array_equal(found.value[0], found.value[1])
        return found.value[0, :4].tolist()

    assert estimate(0.004, 0.004, 0.004) == [0.0, 0.004, 0.03, 0.002]
    assert estimate(0.004, 0.004, 0.02) == [0.0, 0.004, 0.03, 0.03]
    assert estimate(0.02, 0.004, 0.004) == pytest.approx([0.0, 0.015, 0.03, 0.002])
