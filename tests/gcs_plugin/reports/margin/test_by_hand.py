"""The report's figures of a flight of ten rows, one a second, each worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import log, model
from thrustmargin.gcs_plugin.reports.margin import flight_verdict, report_flight
from thrustmargin.gcs_plugin.reports.margin.data import (
    FlightReport,
    end_rows,
    least,
    mean,
    median,
    most,
    share,
)
from thrustmargin.gcs_plugin.wording.margin_verdict import (
    Level,
    MarginVerdict,
    Moment,
    action,
    estimate,
    facts,
    headline,
    moment_words,
    several_headline,
)
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.scores import Estimate

NAN = float("nan")
ROWS = 10


def flown(**channels: object) -> FlightTrack:
    """Ten rows, one a second; the first and the last on the ground, a tank of 9 kg to 0 kg."""
    given = {
        "tank_kg": np.arange(9.0, -1.0, -1.0),
        "velocity_ned": np.tile([3.0, 4.0, 0.0], (ROWS, 1)),
        "airspeed": np.full(ROWS, 5.0),
        "voltage": np.full(ROWS, 50.0),
        "altitude": np.zeros(ROWS),
        **channels,
    }
    track = FlightTrack.of(name="ten", time_s=np.arange(float(ROWS)), rotor_count=4, **given)
    return replace(track, flying=np.array([False, *[True] * 8, False]))


def used(use: np.ndarray, **channels: object) -> FlightAnalysis:
    """The ten rows with `use` (10, 4) as measured thrust utilisation; predicted 0.7 throughout."""
    analysis = analyse(flown(**channels), model())
    return replace(analysis, utilisation=use, utilisation_predicted=np.full((ROWS, 4), 0.7))


def report_of(analysis: FlightAnalysis, limit: float = 0.5) -> FlightReport:
    recorded = replace(log(), track=analysis.track)
    return report_flight(analysis, recorded, max_utilisation=limit)


def rising() -> np.ndarray:
    """Rotor 1 at 0.1, 0.2, ... 1.0, the others at 0.3."""
    use = np.full((ROWS, 4), 0.3)
    use[:, 0] = np.arange(1, ROWS + 1) / 10
    return use


def test_time_above_the_limit_counts_airborne_rows_in_which_one_rotor_is_above():
    verdict = report_of(used(rising()), limit=0.55).verdict
    assert verdict.over_limit_s == pytest.approx(4.0)  # 0.6, 0.7, 0.8, 0.9; 1.0 is on the ground
    assert verdict.over_limit_share == pytest.approx(4 / 8)
    assert verdict.measured_share == pytest.approx(1.0)
    assert verdict.worst is not None
    assert (verdict.worst.rotor, verdict.worst.time_s) == (1, 8.0)
    assert verdict.worst.capacity_use == pytest.approx(0.9)
    assert verdict.worst.margin == pytest.approx(0.1)


@pytest.mark.parametrize("limit", [0.05, 0.55, 0.95])
def test_the_verdict_alone_is_that_of_the_report(limit):
    analysis = used(rising())
    whole, alone = (
        report_of(analysis, limit).verdict,
        flight_verdict(analysis, max_utilisation=limit),
    )
    assert (alone.level, alone.headline) == (whole.level, whole.headline)
    assert (alone.limit, alone.over_limit_s) == (whole.limit, whole.over_limit_s)


def test_each_rotor_has_its_own_most_median_and_share_above():
    first, second, *_ = report_of(used(rising()), limit=0.55).rotors
    assert first["measured_max"] == pytest.approx(0.9)
    assert first["measured_median"] == pytest.approx(0.55)  # of 0.2 to 0.9
    assert first["over_limit_share"] == pytest.approx(4 / 8)
    assert second["measured_max"] == second["measured_median"] == pytest.approx(0.3)
    assert second["over_limit_share"] == 0.0
    assert first["predicted_max"] == pytest.approx(0.7)


def test_a_silent_esc_neither_hides_the_others_nor_adds_its_prediction():
    use = rising()
    use[:, 3] = NAN  # predicted at 0.7, above the limit, in every row
    analysis = used(use)
    report = report_of(analysis, limit=0.55)
    assert report.verdict.over_limit_s == pytest.approx(4.0)
    assert report.verdict.over_limit_s == np.sum(analysis.above_limit(0.55))
    assert np.isnan(report.rotors[3]["over_limit_share"])
    rows = {row["name"]: row for row in report.load}
    assert np.isnan(rows["thrust in use in flight, mean of the rotors"]["flight_start"])


def test_rows_without_any_measurement_are_judged_by_the_prediction():
    use = rising()
    use[2:4] = NAN
    verdict = report_of(used(use), limit=0.55).verdict
    assert verdict.over_limit_s == pytest.approx(6.0)
    assert verdict.measured_share == pytest.approx(6 / 8)
    assert verdict.basis == "rotor speeds measured for 75 % of the flight, predicted for the rest"


def test_the_flight_in_figures():
    wind = np.tile([0.0, -2.0, 0.0], (ROWS, 1))  # blows to the west, from the east
    found = report_of(used(rising(), wind_ned=wind)).flight
    assert found["airborne_s"] == pytest.approx(8.0)
    assert found["log_duration_s"] == pytest.approx(9.0)
    assert found["distance"] == pytest.approx(8 * 5.0)
    assert (found["tank_start_kg"], found["tank_end_kg"]) == (8.0, 1.0)
    assert found["liquid_used_kg"] == pytest.approx(7.0)
    assert found["ground_speed_median"] == found["ground_speed_max"] == pytest.approx(5.0)
    assert found["wind_speed_median"] == pytest.approx(2.0)
    assert found["wind_from_deg"] == pytest.approx(90.0)
    assert np.isnan(found["spraying_s"])


def test_loads_follow_eq_6_to_8():
    airframe = model().airframe
    rows = {row["name"]: row for row in report_of(used(rising())).load}
    # The first and last tenth of eight airborne rows are one row: 8 kg and 1 kg in the tank.
    load = rows["load a rotor"]
    assert load["flight_start"] == pytest.approx((airframe.empty_mass + 8.0) / 4)
    assert load["flight_end"] == pytest.approx((airframe.empty_mass + 1.0) / 4)
    increase = (airframe.empty_mass + 8.0) / (airframe.empty_mass + 1.0) - 1
    assert rows["full over empty, start over end"]["flight_start"] == pytest.approx(increase)
    nameplate = rows["load over the maker's maximum thrust"]["flight_start"]
    assert nameplate == pytest.approx(load["flight_start"] * G0 / airframe.nameplate_max_thrust)
    mean_use = rows["thrust in use in flight, mean of the rotors"]
    assert mean_use["flight_start"] == pytest.approx((0.2 + 3 * 0.3) / 4)
    assert mean_use["flight_end"] == pytest.approx((0.9 + 3 * 0.3) / 4)


def test_redundancy_below_one_is_counted_in_airborne_seconds():
    free = np.array([0.1, 0.9, 0.95, 1.0, 1.1, 1.2, 1.3, 1.4, NAN, 0.1])
    report = report_of(replace(used(rising()), redundancy_yaw_uncontrolled=free))
    assert report.verdict.level == "critical"
    assert report.verdict.not_survivable_s == pytest.approx(2.0)
    assert report.redundancy["below_one_share"] == pytest.approx(2 / 7)
    assert report.redundancy["yaw_free_min"] == 0.9
    assert report.redundancy["yaw_free_min_time_s"] == 1.0
    assert report.redundancy["yaw_free_median"] == 1.1


def test_the_largest_fill_counts_mass_that_the_model_knows_to_be_hidden():
    mass = Identified(value=3.0, unit="kg", ci95=(2.9, 3.1))
    hidden = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavier = replace(model(), effects=(hidden,))
    known, unknown = (
        report_of(analyse(flown(), chosen)).redundancy for chosen in (heavier, model())
    )
    for name in ("fill_limit_start_kg", "fill_one_rotor_out_min_kg"):
        assert known[name] == pytest.approx(unknown[name] - 3.0)


def test_known_numbers_leave_nan_out():
    values = np.array([NAN, 3.0, 1.0, NAN, 8.0])
    assert (median(values), mean(values), most(values), least(values)) == (3.0, 4.0, 8.0, 1.0)
    nothing = np.full(3, NAN)
    assert all(np.isnan(f(nothing)) for f in (median, mean, most, least))
    assert share(1.0, 4.0) == 0.25
    assert np.isnan(share(0.0, 0.0))


def test_a_row_stands_for_its_step_and_a_pause_for_two_and_a_half():
    track = FlightTrack.of(name="x", time_s=np.array([0.0, 1.0, 2.0, 12.0, 13.0]), rotor_count=4)
    assert track.row_seconds.tolist() == [1.0, 1.0, 2.5, 1.0, 0.0]
    # One row in a quarter of an hour: 300 of them are no 75 hours above the limit.
    sparse = replace(track, time_s=1000.0 * np.arange(track.time_s.size))
    assert sparse.row_seconds.max() == 12.5
    long = FlightTrack.of(name="x", time_s=np.arange(40.0), rotor_count=4)
    first, last = end_rows(replace(long, flying=np.arange(40) < 30))
    assert np.flatnonzero(first).tolist() == [0, 1, 2]
    assert np.flatnonzero(last).tolist() == [27, 28, 29]


MOMENT = Moment(
    time_s=53.7,
    clock_utc=None,
    rotor=2,
    rotor_name="rear left",
    capacity_use=0.731,
    capacity_use_low=0.731,
    capacity_use_high=0.731,
    margin=0.269,
    basis="measured",
    doing=("turning right", "spraying"),
    tank_kg=14.56,
    ground_speed=1.9,
    airspeed=2.2,
    climb_rate=0.0,
    height_agl=3.0,
    north=158.4,
    east=-5.0,
    latitude_deg=NAN,
    longitude_deg=NAN,
    redundancy_yaw_free=0.94,
)
VERDICT = MarginVerdict(
    level="critical",
    headline="",
    facts=(),
    limit=0.5,
    one_rotor_out_use=0.5,
    worst=MOMENT,
    basis="measured rotor speeds",
    speed_basis="measured",
    measured_share=1.0,
    over_limit_s=115.7,
    over_limit_share=0.558,
    redundancy_yaw_free_min=0.919,
    redundancy_yaw_free_low=0.919,
    redundancy_yaw_free_high=0.919,
    not_survivable_s=93.0,
    fill_kg=9.84,
    fill_low_kg=9.1,
    fill_high_kg=10.4,
    fill_start_kg=13.0,
    tank_start_kg=16.0,
)


def test_the_facts_give_part_amount_and_time():
    given = AirframeClaim(words="airframe my-quad, given")
    assert [f"{fact.label}: {fact.text}" for fact in facts(VERDICT, given)] == [
        "what to do: fill at most 9.1 kg (limit at 9.8, 9.1 to 10.4) on this battery, "
        "12.2 kg as long as it is fresh: with more it would descend after losing a rotor",
        "worst: rotor 2, rear left, at 0:53, turning right, spraying, 14.6 kg in the tank, "
        "158 m north, 5 m west of the start",
        "above 50 %: 1 min 56 s, 56 % of the flight",
        "one rotor lost: too heavy for 1 min 33 s (at worst 0.92 × the weight can be held)",
        "from: measured rotor speeds",
        "airframe: my-quad, given",
    ]
    light = replace(VERDICT, over_limit_s=0.0, not_survivable_s=0.0, redundancy_yaw_free_min=1.1)
    light = replace(light, redundancy_yaw_free_low=1.1, redundancy_yaw_free_high=1.1)
    said = {fact.label: fact.text for fact in facts(light, given)}
    assert said["above 50 %"] == "never"
    assert said["one rotor lost"] == (
        "the weight can be held all flight, without yaw control, it will spin (1.10 × or more)"
    )
    doubted = replace(given, withheld=("16 V in flight", "6 rotors"), source="north.tlog")
    said = [f"{fact.label}: {fact.text}" for fact in facts(VERDICT, doubted)]
    assert said[:2] == ["why: 16 V in flight", "why: 6 rotors"]
    assert "`thrustmargin airframe new --from north.tlog`" in said[2]
    bare = replace(MOMENT, doing=(), tank_kg=NAN, north=NAN)
    assert moment_words(bare) == "rotor 2, rear left, at 0:53"


def test_each_verdict_says_what_to_do():
    def say(**changed):
        return action(replace(VERDICT, **changed))

    over = {"level": "over", "not_survivable_s": 0.0}
    assert say(**over) == (
        "fill at most 9.1 kg (limit at 9.8, 9.1 to 10.4) on this battery, 12.2 kg as "
        "long as it is fresh, which is 50 % in hover"
    )
    assert say(**over, tank_start_kg=8.0) == (
        "fly turns and climbs more gently: in hover up to 9.1 kg (limit at 9.8, 9.1 to 10.4) "
        "are within 50 %"
    )
    assert say(level="near").startswith("fill at most 9.1 kg (limit at 9.8, 9.1 to 10.4)")
    assert say(fill_low_kg=-0.5).startswith("do not fill: the limit is at 9.8 kg")
    assert say(level="under").startswith("nothing: in hover up to 9.1 kg")
    assert say(fill_kg=-1.0).startswith("do not fill: even empty")
    assert "no fill can be worked out" in say(fill_kg=NAN)


@pytest.mark.parametrize(
    ("level", "fill_kg", "said"),
    [
        ("under", 0.0, "nothing: it has no tank to fill"),
        ("near", 0.0, "it has no tank to fill"),
        ("over", 0.0, "fly turns and climbs more gently: it has no tank to fill"),
        ("critical", -2.0, "it has no tank to fill, and is too heavy for this air and"),
    ],
)
def test_an_aircraft_without_a_tank_is_not_called_too_heavy_for_that(level, fill_kg, said):
    verdict = replace(VERDICT, level=level, fill_kg=fill_kg, fill_low_kg=fill_kg)
    done = action(verdict, full_at_once="tank")
    assert done.startswith(said)
    assert ("too heavy" in done) == (fill_kg < 0.0)
    full = action(replace(VERDICT, fill_kg=0.0), full_at_once="take-off mass")
    assert "empty it has the maker's maximum take-off mass" in full


def test_after_a_rotor_alarm_the_rotor_comes_before_the_load():
    said = action(replace(VERDICT, level="under"), suspects=(3,))
    assert said.startswith("do not fly it before propeller, motor and ESC of rotor 3 were looked")
    assert "battery off; for the load: nothing: in hover up to" in said


def test_more_than_all_thrust_is_said_as_beyond_the_ceiling():
    given = AirframeClaim(words="airframe my-quad, given")
    beyond = replace(VERDICT, worst=replace(MOMENT, capacity_use=1.24))
    (said,) = (f.text for f in facts(beyond, given) if f.label == "beyond the ceiling")
    assert said.startswith("rotor 2 shows 124 % of what the airframe says it can make")
    assert all(word in said for word in ("voltage", "max_rotor_speed_rpm", "eRPM"))
    full = replace(VERDICT, worst=replace(MOMENT, capacity_use=1.0))
    assert "beyond the ceiling" not in {f.label for f in facts(full, given)}


def test_what_was_inferred_has_its_interval_and_says_what_the_error_holds():
    worst = replace(MOMENT, capacity_use=0.48, capacity_use_low=0.43, capacity_use_high=0.53)
    worst = replace(worst, basis="from motor outputs", doing=(), tank_kg=NAN, north=NAN)
    within = {"redundancy_yaw_free_low": 0.96, "redundancy_yaw_free_high": 1.1}
    near = replace(
        VERDICT, level="near", worst=worst, over_limit_s=0.0, redundancy_yaw_free_min=1.03, **within
    )
    said = {fact.label: fact.text for fact in facts(near, AirframeClaim())}
    assert said["worst"] == (
        "rotor 2, rear left, at 0:53, 48 % (43 to 53) in use, from motor outputs"
    )
    assert said["above 50 %"] == "never; the limit lies within the error"
    assert said["one rotor lost"] == (
        "cannot tell: the weight is within the error of what could be held (1.03 ×, 0.96 to 1.10)"
    )
    assert headline("near", 0.5) == "NEAR THE 50 % LIMIT: CANNOT TELL"


def test_headlines_name_the_limit_and_count_flights():
    assert headline("over", 0.6) == "ABOVE THE 60 % LIMIT AT TIMES"
    assert headline("under", 0.5) == "BELOW THE 50 % LIMIT"
    assert headline("critical", 0.5, 93.0) == "TOO HEAVY TO LOSE A ROTOR FOR 1 MIN 33 S"
    assert headline("over", 0.5, over_share=0.994) == "ABOVE THE 50 % LIMIT AT TIMES"
    assert headline("over", 0.5, over_share=0.996) == "ABOVE THE 50 % LIMIT ALL FLIGHT"
    assert headline("over", 0.5, 93.0) == "ABOVE THE 50 % LIMIT AT TIMES"
    unseen = headline("critical", 0.5, 93.0, ends_in_flight=True)
    assert unseen == "TOO HEAVY TO LOSE A ROTOR FOR 1 MIN 33 S (LOG ENDS IN FLIGHT)"
    levels: list[Level] = ["under", "critical", "over", "critical"]
    assert several_headline(levels, 0.5) == (
        "critical",
        "2 OF 4 FLIGHTS TOO HEAVY TO LOSE A ROTOR",
    )
    below: list[Level] = ["under"] * 3
    silent: list[Level] = ["unknown"] * 2
    assert several_headline(below, 0.5)[1] == "ALL 3 FLIGHTS BELOW THE 50 % LIMIT"
    assert several_headline(silent, 0.5)[1] == "ALL 2 FLIGHTS WITHOUT VERDICT"
    assert several_headline(["over"], 0.5)[1] == "ABOVE THE 50 % LIMIT AT TIMES"


def test_an_estimate_has_its_interval_in_brackets_where_there_is_one():
    assert estimate(Estimate(value=41.23, low=38.04, high=44.58), "rpm") == ("41 (38 to 45) rpm")
    share_of_rows = Estimate(value=0.968, low=0.95, high=1.0)
    assert estimate(share_of_rows, "%", 1, 100) == "97 (95 to 100) %"
    assert estimate(Estimate(value=41.23, low=NAN, high=NAN), "rpm") == "41.2 rpm"
    assert estimate(Estimate(value=NAN, low=NAN, high=NAN), "rpm") == "unknown"
