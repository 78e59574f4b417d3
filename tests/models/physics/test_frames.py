"""Motor layouts are ArduPilot's: places, order and spin; each can be flown."""

import numpy as np
import pytest

from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.motor_layouts import (
    ardupilot_layout,
    bearings,
    layout_of_rotors,
    layout_of_text,
    motor_layouts,
)

CCW, CW = 1, -1
#: FRAME_CLASS, FRAME_TYPE -> degrees from the nose and spin of motor 1 to n, from the tables of
#: ArduPilot's AP_MotorsMatrix.
PUBLISHED = {
    (1, 0): ([90, -90, 0, 180], [CCW, CCW, CW, CW]),
    (1, 1): ([45, -135, -45, 135], [CCW, CCW, CW, CW]),
    (1, 3): ([45, -135, -45, 135], [CW, CW, CCW, CCW]),
    (1, 12): ([135, 45, -135, -45], [CW, CCW, CCW, CW]),
    (1, 13): ([45, -45, -135, 135], [CCW, CW, CCW, CW]),
    (1, 14): ([45, 135, -135, -45], [CCW, CW, CCW, CW]),
    (2, 0): ([0, 180, -120, 60, -60, 120], [CW, CCW, CW, CCW, CCW, CW]),
    (2, 1): ([90, -90, -30, 150, 30, -150], [CW, CCW, CW, CCW, CCW, CW]),
    (3, 0): ([0, 180, 45, 135, -45, -135, -90, 90], [CW, CW, CCW, CCW, CCW, CCW, CW, CW]),
    (3, 1): (
        [22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5],
        [CW, CW, CCW, CCW, CCW, CCW, CW, CW],
    ),
    (4, 0): ([0, -90, 180, 90, -90, 0, 90, 180], [CCW, CW, CCW, CW, CCW, CW, CCW, CW]),
    (4, 1): ([45, -45, -135, 135, -45, 45, 135, -135], [CCW, CW, CCW, CW, CCW, CW, CCW, CW]),
    (5, 10): ([60, 60, 180, 180, -60, -60], [CW, CCW, CW, CCW, CW, CCW]),
    (5, 0): ([60, -60, -60, 180, 60, 180], [CCW, CW, CCW, CW, CW, CCW]),
}


@pytest.mark.parametrize(("kind", "shape"), PUBLISHED)
def test_order_and_spin_are_ardupilots(kind, shape):
    layout = ardupilot_layout(kind, shape)
    angles, spin = PUBLISHED[kind, shape]
    assert layout is not None
    np.testing.assert_allclose(bearings(layout.place), angles, atol=1e-9)
    assert layout.spin.tolist() == spin


@pytest.mark.parametrize("name", motor_layouts())
def test_every_layout_turns_evenly_controls_all_axes_and_names_each_rotor(name):
    layout = motor_layouts()[name]
    assert layout.spin.sum() == 0.0
    effect = np.vstack([np.ones(layout.rotor_count), layout.place.T, layout.spin])
    assert np.linalg.matrix_rank(effect) == 4
    rotors = layout.rotors(0.8, 0.9)
    assert len({rotor["name"] for rotor in rotors}) == layout.rotor_count
    positions = np.array([rotor["position_frd"] for rotor in rotors])
    assert np.hypot(*positions[:, :2].T).max() == pytest.approx(0.8, abs=1e-5)
    assert layout.mismatch(positions) == ""
    below = positions[:, 2] > 0.0
    assert below.tolist() == list(layout.lower)
    assert [rotor.get("effectiveness", 1.0) < 1.0 for rotor in rotors] == list(layout.lower)


@pytest.mark.parametrize("name", ["topxgun-f16", "agras-t20", "agras-t40"])
def test_shipped_aircraft_have_the_rotors_of_their_layout(name):
    craft = load_airframe(name)
    layout = motor_layouts()[craft.layout]
    made = layout.rotors(craft.arm)
    assert tuple(rotor["name"] for rotor in made) == craft.rotor_names
    np.testing.assert_allclose(
        [rotor["position_frd"][:2] for rotor in made], craft.rotor_position_frd[:, :2], atol=1e-4
    )
    assert layout.spin.tolist() == craft.rotor_spin.tolist()
    assert layout_of_rotors(craft.rotor_position_frd, craft.rotor_spin) is layout


def test_a_coaxial_pair_stands_a_tenth_of_the_arm_above_and_below():
    rotors = motor_layouts()["octo-coaxial-x8"].rotors(0.8)
    heights = [rotor["position_frd"][2] for rotor in rotors]
    assert sorted(set(heights)) == [-0.08, 0.08]
    assert {rotor["position_frd"][2] for rotor in motor_layouts()["hexa-x"].rotors(0.8)} == {0.0}


@pytest.mark.parametrize(("turned", "known"), [(14.0, True), (16.0, False), (-16.0, False)])
def test_rotors_within_fifteen_degrees_of_a_layouts_arms_are_it(turned, known):
    layout = motor_layouts()["quad-x"]
    angle = np.radians(turned)
    back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    places = np.column_stack([layout.place @ back, np.zeros(4)])
    assert (layout_of_rotors(places, layout.spin) is layout) == known


def test_another_number_or_shape_of_rotors_is_no_such_layout():
    plus = np.array([r["position_frd"] for r in motor_layouts()["quad-plus"].rotors(1.0)])
    assert "6 rotors, not 4" in motor_layouts()["hexa-x"].mismatch(plus)
    assert "arms at -135, -45, 45, 135 deg" in motor_layouts()["quad-x"].mismatch(plus)
    narrow = plus[:, :] * [1.0, 0.7, 1.0]
    assert motor_layouts()["quad-plus"].mismatch(narrow) == ""
    assert ardupilot_layout(1, 4) is None
    assert ardupilot_layout(6, 0) is None


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("QUAD/PLUS", "quad-plus"),
        ("QUAD/X", "quad-x"),
        ("QUAD/V", "quad-v"),
        ("QUAD/H", "quad-h"),
        ("QUAD/PLUSREV", "quad-plus-reversed"),
        ("QUAD/BF_X", "quad-bf-x"),
        ("QUAD/DJI_X", "quad-dji-x"),
        ("QUAD/CW_X", "quad-cw-x"),
        ("QUAD/X_REV", "quad-bf-x-reversed"),
        ("QUAD/Y4", "quad-y4"),
        ("HEXA/X", "hexa-x"),
        ("OCTA/I", "octo-i"),
        ("OCTAQUAD/X", "octo-coaxial-x8"),
        ("Y6/default", "y6"),
        ("Y6/Y6B", "y6-b"),
        ("Y6/Y6F", "y6-f"),
        ("DODECAHEXA/X", "dodecahexa-x"),
        ("DECA/X/CW_X", "deca-x"),
    ],
)
def test_the_layout_is_read_from_what_ardupilot_prints_at_boot(text, name):
    """The words are those of AP_Motors::get_type_string."""
    found = layout_of_text(["EKF3 active", f"Frame: {text}"])
    assert found is not None
    assert found.name == name


@pytest.mark.parametrize(
    "text", ["Frame: QUAD/UNKNOWN", "Frame: HELI/X", "Shape: QUAD/X", "QUAD/X"]
)
def test_other_boot_texts_name_no_layout(text):
    assert layout_of_text([text]) is None


def test_layouts_that_turn_the_other_way_are_others():
    x, pair = motor_layouts()["quad-x"], motor_layouts()["octo-coaxial-x8"]
    places = np.pad(x.place, ((0, 0), (0, 1)))
    assert layout_of_rotors(places, x.spin) is x
    assert layout_of_rotors(places, -x.spin) is not x
    # A tenth of the arm above its middle, and below it the lower one; down counts.
    heights = {r["position_frd"][2] * (1 if "lower" in r["name"] else -1) for r in pair.rotors(2.0)}
    assert heights == {0.2}
    # Names of arms in one sector have their bearing from the nose, to either side.
    names = [r["name"] for r in motor_layouts()["octo-x"].rotors(1.0)]
    assert {"front right 22.5", "front left 22.5", "rear left 157.5"} <= set(names)
