"""The advice on the page before take-off is that of `thrustmargin fill` for the same day."""

from dataclasses import replace

import numpy as np

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.reports.fill.fill_table import fill_table
from thrustmargin.gcs_plugin.store.remembered_day import day_file, remember
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.physics.atmosphere import isa_pressure
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day

CELSIUS, HECTOPASCAL, VOLTS = 35.0, float(isa_pressure(400.0)) / 100.0, 56.0


def standing(volts=VOLTS, pressure=100.0 * HECTOPASCAL, thermometer=True, **changes):
    """A flight that stands on the ground with its motors off, in the air of the day."""
    made, track = flight(), flight().track
    errors = {"temperature": np.full(ROWS, 0.5)} if thermometer else {}
    track = replace(
        track,
        flying=np.zeros_like(track.flying),
        rotor_speed_rpm=np.zeros_like(track.rotor_speed_rpm),
        voltage=np.full(ROWS, volts),
        pressure=np.full(ROWS, pressure),
        temperature=np.full(ROWS, CELSIUS + 273.15),
        standard_errors=errors,
        **changes,
    )
    return analyse(track, made.model)


def advised(advice: FillAdvice, analysis: FlightAnalysis) -> str:
    """The sentence on the largest fill."""
    largest = advice.fill(analysis)
    assert largest is not None
    return advice.text(largest)


def test_the_page_and_the_command_advise_the_same():
    analysis = standing()
    link = DaySource.LINK
    day = complete_day(
        51.8,
        Day(
            air_temperature=DayValue(CELSIUS + 273.15, link, error=0.5),
            pressure=DayValue(100.0 * HECTOPASCAL, link, error=0.5 * HECTOPASCAL),
            battery_voltage=DayValue(VOLTS, link),
        ),
    )
    table = fill_table(
        analysis.model, day, limit=0.5, rotor_lost=True, temperatures_c=(35.0,), altitudes=(400.0,)
    )
    said = advised(FillAdvice(0.5), analysis)
    assert said.startswith(table.advice)
    assert "this battery, 56.0 V at rest, 35 °C, 966 hPa, no wind" in said


def test_air_that_nobody_measures_is_that_of_the_day_that_was_stated_else_the_default():
    bare = standing(thermometer=False)
    assert "30 °C, 966 hPa, no wind" in advised(FillAdvice(0.5), bare)
    remember(Day(air_temperature=DayValue(285.15, DaySource.OPTION)))
    assert "12 °C as given at " in advised(FillAdvice(0.5), bare)


def test_nothing_is_advised_in_flight_or_where_no_airframe_is_known():
    on_ground = standing()
    assert FillAdvice(0.5).fill(on_ground) is not None
    flying = replace(on_ground.track, flying=np.ones(ROWS, dtype=bool))
    assert FillAdvice(0.5).fill(replace(on_ground, track=flying)) is None
    unknown = replace(on_ground.airframe_match, no_verdict=("another aircraft",))
    assert FillAdvice(0.5).fill(replace(on_ground, airframe_match=unknown)) is None


def test_it_is_worked_out_anew_when_the_air_or_the_battery_changes():
    advice, analysis = FillAdvice(0.5), standing()
    first = advice.fill(analysis)
    assert advice.fill(analysis) is first
    thin = advised(advice, standing(pressure=80.0 * HECTOPASCAL))
    assert thin != advised(FillAdvice(0.5), analysis)
    assert advised(advice, standing(pressure=80.0 * HECTOPASCAL, volts=VOLTS - 1.0)) != thin


def test_a_damaged_memory_of_the_day_is_said():
    remember(Day(wind=DayValue(3.0, DaySource.OPTION)))

    day_file().write_text("{", encoding="utf-8")
    assert "remove it, and state the day anew" in advised(FillAdvice(0.5), standing())


def on_the_ground(tank_kg: float) -> VehicleSummary:
    """An aircraft that has not flown yet, with so much in its tank."""
    analysis = standing()
    tank = np.full(analysis.track.time_s.size, tank_kg)
    analysis = replace(analysis, track=replace(analysis.track, tank_kg=tank))
    largest = FillAdvice(0.5).fill(analysis)
    return VehicleSummary(number=1, row=ShownRow(analysis, -1), largest=largest, fill="Fill so")


def test_before_take_off_the_fill_on_board_stands_beside_the_largest_and_is_never_green():
    largest = on_the_ground(0.0).largest
    assert largest is not None
    most = f"{np.floor(largest.kg * 10) / 10:.1f} L"  # of 1 kg/L
    assert on_the_ground(2.0).first_line == (f"2.0 L on board, at most {most}", "Fill so", "grey")
    over = f"TOO MUCH: {np.ceil(largest.kg * 10) / 10 + 0.1:.1f} L, at most {most}"
    # Shown rounded up: 0.06 kg more must not read like the largest itself.
    headline, _, level = on_the_ground(np.floor(largest.kg * 10) / 10 + 0.16).first_line
    assert (headline, level) == (over, "red")
    assert on_the_ground(np.nan).first_line[::2] == (f"FILL AT MOST {most}", "grey")
    unknown = replace(on_the_ground(2.0), largest=None)
    assert unknown.first_line[::2] == ("", "grey")
