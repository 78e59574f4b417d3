"""The scorer counts what it says: checked with answers whose worth is known beforehand."""

from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from tests.undeclared.changes import NAMED
from tests.undeclared.datasets import DataSet, build
from tests.undeclared.judging import REPORTED_AS, Score, judge
from tests.undeclared.outside import OUTSIDE
from tests.undeclared.scorer import ROUND, plan
from tests.undeclared.table import goals_met, print_table, share, summary

BASES = ("rotor_degradation", "extra_mass", "cg_offset", "rotor_degradation/onset", "none", "surge")


@pytest.fixture(scope="module")
def sets() -> dict[str, DataSet]:
    return {kind: build(kind, seed=21, base="trained") for kind in BASES}


def answer(data: DataSet, **changes: Any) -> dict[str, Any]:
    """What a perfect loop would report, with some of it changed."""
    effects = []
    for m in data.asked:
        parameters = {}
        for key, value in m.truth.items():
            name = REPORTED_AS.get((m.name, key), key)
            spread = 0.1 * abs(value) + 1e-9
            parameters[name] = {"value": value, "ci95": [value - spread, value + spread]}
        rotor = None if m.rotor is None else m.rotor + 1
        effects.append({"name": m.name, "rotor": rotor, "parameters": parameters})
    outside = bool(data.outside_rpm)
    return {
        "effects": effects,
        "before": {"rmse_rpm": 50.0},
        "after": {"rmse_rpm": 1.05 * data.knowing_rmse_rpm},
        "unexplained": {"mode": "pitch" if outside else None, "channel": None},
        "floor_rpm": data.floor_rpm,
        **changes,
    }


@pytest.mark.parametrize("kind", BASES)
def test_a_perfect_answer_is_right_in_every_respect(sets, kind):
    score = judge(sets[kind], answer(sets[kind]))
    assert score.right
    assert set(score.verdicts) <= {"exact"}
    assert all(i.covers for i in score.intervals)
    assert score.unmapped == ()
    assert score.ratio == pytest.approx(1.05)


@pytest.mark.parametrize("kind", ["rotor_degradation", "extra_mass", "cg_offset"])
def test_silence_is_a_miss(sets, kind):
    score = judge(sets[kind], answer(sets[kind], effects=[]))
    assert score.verdicts == ("missed",)
    assert not score.right


def test_a_wrong_rotor_is_a_miss_and_a_wrong_name(sets):
    data = sets["rotor_degradation"]
    given = answer(data)
    given["effects"][0]["rotor"] = given["effects"][0]["rotor"] % 4 + 1
    score = judge(data, given)
    assert score.verdicts == ("missed",)
    assert len(score.wrong) == 1


def test_a_twin_counts_only_when_it_is_declared_and_the_list_is_short(sets):
    data = sets["extra_mass"]
    other = {"name": "air_density", "rotor": None, "parameters": {}}
    for twins, verdict in (
        ([], "missed"),
        (["extra_mass"], "twin"),
        (["extra_mass", "tank_scale", "thrust_drift", "wind"], "missed"),
    ):
        given = answer(data, effects=[{**other, "indistinguishable_from": twins}])
        score = judge(data, given)
        assert score.verdicts == (verdict,)
        assert bool(score.wrong) == (verdict == "missed")


def test_one_reported_effect_answers_for_one_missing_effect_only(sets):
    data = sets["extra_mass"]
    twice = replace(data, missing=(*data.missing, replace(data.missing[0], name="tank_scale")))
    given = answer(data)
    given["effects"][0]["indistinguishable_from"] = ["tank_scale"]
    assert judge(twice, given).verdicts == ("exact", "missed")


def test_an_interval_beside_the_truth_does_not_cover(sets):
    data = sets["extra_mass"]
    given = answer(data)
    mass = data.asked[0].truth["mass"]
    given["effects"][0]["parameters"]["mass"]["ci95"] = [1.1 * mass, 1.2 * mass]
    assert [i.covers for i in judge(data, given).intervals] == [False]


def test_a_parameter_that_no_report_states_is_told(sets):
    data = sets["cg_offset"]
    given = answer(data)
    del given["effects"][0]["parameters"]["x"]
    assert judge(data, given).unmapped == ("cg_offset.x",)


def test_any_name_on_a_flight_with_nothing_missing_is_a_false_alarm(sets):
    data = sets["none"]
    alarm = {"name": "thrust_drift", "rotor": None, "parameters": {}}
    scores = [judge(data, answer(data)), judge(data, answer(data, effects=[alarm]))]
    assert summary(scores)["false_alarm"]["share"] == 0.5


def test_a_declared_twin_counts_as_found_but_not_as_the_right_name(sets):
    data = sets["extra_mass"]
    twin = {"name": "air_density", "rotor": None, "parameters": {}}
    given = answer(data, effects=[{**twin, "indistinguishable_from": ["extra_mass"]}])
    figures = summary([judge(data, given), judge(data, answer(data))])
    assert figures["right_name_or_twin"]["hits"] == 2
    assert figures["right_name"]["hits"] == 1


def test_an_outside_effect_must_be_said_and_not_misnamed(sets):
    data = sets["surge"]
    quiet = {"mode": None, "channel": None}
    named = {"name": "wind", "rotor": None, "parameters": {}}
    empirical = {"name": "unexplained:airspeed", "rotor": None, "parameters": {}}
    assert judge(data, answer(data)).right
    assert judge(data, answer(data, unexplained=quiet, effects=[empirical])).right
    assert not judge(data, answer(data, unexplained=quiet)).right
    assert not judge(data, answer(data, effects=[named])).right


def test_goals_are_met_by_perfect_answers_and_not_by_silent_ones(sets):
    perfect = [judge(d, answer(d)) for d in sets.values()]
    silence = {"effects": [], "unexplained": {"mode": None}, "after": {"rmse_rpm": 50.0}}
    silent = [judge(d, answer(d, **silence)) for d in sets.values()]
    # Intervals that always cover are too wide: the goal has an upper end.
    met = goals_met(perfect)
    assert [words for words, ok in met.items() if not ok] == [
        "95 % intervals that cover, 90 to 99 %"
    ]
    assert sum(goals_met(silent).values()) == 2  # no false alarm, and no interval to count


def test_a_plan_holds_every_kind_and_does_not_change_with_a_seed():
    cases = plan(2 * len(ROUND), seed=4)
    assert {k for k, _ in cases} == {"none", "load_factor", "two", *NAMED, *OUTSIDE}
    assert cases == plan(2 * len(ROUND), seed=4)
    assert cases != plan(2 * len(ROUND), seed=5)
    assert len({s for _, s in cases}) == len(cases)


def test_a_share_states_its_own_uncertainty():
    counted = share(19, 20)
    assert counted["ci95"] == pytest.approx([0.764, 0.991], abs=0.002)  # Wilson, by hand
    assert share(0, 0)["share"] is None


def test_the_table_shows_every_kind(sets, capsys):
    scores: list[Score] = [judge(d, answer(d)) for d in sets.values()]
    print_table(scores, Console(width=160))
    shown = capsys.readouterr().out
    for kind in BASES:
        assert kind in shown
    assert "NOT MET" in shown
