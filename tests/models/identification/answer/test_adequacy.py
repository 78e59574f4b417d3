"""What names leave unexplained: in which mode, along which channel, how much of it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.identification.answer import accepted_names, adequacy
from thrustmargin.models.identification.answer.adequacy import (
    _channel_of,
    _evidence,
    _free_part,
    _sound_part,
    acts_in,
    closest_to,
    discrepancy_rms,
    unexplained,
    with_free,
)
from thrustmargin.models.identification.answer.posterior import Posterior
from thrustmargin.models.identification.answer.result import OneOf
from thrustmargin.models.identification.loop import identify_checked
from thrustmargin.models.identification.rows.candidates import Held, Term, predicted
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.sets.nuisance import LEVELS
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
CONSTANT_FACTOR = 2.0

MODEL = curve_model()
DIRECTIONS = modes(F16).directions
SIZE = 60.0  # rpm, amplitude of the wave in its mode


def flights_with_wave(mode: int | None):
    """Flights with a wave of the airspeed in one mode, which no effect of the table has."""
    flights = []
    for track in made_flights(3, duration=120.0):
        wave = np.zeros((track.time_s.size, 4))
        if mode is not None:
            wave = SIZE * np.sin(2.0 * track.airspeed)[:, None] * DIRECTIONS[:, mode]
        flights.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + wave))
    return flights


def searched(mode: int | None, keys=("rotor_degradation", "cg_offset", "extra_mass"), model=MODEL):
    space = search_space(model, flights_with_wave(mode), effects_for(F16, table(keys)))
    return space, Search(space.reduced, space.nuisance, space.candidates)


@pytest.mark.parametrize("mode", [1, 3])
def test_a_wave_that_no_effect_has_is_left_in_its_mode_with_its_size_along_its_channel(mode):
    space, search = searched(mode)
    left = unexplained(space, search, search.fit(frozenset(), ()))
    assert left is not None
    assert left.mode == mode
    assert left.channel == "airspeed"
    x = space.reduced.channels
    wave = SIZE * np.sin(2.0 * x.airspeed)
    assert left.rms_rpm == pytest.approx(np.sqrt(np.mean(wave**2)), rel=0.2)
    assert np.corrcoef(left.curve_rpm, wave)[0, 1] > 0.8
    assert 0.8 < left.share <= 1.0


def test_the_free_form_takes_what_a_dense_model_expects_of_it():
    """Of r with the covariance V of noise and all nuisances at the widest level, curves F of
    size D have D² F' V^-1 r."""
    flights = [track.rows(slice(0, 500)) for track in flights_with_wave(1)[:2]]
    catalogue = effects_for(F16, table(["extra_mass"]))
    space = search_space(MODEL, flights, catalogue)
    nuisance, rows = space.nuisance, space.nuisance.scatter.shape[0]
    widest, parts = LEVELS[-1], []
    for of in nuisance.flights:
        own = np.zeros_like(nuisance.scatter)
        own[of] = nuisance.scatter[of]
        parts.append(own.reshape(rows * 4, -1))
    parts.append(nuisance.uncertainty.reshape(rows * 4, -1))
    curves = np.zeros((rows, 4, 4, nuisance.free.shape[2]))
    sizes = np.full((4, nuisance.free.shape[2]), widest.moments)
    sizes[0] = widest.collective
    sizes[:, 0] = CONSTANT_FACTOR
    for mode in range(4):
        curves[:, mode, mode] = sizes[mode] * nuisance.free[mode]
    parts.append(curves.reshape(rows * 4, -1))
    whole = np.concatenate(parts, axis=1)
    x = space.reduced
    residual = x.in_modes(x.measured_rpm) - predicted(x, ())
    white = nuisance.whitening.apply(residual).ravel()
    drawn = parts[-1].T @ np.linalg.solve(np.eye(rows * 4) + whole @ whole.T, white)
    taken = drawn.reshape(4, -1) * space.sizes
    taken *= sizes
    expected = np.sqrt(np.mean((space.hats @ taken.T) ** 2, axis=0))
    np.testing.assert_allclose(discrepancy_rms(MODEL, flights, catalogue), expected, rtol=1e-6)


def dense_evidence(name: str, mode: int, space, white) -> float:
    """Log evidence of whitened rows (n, R), all that is normal in one covariance."""
    nuisance, found = space.nuisance, []
    rows, modes_ = white.shape
    for freedom in (4.0, 16.0):
        parts = [nuisance.uncertainty.reshape(rows * modes_, -1)]
        for of in nuisance.flights:
            own = np.zeros_like(nuisance.scatter)
            own[of] = nuisance.scatter[of]
            parts.append(own.reshape(rows * modes_, -1))
        for m in range(modes_):
            size = np.ones(len(space.groups))
            if m == mode:
                size[[g in (name, "constant") for g in space.groups]] = freedom
            curves = np.zeros((rows, modes_, size.size))
            curves[:, m] = size * nuisance.free[m]
            parts.append(curves.reshape(rows * modes_, -1))
        whole = np.concatenate(parts, axis=1)
        covariance = np.eye(rows * modes_) + whole @ whole.T
        flat = white.ravel()
        square = flat @ np.linalg.solve(covariance, flat)
        found.append(-0.5 * float(square + np.linalg.slogdet(covariance)[1]))
    return max(found)


def test_the_channel_is_that_of_most_evidence_by_a_dense_model():
    """Time, tank level and their curves go together in a flight: not the widest family wins."""
    flights = []
    for track in made_flights(2, duration=60.0):
        wave = 40.0 * np.sin(track.time_s / 20.0)
        speed = track.rotor_speed_rpm + wave[:, None] * DIRECTIONS[:, 0]
        flights.append(replace(track, rotor_speed_rpm=speed))
    space = search_space(MODEL, flights, effects_for(F16, table(["extra_mass"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    empty = search.fit(frozenset(), ())
    white = space.nuisance.whitening.apply(np.nan_to_num(empty.residual)[:, :, None])[:, :, 0]
    names = [n for n in dict.fromkeys(space.groups) if n != "constant"]
    shared = space.nuisance.sums(np.nan_to_num(empty.residual)[:, :, None])[0][:, 0]
    loose = [np.isin(space.groups, [n, "constant"]) for n in names]
    ours = np.array([_evidence(search.solved, shared, 0, one) for one in loose])
    dense = np.array([dense_evidence(n, 0, space, white) for n in names])
    np.testing.assert_allclose(ours - ours[0], dense - dense[0], atol=1e-6 * np.abs(dense).max())

    assert _channel_of(0, space, search, empty) == "time_s"


@pytest.mark.parametrize(("gain", "channel"), [(2.9, "airspeed"), (3.1, "airspeed x tank_kg")])
def test_two_channels_together_need_twenty_times_the_odds_of_one(monkeypatch, gain, channel):
    space, search = searched(1)
    of = {"airspeed": 10.0, "airspeed x tank_kg": 10.0 + gain}

    def evidence(*given):
        loose = set(np.array(space.groups)[given[-1]])
        assert "constant" in loose  # what stands goes with no channel
        (name,) = loose - {"constant"}
        return of.get(name, 0.0)

    monkeypatch.setattr(adequacy, "_evidence", evidence)
    assert _channel_of(1, space, search, search.fit(frozenset(), ())) == channel


def test_sound_flights_leave_nothing():
    space, search = searched(None)
    assert unexplained(space, search, search.fit(frozenset(), ())) is None


@pytest.mark.parametrize("wave_mode", [None, 1])
def test_what_the_values_of_a_set_take_is_not_left_wherever_it_is_linearised(wave_mode):
    """A set may stand away from its likeliest values, which are then a step further on."""
    space, search = searched(wave_mode)
    key = frozenset(k for k, c in enumerate(search.candidates) if c.key == "cg_offset")
    best = search.fit(key, ())
    (held,) = best.held
    away = search._fit(key, [held.moved(np.array([0.01, -0.01]))], 0)
    apart = np.sqrt(np.mean((away.residual - best.residual) ** 2))
    assert apart > 10.0  # rpm
    here, there = (_free_part(space, search, one) for one in (best, away))
    assert here.keys() == there.keys()
    for name, curve in here.items():
        np.testing.assert_allclose(there[name], curve, atol=0.5)


def test_what_good_flights_show_too_is_no_finding():
    """A model that is off along its own inputs is off by as much on a sound aircraft."""
    catalogue = effects_for(F16, table(["extra_mass"]))
    shown = discrepancy_rms(MODEL, flights_with_wave(1), catalogue)
    assert shown[1] == pytest.approx(SIZE * np.sqrt(0.5), rel=0.3)
    assert np.all(shown[[0, 2, 3]] < 0.1 * shown[1])
    for factor, found in ((1.0, False), (0.2, True)):
        known = GoodFlights(flights=9, free_form_rpm=tuple((factor * shown).tolist()))
        space, search = searched(1, model=replace(MODEL, good_flights=known))
        left = unexplained(space, search, search.fit(frozenset(), ()))
        assert (left is not None) == found
        assert unexplained(space, search, search.fit(frozenset(), ()), named=True) is not None


def test_what_motor_outputs_have_in_common_is_not_left_unexplained():
    space, search = searched(0)
    empty = search.fit(frozenset(), ())
    assert unexplained(space, search, empty) is not None
    search.reduced = replace(search.reduced, of_outputs=True)
    left = unexplained(space, search, empty)
    assert left is None or left.mode != 0


def test_an_effect_acts_in_the_mode_of_most_of_its_change():
    _, search = searched(None)
    by_key = {c.key: c for c in search.candidates}
    mass = Held(candidate=by_key["extra_mass"], values=np.full((3, 1), 2.0))
    assert [acts_in(search, mass, [m]) for m in range(4)] == [True, False, False, False]
    one = by_key["rotor_degradation@1"]
    values = one.start.copy()
    values[:, 0] = 0.1
    rotor = Held(candidate=one, values=values)
    assert not any(acts_in(search, rotor, [m, n]) for m in range(4) for n in range(m))
    assert acts_in(search, rotor, [0, 1, 2])


def test_an_effect_in_a_mode_that_is_left_is_no_name_though_another_mode_has_more_left():
    flights = []
    for track in made_flights(3, duration=120.0):
        wave = np.sin(2.0 * track.airspeed)[:, None]
        lasting = 15.0 * DIRECTIONS[:, 1] + 0.0 * wave
        both = SIZE * wave * DIRECTIONS[:, 1] + 2.0 * SIZE * wave * DIRECTIONS[:, 0]
        speed = track.rotor_speed_rpm + lasting + both
        flights.append(replace(track, rotor_speed_rpm=speed))
    space = search_space(MODEL, flights, effects_for(F16, table(["cg_offset"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    shifted = search.fit(frozenset({0}), ())
    left = unexplained(space, search, shifted)
    assert left is not None
    assert (left.mode, left.modes) == (0, (0, 1))
    whole = np.mean(np.sum(shifted.residual**2, axis=1))  # of which four fifths are in mode 0
    assert left.share == pytest.approx(left.rms_rpm**2 / whole)
    assert left.share == pytest.approx(0.8, abs=0.1)
    assert acts_in(search, shifted.held[0], left.modes)
    assert not acts_in(search, shifted.held[0], [left.mode])


def test_a_name_by_the_channel_that_the_unexplained_goes_with_is_only_closest():
    flights = [
        replace(
            track,
            rotor_speed_rpm=track.rotor_speed_rpm
            + SIZE * np.sin(2.0 * track.airspeed)[:, None] * DIRECTIONS[:, 1],
        )
        for track in made_flights(3, duration=120.0)
    ]
    names = ["extra_mass", "parasite_drag", "cg_offset"]
    space = search_space(MODEL, flights, effects_for(F16, table(names)))
    search = Search(space.reduced, space.nuisance, space.candidates)
    by_key = {c.key: k for k, c in enumerate(search.candidates)}
    mass, drag, cg = (by_key[name] for name in names)
    best = search.fit(frozenset({mass, drag, cg}), ())
    left = unexplained(space, search, best, named=True)
    assert left is not None
    assert (left.mode, "airspeed" in left.channel) == (1, True)
    # Drag acts in the collective alone, but by airspeed; a mass does neither.
    assert closest_to(left, [mass, drag, cg], search, best) == [drag, cg]
    elsewhere = replace(left, channel="time_s", modes=(3,))
    assert closest_to(elsewhere, [mass, drag, cg], search, best) == []
    assert closest_to(None, [mass, drag, cg], search, best) == []


def waving(size_rpm: float, lasting_rpm: float = 0.0):
    """What is left of a wave of a size in roll, beside a standing roll that has a name."""
    flights = []
    for track in made_flights(3, duration=120.0):
        speed = size_rpm * np.sin(2.0 * track.airspeed)[:, None] + lasting_rpm
        speed = track.rotor_speed_rpm + speed * DIRECTIONS[:, 1]
        flights.append(replace(track, rotor_speed_rpm=speed))
    space = search_space(MODEL, flights, effects_for(F16, table(["cg_offset"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    best = search.fit(frozenset({0} if lasting_rpm else ()), ())
    return space, unexplained(space, search, best)


@pytest.mark.parametrize(("share", "found"), [(0.1, False), (0.25, True)])
def test_names_may_leave_15_percent_of_what_is_explained_in_a_mode(share, found):
    """A wave has half of its square: so much of it and of a standing roll of 60 rpm."""
    wave = 60.0 * np.sqrt(2.0 * share / (1.0 - share))
    assert (waving(wave, 60.0)[1] is not None) == found


@pytest.mark.parametrize(("times", "found"), [(2.0, False), (4.5, True)])
def test_what_is_left_is_three_times_what_a_sound_aircraft_leaves(times, found):
    space, _ = waving(60.0)
    sound = np.sqrt(np.mean(space.hats**2, axis=0) @ space.sizes[1] ** 2)
    assert (waving(times * sound * np.sqrt(2.0))[1] is not None) == found


def test_a_sound_aircraft_leaves_what_its_sizes_give_or_what_good_flights_showed():
    """A hat of the height h is of the size s: the mean square of all is the sum of (s h)²."""
    space, _ = searched(None)
    usual = [sum(np.mean((space.hats * size) ** 2, axis=0)) for size in space.sizes]
    np.testing.assert_allclose(_sound_part(space, named=False), usual)
    shown = (2.0 * np.sqrt(usual[0]), 0.0, 0.0, 0.0)
    for rms, most in ((shown, 4.0 * usual[0]), ((), usual[0])):
        good = GoodFlights(flights=9, free_form_rpm=rms)
        space, _ = searched(None, model=replace(MODEL, good_flights=good))
        np.testing.assert_allclose(_sound_part(space, named=False), [most, *usual[1:]])
        np.testing.assert_allclose(_sound_part(space, named=True), usual)


def wandering(size_rpm: float, slow_rpm: tuple[float, ...], mode: int = 2):
    """What is left of flights of which a mode is by turns above and below for 25 s each."""
    flights = []
    for track in made_flights(3, duration=200.0):
        way = np.where(track.time_s % 50.0 < 25.0, size_rpm, -size_rpm)
        speed = track.rotor_speed_rpm + way[:, None] * DIRECTIONS[:, mode]
        flights.append(replace(track, rotor_speed_rpm=speed))
    good = GoodFlights(flights=9, slow_rpm=slow_rpm) if slow_rpm else None
    model = replace(MODEL, good_flights=good)
    space = search_space(model, flights, effects_for(F16, table(["extra_mass"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    return space, search, search.fit(frozenset(), ())


def test_a_mode_that_comes_and_goes_more_than_in_good_flights_is_unexplained_and_takes_no_name():
    """Steps of 40 rpm over 25 s are slow noise of 40 / 0.75 rpm: three times 17.8."""
    left = unexplained(*wandering(40.0, (17.0,) * 4))
    assert left is not None
    assert (left.mode, left.modes, left.channel, left.wanders) == (2, (2,), "time_s", True)
    assert left.rms_rpm == pytest.approx(40.0, rel=0.1)
    assert 0.8 < left.share <= 1.0
    _, search, _ = wandering(40.0, (17.0,) * 4)
    mass = search.fit(frozenset({0}), ())
    assert closest_to(replace(left, modes=(0, 1, 2, 3)), [0], search, mass) == []
    assert unexplained(*wandering(40.0, (20.0,) * 4)) is None
    assert unexplained(*wandering(40.0, ())) is None
    space, search, best = wandering(40.0, (17.0,) * 4, mode=0)
    assert unexplained(space, search, best) is not None
    space = replace(space, reduced=replace(space.reduced, of_outputs=True))
    assert unexplained(space, search, best) is None  # outputs are not measured thrust


def pumping(rotor: int, size_rpm: float):
    """Flights of which rotor 3 is always 80 rpm faster, and another one while the pump is on."""
    flights = []
    for track in made_flights(3, duration=120.0):
        on = (track.time_s % 40.0 < 28.0).astype(float)
        faster = np.zeros((track.time_s.size, 4))
        faster[:, 2] = 80.0
        faster[:, rotor] = size_rpm * on
        speed = track.rotor_speed_rpm + faster
        flights.append(replace(track, spraying=on, rotor_speed_rpm=speed))
    return flights


def test_a_name_stands_only_if_it_does_beside_what_no_effect_explains():
    """A rotor that is weak while the pump runs is no weak rotor: it took two names."""
    found = identify_checked(pumping(1, 80.0), MODEL, catalogue=table(["rotor_degradation"]))
    assert found.left is not None
    assert (found.left.channel, found.left.modes) == ("spraying", (2, 3))
    assert not found.found
    assert {t.rotor for t in found.closest} == {1, 2}
    assert [m.rotor for m in found.mentioned if m.probability > 0.8] == [2]


def test_what_a_name_of_the_unexplained_hid_is_named_beside_it(monkeypatch: pytest.MonkeyPatch):
    """Two rotors for what the pump does had taken the place of a mass: here it is left out by
    hand."""
    looks, named = [], Posterior.named

    def names(answer: Posterior) -> list[int]:
        every = answer.search.candidates
        found = [c for c in named(answer) if looks or every[c].term.effect.name != "extra_mass"]
        looks.append(found)
        return found

    monkeypatch.setattr(Posterior, "named", names)
    heavy = [replace(t, rotor_speed_rpm=1.03 * t.rotor_speed_rpm) for t in pumping(1, 80.0)]
    found = identify_checked(
        heavy, MODEL, catalogue=table(["extra_mass", "rotor_degradation"]), held_out=heavy[:1]
    )
    assert [one.term.effect.name for one in found.found] == ["extra_mass"]
    assert 2 in {t.rotor for t in found.closest}


def test_beside_the_unexplained_its_channel_is_free_in_all_modes_and_a_constant_in_its_own():
    space, search = searched(1)
    left = unexplained(space, search, search.fit(frozenset(), ()))
    assert left is not None
    known = space.nuisance.uncertainty.shape[2]
    free = with_free(space, replace(left, modes=(1, 3))).uncertainty[:, :, known:]
    along = [k for k, name in enumerate(space.groups) if name == "airspeed"]
    at, columns = 0, np.zeros((len(space.hats), 4, 4 * len(along) + 2))
    for mode in range(4):
        for k in along:
            columns[:, mode, at] = 16.0 * space.sizes[mode, k] * space.hats[:, k]
            at += 1
        if mode in (1, 3):
            columns[:, mode, at] = 16.0 * space.sizes[mode, along[0]]
            at += 1
    np.testing.assert_allclose(free, space.nuisance.whitening.apply(columns))


@pytest.mark.parametrize(("rms_rpm", "left"), [(1.0, True), (100.0, False)])
def test_where_no_name_is_kept_what_good_flights_leave_too_is_no_finding(rms_rpm, left):
    """The rotors that were named for it stay to be inspected, as far as they are likely."""
    model = replace(MODEL, good_flights=GoodFlights(flights=9, free_form_rpm=(rms_rpm,) * 4))
    found = identify_checked(pumping(1, 80.0), model, catalogue=table(["rotor_degradation"]))
    assert not found.found
    assert (found.left is not None) == left
    assert {t.rotor for t in found.closest} == ({1, 2} if left else set())
    assert [m.rotor for m in found.mentioned if m.probability > 0.8] == [2]


@pytest.mark.parametrize(("offset", "left"), [(60.0, True), (0.0, False)])
def test_names_that_are_only_closest_but_predict_leave_something_unexplained(offset, left):
    """Also where good flights leave as much: what such a name takes, they did not."""
    model = replace(MODEL, good_flights=GoodFlights(flights=9, free_form_rpm=(100.0,) * 4))
    flights = []
    for track in flights_with_wave(2):
        faster = offset * DIRECTIONS[:, 2]
        flights.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + faster))
    found = identify_checked(flights, model, catalogue=table(["cg_offset"]))
    assert not found.found
    assert (found.left is not None) == left
    assert [t.effect.name for t in found.closest] == ["cg_offset"] * left


@pytest.mark.parametrize(("rms_rpm", "left"), [(1.0, True), (100.0, False)])
def test_beside_names_that_all_stand_what_good_flights_leave_too_is_no_finding(rms_rpm, left):
    """It may make a name doubtful, and is looked at for that; then it is nothing new."""
    model = replace(MODEL, good_flights=GoodFlights(flights=9, free_form_rpm=(rms_rpm,) * 4))
    heavy = [
        replace(t, rotor_speed_rpm=1.03 * t.rotor_speed_rpm) for t in flights_with_wave(mode=1)
    ]
    found = identify_checked(heavy, model, catalogue=table(["extra_mass"]))
    assert [one.term.effect.name for one in found.found] == ["extra_mass"]
    assert (found.left is not None) == left
    assert found.closest == ()


def test_what_is_likely_but_not_said_explains_nothing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Posterior, "named", lambda *_: [])
    flights = []
    for track in made_flights(3, duration=120.0):
        faster = 8.0 * track.tank_kg[:, None] * DIRECTIONS[:, 2]
        flights.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + faster))
    catalogue = table(["cg_offset:tank", "extra_mass"])
    found = identify_checked(flights, MODEL, catalogue=catalogue)
    assert found.unexplained()["mode"] == "pitch"
    assert found.unexplained()["closest"] == ["cg_offset"]
    with monkeypatch.context() as without:
        without.setattr(accepted_names, "closest_to", lambda *_: [])
        assert identify_checked(flights, MODEL, catalogue=catalogue).left is None
    either = OneOf(terms=found.closest, probabilities=(0.9,))
    monkeypatch.setattr(Posterior, "one_of", lambda *_: (either,))
    assert identify_checked(flights, MODEL, catalogue=catalogue).left is None


def test_a_loss_is_that_beside_a_mass_that_may_be_thin_air(monkeypatch: pytest.MonkeyPatch):
    worn = made_flights(3, loss=0.06, hidden_mass=1.5)
    named = Posterior.named

    def rotors(answer: Posterior) -> list[int]:
        every = answer.search.candidates
        return [c for c in named(answer) if every[c].term.rotor is not None]

    either: list[OneOf] = []
    monkeypatch.setattr(Posterior, "named", rotors)
    monkeypatch.setattr(Posterior, "one_of", lambda *_: tuple(either))
    catalogue = effects_for(F16, table(["rotor_degradation", "extra_mass"]))
    (alone,) = identify_checked(worn, MODEL, catalogue=catalogue).found
    mass = next(e for e in catalogue if e.name == "extra_mass")
    either.append(OneOf(terms=(Term(effect=mass, rotor=None),), probabilities=(0.9,)))
    (beside,) = identify_checked(worn, MODEL, catalogue=catalogue).found
    assert alone.value[0, 0] > 0.075
    assert beside.value[0, 0] == pytest.approx(0.06, abs=0.006)


def test_a_rotor_that_is_likely_and_gets_no_name_is_said(monkeypatch: pytest.MonkeyPatch):
    """Also where its name fell because it takes too little of the error on flights left out."""
    monkeypatch.setattr(accepted_names, "that_matter", lambda *_: [])
    worn = made_flights(3, loss=0.06)
    found = identify_checked(worn, MODEL, catalogue=table(["rotor_degradation"]))
    assert not found.found
    assert [m.rotor for m in found.mentioned if m.probability > 0.95] == [0]
