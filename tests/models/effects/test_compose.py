"""Effects put together: what a corrected input means for the effects after it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, made_flight
from thrustmargin.models.effects import CATALOGUE, Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.flown import model_channels, table_of
from thrustmargin.models.model.rotor_model import RotorModel, physics_model

EFFECTS = {effect.key: effect for effect in CATALOGUE}
LIFT = Placed(effect=EFFECTS["translational_lift"], values={"gain": 0.2})
DRAG = Placed(effect=EFFECTS["parasite_drag"], values={"drag_area": 2.0})
TANK_FORWARD = Placed(effect=EFFECTS["cg_offset:tank"], values={"x_full": 0.05, "y_full": 0.0})
MASS = Placed(effect=EFFECTS["extra_mass"], values={"mass": 2.0})
WIND = Placed(effect=EFFECTS["wind"], values={"wind_north": 3.0, "wind_east": -2.0})
HALF_SHOWN = Placed(effect=EFFECTS["tank_scale"], values={"gain": 2.0})


@pytest.fixture(scope="module")
def model() -> RotorModel:
    return physics_model(F16)


def speeds(model: RotorModel, x: Channels, *placed: Placed) -> Floats:
    return rotor_speed_rpm(table_of(model), placed, x, np)


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
