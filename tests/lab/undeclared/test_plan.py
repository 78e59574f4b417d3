"""The plan is frozen, holds what it says, and keeps its sealed part shut."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.conditions import KINDS, Condition, draw
from tests.lab.undeclared.crafts import CRAFTS, HEXACOPTER, OTHER_CRAFTS
from tests.lab.undeclared.days import Day
from tests.lab.undeclared.missions import Style
from tests.lab.undeclared.plan import (
    ROUND,
    SECOND_ROUND,
    THIRD_ROUND,
    DataSet,
    build,
    case_of,
    draw_implants,
    good_flights,
)
from tests.lab.undeclared.plant import fly
from tests.lab.undeclared.recorded import RECORDED_ROUND, build_recorded
from tests.lab.undeclared.scorer import main

SMALL = CRAFTS[1]


@pytest.fixture(scope="module")
def sound() -> DataSet:
    return build(7, "none", SMALL)


def test_each_sixty_seeds_hold_every_kind_as_often_as_planned():
    assert len(ROUND) == 60
    for start in (1, 61, 5041):
        assert Counter(case_of(seed)[0] for seed in range(start, start + 60)) == Counter(ROUND)
    assert len({case_of(seed)[1].layout for seed in range(1, 61)}) == 5


def test_the_second_plan_has_other_aircraft_and_every_kind_in_each_round():
    assert len(SECOND_ROUND) == 62
    for start in (20_000, 30_000 - 18):  # of rounds that began at 20000
        seeds = range(start, start + 62)
        assert Counter(case_of(seed)[0] for seed in seeds) == Counter(SECOND_ROUND)
        assert {case_of(seed)[1].name for seed in seeds} == {
            "hexa-x-24kg", "octo-coaxial-x8-8kg", "quad-plus-15kg",
        }  # fmt: skip


def test_the_third_plan_has_one_aircraft_and_every_kind_in_each_round():
    assert len(THIRD_ROUND) == 16
    for start in (40_000, 41_008):
        seeds = range(start, start + 16)
        assert Counter(case_of(seed)[0] for seed in seeds) == Counter(THIRD_ROUND)
        assert {case_of(seed)[1].name for seed in seeds} == {"hexa-x-20kg"}
    pair = draw_implants("worn and shifted", np.random.default_rng(1), HEXACOPTER)
    assert [i.name for i in pair] == ["rotor_degradation", "cg_offset"]


def test_the_plans_stay_as_they_were_frozen():
    kinds = ["late ESC", "none", "cg", "none", "shed", "none"]
    assert [case_of(seed)[0] for seed in range(1, 7)] == kinds
    assert [case_of(seed)[0] for seed in range(20_000, 20_004)] == [
        "rotor",
        "rotor",
        "flap",
        "none",
    ]


def test_what_a_craft_reports_is_slow_coarse_or_repeated():
    hexa, octo, plus = OTHER_CRAFTS
    slow, coarse, repeated = (
        fly(
            c, replace(Condition(), **dict(c.telemetry)), Style(duration=20.0), Day(), [1], "one"
        ).track.rotor_speed_rpm[:, 0]
        for c in (hexa, octo, plus)
    )
    fresh = np.flatnonzero(np.diff(slow))
    assert np.all(np.diff(fresh) % 3 == 0)
    step = np.diff(np.unique(coarse)).min()
    assert step == pytest.approx(0.004 * octo.hover_rpm, abs=1.0)
    assert np.mean(np.diff(repeated) == 0.0) == pytest.approx(0.3, abs=0.12)


def test_a_repaired_rotor_is_sound_afterwards():
    data = build(20_000, "repaired rotor", SMALL)
    (implant,) = data.implants
    rotor = implant.rotor
    assert rotor is not None
    means = [f.track.rotor_speed_rpm[f.track.flying].mean(axis=0) for f in data.fit]
    apart = [m[rotor] - np.delete(m, rotor).mean() for m in means]
    assert min(apart[:4]) > max(apart[4:]) + 0.2 * implant.size * SMALL.hover_rpm


@pytest.mark.parametrize("kind", list(KINDS))
def test_sizes_spread_evenly_in_the_logarithm_over_their_range(kind):
    _, low, high, _ = KINDS[kind]
    sizes = [draw(kind, np.random.default_rng(s), SMALL).size for s in range(200)]
    assert min(sizes) >= 0.999 * low
    assert max(sizes) <= 1.001 * high
    if high > 1.01 * low and kind != "air":
        assert np.median(np.log(sizes)) == pytest.approx(0.5 * np.log(low * high), abs=0.35)


def test_a_biased_airspeed_may_read_high_or_low():
    drawn = (draw("airspeed bias", np.random.default_rng(s), SMALL).condition for s in range(20))
    signs = {str(c["airspeed_bias"]).startswith("-") for c in drawn}
    assert signs == {True, False}


@pytest.mark.parametrize("kind", list(KINDS))
def test_each_change_at_its_largest_moves_what_is_reported(kind, sound):
    data = build(7, kind, SMALL, KINDS[kind][2])
    assert data.kind == kind
    at = -1 if kind == "late rotor" else 1  # it shows in the last flights alone
    one = data.fit[at].track
    if kind in ("ground", "climb"):  # flown otherwise, on the sound aircraft
        other = sound.fit[1].track
        assert abs(np.ptp(one.height_agl) - np.ptp(other.height_agl)) > 0.5
        law = np.abs(one.rotor_speed_rpm - data.without[0][1].track.rotor_speed_rpm)
        assert np.max(law) > 2.0
        return
    other = data.without[0][: len(data.fit)][at].track if data.without else sound.fit[1].track
    moved = [
        np.nanmax(np.abs(getattr(one, c) - getattr(other, c)))
        for c in ("rotor_speed_rpm", "tank_kg", "airspeed", "temperature", "voltage")
    ]
    assert max(moved) > 0.02


def test_a_mixture_is_a_cut_propeller_a_hidden_mass_and_a_shifted_balance():
    data = build(3, "mixed", SMALL)
    assert [i.name for i in data.implants] == ["rotor_degradation", "extra_mass", "cg_offset"]
    assert data.group == "triple"
    assert len(data.without) == 3


def test_a_seed_gives_the_same_set_again_and_another_gives_another():
    first, again, other = (build(s, "rotor", SMALL).fit[0].track for s in (9, 9, 10))
    for channel in ("rotor_speed_rpm", "tank_kg", "specific_force_frd", "airspeed"):
        np.testing.assert_array_equal(getattr(first, channel), getattr(again, channel))
    assert first.time_s.size != other.time_s.size or np.any(
        first.rotor_speed_rpm != other.rotor_speed_rpm
    )


def test_sound_flights_differ_from_day_to_day_as_real_ones_do():
    flights = [f.track for f in good_flights(SMALL, 6)]
    mean = [t.rotor_speed_rpm[t.flying].mean() for t in flights]
    assert np.std(mean) > 0.005 * np.mean(mean)
    assert len({round(float(t.temperature[0]), 1) for t in flights}) > 3


def test_sealed_seeds_stay_shut_without_the_word(capsys):
    for seeds in ((5000, 5001), (990, 1001), (0, 3), (30_000, 30_001), (29_990, 30_010)):
        assert main(seeds=seeds) == 2
    assert "sealed" in capsys.readouterr().out


@pytest.mark.parametrize("kind", sorted(set(RECORDED_ROUND)))
def test_a_recorded_set_differs_from_its_recordings_by_its_change_alone(kind):
    data = build_recorded(3, kind)
    assert {f.track.name for f in data.fit}.isdisjoint(f.track.name for f in data.held_out)
    assert len(data.without) == len(data.implants)
    for flights in data.without:
        one, other = data.fit[0].track, flights[0].track
        moved = np.nanmax(np.abs(one.rotor_speed_rpm - other.rotor_speed_rpm))
        assert moved > 0.5 or np.nanmax(np.abs(one.tank_kg - other.tank_kg)) > 0.01 or kind == "jet"
