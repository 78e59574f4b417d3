"""What can be wrong with an aircraft and has a name: drawn at random from its physical meaning.

Sizes are drawn evenly in their logarithm between what is just worth knowing and what a pilot would
still fly with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from tests.undeclared.days import Day, elsewhere
from tests.undeclared.physics import FIRST_ROW, Physics


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """One change: numbers of the aircraft, of the day, and the truth that a report should meet."""

    name: str
    variant: str = ""
    rotor: int | None = None  # counted from 0
    physics: Mapping[str, object] = field(default_factory=dict)
    altitude: float | None = None  # m, when the field is elsewhere
    warmer: float = 0.0  # K above standard air there
    truth: Mapping[str, float] = field(default_factory=dict)

    def on(self, physics: Physics) -> Physics:
        return replace(physics, **self.physics)  # type: ignore[arg-type]

    def off(self, physics: Physics, healthy: Physics) -> Physics:
        """The aircraft without this change but with any other that it has."""
        return replace(physics, **{name: getattr(healthy, name) for name in self.physics})  # type: ignore[arg-type]

    def at(self, day: Day) -> Day:
        return day if self.altitude is None else elsewhere(day, self.altitude, self.warmer)


Draw = Callable[[np.random.Generator, Physics], Change]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Even in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def either(rng: np.random.Generator, low: float, high: float) -> float:
    """As `between`, of either sign."""
    return between(rng, low, high) * float(rng.choice([-1.0, 1.0]))


def air(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    altitude, warmer = between(rng, 250.0, 4000.0), float(rng.uniform(-15.0, 25.0))
    return Change(
        name="air_density",
        physics={"thin_air": True},
        altitude=altitude,
        warmer=warmer,
        truth={"warmer_than_standard": warmer},
    )


def wind(rng: np.random.Generator, healthy: Physics) -> Change:
    del rng, healthy
    return Change(name="wind", physics={"blind_to_wind": True})


def tank(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    gain = float(np.exp(either(rng, 0.03, 0.3)))
    return Change(name="tank_scale", physics={"gauge_gain": gain}, truth={"gain": gain})


def load(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    mass = between(rng, 0.4, 6.0)
    return Change(name="extra_mass", physics={"hidden_mass": mass}, truth={"mass": mass})


def drag(rng: np.random.Generator, healthy: Physics) -> Change:
    more = between(rng, 0.3, 2.5)
    return Change(
        name="parasite_drag",
        physics={"drag_area": healthy.drag_area + more},
        # What adds in quadrature to the drag that the base has learnt.
        truth={"drag_area": float(np.sqrt((healthy.drag_area + more) ** 2 - healthy.drag_area**2))},
    )


def lift(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    gain = either(rng, 0.05, 0.25)
    return Change(
        name="translational_lift", physics={"extra_lift_gain": gain}, truth={"gain": gain}
    )


def inflow(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    slope = between(rng, 0.2, 1.3)
    return Change(name="climb_inflow", physics={"inflow_slope": slope}, truth={"slope": slope})


def ground(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    k = between(rng, 0.06, 0.6)
    return Change(name="ground_effect", physics={"cushion": k}, truth={"strength": k})


def worn(rng: np.random.Generator, healthy: Physics) -> Change:
    rotor, loss = int(rng.integers(healthy.layout.rotors)), between(rng, 0.012, 0.25)
    return Change(
        name="rotor_degradation",
        rotor=rotor,
        physics={"rotor_loss": loss, "lossy_rotor": rotor},
        truth={"loss": loss},
    )


def worn_from_warm(rng: np.random.Generator, healthy: Physics) -> Change:
    """A rotor that weakens once warm: the same time after every start."""
    constant, onset = worn(rng, healthy), float(rng.uniform(50.0, 140.0))
    return replace(
        constant,
        variant="from a time of each flight",
        physics={**constant.physics, "loss_from_flight_time": onset},
        truth={**constant.truth, "onset": onset - FIRST_ROW},
    )


def worn_from_clock(rng: np.random.Generator, healthy: Physics) -> Change:
    """A propeller that goes bad once, in one of the flights, and stays so (clock set later)."""
    constant = worn(rng, healthy)
    at = 1200.0 * int(rng.integers(0, 3)) + float(rng.uniform(60.0, 130.0))
    return replace(
        constant,
        variant="from one moment on",
        physics={**constant.physics, "loss_from_clock": at},
        truth={**constant.truth, "onset_clock": at},
    )


def fouling(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    rate = between(rng, 0.02, 0.15) / 300.0
    return Change(name="thrust_drift", physics={"fouling_rate": rate}, truth={"rate": rate})


def pack(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    exponent = between(rng, 0.3, 2.0)
    return Change(
        name="battery_voltage", physics={"pack_exponent": exponent}, truth={"exponent": exponent}
    )


def balance(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    size, way = between(rng, 0.006, 0.06), rng.uniform(0.0, 2 * np.pi)
    x, y = float(size * np.cos(way)), float(size * np.sin(way))
    return Change(name="cg_offset", physics={"balance": (x, y)}, truth={"x": x, "y": y})


def balance_tank(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    size, way = between(rng, 0.01, 0.1), rng.uniform(0.0, 2 * np.pi)
    x, y = float(size * np.cos(way)), float(size * np.sin(way))
    return Change(
        name="cg_offset",
        variant="with the tank",
        physics={"balance_full_tank": (x, y)},
        truth={"x_tank": x, "y_tank": y},
    )


def trim(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    moment = either(rng, 0.12, 1.8)
    return Change(name="yaw_trim", physics={"yaw_trim": moment}, truth={"moment": moment})


def booms(rng: np.random.Generator, healthy: Physics) -> Change:
    """Longer or shorter booms: more or less inertia than the base has seen."""
    scale = float(np.exp(either(rng, 0.12, 0.5)))
    base = np.maximum(healthy.inertia, (0.4, 0.4, 0.8))
    inertia = tuple(float(v) for v in base * scale)
    more = np.subtract(inertia, healthy.inertia)
    return Change(
        name="manoeuvre_moment",
        physics={"inertia": inertia},
        truth={f"inertia_{axis}": float(v) for axis, v in zip("xyz", more, strict=True)},
    )


def delay(rng: np.random.Generator, healthy: Physics) -> Change:
    del healthy
    seconds = between(rng, 0.2, 1.2)
    return Change(name="sensor_lag", physics={"reporting_delay": seconds}, truth={"delay": seconds})


NAMED: Mapping[str, Draw] = MappingProxyType(
    {
        "air_density": air,
        "wind": wind,
        "tank_scale": tank,
        "extra_mass": load,
        "parasite_drag": drag,
        "translational_lift": lift,
        "climb_inflow": inflow,
        "ground_effect": ground,
        "rotor_degradation": worn,
        "rotor_degradation/warm": worn_from_warm,
        "rotor_degradation/onset": worn_from_clock,
        "thrust_drift": fouling,
        "battery_voltage": pack,
        "cg_offset": balance,
        "cg_offset/tank": balance_tank,
        "yaw_trim": trim,
        "manoeuvre_moment": booms,
        "sensor_lag": delay,
    }
)
