"""Effects put together: what a corrected input means for the effects after it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, made_flight
from thrustmargin.models.effects import Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import base_table, rotor_speed_rpm
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    model_channels,
    physics_model,
    table_of,
)

LIFT = Placed(effect=known_effect("translational_lift"), values={"gain": 0.2})
DRAG = Placed(effect=known_effect("parasite_drag"), values={"drag_area": 2.0})
TANK_FORWARD = Placed(effect=known_effect("cg_offset:tank"), values={"x_full": 0.05, "y_full": 0.0})
MASS = Placed(effect=known_effect("extra_mass"), values={"mass": 2.0})
WIND = Placed(effect=known_effect("wind"), values={"wind_north": 3.0, "wind_east": -2.0})
HALF_SHOWN = Placed(effect=known_effect("tank_scale"), values={"gain": 2.0})


@pytest.fixture(scope="module")
def model() -> RotorModel:
    return physics_model(F16)


def speeds(model: RotorModel, x: Channels, *placed: Placed) -> Floats:
    return rotor_speed_rpm(table_of(model), placed, x)


@pytest.mark.parametrize("effect", [LIFT, DRAG], ids=["lift", "drag"])
def test_lift_and_drag_go_with_the_airspeed_that_an_unreported_wind_leaves(model, effect):
    over_ground = model_channels(model, made_flight(1, speed=6.0))
    through_air = replace(
        over_ground,
        airspeed=np.hypot(over_ground.velocity_north - 3.0, over_ground.velocity_east + 2.0),
    )
    told = speeds(model, over_ground, WIND, effect)
    assert told == pytest.approx(speeds(model, through_air, effect), abs=1e-3)
    assert np.abs(told - speeds(model, over_ground, effect)).max() > 3.0


@pytest.mark.parametrize("effect", [TANK_FORWARD, MASS], ids=["balance", "mass"])
def test_balance_and_hidden_mass_go_with_what_the_tank_really_holds(model, effect):
    shown = model_channels(model, made_flight(1, tank_kg=6.0))
    really = replace(
        shown, tank_kg=2.0 * shown.tank_kg, total_mass=shown.total_mass + shown.tank_kg
    )
    assert speeds(model, shown, HALF_SHOWN, effect) == pytest.approx(
        speeds(model, really, effect), abs=1e-6
    )


HEXA_X = np.array([90.0, -90.0, -30.0, 150.0, 30.0, -150.0])  # deg from the nose, motor 1 first
HEXA_SPIN = np.array([-1.0, 1.0, -1.0, 1.0, 1.0, -1.0])


def multirotor(bearings_deg, spin, effectiveness=None) -> RotorModel:
    at = np.radians(bearings_deg)
    airframe = replace(
        F16,
        rotor_position_frd=np.stack([np.cos(at), np.sin(at), 0.0 * at], axis=1),
        rotor_spin=np.asarray(spin),
        rotor_effectiveness=np.ones(at.size) if effectiveness is None else effectiveness,
        rotor_names=tuple(f"{k}" for k in range(at.size)),
    )
    return physics_model(airframe)


def worn(rotor: int, loss: float, torque_share: float) -> Placed:
    values = {"loss": loss, "torque_share": torque_share}
    return Placed(effect=known_effect("rotor_degradation"), values=values, rotor=rotor)


def squares(model: RotorModel, *placed: Placed) -> Floats:
    """(R,) apparent thrust of the rotors over the mean of them without effects."""
    x = model_channels(model, made_flight(1, duration=1.0))
    return speeds(model, x, *placed)[0] ** 2 / np.mean(speeds(model, x)[0] ** 2)


def test_on_six_rotors_the_opposite_one_gives_way_too():
    """Each control has its share of a rotor: 1/6 of collective, 1/3 of roll and pitch together and
    1/6 of yaw. So of what rotor 4 lacks, 1/15, the mixer asks 2/3 of itself, 1/6 of each neighbour
    and -1/3 of the rotor opposite, over 1 - 2/3 x 0.1 for what it lacks of that in turn."""
    part = 0.1 / (1.0 - 0.1 * 2.0 / 3.0)
    by_hand = 1.0 + part * np.array([1 / 6, 1 / 6, -1 / 3, 2 / 3, 1 / 6, 1 / 6])
    found = squares(multirotor(HEXA_X, HEXA_SPIN), worn(3, 0.1, 1.0))
    assert found == pytest.approx(by_hand, abs=1e-9)


def test_a_hexacopter_in_ardupilot_shares_a_weak_rotor_as_the_mixer_says():
    """Median rpm of a simulated hexacopter X in straight flight, rotor 4 making 10 % less thrust
    than it asks; the torque fell by two thirds of that."""
    recorded = np.array([3639.0, 3617.0, 3545.0, 3710.0, 3618.0, 3638.0])
    found = np.sqrt(squares(multirotor(HEXA_X, HEXA_SPIN), worn(3, 0.1, 0.67)))
    assert found * np.mean(recorded) / np.mean(found) == pytest.approx(recorded, abs=3.0)
    keeps_its_thrust = np.array([1.0, 1.0, 1.0, 0.9**-0.5, 1.0, 1.0])
    off = keeps_its_thrust * np.mean(recorded) / np.mean(keeps_its_thrust) - recorded
    assert np.abs(off).max() > 30.0


OCTO = np.arange(8) * 45.0 + 22.5
PAIRS = np.array([45.0, -45.0, -135.0, 135.0] * 2)
LAYOUTS = {
    "quad": multirotor([45.0, -135.0, -45.0, 135.0], [1.0, 1.0, -1.0, -1.0]),
    "hexa": multirotor(HEXA_X, HEXA_SPIN),
    "octo": multirotor(OCTO, (-1.0) ** np.arange(8)),
    "octo of pairs": multirotor(
        PAIRS, [1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0], np.repeat([1.0, 0.8], 4)
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("torque_share", [0.0, 0.5, 1.0, 1.5])
def test_a_weak_rotor_changes_no_force_and_no_moment_and_only_what_the_mixer_can(
    layout, torque_share
):
    model = LAYOUTS[layout]
    airframe, sound = model.airframe, squares(model)
    x, y = airframe.rotor_position_frd[:, 0], airframe.rotor_position_frd[:, 1]
    columns = np.stack([np.ones_like(x), -y, x, airframe.rotor_spin])
    for rotor in range(airframe.rotor_count):
        weak = squares(model, worn(rotor, 0.3, torque_share))
        thrust, torque = np.ones_like(weak), np.ones_like(weak)
        thrust[rotor], torque[rotor] = 0.7, 1.0 - 0.3 * torque_share
        made = airframe.rotor_effectiveness * sound
        makes = airframe.rotor_effectiveness * weak * thrust
        assert columns[:3] @ makes == pytest.approx(columns[:3] @ made, abs=1e-9)
        drag = airframe.rotor_effectiveness * weak * torque
        assert airframe.rotor_spin @ drag == pytest.approx(airframe.rotor_spin @ made, abs=1e-9)
        unreached = np.linalg.svd(columns)[2][4:]
        assert unreached @ (weak - sound) == pytest.approx(0.0, abs=1e-9)


def test_three_rotors_share_what_a_weak_one_leaves():
    found = squares(multirotor([60.0, -60.0, 180.0], [1.0, -1.0, 1.0]), worn(2, 0.1, 1.0))
    assert found == pytest.approx([1.0, 1.0, 1.0 / 0.9], abs=1e-9)


def test_what_all_rotors_lose_alike_is_made_up_by_each_of_them():
    drift = Placed(effect=known_effect("thrust_drift"), values={"rate": 0.001})
    model = LAYOUTS["octo of pairs"]
    x = model_channels(model, made_flight(1))
    row = int(np.argmin(np.abs(x.time_s - 50.0)))
    ratio = speeds(model, x, drift)[row] / speeds(model, x)[row]
    assert ratio == pytest.approx((1.0 - 0.001 * x.time_s[row]) ** -0.5, rel=1e-9)


def test_the_lower_rotors_of_pairs_bear_their_share_of_the_moment():
    """0.02 m ahead: sum of x A over effectiveness is 0.02 of the thrust, whatever each makes."""
    model = LAYOUTS["octo of pairs"]
    ahead = Placed(effect=known_effect("cg_offset"), values={"x": 0.02, "y": 0.0})
    made = model.airframe.rotor_effectiveness * squares(model, ahead)
    moment = model.airframe.rotor_position_frd[:, 0] @ made
    assert moment == pytest.approx(0.02 * made.sum(), rel=1e-9)


def test_the_base_table_is_read_between_its_grid_and_held_beyond_it():
    """A speed whose square is a product of lines in airspeed and tank mass is read exactly."""

    def speed(airspeed, tank_kg):
        return np.sqrt((1.0 + airspeed) * (2.0 + tank_kg))[:, None] * np.sqrt([1.0, 2.0, 3.0, 4.0])

    table = base_table(speed, F16, thrust_coefficient=1e-5)
    airspeed, tank_kg = np.array([15.05, 3.33, -2.0, 70.0]), np.array([3.31, 15.9, 1.0, 1.0])
    read = table.look_up(airspeed, tank_kg)
    held = np.clip(airspeed, 0.0, 20.0)
    by_hand = 1e-5 * ((1.0 + held) * (2.0 + tank_kg))[:, None] * [1.0, 2.0, 3.0, 4.0]
    assert read == pytest.approx(by_hand, rel=1e-9)
    full = table.look_up(np.zeros(1), np.array([1.5 * F16.tank_capacity_kg]))
    assert full[0, 0] == pytest.approx(1e-5 * (2.0 + 1.5 * F16.tank_capacity_kg), rel=1e-9)
    assert table.look_up(np.array([np.nan]), np.zeros(1))[0, 0] == pytest.approx(2e-5)


def test_a_report_of_a_fall_at_more_than_g_asks_for_no_thrust_and_is_known(model):
    """Thrust below none to a power would be no number, and a warning."""
    turning_effect = [known_effect("manoeuvre_moment")]
    x = model_channels(model, made_flight(1, speed=6.0), effects=turning_effect)
    down, still = np.full(x.load_factor_shifts.shape, -0.5), np.zeros(x.load_factor_shifts.shape)
    falling = x.with_changed(
        load_factor_shifts=down,
        manoeuvre_load_shifts=down,
        rate_shifts=(still,) * 3,
        acceleration_shifts=(still,) * 3,
    )
    felt = {"gain": 1.0, "imu_share": 1.0, "derivative_correction": 0.0, "lag": 0.0}
    names = [p.name for p in known_effect("manoeuvre_moment").parameters]
    turning = dict.fromkeys(names, 0.0) | {"inertia_roll": 1.0, "load_exponent": 0.5}
    placed = [
        Placed(effect=known_effect("load_factor"), values=felt),
        Placed(effect=known_effect("manoeuvre_moment"), values=turning),
    ]
    with np.errstate(invalid="raise"):
        found = speeds(model, falling, *placed)
    assert np.isfinite(found).all()
    assert found.max() < 0.05 * speeds(model, x).min()
