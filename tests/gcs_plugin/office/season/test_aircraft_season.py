"""One aircraft's season: findings in the order of their weight, tied to what was reported then."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.office.season.made_store import DAY, START, rows_of, sums_of
from tests.models.identification.season.made_seasons import GAIN, LOSS_2, season, wear, with_change
from thrustmargin.gcs_plugin.office.season import fleet_words as words
from thrustmargin.gcs_plugin.office.season.aircraft_season import (
    ACT,
    CHECK,
    FINE,
    FIRST,
    LOAD,
    WATCH,
    aircraft_season,
    change_level,
    group_by_frame,
)
from thrustmargin.gcs_plugin.office.season.fleet_page import rank_aircraft
from thrustmargin.gcs_plugin.office.season.part_history import with_parts
from thrustmargin.gcs_plugin.office.season.parts import Part
from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.models.identification.season.change_points import SeasonEntry

RNG = np.random.default_rng


@pytest.mark.slow
def test_wear_that_goes_on_is_looked_at_first_with_its_date_and_what_was_said():
    flights = with_change(season(RNG(1), 60), LOSS_2, wear(60, 30, 0.002))
    rows = rows_of(60)
    rows[30]["alarms"] = ["rotor 2 weak"]
    found = aircraft_season("a", rows, sums_of(flights))
    assert found.level == FIRST
    top = found.findings[0]
    assert (
        "thrust lost by rotor 2: 0.20 % more a flight since flight 31 (31 May 2026" in top.sentence
    )
    assert top.action.startswith("with the battery off, change propeller 2")
    assert top.then == "rotor 2 weak (in the words of the day it was taken in)"


def test_a_small_step_is_watched_and_a_larger_one_acted_on():
    late = np.arange(60) >= 40
    small, larger = (
        aircraft_season("a", rows_of(60), sums_of(with_change(season(RNG(2), 60), LOSS_2, loss)))
        for loss in (0.006 * late, 0.02 * late)
    )
    assert small.level == WATCH
    assert larger.level == ACT


def test_a_rotor_that_comes_to_make_more_thrust_is_not_changed_for_a_new_one():
    late = np.arange(60) >= 40
    found = aircraft_season(
        "a", rows_of(60), sums_of(with_change(season(RNG(2), 60), LOSS_2, -0.06 * late))
    )
    assert found.level == WATCH
    assert found.findings[0].action.startswith(
        "with the battery off, compare the size and pitch of its propeller"
    )


@pytest.mark.parametrize(("lost", "level"), [(0.03, ACT), (0.1, FIRST)])
def test_what_is_off_in_all_flights_counts_by_how_much_sound_aircraft_differ(lost, level):
    """Their rotors differ by 0.4 %: 3 % are seven times as much, and 10 % 25 times."""
    flights = with_change(season(RNG(2), 40), LOSS_2, np.full(40, lost))
    (found,) = aircraft_season("a", rows_of(40), sums_of(flights)).findings
    assert found.level == level
    assert found.weight == pytest.approx(lost / 0.004, rel=0.05)
    assert "in all flights" in found.sentence


def test_what_is_off_in_all_flights_has_an_interval_of_95_percent():
    said = words.shared_sentence(LOSS_2, 0.08, 0.01)  # 1.96 % to either side
    assert said == "thrust lost by rotor 2: 8 % in all flights (6 to 10)"


def test_a_swap_is_named_by_its_part_and_is_no_reason_to_look():
    lost = np.where(np.arange(60) < 40, 0.03, 0.0)
    flights = with_change(season(RNG(3), 60), LOSS_2, lost)
    swap = START + 39.5 * DAY
    place = Part(name="", aircraft="a", position="propeller 2", installed_s=-np.inf, removed_s=swap)
    old = replace(place, name="P-1")
    new = replace(place, name="P-2", installed_s=swap, removed_s=np.inf)
    (found,) = with_parts(
        [aircraft_season("a", rows_of(60), sums_of(flights), [old, new])], [old, new]
    )
    (step,) = (f for f in found.findings if f.flight is not None)
    assert step.level == FINE
    assert "propeller 2 P-2, installed" in step.action
    assert "back from 2.9 % to" in step.sentence
    before, after = found.parts
    assert (before.flights, after.flights) == (40, 20)
    assert after.hours == 20 * 600.0 / 3600.0
    assert abs(before.loss - 0.03) < 3 * before.loss_error + 0.003
    assert abs(after.loss) < 3 * after.loss_error + 0.003
    later = replace(new, installed_s=START + 45.0 * DAY)
    for parts in ((), (old, later)):
        unknown = aircraft_season("a", rows_of(60), sums_of(flights), parts)
        assert any("enter it into parts.csv" in f.action for f in unknown.findings)


@pytest.mark.parametrize(
    ("ratio", "part", "level"),
    [
        (2.9, "propeller", WATCH),
        (3.0, "propeller", ACT),
        (9.9, "propeller", ACT),
        (10.0, "propeller", FIRST),
        (2.9, "tank gauge", WATCH),
        (10.0, "tank gauge", CHECK),
    ],
)
def test_3_times_what_sound_aircraft_differ_by_is_acted_on_and_10_times_first(ratio, part, level):
    assert change_level(ratio, part=part) == level


def test_an_ageing_battery_is_dated_and_a_steady_one_is_silent():
    noise = 0.0005 * RNG(4).standard_normal(60)
    rows = rows_of(60, battery_ohm_error=0.0003)
    for k, row in enumerate(rows):
        row["battery_ohm"] = 0.030 + noise[k] + 0.001 * max(0, k - 29)
    (found,) = with_parts([aircraft_season("a", rows, [])])
    assert found.level == FIRST  # doubled
    assert "battery resistance" in found.findings[0].sentence
    # 25 % more so far, and 33 % in ten flights: it is acted on from 30 %, unless it has stopped.
    slow = np.maximum(0.0, np.arange(60) - 29) * 0.00025
    for grown, level in ((slow, ACT), (np.minimum(slow, 20 * 0.00025), WATCH)):
        for k, row in enumerate(rows):
            row["battery_ohm"] = 0.030 + 0.2 * noise[k] + grown[k]
        (found,) = with_parts([aircraft_season("a", rows, [])])
        assert found.findings[0].level == level
    for k, row in enumerate(rows):
        row["battery_ohm"] = 0.030 + noise[k]
    assert with_parts([aircraft_season("a", rows, [])])[0].findings == ()


def test_a_worn_out_battery_is_named_where_no_thrust_was_left_and_a_better_one_is_no_reason():
    noise = 0.0005 * RNG(4).standard_normal(60)
    slope = np.maximum(0, np.arange(60) - 29)
    for per_flight, level, named in ((0.001, FIRST, True), (0.0, FIRST, False)):
        rows = rows_of(60, battery_ohm_error=0.0003)
        for k, row in enumerate(rows):
            row["battery_ohm"] = 0.030 + noise[k] + per_flight * slope[k]
        rows[-1] |= {"verdict": "critical", "worst_margin": -0.1, "worst_rotor": 1}
        (found,) = with_parts([aircraft_season("a", rows, [])])
        assert found.level == level
        assert ("its resistance grew" in found.findings[0].action) == named
    for k, row in enumerate(rows := rows_of(60, battery_ohm_error=0.0003)):
        row["battery_ohm"] = 0.060 + noise[k] - 0.001 * slope[k]
    (found,) = with_parts([aircraft_season("a", rows, [])])
    assert found.level == FINE
    assert found.findings[0].action == "nothing: a newer battery or a warmer day"
    assert "from 60" in found.findings[0].sentence


def ohms(seed: int, of: np.ndarray) -> list[dict]:
    """Rows of flights with a battery of these resistances."""
    noise = 0.0005 * RNG(seed).standard_normal(of.size)
    rows = rows_of(of.size, battery_ohm_error=0.0003)
    for row, ohm in zip(rows, (of + noise).tolist(), strict=True):
        row["battery_ohm"] = ohm
    return rows


def test_a_battery_keeps_its_history_when_it_moves_to_another_aircraft():
    # B-old ages over 40 flights: 20 on a, then 20 on b; B-new is sound and goes the other way.
    ages, sound = 0.030 + 0.001 * np.arange(40), np.full(40, 0.030)
    on_a = ohms(21, np.concatenate([ages[:20], sound[20:]]))
    on_b = ohms(22, np.concatenate([sound[:20], ages[20:]]))
    moved = START + 19.5 * DAY
    first = Part(
        name="B-old", aircraft="a", position="battery", installed_s=-np.inf, removed_s=moved
    )
    later = replace(first, aircraft="b", installed_s=moved, removed_s=np.inf)
    sounds = [replace(first, aircraft="b"), replace(later, aircraft="a")]
    parts = [first, later, *(replace(p, name="B-new") for p in sounds)]
    a, b = with_parts([aircraft_season(n, r, []) for n, r in (("a", on_a), ("b", on_b))], parts)
    assert (a.level, b.level) == (FINE, FIRST)  # it is where the battery is
    (old,) = (p for p in b.parts if p.name == "B-old")
    assert (old.flights, old.stays, old.aircraft) == (40, ("a", "b"), "b")
    assert old.hours == 40 * 600.0 / 3600.0
    assert old.battery is not None
    assert old.battery.now == pytest.approx(0.069, abs=0.002)
    assert "B-old (then on a), battery resistance" in b.findings[0].sentence
    (new,) = (p for p in a.parts if p.name == "B-new")
    assert new.battery is not None
    assert new.battery.changes == ()
    gone = [first, replace(later, removed_s=START + 40 * DAY), *parts[2:]]
    gone = with_parts([aircraft_season(n, r, []) for n, r in (("a", on_a), ("b", on_b))], gone)
    assert [one.level for one in gone] == [FINE, FINE]  # the bad one is on none of them
    assert with_parts([aircraft_season("a", on_a, [])])[0].findings  # as if it were one battery


def test_a_new_propeller_begins_its_own_history_and_the_motor_keeps_its():
    lost = np.where(np.arange(60) < 40, 0.03, 0.0)
    flights = with_change(season(RNG(3), 60), LOSS_2, lost)
    swap = START + 39.5 * DAY
    motor = Part(name="M", aircraft="a", position="motor 2", installed_s=-np.inf, removed_s=np.inf)
    old = replace(motor, name="P-1", position="propeller 2", removed_s=swap)
    new = replace(old, name="P-2", installed_s=swap, removed_s=np.inf)
    (found,) = with_parts([aircraft_season("a", rows_of(60), sums_of(flights))], [motor, old, new])
    flown = {p.name: p.flights for p in found.parts}
    assert flown == {"M": 60, "P-1": 40, "P-2": 20}
    losses = {p.name: p.loss for p in found.parts}
    assert losses["P-1"] == pytest.approx(0.03, abs=0.004)
    assert losses["P-2"] == pytest.approx(0.0, abs=0.004)
    assert losses["M"] == losses["P-2"]


def test_flights_of_a_quad_and_of_a_hexacopter_with_one_name_are_two_aircraft():
    quad = rows_of(4, rotor_count=4, layout="quad-x")
    hexa = rows_of(3, rotor_count=6, layout="hexa-x")
    blind = rows_of(1, rotor_count=6)  # says its rotors and no layout: there is one it can be of
    silent = rows_of(1)
    assert {w: len(own) for w, own in group_by_frame([*quad, *hexa, *blind]).items()} == {
        "4 rotors, quad-x": 4,
        "6 rotors, hexa-x": 4,
    }
    assert [len(own) for own in group_by_frame([*quad, *hexa, *silent]).values()] == [4, 3, 1]
    assert [len(own) for own in group_by_frame([*quad, *silent]).values()] == [5]
    frames = {"4 rotors, quad-x": 4, "6 rotors, hexa-x": 3}
    found = aircraft_season("sysid-1 (4 rotors, quad-x)", quad, [], (), frames)
    assert found.findings[0].level == ACT
    assert "its name is that of 2 aircraft" in found.findings[0].sentence
    assert found.findings[0].action == words.NAME_EACH


def test_autopilots_that_fly_in_turns_under_one_name_are_said_and_a_new_one_is_not():
    rows = rows_of(6)
    for k, row in enumerate(rows):
        row["board"] = "one" if k < 3 else "two"
    assert aircraft_season("a", rows, []).several == ""
    rows[4]["board"] = "one"
    assert aircraft_season("a", rows, []).several.startswith("2 autopilots flew in turns")


def test_a_healthy_season_says_what_it_would_have_seen():
    found = aircraft_season("a", rows_of(50), sums_of(season(RNG(5), 50)))
    assert (found.level, found.findings) == (FINE, ())
    assert 0.0005 < found.least_seen < 0.005


def test_aircraft_are_in_the_order_of_what_is_wrong_with_what_their_reports_say():
    grave_first = ("damaged", "lost", "battery", "no_thrust", "critical", "over", "near", "unknown")
    margin = {"worst_margin": 0.2, "worst_rotor": 1, "worst_doing": "climbing"}
    made = [
        aircraft_season(name, rows_of(3, verdict=name, action=f"do {name}", **margin), [])
        for name in sorted((*grave_first, "under"))
    ]
    order = rank_aircraft("season", made).aircraft
    assert [one.name for one in order] == [*grave_first, "under"]
    day = "(in the words of the day it was taken in)"
    for one, verdict in zip(order[:7], grave_first, strict=False):
        first, *_, last = one.findings[0].action.split("; ")
        # In the reader's language.
        battery = "with the battery off, take the battery out and test it"
        assert first.startswith(("do not fly it", "fill less", battery))
        assert last == f"do {verdict} {day}"


def test_flights_above_the_limit_and_without_verdict_are_reasons():
    rows = rows_of(30)
    for row in rows[-3:]:
        row.update(verdict="critical", worst_margin=0.2, worst_rotor=4, worst_doing="climbing")
    found = aircraft_season("a", rows, [])
    assert found.level == LOAD
    assert (
        "3 of the last 10 flights; least thrust left 20 %, rotor 4, climbing"
        in found.findings[0].sentence
    )
    assert found.no_changes.startswith("no flight has sums")
    rows[-1]["worst_margin"] = -0.1  # no thrust was left: nothing is more urgent
    found = aircraft_season("a", rows, [])
    assert (found.level, found.findings[0].action.split(";")[0]) == (
        FIRST,
        "do not fly it before its battery and propellers were looked at",
    )


@pytest.mark.parametrize(
    ("row", "action"),
    [
        ({"airframe_basis": "not known", "airframe": "x"}, words.SET_AIRFRAME),
        ({"airframe_basis": "given"}, words.OTHER_AIRFRAME),
        ({"missing_channels": ["rotor_speed_rpm", "tank_kg"]}, actions.ESC_TELEMETRY.text),
        ({"missing_channels": ["tank_kg"]}, actions.CONNECT_GAUGE.text),
        ({}, actions.INSPECT_LOG.text),
    ],
)
def test_an_aircraft_without_verdicts_has_the_reason_as_reason_and_an_action(
    row: dict, action: str
):
    rows = rows_of(4, verdict="unknown", verdict_reason="why it has none", **row)
    top = aircraft_season("a", rows, []).findings[0]
    assert top.sentence.startswith("4 of 4 flights have no verdict: why it has none (in the words")
    assert top.action == action


def test_sums_about_an_older_model_are_left_out_and_said():
    flights = season(RNG(6), 30)
    sums = [*sums_of(flights)[:10], *sums_of(flights, "new")[10:]]
    found = aircraft_season("a", rows_of(30), sums)
    assert found.counted == tuple(range(10, 30))
    assert found.no_changes.startswith("10 flights are about an older model, or of an older")


def test_sums_of_another_version_are_left_out_and_said():
    flights = season(RNG(6), 30)
    sums = sums_of(flights)
    for one in sums[20:]:
        del one["arrays"]["bent"]
    found = aircraft_season("a", rows_of(30), sums)
    assert found.counted == tuple(range(20))
    assert found.no_changes.startswith("10 flights are about an older model, or of an older")
    assert "learn --store --again" in found.no_changes


def test_a_drifting_gauge_asks_for_scales():
    flights = with_change(season(RNG(7), 60), GAIN, wear(60, 10, 0.003))
    found = aircraft_season("a", rows_of(60), sums_of(flights))
    assert "load above the tank gauge" in found.findings[0].sentence
    assert "weigh what is filled in" in found.findings[0].action


PLACE = {
    "latitude_deg": 48.0,
    "longitude_deg": 11.0,
    "tank_start_kg": 10.0,
    "tank_end_kg": 3.85,
    "current_median": 60.0,
}


def test_one_flight_in_two_logs_counts_once_and_the_one_with_sums_stays():
    first, second, later = rows_of(3, duration_s=700.0, worst_time_s=100.0, **PLACE)
    second |= {"started_unix_s": first["started_unix_s"] + 20.0, "worst_time_s": 82.0}
    first["sums_reason"] = "no rotor speed"
    found = aircraft_season("a", [first, second, later], [])
    assert [f["flight"] for f in found.flights] == [second["flight"], later["flight"]]
    assert (found.twice, found.hours) == (1, 2 * 600.0 / 3600.0)
    unknown = [{**row, "started_unix_s": None} for row in (first, second)]
    assert aircraft_season("a", unknown, []).twice == 0
    blind = [{**row, "worst_time_s": None} for row in (first, second)]
    assert aircraft_season("a", blind, []).twice == 1


@pytest.mark.parametrize(
    ("other", "twice"),
    [
        ({}, 1),
        ({"latitude_deg": 48.001}, 1),  # 111 m: loggers have origins of their own
        ({"latitude_deg": 48.01}, 0),
        ({"longitude_deg": 11.01}, 0),  # 744 m
        ({"tank_end_kg": 6.4}, 0),
        ({"tank_end_kg": 3.9, "current_median": 60.5}, 1),
        ({"current_median": 60.8}, 0),  # 1.3 % more: in wind, all else alike
        ({"worst_time_s": 106.0}, 0),
        ({"board": "b"}, 1),
        (dict.fromkeys(("latitude_deg", "tank_start_kg", "tank_end_kg")), 1),
        (dict.fromkeys(("latitude_deg", "tank_start_kg", "tank_end_kg", "current_median")), 0),
    ],
)
def test_logs_of_one_time_are_of_one_flight_where_place_load_and_current_agree_too(
    other: dict, twice: int
):
    """Aircraft of one make fly at one time, in simulation to the second."""
    first, second = rows_of(2, duration_s=700.0, worst_time_s=100.0, **PLACE)
    second |= {"started_unix_s": first["started_unix_s"], **other}
    assert aircraft_season("a", [first, second], []).twice == twice


def test_of_flights_that_are_certainly_of_several_aircraft_no_change_is_followed():
    """Two aircraft of one name fly at the same times, each with a battery of its own."""
    rows = rows_of(40, duration_s=700.0, battery_ohm_error=0.0003)
    for k, row in enumerate(rows):
        row["started_unix_s"] = START + (k // 2) * 1000.0
        row["battery_ohm"] = 0.030 if k < 20 else 0.060
        row["latitude_deg"], row["longitude_deg"] = 48.0 + 0.1 * (k % 2), 11.0
    (alone,) = with_parts([aircraft_season("a", rows, sums_of(season(RNG(6), 40)))])
    assert any(f.sentence.startswith("20 of 40 flights are at the") for f in alone.findings)
    assert any("battery resistance" in f.sentence for f in alone.findings)  # may be one twice
    for row in rows:
        row["started_unix_s"] = START  # any overlap more than half
    (mixed,) = with_parts([aircraft_season("a", rows, sums_of(season(RNG(6), 40)))])
    (only,) = mixed.findings
    assert only.sentence.startswith("39 of 40 flights are at the time of another")
    assert mixed.changes is None
    assert mixed.no_changes.startswith("no change is followed: most flights are at the time of")


def test_amounts_before_and_after_a_change_differ_in_their_unit():
    shifted = words.value_words("cg_offset:tank.x_full")
    assert shifted.amounts(0.0004, -0.0021) == ("0 mm", "−2 mm")
    assert shifted.amounts(0.0011, 0.0013) == ("1.1 mm", "1.3 mm")
    assert words.value_words("drag_moment.roll").amounts(0.01, 0.03) == ("10 mm", "30 mm")
    assert words.value_words("climb_inflow.slope").amounts(1.2, 1.3) == ("1.200", "1.300")
    assert words.value_words("yaw_trim.moment").amounts(1.0, 1.0) == ("1.0000 N m",) * 2


def test_a_change_of_less_than_a_shown_digit_is_shown_with_more_digits():
    step = SeasonEntry(
        ramp=False,
        flight=30,
        earliest=30,
        latest=30,
        until=60,
        before=0.0011,
        after=0.0013,
        size_error=1e-5,
        per_flight=0.0,
        per_flight_error=0.0,
        score=20.0,
    )
    said = words.entry_sentence("cg_offset:tank.x_full", step, "flight 31", False)
    assert said == (
        "centre of gravity forward with a full tank: from 1.1 mm to 1.3 mm at flight 31"
    )


def test_one_autopilot_flies_once_at_a_time_and_two_are_two_aircraft():
    first, second = rows_of(2, duration_s=700.0, worst_time_s=100.0, **PLACE, board="a")
    second |= {"started_unix_s": first["started_unix_s"], "tank_end_kg": 3.0}
    assert aircraft_season("a", [first, second], []).twice == 1
    second |= {"board": "b", "tank_end_kg": first["tank_end_kg"]}
    assert aircraft_season("a", [first, second], []).twice == 0


def test_of_two_logs_of_one_flight_the_graver_verdict_stays():
    first, second = rows_of(2, duration_s=700.0, worst_time_s=100.0, **PLACE)
    second |= {"started_unix_s": first["started_unix_s"], "sums_reason": "no model"}
    for rows in ([first, second], [second, first]):
        second["verdict"] = "damaged"
        (one,) = aircraft_season("a", rows, []).flights
        assert one["verdict"] == "damaged"
        second["verdict"] = first["verdict"]
        (one,) = aircraft_season("a", rows, []).flights
        assert one["sums_reason"] is None


def test_two_aircraft_under_one_name_are_never_taken_for_one_flight_and_it_is_said():
    first, second, later = rows_of(3, duration_s=700.0, worst_time_s=100.0)
    second |= {"started_unix_s": first["started_unix_s"] + 60.0}
    found = aircraft_season("a", [first, second, later], [])
    assert (found.twice, len(found.flights)) == (0, 3)
    assert found.findings[0].sentence.startswith("1 of 3 flights are at the time of another one")
    assert "--again --aircraft" in found.findings[0].action
    assert not [
        f for f in aircraft_season("a", [first, later], []).findings if "at the time" in f.sentence
    ]
