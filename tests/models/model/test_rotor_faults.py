"""A propeller or a motor put into a flight that is written here, and what is said of it."""

import math
import tomllib
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.recorded import CAMPAIGN
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import RotorFault, block_scatter
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_faults import (
    RotorFaults,
    fault_episodes,
    fault_history,
    fault_signals,
    loss_steps,
    mode_directions,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import airframe_from_table, load_airframe
from thrustmargin.models.physics.motor_output import output_curve
from thrustmargin.models.statement import state

FAULT_SIZES = 0.03 * 1.06 ** np.arange(52)  # by hand

#: As the code has them, written down by hand: a change there is to be seen here.
LEAST = 0.03
MOST = 0.6
THRESHOLD = 10.154801980817034

F16 = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(F16)
ONSET = 60.0


def hover(seed: int, seconds: float = 90.0, noise: float = 0.003) -> FlightTrack:
    """A hover with an own noise of each rotor, slow and quick; outputs that go with the speeds."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 0.1)
    rows = time_s.size
    level = math.sqrt((F16.empty_mass + 4.0) * 9.80665 / 4 / F16.thrust_coefficient)
    wander = np.cumsum(rng.normal(0.0, 0.1 * noise, (rows, 4)), axis=0)
    speed = level * (1.0 + noise * rng.standard_normal((rows, 4)) + 0.2 * wander)
    return FlightTrack.of(
        name="hover",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=speed,
        throttle=outputs(speed),
        airspeed=np.zeros(rows),
        tank_kg=np.full(rows, 4.0),
        altitude=np.zeros(rows),
        voltage=np.full(rows, F16.ceiling_voltage),
        angular_rate_frd=0.01 * rng.standard_normal((rows, 3)),
        specific_force_frd=np.tile([0.0, 0.0, -9.80665], (rows, 1)),
    )


def outputs(speed: np.ndarray) -> np.ndarray:
    """Motor outputs that ask for these speeds, by the curve turned round."""
    grid = np.linspace(0.2, 0.95, 2000)
    share = output_curve({}).thrust_share(grid)
    return np.interp((speed / F16.max_rotor_speed_rpm) ** 2, share, grid)


def seen(
    track: FlightTrack, factor: Any = 1.0, weak: Any = 1.0, since: float = ONSET
) -> list[RotorFault]:
    """What stands at the end, with speeds and outputs by these factors (4,) from the onset on."""
    after = (track.time_s >= since)[:, None]
    speed = track.rotor_speed_rpm * np.where(after, factor, 1.0)
    asked = outputs(speed / np.where(after, weak, 1.0))
    track = FlightTrack.of(
        **{
            name: getattr(track, name)
            for name in ("name", "time_s", "airspeed", "tank_kg", "altitude", "voltage")
        },
        angular_rate_frd=track.angular_rate_frd,
        specific_force_frd=track.specific_force_frd,
        rotor_count=4,
        rotor_speed_rpm=speed,
        throttle=asked,
    )
    analysis, faults = analyse(track, MODEL), RotorFaults(MODEL)
    signals = fault_signals(analysis, slice(None))
    for time_s, row in zip(track.time_s, signals, strict=True):
        faults.add(float(time_s), row)
    return list(faults.current)


def lost(rotor: int, loss: float) -> np.ndarray:
    factor = np.ones(4)
    factor[rotor] = 1.0 / math.sqrt(1.0 - loss)
    return factor


def test_the_threshold_is_that_of_the_false_alarms_allowed():
    # 3600 s / 0.7 s / every 2nd block / 0.1 an hour = 25,714 starts for each false alarm.
    assert math.exp(THRESHOLD) == pytest.approx(25714.3, rel=1e-5)


@pytest.mark.parametrize("rotor", range(4))
def test_a_propeller_is_named_with_an_interval_that_holds(rotor):
    for loss in (0.06, 0.12, 0.3):
        (fault,) = seen(hover(rotor), lost(rotor, loss))
        assert (fault.kind, fault.rotor) == ("propeller", rotor)
        assert fault.lower <= loss <= fault.upper
        assert fault.upper - fault.lower < 0.4 * loss


def test_the_intervals_of_many_flights_hold():
    found = [seen(hover(seed), lost(seed % 4, 0.1)) for seed in range(20, 40)]
    assert all(len(faults) == 1 for faults in found)
    assert sum(f.lower <= 0.1 <= f.upper for (f,) in found) >= 18


@pytest.mark.parametrize("hertz", [1, 2, 5])
def test_slow_telemetry_names_the_rotor_too_and_no_sound_one(hertz):
    for seed in range(4):
        track = hover(seed).rows(slice(None, None, 10 // hertz))
        (fault,) = seen(track, lost(seed, 0.1))
        assert (fault.kind, fault.rotor) == ("propeller", seed)
        assert fault.lower <= 0.1 <= fault.upper < 0.2
        assert seen(track) == []


def test_rows_of_other_messages_between_slow_readings_hide_nothing():
    track = hover(1)
    speeds = np.where((np.arange(900) % 10 == 0)[:, None], track.rotor_speed_rpm, np.nan)
    (fault,) = seen(replace(track, rotor_speed_rpm=speeds), lost(1, 0.1))
    assert (fault.kind, fault.rotor) == ("propeller", 1)


def test_readings_two_seconds_apart_are_too_few_for_a_mean():
    assert seen(hover(0).rows(slice(None, None, 20)), lost(0, 0.3)) == []


def test_a_loss_beyond_the_bound_is_said_to_be_at_the_bound():
    for fault in seen(hover(3), lost(2, 0.8)):
        assert fault.rotor == 2
        assert fault.size <= MOST


@pytest.mark.parametrize(
    "pattern",
    [
        [1.1] * 4,  # mass, air
        [1.15, 1.15, 0.85, 0.85],  # yaw
        [1.15, 1.15, 1.0, 1.0],  # a diagonal alone
        [1.1, 1.0, 1.1, 1.0],  # two neighbours alone
        [1.0, 1.0, 0.9, 0.9],  # the other diagonal unloaded
        [0.85, 1.0, 1.0, 1.0],  # one rotor with too much thrust
    ],
)
def test_a_pair_or_all_together_are_no_propeller(pattern):
    assert [f for f in seen(hover(5), np.sqrt(pattern)) if f.kind == "propeller"] == []


@pytest.mark.parametrize("short", [0.05, 0.1, 0.3])
def test_a_weak_motor_is_a_fault_of_its_own(short):
    weak = np.ones(4)
    weak[1] -= short
    (fault,) = seen(hover(6), weak=weak)
    assert (fault.kind, fault.rotor) == ("motor", 1)
    assert fault.lower <= short <= fault.upper


def test_a_motor_that_is_faster_than_its_output_asks_or_all_slower_are_none():
    assert seen(hover(7), weak=np.array([1.1, 1.0, 1.0, 1.0])) == []
    assert seen(hover(7), weak=np.full(4, 0.8)) == []


def test_a_fault_that_goes_away_is_cleared_and_one_that_stays_is_not():
    track = hover(8, seconds=150.0)
    bad = np.where((track.time_s > 60.0) & (track.time_s < 100.0), 1.0 / math.sqrt(0.85), 1.0)
    factor = np.ones((track.time_s.size, 4))
    factor[:, 3] = bad
    assert seen(track, factor, since=0.0) == []
    (fault,) = seen(track, lost(3, 0.15))
    assert fault.rotor == 3


def test_while_a_fault_grows_only_its_least_size_is_known():
    (fault,) = seen(hover(9, seconds=ONSET + 4.0), lost(0, 0.2))
    assert fault.upper == MOST
    assert fault.lower < 0.2


def test_a_lost_share_moves_its_own_rotor_on_a_quad():
    steps, torque = loss_steps(MODEL)
    at = int(np.argmin(abs(FAULT_SIZES - 0.12)))
    loss = FAULT_SIZES[at]
    # Rotor 3 turns faster by loss/(1 - loss) of its thrust, less what its own torque spares.
    modes = mode_directions(MODEL)
    three = (steps[2, at] @ modes)[:3]
    assert abs(three) == pytest.approx(0.5 * loss / (1.0 - loss), rel=0.02)
    assert np.argmax(steps[2, at]) == 2
    # What its torque does is nearly all yaw.
    assert np.max(abs(torque[2, at] @ modes)[:3]) < 0.04 * abs(three).max()


@pytest.mark.parametrize("craft", [c for c in CRAFTS if c.rotors > 4], ids=lambda c: c.name)
def test_with_more_rotors_all_make_up_for_one_through_the_mixer(craft):
    """Commands x = M'y of thrust, roll, pitch and yaw, with which the weak rotor and all others
    make what sound ones did."""
    airframe = airframe_from_table(tomllib.loads(craft.airframe_toml()), craft.name)
    steps, _ = loss_steps(physics_model(airframe))
    at, count = 20, craft.rotors
    mixer = np.stack([np.ones(count), *airframe.rotor_position_frd[:, :2].T, airframe.rotor_spin])
    for rotor in range(count):
        sound = airframe.rotor_effectiveness
        left = np.where(np.arange(count) == rotor, 1.0 - FAULT_SIZES[at], 1.0) * sound  # torque too
        asked = np.linalg.solve(mixer * left @ mixer.T, mixer @ (sound - left))
        np.testing.assert_allclose(steps[rotor, at], mixer.T @ asked, atol=2e-3)


def test_the_ground_long_enough_forgets_a_fault_and_a_bounce_does_not():
    analysis = analyse(hover(10), MODEL)
    rows = fault_signals(analysis, slice(None)).copy()
    rows[600:, 1] += 0.2 / 0.8
    for pause, left in ((1.0, 1), (60.0, 0)):
        faults = RotorFaults(MODEL)
        for row in rows:
            faults.add(float(row[0]), row)
        assert len(faults.current) == 1
        faults.landed(90.0)
        faults.add(90.0 + pause, rows[0])
        assert len(faults.current) == left


def test_the_history_of_a_flight_has_every_change_once():
    track, since = hover(11), ONSET
    bad = np.where((track.time_s >= since)[:, None], lost(2, 0.15), 1.0)
    flown = replace(track, rotor_speed_rpm=track.rotor_speed_rpm * bad)
    history = fault_history(analyse(replace(flown, throttle=np.full_like(bad, np.nan)), MODEL))
    times, standing = zip(*history, strict=True)
    assert ONSET < times[0] < ONSET + 10.0
    assert all(a < b for a, b in pairwise(times))
    assert all(a != b for a, b in pairwise(standing))
    assert {(f.kind, f.rotor) for faults in standing for f in faults} == {("propeller", 2)}
    no_verdict = AirframeMatch(no_verdict=(state("no voltage"),))
    assert fault_history(analyse(flown, MODEL, airframe_match=no_verdict)) == []


def test_an_episode_begins_when_it_is_found_ends_when_it_is_cleared_and_keeps_its_last_size():
    def fault(rotor: int, size: float, kind: Any = "propeller") -> RotorFault:
        return RotorFault(kind=kind, rotor=rotor, size=size, lower=0.9 * size, upper=1.1 * size)

    first, grown, motor = fault(2, 0.1), fault(2, 0.2), fault(2, 0.3, "motor")
    again = fault(2, 0.15)
    history = [(5.0, (first,)), (8.0, (grown, motor)), (20.0, (motor,)), (30.0, (again, motor))]
    found = [(e.begin_s, e.end_s, e.fault) for e in fault_episodes(history)]
    assert found == [(5.0, 20.0, grown), (8.0, None, motor), (30.0, None, again)]
    assert fault_episodes([]) == ()


def test_a_chipped_propeller_is_found_when_and_as_large_as_it_was():
    """12 % less thrust of rotor 3, from 145 s on."""
    model = shipped_model()
    log = read_log(CAMPAIGN.parent / "onset" / "worn_prop_onset.tlog", airframe=model.airframe)
    history = fault_history(analyse(log.track, model))
    assert len(history) == 16
    for (time_s, (fault,)), expected in (
        # At first what it has at least; the size is settled as rows come.
        (history[0], (145.502, 0.078, 0.0616, MOST)),
        (history[4], (148.3, 0.117, 0.1085, MOST)),
        (history[-1], (156.0, 0.119, 0.1090, 0.1283)),
    ):
        found = (time_s, fault.size, fault.lower, fault.upper)
        assert (fault.kind, fault.rotor) == ("propeller", 2)
        assert found == pytest.approx(expected, abs=0.001)


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_speeds_that_scatter_by_a_sixth_name_no_rotor(rate):
    """ESC telemetry that comes now and then, each report off by 16 % of thrust by itself."""
    for seed in range(4):
        track = hover(seed, seconds=60.0)
        report = np.floor(track.time_s * rate).astype(int)
        scatter = np.random.default_rng(seed).standard_normal((report[-1] + 1, 4))
        share = np.maximum(1.0 + 0.16 * scatter[report], 0.05)
        speed = track.rotor_speed_rpm * np.sqrt(share)
        flown = replace(track, rotor_speed_rpm=speed, throttle=np.full_like(speed, np.nan))
        assert fault_history(analyse(flown, MODEL)) == []


def test_one_outlier_before_the_scatter_is_known_names_no_rotor():
    track = hover(12)
    speed = track.rotor_speed_rpm.copy()
    speed[20:23, 1] *= 1.2  # one report at 3 Hz
    flown = replace(track, rotor_speed_rpm=speed, throttle=np.full_like(speed, np.nan))
    assert fault_history(analyse(flown, MODEL)) == []


def test_the_scatter_of_blocks_is_theirs_whatever_a_turn_or_an_outlier_does():
    noise = 0.16 * np.random.default_rng(5).standard_normal((400, 1))
    # Differences of independent blocks scatter by the root of 2; of three quarters: 0.16 x 1.22.
    assert block_scatter(noise)[0] == pytest.approx(0.196, rel=0.1)
    noise[50] += 100.0
    noise[200:] += 3.0
    assert block_scatter(noise)[0] == pytest.approx(0.196, rel=0.1)


def test_an_episode_of_several_rotors_is_one_with_that_of_the_rotor_it_was():
    def fault(rotor: int, *rotors: int) -> RotorFault:
        return RotorFault(
            kind="propeller", rotor=rotor, size=0.3, lower=0.2, upper=0.4, rotors=rotors
        )

    history = [(5.0, (fault(5, 3, 5),)), (5.7, (fault(3),)), (9.0, (fault(1, 1, 2),)), (9.7, ())]
    found = [(e.begin_s, e.end_s, e.fault.rotors) for e in fault_episodes(history)]
    assert found == [(5.7, 9.0, ()), (9.0, 9.7, (1, 2))]
