"""The check before take-off on the vehicle, run in Lua 5.3 beside the one that the ground makes."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT
from tests.gcs_plugin.peers.scripted_vehicle import ScriptedVehicle
from tests.models.checks.test_takeoff import flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.takeoff_words import takeoff_alarm
from thrustmargin.models.checks import speed_readings, takeoff
from thrustmargin.models.flight import FlightTrack

SCRIPT = (ROOT / "gcs_plugin/office/stations/on_vehicle/takeoff_check.lua").read_text("utf-8")
FLOWN = sorted((ROOT / "sitl_logs" / "campaign").glob("v4_*_q2.5.tlog"))
CRITICAL, WARNING, INFO = 2, 4, 6
#: Outputs of the motors, as functions, and the channels that have them.
CHANNELS = {33: 8, 34: 9, 35: 10, 36: 11}


def run_up(track: FlightTrack, celsius: dict[int, float] | None = None) -> list[tuple[int, str]]:
    """Texts of the script for the rows of a flight, at ten looks a second.

    `celsius` are the temperatures of ESCs, by channel.
    """
    craft = ScriptedVehicle()
    for purpose, channel in CHANNELS.items():
        craft.now.channels[purpose] = channel
    for channel, warm in (celsius or {}).items():
        craft.now.centidegrees[channel] = round(100.0 * warm)
    end = float(track.time_s[track.flying][0]) + 1.0 if track.flying.any() else track.time_s[-1]
    rows = np.searchsorted(track.time_s, np.arange(0.0, end, 0.1) + 1e-6) - 1
    for look, row in enumerate(np.maximum(rows, 0)):
        for motor, (purpose, channel) in enumerate(CHANNELS.items()):
            rpm, output = track.rotor_speed_rpm[row, motor], track.throttle[row, motor]
            craft.now.rpm[channel] = None if np.isnan(rpm) else float(rpm)
            share = None if np.isnan(output) else round(1000 + 1000 * float(output))
            craft.now.pulses[purpose] = share
        craft.now.volts[0] = float(track.voltage[row])
        craft.now.flying = bool(track.flying[row])
        if look:
            craft.look()
        else:
            craft.load(SCRIPT)
    return [(int(severity), str(text)) for severity, text in craft.taken("texts")]


def forbidden(track: FlightTrack) -> set[str]:
    """Alarms of the ground's check before lift-off, about what the script knows of."""
    (check,) = takeoff.takeoff_checks(track)
    kinds = (takeoff.TakeoffKind.STANDS, takeoff.TakeoffKind.LATE)
    kinds += (takeoff.TakeoffKind.SLOW, takeoff.TakeoffKind.FAST, takeoff.TakeoffKind.EXCHANGED)
    found = [one for one in check.forbidding if one.kind in kinds]
    # While a motor stands nobody knows that it will be late.
    found = [replace(one, kind=kinds[0]) if one.kind is kinds[1] else one for one in found]
    return {takeoff_alarm(one, flying=False) for one in found}


def test_its_limits_are_those_of_the_ground():
    stated = dict[str, float]()
    for names, values in re.findall(r"^local ([A-Z_, ]+) = ([\d., ]+)", SCRIPT, re.MULTILINE):
        stated |= dict(zip(names.split(", "), map(float, values.split(", ")), strict=True))
    own = {"EVERY_MS", "KEPT", "CRITICAL", "WARNING", "INFO", "BATTERY"}
    known = vars(takeoff) | {"TURNING": speed_readings.TURNING, "FLOOR": speed_readings.FLOOR}
    assert {name: known[name] for name in stated.keys() - own} == {
        name: value for name, value in stated.items() if name not in own
    }
    assert len(stated.keys() - own) == 17


def test_of_a_sound_run_up_one_line_says_what_was_well():
    assert run_up(flight()) == [(INFO, "4 of 4 turn within 0.0s, 58.8V to 56.9V")]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"late": {2: np.inf}}, "DO NOT LIFT: motor 3 does not turn"),
        ({"late": {1: 1.5}}, "DO NOT LIFT: motor 2 does not turn"),
        ({"speed": (1.0, 1.0, 1.0, 0.5)}, "DO NOT LIFT: motor 4 slow for its output"),
        ({"speed": (1.5, 1.0, 1.0, 1.0)}, "DO NOT LIFT: motor 1 too fast: propeller?"),
    ],
)
def test_it_says_what_the_ground_says(changed, said):
    track = flight(**changed)
    texts = run_up(track)
    assert {severity for severity, _ in texts} == {CRITICAL}
    assert {text for _, text in texts} == forbidden(track)
    assert texts[0] == (CRITICAL, said)


def test_two_exchanged_motors_are_named_together_and_none_of_them_alone():
    track = flight(output=(1.0, 1.3, 0.55, 1.0))
    exchanged = replace(track, rotor_speed_rpm=track.rotor_speed_rpm[:, [0, 2, 1, 3]])
    texts = run_up(exchanged)
    assert texts == [(CRITICAL, "DO NOT LIFT: motors 2 and 3 are exchanged")]
    assert {text for _, text in texts} == forbidden(exchanged)


def test_a_motor_half_a_second_late_is_said_and_one_a_third_is_not():
    assert run_up(flight(late={2: 0.3}))[0][0] == INFO
    assert run_up(flight(late={2: 0.8}))[0] == (CRITICAL, "DO NOT LIFT: motor 3 does not turn")


def test_a_motor_that_is_asked_for_half_as_much_is_sound_at_its_speed():
    track = flight(output=(1.0, 1.0, 1.0, 0.5))
    assert run_up(track)[0][0] == INFO
    assert forbidden(track) == set()


def test_a_start_that_was_broken_off_blames_no_motor():
    """All motors stop after 0.4 s, before the third was late."""
    track = flight(late={2: np.inf})
    speed = np.where(track.time_s[:, None] >= 5.4, 0.0, track.rotor_speed_rpm)
    broken = replace(track, rotor_speed_rpm=speed, flying=np.zeros_like(track.flying))
    assert run_up(broken) == []
    assert forbidden(broken) == set()


def test_a_hot_esc_and_a_silent_one():
    hot = run_up(flight(), celsius={9: 91.0, 10: 89.0})
    assert hot == [(CRITICAL, "DO NOT LIFT: ESC 2 has 91 C")]
    silent = run_up(flight(silent=[3]))
    assert (WARNING, "No speed of motors 4: not checked") in silent
    assert (INFO, "3 of 4 turn within 0.0s, 58.8V to 56.9V") in silent


def test_without_telemetry_nothing_is_said_to_be_well():
    said = run_up(flight(silent=[0, 1, 2, 3]))
    assert said == [(WARNING, "No speed of motors 1 2 3 4: not checked")]


def test_an_aircraft_without_motors_says_so_once():
    craft = ScriptedVehicle()
    with pytest.raises(TypeError):  # it returns nothing to be called again
        craft.load(SCRIPT)
    assert craft.taken("texts") == [(WARNING, "Take-off check: no motors by SERVOn_FUNCTION")]


@cache
def flown(name: str) -> FlightTrack:
    return read_log(ROOT / "sitl_logs" / "campaign" / name).track


@pytest.mark.parametrize("name", [path.name for path in FLOWN])
def test_recorded_run_ups_are_sound_and_a_motor_that_is_made_to_stand_is_said(name):
    track = flown(name)
    assert {severity for severity, _ in run_up(track)} <= {INFO}
    speed = track.rotor_speed_rpm.copy()
    speed[:, 2] = np.where(np.isfinite(speed[:, 2]), 0.0, np.nan)
    stands = replace(track, rotor_speed_rpm=speed)
    assert run_up(stands)[0] == (CRITICAL, "DO NOT LIFT: motor 3 does not turn")
    assert "DO NOT LIFT: motor 3 does not turn" in forbidden(stands)
