"""The metrics of a monitor, read as Prometheus reads them."""

import json
import re
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from dataclasses import replace
from importlib import resources
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.gcs_plugin.live.live_vehicle import command, first_part, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME, MODEL, Ground
from tests.gcs_plugin.peers.ports import free_port, free_udp_port
from tests.waiting import until
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmSettings
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings, MonitorStatus
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.office.streams.collector import (
    COUNTS,
    FIGURES,
    LEVELS,
    MetricsServer,
    MonitorCollector,
    part_of,
)
from thrustmargin.models.errors import LinkError
from thrustmargin.models.model.analysis import analyse

Samples = dict[str, list[tuple[dict[str, str], float]]]


def scraped(port: int) -> Samples:
    """Name of a sample -> its labels and value."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=100) as answer:
        text = answer.read().decode()
    found: Samples = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, []).append((sample.labels, sample.value))
    return found


@pytest.fixture(scope="module")
def flown(tmp_path_factory, sitl_logs) -> SimpleNamespace:
    """A minute of a flight heard over UDP: metrics at its last row, and when that is old."""
    folder = tmp_path_factory.mktemp("metrics")
    log = first_part(sitl_logs / "campaign" / "v4_m10_q3.5.tlog", 60.0, folder)
    frames = log_frames(log)
    ground = Ground(frames[0].stamp_us)
    watch = WatchSettings(alarms=AlarmSettings(max_utilisation=0.3))
    settings = MonitorSettings(urls=("udpin:127.0.0.1:0",), record=folder / "rec", watch=watch)
    with ground.in_listeners():
        monitor = LiveMonitor(MODEL, settings)
    served = MetricsServer(MonitorCollector(monitor), 0)
    with monitor, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        unheard = scraped(served.port)
        address = monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
        for sent, frame in enumerate(frames, start=1):
            ground.us = frame.stamp_us
            out.sendto(frame.data, address)
            while monitor.status().frames < sent:
                time.sleep(0.0005)
        fresh: Samples = {}
        track = read_log(log, airframe=AIRFRAME, sampling="hold").track

        def last_row() -> bool:
            fresh.clear()
            fresh.update(scraped(served.port))
            shown = fresh.get("thrustmargin_tank_kg", [])
            age = fresh.get("thrustmargin_figures_age_seconds", [({}, 9.0)])
            return bool(shown) and age[0][1] < 0.15

        until(last_row)
        ground.us += 2_500_000
        old = scraped(served.port)
        served.close()
    monitor.check()
    return SimpleNamespace(
        unheard=unheard,
        fresh=fresh,
        old=old,
        frames=len(frames),
        analysis=analyse(track, MODEL),
    )


@pytest.mark.slow
def test_the_address_is_said_and_is_of_this_computer_alone():
    link, port = free_udp_port(), free_port()
    monitor = command(
        *("monitor", f"udpin:127.0.0.1:{link}", "--no-view", "--metrics", str(port), "--silent"),
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert monitor.stderr is not None
        assert monitor.stderr.readline() == f"metrics: http://127.0.0.1:{port}/metrics\n"
        assert scraped(port)["thrustmargin_vehicles"] == [({}, 0.0)]
    finally:
        monitor.send_signal(signal.SIGINT)
        monitor.communicate(timeout=120)


def test_before_anything_is_heard_there_is_no_figure(flown):
    assert flown.unheard["thrustmargin_vehicles"] == [({}, 0.0)]
    assert flown.unheard["thrustmargin_link_frames_total"] == [({}, 0.0)]
    assert not [name for name in flown.unheard if "margin_ratio" in name]


def test_margins_and_use_are_those_of_the_flight_read_from_its_file(flown):
    margin, use = flown.analysis.margin[-1], flown.analysis.known_utilisation[-1]
    assert np.isfinite(margin).all()
    found = {labels["rotor"]: value for labels, value in flown.fresh["thrustmargin_margin_ratio"]}
    assert found == pytest.approx({str(k + 1): m for k, m in enumerate(margin)}, abs=1e-9)
    found = {labels["rotor"]: v for labels, v in flown.fresh["thrustmargin_utilisation_ratio"]}
    assert found == pytest.approx({str(k + 1): u for k, u in enumerate(use)}, abs=1e-9)
    labels, _ = flown.fresh["thrustmargin_margin_ratio"][0]
    assert labels == {"vehicle": "1", "rotor": "1", "name": "front right", "basis": "measured"}
    ((_, tank),) = flown.fresh["thrustmargin_tank_kg"]
    assert tank == pytest.approx(flown.analysis.track.tank_kg[-1], abs=1e-9)


def test_the_interval_is_around_the_margin(flown):
    low, middle, high = (
        np.array([v for _, v in flown.fresh[f"thrustmargin_margin{part}_ratio"]])
        for part in ("_low", "", "_high")
    )
    assert ((low <= middle) & (middle <= high)).all()


def test_what_comes_in_is_counted(flown):
    assert flown.fresh["thrustmargin_link_frames_total"] == [({}, float(flown.frames))]
    assert flown.fresh["thrustmargin_link_bad_checksum_total"] == [({}, 0.0)]
    assert flown.fresh["thrustmargin_vehicles"] == [({}, 1.0)]
    missing = flown.fresh["thrustmargin_link_missing_frames"]
    assert [labels for labels, _ in missing] == [{"vehicle": "1", "component": "1"}]


def test_an_alarm_that_stands_has_its_level(flown):
    found = {labels["alarm"]: labels for labels, _ in flown.fresh["thrustmargin_alarm"]}
    assert found["margin"]["level"] == "warning"
    assert found["margin"]["vehicle"] == "1"
    assert flown.fresh["thrustmargin_margin_least_ratio"] == [({}, 0.7)]


def test_an_old_figure_is_left_out_and_its_age_says_why(flown):
    assert {f"thrustmargin_{name}" for name in FIGURES} & flown.old.keys() == set()
    ((_, age),) = flown.old["thrustmargin_figures_age_seconds"]
    assert age > 1.5
    ((_, silence),) = flown.old["thrustmargin_silence_seconds"]
    assert silence > 1.0
    assert flown.old["thrustmargin_vehicles"] == [({}, 1.0)]
    assert "thrustmargin_alarm" in flown.old


def test_the_dashboard_draws_what_there_is(flown):
    text = (
        resources.files("thrustmargin.gcs_plugin.office.streams") / "grafana_dashboard.json"
    ).read_text("utf-8")
    dashboard = json.loads(text)
    drawn = {
        name
        for panel in dashboard["panels"]
        for target in panel["targets"]
        for name in re.findall(r"thrustmargin_\w+", target["expr"])
    }
    there = flown.fresh.keys() | {"thrustmargin_field_age_seconds"}
    assert drawn <= there
    for said in ("margin_ratio", "alarm", "figures_age_seconds", "link_missing_frames"):
        assert f"thrustmargin_{said}" in drawn
    # A line that goes on over a gap would show a margin that nobody knows.
    lines = [p for p in dashboard["panels"] if "margin_ratio" in str(p) and p["type"] != "table"]
    assert all(not p["fieldConfig"]["defaults"]["custom"]["spanNulls"] for p in lines)


@pytest.fixture(scope="module")
def watched(tmp_path_factory, sitl_logs):
    """A monitor that has read 80 s of a flight, to its last row in the air."""
    folder = tmp_path_factory.mktemp("watched")
    log = first_part(sitl_logs / "campaign" / "v4_m10_q3.5.tlog", 80.0, folder)
    with LiveMonitor(MODEL, MonitorSettings(urls=(str(log),))) as monitor:
        monitor.wait(100.0)
        yield monitor


def figures(monitor: LiveMonitor, monkeypatch, **changed: Any) -> Samples:
    """Its metrics with the newest analysis changed so."""
    watch = monitor.fleet.vehicles[1]
    assert watch.last is not None
    of_now = replace(watch.last, analysis=replace(watch.last.analysis, **changed))
    monkeypatch.setattr(watch, "last", of_now)
    return {
        family.name: [(sample.labels, sample.value) for sample in family.samples]
        for family in MonitorCollector(monitor).collect()
    }


def test_each_figure_is_that_of_the_newest_row(watched, monkeypatch):
    last = watched.fleet.vehicles[1].last
    rows = last.analysis.track.time_s.size
    assert last.analysis.track.flying.all()
    use = np.linspace(0.7, 0.4, rows)[:, None] - np.array([0.0, 0.01, 0.02, 0.03])
    found = figures(watched, monkeypatch, utilisation_predicted=use)
    assert found["thrustmargin_margin_predicted_ratio"] == [({"vehicle": "1"}, pytest.approx(0.6))]
    assert found["thrustmargin_flying"] == [({"vehicle": "1"}, 1.0)]
    basis = [labels["basis"] for labels, _ in found["thrustmargin_margin_ratio"]]
    assert basis == ["measured"] * 4
    silent = last.analysis.utilisation.copy()
    silent[-1] = np.nan
    found = figures(watched, monkeypatch, utilisation=silent, utilisation_predicted=use)
    now = [(labels["basis"], value) for labels, value in found["thrustmargin_margin_ratio"]]
    assert now == [("predicted", pytest.approx(0.6 + 0.01 * rotor)) for rotor in range(4)]


def test_on_the_ground_no_rotor_has_a_margin(watched, monkeypatch):
    track = watched.fleet.vehicles[1].last.analysis.track
    down = track.flying.copy()
    down[-1] = False
    found = figures(watched, monkeypatch, track=replace(track, flying=down))
    assert found["thrustmargin_flying"] == [({"vehicle": "1"}, 0.0)]
    assert found["thrustmargin_margin_ratio"] == found["thrustmargin_utilisation_ratio"] == []
    up = ~down
    found = figures(watched, monkeypatch, track=replace(track, flying=up))
    assert found["thrustmargin_flying"] == [({"vehicle": "1"}, 1.0)]
    assert len(found["thrustmargin_margin_ratio"]) == 4


def test_an_aircraft_that_is_not_known_has_no_margin_and_says_so(watched, monkeypatch):
    airframe_match = replace(
        watched.fleet.vehicles[1].last.analysis.airframe_match, no_verdict=("another aircraft",)
    )
    found = figures(watched, monkeypatch, airframe_match=airframe_match)
    assert found["thrustmargin_margin_ratio"] == []
    assert found["thrustmargin_no_verdict"] == [({"vehicle": "1"}, 1.0)]
    assert found["thrustmargin_flying"] == [({"vehicle": "1"}, 1.0)]


def test_the_interval_of_a_margin_is_turned_round(watched, monkeypatch):
    analysis = watched.fleet.vehicles[1].last.analysis
    use = np.full_like(analysis.utilisation, 0.4)
    error = np.full_like(use, 0.1)
    found = figures(watched, monkeypatch, utilisation=use, utilisation_error=error)
    # 90 % lie within 1.645 standard errors: margins from 0.4355 to 0.7645 or, of one that is
    # known to use less, to less.
    low, high = (found[f"thrustmargin_margin_{end}_ratio"][0][1] for end in ("low", "high"))
    assert low == pytest.approx(0.6 - 0.1645, abs=1e-3)
    assert 0.6 < high <= 0.7645 + 1e-3


def test_of_two_vehicles_with_one_id_there_are_no_figures(watched, monkeypatch):
    assert figures(watched, monkeypatch)["thrustmargin_margin_ratio"]
    monkeypatch.setattr(watched.fleet.vehicles[1].link, "shared_until_us", 2**62)
    found = figures(watched, monkeypatch)
    assert found["thrustmargin_margin_ratio"] == found["thrustmargin_flying"] == []


@pytest.mark.parametrize(
    ("basis", "shown"), [("motor outputs", [({"vehicle": "1"}, 0.6)]), ("height", [])]
)
def test_of_an_aircraft_that_is_not_known_its_motor_outputs_are_shown(
    watched, monkeypatch, basis: str, shown: list
):
    contact = SimpleNamespace(basis=basis, median_use=0.6, worst_use=0.8)
    answer = SimpleNamespace(contact=contact, gravity=3.0, fill_kg=7.5)
    watch = watched.fleet.vehicles[1]
    flight: Any = SimpleNamespace(answer=answer)
    monkeypatch.setattr(watch, "last", replace(watch.last, flight=flight))
    found = figures(watched, monkeypatch)
    assert found["thrustmargin_outputs_median_ratio"] == shown
    assert [v for _, v in found["thrustmargin_outputs_most_ratio"]] == [0.8] * len(shown)
    assert found["thrustmargin_flight_level"] == [({"vehicle": "1"}, 3.0)]
    assert found["thrustmargin_next_fill_kg"] == [({"vehicle": "1"}, 7.5)]


def test_a_vehicle_that_is_gone_on_the_ground_is_none(watched, monkeypatch):
    assert figures(watched, monkeypatch)["thrustmargin_vehicles"] == [({}, 1.0)]
    monkeypatch.setattr(type(watched.fleet.vehicles[1]), "has_left", lambda *_: True)
    found = figures(watched, monkeypatch)
    assert found["thrustmargin_vehicles"] == [({}, 0.0)]
    assert found["thrustmargin_figures_age_seconds"] == found["thrustmargin_alarm"] == []


@pytest.mark.parametrize(("trouble", "works"), [("", 1.0), ("disk full", 0.0)])
def test_a_recorder_in_trouble_does_not_record(watched, monkeypatch, trouble: str, works: float):
    recorder = SimpleNamespace(trouble=trouble, frames_lost=7)
    status = replace(watched.status(), recorder=recorder, behind_s=0.25)
    monkeypatch.setattr(watched, "status", lambda: status)
    found = figures(watched, monkeypatch)
    assert found["thrustmargin_recording"] == [({}, works)]
    assert found["thrustmargin_recording_lost_frames"][0] == ({}, 7.0)
    assert found["thrustmargin_behind_seconds"] == [({}, 0.25)]


class Nothing:
    def collect(self):
        return ()


def test_a_name_that_a_web_page_points_here_gets_nothing():
    served = MetricsServer(Nothing(), 0)  # type: ignore[arg-type]
    try:
        asked = urllib.request.Request(served.url, headers={"Host": "evil.example:9464"})
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(asked, timeout=100)
        assert refused.value.code == 403
        with urllib.request.urlopen(served.url, timeout=100) as answer:
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
    finally:
        served.close()


def test_a_port_in_use_is_an_error_that_names_the_option():
    served = MetricsServer(Nothing(), 0)  # type: ignore[arg-type]
    try:
        port = served.url.removesuffix("/metrics").rpartition(":")[2]
        with pytest.raises(LinkError, match=f"--metrics {port} cannot be opened"):
            MetricsServer(Nothing(), int(port))  # type: ignore[arg-type]
    finally:
        served.close()
    with pytest.raises(LinkError, match="a port from 0 to 65535"):
        MetricsServer(Nothing(), 70_000)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rotor", "rotors", "part"),
    [(3, (), "rotor 3"), (None, (1, 2), "rotor 1 or 2"), (None, (), "")],
)
def test_the_part_of_an_alarm_is_a_rotor_or_none(rotor, rotors, part: str):
    alarm = Alarm("rotor", rotor, 4, "text", 0.0, rotors=rotors)
    assert part_of(alarm) == part
    assert LEVELS[alarm.severity] == "warning"


def test_every_count_is_one_of_the_monitor():
    assert COUNTS.keys() <= set(MonitorStatus.__dataclass_fields__)
