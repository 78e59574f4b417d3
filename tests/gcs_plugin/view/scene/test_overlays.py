"""What colours the route is the worst rotor of each row, and it says what it rests on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.reports.margin.summary import report_flight
from thrustmargin.gcs_plugin.view.scene.aircraft import tank_level
from thrustmargin.gcs_plugin.view.scene.overlays import (
    before_and_after,
    overlays_of,
    residual_limit,
    speed_overlay,
)
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe


def by_name(analysis):
    return {o.name: o for o in overlays_of(analysis)}


def test_thrust_left_is_that_of_the_rotor_that_works_hardest():
    analysis = flight()
    overlays = by_name(analysis)
    assert list(overlays) == ["Thrust left", "Redundancy", "Residual"]
    np.testing.assert_allclose(overlays["Thrust left"].values, analysis.margin.min(axis=1))
    hardest = np.argmax(analysis.utilisation, axis=1)
    np.testing.assert_array_equal(overlays["Thrust left"].rotor, hardest)
    np.testing.assert_array_equal(
        overlays["Redundancy"].values, analysis.redundancy_yaw_uncontrolled
    )


def test_residual_is_the_rotor_furthest_off_with_its_sign():
    analysis = flight()
    overlay = by_name(analysis)["Residual"]
    residual = analysis.residual_rpm
    row = int(np.argmin(residual.min(axis=1)))
    furthest = int(np.argmax(np.abs(residual[row])))
    assert overlay.values[row] == residual[row, furthest] < 0
    assert overlay.rotor is not None
    assert overlay.rotor[row] == furthest
    assert overlay.worst == "abs"


def test_the_residuals_colours_end_where_the_residual_does():
    analysis = flight()
    overlay = by_name(analysis)["Residual"]
    size = np.abs(overlay.values[analysis.track.flying])
    assert 0.01 <= np.mean(size > overlay.scale.high) <= 0.03
    assert overlay.scale.low == -overlay.scale.high


def test_the_note_tells_measured_from_predicted():
    rpm = flight().track.rotor_speed_rpm.copy()
    assert by_name(flight())["Thrust left"].note == "measured"
    rpm[: ROWS // 2] = np.nan
    assert (
        by_name(flight(rotor_speed_rpm=rpm))["Thrust left"].note
        == "measured for 50 %, predicted for the rest"
    )
    rpm[:] = np.nan
    nothing = by_name(flight(rotor_speed_rpm=rpm))
    assert nothing["Thrust left"].note == "predicted: no rotor speed was measured"
    assert np.all(np.isfinite(nothing["Thrust left"].values))
    assert np.all(np.isnan(nothing["Residual"].values))


def test_a_row_without_any_number_is_unknown_and_not_zero():
    nothing = np.full(ROWS, np.nan)
    overlays = by_name(flight(rotor_speed_rpm=np.full((ROWS, 4), np.nan), tank_kg=nothing))
    for overlay in overlays.values():
        assert np.all(np.isnan(overlay.values)), overlay.name
    assert overlays["Thrust left"].note == ""


def test_the_worst_moment_reads_with_value_rotor_and_time():
    overlay = by_name(flight())["Thrust left"]
    names = ("a", "b", "c", "front left <b>")
    row = int(np.argmax(overlay.values))
    told = overlay.at(row, 151.7, names)
    assert told["value"] == f"{100 * overlay.values[row]:.0f} %"
    assert (told["number"], told["place"], told["time"]) == (4, "front left <b>", "2:31")


def test_with_one_esc_silent_view_and_report_count_the_same_rows_above_the_limit(sitl_logs: Path):
    """By a prediction of the silent rotor there would be 159 rows more."""
    airframe = load_airframe("topxgun-f16-sitl")
    log = read_log(sitl_logs / "campaign" / "v4_m16_q2.5.tlog", airframe=airframe)
    model = physics_model(airframe)
    speeds = log.track.rotor_speed_rpm.copy()
    speeds[:, 1] = np.nan
    analysis = analyse(replace(log.track, rotor_speed_rpm=speeds), model)
    left = by_name(analysis)["Thrust left"]
    shown = analysis.track.flying & (left.values < 0.5)
    assert shown.sum() == 1760
    np.testing.assert_array_equal(shown, analysis.above_limit(0.5))
    seconds = report_flight(analysis, log, max_utilisation=0.5).json["verdict"]["use"][
        "above_limit_s"
    ]
    assert seconds == pytest.approx(0.1 * shown.sum(), rel=0.01)
    assert left.rotor is not None
    assert 1 not in left.rotor[analysis.any_measured]


def test_the_worst_row_is_of_the_rows_asked_for_and_absent_when_nothing_is_known():
    values = np.full(100, np.nan)
    values[17], values[80] = -9.0, 4.0
    every, some = np.ones(100, dtype=bool), np.arange(100) > 50
    load = by_name(flight())["Thrust left"]
    wanted = {"max": (80, 80), "min": (17, 80), "abs": (17, 80)}
    for worst, rows in wanted.items():
        overlay = replace(load, values=values, worst=worst)
        assert (overlay.worst_row(every), overlay.worst_row(some)) == rows
        assert overlay.worst_row(np.arange(100) > 80) is None


def test_an_aircraft_without_a_tank_shows_no_level():
    assert np.isnan(tank_level(0.0, 0.0))
    assert np.isnan(tank_level(np.nan, 10.0))
    assert [tank_level(kg, 10.0) for kg in (0.0, 4.0, 12.0)] == [0.0, 0.4, 1.0]


def test_the_speed_over_ground_is_level_and_its_extreme_the_fastest():
    analysis = flight()
    velocity = np.zeros((ROWS, 3))
    velocity[:, 2] = 9.0  # up or down is none
    velocity[30] = 3.0, -4.0, 0.0
    made = speed_overlay(replace(analysis.track, velocity_ned=velocity))
    assert made.values[30] == pytest.approx(5.0)
    assert made.values[31] == 0.0
    assert made.worst_row(np.ones(ROWS, dtype=bool)) == 30
    assert made.at(30, 151.0, ("front right",)) == {
        "extreme": "fastest",
        "value": made.scale.number(5.0),
        "number": None,
        "place": "",
        "time": "2:31",
    }


def test_a_residual_ends_its_colours_where_two_percent_of_the_rows_in_flight_are_beyond():
    residual = np.linspace(-50.0, 50.0, 1001)
    flying = np.ones(1001, dtype=bool)
    assert residual_limit(residual, flying) == pytest.approx(49.0, abs=0.1)
    residual[:100] = 900.0  # on the ground
    flying[:100] = False
    assert residual_limit(residual, flying) < 50.0
    assert residual_limit(residual / 1000.0, flying) == 1.0
    assert residual_limit(np.full(1001, np.nan), flying) == 1.0


def test_before_and_after_are_of_one_flight_and_in_the_same_colours():
    one = flight()
    other = analyse(one.track, replace(one.model, background_rpm=(5.0,) * 4))
    first, second = before_and_after(one, other)
    assert first.scale is second.scale
    assert first.name != second.name
    with pytest.raises(DataError, match="two flights"):
        before_and_after(one, flight(name="another.tlog"))
