"""Prediction error of a flight and its intervals from blocks of time."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import flight, log, model
from thrustmargin.gcs_plugin.reports.margin.summary import error_row
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, Prediction, analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.prediction_error import prediction_error

BLOCK_S, FEWEST_BLOCKS = 20.0, 5  # s of a block; of them, for an interval
NAMES = ("a", "b", "c", "d")


def correlated(rows: int, step: float, tau: float, rng: np.random.Generator) -> np.ndarray:
    """(rows, 4) noise of unit variance with correlation time `tau` s."""
    keep = np.exp(-step / tau)
    kicks = rng.normal(size=(rows, 4)) * np.sqrt(1 - keep**2)
    kicks[0] = rng.normal(size=4)
    out = np.empty((rows, 4))
    level = np.zeros(4)
    for k in range(rows):
        level = keep * level + kicks[k]
        out[k] = level
    return out


def made(error_rpm: np.ndarray, step: float, half_width_rpm: float = 50.0) -> FlightAnalysis:
    """A flight whose prediction differs from the measurement by `error_rpm` (T, 4)."""
    time_s = np.arange(error_rpm.shape[0]) * step
    predicted = 2000.0 + 100.0 * np.sin(time_s / 7.0)[:, None] * np.ones(4)
    track = FlightTrack.of(
        name="made",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=predicted + error_rpm,
        tank_kg=np.full(time_s.size, 10.0),
        airspeed=np.full(time_s.size, 4.0),
    )
    analysis = analyse(track, model())
    prediction = Prediction(
        rotor_speed_rpm=predicted,
        lower_rpm=predicted - half_width_rpm,
        upper_rpm=predicted + half_width_rpm,
        coverage=0.9,
        thrust=analysis.prediction.thrust,
        basis=analysis.prediction.basis,
    )
    return replace(analysis, prediction=prediction, residual_rpm=error_rpm)


def test_rmse_bias_r2_and_coverage_are_those_of_the_airborne_rows():
    analysis, _ = flight()
    found = prediction_error(analysis, analysis.places)
    flying = analysis.track.flying
    measured = analysis.track.rotor_speed_rpm[flying]
    predicted = analysis.prediction.rotor_speed_rpm[flying]
    good = np.isfinite(measured) & np.isfinite(predicted)
    error = measured - predicted
    r2 = []
    for k, rotor in enumerate(found.rotors):
        rows = good[:, k]
        e, y = error[rows, k], measured[rows, k]
        assert rotor.rows == rows.sum()
        assert rotor.rmse_rpm.value == pytest.approx(np.sqrt(np.mean(e**2)))
        assert rotor.bias_rpm.value == pytest.approx(np.mean(e))
        r2.append(1 - np.sum(e**2) / np.sum((y - y.mean()) ** 2))
        assert rotor.r2.value == pytest.approx(r2[-1])
    assert found.overall is not None
    assert found.overall.rmse_rpm.value == pytest.approx(np.sqrt(np.mean(error[good] ** 2)))
    assert found.overall.r2.value == pytest.approx(np.mean(r2))


def test_coverage_is_the_share_inside_the_interval():
    error = np.linspace(-100.0, 100.0, 2001)[:, None] * np.ones(4)
    found = prediction_error(made(error, 0.1, half_width_rpm=50.0), NAMES)
    assert found.overall is not None
    assert found.overall.coverage.value == pytest.approx(0.5, abs=0.001)
    assert found.promised_coverage == 0.9


def test_more_samples_a_second_do_not_make_a_figure_surer():
    rng = np.random.default_rng(1)
    slow = correlated(600, 0.5, 3.0, rng) * 30
    fast = np.repeat(slow, 10, axis=0)
    widths = []
    for error, step in ((slow, 0.5), (fast, 0.05)):
        overall = prediction_error(made(error, step), NAMES).overall
        assert overall is not None
        widths.append(overall.rmse_rpm.high - overall.rmse_rpm.low)
    assert widths[1] == pytest.approx(widths[0], rel=0.15)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(2)
    held = {"bias": 0, "rmse": 0}
    trials = 60
    for _ in range(trials):
        error = correlated(1000, 0.2, 2.0, rng) * 20
        for rotor in prediction_error(made(error, 0.2), NAMES).rotors:
            held["bias"] += rotor.bias_rpm.low <= 0.0 <= rotor.bias_rpm.high
            held["rmse"] += rotor.rmse_rpm.low <= 20.0 <= rotor.rmse_rpm.high
    for name, count in held.items():
        # 240 intervals made for 95 %; by counting samples fewer than half would hold.
        assert 0.89 <= count / (4 * trials) <= 0.99, name


def test_a_flight_too_short_for_blocks_has_figures_but_no_intervals():
    rows = int(BLOCK_S * (FEWEST_BLOCKS - 0.5) / 0.1)
    short = made(np.full((rows, 4), 7.0), 0.1)
    found = prediction_error(short, NAMES)
    assert found.overall is not None
    assert found.overall.bias_rpm.value == pytest.approx(7.0)
    assert np.isnan(found.overall.bias_rpm.low)
    assert error_row(short)["words"].startswith("No intervals")


def test_rows_without_prediction_do_not_count():
    analysis = made(np.full((2001, 4), 5.0), 0.1)
    analysis.prediction.rotor_speed_rpm[1000:] = np.nan
    found = prediction_error(analysis, NAMES)
    assert found.rotors[0].rows == 1000
    assert found.rotors[0].bias_rpm.value == pytest.approx(5.0)


def test_a_silent_rotor_is_left_out_and_the_others_stand():
    analysis = made(np.full((2001, 4), 5.0), 0.1)
    analysis.track.rotor_speed_rpm[:, 2] = np.nan
    found = prediction_error(analysis, NAMES)
    assert [r.name for r in found.rotors] == ["a", "b", "d"]
    assert found.overall is not None
    assert np.isfinite(found.overall.r2.value)


@pytest.mark.parametrize(
    ("name", "trained"), [("v4_m10_q2.5.tlog", True), ("v4_m10_q2.5.BIN", True), ("new.BIN", False)]
)
def test_a_flight_that_trained_the_network_is_said_to_have(name, trained):
    analysis = analyse(replace(log().track, name=name), shipped_model())
    found = prediction_error(analysis, NAMES)
    assert found.trained_on is trained
    assert ("learnt from a flight of this name" in error_row(analysis)["words"]) is trained


def test_without_a_network_no_flight_has_trained_it():
    assert prediction_error(flight()[0], NAMES).trained_on is False
