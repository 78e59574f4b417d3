"""A vehicle that flies now is recognised, doubted and believed again, and never flickers."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL
from thrustmargin.gcs_plugin.live.announce import figures
from thrustmargin.gcs_plugin.live.console import numbers
from thrustmargin.gcs_plugin.live.watch.airframe_watch import AirframeWatch
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor, WatchSettings
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavproxy_worker import fields, reading, summary
from thrustmargin.gcs_plugin.view.figures.gauges import gauges_html
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.live_words import AIRFRAME_NOT_YET
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_claim import AirframeClaim

FILE = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
LOG = read_log(FILE, airframe=AIRFRAME)
START = int(np.argmax(LOG.track.flying))


def watched(*, given: bool) -> AirframeWatch:
    return AirframeWatch(MODEL, given=given, source="udpin:127.0.0.1:14550")


def claims(watch: AirframeWatch, track: FlightTrack, first: int, end: int) -> list[AirframeClaim]:
    """What is decided after each half second of the rows from `first` to `end`."""
    return [
        watch.look(track.rows(slice(at, at + 5)), LOG.facts, LOG.parameters)
        for at in range(first, end, 5)
    ]


def with_volts(volts: float, first: int, end: int) -> FlightTrack:
    voltage = LOG.track.voltage.copy()
    voltage[first:end] = volts
    return replace(LOG.track, voltage=voltage)


def test_an_airframe_that_nobody_gave_is_known_after_some_seconds_in_flight_and_stays():
    made = claims(watched(given=False), LOG.track, 0, LOG.track.time_s.size)
    waiting = [claim.withheld == (AIRFRAME_NOT_YET,) for claim in made]
    changes = np.flatnonzero(np.diff(waiting))
    assert changes.size == 1
    seconds = 0.5 * (changes[0] + 1) - 0.1 * START
    assert 4.0 < seconds < 8.0
    known = [claim for claim in made if claim.withheld != (AIRFRAME_NOT_YET,)]
    assert all(claim is known[0] for claim in known)
    assert known[0].basis == "recognised"


def test_on_the_ground_nothing_is_decided():
    ground = replace(LOG.track, flying=np.zeros_like(LOG.track.flying))
    assert {c.withheld for c in claims(watched(given=False), ground, 0, 600)} == {
        (AIRFRAME_NOT_YET,)
    }
    assert {c.withheld for c in claims(watched(given=True), ground, 0, 600)} == {()}


@pytest.mark.parametrize("given", [True, False])
def test_another_battery_withholds_the_margin_and_a_moment_of_it_does_not(given):
    watch = watched(given=given)
    at = START + 300
    # 3 s of a wrong reading are not the median of the last minute.
    track = with_volts(16.0, at, at + 30)
    assert not any(c.withheld for c in claims(watch, track, START, at + 200)[20:])
    track = with_volts(16.0, at + 200, at + 1200)
    made = claims(watch, track, at + 200, at + 1200)
    assert "16.0 V in flight" in made[-1].withheld[0]
    assert made[-1].basis == ("given" if given else "not known")
    assert np.count_nonzero(np.diff([bool(claim.withheld) for claim in made])) == 1


def test_a_doubt_that_has_gone_for_long_is_taken_back():
    watch = watched(given=True)
    assert claims(watch, with_volts(16.0, 0, START + 200), START, START + 200)[-1].withheld
    made = claims(watch, LOG.track, START + 200, START + 1600)
    assert made[-1].withheld == ()
    flips = np.flatnonzero(np.diff([bool(claim.withheld) for claim in made]))
    assert flips.size == 1


def test_another_number_of_rotors_is_certain_at_once():
    six = LOG.track.rows(slice(0, 5))
    wide = np.tile(six.rotor_speed_rpm[:, :1], 6)
    six = replace(six, rotor_speed_rpm=wide, throttle=wide)
    watch = watched(given=True)
    assert watch.look(six, LOG.facts, LOG.parameters).withheld
    assert not watch.look(LOG.track.rows(slice(5, 10)), LOG.facts, LOG.parameters).withheld


def monitored(**settings) -> tuple[VehicleMonitor, list]:
    vehicle = VehicleMonitor(1, MODEL, WatchSettings(**settings))
    updates = []
    frames = [frame for frame in log_frames(FILE) if frame.system == 1]
    for at in range(0, len(frames) // 3, 25):
        for frame in frames[at : at + 25]:
            vehicle.take(frame)
        updates += vehicle.updates()
    return vehicle, updates


def test_margins_are_withheld_on_every_screen_until_the_airframe_is_recognised():
    vehicle, updates = monitored(airframe_given=False)
    first = next(u for u in updates if u.analysis.track.flying[-1])
    assert first.analysis.withheld == (AIRFRAME_NOT_YET,)
    assert np.isnan(first.analysis.margin).all()
    assert numbers(first, 0.5)[0].plain == "NO VERDICT"
    assert AIRFRAME_NOT_YET in first.remarks[0]
    assert set(figures(first)) == set()
    shown = reading(first, 0.0)
    assert AIRFRAME_NOT_YET in summary(shown, 0.5, 0.0)[0]
    assert "NO VERDICT" in fields(shown, 0.5, 0.0)["Margin"][0]
    html = gauges_html(ShownRow(first.analysis, -1), "vehicle 1")
    assert "NO VERDICT" in html
    assert AIRFRAME_NOT_YET in html
    last = updates[-1]
    assert last.analysis.claim.basis == "recognised"
    assert np.isfinite(last.analysis.margin[-1]).all()
    assert last.remarks[0].endswith("none was given")
    assert "recognised" in summary(reading(last, 0.0), 0.5, 0.0)[-1]
    assert any("recognised" in note for _, note in vehicle.notes)


def test_an_alarm_about_the_margin_ends_when_the_margin_is_withheld():
    vehicle, updates = monitored()
    track = updates[-1].analysis.track
    doubted = AirframeClaim(withheld=("another battery",))
    analysis = updates[-1].analysis
    rows = track.time_s.size
    heavy = replace(analysis, utilisation=np.full_like(analysis.utilisation, 0.8))
    lost = np.full_like(analysis.utilisation, np.nan)
    withheld = replace(analysis, utilisation=lost, claim=doubted)
    for second in range(30):
        vehicle.alarms.rows(
            heavy if second < 10 else withheld,
            rows - 1,
            clock_s=np.full(rows, 1000.0 + second),
            pumped_kg=np.full(rows, np.nan),
            virtual_kg=np.full(rows, np.nan),
        )
        if second == 9:
            assert ("margin", None) in vehicle.alarms.standing
    assert ("margin", None) not in vehicle.alarms.standing
    assert "does not fit" in vehicle.alarms.standing["airframe", None].text
