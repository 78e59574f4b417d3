"""Where the tank level comes from, source by source, and that none is made up."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.log_files import frames_of
from tests.made_sources import sent
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import (
    TankContext,
    check_source,
    first_level,
    flight_battery,
    tank_levels,
)
from thrustmargin.gcs_plugin.telemetry.signals import signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import LogError
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.statement import state

ROOT = Path(__file__).resolve().parents[3]
FLIGHT = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
F16 = load_airframe("topxgun-f16-sitl")
TIME = np.arange(0.0, 100.0, 0.5)
PACK = [
    Signal("battery_voltage", sent("BATTERY_STATUS voltages of id 0"), TIME, np.full(200, 56.0), 0),
    Signal("battery_percent", sent("BATTERY_STATUS battery_remaining of id 0"), TIME, TIME, 0),
]


def context(airframe=F16, start=None, pump=None, parameters=None) -> TankContext:
    return TankContext(
        airframe=airframe, parameters=parameters or {}, start_kg=start, pump_output=pump
    )


def battery(percent, *, number=1, volts=1.5, used=None) -> list[Signal]:
    made = [
        Signal(
            "battery_voltage",
            sent(f"BATTERY_STATUS of id {number}"),
            TIME,
            TIME * 0 + volts,
            number,
        ),
        Signal("battery_percent", sent(f"BATTERY_STATUS of id {number}"), TIME, percent, number),
    ]
    if used is not None:
        made.append(
            Signal("battery_consumed", sent(f"BATTERY_STATUS of id {number}"), TIME, used, number)
        )
    return made


def level(*signals, source="auto", **given):
    return first_level(tank_levels(signals_by_channel([*PACK, *signals]), context(**given), source))


def test_a_named_value_goes_before_a_tank_battery():
    named = Signal("named_value", sent("NAMED_VALUE_FLOAT TANK"), TIME, TIME * 0 + 7.0, "TANK")
    found = level(named, *battery(TIME * 0 + 50))
    assert found.signal is not None
    assert source_words(found.signal.source) == "NAMED_VALUE_FLOAT TANK"
    assert found.signal.values[0] == 7.0


def test_litres_take_the_liquids_density():
    named = Signal("named_value", sent("NAMED_VALUE_FLOAT TANK_L"), TIME, TIME * 0 + 7.0, "TANK_L")
    found = level(named)
    assert found.signal is not None
    assert found.signal.values[0] == pytest.approx(7.0 * F16.liquid_density)
    own = Signal("named_value", sent("NAMED_VALUE_FLOAT LVL"), TIME, TIME * 0 + 7.0, "LVL")
    forced = level(own, source="NAMED_VALUE_FLOAT LVL:l", airframe=None)
    assert forced.signal is not None
    assert forced.signal.values[0] == 7.0
    assert forced.notes == (state("liquid taken as water"),)


def test_a_second_battery_with_a_level_senders_voltage_is_the_tank():
    used = 6000.0 + TIME * 10
    found = level(
        *battery(100 * (1 - used / 16000), used=used), parameters={"BATT2_CAPACITY": 16000.0}
    )
    assert found.signal is not None
    np.testing.assert_allclose(found.signal.values, 16.0 - used / 1000)
    assert source_words(found.signal.source) == (
        "BATTERY_STATUS of id 1 (a tank: ml used of BATT2_CAPACITY 16000 ml)"
    )


def test_without_a_capacity_parameter_the_airframes_tank_counts():
    found = level(*battery(TIME * 0 + 50.0))
    assert found.signal is not None
    assert found.signal.values[0] == pytest.approx(0.5 * F16.tank_capacity_kg)
    assert "% of the airframe's 16 L" in source_words(found.signal.source)
    brine = replace(F16, liquid_density=1.2)
    heavier = level(*battery(TIME * 0 + 50.0), airframe=brine)
    assert heavier.signal is not None
    assert heavier.signal.values[0] == pytest.approx(1.2 * found.signal.values[0])
    nothing = level(*battery(TIME * 0 + 50.0), airframe=None)
    assert nothing.signal is None
    assert any("its volume is unknown" in note for note in map(statement_words, nothing.notes))


def test_ml_used_that_contradict_the_percentage_are_not_used():
    found = level(*battery(TIME * 0 + 50.0, used=TIME * 0), parameters={"BATT2_CAPACITY": 16000.0})
    assert found.signal is not None
    assert found.signal.values[0] == pytest.approx(8.0)


def test_a_second_pack_is_not_taken_for_a_tank():
    found = level(*battery(TIME * 0 + 50.0, volts=55.0))
    assert found.signal is None
    assert any("no tank gauge" in note for note in map(statement_words, found.notes))
    # Forced, it is taken at the user's word.
    assert level(*battery(TIME * 0 + 50.0, volts=55.0), source="BATTERY_STATUS 1").signal


@pytest.mark.parametrize("number", [90, 91])
def test_what_monitor_announces_as_a_battery_is_no_gauge(number: int):
    """A margin of 40 % would be 6.4 kg in the tank, and a level by thrust would prove itself."""
    share = Signal(
        "battery_percent", sent("BATTERY_STATUS battery_remaining"), TIME, np.full(200, 40), number
    )
    assert level(share).signal is None
    forced = level(share, source=f"BATTERY_STATUS {number}").signal
    assert forced is not None  # a vehicle that has such a number may say so


def test_the_pack_is_found_though_the_tank_has_the_lower_id():
    tank_first = battery(TIME * 0 + 50.0, number=0)
    pack = Signal("battery_voltage", sent("BATTERY_STATUS of id 1"), TIME, TIME * 0 + 56.0, 1)
    assert flight_battery(signals_by_channel([*tank_first, pack])) == 1


def pump(share: float) -> Signal:
    pulses = np.zeros((TIME.size, 6))
    pulses[:, 4] = 1000 + 1000 * share
    return Signal("servo_us", sent("SERVO_OUTPUT_RAW"), TIME, pulses)


def test_the_pump_is_summed_from_a_stated_level():
    given = {"SERVO5_MIN": 1000.0, "SERVO5_MAX": 2000.0}
    found = level(pump(0.5), start=10.0, pump=4, parameters=given)
    assert found.signal is not None
    per_second = 0.5 * F16.pump_max_flow_l_min / 60 * F16.liquid_density
    expected = np.maximum(10.0 - per_second * TIME, 0.0)
    np.testing.assert_allclose(found.signal.values, expected, atol=1e-9)
    assert "stated 10 kg" in source_words(found.signal.source)


def test_without_a_start_level_the_pump_gives_no_number():
    found = level(pump(0.5), pump=4)
    assert found.signal is None
    assert any(
        "start level (--tank-start-kg) is unknown" in note
        for note in map(statement_words, found.notes)
    )


@pytest.mark.parametrize(
    "source", ["FUEL_STATUS", "BATTERY_STATUS 7", "NAMED_VALUE_FLOAT NOPE", "pump"]
)
def test_a_forced_source_that_is_not_there_is_an_error(source):
    with pytest.raises(LogError, match="no tank level from"):
        level(source=source)


@pytest.mark.parametrize("source", ["teapot", "BATTERY_STATUS one"])
def test_a_source_that_cannot_be_is_an_error(source):
    with pytest.raises(LogError, match="tank source"):
        level(source=source)
    with pytest.raises(LogError, match="tank source"):
        check_source(source)


def test_the_airframe_file_names_the_source_unless_the_user_does():
    own = replace(F16, tank_source="BATTERY_STATUS 1")
    named = Signal("named_value", sent("NAMED_VALUE_FLOAT TANK"), TIME, TIME * 0 + 7.0, "TANK")
    tank = battery(TIME * 0 + 50)
    found = level(named, *tank, airframe=own)
    assert found.signal is not None
    assert source_words(found.signal.source).startswith("BATTERY_STATUS")
    asked = level(named, *tank, airframe=own, source="NAMED_VALUE_FLOAT TANK")
    assert asked.signal is not None
    assert asked.signal.values[0] == 7.0
    # Another does not step in unasked, and the message says who named it.
    with pytest.raises(LogError, match=f"airframe {F16.name} names"):
        level(named, airframe=own)
    for source in ("auto", "none", "pump", "NAMED_VALUE_FLOAT LVL", own.tank_source):
        check_source(source)


def test_the_recorded_flights_three_gauges_agree():
    named = read_log(FLIGHT, airframe=F16).track
    battery_track = read_log(FLIGHT, airframe=F16, tank="BATTERY_STATUS 1").track
    assert np.nanmax(np.abs(named.tank_kg - battery_track.tank_kg)) < 0.15
    assert source_words(battery_track.sources["tank_kg"]).startswith(
        "BATTERY_STATUS current_consumed of id 1 (a tank: ml used of"
    )
    left_out = read_log(FLIGHT, airframe=F16, tank="none").track
    assert not left_out.reports("tank_kg")


def test_a_flight_without_gauge_falls_back_to_the_pump_and_says_so(tmp_path):
    path = tmp_path / "no_gauge.tlog"
    path.write_bytes(
        b"".join(
            p
            for p in frames_of(FLIGHT)
            if p[15] != 251 and not (p[15] == 147 and p[8 + 10 + 32] == 1)
        )
    )
    unknown = read_log(path, airframe=F16).track
    assert not unknown.reports("tank_kg")
    assert any("start level" in note for note in map(statement_words, unknown.notes))
    track = read_log(path, airframe=F16, tank_start_kg=10.0).track
    assert source_words(track.sources["tank_kg"]).startswith(
        "pump output (servo 5, summed from the stated 10 kg"
    )
    used = 10.0 - track.tank_kg[-1]
    truth = read_log(FLIGHT).track.tank_kg
    assert used == pytest.approx(truth[0] - truth[-1], rel=0.03)
