"""What no name explains goes into the new model where flights left out show it again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flights
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.unnamed import UNNAMED
from thrustmargin.models.identification.answer.open_causes import change_by_causes, open_causes
from thrustmargin.models.identification.rows.problem import assemble

NOISE = 5.0  # rpm
PITCH = Placed(
    effect=UNNAMED["pitch", "time_s"],
    values={"at_1": 0.0, "at_2": 0.02, "at_3": 0.04, "at_4": 0.06, "low": 0.0, "high": 60.0},
)


@pytest.fixture(scope="module")
def problem():
    return assemble(curve_model(), made_flights(4, duration=60.0))


def left(problem, cause=None, of_flights=(0, 1, 2, 3), seed=1):
    """A residual (T, R) of noise, and of a cause in some of the flights."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, problem.measured_rpm.shape)
    if cause is None:
        return noise
    change = problem.speeds([cause]) - problem.speeds()
    return noise + change * np.isin(problem.flight, of_flights)[:, None]


def rms(values) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_a_cause_in_every_flight_is_found_where_it_acts_and_leaves_the_noise(problem):
    residual = left(problem, PITCH)
    assert rms(residual) > 2.0 * NOISE
    found = open_causes(problem, residual, ())
    first = found.causes[0]
    assert first.place is not None
    mode, channel = first.place
    assert mode == "pitch"
    assert "time_s" in (channel, *first.alike)
    assert not {"yaw_rate", "constant"} & {channel, *first.alike}
    assert rms(residual - found.left_out_rpm) < 1.05 * NOISE
    assert rms(residual - found.change_rpm) < 1.02 * NOISE
    wanted = problem.speeds([PITCH]) - problem.speeds()
    assert rms(change_by_causes(problem, found.causes) - wanted) < 0.2 * rms(wanted)
    wide = (first.found.upper - first.found.lower)[0] / 2.0
    assert 0.0 < wide[:4].max() < 0.01
    assert wide[4:].tolist() == [0.0, 0.0]


def test_the_interval_is_that_of_how_flights_left_out_in_turn_differ(problem):
    """Of 0.045, 0.05, 0.05 and 0.055, each left out in turn: 3.182 sqrt(3/4 sum (0.005/3)²)."""
    steady = Placed(effect=UNNAMED["pitch", "constant"], values={"at_1": 0.05})
    share = np.array([0.9, 1.0, 1.0, 1.1])[problem.flight][:, None]
    change = problem.speeds([steady]) - problem.speeds()
    (one,) = open_causes(problem, share * change, ()).causes
    assert one.place == ("pitch", "constant")
    assert one.found.value[0, 0] == pytest.approx(0.05, rel=0.03)
    half = (one.found.upper - one.found.lower)[:, 0] / 2.0
    assert half == pytest.approx(np.full(4, 0.0065), rel=0.06)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_is_no_cause(problem, seed):
    found = open_causes(problem, left(problem, seed=seed), ())
    assert found.causes == ()
    assert np.all(np.asarray(found.left_out_rpm) == 0.0)


def test_what_one_flight_shows_and_the_others_do_not_is_no_cause(problem):
    found = open_causes(problem, left(problem, PITCH, of_flights=(2,)), ())
    assert found.causes == ()


def test_the_change_of_a_flight_comes_from_the_other_flights(problem):
    """A flight that lacks what the others show is made worse by it."""
    residual = left(problem, PITCH, of_flights=(0, 1, 2))
    mine = problem.flight == 3
    left_out = residual - open_causes(problem, residual, ()).left_out_rpm
    assert rms(left_out[mine]) > 1.5 * rms(residual[mine])
    assert rms(left_out[~mine]) < rms(residual[~mine])


@pytest.mark.parametrize("seed", [5, 10])
def test_what_each_flight_has_otherwise_is_no_cause_though_one_seems_to_fit(problem, seed):
    """Each flight has moments of its own. A choice among all curves by the flights left out seems
    to help, and a choice made anew without each of them makes it worse."""
    rng, residual = np.random.default_rng(seed), left(problem, seed=seed)
    for flight in range(4):
        mine = problem.flight == flight
        for mode in ("collective", "roll", "pitch", "yaw"):
            knots = {f"at_{k + 1}": v for k, v in enumerate(rng.normal(0.0, 0.012, 4))}
            own = Placed(effect=UNNAMED[mode, "time_s"], values={**knots, "low": 0.0, "high": 60.0})
            residual[mine] += (problem.speeds([own]) - problem.speeds())[mine]
    assert open_causes(problem, residual, ()).causes == ()


def test_one_flight_and_motor_outputs_show_no_cause():
    one = assemble(curve_model(), made_flights(1, duration=60.0))
    assert open_causes(one, left(one, PITCH, of_flights=(0,)), ()).causes == ()
    several = assemble(curve_model(), made_flights(3, duration=60.0))
    outputs = replace(several, of_outputs=True)
    assert open_causes(outputs, left(several, PITCH), ()).causes == ()


def test_no_search_looks_for_what_has_no_name():
    assert not {e.name for e in CATALOGUE} & {e.name for e in UNNAMED.values()}
