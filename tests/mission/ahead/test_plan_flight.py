"""A plan flown in time against what can be worked out by hand."""

import numpy as np
import pytest

from thrustmargin.mission.ahead.limits import flight_limits
from thrustmargin.mission.ahead.plan_flight import Conditions, fly_plan
from thrustmargin.mission.ahead.way import way_leg
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

LIMITS = flight_limits({"WPNAV_SPEED": 400.0, "WPNAV_SPEED_UP": 300.0, "WPNAV_ACCEL_Z": 250.0})
MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


@pytest.mark.parametrize("rise", [0.0, 100.0])
def test_a_line_that_climbs_takes_the_liquid_of_its_length_over_ground(rise: float):
    end = np.array([200.0, 0.0, -rise])
    leg = way_leg(LIMITS, 1, np.zeros(3), end, speed=4.0, stops=True, pump=True)
    assert leg is not None
    flown = fly_plan(
        "by hand", [leg], LIMITS, MODEL, Conditions(fill_kg=10.0, density=1.2, flow=0.04)
    )
    # 0.04 kg/s at 4 m/s is 0.01 kg a metre over ground: 2 kg, less the ends slower than 1 m/s.
    assert 10.0 - flown.track.tank_kg[-1] == pytest.approx(2.0, abs=0.03)
