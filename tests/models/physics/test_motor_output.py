"""Thrust of motor outputs against numbers worked out by hand from the firmware's own formulas."""

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.physics.motor_output import output_curve
from thrustmargin.models.provenance import NOT_REPORTED, Meaning

DEMAND = sent("actuator_motors control", meaning=Meaning.THRUST_DEMAND)


def share(parameters, output, source=NOT_REPORTED) -> float:
    return output_curve(parameters, source).thrust_share(np.array([output]))[0]


def test_ardupilots_curve_is_undone():
    # thrust_to_actuator(0.3): (0.65 - 1 + sqrt(0.35² + 4 x 0.65 x 0.3))/(2 x 0.65)
    #   = (-0.35 + sqrt(0.9025))/1.3 = 0.6/1.3; output 0.15 + 0.8 x 0.6/1.3
    set_by = {"MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}
    assert share(set_by, 0.15 + 0.8 * 0.6 / 1.3) == pytest.approx(0.3)


def test_an_exponent_of_zero_is_a_straight_line_and_one_a_square():
    spin = {"MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9}
    assert share({**spin, "MOT_THST_EXPO": 0.0}, 0.5) == pytest.approx(0.5)
    assert share({**spin, "MOT_THST_EXPO": 1.0}, 0.5) == pytest.approx(0.25)
    # the least exponent that the firmware allows: 2 x 0.5 - 0.25
    assert share({**spin, "MOT_THST_EXPO": -1.0}, 0.5) == pytest.approx(0.75)


def test_without_parameters_the_firmwares_defaults_are_said_to_be_assumed():
    curve = output_curve({})
    assert curve.thrust_share(np.array([0.15 + 0.8 * 0.6 / 1.3]))[0] == pytest.approx(0.3)
    assert "assumed" in statement_words(curve.set_by)
    assert curve.steepness_error == 2 * output_curve({"MOT_THST_EXPO": 0.65}).steepness_error


@pytest.mark.parametrize(
    "wrong",
    [{"MOT_THST_EXPO": np.nan}, {"MOT_THST_EXPO": 7.0}, {"MOT_SPIN_MIN": 1.0}],
)
def test_a_parameter_that_cannot_be_is_taken_as_not_set(wrong):
    assert share(wrong, 0.15 + 0.8 * 0.6 / 1.3) == pytest.approx(0.3)


def test_px4s_curve_is_that_of_its_signal():
    # FunctionMotors: thrust 0.28 with factor 0.5 becomes -0.5 + sqrt(0.25 + 0.56) = 0.4
    assert share({"THR_MDL_FAC": 0.5}, 0.4, sent("ACTUATOR_OUTPUT_STATUS")) == pytest.approx(0.28)


def test_px4s_actuator_motors_is_thrust_already():
    assert share({"THR_MDL_FAC": 0.5}, 0.28, DEMAND) == pytest.approx(0.28)
    # without a factor the control is the signal: 0.35 x 0.6 + 0.65 x 0.36
    unset = share({"THR_MDL_FAC": 0.0}, 0.6, DEMAND)
    assert unset == pytest.approx(0.444)


def test_an_idling_motor_has_no_share():
    assert np.isnan(share({}, 0.12))
    assert np.isnan(share({}, np.nan))


@pytest.mark.parametrize(("thrust", "known"), [(0.009, False), (0.011, True)])
def test_below_a_hundredth_of_full_thrust_the_curve_says_nothing(thrust, known):
    curve = output_curve({"MOT_THST_EXPO": 0.0, "MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0})
    found = curve.thrust_share(np.array([thrust]))
    np.testing.assert_allclose(found, [thrust if known else np.nan])
