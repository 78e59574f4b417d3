"""A weak rotor of which the loss is not the same share of its thrust all along."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.coefficient.rotor_degradation import ROTOR_DEGRADATION_ONSET
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer import accepted_names
from thrustmargin.models.identification.answer import uneven_loss as uneven
from thrustmargin.models.identification.answer.adequacy import beside, closest_to
from thrustmargin.models.identification.answer.uneven_loss import (
    law_columns,
    uneven_loss,
    unexplained_loss,
)
from thrustmargin.models.identification.loop import identify_checked
from thrustmargin.models.identification.rows.candidates import (
    Held,
    Term,
    candidate,
    derivatives,
)
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.sets.nuisance import LEVELS
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search

#: As the code has them, written down by hand: a change there is to be seen here.
CONSTANT_FACTOR = 2.0

MODEL = curve_model()
CATALOGUE = effects_for(F16, table(["rotor_degradation", "extra_mass"]))
SIZE, ROTOR = 0.06, 2
ROLL = 50.0 * modes(F16).directions[:, 1]  # rpm
#: rpm² of blocks left out, without a loss and with it
BORNE_OUT = np.array([2.0, 3.0, 5.0, 4.0, 6.0]), np.array([1.0, 2.0, 3.0, 3.0, 4.0])


def lost_thrust(track: FlightTrack, law: str) -> np.ndarray:
    """(T,) share of its thrust that a rotor lacks, by a law of its own."""
    share = (track.tank_kg + F16.empty_mass) / (12.0 + F16.empty_mass)
    shape = {
        "steady": np.ones_like(share),
        "bends": np.maximum(share - 0.75, 0.0) / 0.25,
        "in fast flight": 0.6 + track.airspeed / 7.0,
        "warm": track.time_s / 60.0,
        "swings": 2.0 * np.exp(-(((share - 1.0) / 0.06) ** 2)),
    }
    return SIZE * shape[law]


def flights(law: str) -> list[FlightTrack]:
    found = []
    for track in made_flights(4, duration=120.0):
        speed = track.rotor_speed_rpm.copy()
        speed[:, ROTOR] /= np.sqrt(1.0 - lost_thrust(track, law))
        found.append(replace(track, rotor_speed_rpm=speed))
    return found


def searched(law: str) -> Search:
    space = search_space(MODEL, flights(law), CATALOGUE)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.run()
    return search


def test_a_steady_loss_keeps_its_name():
    found = identify_checked(flights("steady"), MODEL, catalogue=CATALOGUE)
    assert [f.term.key for f in found.found] == [f"rotor_degradation@{ROTOR + 1}"]
    assert found.left is None


@pytest.mark.parametrize(
    ("law", "channel"),
    [
        ("bends", "rotor_thrust"),
        ("swings", "rotor_thrust"),
        ("in fast flight", "airspeed"),
        ("warm", "time_s"),
    ],
)
def test_a_loss_that_goes_along_a_channel_is_no_name_and_says_the_rotor_and_the_channel(
    law, channel
):
    found = identify_checked(flights(law), MODEL, catalogue=CATALOGUE)
    assert found.found == ()
    assert found.left is not None
    assert (found.left.rotor, found.left.channel) == (ROTOR, channel)
    assert [t.key for t in found.closest] == [f"rotor_degradation@{ROTOR + 1}"]
    assert [m.rotor for m in found.mentioned] == [ROTOR]  # nobody may fly on with it unasked
    assert found.unexplained()["rotor"] == ROTOR + 1
    assert f"rotor {ROTOR + 1} along {channel}" in repr(found)


def test_what_it_does_is_how_the_loss_differs_from_a_steady_one():
    law = "bends"
    search = searched(law)
    best = search.best
    one = uneven_loss(search, best)
    assert one is not None
    x = search.reduced
    share = (x.channels.tank_kg + F16.empty_mass) / (12.0 + F16.empty_mass)
    loss = SIZE * np.maximum(share - 0.75, 0.0) / 0.25
    speed = np.sqrt(share / (1.0 - loss)) / np.sqrt(share / (1.0 - loss.mean()))
    hover = x.measured_rpm[:, ROTOR] * (1.0 - 1.0 / speed)
    changed = one.change @ x.modes.directions.T
    assert np.corrcoef(changed[:, ROTOR], hover)[0, 1] > 0.95
    assert np.std(changed[:, ROTOR]) == pytest.approx(np.std(hover), rel=0.35)


@pytest.mark.parametrize("law", [(ROTOR, "airspeed"), (0, "rotor_thrust")])
def test_the_odds_are_those_of_a_dense_model(law):
    """Of r with the covariance V of noise, nuisances, forms and free values, against V + A A' with
    the columns A: half the difference of r' V^-1 r, less half that of ln det V."""
    search = searched("bends")
    best = search.best
    space = search.nuisance
    (c,) = sorted(best.key)
    columns = law_columns(search, best, law[0])[law[1]]
    other = {(1, "rotor_thrust"): law_columns(search, best, 1)["rotor_thrust"]}
    odds, taken = uneven._against_steady(search, best, {**other, law: columns})[law]
    about = search.columns_about(best)
    wide = about.whole.wide(search.reduced.flight)
    first, last = about.columns[c].start, about.columns[c].stop
    rows, modes = space.scatter.shape[:2]

    def white(some):
        return space.whitening.apply(some).reshape(rows * modes, -1)

    parts = [space.uncertainty.reshape(rows * modes, -1)]
    for of in space.flights:
        own = np.zeros_like(space.scatter)
        own[of] = space.scatter[of]
        parts.append(own.reshape(rows * modes, -1))
    level = LEVELS[best.best_level]
    for mode in range(modes):
        size = np.full(space.free.shape[2], level.collective if mode == 0 else level.moments)
        size[0] = CONSTANT_FACTOR
        own = np.zeros((rows, modes, space.free.shape[2]))
        own[:, mode] = size * space.free[mode]
        parts.append(own.reshape(rows * modes, -1))
    parts.append(white(wide[:, :, about.asked :]))
    values = white(wide[:, :, first:last])
    parts.append(values / np.linalg.norm(values, axis=0) * 1e4)  # free
    whole = np.concatenate(parts, axis=1)
    steady = np.eye(rows * modes) + whole @ whole.T
    more = white(columns)
    left = white(wide[:, :, [about.asked - 1]])[:, 0]

    def log_likelihood(v):
        return -0.5 * (left @ np.linalg.solve(v, left) + np.linalg.slogdet(v)[1])

    assert odds == pytest.approx(
        log_likelihood(steady + more @ more.T) - log_likelihood(steady), abs=0.02
    )
    along = more.T @ np.linalg.solve(steady + more @ more.T, left)
    np.testing.assert_allclose(taken, along, rtol=0.01, atol=1e-3)


def test_what_the_values_of_a_set_may_do_is_no_law():
    """All values of a set are free: a law that does what one of them does has even odds."""
    names = ["rotor_degradation", "extra_mass"]
    space = search_space(MODEL, flights("steady"), effects_for(F16, table(names)))
    search = Search(space.reduced, space.nuisance, space.candidates)
    by_key = {c.key: k for k, c in enumerate(search.candidates)}
    key = {by_key["extra_mass"], by_key["rotor_degradation@4"]}  # the last of the candidates
    best = search.fit(frozenset(key), ())
    for c, held in zip(sorted(key), best.held, strict=True):
        column = np.nan_to_num(derivatives(search.reduced, best.held, sorted(key).index(c)))
        law = (ROTOR, held.candidate.key)
        odds, _ = uneven._against_steady(search, best, {law: 0.05 * column[:, :, :1]})[law]
        assert odds == pytest.approx(0.0, abs=0.05), held.candidate.key


@pytest.mark.parametrize(
    ("rotor", "needed"),
    [
        (ROTOR, 19.0 * 4.0),  # the 19 to 1 of a name, of four laws
        (0, 19.0 * 2.0 / 0.005),  # of two, and of a rotor of which nothing else says that it is bad
    ],
)
def test_one_law_of_many_is_not_taken_for_likelier_than_it_is(monkeypatch, rotor, needed):
    search = searched("steady")
    best = search.best

    def weighed(odds: float):
        def against(_search, _best, columns):
            every = {law: (-90.0, np.ones(c.shape[2])) for law, c in columns.items()}
            law = (rotor, "rotor_thrust")
            return {**every, law: (np.log(odds), np.arange(every[law][1].size))}

        return against

    monkeypatch.setattr(uneven, "_left_out", lambda *_: BORNE_OUT)
    monkeypatch.setattr(uneven, "_against_steady", weighed(0.97 * needed))
    assert uneven_loss(search, best) is None
    monkeypatch.setattr(uneven, "_against_steady", weighed(1.03 * needed))
    one = uneven_loss(search, best)
    assert one is not None
    assert (one.rotor, one.channel) == (rotor, "rotor_thrust")
    assert one.odds == pytest.approx(np.log(1.03 * 19.0), abs=1e-3)


def test_a_rotor_that_swings_is_said_where_a_set_has_something_else_in_its_place():
    search = searched("swings")
    nothing = search.fit(frozenset(), ())
    one = uneven_loss(search, nothing)
    assert one is not None
    assert (one.rotor, one.channel) == (ROTOR, "rotor_thrust")


def test_a_rotor_that_no_set_has_is_asked_by_its_thrust_alone_and_has_a_steady_loss_too():
    search = searched("steady")
    best = search.best
    named, other = law_columns(search, best, ROTOR), law_columns(search, best, 0)
    thrust = ["rotor_thrust in proportion", "rotor_thrust"]
    assert list(named) == [*thrust, "airspeed", "time_s"]
    assert list(other) == thrust
    for name in thrust:
        assert other[name].shape[2] == named[name].shape[2] + 1
        np.testing.assert_array_equal(other[name][:, :, 0], uneven._steady(search, best, 0))


def test_names_are_asked_again_beside_what_the_loss_may_do(monkeypatch):
    asked = []

    class Asked(Search):
        def __init__(self, reduced, nuisance, candidates, solved=None):
            asked.append(nuisance)
            super().__init__(reduced, nuisance, candidates, solved)

    monkeypatch.setattr(accepted_names, "Search", Asked)
    identify_checked(flights("bends"), MODEL, catalogue=CATALOGUE)
    (nuisance,) = asked
    search = searched("bends")
    one = uneven_loss(search, search.best)
    assert one is not None
    free = nuisance.uncertainty[:, :, search.nuisance.uncertainty.shape[2] :]
    np.testing.assert_allclose(free, search.nuisance.whitening.apply(one.columns), atol=1e-9)


def test_a_second_bad_rotor_may_stand_for_a_loss_that_is_not_steady(monkeypatch):
    """The odds are against the likeliest set, with what the second one cost or brought."""
    real = uneven._against_steady

    def of_one_alone(search, of, columns):
        weighed = real(search, of, columns)
        return weighed if len(of.key) == 1 else {law: (-9.0, w[1]) for law, w in weighed.items()}

    monkeypatch.setattr(uneven, "_against_steady", of_one_alone)
    search = searched("bends")
    of_rotor = {c.term.rotor: k for k, c in enumerate(search.candidates)}
    alone = search.fit(frozenset({of_rotor[ROTOR]}), ())
    mine = uneven_loss(search, alone)
    assert mine is not None
    for brought in (-3.0, mine.odds - 3.2, mine.odds - 2.7):  # ln 19 is 2.9
        pair = search.fit(frozenset({of_rotor[ROTOR], of_rotor[3]}), ())
        pair = replace(pair, log_evidence=pair.log_evidence + alone.total + brought - pair.total)
        found = uneven_loss(search, pair)
        stands = brought > mine.odds - np.log(19.0)
        assert (found is None) == stands
        if found is not None:
            assert (found.rotor, found.channel) == (ROTOR, "rotor_thrust")
            assert found.odds == pytest.approx(mine.odds - brought, abs=0.05)
            np.testing.assert_allclose(found.change, mine.change, atol=0.1)


@pytest.mark.parametrize("slight", [True, False])
def test_a_loss_that_is_nearly_steady_counts_only_in_the_place_of_another_effect(
    monkeypatch, slight
):
    search = searched("bends")
    of_rotor = {c.term.rotor: k for k, c in enumerate(search.candidates)}
    alone = search.fit(frozenset({of_rotor[ROTOR]}), ())
    pair = search.fit(frozenset({of_rotor[ROTOR], of_rotor[3]}), ())
    steady = uneven._rms(uneven._steady(search, alone, ROTOR))
    change = steady * (0.14 if slight else 0.16)  # a law is good to 5 %: three times that counts

    def of_size(_, of, columns):
        found = {}
        for law, shape in columns.items():
            every = np.ones(shape.shape[2])
            odds = 90.0 if law[0] == ROTOR and len(of.key) == 1 else -9.0
            found[law] = odds, every * change / max(uneven._rms(shape @ every), 1e-9)
        return found

    monkeypatch.setattr(uneven, "_against_steady", of_size)
    one = uneven_loss(search, pair)
    assert one is not None
    assert (one.rotor, one.slight, one.instead) == (ROTOR, slight, True)
    assert (uneven_loss(search, alone) is None) == slight


def test_an_effect_in_the_place_of_which_a_loss_that_is_nearly_steady_does_has_no_name(monkeypatch):
    """By hand: what the loss may do is what a shifted centre of gravity does."""
    shifted = [replace(t, rotor_speed_rpm=t.rotor_speed_rpm + ROLL) for t in flights("steady")]
    catalogue = effects_for(F16, table(["rotor_degradation", "cg_offset"]))

    def names():
        found = identify_checked(shifted, MODEL, catalogue=catalogue)
        assert found.left is None
        return {f.term.key for f in found.found}

    assert names() == {"cg_offset", f"rotor_degradation@{ROTOR + 1}"}

    instead = [True]

    def like_the_shift(search: Search, _):
        columns = np.zeros((len(search.reduced.flight), 4, 1))
        columns[:, 1, 0] = np.linalg.norm(ROLL)
        slight = np.zeros(columns.shape[:2])
        return uneven.UnevenLoss(
            rotor=ROTOR, channel="rotor_thrust", odds=9.0, columns=columns, change=slight,
            steady=slight + 1.0, instead=instead[-1],
        )  # fmt: skip

    monkeypatch.setattr(accepted_names, "uneven_loss", like_the_shift)
    assert names() == {f"rotor_degradation@{ROTOR + 1}"}
    instead.append(False)  # of a rotor that no set has it is no name's place
    left = identify_checked(shifted, MODEL, catalogue=catalogue).left
    assert left is not None
    assert left.rotor == ROTOR
    instead.append(True)
    # Where something is left it is said, and is not taken for how the loss goes.
    waving = [
        replace(t, rotor_speed_rpm=t.rotor_speed_rpm + np.sin(2.0 * t.airspeed)[:, None] * ROLL)
        for t in shifted
    ]
    asked = []

    def noted(space, columns):
        asked.append(columns)
        return beside(space, columns)

    monkeypatch.setattr(accepted_names, "beside", noted)
    found = identify_checked(waving, MODEL, catalogue=catalogue)
    assert found.left is not None
    assert (found.left.mode, found.left.channel) == (1, "airspeed")
    assert asked == []


def test_a_sound_rotor_is_none():
    space = search_space(MODEL, made_flights(4, duration=120.0), CATALOGUE)
    search = Search(space.reduced, space.nuisance, space.candidates)
    assert uneven_loss(search, search.fit(frozenset(), ())) is None


def test_motor_outputs_do_not_show_it():
    search = searched("bends")
    search.reduced = replace(search.reduced, of_outputs=True)
    assert uneven_loss(search, search.best) is None


def test_what_goes_by_the_tank_is_no_name_beside_a_loss_that_goes_with_the_rotors_own_thrust():
    names = ["rotor_degradation", "extra_mass", "tank_scale", "parasite_drag"]
    space = search_space(MODEL, flights("bends"), effects_for(F16, table(names)))
    search = Search(space.reduced, space.nuisance, space.candidates)
    by_key = {c.key: k for k, c in enumerate(search.candidates)}
    first, third = (by_key[f"rotor_degradation@{n}"] for n in (1, ROTOR + 1))
    mass, tank, airspeed = (by_key[name] for name in names[1:])
    best = search.fit(frozenset({third}), ())
    one = uneven_loss(search, best)
    assert one is not None
    left = unexplained_loss(one, best)
    named = sorted([first, third, mass, tank, airspeed])
    assert set(closest_to(left, named, search, best)) == {third, tank}
    in_flight = replace(left, channel="airspeed")
    assert set(closest_to(in_flight, named, search, best)) == {third, airspeed}
    assert left.share == pytest.approx(
        np.mean(one.change**2, axis=0).sum() / np.mean(best.residual**2, axis=0).sum()
    )
    assert left.rms_rpm == pytest.approx(np.sqrt(np.mean(np.sum(one.change**2, axis=1))))


def test_a_loss_that_begins_in_flight_is_asked_as_one_all_along():
    search = searched("steady")
    begins = candidate(Term(effect=ROTOR_DEGRADATION_ONSET, rotor=ROTOR), search.reduced.flights)
    values = begins.start.copy()
    values[:, 0] = [0.0, 0.05, 0.08, 0.0]  # in each flight
    values[:, 1] = 60.0  # s
    best = replace(search.best, held=(Held(candidate=begins, values=values),))
    along = uneven._steady(search, best, ROTOR)
    (c,) = sorted(search.best.key)
    small = Held(candidate=search.candidates[c], values=search.start[c].values)
    slope = np.nan_to_num(derivatives(search.reduced, [small], 0)[:, :, 0])
    before = search.reduced.channels.time_s < 55.0
    np.testing.assert_allclose(along[before], 0.08 * slope[before], rtol=0.02)
    nothing = replace(search.best, key=frozenset(), held=())
    usual = uneven._steady(search, nothing, ROTOR)
    np.testing.assert_allclose(usual, 0.05 * slope, rtol=1e-6)


@pytest.mark.parametrize(("share", "steady"), [(0.14, True), (0.16, False)])
def test_a_loss_is_steady_that_goes_along_by_less_than_three_times_what_its_law_may_be_off_by(
    monkeypatch, share, steady
):
    search = searched("steady")
    best = search.best
    real = uneven._steady(search, best, ROTOR)
    curve = np.zeros((*real.shape, 1))
    curve[:, :, 0] = share * real * np.sign(np.arange(len(real)) % 2 - 0.5)[:, None]

    def one_law(_search, _best, rotor):
        return {"airspeed": curve if rotor == ROTOR else 0.0 * curve}

    monkeypatch.setattr(uneven, "law_columns", one_law)
    monkeypatch.setattr(
        uneven,
        "_against_steady",
        lambda _s, _b, columns: {law: (50.0 * (law[0] == ROTOR), np.ones(1)) for law in columns},
    )
    assert (uneven_loss(search, best) is None) == steady


@pytest.mark.parametrize(("fall", "said"), [(0.019, False), (0.021, True)])
def test_a_rotor_that_nothing_says_is_bad_must_predict_what_is_left_out_by_2_percent(
    monkeypatch, fall, said
):
    search = searched("steady")
    monkeypatch.setattr(
        uneven,
        "_against_steady",
        lambda _s, _b, columns: {
            law: (50.0 * (law[0] == 0), np.ones(c.shape[2])) for law, c in columns.items()
        },
    )
    beside = np.array([100.0, 110.0, 120.0, 105.0, 96.0])  # rpm²
    monkeypatch.setattr(uneven, "_left_out", lambda *_: ((1.0 + fall) ** 2 * beside, beside))
    assert (uneven_loss(search, search.best) is not None) == said


def test_what_a_loss_says_of_blocks_left_out_is_of_the_others_alone():
    """Two columns and 2 flights of 25 s: blocks of 10 s, each fifth of the six left out in turn,
    with what ridge regression on the white rows of the others gives."""
    space = search_space(MODEL, made_flights(2, duration=60.0), CATALOGUE)
    search = Search(space.reduced, space.nuisance, space.candidates)
    x, whitening = search.reduced, search.nuisance.whitening
    best = search.fit(frozenset(), ())
    rng = np.random.default_rng(5)
    columns = rng.normal(size=(*x.measured_rpm.shape, 2))
    best = replace(best, residual=3.0 * columns[:, :, 0] + rng.normal(size=x.measured_rpm.shape))
    without, beside = uneven._left_out(search, best, columns)
    blocks, fold = [], []
    for f, t in zip(x.flight, x.channels.time_s, strict=True):
        block = (f, int((t - x.channels.time_s[x.flight == f][0]) // 10.0))
        if block not in blocks:
            blocks.append(block)
        fold.append(blocks.index(block) % 5)
    fold = np.array(fold)
    white, left = whitening.apply(columns), whitening.apply(best.residual)
    for k in range(5):
        others = fold[whitening.rows] != k
        a, r = white[others].reshape(-1, 2), left[others].ravel()
        taken = np.linalg.lstsq(
            np.concatenate([a, np.eye(2)]), np.concatenate([r, np.zeros(2)]), rcond=None
        )[0]
        assert without[k] == pytest.approx(np.mean(best.residual[fold == k] ** 2))
        off = best.residual[fold == k] - columns[fold == k] @ taken
        assert beside[k] == pytest.approx(np.mean(off**2))
    assert len(without) == 5
    assert beside.mean() < 0.2 * without.mean()


def test_a_stretch_of_one_block_shows_no_rotor():
    (track,) = made_flights(1, duration=16.0)
    speed = track.rotor_speed_rpm.copy()
    speed[:, ROTOR] /= np.sqrt(1.0 - 0.3 * np.sin(track.time_s) ** 2)
    short = replace(track, rotor_speed_rpm=speed)
    space = search_space(MODEL, [short], CATALOGUE)
    search = Search(space.reduced, space.nuisance, space.candidates)
    nothing = search.fit(frozenset(), ())
    one_block = replace(
        search.reduced.channels, time_s=np.linspace(0.0, 9.9, search.reduced.flight.size)
    )
    search.reduced = replace(search.reduced, channels=one_block)
    assert uneven_loss(search, nothing) is None


def test_of_two_rotors_the_likelier_counts_even_where_it_is_not_uneven_enough(monkeypatch):
    search = searched("steady")
    best = search.best
    real = {r: uneven._steady(search, best, r)[:, :, None] for r in range(4)}
    monkeypatch.setattr(
        uneven, "law_columns", lambda _s, _b, r: {"airspeed": (0.1 + 0.9 * (r == 3)) * real[r]}
    )
    odds = {ROTOR: 90.0, 3: 80.0}
    monkeypatch.setattr(
        uneven,
        "_against_steady",
        lambda _s, _b, columns: {law: (odds.get(law[0], -9.0), np.ones(1)) for law in columns},
    )
    assert uneven_loss(search, best) is None
    monkeypatch.setattr(uneven, "_left_out", lambda *_: BORNE_OUT)
    odds[3] = 99.0
    one = uneven_loss(search, best)
    assert one is not None
    assert one.rotor == 3
