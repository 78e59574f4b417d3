"""A residual that lasts for seconds is distinguished from noise and gusts, in its own mode."""

import numpy as np
import pytest

from tests.models.made_flights import F16, NOISE_RPM, made_flight
from thrustmargin.models.identification.autocorrelation import autocorrelated_residual
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.model.rotor_model import physics_model

SPEED = 1900.0  # rpm, about that of these flights


@pytest.fixture(scope="module")
def problem():
    return assemble(physics_model(F16), [made_flight(k) for k in (1, 2, 3)])


def noise(problem, seed: int = 0):
    shape = problem.measured_rpm.shape
    return NOISE_RPM * np.random.default_rng(seed).standard_normal(shape)


def test_noise_and_gusts_of_under_a_second_are_nothing(problem):
    rows, rotors = problem.measured_rpm.shape
    gust = np.zeros((rows, rotors))
    white = np.random.default_rng(1).standard_normal((rows, rotors))
    for k in range(1, rows):
        gust[k] = np.exp(-0.1 / 0.7) * gust[k - 1] + 4.0 * white[k]
    assert autocorrelated_residual(problem, noise(problem)) is None
    assert (
        autocorrelated_residual(problem, noise(problem) + gust @ problem.modes.directions.T) is None
    )


@pytest.mark.parametrize("mode", ["collective", "roll", "pitch", "yaw"])
def test_a_slow_swing_is_found_in_its_mode_with_its_size(problem, mode):
    direction = problem.modes.directions[:, problem.modes.names.index(mode)]
    swing = 30.0 * np.sin(2 * np.pi * problem.channels.time_s / 9.0)
    found = autocorrelated_residual(problem, noise(problem) + swing[:, None] * direction)
    assert found is not None
    assert found.mode == mode
    assert found.rms_rpm == pytest.approx(30.0 / np.sqrt(2.0), rel=0.15)
    assert 0.0 < found.share < 1.0


def test_one_rotor_is_named_when_it_alone_wanders(problem):
    residual = noise(problem)
    residual[:, 2] += 20.0 * np.sign(np.sin(2 * np.pi * problem.channels.time_s / 14.0))
    found = autocorrelated_residual(problem, residual)
    assert found is not None
    assert found.mode == "rotor 3"


def test_what_is_too_small_for_a_name_is_left_alone(problem):
    swing = 0.002 * SPEED * np.sin(2 * np.pi * problem.channels.time_s / 9.0)
    assert autocorrelated_residual(problem, noise(problem) + swing[:, None] / 2.0) is None
