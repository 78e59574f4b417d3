"""The walk of an aircraft's modes: each state by hand, and who may teach."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, made_flight
from thrustmargin.models.errors import DataError, ModelError
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.flight_lessons import flight_offsets
from thrustmargin.models.model.mode_walk import (
    FlightOffsets,
    ModeState,
    WalkSizes,
    fit_steps,
    mode_columns,
    shift_rpm,
    state_before,
    walk,
)
from thrustmargin.models.model.rotor_faults import fault_signals
from thrustmargin.models.model.rotor_model import physics_model

DAY = 86_400.0


def flown(name: str, day: float, *offset: float, error: float = 0.001) -> FlightOffsets:
    """A flight at noon of a day at Greenwich."""
    return FlightOffsets(
        flight=name,
        start_unix_s=(day + 0.5) * DAY,
        longitude_deg=0.0,
        offset=offset,
        error=(error,) * len(offset),
        rows=1000,
    )


def test_a_state_is_that_of_a_kalman_filter_worked_by_hand():
    steps = WalkSizes(flight=0.03, day=0.04)
    one, two = flown("a", 0, 0.06, error=0.0), flown("b", 0.1, 0.0, error=0.04)
    first, second = walk([two, one], steps, last_training=flown("t", 0.01, 0.0))
    # Before the first: 0.04² of the model's days and 0.03² of a flight, of the same day.
    assert first.flight.flight == "a"
    assert first.before.offset == (0.0,)
    assert first.before.error[0] == pytest.approx(0.05)
    assert first.surprise[0] == pytest.approx(1.2)
    # Measured without error: the state is the flight's.
    assert (first.after.offset[0], first.after.error[0]) == (pytest.approx(0.06), 0.0)
    # Then a flight's step of 0.03 against an error of 0.04: a gain of 9/25.
    assert second.before.error[0] == pytest.approx(0.03)
    assert second.after.offset[0] == pytest.approx(0.06 * (1.0 - 9.0 / 25.0))
    assert second.after.error[0] == pytest.approx(0.03 * 0.8)


def test_another_day_and_a_repair_widen_the_state():
    steps, flights = WalkSizes(flight=0.03, day=0.04), [flown("a", 0, 0.0, error=0.0)]
    same_day = state_before(flights, steps, 1, 0.6 * DAY, longitude_deg=0.0)
    next_day = state_before(flights, steps, 1, 1.6 * DAY, longitude_deg=0.0)
    repaired = state_before(flights, steps, 1, 0.6 * DAY, longitude_deg=0.0, repairs=[0.55 * DAY])
    assert same_day.error[0] == pytest.approx(0.03)
    assert next_day.error[0] == pytest.approx(0.05)
    assert repaired.error[0] == pytest.approx(math.hypot(0.03, 0.03))  # a repair: 3 %


def test_a_day_is_that_of_the_place():
    evening = FlightOffsets(
        flight="a",
        start_unix_s=1.1 * DAY,
        longitude_deg=-105.0,
        offset=(0.0,),
        error=(0.0,),
        rows=1,
    )
    assert evening.day == 0  # 2:24 in Greenwich is the evening before in Colorado


def test_no_flight_is_predicted_by_itself_or_by_a_later_one():
    flights = [flown("a", 0, 0.02), flown("b", 1, 0.08)]
    before_b = state_before(flights, WalkSizes(), 1, flights[1].start_unix_s)
    assert before_b == state_before(flights[:1], WalkSizes(), 1, flights[1].start_unix_s)
    assert before_b.offset[0] < 0.021


def test_a_jump_beyond_the_walk_is_a_change_and_a_step_within_it_is_none():
    steady = [flown(str(k), k, 0.001 * (-1) ** k, 0.0, 0.0, 0.0) for k in range(6)]
    steps = fit_steps(steady)
    jumped = walk([*steady, flown("x", 6, 0.03, 0.0, 0.0, 0.0)], steps)[-1]
    within = walk([*steady, flown("x", 6, 0.002, 0.0, 0.0, 0.0)], steps)[-1]
    assert jumped.changed == (0,)
    assert within.changed == ()


def test_steps_are_learnt_from_an_aircraft_s_own_flights():
    rng = np.random.default_rng(7)
    offset, flights = np.zeros(4), []
    for day in range(12):
        offset = offset + rng.normal(0.0, 0.01, 4)  # a day's step of 1 %
        for k in range(4):
            offset = offset + rng.normal(0.0, 0.004, 4)
            flights.append(flown(f"{day}-{k}", day + 0.05 * k, *offset))
    flight, day = fit_steps(flights).typical
    assert flight == pytest.approx(0.004, rel=0.35)
    assert day == pytest.approx(0.01, rel=0.35)


def test_each_mode_has_steps_of_its_own_size():
    rng = np.random.default_rng(8)
    moves = np.array([0.005, 0.0025, 0.0025, 0.02])
    days = np.cumsum(moves * rng.normal(size=(24, 4)), axis=0)
    steps = fit_steps([flown(str(k), k, *offset) for k, offset in enumerate(days)])
    by_step = np.hypot(steps.flight, steps.day)
    assert by_step == pytest.approx(moves, rel=0.5)


def test_without_flights_the_steps_are_those_of_a_measured_aircraft():
    assert (fit_steps([]).flight, fit_steps([]).day) == (0.015, 0.025)


def test_the_interval_of_a_walk_holds_on_the_next_flight():
    """On 200 made aircraft, each predicted before it teaches: 90 % of next flights inside."""
    rng = np.random.default_rng(11)
    inside = []
    for _ in range(200):
        values = np.cumsum(rng.normal(0.0, 0.02, 8))
        flights = [flown(str(k), k, float(v)) for k, v in enumerate(values)]
        steps = WalkSizes(flight=0.012, day=0.016)  # together 0.02
        last = walk(flights, steps)[-1]
        inside.append(abs(last.surprise[0]) < 1.645)
    assert 0.85 < np.mean(inside) < 0.95


def test_a_flight_given_twice_is_refused():
    with pytest.raises(DataError, match="a is given twice"):
        walk([flown("a", 0, 0.0), flown("a", 1, 0.0)], WalkSizes())


def test_offsets_are_those_by_which_a_flight_was_shifted():
    model = physics_model(F16)
    track = made_flight(3)
    base = analyse(track, model)
    columns = mode_columns(F16)
    assert columns.T @ columns == pytest.approx(4.0 * np.eye(4), abs=1e-9)
    true = np.array([0.02, 0.0, -0.01, 0.005])
    predicted = base.prediction.rotor_speed_rpm
    speed = predicted + np.mean(predicted, axis=1, keepdims=True) * (columns @ true)
    shifted = analyse(replace(track, rotor_speed_rpm=speed), model)
    found = flight_offsets(shifted, flight="a", start_unix_s=0.0, longitude_deg=0.0)
    assert found is not None
    assert found.offset == pytest.approx(true, abs=2e-4)
    # A model with that state predicts the flight, and the offsets are measured without the state.
    state = ModeState(offset=tuple(true.tolist()), error=(0.0,) * 4)
    followed = analyse(shifted.track, replace(model, state=state))
    assert followed.prediction.rotor_speed_rpm == pytest.approx(speed, rel=1e-6, nan_ok=True)
    again = flight_offsets(followed, flight="a", start_unix_s=0.0, longitude_deg=0.0)
    assert again is not None
    assert again.offset == pytest.approx(found.offset, abs=1e-9)


def test_a_fault_is_sought_against_the_model_as_it_was_made():
    """A weak rotor that the state has followed over many flights must stay in what is tested."""
    model, track = physics_model(F16), made_flight(3, loss=0.12, rotor=2)
    followed = replace(model, state=ModeState(offset=(0.02, -0.02, 0.02, 0.02), error=(0.01,) * 4))
    plain, with_state = (fault_signals(analyse(track, m), slice(None)) for m in (model, followed))
    assert with_state == pytest.approx(plain, nan_ok=True)


def test_the_error_of_a_state_widens_every_rotor():
    state = ModeState(offset=(0.0,) * 4, error=(0.03, 0.0, 0.04, 0.0))
    _, error = shift_rpm(state, F16, np.full((2, 4), 2000.0))
    assert error == pytest.approx(np.full((2, 4), 100.0))  # 2000 rpm times hypot(3 %, 4 %)


@pytest.mark.parametrize("wrong", [{"error": (-0.1,)}, {"error": ()}, {"offset": (math.nan,)}])
def test_a_state_that_cannot_be_is_refused(wrong):
    with pytest.raises(ModelError, match="mode state"):
        ModeState(**{"offset": (0.0,), "error": (0.1,), **wrong})


def test_a_mode_that_always_moves_more_than_the_others_has_not_changed():
    rng = np.random.default_rng(3)
    moves = np.array([0.0005, 0.0005, 0.0005, 0.009])
    days = np.cumsum(moves * rng.normal(size=(24, 4)), axis=0)
    flights = [flown(str(k), k, *offset) for k, offset in enumerate(days)]
    for count in range(6, 24):
        assert walk(flights[: count + 1], fit_steps(flights[:count]))[-1].changed == ()
    # A roll trim that moves as much as the yaw trim always does has.
    rolled = flown("x", 24, *(days[-1] + np.array([0.0, 0.009, 0.0, 0.0])))
    assert walk([*flights, rolled], fit_steps(flights))[-1].changed == (1,)
