"""Frozen instruments while a flight goes on: from when on they are left out."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from tests.made_sources import sent
from tests.models.checks.test_output_evidence import SQUARE, hover
from thrustmargin.gcs_plugin.live.watch.prepared_rows import FrozenWatch
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.provenance import SourceKind


def shown(track: FlightTrack, watch: FrozenWatch | None = None) -> FlightTrack:
    """A flight as a listener has it, in pieces of seven rows."""
    watch = FrozenWatch(AIRFRAME) if watch is None else watch
    pieces = [slice(first, first + 7) for first in range(0, track.time_s.size, 7)]
    made = [watch.without_frozen(track.rows(piece), SQUARE) for piece in pieces]
    whole = made[0]
    for part in made[1:]:
        whole = whole.followed_by(part)
    return whole


def test_a_voltage_that_stands_still_is_left_out_after_the_first_minute_until_it_moves():
    volts = np.full(900, 58.8)
    volts[850:] = 58.7
    found = shown(replace(hover(9.0), voltage=volts))
    unknown = found.time_s[np.isnan(found.voltage)]
    assert 60.0 <= unknown[0] <= 72.0
    assert unknown[-1] == pytest.approx(84.9, abs=0.7)
    assert np.isfinite(found.voltage[:600]).all()
    falling = replace(hover(9.0), voltage=np.linspace(58.8, 58.0, 900))
    assert np.isfinite(shown(falling).voltage).all()


def test_the_rows_say_why_the_channel_is_none():
    frozen = replace(hover(9.0), voltage=np.full(900, 58.8))
    assert shown(frozen).source("voltage").kind is SourceKind.ABSENT
    assert statement_words(shown(frozen).statements[-1]).startswith(
        "battery voltage stood at 58.8 V"
    )


def test_a_gauge_that_stands_still_while_the_aircraft_grows_lighter_is_left_out():
    emptied = hover(np.linspace(16.0, 4.0, 900), gauge=4.0)
    assert np.isnan(shown(emptied).tank_kg[-1])
    carried = hover(9.0, gauge=4.0)
    assert np.isfinite(shown(carried).tank_kg).all()


def test_an_airspeed_that_stands_while_the_aircraft_tilts_is_left_out():
    still = replace(
        hover(9.0),
        airspeed=np.full(900, 4.8),
        sources={**hover(9.0).sources, "airspeed": sent("VFR_HUD")},
    )
    tilt = 0.01 * np.random.default_rng(7).standard_normal((900, 3))
    # A hover that is held is no sign of it.
    assert np.isfinite(shown(replace(still, attitude=tilt)).airspeed).all()
    tilt[:, 1] = 0.1 * np.sin(np.arange(900) / 30.0)
    found = shown(replace(still, attitude=tilt))
    assert np.isnan(found.airspeed[-1])
    assert statement_words(found.statements[-1]).startswith("airspeed reading stood at 4.8 m/s")


def test_the_next_flight_is_looked_at_by_itself():
    watch = FrozenWatch(AIRFRAME)
    first = replace(hover(9.0), voltage=np.full(900, 58.8))
    shown(first, watch)
    later = replace(first, time_s=first.time_s + 200.0)
    again = shown(later, watch)
    assert np.isfinite(again.voltage[:590]).all()
    assert np.isnan(again.voltage[-1])


def test_a_monitor_shows_no_voltage_of_an_instrument_that_stands_still():
    monitor, vehicle = VehicleMonitor(1, MODEL, WatchSettings()), Vehicle()
    volts, said = [], []
    for k in range(900):
        for frame in vehicle.tick():
            monitor.take(frame)
        if k % 10 == 9:
            for update in monitor.updates():
                volts += update.analysis.track.voltage[update.first :].tolist()
                said += update.notes
    assert np.isfinite(volts[300])
    assert np.isnan(volts[-1])
    assert any(
        words.startswith("battery voltage stood at 50 V") for words in map(statement_words, said)
    )
