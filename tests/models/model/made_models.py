"""Models with small networks of random numbers, for tests of models and of their files."""

from itertools import pairwise

import numpy as np

from tests.models.known_effects import known_effect
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.network import RotorNetwork
from thrustmargin.models.network.records import GoodFlights
from thrustmargin.models.network.validity import Interval, TrainingDomain
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.forward_flight import ForwardFlight

F16 = load_airframe("topxgun-f16-sitl")


def network(rotors=4, members=2, seed=0) -> RotorNetwork:
    rng = np.random.default_rng(seed)
    widths = (2, 117, 103, 76, rotors)
    pairs = list(pairwise(widths))
    return RotorNetwork(
        weights=tuple(rng.normal(0, 0.1, (members, a, b)).astype(np.float32) for a, b in pairs),
        biases=tuple(rng.normal(0, 0.1, (members, b)).astype(np.float32) for _, b in pairs),
        input_mean=np.tile([3.0, 8.0], (members, 1)),
        input_scale=np.tile([2.0, 4.0], (members, 1)),
        output_mean=np.full((members, rotors), 1900.0),
        output_scale=rng.uniform(100, 200, (members, rotors)),
    )


def worn_rotor(**given) -> EffectRecord:
    """Rotor 1 with 8 % less thrust, with every parameter that the effect has."""
    effect = known_effect("rotor_degradation")
    parameters = {
        p.name: Identified(value=p.start, unit=p.unit, ci95=(p.lower, p.upper))
        for p in effect.parameters
    }
    loss = Identified(value=0.08, unit="1", ci95=(0.07, 0.1 + 0.2))
    return EffectRecord(
        **{"name": effect.name, "rotor": 1, "parameters": {**parameters, "loss": loss}, **given}
    )


def learnt_model(airframe: Airframe = F16, **given) -> RotorModel:
    rotors = airframe.rotor_count
    defaults = {
        "airframe": airframe,
        "network": network(rotors),
        "training_domain": TrainingDomain(
            airspeed=(0.0, 6.0),
            tank_kg=(1.0, 16.0),
            density=(1.22, 1.23),
            height_agl=(2.9, 3.1),
            wind_speed=(np.nan, np.nan),
            flights=("a.tlog", "b.tlog"),
        ),
        "interval": Interval(
            coverage=0.9,
            flights=2,
            airspeed=(0.0, 6.0),
            scatter_rpm=((100.0,) * rotors, (20.0,) * rotors),
            factor=(1.1,) * rotors,
        ),
        "effects": (worn_rotor(),),
        "forward_flight": ForwardFlight(
            rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=5.0
        ),
        "good_flights": GoodFlights(
            flights=2,
            scatter={"cg_offset.x": 0.1 + 0.2, "manoeuvre_moment.inertia_yaw": 0.0},
            mode_scatter_rpm=(1.5,) * rotors,
            free_form_rpm=(2.5,) * rotors,
            curve_rpm={"collective.airspeed": 2.5},
        ),
        "reference_density": 1.2240448906210113,
        "reference_voltage": np.nan,
    }
    return RotorModel(**{**defaults, **given})
