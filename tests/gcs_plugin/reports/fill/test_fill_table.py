"""The table of fills: its cells are the fills of their own air and battery, in their own place."""

import json
from dataclasses import replace

import pytest

from thrustmargin.gcs_plugin.reports.fill.fill_table import (
    conditions,
    fill_table,
    html_text,
    json_text,
)
from thrustmargin.models.model.fill_limits import largest_fills
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day

MODEL = physics_model(load_airframe("topxgun-f16"))
STATED = DaySource.OPTION
DAY = complete_day(
    51.8,
    Day(
        air_temperature=DayValue(273.15 + 25.0, STATED),
        height=DayValue(500.0, STATED),
        battery_voltage=DayValue(52.0, STATED),
    ),
)


@pytest.fixture(scope="module")
def table():
    return fill_table(
        MODEL,
        DAY,
        limit=0.5,
        rotor_lost=True,
        temperatures_c=(0.0, 40.0),
        altitudes=(0.0, 1000.0, 2000.0),
    )


def test_a_cell_is_the_fill_of_its_battery_altitude_and_temperature(table):
    air = air_density(isa_pressure(1000.0), 273.15 + 40.0)
    fill = largest_fills(MODEL, air, 3.5 * 14, airspeed=5.0).sure[0]
    cells = dict(table.rows("nearly empty"))["1 000 m"]
    assert fill > 0.0
    assert cells[1] == f"{int(fill * 10) / 10:.1f} kg"
    made = json.loads(json_text(table))
    assert made["table"]["fill_kg"][2][1][1] == int(fill * 10) / 10


def test_the_page_and_the_json_say_the_same_advice_and_what_it_holds_for(table):
    page, made = html_text(table), json.loads(json_text(table))
    assert made["advice"] == table.advice
    assert table.advice.split(":")[0].replace(" ", "") in page.replace("\xa0", "").replace(" ", "")
    assert made["conditions"] == conditions(table)
    assert any("max_takeoff_mass" in sentence for sentence in made["conditions"])
    assert page.count("<tr>") == 3 + 9
    assert "<script" not in page


@pytest.mark.parametrize(
    ("tank_l", "limit", "colour"), [(None, 0.2, "critical"), (0.0, 0.9, "under")]
)
def test_the_colour_is_that_of_the_sentence(tank_l, limit, colour):
    craft = MODEL.airframe if tank_l is None else replace(MODEL.airframe, tank_volume_l=tank_l)
    made = fill_table(
        physics_model(craft),
        DAY,
        limit=limit,
        rotor_lost=False,
        temperatures_c=(0.0,),
        altitudes=(0.0,),
    )
    first = "Do not fill" if tank_l is None else "Nothing to fill: it has no tank"
    assert made.advice.startswith(first)
    assert f'class="verdict {colour}"' in html_text(made)
