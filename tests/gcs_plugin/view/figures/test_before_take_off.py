"""The advice on the page before take-off is that of `thrustmargin fill`."""

import re
from dataclasses import replace

import numpy as np

from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.reports.fill.fill_table import Day, fill_table
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice
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
    said = FillAdvice(0.5).text(analysis)
    assert table.advice in said
    assert re.search(r"(Fill at most|Do not fill)", said)


def test_nothing_is_advised_in_flight_or_without_the_air():
    unknown = replace(standing(), density=np.full(flight().track.time_s.size, np.nan))
    assert FillAdvice(0.5).text(unknown) == ""
    flying = replace(
        standing(), track=replace(flight().track, flying=np.ones_like(flight().track.flying))
    )
    assert FillAdvice(0.5).text(flying) == ""


def test_it_is_worked_out_anew_when_the_air_changes():
    advice, analysis = FillAdvice(0.5), standing()
    first = advice.text(analysis)
    assert advice.text(analysis) is first
    thin = replace(analysis, density=0.8 * analysis.density)
    assert advice.text(thin) != first
