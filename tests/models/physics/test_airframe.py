"""Airframe files: what ships is complete and sourced, what is wrong is refused with a remedy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thrustmargin.models.errors import AirframeError
from thrustmargin.models.physics.airframe import (
    QUANTITIES,
    airframe_from_table,
    airframe_names,
    airframe_table,
    load_airframe,
    table_problems,
)

SHIPPED = airframe_names()
SPRAYERS = [name for name in SHIPPED if load_airframe(name).tank_capacity_kg > 0]


def test_quad_hexa_and_coaxial_octo_ship():
    layouts = {load_airframe(name).layout: load_airframe(name).rotor_count for name in SHIPPED}
    assert layouts == {"quad-x": 4, "hexa-x": 6, "octo-coaxial-x8": 8}


@pytest.mark.parametrize("name", SHIPPED)
def test_every_value_says_its_unit_and_where_it_is_from(name):
    airframe = load_airframe(name)
    assert set(airframe.quantities) == set(QUANTITIES)
    for quantity in airframe.quantities.values():
        assert quantity.unit
        assert len(quantity.source) > 8


@pytest.mark.parametrize("name", SHIPPED)
def test_rotors_balance_about_the_centre(name):
    airframe = load_airframe(name)
    np.testing.assert_allclose(airframe.rotor_position_frd[:, :2].sum(axis=0), 0.0, atol=1e-9)
    assert airframe.rotor_spin.sum() == 0.0
    assert (airframe.rotor_spin * airframe.rotor_effectiveness).sum() == pytest.approx(0.0)


@pytest.mark.parametrize("name", SPRAYERS)
def test_curve_reaches_the_nameplate_within_the_rotor_speed_it_can_turn(name):
    airframe = load_airframe(name)
    top = airframe.thrust_coefficient * airframe.max_rotor_speed_rpm**2
    assert top >= 0.999 * airframe.nameplate_max_thrust


def test_f16_is_the_papers():
    airframe = load_airframe("topxgun-f16")
    assert airframe.empty_mass == 21.1
    assert airframe.tank_capacity_kg == 16.0
    assert airframe.thrust_coefficient == 2.011e-5
    assert airframe.nameplate_max_thrust == pytest.approx(17.0 * 9.80665, abs=1e-3)
    assert airframe.rotor_names == ("front right", "rear left", "front left", "rear right")


def test_extends_takes_all_but_what_it_replaces():
    real, simulated = load_airframe("topxgun-f16"), load_airframe("topxgun-f16-sitl")
    assert simulated.empty_mass == real.empty_mass
    assert simulated.ceiling_voltage == 58.8
    np.testing.assert_array_equal(simulated.rotor_spin, real.rotor_spin)


def test_a_full_tank_is_volume_times_density():
    table = airframe_table(load_airframe("topxgun-f16"))
    table["quantities"]["liquid_density"]["value"] = 1.25
    assert airframe_from_table(table, "table").tank_capacity_kg == 20.0  # 16 L x 1.25 kg/L


@pytest.mark.parametrize("name", SHIPPED)
def test_an_airframe_is_its_own_table_again(name):
    airframe = load_airframe(name)
    again = airframe_from_table(airframe_table(airframe), "table")
    assert airframe_table(again) == airframe_table(airframe)
    np.testing.assert_array_equal(again.rotor_spin, airframe.rotor_spin)
    np.testing.assert_array_equal(again.rotor_position_frd, airframe.rotor_position_frd)
    np.testing.assert_array_equal(again.rotor_effectiveness, airframe.rotor_effectiveness)
    words = [rotor["spin"] for rotor in airframe_table(airframe)["rotors"]]
    assert [spin > 0 for spin in airframe.rotor_spin] == [word == "ccw" for word in words]


@pytest.mark.parametrize(
    "name", ["tank_volume_l", "pump_max_flow_l_min", "ceiling_voltage_exponent"]
)
def test_no_tank_no_pump_and_no_effect_of_voltage_are_zero(tmp_path, name):
    airframe = load_airframe(write(tmp_path, quantity(name, 0.0, QUANTITIES[name])))
    assert getattr(airframe, name) == 0.0


@pytest.mark.parametrize("name", sorted(set(QUANTITIES) - {"tank_volume_l", "pump_max_flow_l_min"}))
@pytest.mark.parametrize("value", ["-0.1", "inf"])
def test_nothing_is_below_zero_or_without_end(tmp_path, name, value):
    with pytest.raises(AirframeError, match=f"{name} is .*; it must be a number above 0"):
        load_airframe(write(tmp_path, quantity(name, value, QUANTITIES[name])))


def test_a_mass_may_not_be_zero_and_may_be_an_integer(tmp_path):
    with pytest.raises(AirframeError, match="above 0"):
        load_airframe(write(tmp_path, quantity("empty_mass", 0, "kg")))
    assert load_airframe(write(tmp_path, quantity("empty_mass", 22, "kg"))).empty_mass == 22.0


def test_what_extends_what_extends_it_is_refused(tmp_path):
    write(tmp_path, 'extends = "other.toml"\n', "mine.toml")
    path = write(tmp_path, 'extends = "mine.toml"\n', "other.toml")
    with pytest.raises(AirframeError, match="extends it again"):
        load_airframe(path)


def test_a_child_replaces_only_the_rotors_and_quantities_it_gives(tmp_path):
    write(tmp_path, quantity("empty_mass", 30.0, "kg"), "base.toml")
    child = 'extends = "base.toml"\n[quantities]\nnominal_voltage = '
    path = write(tmp_path, child + '{ value = 50.0, unit = "V", source = "own measurement" }\n')
    airframe = load_airframe(path)
    assert (airframe.empty_mass, airframe.nominal_voltage) == (30.0, 50.0)
    assert airframe.thrust_coefficient == 2.011e-5
    assert airframe.name == "topxgun-f16"
    assert airframe.quantities["nominal_voltage"].source == "own measurement"


def write(tmp_path, text, name="mine.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_own_file_can_extend_a_shipped_airframe(tmp_path):
    path = write(
        tmp_path,
        'extends = "topxgun-f16"\nname = "mine"\n[quantities]\n'
        'empty_mass = { value = 22.4, unit = "kg", source = "own scale" }\n',
    )
    airframe = load_airframe(path)
    assert (airframe.name, airframe.empty_mass, airframe.rotor_count) == ("mine", 22.4, 4)


def test_a_file_may_name_where_the_tank_level_comes_from(tmp_path):
    assert load_airframe("topxgun-f16").tank_source == "auto"
    path = tmp_path / "ours.toml"
    path.write_text('extends = "topxgun-f16"\ntank_source = "BATTERY_STATUS 1"\n')
    ours = load_airframe(path)
    assert ours.tank_source == "BATTERY_STATUS 1"
    assert airframe_from_table(airframe_table(ours), "table").tank_source == ours.tank_source


def test_own_file_extends_a_neighbour_in_its_own_folder(tmp_path):
    write(tmp_path, 'extends = "topxgun-f16"\nname = "base"\n', "base.toml")
    path = write(tmp_path, 'extends = "base.toml"\nname = "mine"\n')
    assert load_airframe(path).empty_mass == 21.1


def quantity(name, value, unit):
    return (
        f'extends = "topxgun-f16"\n[quantities]\n{name} = '
        f'{{ value = {value}, unit = "{unit}", source = "a test of the reader" }}\n'
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (quantity("empty_mass", 22400, "g"), "empty_mass is in 'g'; give it in 'kg'"),
        (quantity("empty_mass", -3.0, "kg"), "empty_mass is -3.0; it must be a number above 0"),
        (quantity("empty_mass", "nan", "kg"), "must be a number above 0"),
        (quantity("empty_mass", "true", "kg"), "must be a number above 0"),
        (quantity("empty_mass", '"22"', "kg"), "must be a number above 0"),
        (quantity("empty_mas", 22.4, "kg"), "unknown quantity 'empty_mas'"),
        ('extends = "topxgun-f16"\n[quantities]\nempty_mass = 22.4\n', "needs value, unit"),
        ('extends = "topxgun-f16"\nrotors = []\n', "at least 3"),
        ('extends = "mine.toml"\n', "extends it again"),
        ('extends = "no-such"\n', "no airframe 'no-such'; shipped are"),
        ("extends = 7\n", "no airframe '7'"),
        ("quantities = 7\n", "quantities must be a table"),
        ("rotors = 7\n", "rotors must be a table"),
        ('title = "a"\n', "empty_mass needs value, unit"),
        ("a = = b\n", "not a TOML file"),
    ],
)
def test_a_wrong_file_is_refused_with_what_to_do(tmp_path, text, message):
    with pytest.raises(AirframeError, match=message):
        load_airframe(write(tmp_path, text))


ROTORS = """
extends = "topxgun-f16"
layout = "custom"
[[rotors]]
name = "one"
position_frd = [1.0, 0.0, 0.0]
spin = "ccw"
[[rotors]]
name = "two"
position_frd = [-0.5, 0.8, 0.0]
spin = "cw"
[[rotors]]
name = "three"
position_frd = [-0.5, -0.8, 0.0]
spin = "cw"
"""


def test_any_rotor_count_from_three_can_be_described(tmp_path):
    airframe = load_airframe(write(tmp_path, ROTORS))
    assert airframe.rotor_count == 3
    assert airframe.rotor_spin.tolist() == [1.0, -1.0, -1.0]
    assert airframe.rotor_effectiveness.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(AirframeError, match="2 \\[\\[rotors\\]\\]; a multirotor has at least 3"):
        load_airframe(write(tmp_path, ROTORS[: ROTORS.rindex("[[rotors]]")]))


def test_rotors_on_a_line_fly_and_rotors_in_one_place_do_not(tmp_path):
    line = ROTORS.replace("[-0.5, 0.8, 0.0]", "[0, 0, 0]").replace("[-0.5, -0.8, 0.0]", "[0, 0, 0]")
    assert load_airframe(write(tmp_path, line)).rotor_count == 3
    with pytest.raises(AirframeError, match="all rotors are at the centre"):
        load_airframe(write(tmp_path, line.replace("[1.0, 0.0, 0.0]", "[0.0, 0.0, 1.0]")))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('spin = "ccw"', 'spin = "left"', "rotor 1: spin is 'left'; write 'ccw' or 'cw'"),
        ("[1.0, 0.0, 0.0]", "[1.0, 0.0]", "three numbers in m"),
        ("[1.0, 0.0, 0.0]", "[inf, 0.0, 0.0]", "three numbers in m"),
        ('name = "one"', 'name = "one"\neffectiveness = 1.4', "above 0 and at most 1"),
        ('name = "one"', 'name = "one"\neffectiveness = 0.0', "above 0 and at most 1"),
    ],
)
def test_a_wrong_rotor_is_refused(tmp_path, old, new, message):
    with pytest.raises(AirframeError, match=message):
        load_airframe(write(tmp_path, ROTORS.replace(old, new, 1)))


@pytest.mark.parametrize("name", ["no-such", "no-such.toml", "", "."])
def test_a_name_that_is_no_airframe_is_refused(name):
    with pytest.raises(AirframeError):
        load_airframe(name)


def test_a_folder_or_binary_file_is_refused(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x81")
    for name in ("folder.toml", "binary.toml"):
        with pytest.raises(AirframeError, match="cannot read"):
            load_airframe(tmp_path / name)


def test_a_quantity_needs_its_unit_and_source_and_may_have_a_note(tmp_path):
    entry = 'extends = "topxgun-f16"\n[quantities]\nempty_mass = { value = 22.0, unit = "kg"'
    with pytest.raises(AirframeError, match=r"empty_mass needs value, unit \(kg\) and source"):
        load_airframe(write(tmp_path, entry + " }\n"))
    noted = entry + ', source = "own scale", note = "without the rear cover" }\n'
    assert load_airframe(write(tmp_path, noted)).empty_mass == 22.0


CHILD = 'extends = "topxgun-f16"\nlayout = "hexa-x"\n'
ARM = '[quantities]\narm = { value = 0.9, unit = "m", source = "own tape" }\n'


def test_a_layout_alone_does_not_keep_the_rotors_of_another(tmp_path):
    with pytest.raises(AirframeError, match=r"hexa-x without rotors: give its 6 \[\[rotors"):
        load_airframe(write(tmp_path, CHILD))
    craft = load_airframe(write(tmp_path, CHILD + ARM))
    assert craft.rotor_spin.tolist() == [-1, 1, -1, 1, 1, -1]
    assert craft.arm == pytest.approx(0.9)
    again = airframe_from_table(airframe_table(craft), "table")
    np.testing.assert_array_equal(again.rotor_position_frd, craft.rotor_position_frd)
    longer = load_airframe(write(tmp_path, 'extends = "topxgun-f16"\n' + ARM))
    assert (longer.rotor_count, round(longer.arm, 3)) == (4, 0.9)


LOWER = 'lower_rotor_effectiveness = { value = %g, unit = "1", source = "own bench" }\n'
COAXIAL = CHILD.replace("hexa-x", "octo-coaxial-x8") + ARM


def test_the_lower_rotors_of_a_coaxial_layout_need_their_share_of_thrust(tmp_path):
    craft = load_airframe(write(tmp_path, COAXIAL + LOWER % 0.8))
    assert sorted(craft.rotor_effectiveness.tolist()) == [0.8] * 4 + [1.0] * 4
    assert load_airframe(write(tmp_path, COAXIAL + LOWER % 1.0)).rotor_effectiveness.sum() == 8.0
    for text in (COAXIAL, COAXIAL + LOWER % 1.2):
        with pytest.raises(
            AirframeError, match=r"octo-coaxial-x8 without .* arm, lower_rotor_effect"
        ):
            load_airframe(write(tmp_path, text))


def test_own_rotors_replace_the_arm_of_the_base_too(tmp_path):
    write(tmp_path, CHILD + ARM, "base.toml")
    own = ROTORS.replace('extends = "topxgun-f16"', 'extends = "base.toml"')
    craft = load_airframe(write(tmp_path, own))
    assert (craft.rotor_count, "arm" in craft.quantities) == (3, False)


def test_rotors_of_another_number_than_the_layout_are_refused(tmp_path):
    wrong = ROTORS.replace('layout = "custom"', 'layout = "quad-x"')
    with pytest.raises(AirframeError, match=r"disagree: quad-x has 4 rotors, not 3"):
        load_airframe(write(tmp_path, wrong))
    with pytest.raises(AirframeError, match=r"layout 'hexx-x' is none .* did you mean hexa-x"):
        load_airframe(write(tmp_path, CHILD.replace("hexa-x", "hexx-x") + ARM))
    both = airframe_table(load_airframe("topxgun-f16"))
    both["quantities"]["arm"] = {"value": 0.7, "unit": "m", "source": "own tape"}
    with pytest.raises(AirframeError, match=r"arm is 0.7 m, but the farthest .* is 0.9595 m"):
        airframe_from_table(both, "table")


def test_all_that_is_wrong_is_said_at_once(tmp_path):
    text = """extends = "topxgun-f16"
titel = "mine"
[quantities]
empty_mass = { value = 22400, unit = "g", source = "own scale" }
propeler_pitch = { value = 0.3, unit = "m", source = "own" }
liquid_density = { value = -1, unit = "kg/L", source = "own", guesed = true }
torque_ratio = { value = 0.05, unit = "m", source = "own", guessed = "yes" }
[[rotors]]
name = "one"
spin = "left"
position_frd = [1.0, 2.0]
[[rotors]]
name = 2
spin = "cw"
position_frd = [500.0, 500.0, 0.0]
efectiveness = 0.8
[[rotors]]
name = "three"
spin = "cw"
position_frd = [0.0, -1.0, 0.0]
"""
    with pytest.raises(AirframeError) as error:
        load_airframe(write(tmp_path, text))
    said = str(error.value)
    assert "11 things to correct" in said
    for words in (
        "unknown key 'titel'; did you mean title?",
        "empty_mass is in 'g'; give it in 'kg'",
        "unknown quantity 'propeler_pitch'; did you mean propeller_pitch?",
        "liquid_density is -1; it must be a number above 0",
        "unknown key of liquid_density 'guesed'; did you mean guessed?",
        "torque_ratio: guessed is 'yes'; write true or false",
        "rotor 1: spin is 'left'",
        "rotor 1: position_frd must be three numbers in m",
        "rotor 2 needs a name",
        "rotor 2: position_frd [500.0, 500.0, 0.0] is not in m",
        "unknown key of rotor 2 'efectiveness'; did you mean effectiveness?",
    ):
        assert words in said


@pytest.mark.parametrize(
    ("name", "value", "unit", "message"),
    [
        ("propeller_diameter", 36.0, "m", "C_T of .* check both units"),
        ("propeller_diameter", 1e-90, "m", "is 1e-90 m and .* check both units"),
        ("thrust_coefficient", 2.05e-6, "N/rpm^2", "C_T of .* check both units"),
        ("empty_mass", 211.0, "kg", "does not lift the empty weight of 2069 N"),
        ("liquid_density", 1000.0, "kg/L", "a liquid has 0.5 to 3: check its unit"),
        ("tank_volume_l", 16000.0, "L", "a full tank of 16000 L alone weighs 1.569e"),
    ],
)
def test_values_that_are_impossible_together_are_refused(tmp_path, name, value, unit, message):
    with pytest.raises(AirframeError, match=message):
        load_airframe(write(tmp_path, quantity(name, value, unit)))


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        # C_T = a 3600/(rho D^4) from 0.01 to 0.5: at D = 1 m and 1.2 kg/m³ a = C_T/3000.
        ({"thrust_coefficient": 0.0101 / 3000.0}, True),
        ({"thrust_coefficient": 0.0099 / 3000.0}, False),
        ({"thrust_coefficient": 0.499 / 3000.0}, True),
        ({"thrust_coefficient": 0.501 / 3000.0}, False),
        # Four rotors of 2e-5 x 3000² = 180 N lift 73.42 kg.
        ({"empty_mass": 73.4, "thrust_coefficient": 2e-5, "max_rotor_speed_rpm": 3000.0}, True),
        ({"empty_mass": 73.5, "thrust_coefficient": 2e-5, "max_rotor_speed_rpm": 3000.0}, False),
        ({"arm": 0.965}, True),  # the rotors stand at 0.9595 m: one in a hundred may be rounding
        ({"arm": 0.975}, False),
    ],
)
def test_limits_of_what_an_airframe_can_be(change, fits):
    table = airframe_table(load_airframe("topxgun-f16"))
    usual = {"propeller_diameter": 1.0, "reference_density": 1.2, "max_rotor_speed_rpm": 30_000.0}
    for name, value in (usual | change).items():
        unit = {"arm": "m", **QUANTITIES}[name]
        table["quantities"][name] = {"value": value, "unit": unit, "source": "own"}
    assert (table_problems(table) == []) == fits


@pytest.mark.parametrize(("metres", "fits"), [(50.0, True), (50.1, False)])
def test_a_rotor_stands_within_fifty_metres(metres, fits):
    table: dict[str, Any] = airframe_table(load_airframe("topxgun-f16"))
    table["layout"] = "custom"
    for rotor in table["rotors"]:
        rotor["position_frd"] = [metres * np.sign(v) for v in rotor["position_frd"]]
    table["quantities"].pop("arm", None)
    assert (table_problems(table) == []) == fits


@pytest.mark.parametrize(("key", "value"), [("quantities", [1]), ("rotors", {"a": 1})])
def test_a_table_of_the_wrong_kind_is_refused(key, value):
    table = airframe_table(load_airframe("topxgun-f16"))
    with pytest.raises(AirframeError, match=f"{key} must be a table"):
        airframe_from_table(table | {key: value}, "table")


def test_a_guess_stays_a_guess_through_file_and_table(tmp_path):
    text = quantity("torque_ratio", 0.05, "m").replace(" }", ", guessed = true }")
    craft = load_airframe(write(tmp_path, text))
    assert "torque_ratio" in craft.guessed
    again = airframe_from_table(airframe_table(craft), "table")
    assert again.guessed == craft.guessed
    assert again.quantities["torque_ratio"].guessed


@pytest.mark.parametrize("name", SHIPPED)
def test_what_is_assumed_of_a_shipped_aircraft_is_marked_as_a_guess(name):
    for quantity in load_airframe(name).quantities.values():
        assert quantity.guessed == quantity.source.startswith(("assumed", "derived"))


def test_a_number_too_large_for_a_number_is_listed_with_the_rest(tmp_path):
    shipped = Path(__file__).parents[3] / "models/airframes/topxgun-f16.toml"
    text = shipped.read_text(encoding="utf-8")
    for old in ("empty_mass = { value = 21.1", "tank_volume_l = { value = 16.0"):
        assert old in text
        text = text.replace(old, old.rpartition(" ")[0] + " 1" + "0" * 400)
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    with pytest.raises(AirframeError, match=r"(?s)2 things to correct.*empty_mass.*tank_volume_l"):
        load_airframe(tmp_path / "x.toml")
