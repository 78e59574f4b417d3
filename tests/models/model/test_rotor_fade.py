"""A propeller that fades over minutes, put into blocks by hand and into a recorded flight."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.recorded import CAMPAIGN
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_fade import RotorFade
from thrustmargin.models.model.rotor_faults import (
    fault_episodes,
    fault_history,
    loss_steps,
    mode_directions,
    rotor_fade,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.motor_output import output_curve

FAULT_SIZES = 0.03 * 1.06 ** np.arange(52)  # by hand

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))
MODES = mode_directions(MODEL)
BLOCK = 0.7  # s
#: By hand: how a quad's modes (collective, roll, pitch, yaw) share what rotor 3 lacks.
ROTOR_3 = loss_steps(MODEL)[0][2] @ MODES


def moved(
    *modes: np.ndarray | float, seconds: float = 300.0, seed: int = 0, coarse: float = 0.0
) -> RotorFault | None:
    """What stands after a flight whose four modes drift evenly by so much from 20 s to 200 s."""
    test, rng = rotor_fade(MODEL, MODES), np.random.default_rng(seed)
    for time_s in np.arange(0.0, seconds, BLOCK):
        share = min(max((time_s - 20.0) / 180.0, 0.0), 1.0)
        test.add(float(time_s), share * np.array(modes) + 0.01 * rng.standard_normal(4), coarse)
    return test.current


def of_loss(loss: float) -> np.ndarray:
    """(4,) how modes move by a loss of rotor 3."""
    return np.array([np.interp(loss, FAULT_SIZES, ROTOR_3[:, m]) for m in range(4)])


@pytest.mark.parametrize("loss", [0.05, 0.08, 0.12])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_rotor_that_fades_in_three_minutes_is_named_with_an_interval_that_holds(loss, seed):
    fault = moved(*of_loss(loss), seed=seed)
    assert fault is not None
    assert (fault.kind, fault.rotor, fault.evidence, fault.rotors) == ("propeller", 2, "fade", ())
    assert fault.lower <= loss <= fault.upper
    assert fault.size == pytest.approx(loss, rel=0.25)


@pytest.mark.parametrize(("loss", "coarse", "named"), [(0.17, 0.07, False), (0.17, 0.004, True)])
def test_speeds_in_steps_name_no_rotor_by_less_than_a_step(loss, coarse, named):
    """Of steps of 250 rpm at 2,000 one reading is 7 % of thrust off, for as long as it stays."""
    assert (moved(*of_loss(loss), coarse=coarse) is not None) is named


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_aircraft_names_none(seed):
    assert moved(0.0, 0.0, 0.0, 0.0, seed=seed) is None


@pytest.mark.parametrize(
    "modes",
    [
        (0.06, 0.0, 0.0, 0.0),  # a gauge that reads low, air that warms up
        (0.0, 0.03, 0.03, 0.0),  # a centre of gravity that moves to one corner as the tank empties
        (-0.05, -0.04, 0.04, 0.0),  # the same with a load that is not known
        (0.0, 0.0, 0.0, 0.08),  # a yaw trim, by wind
        (-0.04, 0.0, 0.0, 0.05),
    ],
)
def test_what_else_drifts_is_no_rotor(modes):
    assert moved(*modes) is None


def test_a_rotor_is_named_though_the_loads_error_moves_the_collective():
    error = np.array([-0.05, 0.0, 0.0, 0.0])
    fault = moved(*(of_loss(0.12) + error))
    assert fault is not None
    assert fault.rotor == 2


def test_two_comparisons_on_end_must_name_it_and_a_sound_one_clears_it():
    """Four windows of 15 s are the reference; the two after it are compared when they are whole."""
    test = rotor_fade(MODEL, MODES)
    modes, named = of_loss(0.2), []
    for window in range(14):
        for block in range(4):
            at = 15.0 * window + 3.0 * block
            test.add(at, modes if 4 <= window < 10 else 0.0 * modes)
        named.append(test.current is not None)
    # Windows 5 and 6 are whole when the next one begins.
    assert named == [False] * 8 + [True] * (named.count(True)) + [False] * (6 - named.count(True))
    assert 3 <= named.count(True) <= 4


def test_a_window_of_few_blocks_is_none():
    test = rotor_fade(MODEL, MODES)
    for window in range(30):
        for block in range(2):
            test.add(15.0 * window + 5.0 * block, of_loss(0.3) * (window > 5))
    assert test.current is None


def test_a_new_flight_has_a_reference_of_its_own():
    test = rotor_fade(MODEL, MODES)
    for flight, modes in enumerate((np.zeros(4), of_loss(0.2))):
        for time_s in np.arange(0.0, 200.0, BLOCK):
            test.add(1000.0 * flight + float(time_s), modes)
        assert test.current is None
        test.restart()


def test_sizes_are_bounded():
    """45 % and more is beyond what is searched for between 3 and 60 %."""
    none = np.zeros((4, FAULT_SIZES.size, 4))
    test = RotorFade(none, none, np.full(4, 0.01))
    test._middles = [7.5 + 15.0 * k for k in range(8)]
    sizes = np.zeros(FAULT_SIZES.size)
    sizes[-1] = 1.0
    fault = test._fault(0, sizes)
    assert fault.upper < 0.6


def faded(track: FlightTrack, rotor: int, loss: float) -> FlightTrack:
    """A flight of which a rotor loses so much of its thrust evenly from 20 s in the air to its end,
    turns as much faster, and is asked for as much more."""
    first, last = track.time_s[track.flying][[0, -1]]
    share = np.clip((track.time_s - first - 20.0) / (last - first - 20.0), 0.0, 1.0)
    speed = track.rotor_speed_rpm.copy()
    speed[:, rotor] /= np.sqrt(1.0 - loss * share)
    outputs, grid = track.throttle.copy(), np.linspace(0.0, 1.0, 2001)
    thrust = output_curve({}, track.source("throttle")).thrust_share(grid)
    asked = np.interp(outputs[:, rotor], grid, thrust) / (1.0 - loss * share)
    outputs[:, rotor] = np.interp(asked, thrust, grid)
    return replace(track, rotor_speed_rpm=speed, throttle=outputs)


@pytest.mark.parametrize("name", ["v2_m10_q2.5", "v6_m4_q1.5"])
def test_a_fade_of_a_recorded_flight_is_found_and_none_in_it_as_it_was(name):
    model = shipped_model()
    track = read_log(CAMPAIGN / f"{name}.tlog", airframe=model.airframe).track
    assert fault_history(analyse(track, model)) == []
    (episode,) = fault_episodes(fault_history(analyse(faded(track, 1, 0.07), model)))
    assert episode.fault.rotor == 1
    assert episode.fault.evidence == "fade"
    assert episode.fault.lower <= 0.07 <= episode.fault.upper
    assert math.isfinite(episode.begin_s)


def test_the_interval_is_as_wide_as_means_of_four_and_two_windows_scatter():
    """Windows of 0.02: d scatters by 0.02 sqrt(1/4 + 1/2), and four modes halve that: 0.0087.

    The lower end lies 1.96 of these below, 0.017, and up to twice that: the jump counts among the
    second differences as three standard deviations, and each mode may drift by itself.
    """
    signs: Floats = np.array(
        [[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]], dtype=float
    )
    steps: Floats = np.asarray(signs[:, None, :] * FAULT_SIZES[None, :, None], np.float64)
    below = []
    for seed in range(20):
        rng, test = np.random.default_rng(seed), RotorFade(steps, np.zeros_like(steps), np.zeros(4))
        for window in range(14):
            modes = 0.2 * signs[1] * (window >= 6) + 0.02 * rng.standard_normal(4)
            for block in range(4):
                test.add(15.0 * window + 3.0 * block, modes)
        assert test.current is not None
        assert test.current.rotor == 1
        below.append(test.current.size - test.current.lower)
    assert 0.026 < np.mean(below) < 0.040
