"""The report's figures of a flight of ten rows, one a second, each worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import log, model
from thrustmargin.gcs_plugin.reports.margin import report_flight
from thrustmargin.gcs_plugin.reports.margin.data import ReportedFlight, end_rows, share
from thrustmargin.gcs_plugin.reports.margin.load import redundancy_rows
from thrustmargin.gcs_plugin.wording.margin_verdict import (
    estimate,
    peak_words,
    voltage_facts,
)
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, with_bad_part
from thrustmargin.models.model.utilisation_peaks import Activity, UtilisationPeak
from thrustmargin.models.physics.smoothing import known_least, known_mean, known_median, known_most
from thrustmargin.models.scores import Estimate

G0 = 9.80665  # m/s²


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


def report_of(analysis: FlightAnalysis, limit: float = 0.5) -> ReportedFlight:
    recorded = replace(log(), track=analysis.track)
    return report_flight(analysis, recorded, max_utilisation=limit)


def rising() -> np.ndarray:
    """Rotor 1 at 0.1, 0.2, ... 1.0, the others at 0.3."""
    use = np.full((ROWS, 4), 0.3)
    use[:, 0] = np.arange(1, ROWS + 1) / 10
    return use


@pytest.mark.parametrize(
    ("tank", "load", "said"),
    [(20.0, 0.0, "0.0 kg on board"), (0.0, 3.0, "3.0 kg on board"), (0.0, 0.0, "")],
)
def test_a_worst_moment_without_a_tank_has_no_kg_but_a_payload(tank, load, said):
    analysis = used(rising(), tank_kg=np.full(ROWS, load))
    craft = replace(model().airframe, tank_volume_l=tank)
    analysis = replace(analysis, model=replace(analysis.model, airframe=craft))
    worst = report_of(analysis).worst
    assert worst is not None
    assert [part for part in peak_words(worst).split(", ") if "kg" in part] == [said] * bool(said)


def test_time_above_the_limit_counts_airborne_rows_in_which_one_rotor_is_above():
    report = report_of(used(rising()), limit=0.55)
    verdict, worst = report.json["verdict"], report.worst
    assert verdict["use"]["above_limit_s"] == pytest.approx(
        4.0
    )  # 0.6, 0.7, 0.8, 0.9; 1.0 is on the ground
    assert verdict["above_limit_share"] == pytest.approx(4 / 8)
    assert verdict["measured_share"] == pytest.approx(1.0)
    assert worst is not None
    assert (worst.rotor, worst.time_s) == (0, 8.0)
    assert worst.utilisation == pytest.approx(0.9)
    assert worst.margin == pytest.approx(0.1)


def test_each_rotor_has_its_own_most_median_and_share_above():
    first, second, *_ = report_of(used(rising()), limit=0.55).json["rotors"]
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
    assert report.json["verdict"]["use"]["above_limit_s"] == pytest.approx(4.0)
    assert report.json["verdict"]["use"]["above_limit_s"] == np.sum(analysis.above_limit(0.55))
    assert np.isnan(report.json["rotors"][3]["over_limit_share"])
    rows = {row["name"]: row for row in report.json["load"]}
    assert np.isnan(rows["thrust in use in flight, mean of the rotors"]["flight_start"])


def test_rows_without_any_measurement_are_judged_by_the_prediction():
    use = rising()
    use[2:4] = NAN
    verdict = report_of(used(use), limit=0.55).json["verdict"]
    assert verdict["use"]["above_limit_s"] == pytest.approx(6.0)
    assert verdict["measured_share"] == pytest.approx(6 / 8)
    assert (
        verdict["basis"] == "rotor speeds measured for 75 % of the flight, predicted for the rest"
    )


def test_the_flight_in_figures():
    wind = np.tile([0.0, -2.0, 0.0], (ROWS, 1))  # blows to the west, from the east
    found = report_of(used(rising(), wind_ned=wind)).json["flight"]
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
    rows = {row["name"]: row for row in report_of(used(rising())).json["load"]}
    # The first and last tenth of eight airborne rows are one row: 8 kg and 1 kg in the tank.
    load = rows["load a rotor"]
    assert load["flight_start"] == pytest.approx((airframe.empty_mass + 8.0) / 4)
    assert load["flight_end"] == pytest.approx((airframe.empty_mass + 1.0) / 4)
    increase = (airframe.empty_mass + 8.0) / (airframe.empty_mass + 1.0) - 1
    assert rows["load with a full tank over that with an empty one; at the start over at the end"][
        "flight_start"
    ] == pytest.approx(increase)
    nameplate = rows["load over the maker's maximum thrust"]["flight_start"]
    assert nameplate == pytest.approx(load["flight_start"] * G0 / airframe.nameplate_max_thrust)
    mean_use = rows["thrust in use in flight, mean of the rotors"]
    assert mean_use["flight_start"] == pytest.approx((0.2 + 3 * 0.3) / 4)
    assert mean_use["flight_end"] == pytest.approx((0.9 + 3 * 0.3) / 4)


def test_redundancy_below_one_is_counted_in_airborne_seconds():
    free = np.array([0.1, 0.9, 0.95, 1.0, 1.1, 1.2, 1.3, 1.4, NAN, 0.1])
    report = report_of(replace(used(rising()), redundancy_yaw_uncontrolled=free))
    assert report.json["verdict"]["level"] == "critical"
    assert report.json["verdict"]["rotor_lost"]["not_survivable_s"] == pytest.approx(2.0)
    assert report.json["redundancy"]["below_one_share"] == pytest.approx(2 / 7)
    assert report.json["redundancy"]["yaw_free_min"] == 0.9
    assert report.json["redundancy"]["yaw_free_min_time_s"] == 1.0
    assert report.json["redundancy"]["yaw_free_median"] == 1.1


def test_with_a_bad_rotor_only_what_is_surely_bad_of_the_loss_of_one_more_is_counted():
    """Of eight rows in flight five are below 1: the others are unknown, and the middle of all."""
    analysis = used(rising())
    free = np.array([2.0, 0.9, 0.8, 0.9, 0.8, 0.9, 1.2, 1.3, 1.4, 2.0])
    bad = with_bad_part(replace(analysis, redundancy_yaw_uncontrolled=free))
    nothing = np.full(ROWS, np.nan)
    unknown = {"fill_limit_kg": nothing, "fill_one_rotor_out_kg": nothing}
    rows = redundancy_rows(bad, unknown, analysis.track.row_seconds)
    assert rows["below_one_share"] == pytest.approx(5 / 8)
    assert rows["yaw_free_min"] == pytest.approx(0.8)
    assert np.isnan([rows["yaw_free_median"], rows["trimmable_loss_min"]]).all()


def test_the_largest_fill_counts_mass_that_the_model_knows_to_be_hidden():
    mass = Identified(value=3.0, unit="kg", ci95=(2.9, 3.1))
    hidden = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavier = replace(model(), effects=(hidden,))
    known, unknown = (
        report_of(analyse(flown(), chosen)).json["redundancy"] for chosen in (heavier, model())
    )
    for name in ("fill_limit_start_kg", "fill_one_rotor_out_min_kg"):
        assert known[name] == pytest.approx(unknown[name] - 3.0)


OF_KNOWN = known_median, known_mean, known_most, known_least


def test_known_numbers_leave_nan_out():
    values = np.array([NAN, 3.0, 1.0, NAN, 8.0])
    assert [f(values) for f in OF_KNOWN] == [3.0, 4.0, 8.0, 1.0]
    nothing = np.full(3, NAN)
    assert all(np.isnan(f(nothing)) for f in OF_KNOWN)
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


PEAK = UtilisationPeak(
    time_s=53.7,
    rotor=1,
    rotor_name="rear left",
    utilisation=0.731,
    utilisation_low=0.731,
    utilisation_high=0.731,
    basis="measured",
    activities=(Activity("turning right"), Activity("spraying")),
    tank_kg=14.56,
    ground_speed=1.9,
    airspeed=2.2,
    climb_rate=0.0,
    height_agl=3.0,
    north=158.4,
    east=-5.0,
    latitude_deg=NAN,
    longitude_deg=NAN,
    redundancy_yaw_uncontrolled=0.94,
)


def test_a_peak_is_named_by_rotor_time_movement_and_place():
    assert peak_words(PEAK) == (
        "rotor 2, rear left, at 0:53, turning right, spraying, 14.6 kg on board, "
        "158 m north, 5 m west of the start"
    )
    bare = replace(PEAK, activities=(), tank_kg=NAN, north=NAN)
    assert peak_words(bare) == "rotor 2, rear left, at 0:53"
    inferred = replace(bare, utilisation=0.48, utilisation_low=0.43, utilisation_high=0.53)
    assert peak_words(replace(inferred, basis="from motor outputs")) == (
        "rotor 2, rear left, at 0:53, thrust left 52 % (47 to 57), from motor outputs"
    )


def test_more_than_all_thrust_is_said_as_beyond_the_ceiling():
    for most_used, told in ((1.24, True), (0.98, False)):
        use = np.full((ROWS, 4), 0.3)
        use[4, 1] = most_used
        facts = {f["label"]: f["text"] for f in report_of(used(use)).json["verdict"]["facts"]}
        assert ("beyond the ceiling" in facts) == told
        if told:
            said = facts["beyond the ceiling"]
            assert said.startswith(
                "rotor 2 shows 24 % more thrust than the airframe says it can make"
            )
            assert all(word in said for word in ("voltage", "max_rotor_speed_rpm", "eRPM"))


def test_an_estimate_has_its_interval_in_brackets_where_there_is_one():
    assert estimate(Estimate(value=41.23, low=38.04, high=44.58), "rpm") == ("41 (38 to 45) rpm")
    share_of_rows = Estimate(value=0.968, low=0.95, high=1.0)
    assert estimate(share_of_rows, "%", 1, 100) == "97 (95 to 100) %"
    assert estimate(Estimate(value=41.23, low=NAN, high=NAN), "rpm") == "41.2 rpm"
    assert estimate(Estimate(value=NAN, low=NAN, high=NAN), "rpm") == "unknown"


@pytest.mark.parametrize(("lost", "said"), [(0, ""), (2, ""), (30, "not known for 3.0 s of 9.9 s")])
def test_a_voltage_that_is_missing_for_a_part_is_said_with_what_stands_in(lost: int, said: str):
    volts = np.full(100, 50.0)
    volts[:lost] = 0.0
    track = FlightTrack.of(
        name="v", time_s=np.arange(100) / 10.0, rotor_count=4, voltage=volts, tank_kg=np.ones(100)
    )
    track = replace(track, flying=np.ones(100, dtype=np.bool_))
    analysis = analyse(track, model())
    facts = voltage_facts(analysis)
    shown = [(f["label"], f["text"]) for f in report_of(analysis).json["verdict"]["facts"]]
    assert set(facts) <= set(shown)
    assert [text for _, text in facts] == (
        [f"{said}: the most thrust is taken at 51.8 V"] if said else []
    )
