"""The plant's laws against values worked out by hand, and its flights against plain physics."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.lab.undeclared.conditions import Condition, Implant
from tests.lab.undeclared.crafts import CRAFTS, GRAVITY, RPM, SEA_LEVEL_DENSITY
from tests.lab.undeclared.days import Day, Surroundings, elsewhere
from tests.lab.undeclared.flight_laws import (
    Attitude,
    Flow,
    drag_of,
    flow_of,
    rotor_forces,
    wake_inflow,
    yaw_time,
)
from tests.lab.undeclared.missions import Motion, Style
from tests.lab.undeclared.plant import SPIN_MAX, SPIN_MIN, as_telemetry, fly, motor_output
from tests.lab.undeclared.rotor_aero import (
    Blade,
    cut_for_loss,
    forces_of,
    ground_relief,
    hover,
    induced,
    strip_forces,
)

F16, SMALL, PLUS, HEXA, OCTO, X8 = CRAFTS
CALM = Day(turbulence=0.0, gusts=0.0, noise=0.0, fill=0.6)
HOVER = Style(hover_first=20.0, duration=0.0, line_length=2.0, sway=0.0, turns=False, height=30.0)
ROWS = slice(60, 150)  # of the hover, before the line
BLADE = Blade()


def calm_hover(craft=F16, condition=None, day=CALM):
    return fly(craft, condition or Condition(), HOVER, day, [1], "hover").track


def speeds(**given):
    return calm_hover(**given).rotor_speed_rpm[ROWS].mean(axis=0)


def test_strips_of_a_thin_rotor_agree_with_the_integral_by_hand():
    # One strip theory value: at no inflow Cl = 1.3 tanh(5.7 (atan(P/(pi D r)) + 0.085) / 1.3).
    r = np.linspace(0.18, 0.97, 4001)
    attack = np.arctan(0.32 / (np.pi * r)) + 0.085
    lift = 1.3 * np.tanh(5.7 * attack / 1.3)
    by_hand = 0.5 * 0.085 * np.trapezoid(lift * r**2, r)
    assert strip_forces(BLADE, np.zeros(1), np.zeros(1))[0] == pytest.approx(by_hand, rel=2e-3)


def test_hover_inflow_is_that_of_momentum_theory():
    own = induced(BLADE, np.zeros(1), np.zeros(1))
    assert own == pytest.approx(np.sqrt(hover(BLADE)[0] / 2.0), rel=1e-6)


def test_fast_edgewise_inflow_tends_to_glauerts():
    mu = np.array([0.35])
    thrust = forces_of(BLADE).at(forces_of(BLADE).thrust, mu, np.zeros(1))
    assert induced(BLADE, mu, np.zeros(1)) == pytest.approx(thrust / (2 * 0.35), rel=0.02)


def test_a_climb_takes_thrust_and_a_descent_gives_it():
    table = forces_of(BLADE)
    thrust = table.at(table.thrust, np.zeros(3), np.array([-0.03, 0.0, 0.03]))
    assert thrust[0] > thrust[1] > thrust[2]
    # dCT/dl_c of strips and momentum together: g s a/4 (1 - ...) is between 0.02 and 0.06 here.
    assert 0.02 < (thrust[0] - thrust[2]) / 0.06 < 0.06


def test_a_cut_propeller_loses_more_torque_than_thrust():
    cut = cut_for_loss(BLADE, 0.08)
    (whole, drag), (short, less) = hover(BLADE), hover(replace(BLADE, cut=cut))
    assert short / whole == pytest.approx(0.92, abs=1e-4)
    # Thrust goes about with R⁴ and less in strips of the same inflow, torque with R⁵: 1.3 to 1.6.
    assert 1.3 < (1 - less / drag) / (1 - short / whole) < 1.6


def test_the_ground_takes_induced_power_as_hayden_measured():
    # At one diameter 1 - 1/(0.9926 + 0.03794) = 2.96 %; far away nothing.
    assert ground_relief(np.array([1.0, 50.0])) == pytest.approx([0.0296, 0.0], abs=1e-4)


def test_drag_of_a_bluff_body_saturates():
    bare = Condition()
    speed = np.array([[9.0, 0.0, 0.0]])
    more = drag_of(F16, replace(bare, drag_area=1.0), 1.2, speed) - drag_of(F16, bare, 1.2, speed)
    assert more[0] == pytest.approx([-0.5 * 1.2 * 81.0 / np.sqrt(2.0), 0.0, 0.0])


@pytest.mark.parametrize("craft", CRAFTS, ids=lambda c: c.name)
def test_hover_carries_the_weight_with_every_rotor_in_trim(craft):
    track = calm_hover(craft)
    rpm = track.rotor_speed_rpm[ROWS].mean(axis=0)
    weight = (craft.empty_mass + 0.6 * craft.tank_litres) * GRAVITY
    shares = craft.hover_coefficients[0] / craft.hover_coefficients[0].max()
    day = CALM.density / SEA_LEVEL_DENSITY
    thrust = day * craft.thrust_coefficient * np.sum(shares * rpm**2)
    assert thrust == pytest.approx(weight, rel=0.003)
    assert np.ptp(rpm) < 0.002 * rpm.mean()
    assert track.specific_force_frd[ROWS].mean(axis=0) == pytest.approx([0, 0, -GRAVITY], abs=0.05)


def test_a_lower_rotor_in_the_wash_makes_about_a_fifth_less():
    thrust, _ = X8.hover_coefficients
    assert 0.6 < thrust[4] / thrust[0] < 0.9


def test_hidden_mass_asks_for_speed_by_its_root():
    loaded = speeds(condition=Condition(hidden_mass=3.0)).mean() / speeds().mean()
    assert loaded == pytest.approx(np.sqrt(33.7 / 30.7), rel=1e-3)


def test_a_gauge_that_shows_too_little_hides_liquid_that_is_there():
    low = calm_hover(condition=Condition(gauge_gain=1.25))
    assert low.tank_kg[ROWS] == pytest.approx(calm_hover().tank_kg[ROWS], abs=0.1)
    rise = low.rotor_speed_rpm[ROWS].mean() / speeds().mean()
    assert rise == pytest.approx(np.sqrt((21.1 + 1.25 * 9.6) / (21.1 + 9.6)), rel=1e-3)


def test_a_propeller_is_whole_until_it_is_cut():
    later = replace(CALM, clock_start=1200.0)
    chipped = Condition(cut=0.05, rotor=2, cut_from=1210.5)
    rpm = calm_hover(condition=chipped, day=later).rotor_speed_rpm[:, 2]
    assert rpm[60:95] == pytest.approx(calm_hover(day=later).rotor_speed_rpm[60:95, 2], abs=1.0)
    assert rpm[110:140].mean() > 1.03 * rpm[60:95].mean()


def test_thin_air_asks_for_speed_by_its_root():
    high = elsewhere(CALM, 2000.0, 0.0)
    assert high.density / CALM.density == pytest.approx(0.8216, abs=1e-3)  # standard atmosphere
    assert speeds(day=high).mean() / speeds().mean() == pytest.approx(0.8216**-0.5, rel=2e-3)


def test_a_centre_of_gravity_forward_and_right_loads_those_rotors():
    thrust = speeds(condition=Condition(cg=(0.03, 0.01))) ** 2
    assert F16.position.T @ thrust / thrust.sum() == pytest.approx([0.03, 0.01], abs=5e-4)


def test_on_a_hexa_the_mixer_shares_out_what_a_cut_rotor_lacks():
    # Controls c with B diag(kappa) M c = demand, solved by hand for thrust and torque shares.
    j, loss = 3, 0.1
    cut = cut_for_loss(HEXA.blade, loss)
    (t0, q0), (t1, q1) = hover(HEXA.blade), hover(replace(HEXA.blade, cut=cut))
    kappa, turning = np.ones(6), np.ones(6)
    kappa[j], turning[j] = t1 / t0, q1 / q0
    x, y = HEXA.position.T
    arms = np.stack([kappa, -y * kappa, x * kappa, HEXA.spin * turning])
    share = HEXA.mixer @ np.linalg.solve(arms @ HEXA.mixer, [6.0, 0.0, 0.0, 0.0])
    cut_speeds = speeds(craft=HEXA, condition=Condition(cut=cut, rotor=j))
    assert cut_speeds / speeds(craft=HEXA) == pytest.approx(np.sqrt(share), abs=1e-3)
    assert share[2] < 0.99  # the opposite rotor slows down


def test_a_leaning_motor_is_held_by_the_torque_of_all():
    rpm = speeds(condition=Condition(tilt=0.005))
    ratio = F16.radius * F16.hover_coefficients[1][0] / F16.hover_coefficients[0][0]
    # 4 q s N²/N0² share: sum s_i T_i q = -arm T/4 tilt, so each rotor's N² moves by -s arm tilt/4q.
    wanted = 1.0 - F16.spin * F16.arm * 0.005 / (4.0 * ratio)
    assert (rpm / speeds()) ** 2 == pytest.approx(wanted, abs=2e-3)


def test_rotors_that_swing_down_meet_air_from_below():
    still = np.zeros((1, 3))
    flying = np.ones(1, dtype=np.bool_)
    high = np.full(1, 50.0)
    motion = Motion(np.zeros(1), still, still, still, np.zeros(1), high, np.zeros(1), flying)
    around = Surroundings(still, 1.2, np.zeros(1), np.zeros(1), 0.0, np.zeros((1, 4)))
    attitude = Attitude(still, np.array([[0.5, 0.25, 0.0]]), np.eye(3)[None], np.ones(1), still)
    x, y = F16.position.T
    axial = flow_of(F16, Condition(), attitude, motion, around).axial[0]
    assert axial == pytest.approx(0.25 * x - 0.5 * y)  # up through the disc: rolling right, nose up


def test_drag_of_what_hangs_below_pulls_the_nose_down_and_the_rotors_hold_against_it():
    wind = fly(F16, Condition(), HOVER, replace(CALM, wind=(-7.0, 0.0)), [1], "hover").track
    rpm = wind.rotor_speed_rpm[ROWS].mean(axis=0)
    front = F16.position[:, 0] > 0
    assert np.all(np.cos(wind.attitude[ROWS, 2]) > 0.99)
    assert rpm[front].mean() > rpm[~front].mean() + 1.0


def test_rear_rotors_meet_the_wash_of_front_ones_and_not_the_other_way():
    flow = Flow(np.zeros((1, 4)), np.array([[8.0, 0.0]]), np.zeros((1, 1)))
    own, mu = np.full((1, 4), 0.05), np.full((1, 4), 0.08)
    met = wake_inflow(F16, flow, own, mu, np.zeros((1, 4)))[0]
    rear = F16.position[:, 0] < 0
    # 1.358 m behind, falling 0.05/0.08 of the way: 0.848 m below, in a wake of 1.5 radii.
    by_hand = 2 * 0.05 * np.exp(-((1.358 * 0.05 / 0.08 / (1.5 * 0.457)) ** 2))
    assert met[rear] == pytest.approx(by_hand, rel=0.01)
    assert met[~rear] == pytest.approx(0.0, abs=1e-3)


def test_thrust_that_flexes_away_goes_with_the_load():
    flow = Flow(np.zeros((1, 4)), np.zeros((1, 2)), np.zeros((1, 1)))
    time = np.zeros(1)
    for share, lost in ((1.0, 0.05), (1.5, 0.1)):
        omega = np.full((1, 4), F16.hover_rpm / RPM * np.sqrt(share))
        stiff, _ = rotor_forces(F16, Condition(), omega, flow, time, time)
        soft, _ = rotor_forces(F16, Condition(flex=0.1, rotor=2), omega, flow, time, time)
        assert 1 - soft[0, 2] / stiff[0, 2] == pytest.approx(lost, abs=1e-3)


def test_near_the_ground_rotors_make_more_at_a_speed():
    omega, time = np.full((1, 4), F16.hover_rpm / RPM), np.zeros(1)
    still = np.zeros((1, 4)), np.zeros((1, 2))
    far, near = (
        rotor_forces(F16, Condition(), omega, Flow(*still, np.full((1, 1), r)), time, time)[0]
        for r in (0.0, 0.1)
    )
    # A tenth of the inflow of 0.067 less, at dCT/dl_c of 0.03 to 0.04 of 0.0089: 2.5 %.
    assert near / far == pytest.approx(1.025, abs=0.006)


def test_outputs_follow_ardupilots_thrust_curve():
    # Half of full thrust: 0.35 c + 0.65 c² = 0.5 gives c = 0.6481.
    full, volts = F16.max_rpm, np.array([4.2 * F16.cells])
    half = motor_output(F16, np.array([[full * np.sqrt(0.5)]]), volts)
    assert half == pytest.approx(SPIN_MIN + 0.6481 * (SPIN_MAX - SPIN_MIN), abs=1e-3)
    assert motor_output(F16, np.array([[full]]), volts) == pytest.approx(SPIN_MAX)


def test_slow_and_coarse_telemetry():
    rpm = np.arange(30.0)[:, None] * 10 + 1000.0
    rng = np.random.default_rng(0)
    slow = as_telemetry(F16, Condition(period=1.0), rpm, rng)
    assert slow[:, 0].tolist() == [1000.0] * 10 + [1100.0] * 10 + [1200.0] * 10
    coarse = as_telemetry(F16, Condition(quantum=0.01), rpm, rng)
    assert coarse / (0.01 * F16.hover_rpm) == pytest.approx(
        np.round(rpm / (0.01 * F16.hover_rpm)), abs=1e-9
    )


def test_rotor_inertia_delays_yaw_by_a_fraction_of_a_second():
    assert 0.05 < yaw_time(F16) < 1.0


def test_a_change_of_the_season_moves_only_what_it_says():
    heavy = Implant(kind="mass", size=0.1, condition={"hidden_mass": 3.0}).on(Condition())
    assert heavy == Condition(hidden_mass=3.0)
    sound, loaded = calm_hover(), calm_hover(condition=heavy)
    for channel in ("tank_kg", "airspeed", "pressure", "height_agl"):
        np.testing.assert_allclose(getattr(sound, channel), getattr(loaded, channel))


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
    return named | {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}


def test_the_plant_shares_no_code_with_what_it_tests():
    for path in Path(__file__).parent.glob("*.py"):
        if path.name not in ("subject.py", "recorded.py"):
            of_models = {m for m in imports_of(path) if m.startswith("thrustmargin")}
            assert of_models <= {"thrustmargin.models.flight"}, path.name
