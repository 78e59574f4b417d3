"""Where the flight that goes on begins: as a file of the same rows is divided."""

import errno
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from tests.made_sources import sent
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState
from thrustmargin.gcs_plugin.live.watch.flight_so_far import SortieRows
from thrustmargin.gcs_plugin.live.watch.landed_flight import as_reported
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings, in_background
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.flight_log import flight_spans
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch

FLOWN, DOWN = 40.0, 20.0  # s of each flight, and of the stay between them


def day(*, tank: float, voltage: float, down: float) -> FlightTrack:
    """Two flights with so much more in tank (kg) and battery (V) after `down` s on the ground."""
    time_s = np.arange(0.0, 2 * FLOWN + down, 0.1)
    later = time_s >= FLOWN + down
    rows = time_s.size
    return FlightTrack.of(
        name="day",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=np.full((rows, 4), 1700.0),
        airspeed=np.zeros(rows),
        altitude=np.zeros(rows),
        tank_kg=4.0 + tank * later,
        voltage=AIRFRAME.ceiling_voltage - 6.0 + voltage * later,
        flying=(time_s < FLOWN) | later,
    )


def begins(track: FlightTrack, *, armed: bool) -> float:
    """s at which the flight that goes on began, followed in pieces of a second."""
    sorties, airframe_match = SortieRows(MODEL, Alarms(), lambda _: lambda: None), AirframeMatch()
    for first in range(0, track.time_s.size, 10):
        part = track.rows(slice(first, first + 10))
        on = armed or bool(part.flying.any())
        sorties.add(part, part.time_s, airframe_match, VehicleState(system=1, armed=on), ())
    sorties.make()
    assert sorties.now is not None
    return float(track.time_s[-1] - sorties.now.track.time_s[-1])


@pytest.mark.parametrize(
    ("tank", "voltage", "down", "armed", "other"),
    [
        (0.0, 0.0, DOWN, True, False),  # a touch-down
        (2.5, 0.0, DOWN, True, True),  # filled with the motors on
        (1.5, 0.0, DOWN, True, False),  # a gauge that sloshes
        (0.0, 4.0, DOWN, True, True),  # another battery
        (5.0, 0.0, 8.0, True, False),  # nobody fills in so little time
        (0.0, 0.0, DOWN, False, True),
        (0.0, 0.0, 70.0, True, True),
    ],
)
def test_a_refill_while_armed_divides_the_flight_as_it_divides_a_file(
    tank, voltage, down, armed, other
):
    track = day(tank=tank, voltage=voltage, down=down)
    began = begins(track, armed=armed)
    state = ((track.time_s < FLOWN) | track.flying | armed).astype(float)
    said = [
        Signal("armed", sent("HEARTBEAT base_mode"), track.time_s, state),
        Signal(
            "landed",
            sent("EXTENDED_SYS_STATE landed_state"),
            track.time_s,
            2.0 - (~track.flying).astype(np.float64),
        ),
    ]
    spans = flight_spans(track, 0.0, {one.channel: (one,) for one in said})
    assert len(spans) == 1 + other
    if other:
        assert FLOWN < began <= FLOWN + down
        assert began == pytest.approx(spans[-1][0], abs=1.1)  # a piece of a second
    else:
        assert began == 0.0


def test_a_battery_that_is_lower_after_the_stay_is_the_same():
    track = day(tank=0.0, voltage=-2.0, down=DOWN)
    assert begins(track, armed=True) == 0.0
    assert begins(replace(track, voltage=track.voltage * np.nan), armed=True) == 0.0


def test_what_the_end_of_listening_cuts_off_has_no_answer():
    begun, go_on = Event(), Event()
    pool = ThreadPoolExecutor(1)

    def first() -> str:
        begun.set()
        assert go_on.wait(100.0)
        return "landed"

    later = in_background(pool, pytest.fail)  # type: ignore[arg-type]
    running, waiting = later(first), later(lambda: "never")
    assert begun.wait(100.0)
    assert running() is None
    assert waiting() is None
    pool.shutdown(wait=False, cancel_futures=True)
    assert waiting() is None
    go_on.set()
    pool.shutdown()
    assert running() == "landed"


def test_a_flight_that_cannot_be_read_for_an_error_keeps_what_was_said_and_it_is_noted_once():
    noted: list[BaseException] = []
    with ThreadPoolExecutor(1) as pool:
        later = in_background(pool, noted.append)
        broken, sound = later(lambda: [][0]), later(lambda: "landed")
    assert (broken(), broken(), sound()) == (None, None, "landed")
    assert [type(error) for error in noted] == [IndexError]


def test_a_full_disk_leaves_a_flight_that_landed_with_what_was_said_so_far(monkeypatch):
    tlog = (ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog").read_bytes()
    assert as_reported(tlog, MODEL, WatchSettings(), system=1) is not None

    def full(*_) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    assert as_reported(tlog, MODEL, WatchSettings(), system=1) is None
