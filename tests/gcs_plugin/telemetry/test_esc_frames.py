"""The share of its telemetry frames that an ESC loses, from reports made by hand."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.esc_frames import lost_frames
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.statement import state

ESC = Provenance(kind=SourceKind.MESSAGE, name="ESC")
MOTORS = MotorMap(2, (0, 1), None, state("as written", text="by hand"), (), escs=(1, 0))
TIME_S = np.arange(0.0, 100.0, 0.1)


def speeds(*times):
    """One signal a motor, of a rotor that turns; the motors' ESCs are exchanged."""
    pairs = zip(times, MOTORS.escs, strict=True)
    return [Signal("esc_rpm", ESC, t, np.full(t.size, 2000.0), esc) for t, esc in pairs]


def shares(signals, reported):
    """Mean share of each motor."""
    found, _ = lost_frames(signals, MOTORS, reported)
    return [None if one is None else float(one.values.mean()) for one in found]


def counted(channel, esc, values):
    return Signal(channel, ESC, TIME_S, np.asarray(values, dtype=float), esc)


def test_a_pause_of_reports_is_lost_and_reports_that_a_logger_skips_are_not():
    paused = TIME_S[(TIME_S < 40.0) | (TIME_S > 50.0)]
    skipped = np.sort(np.concatenate([TIME_S[::2], TIME_S[1:400:2]]))
    assert shares({}, speeds(paused, skipped)) == pytest.approx([0.105, 0.0], abs=0.006)


def test_steps_that_are_short_and_long_in_turn_are_no_pauses():
    """10 and 90 ms, of which for some seconds the short ones are more."""
    uneven = np.cumsum(np.tile([0.01, 0.09], 1000))
    bursts = np.cumsum(np.tile([*[0.01] * 4, *[0.09] * 3], 322))
    assert shares({}, speeds(uneven, bursts)) == [0.0, 0.0]


def test_shares_of_a_link_that_is_heard_in_pieces_are_those_of_the_whole():
    """Rows of every 2.3 s, from the reports of the 8 s before; the ESC pauses for 12 s."""
    paused = TIME_S[(TIME_S < 40.0) | (TIME_S > 52.0)]
    whole, _ = lost_frames({}, MOTORS, speeds(paused, TIME_S))
    pieces: dict[float, float] = {}
    usual, heard_s = (), -np.inf
    for until_s in np.arange(2.3, 100.0, 2.3):
        kept = [
            t[max(int(np.searchsorted(t, heard_s - 8.0)) - 1, 0) : np.searchsorted(t, until_s)]
            for t in (paused, TIME_S)
        ]
        found, usual = lost_frames({}, MOTORS, speeds(*kept), heard_s=heard_s, usual_s=usual)
        if (one := found[0]) is not None:
            pieces |= dict(zip(one.time_s.tolist(), one.values.tolist(), strict=True))
        heard_s = until_s
    first = whole[0]
    assert first is not None
    known = first.time_s <= max(pieces)
    assert pieces == dict(
        zip(first.time_s[known].tolist(), first.values[known].tolist(), strict=True)
    )
    assert max(pieces.values()) == 1.0


def test_an_error_rate_goes_to_the_motor_of_its_esc():
    rates = (counted("esc_error_rate", 0, np.full(1000, 0.02)),)
    rates += (counted("esc_error_rate", 1, np.zeros(1000)),)
    assert shares({"esc_error_rate": rates}, speeds(TIME_S, TIME_S)) == pytest.approx([0.0, 0.02])


def test_a_rate_of_zero_throughout_is_of_no_esc_that_counts():
    rates = tuple(counted("esc_error_rate", esc, np.zeros(1000)) for esc in (0, 1))
    paused = TIME_S[(TIME_S < 40.0) | (TIME_S > 50.0)]
    found = shares({"esc_error_rate": rates}, speeds(paused, TIME_S))
    assert found == pytest.approx([0.105, 0.0], abs=0.006)


def test_errors_that_a_counter_adds_are_compared_with_the_reports():
    """One error for every four reports, and a restart of the counter at half time."""
    count = np.floor(np.arange(1000) / 4.0)
    count[500:] -= count[500]
    errors = (counted("esc_errors", 1, 7.0 + count), counted("esc_errors", 0, np.zeros(1000)))
    found = shares({"esc_errors": errors}, speeds(TIME_S, TIME_S))
    assert found == pytest.approx([0.2, 0.0], abs=0.005)


def test_a_motor_without_speed_is_unknown():
    assert shares({}, [None, speeds(TIME_S, TIME_S)[1]]) == [None, 0.0]
