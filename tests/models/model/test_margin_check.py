"""Thrust in use, predicted against measured: worked out by hand on rows made for it."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.model_misfit import margin_check


@pytest.fixture(scope="module")
def flown(sitl_logs):
    return analyse(read_log(sitl_logs / "campaign" / "v4_m10_q2.5.tlog").track, shipped_model())


def with_use(flown, measured, predicted, half=0.1):
    """The flight with these shares in use in flight, (T,), and an interval of speed +- half."""
    rotors = flown.track.rotor_count
    speed = np.ones((measured.size, rotors))
    prediction = replace(
        flown.prediction,
        rotor_speed_rpm=speed,
        lower_rpm=(1.0 - half) * speed,
        upper_rpm=(1.0 + half) * speed,
    )
    return replace(
        flown,
        utilisation=np.repeat(measured[:, None], rotors, axis=1),
        utilisation_predicted=np.repeat(predicted[:, None], rotors, axis=1),
        prediction=prediction,
    )


def test_the_worst_rotor_is_compared_at_three_steps_and_the_interval_is_counted(flown):
    rows = flown.track.time_s.size
    share = np.empty(rows)
    share[flown.track.flying] = np.linspace(0.0, 1.0, np.count_nonzero(flown.track.flying))
    share[~flown.track.flying] = 9.0
    check = margin_check(with_use(flown, 0.4 + 0.2 * share, 0.5 + 0.0 * share))
    assert check is not None
    assert [s.name for s in check.steps] == ["typical", "worst 5 %", "worst 1 %"]
    assert [s.measured for s in check.steps] == pytest.approx([0.5, 0.59, 0.598], abs=2e-3)
    assert [s.predicted for s in check.steps] == pytest.approx([0.5] * 3)
    # Speed within 10 % is use within 0.81 to 1.21 of 0.5: 0.405 to 0.605, all but 2.5 % of rows.
    assert check.coverage == pytest.approx(0.975, abs=2e-3)


def test_each_side_has_its_own_worst_rotor(flown):
    use = np.full(flown.track.rotor_speed_rpm.shape, 0.3)
    one, other = use.copy(), use.copy()
    one[:, 0], other[:, 2] = 0.6, 0.5
    same = with_use(flown, use[:, 0], use[:, 0])
    check = margin_check(replace(same, utilisation=one, utilisation_predicted=other))
    assert check is not None
    assert (check.steps[0].measured, check.steps[0].predicted) == (0.6, 0.5)


def test_what_was_not_measured_is_not_compared(flown):
    silent = replace(flown, utilisation=np.full_like(flown.utilisation, np.nan))
    assert margin_check(silent) is None
    few = np.zeros_like(flown.track.flying)
    few[np.flatnonzero(flown.track.flying)[:99]] = True
    assert margin_check(replace(flown, track=replace(flown.track, flying=few))) is None


def test_the_shipped_model_predicts_a_recorded_flight_within_two_points(flown):
    check = margin_check(flown)
    assert check is not None
    assert all(abs(s.measured - s.predicted) < 0.02 for s in check.steps[:2])
    assert check.coverage > 0.8
