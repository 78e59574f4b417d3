"""What nobody stated of an airframe follows from what somebody did, and says that it is a guess."""

import csv
import os
from collections import defaultdict
from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from statistics import median, stdev

import pytest

from thrustmargin.models.physics.airframe import (
    QUANTITIES,
    Quantity,
    airframe_from_table,
    airframe_names,
    airframe_table,
    load_airframe,
)
from thrustmargin.models.physics.airframe_draft import (
    airframe_toml,
    complete_quantities,
    power_sets,
)
from thrustmargin.models.physics.thrust import dimensionless_coefficient

#: As the code has them, written down by hand: a change there is to be seen here.
TYPICAL_C_T = 0.07

STATED = {
    "empty_mass": Quantity(18.0, "kg", "own scale"),
    "tank_volume_l": Quantity(10.0, "L", "own jug"),
    "nominal_voltage": Quantity(51.8, "V", "14 cells"),
}


@pytest.mark.parametrize("name", power_sets())
def test_a_power_set_with_mass_tank_and_battery_is_a_whole_airframe(name):
    made = complete_quantities({**power_sets()[name].quantities, **STATED})
    assert set(made) == set(QUANTITIES)
    assert all(quantity.unit == QUANTITIES[key] for key, quantity in made.items())
    slope, top = made["thrust_coefficient"].value, made["max_rotor_speed_rpm"].value
    assert slope * top**2 == pytest.approx(made["nameplate_max_thrust"].value, rel=0.09)
    diameter, density = made["propeller_diameter"].value, made["reference_density"].value
    found = dimensionless_coefficient(slope, density=density, diameter=diameter)
    assert 0.05 < found < 0.105
    for key in STATED.keys() | power_sets()[name].quantities.keys():
        assert made[key].guessed == {**power_sets()[name].quantities, **STATED}[key].guessed
    assert all(made[key].guessed for key in ("ceiling_voltage_exponent", "motor_poles"))


def test_the_formulas_by_hand():
    given = {
        **STATED,
        "propeller_diameter": Quantity(0.6, "m", "own ruler"),
        "propeller_pitch": Quantity(0.2, "m", "print on it"),
        "nameplate_max_thrust": Quantity(120.0, "N", "data sheet"),
    }
    made = complete_quantities(given)
    slope = 0.070 * 1.225 * 0.6**4 / 3600.0
    assert made["thrust_coefficient"].value == pytest.approx(slope, rel=1e-3)
    assert made["max_rotor_speed_rpm"].value == pytest.approx(sqrt(120.0 / slope), rel=1e-3)
    each = 28.0 * 9.80665 / 4.0
    induced = sqrt(each / (2.0 * 1.225 * pi * 0.09))
    turning = sqrt(each / slope) * 2.0 * pi / 60.0
    assert made["torque_ratio"].value == pytest.approx(induced / (0.7 * turning), rel=0.01)
    assert made["pump_max_flow_l_min"].value == pytest.approx(2.9)
    usual = {"propeller_blades": 2.0, "reference_density": 1.225, "ceiling_voltage": 51.8}
    usual |= {"ceiling_voltage_exponent": 1.0, "motor_poles": 28.0}
    assert {key: made[key].value for key in usual} == usual
    assert all(made[key].guessed for key in usual)
    # A thrust and its speed are the curve, as well known as they are.
    top = {**given, "max_rotor_speed_rpm": Quantity(4000.0, "rpm", "data sheet")}
    curve = complete_quantities(top)["thrust_coefficient"]
    assert (curve.value, curve.guessed) == (7.5e-6, False)
    guessed = replace(top["max_rotor_speed_rpm"], guessed=True)
    assert complete_quantities({**top, "max_rotor_speed_rpm": guessed})[
        "thrust_coefficient"
    ].guessed
    with pytest.raises(KeyError, match="empty_mass"):
        complete_quantities({key: q for key, q in given.items() if key != "empty_mass"})
    dry = complete_quantities({**given, "tank_volume_l": Quantity(0.0, "L", "none")})
    assert (dry["pump_max_flow_l_min"].value, dry["pump_max_flow_l_min"].guessed) == (0.0, False)


@pytest.mark.parametrize("name", airframe_names())
def test_the_text_of_a_file_is_the_airframe_again(name, tmp_path):
    craft = load_airframe(name)
    path = tmp_path / "again.toml"
    path.write_text(airframe_toml(craft, "made by a test\nof two lines"), encoding="utf-8")
    assert airframe_table(load_airframe(path)) == airframe_table(craft)


def test_text_that_toml_would_stumble_over_comes_back(tmp_path):
    table = airframe_table(load_airframe("topxgun-f16"))
    table["title"] = 'our "best"\n\\ one \x7f\x00é'
    path = tmp_path / "odd.toml"
    path.write_text(airframe_toml(airframe_from_table(table, "odd")), encoding="utf-8")
    assert load_airframe(path).title == table["title"]


TABLES = Path(os.environ.get("THRUSTMARGIN_MEASURED", "/nowhere")) / "vendor_bench_tmotor_kde"


@pytest.mark.measured
@pytest.mark.skipif(not TABLES.is_dir(), reason="THRUSTMARGIN_MEASURED names no such tables")
def test_the_typical_coefficient_is_that_of_the_makers_tables():
    tables: dict[tuple[str, ...], list[float]] = defaultdict(list)
    with (TABLES / "motor_prop_bench_tidy.csv").open() as file:
        for row in csv.DictReader(file):
            size = row["brand"], row["D_in"], row["pitch_in"], row["file"], row["test_V"]
            if float(row["D_in"]) >= 18 and row["blades"] == "2" and float(row["rpm"] or 0) > 300:
                slope = float(row["thrust_g"]) * 9.80665e-3 / float(row["rpm"]) ** 2
                diameter = float(row["D_in"]) * 0.0254
                tables[size].append(
                    dimensionless_coefficient(slope, density=1.225, diameter=diameter)
                )
    propellers: dict[tuple[str, ...], list[float]] = defaultdict(list)
    for size, found in tables.items():
        propellers[size[:3]].append(median(found))
    typical = [median(found) for found in propellers.values()]
    assert len(typical) == 19
    assert median(typical) == pytest.approx(TYPICAL_C_T, abs=0.0005)
    assert stdev(typical) == pytest.approx(0.007, abs=0.0005)
    assert (min(typical), max(typical)) == pytest.approx((0.057, 0.078), abs=0.001)
