"""The advice on the page before take-off is that of `thrustmargin fill`."""

import re
from dataclasses import replace

import numpy as np

from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.reports.fill.fill_table import Day, fill_table
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure

AIRSPEED = 5.0  # m/s
CELSIUS, ALTITUDE = 35.0, 400.0


def standing(**changes):
    """A flight whose last row is on the ground, in the air of the day."""
    made = flight()
    on_ground = np.zeros_like(made.track.flying)
    air = air_density(isa_pressure(np.array([ALTITUDE])), np.array([CELSIUS + 273.15]))
    track = replace(made.track, flying=on_ground)
    return replace(made, track=track, density=np.full(on_ground.size, air[0]), **changes)


def advised(advice: FillAdvice, analysis: FlightAnalysis) -> str:
    """The sentence on the largest fill."""
    largest = advice.fill(analysis)
    assert largest is not None
    return advice.text(largest, analysis)


def test_the_page_and_the_command_advise_the_same():
    analysis = standing()
    day = Day(
        temperature_c=CELSIUS,
        altitude=ALTITUDE,
        voltage=analysis.model.airframe.nominal_voltage,
        airspeed=AIRSPEED,
    )
    table = fill_table(
        analysis.model, day, limit=0.5, rotor_lost=True, temperatures_c=(35.0,), altitudes=(400.0,)
    )
    said = advised(FillAdvice(0.5), analysis)
    assert table.advice in said
    assert re.search(r"(Fill at most|Do not fill)", said)


def test_nothing_is_advised_in_flight_or_without_the_air():
    unknown = replace(standing(), density=np.full(flight().track.time_s.size, np.nan))
    assert FillAdvice(0.5).fill(unknown) is None
    flying = replace(
        standing(), track=replace(flight().track, flying=np.ones_like(flight().track.flying))
    )
    assert FillAdvice(0.5).fill(flying) is None


def test_it_is_worked_out_anew_when_the_air_changes():
    advice, analysis = FillAdvice(0.5), standing()
    first = advice.fill(analysis)
    assert advice.fill(analysis) is first
    thin = replace(analysis, density=0.8 * analysis.density)
    assert advised(advice, thin) != advised(advice, analysis)


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
