"""What goes out, heard by pymavlink as ground station and as vehicle, over loopback UDP."""

import math
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle
from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent, AlarmState
from thrustmargin.gcs_plugin.live.announce import Announcer, plain, what_to_do
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.mavlink.frame import frame_of
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
CRITICAL = 2
WARNING = 4

COMPONENT = 25  # MAV_COMP_ID_USER1
MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


class Air:
    """A vehicle in real time that the monitor hears, and what comes back to it."""

    def __init__(self, port: int, system: int = 1) -> None:
        self.vehicle = Vehicle(system)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.parser = dialect.MAVLink(None)
        self.heard: list[Any] = []

    def fly(self, seconds: float, **options: Any) -> None:
        for _ in range(round(seconds * 10)):
            for frame in self.vehicle.tick(**options):
                self.socket.send(frame.data)
            time.sleep(0.1)
            self.listen()

    def listen(self) -> None:
        while True:
            try:
                data = self.socket.recv(65535)
            except BlockingIOError:
                return
            self.heard += self.parser.parse_buffer(data) or []

    def kinds(self) -> set[str]:
        return {message.get_type() for message in self.heard}


@contextmanager
def monitored(*, forward: bool = False, **speaking: Any) -> Iterator[tuple[LiveMonitor, Air, Any]]:
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="ardupilotmega")
    forwards = (f"udpout:127.0.0.1:{station.port.getsockname()[1]}",) if forward else ()
    monitor = LiveMonitor(MODEL, MonitorSettings(urls=("udpin:127.0.0.1:0",), forwards=forwards))
    sender = Sender(monitor.listener, speaking.get("sign"))
    if speaking.get("announce"):
        battery = bool(speaking.get("battery"))
        monitor.outputs.append(Announcer(sender, battery=battery))
    monitor.start()
    air = Air(monitor.listener.links[0].transport.address[1])  # type: ignore[attr-defined]
    try:
        yield monitor, air, station
    finally:
        monitor.close()
        air.socket.close()
        station.close()
    monitor.check()


def heard_by(station: Any) -> list[Any]:
    found = []
    while (message := station.recv_match()) is not None:
        found.append(message)
    return found


@pytest.mark.slow
def test_a_ground_station_behind_a_forward_sees_alarms_and_figures():
    with monitored(forward=True, announce=True, battery=True) as (_, air, station):
        messages, began = [], time.monotonic()
        for _ in range(4):  # its socket does not hold it all
            air.fly(3.0, rpm=(2200, 2200, 2300, 2200))
            messages += heard_by(station)
        took = time.monotonic() - began
    ours = [m for m in messages if m.get_srcComponent() == COMPONENT]
    assert {m.get_srcSystem() for m in ours} == {1}
    texts = [(m.severity, m.text) for m in ours if m.get_type() == "STATUSTEXT"]
    assert [t[0] for t in texts if "Thrust left" in t[1]] == [WARNING], texts
    assert all(len(text) <= 50 for _, text in texts)
    figures = [m for m in ours if m.get_type() == "NAMED_VALUE_FLOAT"]
    margin = [m.value for m in figures if m.name == "MARGIN"]
    # 3000 rpm at 58.8 V, and the ESCs report 50 V.
    assert margin[-1] == pytest.approx(100 * (1 - (2300 / (3000 * 50 / 58.8)) ** 2), abs=0.1)
    assert 4 <= len(margin) <= took + 1.0  # once a second
    said = {m.name: m.value for m in figures}
    assert (said["MARGIN_ROT"], said["MARGIN_LIM"]) == (3.0, 50.0)
    assert said["MARGIN_DO"] == 2.0  # fly gently
    assert "TANK" not in said
    # Margin and tank as batteries that nobody takes for the battery; 10 of 16 kg are in it.
    extra = {m.id: m for m in ours if m.get_type() == "BATTERY_STATUS"}
    assert {number: m.battery_remaining for number, m in extra.items()} == {
        90: math.floor(margin[-1]),
        91: 62,
    }
    for message in extra.values():
        assert set(message.voltages) == {65535}
        assert (message.current_battery, message.current_consumed) == (-1, -1)
        assert message.battery_function == 4  # MAV_BATTERY_FUNCTION_PAYLOAD
        assert message.charge_state == 0
    assert (6, "No battery: 90 is thrust left %, 91 tank %") in texts
    # The vehicle's own messages passed unchanged beside them.
    assert any(m.get_srcComponent() == 1 for m in messages)


def test_nothing_is_sent_to_the_vehicle_unless_asked():
    with monitored(forward=True) as (_, air, _station):
        air.fly(2.0, rpm=(2300,) * 4)
        assert air.heard == []


def test_what_is_sent_is_signed_when_the_link_is():
    key = bytes(range(32))
    door = SigningFilter(key)
    with monitored(announce=True, sign=Signer(key).sign) as (_, air, _station):
        frames: list[bytes] = []
        for _ in range(15):
            for frame in air.vehicle.tick():
                air.socket.send(frame.data)
            time.sleep(0.1)
            try:
                while True:
                    frames.append(air.socket.recv(65535))
            except BlockingIOError:
                pass
    assert len(frames) > 3
    assert all(door.accept(frame) for frame in frames)
    ids = {found.id for frame in frames if (found := frame_of(frame))}
    assert 251 in ids  # NAMED_VALUE_FLOAT
    assert 147 not in ids  # BATTERY_STATUS, unless it is asked for


class Sent:
    """In place of a link: keeps what is sent."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []

    def send(self, data: bytes, *, system: int | None = None, forwards: bool = False) -> None:
        del system, forwards
        self.frames.append(data)


def texts(sent: Sent) -> list[tuple[int, str]]:
    parser = dialect.MAVLink(None)
    messages: list[Any] = [m for data in sent.frames for m in parser.parse_buffer(data) or []]
    return [(m.severity, m.text) for m in messages if m.get_type() == "STATUSTEXT"]


def test_texts_are_one_a_second_gravest_first_and_a_flood_is_cut():
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet = Fleet(MODEL)
    vehicle = Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    for number in range(20):
        alarm = Alarm("rotor", number, CRITICAL if number == 13 else WARNING, f"alarm {number}", 0)
        announcer.on_event(1, AlarmEvent(alarm, AlarmState.CLEARED, 0.0))
    for _ in range(100):
        fleet.take(vehicle.tick())
        announcer.on_round(fleet, vehicle.stamp_us)
    said = texts(sent)
    assert said[0] == (CRITICAL, "alarm 13")
    assert len(said) == 8
    assert announcer.dropped == 12


def test_what_still_stands_is_said_again_every_half_minute():
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet = Fleet(MODEL)
    vehicle = Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    watch = fleet.vehicles[1]
    alarm = Alarm("margin", None, WARNING, "Thrust left 41% below 50%: rotor 2", 0.0)
    watch.alarms.listed[alarm.key] = alarm
    announcer.on_event(1, AlarmEvent(alarm, AlarmState.CLEARED, 0.0))
    for _ in range(100):
        fleet.take(vehicle.tick(1.0))
        announcer.on_round(fleet, vehicle.stamp_us)
    # Spoken once: from 6 (INFO) on QGroundControl shows a text and does not speak it.
    assert texts(sent) == [(WARNING, alarm.text)] + [(6, alarm.text)] * 3


def test_what_the_extra_batteries_are_is_said_every_five_minutes():
    sent, fleet, vehicle = Sent(), Fleet(MODEL), Vehicle()
    announcer = Announcer(Sender(sent), battery=True)  # type: ignore[arg-type]
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    for _ in range(14):
        fleet.take(vehicle.tick(50.0))
        fleet.updates()
        announcer.on_round(fleet, vehicle.stamp_us)
    said = [text for _, text in texts(sent) if "batter" in text.lower()]
    assert len(said) == 3
    assert len(set(said)) == 1


def test_a_critical_alarm_is_spoken_again_every_half_minute():
    said = said_of(Alarm("rotor", 2, CRITICAL, "Rotor 2: 12% less thrust: land", 0.0), 70)
    assert said == [(2, "Rotor 2: 12% less thrust: land")] * 3


def said_of(alarm: Alarm, seconds: int, *events: AlarmState) -> list[tuple[int, str]]:
    """What goes out of an alarm that stands so long and then has the states `events`."""
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    fleet.vehicles[1].alarms.listed[alarm.key] = alarm
    announcer.on_event(1, AlarmEvent(alarm, AlarmState.CLEARED, 0.0))
    for _ in range(seconds):
        fleet.take(vehicle.tick(1.0))
        announcer.on_round(fleet, vehicle.stamp_us)
    for state in events:
        announcer.on_event(1, AlarmEvent(replace(alarm, state=state), AlarmState.ACTIVE, 0.0))
        fleet.take(vehicle.tick(1.0))
        announcer.on_round(fleet, vehicle.stamp_us)
    return texts(sent)


def test_a_notice_that_becomes_a_warning_is_spoken_once():
    """The margin of one alarm is first near the limit, then surely below it, and back."""
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    near = Alarm("margin", None, 5, "Thrust left 48% (+-4) near 50%", 0.0)
    low = replace(near, severity=WARNING, text="Thrust left 40% (+-4) below 50%")
    announcer.on_event(1, AlarmEvent(near, AlarmState.CLEARED, 0.0))
    for second in range(20):
        now = low if second in (5, 6, 9, 10) else near
        fleet.vehicles[1].alarms.listed[near.key] = now
        fleet.take(vehicle.tick(1.0))
        announcer.on_round(fleet, vehicle.stamp_us)
    assert texts(sent) == [(6, near.text), (WARNING, low.text)]


@pytest.mark.parametrize(
    ("alarm", "severities"),
    [
        (Alarm("rotor", 2, CRITICAL, "Rotor 2: land", 0.0), [2, 5, 6]),
        (Alarm("margin", None, WARNING, "Thrust left 41% below 50%", 0.0), [4, 5, 6]),
        (Alarm("envelope", None, 5, "Outside the model's training", 0.0), [6, 6, 6]),
        (Alarm("margin", None, 5, "Thrust left 52% (+-4) near 50%", 0.0), [6, 6, 6]),
    ],
)
def test_only_what_asks_for_something_now_is_spoken(alarm: Alarm, severities: list[int]):
    """Raised, not to be confirmed, over."""
    said = said_of(alarm, 1, AlarmState.UNCONFIRMED, AlarmState.CLEARED)
    assert [severity for severity, _ in said] == severities


def test_what_to_do_is_that_of_the_gravest_alarm_that_is_confirmed():
    rotor = Alarm("rotor", 2, CRITICAL, "Rotor 2: 12% less thrust: land", 0.0)
    margin = Alarm("margin", None, WARNING, "Thrust left 41% below 50%: rotor 2", 0.0)
    near = replace(margin, severity=5)
    unsure = replace(rotor, state=AlarmState.UNCONFIRMED)
    land, less = what_to_do([margin, rotor])["MARGIN_DO"], what_to_do([margin])["MARGIN_DO"]
    assert (land, 0 < less < land) == (4.0, True)  # ASKED[4] is "land"
    assert what_to_do([unsure, margin])["MARGIN_DO"] == less
    assert what_to_do([unsure, near])["MARGIN_DO"] == what_to_do([])["MARGIN_DO"] == 0.0


def test_nothing_is_said_in_the_name_of_a_silent_vehicle_until_it_returns():
    """A ground station takes any message of the system for a sign of the vehicle's life."""
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet = Fleet(MODEL)
    vehicle = Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    announcer.on_round(fleet, vehicle.stamp_us)
    assert len(sent.frames) > 0
    sent.frames.clear()
    vehicle.clock_s += 30.0
    for tenth in range(16, 300):
        now_us = vehicle.stamp_us + tenth * 100_000
        for number, event in fleet.tick(now_us):
            announcer.on_event(number, event)
        announcer.on_round(fleet, now_us)
    assert sent.frames == []
    vehicle.stamp_us += 30_000_000
    for _ in range(30):
        fleet.take(vehicle.tick())
        for number, event in fleet.tick(vehicle.stamp_us):
            announcer.on_event(number, event)
        announcer.on_round(fleet, vehicle.stamp_us)
    assert texts(sent) == [
        (CRITICAL, "Telemetry lost in flight: fly by sight"),
        (6, "Over: telemetry"),
    ]


def test_a_figure_that_is_no_longer_known_becomes_none():
    """A station shows the last value of a name for ever: here without rotor speeds, then rows."""
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()

    def last() -> dict[str, float]:
        sent.frames.clear()
        fleet.updates()
        announcer.on_round(fleet, vehicle.stamp_us)
        parser = dialect.MAVLink(None)
        messages: list[Any] = [m for data in sent.frames for m in parser.parse_buffer(data) or []]
        return {m.name: m.value for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}

    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    first = last()
    assert {"MARGIN", "MARGIN_ROT", "MARGIN_PRE", "TANK_THR", "MARGIN_LIM"} <= first.keys()
    assert np.isfinite(list(first.values())).all()
    for _ in range(40):  # 4 s without a message of an ESC
        fleet.take([f for f in vehicle.tick() if f.id != 11030])
    silent = last()
    assert {name for name, value in silent.items() if np.isnan(value)} >= {"MARGIN", "MARGIN_ROT"}
    assert np.isfinite(silent["MARGIN_PRE"])
    for _ in range(3):
        vehicle.stamp_us += SECOND
        fleet.take([vehicle.frame(dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3))])
    none = last()
    assert np.isnan(none["MARGIN_PRE"])
    assert none["MARGIN_LIM"] == 50.0


def said(sent: Sent) -> list[Any]:
    parser = dialect.MAVLink(None)
    return [m for data in sent.frames for m in parser.parse_buffer(data) or []]


def test_batteries_show_margin_and_tank_in_percent_and_are_explained_every_five_minutes():
    sent = Sent()
    announcer = Announcer(Sender(sent), battery=True)  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    fleet.updates()
    watch = fleet.vehicles[1]
    assert watch.last is not None
    analysis = watch.last.analysis
    tank = replace(analysis.track, tank_kg=np.full_like(analysis.track.tank_kg, 4.0))
    watch.last = replace(
        watch.last,
        analysis=replace(analysis, track=tank),
        clock_s=np.full_like(watch.last.clock_s, 12.5),
    )
    announcer.on_round(fleet, vehicle.stamp_us)
    messages = said(sent)
    left = {m.id: m.battery_remaining for m in messages if m.get_type() == "BATTERY_STATUS"}
    assert left[91] == 25  # 4 of the 16 kg that this tank holds
    figures = [m for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert left[90] == int(next(m.value for m in figures if m.name == "MARGIN"))
    assert {m.time_boot_ms for m in figures} == {12_500}
    explained = []
    for second in range(1, 310):
        sent.frames.clear()
        vehicle.stamp_us += SECOND
        now_us = vehicle.stamp_us
        fleet.take([vehicle.frame(dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3))])
        assert watch.last is not None
        stamps = np.full_like(watch.last.stamp_us, now_us)
        watch.last = replace(watch.last, stamp_us=stamps)
        announcer.on_round(fleet, now_us)
        texts_now = [m.text for m in said(sent) if m.get_type() == "STATUSTEXT"]
        explained += [second for text in texts_now if "90" in text]
    # Said in the second in which it is first shown, or in the next: one text a second goes out.
    assert len(explained) == 1
    assert 299 <= explained[0] <= 302


@pytest.mark.parametrize(
    ("level", "severity"), [(FlightLevel.DAMAGED, WARNING), (FlightLevel.UNDER, 6)]
)
def test_after_a_landing_what_is_grave_is_spoken_and_once(level, severity):
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    fleet.updates()
    watch = fleet.vehicles[1]
    heard = []
    for settled in (False, True, True):
        vehicle.stamp_us += SECOND
        fleet.take([vehicle.frame(dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3))])
        answer = SimpleNamespace(brief="Fill 8 kg", gravity=0.0, fill_kg=8.0)
        flight: Any = SimpleNamespace(
            settled=settled, answer=answer, advice=SimpleNamespace(level=level)
        )
        assert watch.last is not None
        watch.last = replace(watch.last, flight=flight)
        announcer.on_round(fleet, vehicle.stamp_us)
        heard.append([t for t in texts(sent) if "Fill" in t[1]])
        sent.frames.clear()
    assert heard == [[], [(severity, "Fill 8 kg")], []]


@pytest.mark.parametrize(("age_s", "fresh"), [(1.4, True), (1.6, False)])
def test_figures_of_a_row_that_is_old_are_none_though_the_vehicle_is_heard(age_s, fresh):
    sent = Sent()
    announcer = Announcer(Sender(sent))  # type: ignore[arg-type]
    fleet, vehicle = Fleet(MODEL), Vehicle()
    fleet.take([f for _ in range(20) for f in vehicle.tick()])
    fleet.updates()
    announcer.on_round(fleet, vehicle.stamp_us)
    sent.frames.clear()
    last = fleet.vehicles[1].last
    assert last is not None
    row_us = int(last.stamp_us[-1])
    vehicle.stamp_us = row_us + round(age_s * SECOND)
    fleet.take([vehicle.frame(dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3))])
    announcer.on_round(fleet, vehicle.stamp_us)
    values = [m.value for m in said(sent) if getattr(m, "name", "") == "MARGIN"]
    assert [np.isfinite(value) for value in values] == [fresh]


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        ("CONTROL LOST: turning at 120°/s", "CONTROL LOST: turning at 120 deg/s"),
        ("Schub über 50 %: Äste ± 1", "Schub ueber 50 %: Aeste +- 1"),
        ("鱼 1", "? 1"),
    ],
)
def test_a_text_has_letters_that_every_station_shows(text, sent):
    assert plain(text) == sent
