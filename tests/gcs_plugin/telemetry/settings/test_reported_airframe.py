"""What parameters say of an airframe: layout, battery, rotors; what they cannot say stays open."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import AirframeError

QUAD = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}


def cells(parameters, highest_voltage=math.nan):
    found = reported_airframe(parameters, highest_voltage).quantities.get("nominal_voltage")
    return (0, True) if found is None else (round(found.value / 3.7), found.guessed)


@pytest.mark.parametrize(
    ("settings", "volts", "expected"),
    [
        ({"MOT_BAT_VOLT_MAX": 60.9, "MOT_BAT_VOLT_MIN": 46.2, "BATT_LOW_VOLT": 50.4}, 56.2, 14),
        ({"MOT_BAT_VOLT_MAX": 25.2, "MOT_BAT_VOLT_MIN": 19.8}, math.nan, 6),
        ({"BATT_LOW_VOLT": 10.5}, 57.4, 14),  # a default that nobody set
        ({"MOT_BAT_VOLT_MAX": 0.0}, 24.9, 6),
        ({"BAT1_N_CELLS": 12.0, "MOT_BAT_VOLT_MAX": 25.2}, math.nan, 12),
        ({"BAT_N_CELLS": 4.0}, math.nan, 4),
    ],
)
def test_cells_are_what_settings_and_voltage_agree_on(settings, volts, expected):
    assert cells(QUAD | settings, volts)[0] == expected


@pytest.mark.parametrize("count", [*range(1, 9), 10, 12, 13, 14, 15, 16, 18, 20, 22, 24, 28])
def test_a_full_battery_of_any_number_sold_is_counted(count):
    assert cells(QUAD | {"MOT_BAT_VOLT_MAX": 4.2 * count})[0] == count
    assert cells(QUAD, 4.15 * count)[0] == count


def test_one_hint_is_a_guess_two_that_agree_are_not_and_none_is_none():
    assert cells(QUAD | {"BATT_LOW_VOLT": 43.2}) == (12, True)
    assert cells(QUAD | {"BATT_LOW_VOLT": 43.2}, 49.1) == (12, False)
    assert cells(QUAD) == (0, True)


@pytest.mark.parametrize(
    ("most", "least", "low", "expected", "guessed"),
    [
        (52.2, 45.6, 46.8, 12, True),  # 4.35 V full; read as LiPo the empty ones say 13
        (60.9, 53.2, 54.6, 14, True),
        (21.8, 16.5, 19.2, 5, False),  # 4.35 V full, rounded up
        (0.0, 19.8, 21.6, 6, True),  # without a full voltage the usual chemistry
        (24.6, 16.8, 18.6, 6, False),  # Li-ion: 4.1, 2.8 and 3.1 V
        (25.2, 18.0, 19.2, 6, False),  # Li-ion charged to 4.2 V
        (92.4, 72.6, 79.2, 22, False),
        (63.0, 49.5, 54.0, 15, False),
        (16.8, 13.2, 14.4, 4, False),
        (16.8, 14.0, 14.8, 4, False),
        (50.4, 39.6, 10.5, 12, False),  # low voltage left at the default of three cells
        (60.9, 46.2, 50.4, 14, False),
    ],
)
def test_settings_of_any_chemistry_are_read_and_differing_readings_are_a_guess(
    most, least, low, expected, guessed
):
    settings = {"MOT_BAT_VOLT_MAX": most, "MOT_BAT_VOLT_MIN": least, "BATT_LOW_VOLT": low}
    assert cells(QUAD | settings) == (expected, guessed)


def test_differing_readings_are_both_stated():
    settings = {"MOT_BAT_VOLT_MAX": 52.2, "MOT_BAT_VOLT_MIN": 45.6, "BATT_LOW_VOLT": 46.8}
    found = reported_airframe(QUAD | settings).quantities["nominal_voltage"]
    assert found.source.endswith(": 12 if HV LiPo, 13 if LiPo")


@pytest.mark.parametrize("volts", [2.5, 5.9, 6.6])
def test_a_voltage_that_no_battery_takes_off_with_says_no_cells(volts):
    assert cells(QUAD, volts) == (0, True)


def test_a_full_cell_is_never_above_a_high_voltage_charger():
    # 4.52 V a cell of 13 would be nearest to the minimum.
    settings = {"MOT_BAT_VOLT_MAX": 58.8, "MOT_BAT_VOLT_MIN": 42.9}
    assert cells(QUAD | settings)[0] == 14


def test_without_parameters_of_the_frame_its_boot_text_says_the_layout():
    assert reported_airframe({}, texts=["EKF3 active", "Frame: HEXA/X"]).layout == "hexa-x"
    assert reported_airframe({}, texts=["Frame: Y6/default"]).layout == "y6"
    assert reported_airframe({}, texts=["Frame: QUAD/BF_X"]).layout == "quad-bf-x"
    assert reported_airframe({}, texts=["Frame: OCTAQUAD/X"]).layout == "octo-coaxial-x8"
    found = reported_airframe(QUAD, texts=["Frame: HEXA/X"])  # the log of a boot before
    assert found.layout == "quad-x"
    assert reported_airframe({}).layout is None


def test_what_is_no_multirotor_or_no_known_frame_is_refused():
    with pytest.raises(AirframeError, match="the vehicle: this is a helicopter"):
        reported_airframe({"FRAME_CLASS": 6.0, "H_RSC_MODE": 1.0})
    with pytest.raises(AirframeError, match="FRAME_CLASS 7, FRAME_TYPE 0 is no layout"):
        reported_airframe({"FRAME_CLASS": 7.0, "FRAME_TYPE": 0.0, "MOT_SPIN_MIN": 0.1})
    assert reported_airframe({"FRAME_CLASS": 7.0}, layout="y6").layout == "y6"


def test_other_outputs_than_the_frame_has_motors_are_noted():
    outputs = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 7)}
    (note,) = reported_airframe(QUAD | outputs).notes
    assert statement_words(note) == "6 motors by SERVOn_FUNCTION, but quad-x has 4"
    assert reported_airframe({"FRAME_CLASS": 2.0, "FRAME_TYPE": 1.0} | outputs).notes == ()


def test_the_lower_rotors_of_a_px4_coaxial_work_in_the_wash_of_the_upper():
    places = [(x, y, z) for z in (-0.1, 0.1) for x, y in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
    given = {"CA_ROTOR_COUNT": 8.0, "CA_AIRFRAME": 0.0}
    for n, place in enumerate(places):
        given |= {f"CA_ROTOR{n}_P{a}": 0.6 * v for a, v in zip("XYZ", place, strict=True)}
        given[f"CA_ROTOR{n}_KM"] = 0.03 if n in (0, 1, 6, 7) else -0.03
    found = reported_airframe(given)
    assert found.rotors is not None
    assert [r.get("effectiveness", 1.0) for r in found.rotors] == [1.0] * 4 + [0.8] * 4
    assert found.quantities["lower_rotor_effectiveness"].guessed
    assert found.quantities["torque_ratio"].value == pytest.approx(0.03)
    assert found.quantities["arm"].value == pytest.approx(0.6 * np.sqrt(2.0))


def px4(**given: float) -> dict[str, float]:
    """Four rotors at the corners of a square with sides of 2 m, the first two counter-clockwise."""
    corners = ((1, 1), (-1, -1), (1, -1), (-1, 1))
    found = {"CA_AIRFRAME": 0.0, "CA_ROTOR_COUNT": 4.0, "MPC_THR_HOVER": 0.4}
    for n, (x, y) in enumerate(corners):
        found |= {f"CA_ROTOR{n}_PX": x, f"CA_ROTOR{n}_PY": y, f"CA_ROTOR{n}_PZ": 0.0}
        found[f"CA_ROTOR{n}_KM"] = 0.05 if n < 2 else -0.05
    return found | given


def test_rotors_of_a_px4_by_hand():
    found = reported_airframe(px4())
    assert found.rotors is not None
    assert [r["position_frd"] for r in found.rotors][1] == [-1.0, -1.0, 0.0]
    assert [r["spin"] for r in found.rotors] == ["ccw", "ccw", "cw", "cw"]
    assert (found.layout, found.rotor_count) == ("quad-x", 4)
    # A coefficient that is PX4's own default is no measured one; none is a rotor below another.
    assert set(found.quantities) == {"arm"}
    # A fifth that pushes backward lifts nothing; of 13 the first twelve are listed.
    pusher = px4(CA_ROTOR_COUNT=5.0, CA_ROTOR4_AX=-1.0, CA_ROTOR4_PX=-3.0)
    assert reported_airframe(pusher).rotor_count == 4
    many = {f"CA_ROTOR{n}_PX": 1.0 + n for n in range(13)}
    with_many = reported_airframe(px4(**many, CA_ROTOR_COUNT=13.0), layout=None)
    assert with_many.rotor_count == 12


def test_three_rotors_are_enough_for_a_px4_and_a_stated_layout_takes_their_place():
    three = px4(CA_ROTOR_COUNT=3.0)
    found = reported_airframe(three)
    assert found.rotors is not None
    assert len(found.rotors) == 3
    assert reported_airframe(three, layout="y6").rotors is None
    assert reported_airframe(px4(CA_ROTOR_COUNT=2.0)).rotors is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"CA_ROTOR1_KM": math.nan}, "a CA_ROTORn_KM is no number"),
        ({"CA_ROTOR1_PX": math.nan}, "put all rotors at the centre"),
        ({f"CA_ROTOR{n}_P{a}": 0.0 for n in range(4) for a in "XY"}, "all rotors at the centre"),
    ],
)
def test_a_px4_whose_rotors_are_not_set_is_refused(given, message):
    with pytest.raises(AirframeError, match=message):
        reported_airframe(px4(**given))
    # One at the centre is a place like any other.
    assert reported_airframe(px4(CA_ROTOR0_PX=0.0, CA_ROTOR0_PY=0.0)).rotor_count == 4


def test_poles_of_an_ardupilot():
    esc = {"SERVO_BLH_POLES": 28.0, "SERVO_BLH_MASK": 15.0, "MOT_THST_HOVER": 0.35}
    found = reported_airframe(QUAD | esc)
    assert found.quantities["motor_poles"].value == 28.0
    unused = reported_airframe(QUAD | esc | {"SERVO_BLH_MASK": 0.0})
    assert "motor_poles" not in unused.quantities
    # Without a type it is the usual X.
    assert reported_airframe({"FRAME_CLASS": 1.0}).layout == "quad-x"
    plus = reported_airframe({"FRAME_CLASS": 1.0, "FRAME_TYPE": 0.0})
    assert plus.layout == "quad-plus"


@pytest.mark.parametrize(("setting", "counts"), [(11.9 * 3.6, True), (12.1 * 3.6, False)])
def test_a_setting_a_fifth_off_the_flight_is_of_another_battery(setting, counts):
    # 41 V are 10 full cells; a setting of 12 cells is 20 % above.
    found = reported_airframe(QUAD | {"BATT_LOW_VOLT": setting}, 41.0)
    voltage = found.quantities["nominal_voltage"]
    assert ("BATT_LOW_VOLT" in voltage.source) == counts
    assert voltage.guessed == (not counts)


def test_a_px4_whose_rotors_push_forward_has_none_to_lift_it():
    pushing = {"CA_ROTOR_COUNT": 4.0} | {f"CA_ROTOR{n}_AX": 1.0 for n in range(4)}
    with pytest.raises(AirframeError, match="0 of 4 rotors point upward"):
        reported_airframe(pushing)


NAMES = [*QUAD, "Q_ENABLE", "Q_FRAME_CLASS", "SERVO1_FUNCTION", "SERVO3_FUNCTION", "BAT1_N_CELLS"]
NAMES += ["CA_ROTOR_COUNT", "CA_ROTOR0_PX", "CA_ROTOR0_KM", "CA_ROTOR1_AX", "MOT_BAT_VOLT_MAX"]
NAMES += ["SERVO_BLH_POLES", "SERVO_BLH_MASK", "BATT_LOW_VOLT", "MOT_THST_HOVER", "CA_AIRFRAME"]
NUMBERS = st.one_of(st.floats(), st.integers(-3, 40).map(float))


@settings(max_examples=300, deadline=None)
@example({"CA_ROTOR_COUNT": math.inf}, 0.0)
@example({"FRAME_CLASS": 1.0, "BAT1_N_CELLS": 1e307}, 0.0)
@given(st.dictionaries(st.sampled_from(NAMES), NUMBERS), NUMBERS)
def test_damaged_parameters_are_an_airframe_error_or_an_answer(parameters, volts):
    try:
        found = reported_airframe(parameters, volts)
    except AirframeError:
        return
    assert all(0 < q.value < math.inf for q in found.quantities.values())


@pytest.mark.parametrize(
    ("volts", "expected"),
    [(1.9, (1, True)), (2.1, (0, True)), (4.1, (1, False)), (math.nan, (1, True))],
)
def test_a_voltage_in_flight_is_a_hint_from_two_volts_on(volts, expected):
    """Beside a setting of one cell, which is one hint; 2.1 V are none of a cell at take-off."""
    assert cells(QUAD | {"BATT_LOW_VOLT": 3.6}, volts) == expected
