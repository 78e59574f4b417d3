"""The report's numbers against the same computed from the flight's arrays."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import flight, log, model, without
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.reports.margin import build_report, report_flight
from thrustmargin.gcs_plugin.reports.margin.data import end_rows
from thrustmargin.gcs_plugin.reports.margin.summary import peak_row
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.gcs_plugin.wording.flight_words import activity_words
from thrustmargin.gcs_plugin.wording.language import clock
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.utilisation_peaks import activities, utilisation_peaks
from thrustmargin.models.physics.airframe import load_airframe

G0 = 9.80665  # m/s²


APART_S = 6.0  # s between peaks that are shown


def doing(track: FlightTrack, row: int) -> tuple[str, ...]:
    """What the vehicle was doing around a row, in words."""
    return tuple(map(activity_words, activities(track, row)))


@pytest.fixture(scope="module")
def analysis():
    return flight()[0]


@pytest.fixture(scope="module")
def report():
    return report_flight(*flight(), max_utilisation=0.5)


def airborne_use(analysis):
    return np.where(analysis.track.flying[:, None], analysis.utilisation, np.nan)


def test_the_worst_moment_is_the_greatest_measured_use_in_the_air(analysis, report):
    use = airborne_use(analysis)
    row, rotor = np.unravel_index(np.nanargmax(use), use.shape)
    worst = report.worst
    assert worst.utilisation == use[row, rotor]
    assert worst.margin == 1 - use[row, rotor]
    assert (worst.rotor, worst.rotor_name) == (rotor, model().airframe.rotor_names[rotor])
    assert worst.time_s == analysis.track.time_s[row]
    assert (worst.north, worst.east) == tuple(analysis.track.position_ned[row, :2])
    assert worst.basis == "measured"
    assert report.json["verdict"]["measured_share"] == pytest.approx(1.0)


def test_a_peak_has_its_row_in_the_json_with_rotors_from_1_and_the_clock(report):
    (first, *_), (row, *_) = report.peaks, report.json["moments"]
    assert report.json["verdict"]["worst"] == row == peak_row(first, flight()[0].track.start_unix_s)
    assert (row["rotor"], row["capacity_use"]) == (first.rotor + 1, first.utilisation)
    assert row["redundancy_yaw_free"] == first.redundancy_yaw_uncontrolled
    assert peak_row(first, 0.0)["clock_utc"].startswith("1970-01-01")
    assert peak_row(first, None)["clock_utc"] is None


def test_the_json_of_a_flight_has_the_keys_that_are_published(report):
    assert list(report.json) == [
        *("name", "verdict", "flight", "model", "load", "rotors", "moments", "losses"),
        *("first_contact", "findings", "alarms", "misread_speed", "takeoff", "vehicle_said"),
        *("notes", "timeline", "redundancy", "accuracy", "margin_check", "quality"),
        *("airframe_basis", "no_verdict", "plan_comparison"),
    ]


def test_the_interval_of_a_moment_reaches_to_more_in_use_where_more_is_shown(analysis):
    shape = analysis.utilisation.shape
    nothing = np.zeros(shape)
    plain = replace(analysis, utilisation_error=nothing, utilisation_beyond=nothing)
    (moment, *_) = utilisation_peaks(plain)
    assert moment.utilisation_low == moment.utilisation == moment.utilisation_high
    shown = replace(
        analysis,
        utilisation_error=np.full(shape, 0.03),
        utilisation_beyond=np.full(shape, 0.02),
    )
    (moment, *_) = utilisation_peaks(shown)
    assert moment.utilisation_high == pytest.approx(moment.utilisation + 1.645 * 0.03)
    assert moment.utilisation_low == pytest.approx(moment.utilisation - 1.645 * 0.01)


def test_time_above_the_limit_is_the_share_of_airborne_rows(analysis, report):
    worst = np.nanmax(airborne_use(analysis)[analysis.track.flying], axis=1)
    verdict = report.json["verdict"]
    assert verdict["above_limit_share"] == pytest.approx(np.mean(worst > 0.5), abs=0.002)
    assert verdict["use"]["above_limit_s"] == pytest.approx(0.1 * np.sum(worst > 0.5), rel=0.02)
    assert report.json["verdict"]["level"] == "under"  # in turns alone
    assert report.json["verdict"]["headline"] == "THRUST LEFT ABOVE THE 50 % LIMIT"
    facts = {fact["label"]: fact["text"] for fact in report.json["verdict"]["facts"]}
    assert facts["turns and gusts"].startswith(
        "thrust left down to 35 %, below 50 % 13 times for 3."
    )


def test_a_rotor_weak_from_the_start_does_not_show_before_flights_have_shown_sound_ones(report):
    said = report_flight(*flight(taught=False), max_utilisation=0.5).json["verdict"]
    assert said["headline"].endswith("THE 50 % LIMIT (A WORN ROTOR WOULD NOT HAVE SHOWN)")
    assert said["action"].startswith("with the battery off, inspect every propeller")
    (rotors,) = (fact["text"] for fact in said["facts"] if fact["label"] == "weak rotors")
    assert "a rotor weak from the start is not" in rotors
    assert "weak rotors" not in {fact["label"] for fact in report.json["verdict"]["facts"]}


def test_a_log_that_ends_in_flight_says_so_and_one_that_ends_on_the_ground_does_not(report):
    analysis, _ = flight()
    assert "log" not in {fact["label"] for fact in report.json["verdict"]["facts"]}
    rows = int(np.flatnonzero(analysis.track.flying)[-1]) - 200
    short = flight(log().track.rows(slice(rows)))
    said = report_flight(*short, max_utilisation=0.5).json["verdict"]
    last = clock(float(short[1].track.time_s[-1]))
    assert said["headline"] == f"THRUST LEFT ABOVE THE 50 % LIMIT UP TO {last} (LOG ENDS IN FLIGHT)"
    assert said["action"].startswith("see how the flight ended; then you may fill up to ")
    assert not any("all flight" in fact["text"] for fact in said["facts"])
    (ending,) = (fact["text"] for fact in said["facts"] if fact["label"] == "log")
    assert ending.startswith(f"ends in flight, at {last}")


def test_a_log_that_begins_in_flight_or_pauses_in_it_says_so():
    analysis, _ = flight()
    since = int(np.flatnonzero(analysis.track.flying)[0]) + 200
    begun = report_flight(*flight(log().track.rows(slice(since, None))), max_utilisation=0.5)
    verdict = begun.json["verdict"]
    assert verdict["headline"] == "THRUST LEFT ABOVE THE 50 % LIMIT (LOG BEGINS IN FLIGHT)"
    first = "record the whole flight next time; then you may fill up to "
    assert verdict["action"].startswith(first)
    rows = np.delete(np.arange(analysis.track.time_s.size), slice(since, since + 301))  # 30 s
    paused = report_flight(*flight(log().track.rows(rows)), max_utilisation=0.5).json["verdict"]
    assert (
        paused["headline"] == "THRUST LEFT ABOVE THE 50 % LIMIT (NOTHING IN THE LOG FOR 30 S OF IT)"
    )
    facts = {fact["label"]: fact["text"] for fact in paused["facts"]}
    assert facts["log"].startswith("has nothing of 30 s of the flight from ")
    assert not any("all flight" in text for text in facts.values())


def test_the_level_follows_the_limit_and_the_redundancy():
    analysis, recorded = flight()
    assert (
        report_flight(analysis, recorded, max_utilisation=0.9).json["verdict"]["level"] == "under"
    )
    heavy = replace(
        analysis, redundancy_yaw_uncontrolled=analysis.redundancy_yaw_uncontrolled * 0.7
    )
    verdict = report_flight(heavy, recorded, max_utilisation=0.9).json["verdict"]
    assert verdict["level"] == "critical"
    lost = analysis.track.flying & (heavy.redundancy_yaw_uncontrolled < 1)
    assert verdict["rotor_lost"]["not_survivable_s"] == pytest.approx(0.1 * np.sum(lost), rel=0.02)


def test_on_a_quad_one_lost_rotor_is_just_survived_at_half_of_capacity(report):
    assert report.json["verdict"]["one_rotor_out_use"] == pytest.approx(0.5)
    fills = report.json["redundancy"]
    assert fills["fill_limit_start_kg"] == pytest.approx(fills["fill_one_rotor_out_start_kg"])


def test_a_hexacopter_survives_more_than_half_of_capacity():
    from thrustmargin.gcs_plugin.reports.margin.load import one_rotor_out_use

    assert one_rotor_out_use(load_airframe("agras-t20")) > 0.5


def test_the_largest_fill_is_the_tank_at_which_redundancy_is_one(analysis, report):
    track, airframe = analysis.track, model().airframe
    # Redundancy goes with 1/weight, so weight times redundancy is what one lost rotor would allow.
    allowed = analysis.redundancy_yaw_uncontrolled * analysis.weight / G0 - airframe.empty_mass
    assert report.json["redundancy"]["fill_one_rotor_out_min_kg"] == pytest.approx(
        np.nanmin(allowed[track.flying])
    )
    assert report.json["redundancy"]["fill_one_rotor_out_start_kg"] == pytest.approx(
        np.nanmedian(allowed[end_rows(track)[0]])
    )


def test_redundancy_figures_are_the_least_of_the_airborne_rows(analysis, report):
    flying = analysis.track.flying
    found = report.json["redundancy"]
    assert found["yaw_free_min"] == np.nanmin(analysis.redundancy_yaw_uncontrolled[flying])
    assert found["yaw_kept_min"] == np.nanmin(analysis.redundancy_yaw_kept[flying])
    assert found["trimmable_loss_min"] == np.nanmin(analysis.trimmable_loss[flying])
    at = np.flatnonzero(analysis.track.time_s == found["yaw_free_min_time_s"])[0]
    assert analysis.redundancy_yaw_uncontrolled[at] == found["yaw_free_min"]


def test_the_papers_figures_stand_beside_the_flights(analysis, report):
    rows = {row["name"]: row for row in report.json["load"]}
    load = rows["load a rotor"]
    assert (load["paper_full"], load["paper_empty"]) == pytest.approx((9.275, 5.275))
    assert rows["load with a full tank over that with an empty one; at the start over at the end"][
        "paper_full"
    ] == pytest.approx(0.7583, abs=5e-5)
    nameplate = rows["load over the maker's maximum thrust"]
    assert nameplate["paper_full"] == pytest.approx(0.546, abs=5e-4)
    hover = rows["thrust in use in hover, by weight"]
    assert (hover["paper_full"], hover["approximate"]) == (0.5, True)

    track = analysis.track
    start = np.nanmedian(track.tank_kg[end_rows(track)[0]])
    end = np.nanmedian(track.tank_kg[end_rows(track)[1]])
    assert load["flight_start"] == pytest.approx((21.1 + start) / 4)
    assert load["flight_end"] == pytest.approx((21.1 + end) / 4)
    ratio = rows["load with a full tank over that with an empty one; at the start over at the end"][
        "flight_start"
    ]
    assert ratio == pytest.approx(load["flight_start"] / load["flight_end"] - 1)
    # On a quad at even load, utilisation in hover is 1/(2 x redundancy).
    expected = np.nanmedian(1 / (2 * analysis.redundancy_yaw_uncontrolled[end_rows(track)[0]]))
    assert hover["flight_start"] == pytest.approx(expected)
    flown = rows["thrust in use in flight, mean of the rotors"]["flight_start"]
    assert flown == pytest.approx(np.median(analysis.utilisation[end_rows(track)[0]].mean(axis=1)))


def test_each_rotor_has_its_own_greatest_and_median_use(analysis, report):
    use = airborne_use(analysis)
    for k, rotor in enumerate(report.json["rotors"]):
        assert rotor["rotor"] == k + 1
        assert rotor["measured_max"] == np.nanmax(use[:, k])
        assert rotor["measured_median"] == np.nanmedian(use[:, k])
        assert rotor["over_limit_share"] == pytest.approx(
            np.mean(use[analysis.track.flying, k] > 0.5), rel=0.02
        )


def test_the_flight_summary_is_that_of_the_recording(report):
    # The manifest: 10 kg down to 3.845 kg at 4 m/s, wind 1.4 m/s from 142 deg, 209 s.
    found = report.json["flight"]
    assert found["tank_start_kg"] == pytest.approx(10.0)
    assert found["tank_end_kg"] == pytest.approx(3.845, abs=0.01)
    assert found["liquid_used_kg"] == pytest.approx(6.155, abs=0.01)
    assert found["ground_speed_median"] == pytest.approx(4.0, abs=0.05)
    assert found["wind_from_deg"] == pytest.approx(142, abs=5)
    assert 195 < found["airborne_s"] < 210
    assert found["start_utc"] is not None
    assert found["start_utc"].endswith("Z")
    # 5 m apart, 591 m sprayed: area and length of the strips must agree.
    assert found["swath_width"] == pytest.approx(5.0, abs=0.2)
    strips = found["swath_width"] * found["sprayed_distance"]
    assert found["sprayed_area"] == pytest.approx(strips, rel=0.05)


def test_a_way_of_which_a_part_is_lost_says_of_how_long():
    track = log().track
    whole = report_flight(*flight(), max_utilisation=0.5).json["flight"]
    middle = np.abs(track.time_s - 100.0) < 15.0  # in the air, with the pump on
    unknown = np.where(middle[:, None], np.nan, track.velocity_ned)
    found = report_flight(*flight(velocity_ned=unknown), max_utilisation=0.5).json["flight"]
    assert whole["distance_lost_s"] == whole["sprayed_distance_lost_s"] == 0.0
    assert found["distance_lost_s"] == pytest.approx(30.0, abs=0.3)
    assert 0.0 < found["sprayed_distance_lost_s"] <= found["distance_lost_s"]
    down = np.where(track.flying[:, None], track.velocity_ned, np.nan)
    assert report_flight(*flight(velocity_ned=down), max_utilisation=0.5).json["flight"][
        "distance_lost_s"
    ] == pytest.approx(0.0)
    # At 4 m/s, less in turns.
    assert 60.0 < whole["distance"] - found["distance"] < 125.0


@pytest.mark.parametrize("lost", ["place", "pause", "pump"])
def test_an_area_of_which_a_part_is_lost_stands_as_at_least(report, lost):
    track = log().track
    on = track.time_s[(track.spraying > 0.5) & track.flying]
    middle = np.abs(track.time_s - np.median(on)) < 15.0
    later = track.time_s + np.where(track.time_s > np.median(on), 30.0, 0.0)
    changed = {
        "place": {"position_ned": np.where(middle[:, None], np.nan, track.position_ned)},
        "pump": {"spraying": np.where(middle, np.nan, track.spraying)},
        "pause": {"time_s": later},
    }[lost]
    found = report_flight(*flight(**changed), max_utilisation=0.5).json["flight"]
    assert np.isnan(found["sprayed_area"])
    # In 30 s at 4 m/s a swath of 5 m is 600 m², with turns less; in a pause none is flown.
    missing = report.json["flight"]["sprayed_area"] - found["sprayed_area_at_least"]
    assert missing == pytest.approx(0.0 if lost == "pause" else 500.0, abs=110.0)
    assert found["sprayed_lost_s"] == pytest.approx(30.0, abs=8.0)
    assert np.isnan(report.json["flight"]["sprayed_area_at_least"])


def test_moments_are_apart_worst_first_and_of_one_rotor_each(analysis, report):
    moments = report.peaks
    use = [m.utilisation for m in moments]
    assert use == sorted(use, reverse=True)
    times = np.sort([m.time_s for m in moments])
    assert np.all(np.diff(times) >= APART_S)
    assert len(moments) > 4
    for m in moments:
        row = np.flatnonzero(analysis.track.time_s == m.time_s)[0]
        assert m.utilisation == np.nanmax(analysis.utilisation[row])


def test_what_was_happening_is_named_from_the_channels(report):
    # Every line end of this flight has a fast yaw turn; the first seconds are the take-off.
    words = {m.time_s: tuple(map(activity_words, m.activities)) for m in report.peaks}
    turning = [w for w in words.values() if {"turning left", "turning right"} & set(w)]
    assert len(turning) >= 5
    first = words[min(words)]
    assert first[:2] == ("taking off", "climbing")


@pytest.mark.parametrize(
    ("channel", "column", "value", "word"),
    [
        ("angular_rate_frd", 2, 0.5, "turning right"),
        ("angular_rate_frd", 2, -0.5, "turning left"),
        ("velocity_ned", 2, -2.0, "climbing"),
        ("velocity_ned", 2, 2.0, "descending"),
        ("attitude", 1, -0.5, "tilted 29°"),
    ],
)
def test_a_movement_has_its_name_and_direction(channel, column, value, word):
    still = {name: np.zeros((200, 3)) for name in ("angular_rate_frd", "velocity_ned", "attitude")}
    still[channel][:, column] = value
    track = FlightTrack.of(name="x", time_s=np.arange(200.0) / 10, rotor_count=4, **still)
    words = doing(track, 100)
    assert word in words
    assert set(words) <= {word, "hovering"}


def test_speeding_up_and_braking_follow_the_slope_of_ground_speed():
    time_s = np.arange(200.0) / 10
    for slope, word in ((1.0, "speeding up"), (-1.0, "braking")):
        velocity = np.zeros((200, 3))
        velocity[:, 1] = 30.0 + slope * time_s
        track = FlightTrack.of(name="x", time_s=time_s, rotor_count=4, velocity_ned=velocity)
        assert doing(track, 100) == (word,)


def test_without_rotor_speeds_everything_is_predicted_and_said_so():
    analysis, recorded = without("rotor_speed_rpm")
    report = report_flight(analysis, recorded, max_utilisation=0.5)
    worst = report.worst
    assert worst is not None
    assert worst.basis == "predicted"
    flying = analysis.track.flying
    assert worst.utilisation == np.nanmax(analysis.utilisation_predicted[flying])
    assert report.json["verdict"]["measured_share"] == 0.0
    assert report.json["verdict"]["basis"] == "predicted; no rotor speeds in this log"
    assert (
        "no rotor speeds in this log: all figures are predicted"
        in report.json["quality"]["missing"]
    )
    assert report.json["accuracy"]["overall"] is None
    assert "No rotor speeds" in report.json["accuracy"]["words"]


def test_with_rotor_speeds_in_half_of_the_flight_the_rest_is_predicted():
    track = log().track
    rpm = track.rotor_speed_rpm.copy()
    rpm[track.time_s > 110] = np.nan
    analysis, recorded = flight(rotor_speed_rpm=rpm)
    verdict = report_flight(analysis, recorded, max_utilisation=0.5).json["verdict"]
    assert 0.4 < verdict["measured_share"] < 0.6
    assert "predicted for the rest" in verdict["basis"]


def test_without_tank_and_rotor_speeds_there_is_no_verdict():
    report = report_flight(*without("rotor_speed_rpm", "tank_kg"), max_utilisation=0.5)
    assert report.json["verdict"]["level"] == "unknown"
    assert report.worst is None
    assert report.peaks == ()
    assert np.isnan(report.json["redundancy"]["yaw_free_min"])
    assert report.json["verdict"]["headline"] == "NO VERDICT"


def test_without_a_tank_level_measured_use_stands_and_redundancy_is_unknown():
    report = report_flight(*without("tank_kg"), max_utilisation=0.5)
    assert report.worst is not None
    assert report.worst.basis == "measured"
    assert np.isnan(report.json["flight"]["liquid_used_kg"])
    said = {fact["label"]: fact["text"] for fact in report.json["verdict"]["facts"]}
    assert "tank level is unknown" in said["one rotor lost"]


@pytest.mark.parametrize(
    "channel",
    ["position_ned", "velocity_ned", "wind_ned", "spraying", "voltage", "angular_rate_frd"],
)
def test_a_missing_channel_is_said_and_never_made_up(channel):
    report = report_flight(*without(channel), max_utilisation=0.5)
    assert len(report.json["quality"]["missing"]) == 1
    of_flight = report.json["flight"]
    unknown = {
        "position_ned": [report.peaks[0].north, of_flight["sprayed_area"]],
        "velocity_ned": [of_flight["distance"], report.peaks[0].ground_speed],
        "wind_ned": [
            of_flight["wind_speed_median"],
            of_flight["wind_from_deg"],
        ],
        "spraying": [
            of_flight["spraying_s"],
            of_flight["sprayed_distance"],
        ],
        "voltage": [of_flight["voltage_start"], of_flight["voltage_min"]],
        "angular_rate_frd": [],
    }[channel]
    assert all(np.isnan(value) for value in unknown)


def test_a_log_that_never_left_the_ground_has_no_verdict():
    track = log().track
    report = report_flight(*flight(flying=np.zeros_like(track.flying)), max_utilisation=0.5)
    assert report.json["verdict"]["level"] == "unknown"
    found = report.json["verdict"]["facts"][0]["text"]
    assert found == "by this log it never left the ground: by its own landed state"
    assert report.json["flight"]["airborne_s"] == 0.0
    assert np.isnan(report.json["flight"]["tank_start_kg"])


def test_a_flight_of_one_row_is_reported():
    track = log().track
    analysis, recorded = flight(track=track.rows(slice(900, 901)))
    report = report_flight(analysis, recorded, max_utilisation=0.5)
    assert report.worst is not None
    assert report.worst.utilisation == np.nanmax(analysis.utilisation)


def test_a_pause_of_the_log_is_not_counted_as_time_above_the_limit():
    track = log().track
    rows = np.r_[0:900, 1300 : track.time_s.size]
    cut = track.rows(rows)
    report = report_flight(*flight(track=cut), max_utilisation=0.01)
    assert report.json["verdict"]["use"]["above_limit_s"] == pytest.approx(
        0.1 * np.sum(cut.flying), rel=0.02
    )


def test_shares_by_basis_add_up_to_one(report):
    use = report.json["model"]
    assert use["network_share"] + use["physics_share"] + use["none_share"] == pytest.approx(1.0)
    assert use["inside_envelope"] is None  # this model has no network


def test_the_data_quality_is_what_the_reader_says(report):
    whole = log().quality
    assert report.json["quality"]["frames"] == whole.frames
    assert report.json["quality"]["bytes"] == whole.bytes
    assert [c["source"] for c in report.json["quality"]["channels"]] == [
        source_words(c.source) for c in log().channels
    ]
    assert report.json["quality"]["messages"] == log().messages


@pytest.mark.parametrize("limit", [0.0, 1.0, -0.5, 50.0, float("nan")])
def test_a_limit_that_is_no_share_is_refused(limit):
    with pytest.raises(DataError, match="is no share"):
        build_report([flight()], max_utilisation=limit)


def test_several_flights_are_counted_by_verdict_and_the_worst_is_named():
    light = report_flight(*flight(), max_utilisation=0.5)
    analysis, recorded = flight()
    heavier = replace(
        analysis,
        utilisation=analysis.utilisation * 1.2,
        redundancy_yaw_uncontrolled=analysis.redundancy_yaw_uncontrolled / 1.2,
    )
    report = build_report([(analysis, recorded), (heavier, recorded)])
    assert report.flights[0].json["verdict"] == light.json["verdict"]
    assert (report.overview["critical"], report.overview["under"]) == (1, 1)
    assert report.overview["worst_flight"] == 2
    assert report.overview["headline"] == "1 OF 2 FLIGHTS: TOO HEAVY TO LOSE A ROTOR"


def test_a_report_without_flights_is_refused():
    with pytest.raises(DataError, match="no flight"):
        build_report([])


def test_a_track_without_any_channel_is_reported_as_unknown():
    bare = FlightTrack.of(name="bare", time_s=np.arange(5.0), rotor_count=4)
    report = report_flight(*flight(track=bare), max_utilisation=0.5)
    assert report.json["verdict"]["level"] == "unknown"
    assert len(report.json["quality"]["missing"]) > 5


def test_the_fill_advised_is_the_least_of_the_flight_and_that_of_its_start(analysis, report):
    verdict, rows = report.json["verdict"], report.rows
    both = np.minimum(rows["fill_limit_kg"], rows["fill_one_rotor_out_kg"])
    flying = analysis.track.flying
    assert verdict["fill"]["limit_kg"] == pytest.approx(both[flying].min())
    row = int(np.argmin(np.where(flying, both, np.inf)))
    mass, error = 21.1 + both[row], analysis.redundancy_error[row]
    assert verdict["fill"]["low_kg"] == pytest.approx(mass * np.exp(-1.645 * error) - 21.1)
    assert verdict["fill"]["high_kg"] <= mass * np.exp(1.645 * error) - 21.1 + 1e-9
    assert 0.0 <= verdict["fill"]["low_kg"] - verdict["fill"]["kg"] < 0.1
    assert verdict["fill"]["limit_kg"] < verdict["fill"]["fresh_kg"] <= 16.0
    assert verdict["fill"]["start_kg"] == pytest.approx(10.0, abs=0.3)


def test_a_gauge_that_stands_at_nothing_reassures_nobody(report):
    rows = log().track.time_s.size
    stuck = report_flight(*flight(tank_kg=np.zeros(rows)), max_utilisation=0.5)
    held, sound = stuck.json["verdict"], report.json["verdict"]
    assert held["rotor_lost"]["redundancy_min"] == pytest.approx(
        sound["rotor_lost"]["redundancy_min"], rel=0.05
    )
    said = {fact["label"]: fact["text"] for fact in held["facts"]}
    assert "0.0 kg by NAMED_VALUE_FLOAT TANK are too little for these rotor speeds" in said["load"]
    do = said["what to do"]
    assert do.startswith(
        "disarmed on the ground, check gauge and empty mass, and with the battery off the "
        "propellers: thrust shows "
    )
    beyond = f"{held['fill']['beyond_gauge_kg']:.1f} kg"
    assert f"{beyond} more than was reported; until then you may fill up to" in do
    assert sound["fill"]["beyond_gauge_kg"] == 0.0
    # Whether the tank was full or the aircraft is heavier than its file, nothing tells.
    beyond = np.nanmedian(log().track.tank_kg[log().track.flying])
    assert beyond > 5.0
    assert sound["fill"]["low_kg"] - held["fill"]["low_kg"] == pytest.approx(beyond, rel=0.25)


def test_report_and_inspection_count_the_same_pauses():
    """One before the first row (parameters being sent) is none of the flight."""
    analysis, recorded = flight()
    start = recorded.clock_start_s
    gaps = ((start - 30.0, 10.3), (start + 5.0, 1.5))
    recorded = replace(recorded, quality=replace(recorded.quality, gaps=gaps))
    quality = report_flight(analysis, recorded, max_utilisation=0.5).json["quality"]
    assert (quality["silences"], quality["longest_silence_s"]) == (1, 1.5)
    found = {f.check: f.words for f in inspect_log(recorded, model().airframe).findings}
    assert found["time"].startswith("1 pause(s) over 1 s without any message, 1.5 s in all")
