"""Causes without a name compete with the effects of the table: what is left, where, along what."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.unnamed import UNNAMED
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.acceptance import (
    effects_resembling,
    exceeds_limits,
    find_unexplained,
    probable_causes,
)
from thrustmargin.models.identification.answer.posterior import Posterior, posterior_of
from thrustmargin.models.identification.loop import identify_checked
from thrustmargin.models.identification.rows.candidates import (
    TrialEffect,
    predicted_modes,
    slopes,
    unnamed_candidates,
)
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.sets.evidence import SetScore
from thrustmargin.models.identification.sets.linear_sets import EffectSet
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.network.records import GoodFlights

MODEL = curve_model()
DIRECTIONS = modes(F16).directions
SIZE = 60.0  # rpm, amplitude of the wave in its mode
LOST, ROTOR = 0.06, 2
KEYS = ("rotor_degradation", "cg_offset", "extra_mass")


def with_wave(mode: int | None) -> list[FlightTrack]:
    """Flights with a wave of the airspeed in one mode, which no effect of the table has."""
    flights = []
    for track in made_flights(3, duration=120.0):
        wave = np.zeros((track.time_s.size, 4))
        if mode is not None:
            wave = SIZE * np.sin(0.7 * track.airspeed)[:, None] * DIRECTIONS[:, mode]
        flights.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + wave))
    return flights


def searched(flights, keys=KEYS, model=MODEL):
    space = search_space(model, flights, effects_for(F16, table(keys)))
    search = Search(space.reduced, space.nuisance, (*space.candidates, *space.unnamed))
    search.run()
    return space, search, posterior_of(search)


def lost_thrust(track: FlightTrack, law: str) -> np.ndarray:
    """(T,) share of its thrust that a rotor lacks, by a law of its own."""
    share = (track.tank_kg + F16.empty_mass) / (12.0 + F16.empty_mass)
    shape = {
        "steady": np.ones_like(share),
        "bends": np.maximum(share - 0.75, 0.0) / 0.25,
        "in fast flight": 0.6 + track.airspeed / 7.0,
        "warm": track.time_s / 60.0,
    }
    return LOST * shape[law]


def with_loss(law: str) -> list[FlightTrack]:
    found = []
    for track in made_flights(3, duration=100.0):
        speed = track.rotor_speed_rpm.copy()
        speed[:, ROTOR] /= np.sqrt(1.0 - lost_thrust(track, law))
        found.append(replace(track, rotor_speed_rpm=speed))
    return found


@pytest.mark.parametrize("mode", [0, 3])
def test_a_wave_that_no_effect_has_is_left_in_its_mode_with_its_size_along_its_channel(mode):
    space, search, answer = searched(with_wave(mode))
    left = find_unexplained(space, answer)
    assert left is not None
    assert (left.mode, left.rotor) == (mode, None)
    assert {"airspeed", "forward_speed"} & {*left.channels}  # without wind they are the same
    wave = SIZE * np.sin(0.7 * space.reduced.channels.airspeed)
    assert left.rms_rpm == pytest.approx(np.sqrt(np.mean(wave**2)), rel=0.3)
    assert 0.6 < left.share <= 1.0
    assert not left.minor
    rough = replace(answer.best, residual=answer.best.residual + 3.0 * SIZE)
    small = find_unexplained(space, Posterior.from_sets(search, [rough]))
    assert small is not None
    assert small.share < 0.15
    assert small.minor
    assert answer.named_candidates() == []


@pytest.fixture(scope="module")
def sound():
    return searched(with_wave(None))


def test_sound_flights_leave_nothing(sound):
    space, _, answer = sound
    assert find_unexplained(space, answer) is None
    assert answer.named_candidates() == []


def test_a_steady_loss_keeps_its_name():
    found = identify_checked(
        with_loss("steady"), MODEL, catalogue=effects_for(F16, table(KEYS[:1] + KEYS[2:]))
    )
    assert [f.term.key for f in found.found] == [f"rotor_degradation@{ROTOR + 1}"]
    assert found.left is None


@pytest.mark.parametrize(
    ("law", "channel"),
    [
        ("bends", "load"),
        pytest.param("in fast flight", "airspeed", marks=pytest.mark.slow),
        pytest.param("warm", "time_s", marks=pytest.mark.slow),
    ],
)
def test_a_loss_that_goes_along_a_channel_is_no_name_and_says_the_rotor_and_the_channel(
    law, channel
):
    found = identify_checked(
        with_loss(law), MODEL, catalogue=effects_for(F16, table(KEYS[:1] + KEYS[2:]))
    )
    assert found.found == ()
    assert found.left is not None
    assert (found.left.rotor, found.left.channel) == (ROTOR, channel)
    assert found.unexplained()["rotor"] == ROTOR + 1
    assert f"rotor {ROTOR + 1} along {channel}" in repr(found)


def test_motor_outputs_show_no_loss_that_goes_along_a_channel(sound):
    space = sound[0]
    assert {c.term.rotor for c in space.unnamed} == {None, 0, 1, 2, 3}
    of_outputs = unnamed_candidates(replace(space.reduced, of_outputs=True))
    assert {c.term.rotor for c in of_outputs} == {None}


def test_the_slopes_of_a_curve_are_those_of_what_it_does():
    """By differences of the whole prediction, for each knot of a curve in a mode and of a rotor."""
    space = search_space(MODEL, with_wave(None)[:2], effects_for(F16, table(KEYS)))
    x = space.reduced
    for one in space.unnamed[:: max(1, len(space.unnamed) // 7)]:
        start = one.initial_effect
        found = slopes(x, [start], 0)
        for k in range(found.shape[2]):
            ends = []
            for sign in (1e-4, -1e-4):
                values = one.start.copy()
                values[:, k] += sign
                ends.append(predicted_modes(x, [TrialEffect(candidate=one, values=values)]))
            by_hand = np.nan_to_num((ends[0] - ends[1]) / 2e-4)
            scale = max(float(np.abs(by_hand).max()), 1.0)
            np.testing.assert_allclose(np.nan_to_num(found[:, :, k]), by_hand, atol=0.02 * scale)


def test_a_cause_without_a_name_rests_where_its_channel_is_0_or_mostly_is():
    """What stands all the time has a name, so one knot of each curve is not free."""
    space = search_space(MODEL, with_wave(None)[:2], effects_for(F16, table(KEYS)))
    x = space.reduced.channels
    resting = {}
    for one in space.unnamed:
        free = {k for k, _ in one.free}
        assert len(free) <= 3
        resting[one.term.effect.variant.split(" along ")[1]] = set(range(4)) - free
    assert 0 in resting["airspeed"] & resting["time_s"] & resting["tank_kg"] & resting["load"]
    # Forward speeds from -5 to 5 m/s have knots at -5, -1.7, 1.7 and 5.
    speed = np.nan_to_num(
        x.velocity_north * np.cos(x.heading) + x.velocity_east * np.sin(x.heading)
    )
    low, high = np.quantile(speed, (0.02, 0.98))
    at = int(np.argmin(np.abs(np.linspace(low, high, 4))))
    assert at in resting["forward_speed"]


def test_a_cause_without_a_name_is_as_likely_in_a_mode_as_an_effect_along_all_channels_together(
    sound,
):
    space = sound[0]
    odds: dict[object, float] = {}
    for one in space.unnamed:
        of = one.term.rotor if one.term.rotor is not None else one.term.effect.variant.split()[0]
        odds[of] = odds.get(of, 0.0) + float(np.exp(one.log_prior))
    expected = dict.fromkeys(("collective", "roll", "pitch", "yaw"), 0.02)
    assert odds == pytest.approx({**expected, **dict.fromkeys(range(4), 0.005)})


def test_an_instrument_is_not_blamed_beside_a_cause_along_its_own_channel():
    """However small the cause is: it may be all that is wrong with what the instrument shows."""
    names = ["tank_scale", "extra_mass"]
    _, search, _ = searched(with_wave(None), names)
    by_key = {c.key: k for k, c in enumerate(search.candidates)}
    gauge, mass = (by_key[name] for name in names)
    blamed = {}
    for channel in ("tank_kg", "yaw_rate"):
        cause = by_key[UNNAMED["pitch", channel].key]
        fitted = [search.fit(frozenset({cause, gauge, mass}), ())]
        answer = Posterior.from_sets(search, fitted)
        assert list(probable_causes(answer)) == [cause]
        blamed[channel] = effects_resembling(None, [gauge, mass], answer)
    assert blamed == {"tank_kg": [gauge], "yaw_rate": []}


def test_a_name_by_the_channel_that_the_unexplained_goes_with_is_only_closest():
    names = ["extra_mass", "parasite_drag", "cg_offset"]
    space, search, answer = searched(with_wave(1), names)
    by_key = {c.key: k for k, c in enumerate(search.candidates) if not c.unnamed}
    mass, drag, cg = (by_key[name] for name in names)
    left = find_unexplained(space, answer)
    assert left is not None
    search.fitted = {answer.best.key: search.fit(frozenset({mass, drag, cg}), ())}
    answer = posterior_of(search)
    left = replace(left, channels=("airspeed",))
    assert effects_resembling(left, [mass, drag, cg], answer) == [drag]
    elsewhere = replace(left, channels=("time_s",))
    assert effects_resembling(elsewhere, [mass, drag, cg], answer) == []
    assert effects_resembling(None, [mass, drag, cg], answer) == []


def test_a_rotor_is_named_by_all_that_says_it_is_weak():
    """By a steady loss, and by one along a channel, together, where the first is likelier."""
    _, search, answer = searched(with_loss("steady"))
    (loss,) = answer.named_candidates()
    of_rotor = {
        c
        for c, one in enumerate(search.candidates)
        if one.term.rotor == ROTOR and any(c in s.key for s in answer.sets)
    }
    assert loss in of_rotor
    assert answer.estimate(loss).probability == pytest.approx(answer.probability(of_rotor))


def wandering(size_rpm: float, slow_rpm: tuple[float, ...], mode: int = 2):
    """A mode that steps up and down every 25 s; good flights wander by so much."""
    flights = []
    for track in made_flights(3, duration=150.0):
        steps = size_rpm * (1.0 - 2.0 * (np.floor(track.time_s / 25.0) % 2.0))
        speed = track.rotor_speed_rpm + steps[:, None] * DIRECTIONS[:, mode]
        flights.append(replace(track, rotor_speed_rpm=speed))
    model = replace(MODEL, good_flights=GoodFlights(flights=9, slow_rpm=slow_rpm))
    space = search_space(model, flights, effects_for(F16, table(["extra_mass"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.fit(frozenset(), ())
    return space, posterior_of(search)


def test_a_mode_that_comes_and_goes_more_than_in_good_flights_is_unexplained_and_takes_no_name():
    """Steps of 40 rpm over 25 s are slow noise of 40 / 0.75 rpm: three times 17.8."""
    space, answer = wandering(40.0, (17.0,) * 4)
    left = find_unexplained(space, answer)
    assert left is not None
    assert (left.mode, left.channel, left.wanders) == (2, "time_s", True)
    assert left.rms_rpm == pytest.approx(40.0, rel=0.15)
    assert 0.8 < left.share <= 1.0
    assert effects_resembling(left, [0], answer) == []
    assert find_unexplained(*wandering(40.0, (20.0,) * 4)) is None
    assert find_unexplained(*wandering(40.0, ())) is None
    space, answer = wandering(40.0, (17.0,) * 4, mode=0)
    assert find_unexplained(space, answer) is not None
    space = replace(space, reduced=replace(space.reduced, of_outputs=True))
    assert find_unexplained(space, answer) is None  # outputs are not measured thrust


def test_beside_a_slightly_uneven_loss_its_rotor_is_named_and_nothing_else():
    """A loss of 6 % that goes by a tenth of itself with the load is steady enough."""
    steady = np.array([100.0, 30.0, 30.0, 20.0])
    sound = np.full(4, 0.01)
    assert exceeds_limits(0.16**2 * steady, steady, sound, of_rotor=True)
    assert not exceeds_limits(0.14**2 * steady, steady, sound, of_rotor=True)


@pytest.mark.parametrize(("share", "open_"), [(0.14, False), (0.16, True)])
def test_names_may_leave_15_percent_of_what_is_explained_in_a_mode(share, open_):
    wave = np.array([0.0, 40.0, 0.0, 0.0])
    names = np.array([1000.0, 40.0 * (1.0 - share) / share, 0.0, 0.0])
    assert exceeds_limits(wave, names, np.full(4, 0.01), of_rotor=False) is open_


@pytest.mark.parametrize(("times", "open_"), [(2.9, False), (3.1, True)])
def test_what_is_left_is_three_times_what_a_sound_aircraft_leaves(times, open_):
    usual = np.array([9.0, 4.0, 1.0, 1.0])
    wave = np.array([0.0, 4.0 * times**2, 0.0, 0.0])
    assert exceeds_limits(wave, np.zeros(4), usual, of_rotor=False) is open_


def test_beside_a_loss_that_goes_along_a_channel_no_other_name_stands():
    """A mass may only make up for what the rotor does."""
    _, search, answer = searched(with_loss("in fast flight"), KEYS[:1] + KEYS[2:])
    by_key = {c.key: k for k, c in enumerate(search.candidates) if not c.unnamed}
    mass, rotor = by_key["extra_mass"], by_key[f"rotor_degradation@{ROTOR + 1}"]
    assert effects_resembling(None, [mass, rotor], answer) == [mass]
    steady = searched(with_loss("steady"), KEYS[:1] + KEYS[2:])[2]
    assert effects_resembling(None, [mass, rotor], steady) == []


@pytest.mark.parametrize(("mass_kg", "doubtful"), [(0.5, True), (15.0, False)])
def test_an_effect_far_larger_than_an_uneven_loss_does_not_make_up_for_it(mass_kg, doubtful):
    _, search, answer = searched(with_loss("in fast flight"), KEYS[:1] + KEYS[2:])
    by_key = {c.key: k for k, c in enumerate(search.candidates) if not c.unnamed}
    mass = by_key["extra_mass"]
    cause = next(c for c in probable_causes(answer))
    fitted = search.fit(frozenset({mass, cause}), ())
    trials = [
        replace(one, values=np.full_like(one.values, mass_kg)) if c == mass else one
        for c, one in fitted.effects.items()
    ]
    search.fitted = {fitted.key: replace(fitted, trials=tuple(trials))}
    resembling = effects_resembling(None, [mass], posterior_of(search))
    assert resembling == ([mass] if doubtful else [])


def test_two_curves_that_take_back_each_other_are_as_large_as_what_they_do_together(sound):
    """Without wind the airspeed is the speed forward: +5 % along one and -4 % along the other."""
    space, search, _ = sound
    by_key = {c.key: k for k, c in enumerate(search.candidates)}

    def trials(channel: str, size: float) -> tuple[int, TrialEffect]:
        c = by_key[f"unnamed_cause:pitch along {channel}"]
        values = search.candidates[c].start.copy()
        values[:, 1:4] = size
        return c, TrialEffect(candidate=search.candidates[c], values=values)

    def alone(*members: tuple[int, TrialEffect]) -> EffectSet:
        kept = sorted(members, key=lambda pair: pair[0])
        count = sum(len(h.candidate.free) for _, h in kept)
        return EffectSet(
            key=frozenset(c for c, _ in kept),
            trials=tuple(h for _, h in kept),
            set_score=SetScore(log_evidence=0.0, step=np.zeros(count), variance=np.ones(count)),
            residual=np.zeros_like(space.reduced.measured_rpm),
        )

    one = trials("airspeed", 0.05)
    sizes = []
    for fitted in (alone(one), alone(one, trials("forward_speed", -0.04))):
        left = find_unexplained(space, Posterior.from_sets(search, [fitted]))
        assert left is not None
        sizes.append(left.rms_rpm)
    assert sizes[0] > 20.0
    assert sizes[1] == pytest.approx(0.2 * sizes[0], rel=0.25)
