"""The scorer counts what it says: checked with answers whose worth is known beforehand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.judging import first_line, judge, uneven_rotors
from tests.lab.undeclared.methods import Sparse, density_slope, oracle_errors, tree_errors
from tests.lab.undeclared.plan import DataSet, build, good_flights
from tests.lab.undeclared.subject import curve_model, told_the_names
from tests.lab.undeclared.table import asked, print_tables, share, summary

SMALL = CRAFTS[1]
KINDS = ("none", "rotor", "mixed", "mass", "flap", "late ESC")


@pytest.fixture(scope="module")
def sets() -> dict[str, DataSet]:
    return {kind: build(21, kind, SMALL) for kind in KINDS}


def answer(data: DataSet, **changes: Any) -> dict[str, Any]:
    """What a perfect loop would report, with some of it changed."""
    effects = [
        {
            "name": i.name,
            "rotor": None if i.rotor is None else i.rotor + 1,
            "probability": 0.99,
            "parameters": {
                k: {"value": v, "ci95": [v - 0.1 * abs(v), v + 0.1 * abs(v)]}
                for k, v in i.truth.items()
            },
        }
        for i in data.implants
        if i.name
    ]
    return {
        "effects": effects,
        "before": {"rmse_rpm": 50.0},
        "after": {"rmse_rpm": 10.0},
        "unexplained": {"mode": None, "channel": None},
        "floor_rpm": 10.0,
        **changes,
    }


def test_a_perfect_answer_is_right_in_every_respect(sets):
    score = judge(sets["mixed"], answer(sets["mixed"]))
    assert score.verdicts == ("named",) * 3
    assert (score.wrong, len(score.intervals)) == ((), 4)
    assert all(i.covers for i in score.intervals)
    assert score.probabilities == (0.99,) * 3


def test_silence_is_a_miss_and_a_wrong_rotor_a_wrong_name_too(sets):
    data = sets["rotor"]
    assert judge(data, answer(data, effects=[])).verdicts == ("missed",)
    given = answer(data)
    given["effects"][0]["rotor"] = given["effects"][0]["rotor"] % 4 + 1
    score = judge(data, given)
    assert (score.verdicts, len(score.wrong)) == (("missed",), 1)


@pytest.mark.parametrize(
    ("kind", "said", "worth"),
    [
        ("none", {}, "nothing"),
        ("none", {"mentioned": [{"rotor": 2, "probability": 0.3}]}, "wrong"),
        ("mass", {"effects": [{"name": "air_density", "probability": 0.9}]}, "wrong"),
        (
            "mass",
            {"one_of": [{"effects": [{"name": "air_density"}, {"name": "extra_mass"}]}]},
            "right",
        ),
        ("flap", {"unexplained": {"mode": "pitch", "channel": "airspeed"}}, "unexplained"),
        ("mass", {"likeliest": {"name": "extra_mass", "probability": 0.6}}, "right"),
        ("flap", {"unnamed_causes": [{"name": "x", "mode": "yaw"}]}, "unexplained"),
        ("mass", {"unnamed_causes": [{"name": "extra_mass", "mode": None}]}, "right"),
        (
            "none",
            {
                "unnamed_causes": [{"name": "x", "mode": "yaw"}],
                "alternatives": [{"probability": 0.6, "effects": []}],
            },
            "nothing",
        ),
        ("none", {"likeliest": {"name": "extra_mass", "probability": 0.6}}, "wrong"),
        ("flap", {"mentioned": [{"rotor": 1, "probability": 0.3}]}, "wrong"),
    ],
)
def test_the_first_sentence_is_judged_as_its_reader_would_act(sets, kind, said, worth):
    given = {"effects": [], "before": {"rmse_rpm": 9.0}, "after": {"rmse_rpm": 9.0}, **said}
    assert first_line(sets[kind], given) == worth


def test_a_rotor_is_spoken_of_before_anything_else(sets):
    data = sets["mixed"]
    wrong = {"name": "rotor_degradation", "rotor": (data.implants[0].rotor + 1) % 4 + 1}
    right = {"name": "extra_mass", "rotor": None}
    assert first_line(data, answer(data, effects=[right, wrong])) == "wrong"
    assert first_line(data, answer(data, effects=[right])) == "right"


def test_two_rotors_that_lose_with_airspeed_are_both_right():
    data = build(20_000, "worn", SMALL)
    at = int(str(data.implants[0].condition["rotor"]))
    assert uneven_rotors(data) == {at + 1, (at + 1) % 4 + 1}


@pytest.mark.parametrize(
    ("beside", "verdict"),
    [
        ({"alternatives": [{"probability": 0.2, "effects": [{"name": "extra_mass"}]}]}, "listed"),
        ({"alternatives": [{"probability": 0.02, "effects": [{"name": "extra_mass"}]}]}, "missed"),
        ({"one_of": [{"effects": [{"name": "extra_mass"}], "probabilities": [0.5]}]}, "listed"),
    ],
)
def test_what_stands_beside_the_names_is_listed(sets, beside, verdict):
    given = answer(sets["mass"], **{"effects": [], **beside})
    assert judge(sets["mass"], given).verdicts == (verdict,)


def test_a_rotor_that_is_asked_for_is_sound_or_it_is_not(sets):
    data = sets["rotor"]
    right = data.implants[0].rotor + 1
    for rotor, sound in ((right, ()), (right % 4 + 1, (right % 4 + 1,))):
        score = judge(data, answer(data, actions=[{"part": f"rotor {rotor}"}]))
        assert (score.asked, score.sound_rotors_asked) == ((f"rotor {rotor}",), sound)
    quiet = judge(sets["none"], answer(sets["none"]))
    loud = judge(sets["none"], answer(sets["none"], actions=[{"part": "tank gauge"}]))
    figures = summary([quiet, loud])
    assert figures["sound_set_with_an_action"]["hits"] == 1
    assert figures["sound_rotor_asked"]["hits"] == 0


def test_an_error_after_is_held_against_that_of_who_knows_the_truth(sets):
    near, far = (
        judge(sets["mass"], answer(sets["mass"], after={"rmse_rpm": after}), knowing_rmse_rpm=10.0)
        for after in (11.4, 11.6)
    )
    assert summary([near, far])["after_within_115_of_truth"]["hits"] == 1


def test_a_rotor_that_is_mentioned_is_listed_by_its_number(sets):
    data = sets["rotor"]
    right = data.implants[0].rotor + 1
    for rotor, verdict in ((right, "listed"), (right % 4 + 1, "missed")):
        given = answer(data, effects=[], mentioned=[{"rotor": rotor, "probability": 0.1}])
        assert judge(data, given).verdicts == (verdict,)


def test_an_interval_beside_the_truth_does_not_cover(sets):
    given = answer(sets["mass"])
    mass = sets["mass"].implants[0].truth["mass"]
    given["effects"][0]["parameters"]["mass"]["ci95"] = [1.1 * mass, 1.2 * mass]
    assert [i.covers for i in judge(sets["mass"], given).intervals] == [False]


def test_a_loss_that_is_there_must_not_be_excluded(sets):
    data = sets["rotor"]
    (implant,) = data.implants
    line = {"name": "rotor_degradation", "rotor": implant.rotor + 1, "parameter": "loss"}
    given = [{**line, "above": 0.5 * implant.size}, {**line, "above": 2.0 * implant.size}]
    score = judge(data, answer(data, excluded=given))
    assert (score.falsely_excluded, score.excluded) == (1, 2)


def test_any_name_on_sound_flights_is_a_false_alarm_and_natural_ones_are_counted_apart(sets):
    data = sets["none"]
    names = ("thrust_drift", "manoeuvre_moment")
    scores = [judge(data, answer(data))] * 2
    scores += [judge(data, answer(data, effects=[{"name": n, "rotor": None}])) for n in names]
    figures = summary(scores)
    assert figures["false_alarm"]["share"] == 0.5
    assert figures["false_alarm_not_natural"]["share"] == 0.25


def test_an_outside_change_must_show_as_unexplained_where_it_acts(sets):
    data = sets["flap"]
    for mode, channel, right in (
        ("pitch", "airspeed", True),
        ("roll", "airspeed", False),
        ("pitch", "time", False),
        (None, None, False),
    ):
        unexplained = {"mode": mode, "channel": channel}
        assert judge(data, answer(data, unexplained=unexplained)).unexplained_right == right
    named = judge(data, answer(data, effects=[{"name": "cg_offset", "rotor": None}]))
    assert summary([named])["outside_named"]["share"] == 1.0


def test_an_instrument_may_be_named_as_such_and_as_nothing_else(sets):
    data = sets["late ESC"]
    for name, wrong in (("sensor_lag", 0), ("manoeuvre_moment", 1)):
        given = answer(data, effects=[{"name": name, "rotor": None}])
        assert len(judge(data, given).wrong) == wrong


def test_the_oracle_finds_a_size_to_the_share_of_the_noise_along_its_signal():
    signal = np.arange(8.0).reshape(4, 2)
    noise = np.full((4, 2), 0.1)
    noise[0, 0] = np.nan  # a row on the ground
    error = oracle_errors([[signal]], [signal + noise])
    by_hand = 0.1 * signal[1:].sum() / (signal[1:] ** 2).sum()
    assert error == pytest.approx(by_hand)


def test_the_oracle_learns_how_much_of_the_airs_density_a_model_misses():
    tracks, dense = [f.track for f in good_flights(SMALL, 3)], [-0.02, 0.0, 0.03]
    left = [-0.5 * 0.7 * t.rotor_speed_rpm * d for t, d in zip(tracks, dense, strict=True)]
    assert density_slope(tracks, dense, left) == pytest.approx(0.7)


def test_sizes_are_counted_in_the_oracles_errors_and_power_by_them(sets):
    base = judge(sets["mass"], answer(sets["mass"]))
    size = sets["mass"].implants[0].size
    errors = tuple(0.6745 * 0.5 * sign for sign in (1, -1, 1, -1))
    score = replace(base, oracle=(errors,), flights=4)
    (row,) = asked([score])
    assert row["z"] == pytest.approx(4.0)  # 0.5 of its size a flight, four flights
    assert row["error4"] == pytest.approx(0.25 * size)


@pytest.mark.parametrize("kind", ["mass", "gauge gain"])
def test_sizes_are_counted_in_the_errors_of_who_is_told_the_names(kind, tmp_path):
    model = curve_model(SMALL, tmp_path)
    found = []
    for size in (0.03, 0.06):  # of larger ones the law is not known any better
        data = build(5, kind, SMALL, size)
        found += told_the_names(model, [f.track for f in data.fit], data.implants)
    assert 1.5 < found[1] / found[0] < 2.5  # of a gain that is counted from nothing: 1.03


def test_who_is_told_the_names_gives_no_size_to_what_has_no_parameter(tmp_path):
    data = build(5, "drag", SMALL, 0.2)
    given = told_the_names(curve_model(SMALL, tmp_path), [f.track for f in data.fit], data.implants)
    assert np.isnan(given).all()


def test_named_and_listed_are_counted_beyond_4_errors_of_who_is_told_the_names(sets):
    data = sets["mixed"]
    of_rotor = [e for e in answer(data)["effects"] if e["rotor"] is not None]
    score = judge(data, answer(data, effects=of_rotor), told=(4.1, 3.9, 8.0))
    figures = summary([score])
    for which in ("above_4_errors_told_the_names", "of_mixtures_above_4_told"):
        counted = figures[f"named_{which}"]
        assert (counted["hits"], counted["of"]) == (1, 2)  # the rotor, of it and the centre


def test_sparse_methods_name_what_is_plain_and_nothing_on_sound_flights():
    good = [f.track for f in good_flights(SMALL, 8)]
    base = np.nanmean([np.nanmean(t.rotor_speed_rpm[t.flying]) for t in good])
    slope = [t.rotor_speed_rpm - base for t in good]
    methods = Sparse(SMALL, good, slope)
    assert methods.names(good[:4], slope[:4]) == {m: [] for m in Sparse.METHODS}
    data = build(5, "mass", SMALL, 0.2)
    with_mass = [f.track for f in data.fit]
    extra = [a.track.rotor_speed_rpm - b.track.rotor_speed_rpm
             for a, b in zip(data.fit, data.without[0], strict=False)]  # fmt: skip
    named = methods.names(with_mass, extra)
    assert ("extra_mass", None) in named["lasso"] + named["stlsq"] + named["ridge"]


def test_trees_predict_what_goes_with_a_channel_on_flights_not_seen():
    tracks = [f.track for f in good_flights(SMALL, 4)]
    residual = [100.0 * np.repeat(np.sin(t.airspeed)[:, None], 4, axis=1) for t in tracks]
    left = tree_errors(tracks[:3], tracks[3:], {"fit": residual[:3], "held_out": residual[3:]})
    assert left < 0.2 * np.sqrt(np.mean(residual[3] ** 2))


def test_a_share_states_its_own_uncertainty():
    assert share(19, 20)["ci95"] == pytest.approx([0.764, 0.991], abs=0.002)  # Wilson, by hand
    assert share(0, 0)["share"] is None


def test_the_tables_show_every_set_and_a_traceback(sets, capsys):
    scores = [judge(d, answer(d)) for d in sets.values()]
    scores[0] = replace(scores[0], failed="IndexError: gone")
    print_tables(scores, Console(width=150))
    shown = capsys.readouterr().out
    for word in ("rotor", "outside: flap", "instrument: late ESC", "IndexError", "100 %"):
        assert word in shown
