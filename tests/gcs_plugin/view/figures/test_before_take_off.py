"""The advice on the page before take-off is that of `thrustmargin fill` for the same day."""

from dataclasses import replace

import numpy as np

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.reports.fill.fill_table import fill_table
from thrustmargin.gcs_plugin.store.remembered_day import day_file, remember
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice
from thrustmargin.models.model.analysis import analyse
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
    said = FillAdvice(0.5).text(analysis)
    assert said.startswith(table.advice)
    assert "this battery, 56.0 V at rest, 35 °C, 966 hPa, no wind" in said


def test_air_that_nobody_measures_is_that_of_the_day_that_was_stated_else_the_default():
    bare = standing(thermometer=False)
    assert "30 °C, 966 hPa, no wind" in FillAdvice(0.5).text(bare)
    remember(Day(air_temperature=DayValue(285.15, DaySource.OPTION)))
    assert "12 °C as given at " in FillAdvice(0.5).text(bare)


def test_nothing_is_advised_in_flight_or_where_no_airframe_is_known():
    on_ground = standing()
    assert FillAdvice(0.5).text(on_ground)
    flying = replace(on_ground.track, flying=np.ones(ROWS, dtype=bool))
    assert FillAdvice(0.5).text(replace(on_ground, track=flying)) == ""
    unknown = replace(on_ground.claim, withheld=("another aircraft",))
    assert FillAdvice(0.5).text(replace(on_ground, claim=unknown)) == ""


def test_it_is_worked_out_anew_when_the_air_or_the_battery_changes():
    advice, analysis = FillAdvice(0.5), standing()
    first = advice.text(analysis)
    assert advice.text(analysis) is first
    thin = advice.text(standing(pressure=80.0 * HECTOPASCAL))
    assert thin != first
    assert advice.text(standing(pressure=80.0 * HECTOPASCAL, volts=VOLTS - 1.0)) != thin


def test_a_damaged_memory_of_the_day_is_said():
    remember(Day(wind=DayValue(3.0, DaySource.OPTION)))

    day_file().write_text("{", encoding="utf-8")
    assert "remove it, and state the day anew" in FillAdvice(0.5).text(standing())
