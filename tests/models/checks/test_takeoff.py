"""The check before take-off on run-ups made by hand: each fault in time, a sound one never."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.models.checks.takeoff import (
    MotorState,
    TakeoffCheck,
    TakeoffKind,
    TakeoffWatch,
    bad_leads,
    hot_escs,
    takeoff_checks,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe

CRAFT = load_airframe("topxgun-f16-sitl")
G = 9.80665
#: s of the made flight: motors on, outputs rise, lift-off, end.
ON, RISE, LIFT, END = 5.0, 8.0, 11.0, 20.0
HOVER_RPM = 1947.0  # of each rotor at 31.1 kg


def flight(
    hz: float = 10.0, *, late: dict[int, float] | None = None, **changed: Any
) -> FlightTrack:
    """A run-up of the F16 from rest at 5 s to lift-off at 11 s and 9 s of hover, at `hz` rows.

    `late`: s by which motors (from 0) start later, inf never. `speed` (4,) multiplies the speeds,
    `output` (4,) the outputs; `silent`: motors without a speed.
    """
    time_s = np.arange(0.0, END, 1.0 / hz)
    rng = np.random.default_rng(5)
    on_s = np.full(4, ON)
    for motor, seconds in (late or {}).items():
        on_s[motor] += seconds
    output = np.interp(time_s, [RISE, LIFT], [0.1, 0.65]) * (time_s >= ON)
    wobble = 0.02 * rng.standard_normal((time_s.size, 4)) * (time_s >= RISE)[:, None]
    throttle = np.clip(output[:, None] + wobble, 0.0, 1.0) * np.array(changed.pop("output", 1.0))
    rpm = np.interp(throttle, [0.0, 0.1, 0.65], [0.0, 450.0, HOVER_RPM])
    rpm = rpm * np.array(changed.pop("speed", 1.0)) * (1 + 0.01 * rng.standard_normal(rpm.shape))
    rpm[time_s[:, None] < on_s] = 0.0
    rpm[:, changed.pop("silent", [])] = np.nan
    given = {
        "throttle": throttle,
        "rotor_speed_rpm": rpm,
        "angular_rate_frd": np.zeros((time_s.size, 3)),
        "specific_force_frd": np.tile([0.0, 0.0, -G], (time_s.size, 1)),
        "tank_kg": np.full(time_s.size, 10.0),
        "voltage": 58.8 - 3.0 * output,
        "current": 100.0 * output,
        "altitude": np.zeros(time_s.size),
        "flying": time_s >= LIFT,
    } | changed
    return FlightTrack.of(name="made", time_s=time_s, rotor_count=4, **given)


def only(track: FlightTrack, craft: Any = CRAFT) -> TakeoffCheck:
    (check,) = takeoff_checks(track, craft)
    return check


def kinds(check: TakeoffCheck) -> list[tuple[TakeoffKind, tuple[int, ...]]]:
    return [(one.kind, one.motors) for one in check.findings]


@pytest.mark.parametrize("hz", [1.0, 2.0, 10.0])
def test_a_sound_start_has_no_finding(hz: float):
    check = only(flight(hz))
    assert kinds(check) == []
    assert [motor.state for motor in check.motors] == [MotorState.TURNS] * 4
    assert check.begin_s == pytest.approx(ON, abs=1.0)
    assert check.lift_s == pytest.approx(LIFT, abs=1.0)
    assert check.mass_kg == pytest.approx(31.1, rel=0.05)
    assert check.stated_kg == pytest.approx(31.1, abs=0.01)
    assert check.rest_voltage == pytest.approx(58.8)
    assert check.idle_voltage == pytest.approx(58.5, abs=0.3)
    assert check.sag_resistance == pytest.approx(0.03, abs=0.001)
    assert check.yaw_reserve > 0.9
    assert all(motor.idle_rpm == pytest.approx(450.0, rel=0.05) for motor in check.motors)


@pytest.mark.parametrize("hz", [2.0, 5.0, 10.0])
def test_a_late_motor_is_said_while_it_stands_and_before_the_outputs_rise(hz: float):
    check = only(flight(hz, late={2: 1.2}))
    assert kinds(check) == [(TakeoffKind.LATE, (2,))]
    (found,) = check.findings
    assert found.forbids
    assert found.time_s < ON + 1.2 + 1e-6
    assert found.value == pytest.approx(1.2, abs=0.51)
    assert check.motors[2].state is MotorState.LATE


def test_motors_that_start_three_tenths_apart_are_sound():
    assert kinds(only(flight(late={1: 0.1, 2: 0.3}))) == []


@pytest.mark.parametrize("hz", [2.0, 10.0])
def test_a_motor_that_never_turns_stands(hz: float):
    check = only(flight(hz, late={3: np.inf}))
    assert (TakeoffKind.STANDS, (3,)) in kinds(check)
    assert check.findings[0].time_s <= ON + 1.0
    assert check.motors[3].state is MotorState.STANDS


def test_a_motor_that_the_autopilot_does_not_drive_is_no_standing_one():
    track = flight(late={3: 2.0})
    throttle = track.throttle.copy()
    throttle[track.time_s < ON + 2.0, 3] = 0.0
    assert kinds(only(replace(track, throttle=throttle))) == []


@pytest.mark.parametrize("hz", [2.0, 10.0])
def test_a_motor_without_propeller_turns_too_fast_for_its_output(hz: float):
    check = only(flight(hz, speed=[1.0, 1.5, 1.0, 1.0]))
    assert (TakeoffKind.FAST, (1,)) in kinds(check)
    assert {motors for kind, motors in kinds(check) if kind in ("fast", "slow")} == {(1,)}
    found = next(one for one in check.findings if one.kind is TakeoffKind.FAST)
    assert found.time_s < LIFT - 0.5
    assert found.value > found.high > found.reference


def test_a_motor_that_does_not_follow_its_output_is_slow_before_lift_off():
    check = only(flight(2.0, speed=[1.0, 1.0, 1.0, 0.45]))
    assert (TakeoffKind.SLOW, (3,)) in kinds(check)
    assert check.findings[0].time_s < LIFT - 0.5


def test_outputs_that_differ_explain_speeds_that_differ():
    assert kinds(only(flight(output=[0.6, 1.2, 0.8, 1.0]), None)) == []


def test_two_exchanged_motors_are_named_together():
    track = flight(output=[1.0, 1.3, 0.55, 1.0])
    exchanged = track.rotor_speed_rpm[:, [0, 2, 1, 3]]
    check = only(replace(track, rotor_speed_rpm=exchanged), None)
    assert kinds(check) == [(TakeoffKind.EXCHANGED, (1, 2))]


def test_a_motor_without_a_speed_is_not_known_and_never_fine():
    check = only(flight(silent=[2]))
    assert kinds(check) == [(TakeoffKind.SILENT, (2,))]
    assert not check.findings[0].forbids
    assert check.motors[2].state is MotorState.NOT_KNOWN
    assert check.reporting == 3


def test_without_any_speed_every_motor_is_not_known():
    check = only(flight(silent=[0, 1, 2, 3]))
    assert {motor.state for motor in check.motors} == {MotorState.NOT_KNOWN}
    assert kinds(check) == []


def test_speeds_made_from_outputs_are_no_measured_start():
    track = flight()
    made = {"rotor_speed_rpm": np.full(track.rotor_speed_rpm.shape, 20.0)}
    check = only(replace(track, standard_errors=made))
    assert {motor.state for motor in check.motors} == {MotorState.NOT_KNOWN}


def runaway(way: float) -> FlightTrack:
    """Motor 1 or 2 (counter-clockwise) turns the wrong way: yaw runs away, and the autopilot
    drives that pair harder in vain."""
    track = flight()
    since = np.clip(track.time_s - LIFT, 0.0, None)
    rate = np.zeros((track.time_s.size, 3))
    rate[:, 2] = -way * 1.5 * np.minimum(since, 1.5)
    pull = 1.0 + way * 0.15 * np.clip(since, 0.0, 1.0)[:, None] * CRAFT.rotor_spin
    return replace(track, angular_rate_frd=rate, rotor_speed_rpm=track.rotor_speed_rpm * pull)


@pytest.mark.parametrize(("way", "motors"), [(1.0, (0, 1)), (-1.0, (2, 3))])
def test_yaw_that_runs_away_against_the_rotors_names_the_side(way: float, motors: tuple):
    check = only(runaway(way))
    assert (TakeoffKind.REVERSED, motors) in kinds(check)
    assert check.findings[0].time_s < LIFT + 2.0


def test_yaw_that_follows_the_rotors_is_sound():
    track = runaway(1.0)
    assert kinds(only(replace(track, angular_rate_frd=-track.angular_rate_frd))) == []


def test_weight_beyond_the_stated_fill_is_reported_and_forbids_nothing():
    check = only(flight(tank_kg=np.full(int(END * 10), 2.0)))
    assert kinds(check) == [(TakeoffKind.WEIGHT, ())]
    found = check.findings[0]
    assert (found.value, found.reference) == (
        pytest.approx(31.1, rel=0.05),
        pytest.approx(23.1, abs=0.01),
    )
    assert not found.forbids


def test_little_yaw_authority_is_reported():
    # One pair does nearly all of the work against a standing yaw moment.
    speed = np.where(CRAFT.rotor_spin > 0, 1.35, 0.42)
    check = only(flight(speed=speed, output=speed))
    assert (TakeoffKind.YAW, ()) in kinds(check)
    assert check.yaw_reserve < 0.2


def test_an_unknown_airframe_is_checked_by_its_rotors_alone():
    check = only(flight(late={2: 1.0}), None)
    assert kinds(check) == [(TakeoffKind.LATE, (2,))]
    assert np.isnan([check.mass_kg, check.yaw_reserve]).all()


def test_each_run_up_has_its_check_and_a_stop_is_no_late_motor():
    first, second = flight(late={0: 1.0}), flight()
    ground = first.rows(first.time_s < 8.0)
    off = np.where(ground.time_s[:, None] >= 7.0, 0.0, ground.throttle)
    stopping = np.where(
        ground.time_s[:, None] >= 7.0 + 0.3 * np.arange(4), 0.0, ground.rotor_speed_rpm
    )
    ground = replace(ground, throttle=off, rotor_speed_rpm=stopping)
    whole = ground.followed_by(replace(second, time_s=second.time_s + 10.0))
    checks = takeoff_checks(whole, CRAFT)
    assert [kinds(one) for one in checks] == [[(TakeoffKind.LATE, (0,))], []]
    assert np.isnan(checks[0].lift_s)
    assert checks[1].lift_s == pytest.approx(LIFT + 10.0)


def test_a_log_that_begins_in_flight_has_no_run_up():
    track = flight()
    assert takeoff_checks(track.rows(track.time_s > LIFT), CRAFT) == []


@pytest.mark.parametrize("rows", [1, 7, 40])
@pytest.mark.parametrize("late", [{}, {2: 1.2}, {1: np.inf}])
def test_a_listener_finds_what_the_log_shows_however_its_rows_come(rows: int, late: dict):
    track, watch = flight(5.0, late=late), TakeoffWatch()
    said: list[TakeoffCheck] = []
    for first in range(0, track.time_s.size, rows):
        part = track.rows(slice(first, first + rows))
        if (now := watch.add(part, CRAFT)) is not None:
            said.append(now)
            # Nothing is known before its time.
            assert all(one.time_s <= part.time_s[-1] for one in now.findings)
    whole = only(track)
    assert said[-1].findings == whole.findings
    assert said[-1].ended


def test_a_listener_does_not_take_a_landing_with_motors_on_for_a_start():
    track = flight()
    flying = track.flying & (track.time_s < 16.0)
    rpm = track.rotor_speed_rpm.copy()
    rpm[track.time_s >= 15.9, 1] = 0.0
    track, watch = replace(track, flying=flying, rotor_speed_rpm=rpm), TakeoffWatch()
    checks = [watch.add(track.rows(slice(k, k + 5)), CRAFT) for k in range(0, track.time_s.size, 5)]
    assert checks[-1] is not None
    assert kinds(checks[-1]) == []
    assert len(takeoff_checks(track, CRAFT)) == 1


def test_a_hot_esc_is_named_with_the_others_beside_it():
    time_s = np.arange(0.0, 3.0, 0.5)
    temperature = np.full((6, 4), 313.0)
    temperature[3:, 1] = 366.0
    (found,) = hot_escs(time_s, temperature)
    assert (found.motors, found.value, found.reference) == ((1,), 366.0, 313.0)
    assert found.time_s == 1.5
    assert hot_escs(time_s, np.minimum(temperature, 353.0)) == []
    assert hot_escs(time_s, temperature * np.nan) == []


def test_a_hot_esc_and_a_bad_lead_are_found_in_the_channels_of_a_flight():
    rows = int(END * 10)
    loaded = np.arange(rows) / 10.0 >= RISE
    current = np.tile(np.where(loaded, 25.0, 0.5)[:, None], (1, 4))
    volts = 58.0 - 0.004 * current
    volts[:, 3] -= 0.03 * current[:, 3]
    temperature = np.full((rows, 4), 313.0)
    temperature[60:, 1] = 366.0
    channels = {"esc_voltage": volts, "esc_current": current, "esc_temperature": temperature}
    check = only(flight(voltage=np.full(rows, 58.0), **channels))
    assert kinds(check) == [(TakeoffKind.HOT, (1,)), (TakeoffKind.LEAD, (3,))]
    assert all(found.forbids and found.time_s <= LIFT for found in check.findings)


def test_resistance_of_a_lead_shows_beside_the_others_and_an_offset_does_not():
    time_s = np.arange(0.0, 8.0, 0.5)
    amperes = np.tile(np.where(time_s < 2.0, 0.5, 30.0)[:, None], (1, 4))
    battery = np.where(time_s < 2.0, 58.8, 57.0)
    volts = battery[:, None] - 0.004 * amperes
    volts[:, 0] -= 0.5  # an instrument that reads low, loaded or not
    assert bad_leads(time_s, battery, volts, amperes) == []
    volts[:, 2] -= 0.025 * amperes[:, 2]
    (found,) = bad_leads(time_s, battery, volts, amperes)
    assert found.motors == (2,)
    assert found.value == pytest.approx(0.029, abs=0.002)
    assert found.reference == pytest.approx(0.004, abs=0.001)
    assert found.time_s <= 2.0 + 3.0


@pytest.mark.parametrize("hz", [2.0, 10.0])
def test_escs_that_report_one_after_the_other_have_no_bad_lead(hz: float):
    """While the current rises, a voltage that is 0.3 s older is some tenths of a volt higher."""
    time_s = np.arange(0.0, 12.0, 1.0 / hz)

    def amperes_at(when: np.ndarray) -> np.ndarray:
        wobble = 4.0 * np.sin(2.0 * np.pi * 1.3 * when) * (when > 4.0)
        return np.interp(when, [4.0, 5.5], [0.5, 25.0]) + wobble

    def volts_at(when: np.ndarray) -> np.ndarray:
        return 58.8 - 0.025 * 4.0 * amperes_at(when)

    late_s = np.array([0.0, 0.3, 0.1, 0.2])
    amperes = np.stack([amperes_at(time_s - late) for late in late_s], axis=1)
    volts = np.stack([volts_at(time_s - late) for late in late_s], axis=1) - 0.004 * amperes
    assert bad_leads(time_s, volts_at(time_s - 0.25), volts, amperes) == []
    volts[:, 2] -= 0.03 * amperes[:, 2]
    (found,) = bad_leads(time_s, volts_at(time_s - 0.25), volts, amperes)
    assert (found.kind, found.motors) == (TakeoffKind.LEAD, (2,))
    assert found.time_s < 5.5 + 4.0


@pytest.mark.parametrize("hz", [2.0, 2.5, 10.0])
@pytest.mark.parametrize("seed", range(6))
def test_outputs_that_wobble_on_the_ground_name_no_motor(hz: float, seed: int):
    """As large quads do before they lift: outputs swing within a second, speeds follow late."""
    fine = np.arange(0.0, 40.0, 0.01)
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    swing = np.clip(0.4 + 0.2 * np.sin(2.0 * np.pi * 0.9 * fine[:, None] + phase), 0.15, 1.0)
    asked = np.where(fine[:, None] < ON, 0.0, np.where(fine[:, None] < RISE, 0.1, swing))
    follows = np.zeros_like(asked)
    for row in range(1, fine.size):  # first order, 0.35 s
        follows[row] = follows[row - 1] + (asked[row] - follows[row - 1]) * 0.01 / 0.35
    rows = slice(None, None, round(100.0 / hz))
    track = FlightTrack.of(
        name="made",
        time_s=fine[rows],
        rotor_count=4,
        throttle=asked[rows],
        rotor_speed_rpm=3500.0 * follows[rows] * np.array([0.9, 1.0, 1.15, 1.0]),
        flying=np.zeros(fine[rows].size, dtype=bool),
    )
    assert [check.forbidding for check in takeoff_checks(track)] == [()]
