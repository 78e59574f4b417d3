"""What on the ground ends a sortie, and what does not: stays made by hand."""

from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.flight_log import flight_spans, has_flight, is_sortie
from thrustmargin.models.flight import FlightTrack

BOOT = 1000.0  # s of the vehicle's clock at the first row
TIME = np.arange(0.0, 400.0, 0.5)


def track(stay: tuple[float, float], **channels: Any) -> FlightTrack:
    """In the air from 20 to 380 s, but for the `stay`."""
    flying = (TIME >= 20) & (TIME < 380) & ~((stay[0] <= TIME) & (stay[1] > TIME))
    return FlightTrack.of(name="x", time_s=TIME, rotor_count=4, flying=flying, **channels)


def reported(channel: str, *reports: tuple[float, float]) -> dict[str, tuple[Signal, ...]]:
    times, values = np.array(reports).T
    return {channel: (Signal(channel, sent(channel), BOOT + times, values),)}


def spans(flight: FlightTrack, signals: Any = None) -> list[tuple[float, float]]:
    return flight_spans(flight, BOOT, signals or {})


ARMED = reported("armed", (0, 0), (10, 1), (390, 0))
WHOLE = [(-np.inf, np.inf)]


def test_a_touch_down_is_no_end_and_disarming_is():
    flight = track((100, 140))
    assert spans(flight) == WHOLE
    assert spans(flight, ARMED) == WHOLE
    # Off from 110 to 130: each sortie has the ground up to the middle between.
    off = reported("armed", (0, 0), (10, 1), (110, 0), (130, 1), (390, 0))
    assert spans(flight, off) == [(-np.inf, BOOT + 120), (BOOT + 120, np.inf)]
    # A heartbeat a second says the same.
    beats = reported(
        "armed", *((t, float(not 110 <= t < 130 and 10 <= t < 390)) for t in range(400))
    )
    assert spans(flight, beats) == [(-np.inf, BOOT + 120), (BOOT + 120, np.inf)]
    # Of a long pause half a minute belongs to either flight, and the rest to none.
    off = reported("armed", (0, 0), (10, 1), (110, 0), (230, 1), (390, 0))
    assert spans(track((100, 240)), off) == [(-np.inf, BOOT + 140), (BOOT + 200, np.inf)]
    # Motors reported off in the air, as by a heartbeat of another component, end nothing.
    assert spans(flight, reported("armed", (0, 1), (200, 0), (201, 1))) == WHOLE


@pytest.mark.parametrize(("seconds", "sorties"), [(59, 1), (61, 2)])
def test_a_minute_on_the_ground_ends_a_sortie_only_where_the_ground_is_reported(seconds, sorties):
    flight = track((100, 100 + seconds))
    landed = reported("landed", (0, 1), (20, 2), (100, 1), (100 + seconds, 2), (380, 1))
    assert len(spans(flight, landed | ARMED)) == sorties
    # Where only rotor speeds went missing, nothing says that it landed.
    assert spans(flight, ARMED) == WHOLE


@pytest.mark.parametrize(
    ("stay_s", "tank_kg", "voltage", "sorties"),
    [
        (20, 3.0, 0.0, 2),
        (20, 1.0, 0.0, 1),
        (20, -3.0, 0.0, 1),
        (20, 0.0, 4.0, 2),
        (20, 0.0, 2.0, 1),
        (5, 3.0, 4.0, 1),
        (20, np.nan, np.nan, 1),
    ],
)
def test_a_fuller_tank_or_battery_begins_a_sortie(stay_s, tank_kg, voltage, sorties):
    after = TIME >= 100
    flight = track(
        (100, 100 + stay_s), tank_kg=5.0 + tank_kg * after, voltage=50.0 + voltage * after
    )
    assert len(spans(flight, ARMED)) == sorties


def test_several_stays_make_as_many_sorties():
    flying = (TIME % 100 >= 20) & (TIME % 100 < 90)
    flight = FlightTrack.of(name="x", time_s=TIME, rotor_count=4, flying=flying)
    beats = ((t, float(10 <= t % 100 < 95)) for t in range(400))
    found = spans(flight, reported("armed", *beats))
    assert len(found) == 4
    assert found[1] == (BOOT + 102.5, BOOT + 202.5)


def test_a_flight_needs_motors_that_were_armed_and_above_idle():
    flight = track((100, 100))
    assert has_flight(flight, {})
    assert has_flight(flight, ARMED)
    assert not has_flight(flight, reported("armed", (0, 0), (390, 0)))
    assert not has_flight(track((20, 380)), ARMED)
    output = np.full((TIME.size, 4), 0.1)
    assert not has_flight(track((100, 100), throttle=output), ARMED)
    output[300] = 0.5
    assert has_flight(track((100, 100), throttle=output), ARMED)


def test_one_that_turned_over_before_it_rose_is_a_sortie_and_no_stretch_without_a_flight():
    """Two boots: in the first it lies on its side at half output, in the second nothing happens."""
    still = np.zeros((TIME.size, 3))
    on_its_side = still + np.radians([100.0, 0.0, 0.0])
    grounded = np.zeros(TIME.size, dtype=bool)
    made = [
        FlightTrack.of(
            name="x",
            time_s=TIME,
            rotor_count=4,
            flying=grounded,
            attitude=attitude,
            throttle=np.full((TIME.size, 4), 0.5),
        )
        for attitude in (on_its_side, still)
    ]
    assert [is_sortie(track, {}) for track in made] == [True, False]
