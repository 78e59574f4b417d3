"""A listener without a gauge: the load that hover thrust has shown so far, and what is stated."""

from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from thrustmargin.gcs_plugin.live.console import numbers
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.provenance import Meaning

NINETY = 1.645  # standard errors to either side of a normal that hold 90 %
LOG = Path("sitl_logs/campaign/v4_m16_q2.5.tlog")


@pytest.fixture(scope="module")
def frames():
    return [frame for frame in log_frames(LOG) if frame.system == 1]


def watched(frames, **settings) -> list[Update]:
    monitor = VehicleMonitor(1, MODEL, WatchSettings(**settings))
    made: list[Update] = []
    for place, frame in enumerate(frames):
        monitor.take(frame)
        if place % 200 == 0:
            made += monitor.updates()
    return made + monitor.updates(final=True)


@pytest.mark.slow
def test_the_load_is_inferred_as_the_flight_goes_and_named_as_that(frames):
    made = watched(frames, tank="none")
    gauge = read_log(LOG, airframe=AIRFRAME, sampling="hold").track
    off, reach = [], []
    for update in made:
        track, new = update.analysis.track, slice(update.first, None)
        known = np.isfinite(track.tank_kg[new]) & track.flying[new]
        level = np.interp(track.time_s[new], gauge.time_s, gauge.tank_kg)
        off += list(np.abs(track.tank_kg[new] - level)[known])
        if known.any():
            reach += list(NINETY * track.standard_errors["tank_kg"][new][known])
    assert len(off) > 1500
    assert np.mean(off) < 0.6
    assert np.mean(np.array(off) < reach) > 0.9
    last = made[-1]
    assert last.analysis.track.source("tank_kg").meaning is Meaning.HOVER_THRUST
    assert "so far" in source_words(last.analysis.track.source("tank_kg"))
    assert any("inferred from hover thrust" in remark for remark in last.remarks)
    flown = [u for u in made if np.isfinite(u.analysis.track.tank_kg[-1])]
    assert any(str(cell).startswith("≈ ") for cell in numbers(flown[0], 0.5))
    # An inferred load cannot contradict the pump or the thrust that it was inferred from.
    texts = {event.alarm.text for update in made for event in update.events}
    assert not any("gauge" in text or "leak" in text for text in texts)


@pytest.mark.slow
def test_a_stated_load_falls_with_the_pump_down_to_its_end(frames):
    made = watched(frames, load=8.0, load_end=4.0)
    load = np.concatenate([u.analysis.track.tank_kg[u.first :] for u in made])
    assert load[0] == 8.0
    assert load[-1] == 4.0
    assert np.all(np.diff(load) <= 0.0)
    words = source_words(made[-1].analysis.track.source("tank_kg"))
    assert words.endswith("falling with the pump's output, at least 4 kg")


def test_only_the_vehicle_that_is_asked_for_is_watched(frames):
    for vehicle, heard in ((2, []), (1, [1]), (None, [1])):
        fleet = Fleet(MODEL, WatchSettings(vehicle=vehicle))
        fleet.take(frames[:500])
        fleet.updates()
        assert list(fleet.vehicles) == heard
