"""The sender on the vehicle, run in Lua 5.3, and what is made of what it sends."""

import math
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import ROOT, Vehicle, as_frame, live_rows, write_log
from tests.gcs_plugin.peers.scripted_vehicle import ScriptedVehicle
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.physics.airframe import load_airframe

CRAFT = load_airframe("topxgun-f16")
SCRIPT = (ROOT / "gcs_plugin/office/stations/on_vehicle/margin_inputs.lua").read_text("utf-8")
WORN = (2000.0, 2100.0, 2200.0, 2300.0)


def sender(**params: float) -> ScriptedVehicle:
    craft = ScriptedVehicle(**params)
    for esc, rpm in enumerate(WORN):
        craft.now.rpm[esc] = rpm
    craft.load(SCRIPT)
    return craft


def test_means_of_a_second_go_out_once_a_second_the_first_rotor_last():
    craft = sender()
    craft.look(8)
    assert craft.taken("floats") == []
    craft.now.rpm[0] = 2100.0
    craft.look()  # one look of ten at 2100 rpm
    assert craft.taken("floats") == [
        ("TM_RPM4", 2300.0),
        ("TM_RPM3", 2200.0),
        ("TM_RPM2", 2100.0),
        ("TM_RPM1", pytest.approx(2010.0)),
    ]
    craft.look(10)
    assert len(craft.taken("floats")) == 4
    assert craft.every_ms == 100


def test_an_esc_that_is_silent_is_not_spoken_for():
    craft = sender()
    craft.look(9)
    craft.taken("floats")
    craft.look(4)
    craft.now.rpm[2] = None
    craft.look(6)
    assert ("TM_RPM3", 2200.0) in craft.taken("floats")  # the mean of what it said
    craft.look(10)
    assert [name for name, _ in craft.taken("floats")] == ["TM_RPM4", "TM_RPM2", "TM_RPM1"]


def test_rates_are_asked_for_on_the_port_that_was_named_and_again_each_minute():
    craft = sender()
    craft.look(1200)
    assert craft.taken("intervals") == []
    craft = sender(TMS_PORT=2)
    first = craft.taken("intervals")
    assert {port for port, _, _ in first} == {2}
    assert {us for _, _, us in first} == {1_000_000}
    assert {identity for _, identity, _ in first} >= {30, 33, 74, 147}
    craft.look(598)
    assert craft.taken("intervals") == []
    craft.look(2)
    assert craft.taken("intervals") == first


def flown(seconds: int) -> list[Frame]:
    """Frames of a vehicle without ESC telemetry that runs the sender, at 1 Hz."""
    script, craft = sender(), Vehicle()
    frames: list[Frame] = []
    for look in range(10 * seconds):
        for esc, rpm in enumerate(WORN):
            script.now.rpm[esc] = rpm + 10.0 * math.sin(look)  # none stands still in flight
        if look:
            script.look()
        craft.clock_s += 0.1
        craft.stamp_us += 100_000
        parts = []
        if look % 10 == 0:
            parts = [craft.heartbeat(), craft.landed(), craft.attitude(), craft.speed()]
            parts += [craft.tank(8.0), craft.place()]
        for name, value in script.taken("floats"):
            message = dialect.MAVLink_named_value_float_message(craft.boot_ms, name.encode(), value)
            parts.append(craft.pack(message))
        frames += [as_frame(part, craft.stamp_us) for part in parts]
    return frames


@pytest.mark.parametrize("piece", [1, 2, 7, 1000])
def test_a_listener_has_a_row_a_second_with_every_rotor(piece: int):
    """However the messages of one second are cut into rounds."""
    rows, _ = live_rows(flown(30), CRAFT, piece=piece)
    assert rows is not None
    speeds = rows.track.rotor_speed_rpm[2:]
    assert np.median(np.diff(rows.track.time_s)) == pytest.approx(1.0, abs=0.01)
    assert speeds == pytest.approx(np.tile(WORN, (len(speeds), 1)), abs=6.0)
    assert rows.track.source("rotor_speed_rpm").name == "NAMED_VALUE_FLOAT"


def test_its_recording_says_the_same(tmp_path: Path):
    log = read_log(write_log(tmp_path / "slow.tlog", flown(30)), airframe=CRAFT)
    speeds = log.track.rotor_speed_rpm
    assert np.isfinite(speeds).all(axis=1).mean() > 0.9
    assert np.nanmean(speeds, axis=0) == pytest.approx(WORN, abs=3.0)


def test_esc_telemetry_comes_before_it():
    frames = flown(12)
    late = Vehicle(clock_s=100.0)
    mixed: list[Frame] = []
    for frame in frames:
        mixed.append(frame)
        late.clock_s, late.stamp_us = 100.0 + (frame.stamp_us - 1.7e15) * 1e-6, frame.stamp_us
        if frame.id == 30:
            mixed.append(as_frame(late.escs((1500,) * 4), frame.stamp_us))
    rows, _ = live_rows(mixed, CRAFT)
    assert rows is not None
    assert rows.track.rotor_speed_rpm[-1] == pytest.approx([1500.0] * 4)
