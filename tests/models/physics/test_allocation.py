"""Mixer and linear programs: geometry, symmetry, what each layout holds with a rotor lost."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from thrustmargin.models.physics.airframe import Airframe, airframe_names, load_airframe
from thrustmargin.models.physics.margin import holdable, mixer, trim_curve

SHIPPED = airframe_names()
QUAD, HEXA, X8 = (load_airframe(n) for n in ("topxgun-f16", "agras-t20", "agras-t40"))


def rearranged(airframe: Airframe, position_frd, spin, effectiveness=None) -> Airframe:
    position = np.asarray(position_frd, dtype=float)
    return replace(
        airframe,
        rotor_position_frd=position,
        rotor_spin=np.asarray(spin, dtype=float),
        rotor_effectiveness=np.ones(len(position)) if effectiveness is None else effectiveness,
        rotor_names=tuple(f"rotor {i + 1}" for i in range(len(position))),
    )


def shifted(airframe: Airframe, x: float, y: float) -> Airframe:
    """With the centre of gravity moved by (x, y) m frd: positions count from it."""
    return replace(airframe, rotor_position_frd=airframe.rotor_position_frd - [x, y, 0.0])


def ring(count: int, spin) -> Airframe:
    angle = np.arange(count) * 2 * np.pi / count
    position = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return rearranged(QUAD, position, spin)


@pytest.mark.parametrize("name", SHIPPED)
def test_mixer_is_the_cross_product_of_arm_and_force(name):
    airframe = load_airframe(name)
    force_frd = np.array([0.0, 0.0, -1.0])  # thrust of one newton, upwards
    moment = np.cross(airframe.rotor_position_frd, force_frd)
    matrix = mixer(airframe)
    np.testing.assert_allclose(matrix[0], 1.0)
    np.testing.assert_allclose(matrix[1:3], moment[:, :2].T)


@pytest.mark.parametrize("name", SHIPPED)
def test_mixer_is_its_own_mirror_image(name):
    """Left and right exchanged: roll and yaw change sign, collective and pitch stay."""
    airframe = load_airframe(name)
    mirrored = airframe.rotor_position_frd * [1.0, -1.0, 1.0]
    distance = np.linalg.norm(mirrored[:, None] - airframe.rotor_position_frd[None], axis=2)
    twin = distance.argmin(axis=1)
    np.testing.assert_allclose(distance[np.arange(len(twin)), twin], 0.0, atol=1e-12)
    matrix = mixer(airframe)
    np.testing.assert_allclose(matrix[:, twin], matrix * [[1.0], [-1.0], [1.0], [-1.0]])


def test_more_thrust_on_the_right_rolls_left_and_in_front_pitches_up():
    front_right = np.array([1.0, 0.0, 0.0, 0.0])
    _, roll, pitch, yaw = mixer(QUAD) @ front_right
    assert roll < 0.0
    assert pitch > 0.0
    assert yaw > 0.0  # it turns counter-clockwise, so its drag turns the body to the right


def test_the_mixer_by_hand():
    # Arms 0.5 m to the front and 0.4 m to the side, drag of 0.05 N m for each newton of thrust.
    x, y = 0.5, 0.4
    quad = rearranged(
        replace(QUAD, torque_ratio=0.05),
        [[x, y, 0.1], [-x, -y, 0.1], [x, -y, 0.1], [-x, y, 0.1]],
        [1, 1, -1, -1],
    )
    np.testing.assert_allclose(
        mixer(quad),
        [[1, 1, 1, 1], [-y, y, y, -y], [x, -x, x, -x], [0.05, 0.05, -0.05, -0.05]],
    )
    # 10, 20, 30 and 40 N: roll -4 + 8 + 12 - 16 = 0, pitch 5 - 10 + 15 - 20 = -10,
    # yaw 0.5 + 1 - 1.5 - 2 = -2 N m.
    together = mixer(quad) @ [10.0, 20.0, 30.0, 40.0]
    np.testing.assert_allclose(together, [100.0, 0.0, -10.0, -2.0], atol=1e-12)


def test_heading_needs_the_torques_balanced_not_only_the_moments():
    # A level quad has equal thrust a on its diagonal of rotors 1 and 2, and b on that of 3 and 4.
    # All turning one way: yaw 2a + 2b = 0. With 4 alone the other way: 2a + b - b = 0, so a = 0.
    for spin, most in (([1, 1, 1, 1], 0.0), ([1, 1, 1, -1], 2.0)):
        odd = replace(QUAD, rotor_spin=np.array(spin, dtype=float))
        assert holdable(odd).intact == pytest.approx(most, abs=1e-9)
        np.testing.assert_allclose(holdable(odd).yaw_uncontrolled, 2.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_rotors_on_a_line_along_or_across_are_held_too(axis):
    # Arms of 1, 0 and -1 m: equal outer thrusts a, and with spins + - + their sum is that of the
    # middle: a = 1/2 and 1, 2 together. The middle one lost: both outer ones full.
    position = np.zeros((3, 3))
    position[:, axis] = [1.0, 0.0, -1.0]
    held = holdable(rearranged(QUAD, position, [1, -1, 1]))
    assert held.intact == pytest.approx(2.0)
    np.testing.assert_allclose(held.yaw_uncontrolled, [1.0, 2.0, 1.0])
    np.testing.assert_allclose(held.yaw_kept, 0.0, atol=1e-9)


def test_a_trim_curve_by_hand():
    # Quad, yaw kept: all four carry a quarter each, so rotor 0 does.
    kept = trim_curve(QUAD, 0)
    np.testing.assert_allclose(kept.collective, [0.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(kept.rotor, [0.0, 1.0], atol=1e-9)
    # Yaw uncontrolled: nothing needed up to 2, where its own diagonal has to join; full at 4.
    free = trim_curve(QUAD, 0, False)
    np.testing.assert_allclose(free.collective, [2.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(free.rotor, [0.0, 1.0], atol=1e-9)
    # A weak rotor opposite: its diagonal joins with two equal shares of at most 0.6.
    weak = replace(QUAD, rotor_effectiveness=np.array([1.0, 0.6, 1.0, 1.0]))
    free = trim_curve(weak, 0, False)
    np.testing.assert_allclose(free.collective, [2.0, 3.2], atol=1e-9)
    np.testing.assert_allclose(free.rotor, [0.0, 0.6], atol=1e-9)


def test_equal_thrust_is_trim_until_the_centre_of_gravity_moves():
    assert mixer(QUAD) @ np.ones(4) == pytest.approx([4.0, 0.0, 0.0, 0.0], abs=1e-12)
    _, roll, pitch, _ = mixer(shifted(QUAD, 0.05, 0.02)) @ np.ones(4)
    assert roll == pytest.approx(4 * 0.02)  # weight to the right of the old centre
    assert pitch == pytest.approx(-4 * 0.05)


def test_quad_with_one_rotor_lost_keeps_a_diagonal_pair_and_no_heading():
    held = holdable(QUAD)
    assert held.intact == pytest.approx(4.0)
    np.testing.assert_allclose(held.yaw_uncontrolled, 2.0)
    np.testing.assert_allclose(held.yaw_kept, 0.0, atol=1e-12)


def test_alternating_hexa_keeps_four_of_six_either_way():
    # With rotor 0 lost, pitch balance of 60, 120, 180, 240, 300 degrees gives T180 = a - b for the
    # pairs a (60, 300) and b (120, 240): the sum 3a + b is largest at a = b = 1, rotor 180 stopped.
    held = holdable(HEXA)
    assert held.intact == pytest.approx(6.0)
    np.testing.assert_allclose(held.yaw_uncontrolled, 4.0)
    np.testing.assert_allclose(held.yaw_kept, 4.0)


def test_hexa_with_neighbours_of_one_spin_holds_as_much_but_can_turn_its_nose_both_ways():
    # The PPNNPN hexa is known for staying controllable (Du et al. 2015); its largest level thrust
    # does not show that, which is why the docstring of the module speaks of trim only.
    held = holdable(ring(6, [1, 1, -1, -1, 1, -1]))
    assert held.yaw_uncontrolled == pytest.approx(np.full(6, 4.0))
    assert np.all(held.yaw_kept <= 4.0 + 1e-9)


def test_flat_octo_keeps_six_of_eight_or_four_root_two_with_its_heading():
    # Rotor 0 lost. Yaw uncontrolled: the opposite one stops, six stay at full thrust. Yaw kept:
    # the opposite one T has the spin of the lost, so that pitch sqrt2 (1 - b) = T and yaw 2 b = T
    # for the pair b at 135 degrees: b = sqrt2 - 1, and 4 + 2 b + T = 4 + 4 b = 4 sqrt2.
    held = holdable(ring(8, [1, -1] * 4))
    np.testing.assert_allclose(held.yaw_uncontrolled, 6.0)
    np.testing.assert_allclose(held.yaw_kept, 4.0 * np.sqrt(2.0))


def test_coaxial_octo_keeps_what_its_pairs_leave():
    # e = 0.8 is the lower rotor. Lost upper: its arm and the opposite one hold e each, the others
    # 1 + e: 2 + 4e. With yaw kept the other arms must spin balanced too, e and e: 6e.
    # Lost lower: 1 on its arm and the opposite one, 1 + e on the others, with yaw balanced: 4 + 2e.
    held = holdable(X8)
    upper, lower = slice(0, 4), slice(4, 8)
    assert held.intact == pytest.approx(4 + 4 * 0.8)
    np.testing.assert_allclose(held.yaw_uncontrolled[upper], 2 + 4 * 0.8)
    np.testing.assert_allclose(held.yaw_kept[upper], 6 * 0.8)
    np.testing.assert_allclose(held.yaw_uncontrolled[lower], 4 + 2 * 0.8)
    np.testing.assert_allclose(held.yaw_kept[lower], 4 + 2 * 0.8)


@pytest.mark.parametrize("name", SHIPPED)
def test_heading_and_a_lost_rotor_only_take_away(name):
    held = holdable(load_airframe(name))
    assert np.all(held.yaw_kept <= held.yaw_uncontrolled + 1e-9)
    assert np.all(held.yaw_uncontrolled < held.intact)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_rectangular_quads_of_any_size_hold_the_same(length, width):
    position = np.sign(QUAD.rotor_position_frd) * [length, width, 0.0]
    held = holdable(rearranged(QUAD, position, QUAD.rotor_spin))
    np.testing.assert_allclose(held.yaw_uncontrolled, 2.0, rtol=1e-9)


def test_a_centre_of_gravity_off_the_middle_costs_thrust():
    whole, off = holdable(QUAD), holdable(shifted(QUAD, 0.1, 0.0))
    # Front and rear share 1/2 -+ d/(2 l): the pair nearer to the load is full at 1.
    arm = 0.6785
    assert off.intact == pytest.approx(whole.intact / (1 + 0.1 / arm))
    # Nose-heavy, a quad can stand on the other diagonal only if the lost rotor is a rear one.
    front = QUAD.rotor_position_frd[:, 0] > 0
    np.testing.assert_allclose(off.yaw_uncontrolled[front], 0.0, atol=1e-9)
    np.testing.assert_allclose(off.yaw_uncontrolled[~front], 2.0)


def _least_by_brute_force(airframe, rotor, collective, yaw_kept):
    matrix = mixer(airframe)
    rows = [matrix[0], matrix[1], matrix[2]] + ([matrix[3]] if yaw_kept else [])
    cost = np.zeros(airframe.rotor_count)
    cost[rotor] = 1.0
    bounds = [(0.0, top) for top in airframe.rotor_effectiveness]
    target = [collective] + [0.0] * (len(rows) - 1)
    return linprog(cost, A_eq=np.array(rows), b_eq=target, bounds=bounds).fun


def _largest_by_brute_force(airframe, yaw_kept):
    rows = mixer(airframe)[1 : 4 if yaw_kept else 3]
    bounds = [(0.0, top) for top in airframe.rotor_effectiveness]
    return -linprog(-np.ones(len(bounds)), A_eq=rows, b_eq=np.zeros(len(rows)), bounds=bounds).fun


@pytest.mark.parametrize("yaw_kept", [True, False])
@pytest.mark.parametrize("name", SHIPPED)
def test_trim_curve_is_the_least_thrust_at_every_collective(name, yaw_kept):
    airframe = load_airframe(name)
    for rotor in (0, airframe.rotor_count - 1):
        curve = trim_curve(airframe, rotor, yaw_kept)
        assert np.all(np.diff(curve.collective) >= 0)
        for share in (0.05, 0.3, 0.52, 0.7, 0.77, 0.9, 0.999):
            collective = share * holdable(airframe).intact
            expected = _least_by_brute_force(airframe, rotor, collective, yaw_kept)
            found = np.interp(collective, curve.collective, curve.rotor)
            assert found == pytest.approx(expected, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(0.3, 1.0), min_size=7, max_size=7),
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
    st.booleans(),
    st.floats(0.01, 0.99),
)
def test_trim_curve_holds_for_odd_layouts_and_loads_off_the_middle(
    effectiveness, offset, yaw_kept, share
):
    odd = replace(ring(7, [1, -1, 1, -1, 1, -1, 1]), rotor_effectiveness=np.array(effectiveness))
    odd = shifted(odd, *offset)
    curve = trim_curve(odd, 2, yaw_kept)
    largest = _largest_by_brute_force(odd, yaw_kept)
    assert curve.collective[-1] == pytest.approx(largest, abs=1e-6)
    collective = share * largest
    found = np.interp(collective, curve.collective, curve.rotor)
    expected = _least_by_brute_force(odd, 2, collective, yaw_kept)
    assert found == pytest.approx(expected, abs=1e-5)


def test_a_rotor_that_the_largest_collective_does_not_need_is_spared_in_it():
    # Two rotors in one place on a quad: balance lets them make one rotor's thrust between them.
    position = [*QUAD.rotor_position_frd, QUAD.rotor_position_frd[0]]
    doubled = rearranged(QUAD, position, [*QUAD.rotor_spin, 1.0])
    for twin in (0, 4):
        curve = trim_curve(doubled, twin, False)
        assert curve.collective[-1] == pytest.approx(4.0)
        assert curve.rotor[-1] == pytest.approx(0.0, abs=1e-9)


def test_the_program_is_solved_once():
    holdable.cache_clear()
    for _ in range(3):
        holdable(QUAD)
    assert holdable.cache_info().misses == 1
