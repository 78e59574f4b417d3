"""The residual loop on flights of RotorPy, whose dynamics and aerodynamics others wrote."""

from dataclasses import replace

import numpy as np
import pytest

from models.flight import FlightTrack
from tests.undeclared.days import Day
from tests.undeclared.missions import Style
from tests.undeclared.physics import GRAVITY, QUAD, Physics
from tests.undeclared.rotorpy_plant import Airframe, fly_rotorpy

pytest.importorskip("rotorpy", reason="RotorPy is not installed: pip install rotorpy")

HEALTHY = Physics()
#: What RotorPy's aircraft has beyond the curve whether or not anything is changed.
NATURAL = {
    "load_factor",
    "manoeuvre_moment",
    "translational_lift",
    "parasite_drag",
    "sensor_lag",
}


def flights(airframe: Airframe, count: int, seconds: float, seed: int = 3) -> list[FlightTrack]:
    rng = np.random.default_rng(seed)
    made = []
    for i in range(count):
        style = Style(
            cruise=3.0 + i,
            acceleration=0.6,
            turns=False,
            sway=0.03,
            climb=6.0,
            line_length=40.0,
            duration=seconds,
        )
        day = Day(fill=15.0 - 3.0 * i, turbulence=0.15, flow=4.0, clock_start=1200.0 * i)
        made.append(fly_rotorpy(airframe, style, day, rng, f"rotorpy {i + 1}"))
    return made


def test_a_healthy_rotorpy_hover_has_the_curve_and_the_weight():
    hover = Style(hover_first=12.0, duration=0.0, line_length=2.0, sway=0.0, turns=False)
    still = Day(turbulence=0.0, gusts=0.0, rotor_noise_rpm=0.0)
    track = fly_rotorpy(
        Airframe(physics=HEALTHY, aerodynamics=False),
        hover,
        still,
        np.random.default_rng(0),
        "hover",
    )
    calm = slice(40, 90)
    thrust = 2.011e-5 * track.rotor_speed_rpm[calm].mean(axis=0) ** 2
    assert thrust.sum() == pytest.approx((21.1 + 12.0) * 9.81, rel=2e-3)
    assert track.specific_force_frd[calm].mean(axis=0) == pytest.approx([0, 0, -GRAVITY], abs=0.03)


def test_a_worn_rotorpy_rotor_turns_faster_by_the_root_of_its_loss():
    worn = replace(HEALTHY, rotor_loss=0.1, lossy_rotor=2)
    (track,) = flights(Airframe(physics=worn), 1, 20.0)
    mean = track.rotor_speed_rpm[20:80].mean(axis=0)
    others = mean[[0, 1, 3]].mean()
    assert mean[2] / others == pytest.approx(1 / np.sqrt(0.9), abs=0.01)


def test_a_rotorpy_centre_of_gravity_forward_loads_the_front_rotors():
    (track,) = flights(Airframe(physics=replace(HEALTHY, balance=(0.04, 0.0))), 1, 20.0)
    thrust = 2.011e-5 * track.rotor_speed_rpm[20:80].mean(axis=0) ** 2
    assert QUAD.position[:, 0] @ thrust / thrust.sum() == pytest.approx(0.04, abs=0.004)


WORN = Airframe(physics=replace(HEALTHY, rotor_loss=0.07, lossy_rotor=1))
HEAVY = Airframe(physics=replace(HEALTHY, hidden_mass=2.0))
NOSE_HEAVY = Airframe(physics=replace(HEALTHY, balance=(0.03, 0.0)))
STEEP = Airframe(physics=HEALTHY, inflow_slope=0.8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("airframe", "name", "parameter", "truth"),
    [
        pytest.param(WORN, "rotor_degradation", "loss", 0.07, id="worn"),
        pytest.param(HEAVY, "extra_mass", "mass", 2.0, id="mass"),
        pytest.param(NOSE_HEAVY, "cg_offset", "x", 0.03, id="balance"),
        pytest.param(STEEP, "climb_inflow", "slope", 0.8, id="inflow"),
    ],
)
def test_the_loop_names_what_was_changed_in_rotorpy(tmp_path, airframe, name, parameter, truth):
    from tests.undeclared.subject import curve_model, run_identify

    tracks = flights(airframe, 4, 120.0)
    result = run_identify(curve_model(QUAD, tmp_path), tracks[:3], tracks[3:])
    found = {e["name"]: e for e in result["effects"]}
    assert name in found
    assert set(found) - {name} <= NATURAL
    low, high = found[name]["parameters"][parameter]["ci95"]
    assert low <= truth <= high
    assert result["after"]["rmse_rpm"] < 0.5 * result["before"]["rmse_rpm"]
