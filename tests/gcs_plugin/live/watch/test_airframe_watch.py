"""A vehicle that flies now is recognised, doubted and believed again, and never flickers."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.flight_channels import with_rotor_count
from tests.gcs_plugin.live.live_vehicle import ROOT, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL, metrics_of
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmSettings, RowsNow
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import esc, saturation
from thrustmargin.gcs_plugin.live.announce import figures
from thrustmargin.gcs_plugin.live.console import numbers
from thrustmargin.gcs_plugin.live.watch import airframe_watch
from thrustmargin.gcs_plugin.live.watch.airframe_watch import AirframeWatch
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import fields, reading, summary
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures
from thrustmargin.gcs_plugin.view.figures.charts import Speeds, chart_images
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.check_words import (
    airframe_match_words,
    described_words,
    no_verdict_words,
    statement_words,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.statement import state

AIRFRAME_NOT_YET = "airframe not known yet: hover 5 s"
FILE = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
LOG = read_log(FILE, airframe=AIRFRAME)
START = int(np.argmax(LOG.track.flying))


def watched(*, given: bool) -> AirframeWatch:
    return AirframeWatch(MODEL, given=given, source="udpin:127.0.0.1:14550")


def matches(watch: AirframeWatch, track: FlightTrack, first: int, end: int) -> list[AirframeMatch]:
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
    made = matches(watched(given=False), LOG.track, 0, LOG.track.time_s.size)
    waiting = [no_verdict_words(airframe_match) == [AIRFRAME_NOT_YET] for airframe_match in made]
    changes = np.flatnonzero(np.diff(waiting))
    assert changes.size == 1
    seconds = 0.5 * (changes[0] + 1) - 0.1 * START
    assert 4.0 < seconds < 8.0
    known = [
        airframe_match
        for airframe_match in made
        if no_verdict_words(airframe_match) != [AIRFRAME_NOT_YET]
    ]
    assert all(
        replace(airframe_match, outputs=known[0].outputs) == known[0] for airframe_match in known
    )
    assert known[0].basis == "recognised"


@pytest.mark.parametrize("given", [True, False])
def test_a_voltmeter_that_reads_too_much_at_rest_widens_the_margin_in_flight(given):
    # 58.8 V at rest are 14 cells at 4.20 V; 4 % more is 8.2 % of thrust. In flight they read less.
    track = replace(LOG.track, voltage=1.04 * LOG.track.voltage)
    made = matches(watched(given=given), track, 0, LOG.track.time_s.size)
    assert made[-1].outputs is not None
    assert made[-1].outputs.ceiling_high == pytest.approx(0.082, abs=0.002)
    assert not any(airframe_match.misfit for airframe_match in made)
    sound = matches(watched(given=given), LOG.track, 0, LOG.track.time_s.size)
    assert sound[-1].outputs is not None
    assert sound[-1].outputs.ceiling_high == 0.0


def test_on_the_ground_nothing_is_decided():
    ground = replace(LOG.track, flying=np.zeros_like(LOG.track.flying))
    waiting = matches(watched(given=False), ground, 0, 600)
    assert {tuple(no_verdict_words(c)) for c in waiting} == {(AIRFRAME_NOT_YET,)}
    assert {c.no_verdict for c in matches(watched(given=True), ground, 0, 600)} == {()}


@pytest.mark.parametrize("given", [True, False])
def test_another_battery_from_the_start_withholds_the_margin(given):
    track = with_volts(16.0, 0, LOG.track.time_s.size)
    made = matches(watched(given=given), track, START, START + 200)
    assert made[-1].no_verdict
    why = made[-1].no_verdict[0] if given else made[-1].unlike
    assert why is not None
    assert "16.0 V in flight" in statement_words(why)
    assert made[-1].basis == ("given" if given else "not known")


@pytest.mark.parametrize("given", [True, False])
def test_a_battery_that_collapses_later_is_a_finding_and_takes_no_identity_away(given):
    watch = watched(given=given)
    before = matches(watch, LOG.track, 0, START + 200)[-1]
    track = with_volts(30.0, START + 200, START + 1400)
    made = matches(watch, track, START + 200, START + 1400)
    assert not any(airframe_match.no_verdict for airframe_match in made)
    assert "30.0 V in flight" in statement_words(made[-1].misfit[0])
    assert "no longer fits" in described_words(made[-1])
    assert (made[-1].basis, airframe_match_words(made[-1])) == (
        before.basis,
        airframe_match_words(before),
    )
    assert np.count_nonzero(np.diff([bool(airframe_match.misfit) for airframe_match in made])) == 1
    # The battery is well again: so is the match.
    size = LOG.track.time_s.size
    assert matches(watch, LOG.track, START + 1400, min(START + 2600, size))[-1].misfit == ()


def test_the_next_flight_is_decided_anew_and_a_bounce_is_none():
    for rest, no_verdict in ((40, False), (60, True)):
        flying = LOG.track.flying.copy()
        flying[START + 200 : START + 200 + rest] = False
        track = replace(with_volts(16.0, START + 200, START + 700), flying=flying)
        made = matches(watched(given=True), track, 0, START + 700)
        assert bool(made[-1].no_verdict) == no_verdict
        assert bool(made[-1].misfit) != no_verdict


def test_a_doubt_that_has_gone_for_long_is_taken_back():
    watch = watched(given=True)
    assert matches(watch, with_volts(16.0, 0, START + 200), START, START + 200)[-1].no_verdict
    made = matches(watch, LOG.track, START + 200, START + 1600)
    assert made[-1].no_verdict == ()
    flips = np.flatnonzero(np.diff([bool(airframe_match.no_verdict) for airframe_match in made]))
    assert flips.size == 1


def test_two_looks_on_end_speak_against_an_airframe_and_four_for_it_again(monkeypatch):
    doubted = AirframeMatch(basis="given", no_verdict=(state("no voltage"),))
    looks = iter([True] * 3 + [False] * 3 + [True] + [False] * 5)
    made: list[bool] = []

    def compared(*_, **__) -> AirframeMatch:
        return doubted if next(looks) else AirframeMatch(basis="given")

    monkeypatch.setattr(airframe_watch, "match_airframe", compared)
    monkeypatch.setattr(airframe_watch, "FEWEST_ROWS", 1)
    monkeypatch.setattr(airframe_watch, "OPENING", 99.0)
    watch = watched(given=True)
    for at in range(START, START + 12 * 26, 26):  # 2.6 s each, and 2.5 s lie between looks
        part = LOG.track.rows(slice(at, at + 26))
        made.append(bool(watch.look(part, LOG.facts, LOG.parameters).no_verdict))
    assert made == [False, *[True] * 9, False, False]


def test_another_number_of_rotors_is_certain_at_once():
    six = LOG.track.rows(slice(0, 5))
    six = with_rotor_count(six, 6)
    watch = watched(given=True)
    assert watch.look(six, LOG.facts, LOG.parameters).no_verdict
    assert not watch.look(LOG.track.rows(slice(5, 10)), LOG.facts, LOG.parameters).no_verdict


def monitored(changed=lambda frame: frame, share=0.33, **settings) -> tuple[VehicleMonitor, list]:
    vehicle = VehicleMonitor(1, MODEL, WatchSettings(**settings))
    updates = []
    frames = [changed(frame) for frame in log_frames(FILE) if frame.system == 1]
    for at in range(0, int(share * len(frames)), 50):
        for frame in frames[at : at + 50]:
            vehicle.take(frame)
        updates += vehicle.updates()
    return vehicle, updates


def exchanged(frame: Frame) -> Frame:
    """With the speeds of ESC 1 and 3 in each other's place: the fourth array of its message."""
    if frame.id != 11030:  # ESC_TELEMETRY_1_TO_4
        return frame
    data, one = bytearray(frame.data), 10 + 24  # behind the header and three arrays
    three = one + 4
    data[one : one + 2], data[three : three + 2] = data[three : three + 2], data[one : one + 2]
    return frame._replace(data=bytes(data))


@pytest.mark.slow
def test_motors_in_another_order_are_an_alarm_and_take_the_places_away():
    vehicle, updates = monitored(exchanged, 0.4)
    alarm = vehicle.alarms.listed["motor order", None]
    assert (alarm.severity, alarm.state) == (4, "active")
    assert alarm.text == "Motor order differs: rotor names are wrong, check"
    assert updates[-1].flight.advice.rotor_names == ()
    page = aircraft_figures(ShownRow(updates[-1].analysis, -1), np.nan)
    assert {rotor["place"] for rotor in page["rotors"]} == {""}
    last = updates[-1].analysis
    charts = chart_images(last.places, Speeds.of(last), 0.0, window_s=20.0, future_share=0.0)
    assert (
        {chart["place"] for chart in charts}
        == {labels["name"] for labels, _ in metrics_of(vehicle)["thrustmargin_margin_ratio"]}
        == {""}
    )
    assert ("motor order", None) not in monitored(share=0.4)[0].alarms.listed
    now = RowsNow(analysis=updates[-1].analysis, rows=slice(-1, None))
    assert saturation(AlarmSettings(), now).text(0, 2) == "Rotor 3: no thrust left, slow down"
    flags = replace(now, esc_failures=np.full_like(now.analysis.utilisation, 4.0))
    assert esc(AlarmSettings(), flags).text(0, 1) == "ESC 2: too hot: land"


def stuck(frame: Frame) -> Frame:
    """With a tank gauge that stands at 12 kg."""
    if frame.id != 251 or not frame.payload[8:].startswith(b"TANK"):  # NAMED_VALUE_FLOAT
        return frame
    value = 10 + 4  # behind the header and the time
    data = frame.data[:value] + struct.pack("<f", 12.0) + frame.data[value + 4 :]
    return frame._replace(data=data)


@pytest.mark.slow
def test_a_gauge_that_stood_still_is_left_out_of_the_flight_so_far_from_its_start():
    flight = monitored(stuck, 0.55)[1][-1].flight
    assert np.nanmax(flight.track.tank_kg) == np.nanmin(flight.track.tank_kg[-600:]) == 12.0
    assert np.isnan(flight.measured.tank_kg).all()


def test_margins_are_withheld_on_every_screen_until_the_airframe_is_recognised():
    vehicle, updates = monitored(airframe_given=False)
    first = next(u for u in updates if u.analysis.track.flying[-1])
    assert no_verdict_words(first.analysis.airframe_match) == [AIRFRAME_NOT_YET]
    assert np.isnan(first.analysis.margin).all()
    assert numbers(first, 0.5)[0].plain == "NO VERDICT"
    assert AIRFRAME_NOT_YET in first.remarks[0]
    assert set(figures(first)) == set()
    shown = reading(first, 0.0)
    assert AIRFRAME_NOT_YET in summary(shown, 0.5, 0.0)[0]
    assert "NO VERDICT" in fields(shown, 0.5, 0.0)["Margin"][0]
    page = aircraft_figures(ShownRow(first.analysis, -1), np.nan)
    assert page["no_verdict"] == [AIRFRAME_NOT_YET]
    assert {rotor["left"] for rotor in page["rotors"]} == {None}
    last = updates[-1]
    assert last.analysis.airframe_match.basis == "recognised"
    assert np.isfinite(last.analysis.margin[-1]).all()
    assert "nobody named it, and the flight fits it" in last.remarks[0]
    assert "the flight fits it" in summary(reading(last, 0.0), 0.5, 0.0)[-1]
    assert sum("the flight fits it" in note for _, note in vehicle.notes) == 1


def test_an_alarm_about_the_margin_cannot_be_confirmed_when_the_margin_is_withheld():
    vehicle, updates = monitored()
    track = updates[-1].analysis.track
    doubted = AirframeMatch(no_verdict=(state("no voltage"),))
    analysis = updates[-1].analysis
    rows = track.time_s.size
    heavy = replace(analysis, utilisation=np.full_like(analysis.utilisation, 0.8))
    lost = np.full_like(analysis.utilisation, np.nan)
    no_verdict = replace(analysis, utilisation=lost, airframe_match=doubted)
    for second in range(30):
        vehicle.alarms.rows(
            heavy if second < 10 else no_verdict,
            rows - 1,
            clock_s=np.full(rows, 1000.0 + second),
            pumped_kg=np.full(rows, np.nan),
            virtual_kg=np.full(rows, np.nan),
        )
        if second == 9:
            assert ("margin", None) in vehicle.alarms.listed
    unsure = vehicle.alarms.listed["margin", None]
    assert (unsure.state, unsure.missing) == ("unconfirmed", "verdict")
    assert "does not fit" in vehicle.alarms.listed["airframe", None].text
