"""Signals, priors and names of the tests for a bad rotor, each number worked out by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.models.model.test_model_by_hand import recorded
from thrustmargin.models.checks.sudden_change import Prior
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import FaultTest, RotorFault
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_faults import (
    RotorFaults,
    RowLimit,
    fault_model,
    fault_signals,
    loss_steps,
    mode_directions,
    motor_test,
    propeller_test,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.network.records import GoodFlights
from thrustmargin.models.physics.airframe import load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
LIKE_A_TURN = 4.451019506160833
FAULT_SIZES = 0.03 * 1.06 ** np.arange(52)

G0 = 9.80665
F16 = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(F16)
MODES = mode_directions(MODEL)
SIZES = FAULT_SIZES.size


def test_the_signals_of_a_row():
    # 29.1 kg on four rotors: rotor 2 turns 5 % faster than predicted, in a pull-up of 1.2 g.
    speed = math.sqrt(29.1 * G0 / 4 / F16.thrust_coefficient)
    track = FlightTrack.of(
        name="x",
        time_s=np.array([7.0]),
        rotor_count=4,
        rotor_speed_rpm=np.array([[speed, 1.05 * speed, speed, np.nan]]),
        throttle=np.full((1, 4), 0.55),
        airspeed=np.zeros(1),
        tank_kg=np.array([8.0]),
        specific_force_frd=np.array([[0.0, 0.6 * G0, -0.8 * 1.5 * G0]]),
        angular_rate_frd=np.array([[0.1, np.nan, 0.3]]),
    )
    found = fault_signals(analyse(track, MODEL, np.full(1, F16.reference_density)), slice(None))[0]
    share = 0.35 * 0.5 + 0.65 * 0.25  # half way between 0.15 and 0.95, exponent 0.65
    np.testing.assert_allclose(found[:5], [7.0, 0.0, 1.05**2 - 1.0, 0.0, np.nan], atol=1e-9)
    level = 2.0 * math.log(speed) - math.log(share)
    np.testing.assert_allclose(found[5:9], [level, level + 2.0 * math.log(1.05), level, np.nan])
    np.testing.assert_allclose(found[9:13], math.log(share))
    load = math.hypot(0.6, 1.2) - 1.0
    # Last the error of coarse steps, which one row does not show, and what the row may show: all
    # outputs are below the end of their range.
    np.testing.assert_allclose(found[13:], [load, 0.1, 0.0, 0.3, 0.0, 0.0])


def test_speeds_in_coarse_steps_are_off_by_as_much_of_thrust_as_twice_a_step():
    """Steps of 250 rpm at 2,000: 12.5 %, by sqrt(12) 3.6 %, of which 2 % are usual."""
    fine = np.random.default_rng(1).uniform(1760.0, 2240.0, 120)
    steps = 250.0 * np.round(fine / 250.0)
    for rpm, coarse in ((steps, 2.0 * math.sqrt(0.0361**2 - 0.02**2)), (fine, 0.0)):
        track = FlightTrack.of(
            name="x",
            time_s=np.arange(120.0) / 10.0,
            rotor_count=4,
            rotor_speed_rpm=np.repeat(rpm[:, None], 4, axis=1),
            airspeed=np.zeros(120),
            tank_kg=np.full(120, 8.0),
        )
        air = np.full(120, F16.reference_density)
        found = fault_signals(analyse(track, MODEL, air), slice(None))
        np.testing.assert_allclose(found[:, -2], coarse, rtol=0.01)


def test_a_motor_that_nearly_idles_shows_no_part():
    """In a sharp turn outputs fall to idle, and a rotor that still slows down is no weak motor."""
    outputs = [0.15, 0.25, 0.35, 0.55]
    track = FlightTrack.of(
        name="x",
        time_s=np.array([7.0]),
        rotor_count=4,
        rotor_speed_rpm=np.full((1, 4), 2000.0),
        throttle=np.array([outputs]),
        airspeed=np.zeros(1),
        tank_kg=np.array([8.0]),
    )
    found = fault_signals(analyse(track, MODEL, np.full(1, F16.reference_density)), slice(None))[0]
    # Shares of full thrust: 0, 0.35/8 + 0.65/64 = 0.054, 0.128, 0.338.
    assert np.isfinite(found[5:9]).tolist() == [False, True, True, True]


def test_a_motor_s_prior():
    prior = motor_test(MODEL)._prior
    np.testing.assert_allclose(prior.trim, 0.1)
    np.testing.assert_allclose(prior.noise, 0.01)
    np.testing.assert_allclose(prior.inputs, [[0.15, 0.2]] * 4)  # steepness of the curve, lag in s
    assert (prior.flights, prior.alone) == (0, False)
    test = motor_test(MODEL)
    # A speed short by s moves ln N² of its own motor, known to half of the step from size to size.
    step = 2.0 * np.log(1.0 - FAULT_SIZES)
    np.testing.assert_allclose(test._steps[2, 1:, 2], step)
    np.testing.assert_allclose(test._widths[2, 1:, 2], -0.03 * step)
    assert not np.any(test._steps[2, :, [0, 1, 3]])
    assert not np.any(test._steps[:, 0])


def turns() -> np.ndarray:
    """(4, 7) prior of load, rates and accelerations in each mode: its own whole, of others 0.1."""
    arm = F16.arm
    own = 2.0 * np.array([1.0, arm / G0, arm / G0, arm**2 / F16.torque_ratio / G0])
    table = np.tile(0.1 * own, (4, 1))
    table[range(4), range(4)] = own
    return np.column_stack([table, table[:, 1:]])


def test_a_propellers_prior():
    prior = propeller_test(MODEL, MODES)._prior
    # A mode of four rotors, each a tenth of its thrust off: 0.1 x 2.
    np.testing.assert_allclose(prior.trim, 0.2)
    np.testing.assert_allclose(prior.noise, 0.02)
    np.testing.assert_allclose(prior.inputs, turns())
    assert (prior.flights, prior.alone) == (0, True)
    # What a model knows of a manoeuvre looks ahead, and is not asked for: the whole of it is left.
    for key in ("load_factor", "manoeuvre_moment"):
        known = replace(MODEL, effects=(recorded(key),))
        np.testing.assert_allclose(propeller_test(known, MODES)._prior.inputs, prior.inputs)
    steps, torque = (a @ MODES for a in loss_steps(MODEL))
    widths = propeller_test(MODEL, MODES)._widths[:, 1:]
    np.testing.assert_allclose(widths, np.sqrt(torque**2 + (0.03 * steps) ** 2))


def test_good_flights_say_how_far_a_trim_may_be_off():
    # Thrust goes with the square: twice the share of the speed in hover with half a tank.
    hover = math.sqrt((21.1 + 8.0) * G0 / 4 / F16.thrust_coefficient)
    shown = (10.0, 4.0, 6.0, 8.0)
    good = GoodFlights(flights=7, scatter={}, mode_scatter_rpm=shown)
    for model, flights in (
        (replace(MODEL, good_flights=good), 7),
        (replace(MODEL, background_rpm=shown), 0),
    ):
        prior = propeller_test(model, MODES)._prior
        np.testing.assert_allclose(prior.trim, 2.0 * np.array(shown) / hover)
        assert prior.flights == flights


def named(posterior: np.ndarray, *, begins: bool = False):
    test = motor_test(MODEL)
    test._set_fault(1, posterior, begins=begins)
    return test.faults.get(1)


def test_a_fault_is_the_mean_of_its_sizes_with_the_interval_that_holds_95_percent():
    posterior = np.zeros(SIZES + 1)
    posterior[11:15] = 0.25
    fault = named(posterior)
    assert fault is not None
    at = FAULT_SIZES[10:14]
    assert fault.size == pytest.approx(at.mean())
    # Half of each size's share lies below it: 0.125, 0.375, 0.625, 0.875; beyond, to the next one.
    assert (fault.lower, fault.upper) == pytest.approx(
        (np.interp(0.2, [0, 1], FAULT_SIZES[9:11]), np.interp(0.8, [0, 1], FAULT_SIZES[13:15])),
    )
    growing = named(posterior, begins=True)
    assert growing is not None
    assert (growing.lower, growing.upper) == (fault.lower, 0.6)


@pytest.mark.parametrize(("sound", "bad"), [(0.49, True), (0.51, False)])
def test_sound_again_is_as_likely_before_as_all_sizes_together(sound, bad):
    posterior = np.full(SIZES + 1, (1.0 - sound) / SIZES)
    posterior[0] = sound / SIZES
    assert (named(posterior / posterior.sum()) is not None) == bad


def test_a_repair_is_believed_when_two_blocks_on_end_show_it():
    """While it begins one block says sound, the next a smaller size, and then two say sound: the
    fault has the size that it had, until it is over."""
    test = motor_test(MODEL)
    sound, small = np.zeros((2, SIZES + 1))
    sound[0], small[5] = 1.0, 1.0
    large = np.roll(small, 15)
    test._set_fault(1, large, begins=False)
    test._faults_before = test.faults
    said = []
    for posterior in (sound, small, sound, sound):
        test._set_fault(1, posterior, begins=True)
        fault = test.faults.get(1)
        said.append(0.0 if fault is None else fault.lower)
    least = FAULT_SIZES[19]
    assert said == pytest.approx([least, least, least, 0.0], rel=0.06)
    # Once all of a change must be there, one block is enough.
    test._set_fault(1, large, begins=False)
    test._set_fault(1, sound, begins=False)
    assert 1 not in test.faults


def test_of_a_rotor_that_stands_no_alternative_is_named():
    test = motor_test(MODEL)
    share = np.full((4, SIZES + 1), 0.5 / SIZES)
    share[2:] = 0.0
    suspect = test._ambiguous_fault(share, 0, 1, None)
    assert suspect is not None
    assert suspect.rotors == (0, 1)
    large = np.eye(SIZES + 1)[20]
    test._set_fault(1, large, begins=False)
    assert test._ambiguous_fault(share, 0, 1, None) is None


@pytest.mark.parametrize(("wrong", "said"), [(24, False), (1, True)])
def test_a_rotor_is_named_when_it_has_nearly_all_of_the_weight(wrong, said):
    """Two rotors move three signals alike, the second in so many of its sizes only."""
    steps = np.ones((2, SIZES, 3))
    steps[1, wrong:] = -1.0
    each = np.ones(3)
    prior = Prior(trim=0.1 * each, noise=0.01 * each, inputs=np.zeros((3, 1)))
    test = FaultTest("motor", steps, np.full(steps.shape, 0.01), prior)
    rng, lowest, suspected = np.random.default_rng(1), 1.0, set()
    for block in range(100):
        jump = 1.0 if block >= 80 else 0.0
        test.add(0.7 * block, jump + 0.01 * rng.standard_normal(3), np.zeros((3, 1)))
        lowest = min(lowest, test._sound_probability)
        suspected |= {fault.rotors for fault in test.current if fault.rotors}
    assert [rotor for rotor, fault in test.faults.items() if not fault.rotors] == [0] * said
    # Until the other is excluded it is one of both.
    assert suspected <= {(0, 1)}
    assert said or suspected == {(0, 1)}
    assert lowest < 1e-3  # what is so likely a part is not counted as a turn


def test_one_of_two_that_move_all_alike_stands_until_the_signals_are_back():
    """As of two rotors on one arm: a minute on, still one of both, and then sound again."""
    each = np.ones(3)
    prior = Prior(trim=0.1 * each, noise=0.01 * each, inputs=np.zeros((3, 1)))
    steps = -2.0 * np.log1p(-FAULT_SIZES)[None, :, None] * np.ones((2, 1, 3))
    test = FaultTest("propeller", steps, 0.03 * steps, prior)
    rng, stood = np.random.default_rng(1), []
    for block in range(240):
        jump = 0.4 if 80 <= block < 170 else 0.0
        test.add(0.7 * block, jump + 0.01 * rng.standard_normal(3), np.zeros((3, 1)))
        stood.append({fault.rotors for fault in test.current})
    assert stood[:80] == [set()] * 80
    assert stood[90:170] == [{(0, 1)}] * 80
    assert stood[180:] == [set()] * 60


@pytest.mark.parametrize("seed", range(6))
def test_both_are_named_until_two_blocks_exclude_one(seed):
    """Two rotors alike but for a tenth in the third signal: 95 % on one leaves the other 5 %."""
    each = np.ones(3)
    prior = Prior(trim=0.1 * each, noise=0.01 * each, inputs=np.zeros((3, 1)))
    steps = -2.0 * np.log1p(-FAULT_SIZES)[None, :, None] * np.ones((2, 1, 3))
    steps[1, :, 2] *= 0.9
    test = FaultTest("propeller", steps, 0.01 * steps, prior)
    rng, excluded, named = np.random.default_rng(seed), [False] * 80, []
    for block in range(88):
        jump = 0.12 * (block >= 80)
        test.add(0.7 * block, jump + 0.004 * rng.standard_normal(3), np.zeros((3, 1)))
        named.append([fault.rotors for fault in test.current])
        if block >= 80:
            sizes = test._remaining.reshape(-1, 3), test._remaining_widths.reshape(-1, 3)
            change = test._test.change(*sizes, 4.0)
            share = change.share.reshape(2, -1).sum(axis=1) if change else np.ones(2)
            excluded.append(float(share.min()) <= 0.01)
    assert named[:80] == [[]] * 80
    assert named[86] in ([()], [(0, 1)])
    first = next((k for k in range(88) if named[k] == [()]), None)
    assert first is None or excluded[first - 1 : first + 1] == [True, True]


def test_a_rotor_that_was_named_stays_it_until_another_is_as_sure():
    """Of two rotors alike but for the third signal, whose change comes back part of the way."""
    each = np.ones(3)
    prior = Prior(trim=0.1 * each, noise=0.01 * each, inputs=np.zeros((3, 1)))
    steps = -2.0 * np.log1p(-FAULT_SIZES)[None, :, None] * np.ones((2, 1, 3))
    steps[1, :, 2] *= 0.8
    test = FaultTest("propeller", steps, 0.03 * steps, prior)
    rng, named, likelier = np.random.default_rng(3), [], []
    for block in range(94):
        third = 0.0 if block < 80 else 0.4 if block < 85 else 0.2
        jump = np.array([0.4, 0.4, third]) * (block >= 80)
        test.add(0.7 * block, jump + 0.005 * rng.standard_normal(3), np.zeros((3, 1)))
        if test.faults:
            sizes = test._remaining.reshape(-1, 3), test._remaining_widths.reshape(-1, 3)
            change = test._test.change(*sizes, 4.0)
            assert change is not None
            likelier.append(float(change.share.reshape(2, -1)[1].sum()))
            named.append(*test.faults)
    sure = next(k for k in range(len(named)) if min(likelier[k : k + 2]) > 0.95)
    assert sum(0.5 < share < 0.95 for share in likelier[:sure]) >= 2
    assert named == [0] * (sure + 1) + [1] * (len(named) - sure - 1)


def row_of(time_s: float, excess=(0.0,) * 4) -> np.ndarray:
    return np.array([time_s, *excess, *(14.0,) * 4, *(-1.0,) * 4, *(0.0,) * 6])


def blocks(faults: RotorFaults, rows) -> list[float]:
    """Times of the rows with which a block was whole."""
    return [float(row[0]) for row in rows if faults.add(float(row[0]), row)]


def test_a_block_is_seven_rows_and_ends_where_time_goes_back():
    assert blocks(RotorFaults(MODEL), [row_of(k / 10) for k in range(16)]) == [0.7, 1.4]
    assert blocks(RotorFaults(MODEL), [row_of(t) for t in (5.0, 5.1, 2.0, 2.1)]) == [2.0]


@pytest.mark.parametrize(
    ("rows", "excess", "propeller", "motor"),
    [
        (3, 0.0, 1, 1),
        (2, 0.0, 0, 0),  # too few for a mean
        (7, -0.19, 1, 1),
        (7, -0.21, 0, 1),  # the legs carry: what a rotor lacks says nothing of its propeller
        (7, np.nan, 0, 1),
    ],
)
def test_which_blocks_a_test_reads(rows, excess, propeller, motor):
    faults = RotorFaults(MODEL)
    faults._close_block(np.array([row_of(k / 10, (excess,) * 4) for k in range(rows)]))
    assert [len(test._waiting or ()) for test in faults._tests] == [propeller, motor]
    assert {*faults.tested} == {k for k, n in (("propeller", propeller), ("motor", motor)) if n}


class Heard:
    """What a test is given."""

    current: tuple[RotorFault, ...] = ()
    time_s: float | None = None

    def add(self, time_s, values, inputs) -> None:
        self.time_s, self.values, self.inputs = time_s, values, inputs


def test_a_block_is_the_mean_of_its_rows_and_its_slopes_from_first_to_last():
    """Excess, motors, outputs, load factor and rates that rise by their own amounts in 0.6 s."""
    faults = RotorFaults(MODEL)
    propeller, motor = Heard(), Heard()
    tests: Any = (propeller, motor)
    faults._tests[:] = tests
    rows = np.array([row_of(5.0 + k / 10) for k in range(7)])
    at = np.array([0, 1, 1, 1, 1, 1, 4])[:, None]  # mean 9/7, 4 from the first to the last
    rises = np.arange(1.0, 17.0)
    rows[:, 1:-2] += at * rises
    faults.add(5.0, rows[0])
    faults._close_block(rows)
    means = rows[0, 1:-2] + 9.0 / 7.0 * rises
    slopes = 4.0 / 0.6 * rises
    assert (propeller.time_s, motor.time_s) == (5.0, 5.0)
    np.testing.assert_allclose(propeller.values, means[:4] @ MODES, atol=1e-12)
    np.testing.assert_allclose(propeller.inputs, [[*means[12:], *slopes[13:]]])
    np.testing.assert_allclose(motor.values, means[4:8] - np.median(means[4:8]))
    moves = np.column_stack([means[8:12], slopes[8:12]])
    np.testing.assert_allclose(motor.inputs, moves - np.median(moves, axis=0))


def test_a_start_that_looks_like_a_part_may_be_a_turn_of_once_a_minute():
    # A block of 0.7 s in 60 s: e^4.451 to one.
    assert math.exp(LIKE_A_TURN) == pytest.approx(60.0 / 0.7)
    assert motor_test(MODEL)._sound_probability == 1.0


def test_a_part_can_have_been_changed_in_half_a_minute_on_the_ground():
    for pause, kept in ((29.9, True), (30.1, False)):
        faults = RotorFaults(MODEL)
        posterior = np.zeros(SIZES + 1)
        posterior[5] = 1.0
        faults._tests[1]._set_fault(2, posterior, begins=False)
        assert [f.rotor for f in faults.current] == [2]
        faults.landed(10.0)
        faults.add(10.0 + pause, row_of(10.0 + pause))
        assert bool(faults.current) == kept


@pytest.mark.parametrize(
    ("evidence", "before", "heard"),
    [
        (RowLimit.ANY, False, True),
        (RowLimit.ANY, True, True),
        (RowLimit.NO_SECOND_FAULT, False, True),
        (RowLimit.NO_SECOND_FAULT, True, False),
        (RowLimit.NO_FAULT, False, False),
    ],
)
def test_rows_in_which_the_model_does_not_hold_name_nobody_new(evidence, before, heard):
    """One row of it in a block is enough; what was found stands, and is confirmed."""
    faults = RotorFaults(MODEL)
    propeller, motor = Heard(), Heard()
    tests: Any = (propeller, motor)
    faults._tests[:] = tests
    if before:
        propeller.current = (RotorFault(kind="propeller", rotor=1, size=0.2, lower=0.1, upper=0.3),)
    rows = np.array([row_of(5.0 + k / 10) for k in range(7)])
    rows[3, -1] = evidence
    faults.add(5.0, rows[0])
    faults._close_block(rows)
    assert (propeller.time_s is not None) is heard
    assert (motor.time_s is not None) is heard
    assert faults.tested["motor"] == motor.current


@pytest.mark.parametrize(
    ("channels", "evidence"),
    [
        ({}, RowLimit.ANY),
        ({"throttle": [[0.5, 0.5, 0.5, 0.99]]}, RowLimit.NO_SECOND_FAULT),
        ({"voltage": [24.0]}, RowLimit.NO_FAULT),  # 1.7 V a cell of 14
        ({"voltage": [42.0]}, RowLimit.ANY),  # 3.0 V
        ({"voltage": [0.0]}, RowLimit.ANY),  # not reported
        ({"velocity_ned": [[0.0, 0.0, 7.0]]}, RowLimit.NO_FAULT),
        ({"velocity_ned": [[0.0, 0.0, 4.0]]}, RowLimit.ANY),
    ],
)
def test_what_a_row_may_show(channels, evidence):
    track = FlightTrack.of(
        name="x",
        time_s=np.array([7.0]),
        rotor_count=4,
        **{name: np.array(values) for name, values in channels.items()},
    )
    found = fault_signals(analyse(track, MODEL, np.full(1, F16.reference_density)), slice(None))
    assert found[0, -1] == evidence


def test_faults_are_sought_without_the_effects_that_look_ahead():
    """So a rotor is named by the rows that have come; the model itself waits two seconds."""
    model = shipped_model()
    assert model.look_ahead_s == pytest.approx(1.9, abs=0.1)
    assert fault_model(model).look_ahead_s == 0.0
    assert {e.name for e in model.effects} - {e.name for e in fault_model(model).effects} == {
        "load_factor",
        "manoeuvre_moment",
    }
