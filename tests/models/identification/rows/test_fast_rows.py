"""How late rotor speeds come, by rows within means, on a recorded flight moved by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.identification.rows.problem import assemble_flight
from thrustmargin.models.identification.rows.reduced import delay_of, reduce_flights
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()


@pytest.fixture(scope="module")
def recorded(sitl_logs):
    return read_log(sitl_logs / "campaign" / "v4_m16_q2.5.tlog").track


def late(track, seconds: float, loss: float = 0.0):
    """Every rotor speed as it was some time before, the second rotor's for less thrust."""
    speeds = track.rotor_speed_rpm / np.sqrt([1.0, 1.0 - loss, 1.0, 1.0])
    columns = [np.interp(track.time_s - seconds, track.time_s, c) for c in speeds.T]
    return replace(track, rotor_speed_rpm=np.column_stack(columns))


def shown(track):
    return delay_of(assemble_flight(MODEL, track))


@pytest.mark.parametrize("seconds", [-0.05, 0.0, 0.04, 0.08, 0.25, 0.9])
def test_a_delay_is_seen_to_a_hundredth_of_a_second(recorded, seconds):
    value, error = shown(late(recorded, seconds))
    assert value == pytest.approx(seconds, abs=0.01)
    assert 0.0003 < error < 0.012


def test_what_lasts_is_no_delay(recorded):
    assert shown(late(recorded, 0.0, loss=0.15))[0] == pytest.approx(0.0, abs=0.01)


def test_its_error_makes_no_delay_as_unlikely_as_rows_do(recorded):
    """By the noise that fits the rows best: each doubling of it in a mode costs T log 2."""
    moved = late(recorded, 0.9)
    value, error = shown(moved)
    flight = assemble_flight(MODEL, moved).rows(np.arange(1500))
    bins = (flight.channels.time_s - flight.channels.time_s[0]) // 0.7

    def size(delay: float) -> np.ndarray:
        placed = Placed(
            effect=known_effect("sensor_lag:rotor speed"), values={"lag": delay}, rotor=None
        )
        left = flight.mode_amplitudes(flight.measured_rpm - flight.speeds([placed]))
        means = np.stack([left[bins == b].mean(axis=0) for b in bins])
        return np.sqrt(np.sum((left - means) ** 2, axis=0))

    costs = 1500 * np.log(size(0.0) / size(value)).sum()
    assert 0.5 * (value / error) ** 2 == pytest.approx(costs, rel=1e-3)


def test_where_nothing_is_quick_or_speeds_are_of_outputs_nothing_is_said(recorded):
    still = assemble_flight(MODEL, recorded)
    same = still.channels.each(lambda a: np.broadcast_to(a[:1], a.shape))
    alike = replace(still, channels=replace(same, time_s=still.channels.time_s))
    assert delay_of(alike).tolist() == [0.0, np.inf]
    assert delay_of(replace(still, of_outputs=True)).tolist() == [0.0, np.inf]


def test_each_flight_of_a_search_brings_its_own(recorded):
    means = reduce_flights(MODEL, [recorded, late(recorded, 0.08)])
    np.testing.assert_array_equal(means.delay_s[0], shown(recorded))
    np.testing.assert_array_equal(means.delay_s[1], shown(late(recorded, 0.08)))
