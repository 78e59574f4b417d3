"""When a rotor went bad: residuals that are a loss from a moment on, dated and weighed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, curve_model, made_flight, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.candidates import Candidate, derivatives
from thrustmargin.models.identification.sets import onsets
from thrustmargin.models.identification.sets.onsets import onset_candidates
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search

#: As the code has them, written down by hand: a change there is to be seen here.
FAR = 27.0

#: Variants of a rotor that degrades at some time.
IN_ONE, FOR_A_WHILE, IN_EACH = "onset", "for a while", "in each flight"
SINCE, UNTIL = "since", "until repaired"


def searched(durations: list[float], dated: bool = True) -> Search:
    """Flights ten minutes apart, the second the first in time, for a rotor that went bad."""
    flights = [made_flight(k, duration=d) for k, d in enumerate(durations)]
    if dated:
        order = [1, 0, *range(2, len(flights))][: len(flights)]
        flights = [
            replace(track, start_unix_s=1e9 + 600.0 * k)
            for k, track in zip(order, flights, strict=True)
        ]
    space = search_space(curve_model(), flights, effects_for(F16, table(["rotor_degradation"])))
    return Search(space.reduced, space.nuisance, space.candidates)


def loss_of(search: Search, rotor: int, size: float, when: Bools) -> Floats:
    """(N, R) rpm in modes that a rotor's loss takes in some means."""
    return size * derivatives(search.reduced, [search.start[rotor]], 0)[:, :, 0] * when[:, None]


def steps(search: Search, residual: Floats) -> list[Candidate]:
    """What is found about a set without effects that leaves a residual."""
    about = replace(search.fit(frozenset(), ()), residual=residual)
    search.fitted[frozenset()] = about
    return onset_candidates(search, about)


def value(one: Candidate, name: str, flight: int = 0) -> float:
    return float(one.start[flight, [p.name for p in one.term.effect.parameters].index(name)])


def acts(search: Search, one: Candidate) -> Bools:
    """The means in which a candidate has its loss."""
    x, flight = search.reduced.channels, search.reduced.flight
    variant = one.term.effect.variant
    if variant == SINCE:
        return x.clock_s >= value(one, "onset_clock")
    if variant == UNTIL:
        return (x.clock_s >= value(one, "onset_clock")) & (x.clock_s < value(one, "end_clock"))
    later = x.time_s >= value(one, "onset_time")
    if variant == IN_EACH:
        return later
    mine = one.free[0][1]
    assert {f for _, f in one.free} == {mine}
    if variant == FOR_A_WHILE:
        later &= x.time_s < value(one, "end_time", mine or 0)
    return later & (flight == mine)


def gain_of(search: Search, one: Candidate, residual: Floats) -> float:
    """What a loss of any size in these means takes of half the squares: g²/2h."""
    both = np.stack(
        [loss_of(search, one.term.rotor or 0, 1.0, acts(search, one)), residual], axis=2
    )
    gram = search.solved.reduce(search.nuisance.sums(both))
    return float(gram[0, 1] ** 2 / gram[0, 0] / 2.0)


THREE = searched([59.5, 61.6, 60.0])


@pytest.mark.parametrize("row", [14, 37, 60])
@pytest.mark.parametrize("variant", [IN_ONE, IN_EACH, SINCE])
def test_a_loss_begins_between_the_last_mean_without_it_and_the_first_with_it(variant, row):
    """The first flight's mean `row` is the first that has it; the flight is not the first flown."""
    x, flight = THREE.reduced.channels, THREE.reduced.flight
    when = {
        IN_ONE: (flight == 0) & (x.time_s >= x.time_s[row]),
        IN_EACH: x.time_s >= x.time_s[row],
        SINCE: x.clock_s >= x.clock_s[row],
    }[variant]
    best = steps(THREE, loss_of(THREE, 2, 0.1, when))[0]
    assert (best.term.rotor, best.term.effect.variant) == (2, variant)
    np.testing.assert_array_equal(acts(THREE, best), when)


def test_a_loss_is_dated_wherever_it_begins_between_the_times_that_are_tried_first():
    search = searched([60.0])
    time_s = search.reduced.channels.time_s
    for row in range(30, 38):  # 0.7 s apart, as those times are 5 s
        when = time_s >= time_s[row]
        best = steps(search, loss_of(search, 1, 0.1, when))[0]
        np.testing.assert_array_equal(acts(search, best), when)


@pytest.mark.parametrize("rows", [(15, 40), (30, 42), (12, 60)])
def test_a_loss_for_a_while_has_both_its_ends(rows):
    flight = THREE.reduced.flight
    when = np.zeros(flight.size, dtype=bool)
    when[np.flatnonzero(flight == 1)[slice(*rows)]] = True
    best = steps(THREE, loss_of(THREE, 0, 0.1, when))[0]
    assert (best.term.rotor, best.term.effect.variant) == (0, FOR_A_WHILE)
    np.testing.assert_array_equal(acts(THREE, best), when)


def test_a_loss_since_a_flight_is_in_all_that_were_flown_later():
    """The second flight was the first; a loss in its middle is in the two others throughout."""
    x, flight = THREE.reduced.channels, THREE.reduced.flight
    when = (flight != 1) | (x.time_s >= 30.0)
    best = steps(THREE, loss_of(THREE, 3, 0.1, when))[0]
    assert best.term.effect.variant == SINCE
    np.testing.assert_array_equal(acts(THREE, best), when)


def times(search: Search, flight: int | None) -> int:
    """How many times 5 s apart are tried, 8 s and more from both ends."""
    time_s = search.reduced.channels.time_s
    mine = time_s if flight is None else time_s[search.reduced.flight == flight]
    return sum(mine.min() + 8.0 + 5.0 * k < mine.max() - 8.0 for k in range(100))


def test_the_prior_of_a_step_is_a_bad_rotors_shared_by_kinds_and_all_that_was_tried():
    search = searched([59.5, 61.6])
    when = search.reduced.channels.time_s >= 30.0
    count = [times(search, f) for f in (0, 1, None)]
    assert count == [9, 9, 9]
    # A step in each flight and since each, any two in a flight, and a time of all flights.
    tried = 2 * (9 + 9 + 36) + 9
    for one in steps(search, loss_of(search, 1, 0.1, when)):
        assert one.log_prior == pytest.approx(np.log(0.005 / 5 / tried))
    undated = searched([59.5, 61.6], dated=False)
    for one in steps(undated, loss_of(undated, 1, 0.1, when)):
        assert one.log_prior == pytest.approx(np.log(0.005 / 5 / (2 * (9 + 36) + 9)))
        assert one.term.effect.variant != SINCE
    alone = searched([61.6])
    found = steps(alone, loss_of(alone, 1, 0.1, alone.reduced.channels.time_s >= 30.0))
    assert {one.term.effect.variant for one in found} == {IN_ONE, FOR_A_WHILE}
    assert all(one.log_prior == pytest.approx(np.log(0.005 / 5 / (9 + 36))) for one in found)


def test_a_step_counts_when_it_gains_3_more_than_the_choice_among_all_times():
    search = searched([61.6])
    residual = loss_of(search, 1, 0.1, search.reduced.channels.time_s >= 30.0)
    best = steps(search, residual)[0]
    least = 3.0 + np.log(9 + 36)
    just = np.sqrt(least / gain_of(search, best, residual))
    assert steps(search, 1.01 * just * residual)
    assert not steps(search, 0.99 * just * residual)
    assert not steps(search, -1.01 * just * residual)  # what gains thrust is no damage


def test_the_ten_steps_that_gain_most_are_kept_the_largest_first():
    search = searched([59.5, 61.6])
    x, flight = search.reduced.channels, search.reduced.flight
    residual = loss_of(search, 0, 0.03, (x.time_s >= 20.0) & (flight == 1))
    for rotor, size in ((1, 0.05), (2, 0.08), (3, 0.02)):
        residual += loss_of(search, rotor, size, x.time_s >= 30.0)
    found = steps(search, residual)
    gains = [gain_of(search, one, residual) for one in found]
    assert len(found) == 10
    assert gains == sorted(gains, reverse=True)
    assert gains[-1] > 3.0


def test_what_a_rotors_loss_from_the_beginning_says_far_better_is_no_step(monkeypatch):
    search = searched([59.5, 61.6])
    always = np.ones(search.reduced.flight.size, dtype=np.bool_)
    residual = loss_of(search, 1, 0.1, always)
    whole = []
    for rotor in range(4):
        both = np.stack([loss_of(search, rotor, 1.0, always), residual], axis=2)
        gram = search.solved.reduce(search.nuisance.sums(both))
        whole.append(max(gram[0, 1], 0.0) ** 2 / gram[0, 0] / 2.0)
    kept = [one.key for one in steps(search, residual)]
    monkeypatch.setattr(onsets, "FAR", np.inf)
    every = steps(search, residual)
    near = [
        one.key
        for one in every
        if gain_of(search, one, residual) > whole[one.term.rotor or 0] - FAR
    ]
    assert kept == near
    assert "rotor_degradation:in each flight@2" in {one.key for one in every} - set(kept)


def test_of_more_than_24_flights_no_moment_of_a_single_one_is_looked_for():
    for count, of_one in ((24, True), (25, False)):
        search = searched([20.0] * count)
        when = (search.reduced.channels.time_s >= 10.0) & (search.reduced.flight == 3)
        found = steps(search, loss_of(search, 1, 0.1, when))
        assert any(one.term.effect.variant == IN_ONE for one in found) == of_one
        others = {IN_EACH, SINCE, UNTIL}  # these by flights
        assert of_one or {one.term.effect.variant for one in found} <= others


@pytest.mark.parametrize(("first", "stop"), [(2, 4), (0, 3), (1, 5)])
def test_a_loss_in_some_flights_in_a_row_is_dated_between_flights(first, stop):
    """Flights by their clock: the second flown is the first of the list, and the first its second.

    It ends before the last one, so it was repaired; nothing is free but its size and its torque.
    """
    search = searched([30.0] * 6)
    order = [1, 0, 2, 3, 4, 5]  # place in time of each flight of the list
    place = np.array(order)[search.reduced.flight]
    when = (place >= first) & (place < stop)
    best = steps(search, loss_of(search, 2, 0.1, when))[0]
    assert (best.term.rotor, best.term.effect.variant) == (2, UNTIL)
    np.testing.assert_array_equal(acts(search, best), when)
    assert {best.term.effect.parameters[k].name for k, _ in best.free} == {"loss", "torque_share"}


def test_a_loss_from_the_sixteenth_of_thirty_flights_on_is_found_between_them():
    search = searched([20.0] * 30)
    place = search.reduced.flight
    best = steps(search, loss_of(search, 1, 0.05, place >= 15))[0]
    assert (best.term.rotor, best.term.effect.variant) == (1, SINCE)
    np.testing.assert_array_equal(acts(search, best), place >= 15)


def test_without_clocks_or_with_two_flights_nothing_is_in_a_row():
    for search in (searched([30.0] * 4, dated=False), searched([30.0] * 2)):
        found = steps(search, loss_of(search, 1, 0.1, search.reduced.flight == 1))
        assert UNTIL not in {one.term.effect.variant for one in found}


def test_no_step_is_found_in_flights_that_are_too_short_for_one():
    search = searched([16.0, 16.0])
    assert not steps(search, loss_of(search, 1, 0.1, search.reduced.channels.time_s >= 8.0))
    search = searched([16.0, 60.0])
    when = (search.reduced.channels.time_s >= 30.0) & (search.reduced.flight == 1)
    best = steps(search, loss_of(search, 1, 0.1, when))[0]
    np.testing.assert_array_equal(acts(search, best), when)


def test_steps_are_looked_for_beside_the_other_effects_of_a_set_and_not_beside_its_bad_rotors():
    flights = [made_flight(k, duration=60.0, hidden_mass=3.0) for k in (1, 2)]
    catalogue = effects_for(F16, table(["extra_mass", "rotor_degradation"]))
    space = search_space(curve_model(), flights, catalogue)
    search = Search(space.reduced, space.nuisance, space.candidates)
    keys = [c.key for c in search.candidates]
    mass, bad = keys.index("extra_mass"), keys.index("rotor_degradation@4")
    heavy = search.fit(frozenset({mass}), ())
    whole = search.fit(frozenset({mass, bad}), ())
    when = search.reduced.channels.time_s >= 30.0
    about = [*heavy.trials, search.start[keys.index("rotor_degradation@2")]]
    step = 0.1 * derivatives(search.reduced, about, 1)[:, :, 0] * when[:, None]
    search.fitted[heavy.key] = replace(heavy, residual=step)
    best = onset_candidates(search, whole)[0]
    assert (best.term.rotor, best.term.effect.variant) == (1, IN_EACH)
    np.testing.assert_array_equal(acts(search, best), when)
    # Where it is not fitted yet it is, and sound flights have no step.
    del search.fitted[heavy.key]
    assert onset_candidates(search, whole) == []
    assert heavy.key not in search.fitted


def test_times_are_tried_every_five_seconds_and_not_within_a_pause():
    """Of 0 to 30 s and again from a million s on: 8 s are kept clear of both ends."""
    flown = np.concatenate([np.arange(0.0, 30.0, 0.5), 1e6 + np.arange(0.0, 20.0, 0.5)])
    tried = onsets._grid(flown)
    np.testing.assert_allclose(
        tried, [8.0, 13.0, 18.0, 23.0, 28.0, 1e6 - 2.0, 1e6 + 3.0, 1e6 + 8.0]
    )
    assert onsets._grid(np.arange(0.0, 15.0)).size == 0
