"""A propeller, an ESC or another rotor's speed: what motor outputs testify, by made signals."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.output_faults import (
    MisreadSpeed,
    OutputWitness,
    misread_speed,
    undecided,
)

ROTORS = 4


def signals(speed, output, seconds=30.0, hz=10.0, noise=0.0, seed=0):
    """Rows of `fault_signals`: time, d of each rotor, ln N² - ln f, ln f, load and three rates."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 1.0 / hz)
    d = np.array(speed) + noise * rng.standard_normal((time_s.size, ROTORS))
    o = np.tile(np.array(output, dtype=float), (time_s.size, 1))
    return np.column_stack([time_s, d, 14.0 + d - o, -1.0 + o, np.zeros((time_s.size, 4))])


def fault(rotor=0, size=0.08, **given):
    lower, upper = size - 0.01, size + 0.01
    return RotorFault(kind="propeller", rotor=rotor, size=size, lower=lower, upper=upper, **given)


def judged(rows, *faults):
    witness = OutputWitness(ROTORS)
    for row in rows:
        witness.add(row)
    return witness.assessed(faults)


@pytest.mark.parametrize("loss", [0.04, 0.08, 0.12])
@pytest.mark.parametrize("steep", [0.65, 1.0, 1.5])
def test_a_worn_propeller_needs_more_output_and_keeps_its_name(loss, steep):
    rows = signals([loss, -0.01, 0.0, 0.0], [steep * loss, 0.0, 0.0, 0.0])
    assert judged(rows, fault(size=loss)) == (fault(size=loss),)
    assert misread_speed(rows, ROTORS, taught=True) is None


@pytest.mark.parametrize("factor", [0.92, 0.96, 1.04, 1.08])
def test_a_speed_alone_that_is_off_is_the_escs(factor):
    off = factor**2 - 1.0
    rows = signals([0.0, 0.0, off, 0.0], [0.005, -0.005, 0.0, 0.004])
    assert judged(rows, fault(rotor=2, size=abs(off))) == () or factor < 1.0
    found = misread_speed(rows, ROTORS, taught=False)
    assert found is not None
    assert (found.rotor, found.witnessed) == (2, True)
    assert found.factor == pytest.approx(factor, abs=0.002)


def test_where_another_output_is_raised_instead_it_is_one_of_the_two():
    rows = signals([0.0, 0.08, 0.0, 0.0], [0.055, 0.0, 0.0, 0.0])
    (one,) = judged(rows, fault(rotor=1))
    assert one.rotors == (0, 1)
    assert misread_speed(rows, ROTORS, taught=True) is None
    # Noise of 5 % of speed at 3 Hz changes nothing of it.
    noisy = signals([0.0, 0.08, 0.0, 0.0], [0.055, 0.0, 0.0, 0.0], hz=3.0, noise=0.1)
    assert judged(noisy, fault(rotor=1))[0].rotors == (0, 1)


def test_one_of_two_stays_so_where_later_rows_do_not_show_the_fault():
    """Speeds in coarse steps stay between two of them: their median then shows nothing."""
    witness = OutputWitness(ROTORS)
    swapped = signals([0.0, 0.12, 0.0, 0.0], [0.09, 0.0, 0.0, 0.0])
    between = signals([0.0, 0.01, 0.0, 0.0], [0.09, 0.0, 0.0, 0.0], seconds=60.0)
    between[:, 0] += 30.0
    for rows in (swapped, between):
        for row in rows:
            witness.add(row)
        assert witness.assessed([fault(rotor=1, size=0.12)])[0].rotors == (0, 1)
    # Of a fault that is more than twice as large they have shown nothing.
    assert witness.assessed([fault(rotor=1, size=0.3)]) == (fault(rotor=1, size=0.3),)


def test_a_step_in_flight_is_judged_by_the_rows_since_and_is_no_escs():
    """Poles stay as many: what begins in flight is a part, whatever outputs that lag say."""
    before = signals([0.0] * 4, [0.0] * 4, seconds=27.0)
    after = signals([0.12, 0.0, 0.0, 0.0], [0.0] * 4, seconds=3.0)
    after[:, 0] += 27.0
    witness = OutputWitness(ROTORS)
    for row in (*before, *after):
        witness.add(row)
    assert witness.assessed([fault(size=0.12)]) == (fault(size=0.12),)
    later = signals([0.12, 0.0, 0.0, 0.0], [0.0] * 4, seconds=30.0)
    later[:, 0] += 30.0
    for row in later:
        witness.add(row)
    assert witness.assessed([fault(size=0.12)]) == (fault(size=0.12),)
    swapped = signals([0.0, 0.12, 0.0, 0.0], [0.09, 0.0, 0.0, 0.0], seconds=3.0)
    swapped[:, 0] += 27.0
    assert judged((*before, *swapped), fault(rotor=1, size=0.12))[0].rotors == (0, 1)


def test_an_esc_that_reads_high_all_flight_stays_one_while_wind_moves_speed_and_output():
    """The model's error is of speed and output alike: half a minute of it is not the flight."""
    witness, named = OutputWitness(ROTORS), []
    for k, error in enumerate([0.0, -0.04, 0.0, 0.04, 0.05, 0.0]):
        output = [error, -error, 0.0, 0.0]
        rows = signals([0.08 + error, -error, 0.0, 0.0], output, noise=0.05, seed=k)
        rows[:, 0] += 30.0 * k
        for row in rows:
            witness.add(row)
            if row[0] > 10.0 and int(row[0] * 10) % 70 == 0:
                named += witness.assessed([fault()])
    assert named == []
    worn = signals([0.24, 0.0, 0.0, 0.0], [0.11, 0.0, 0.0, 0.0])  # its propeller wears as well
    worn[:, 0] += 180.0
    for row in worn:
        witness.add(row)
    assert witness.assessed([fault(size=0.22)]) == (fault(size=0.22),)
    witness.forget()
    for row in signals([0.08, 0.0, 0.0, 0.0], [0.06, 0.0, 0.0, 0.0]):
        witness.add(row)
    assert witness.assessed([fault()]) == (fault(),)


def test_without_outputs_nothing_tells_a_propeller_from_its_esc():
    rows = signals([0.08, 0.0, 0.0, 0.0], [np.nan] * 4)
    (one,) = judged(rows, fault())
    assert (one.rotors, one.witnessed) == ((), False)
    assert misread_speed(rows, ROTORS, taught=True) is None
    slow = signals([0.0, 0.0, -0.08, 0.0], [np.nan] * 4)
    found = misread_speed(slow, ROTORS, taught=True)
    assert found is not None
    assert found == MisreadSpeed(rotor=2, factor=found.factor, witnessed=False)
    assert found.factor == pytest.approx(0.959, abs=0.001)
    # A model that no sound flight has taught does not know how rotors share the thrust.
    assert misread_speed(slow, ROTORS, taught=False) is None


@pytest.mark.parametrize(
    ("speed", "output"),
    [
        ([0.06, -0.06, 0.06, -0.06], [0.04, -0.05, 0.05, -0.04]),  # weight forward
        ([0.0, 0.0, 0.03, 0.0], [0.0] * 4),  # 1.5 % of speed is below what is looked at
        ([0.06, 0.0, 0.06, 0.0], [0.0] * 4),  # two at once are no single ESC
    ],
)
def test_what_moves_several_rotors_or_little_is_no_escs(speed, output):
    assert misread_speed(signals(speed, output), ROTORS, taught=True) is None


def test_faults_that_the_model_holds_stand_as_they_are():
    witness, known = OutputWitness(ROTORS), fault()
    for row in signals([0.0] * 4, [np.nan] * 4):
        witness.add(row)
    assert witness.assessed([known], known=[known]) == (known,)


def test_an_order_that_manoeuvres_do_not_tell_leaves_a_choice_unless_outputs_do():
    blind = fault(witnessed=False)
    assert undecided([blind], [(0, 1), (2, 3)])[0].rotors == (0, 1)
    assert undecided([blind], [(0, 1), (0, 3)])[0].rotors == (0, 1, 3)
    assert undecided([blind], [(2, 3)]) == (blind,)
    assert undecided([fault()], [(0, 1)]) == (fault(),)
    motor = replace(blind, kind="motor")
    assert undecided([motor], [(0, 1)]) == (motor,)
