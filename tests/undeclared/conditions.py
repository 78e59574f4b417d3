"""What is not as on the sound aircraft: numbers of one flight's aircraft and instruments.

`Condition` holds all of them and is neutral by itself. An `Implant` is one change that a set has,
with the name under which the code under test knows it ("" for one that no table has), its size
and, where the number has one physical meaning, its truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from tests.undeclared.crafts import Craft
from tests.undeclared.days import Day, elsewhere
from tests.undeclared.rotor_aero import cut_for_loss

PAUSE_S = 1200.0  # from one take-off to the next


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Numbers of one flight, neutral unless set."""

    hidden_mass: float = 0.0  # kg
    cg: tuple[float, float] = (0.0, 0.0)  # m forward, right
    cg_full: tuple[float, float] = (0.0, 0.0)  # m at a full tank, in proportion to the liquid
    gauge_gain: float = 1.0  # liquid in the tank over what the gauge shows
    drag_area: float = 0.0  # m² of a body more
    inertia_scale: float = 1.0
    cut: float = 0.0  # share of the radius of one propeller
    rotor: int = 0
    cut_from: float = -np.inf  # s on the season's clock
    fouling: float = 0.0  # share of lift slope lost after long flight
    tilt: float = 0.0  # rad by which one motor leans to turn the aircraft clockwise
    tilted: int = 0
    speed_delay: float = 0.0  # s
    speed_with_voltage: float = 0.0  # share of speed misread for each share of voltage
    blind_to_wind: bool = False  # airspeed is ground speed
    # what no table names
    wake: float = 0.0  # share of the front rotors' wash that the rear ones meet
    flex: float = 0.0  # thrust of one rotor lost for each share of load above half of hover's
    slosh: float = 0.0  # share of the liquid that swings
    jet: float = 0.0  # spray pump's moment over weight times arm, to one side
    shed: float = 0.0  # thrust of all rotors lost to ice that builds up and falls off
    band: float = 0.0  # thrust of one rotor lost in a narrow band of its speed
    thermal: float = 0.0  # m/s of rising air over patches of ground
    flap: float = 0.0  # nose-up moment of a cover that opens above a speed
    # instruments
    period: float = 0.0  # s between speed reports
    quantum: float = 0.0  # share of hover speed by which speeds are rounded
    repeats: float = 0.0  # share of rows with the speeds of the row before
    warm: float = 0.0  # K by which the thermometer reads warm beyond its usual
    gauge_drift: float = 0.0  # share of a full tank in 300 s
    airspeed_bias: float = 0.0  # m/s
    voltage_offset: float = 0.0  # share


@dataclass(frozen=True, kw_only=True)
class Implant:
    """One change of a set."""

    kind: str
    name: str = ""  # as the code under test calls it
    size: float  # in the unit of its range below
    condition: Mapping[str, object] = field(default_factory=dict)
    rotor: int | None = None  # counted from 0
    truth: Mapping[str, float] = field(default_factory=dict)  # parameter as reported -> value
    altitude: float | None = None  # m, when the field is elsewhere
    warmer: float = 0.0  # K above standard air there
    wind: tuple[float, float] | None = None  # m/s, the same on all flights
    style: Mapping[str, object] = field(default_factory=dict)  # of the missions that show it

    def on(self, condition: Condition) -> Condition:
        """The condition with this change."""
        return replace(condition, **self.condition)  # type: ignore[arg-type]

    def at(self, day: Day) -> Day:
        """The day at the field of this change."""
        return day if self.altitude is None else elsewhere(day, self.altitude, self.warmer)


Draw = Callable[[np.random.Generator, Craft, float], Implant]

#: Smallest and largest size of each kind, drawn evenly in the logarithm and never drawn again.
RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "rotor": (0.003, 0.15),  # share of its thrust
        "rotor onset": (0.005, 0.15),
        "mass": (0.002, 0.08),  # of the typical mass
        "cg": (0.001, 0.04),  # of the arm
        "cg of tank": (0.003, 0.08),
        "gauge gain": (0.01, 0.25),
        "air": (0.005, 0.2),  # of density
        "wind": (1.0, 8.0),  # m/s
        "drag": (0.05, 1.0),  # of the rotors' discs
        "ground": (0.3, 1.5),  # radius over the lowest height of the legs
        "climb": (0.5, 3.0),  # m/s
        "booms": (0.05, 0.6),  # of inertia
        "fouling": (0.004, 0.12),  # of thrust in five minutes
        "speed with voltage": (0.05, 1.0),
        "tilt": (0.0005, 0.02),  # rad
        "lag": (0.05, 0.8),  # s
        "wake": (0.3, 1.5),
        "flex": (0.01, 0.15),
        "slosh": (0.3, 2.0),
        "jet": (0.001, 0.02),
        "shed": (0.01, 0.1),
        "band": (0.02, 0.2),
        "thermal": (0.2, 2.0),
        "flap": (0.002, 0.04),
        "late ESC": (0.3, 0.3),
        "1 Hz speeds": (1.0, 1.0),
        "rounded speeds": (0.005, 0.03),
        "repeated speeds": (0.1, 0.6),
        "warm thermometer": (3.0, 20.0),  # K
        "gauge drift": (0.01, 0.1),
        "airspeed bias": (0.3, 2.0),  # m/s
        "voltage offset": (0.01, 0.06),
    }
)


def _either(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _way(rng: np.random.Generator, length: float) -> tuple[float, float]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return float(length * np.cos(angle)), float(length * np.sin(angle))


def _rotor(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    rotor = int(rng.integers(craft.rotors))
    return Implant(
        kind="rotor",
        name="rotor_degradation",
        size=size,
        rotor=rotor,
        condition={"cut": cut_for_loss(craft.blade, size), "rotor": rotor},
        truth={"loss": size},
    )


def _rotor_onset(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    one = _rotor(rng, craft, size)
    at = PAUSE_S * int(rng.integers(0, 3)) + float(rng.uniform(60.0, 130.0))
    return replace(one, kind="rotor onset", condition={**one.condition, "cut_from": at})


def _mass(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del rng
    mass = size * craft.typical_mass
    return Implant(
        kind="mass",
        name="extra_mass",
        size=size,
        condition={"hidden_mass": mass},
        truth={"mass": mass},
    )


def _cg(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    x, y = _way(rng, size * craft.arm)
    return Implant(
        kind="cg", name="cg_offset", size=size, condition={"cg": (x, y)}, truth={"x": x, "y": y}
    )


def _cg_tank(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    x, y = _way(rng, size * craft.arm)
    return Implant(
        kind="cg of tank",
        name="cg_offset",
        size=size,
        condition={"cg_full": (x, y)},
        truth={"x_full": x, "y_full": y},
    )


def _gauge(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del craft
    gain = float(np.exp(_either(rng) * size))
    return Implant(
        kind="gauge gain",
        name="tank_scale",
        size=size,
        condition={"gauge_gain": gain},
        truth={"gain": gain},
    )


def _air(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    """Higher or hotter (or colder) than the calibration field."""
    del craft
    if rng.random() < 0.5:
        altitude, warmer = 10_400.0 * size, 0.0
    else:
        altitude, warmer = 0.0, 288.15 * float(np.expm1(_either(rng) * min(size, 0.12)))
    return Implant(
        kind="air",
        name="air_density",
        size=size if altitude else min(size, 0.12),
        altitude=altitude,
        warmer=warmer,
    )


def _wind(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del craft
    north, east = _way(rng, size)
    return Implant(
        kind="wind",
        name="wind",
        size=size,
        condition={"blind_to_wind": True},
        wind=(north, east),
        truth={"wind_north": north, "wind_east": east},
    )


def _drag(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del rng
    area = size * craft.disc * craft.rotors
    return Implant(kind="drag", name="parasite_drag", size=size, condition={"drag_area": area})


def _ground(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    low = max(craft.radius / size, 0.3)
    style = {"height": 3.0 * low, "hills": 2.0 * low, "hill_period": float(rng.uniform(15, 40))}
    return Implant(kind="ground", name="ground_effect", size=size, style=style)


def _climb(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del craft
    style = {"climb": float(rng.uniform(6.0, 14.0)), "climb_speed": size}
    return Implant(kind="climb", name="climb_inflow", size=size, style=style)


def _booms(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    scale = float(np.exp(_either(rng) * size))
    more = craft.inertia * (scale - 1.0)
    truth = zip(("inertia_roll", "inertia_pitch", "inertia_yaw"), map(float, more), strict=True)
    return Implant(
        kind="booms",
        name="manoeuvre_moment",
        size=size,
        condition={"inertia_scale": scale},
        truth=dict(truth),
    )


def _tilt(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    rotor = int(rng.integers(craft.rotors))
    angle = size * _either(rng)
    return Implant(
        kind="tilt", name="yaw_trim", size=size, condition={"tilt": angle, "tilted": rotor}
    )


def _lag(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
    del rng, craft
    return Implant(
        kind="lag",
        name="sensor_lag",
        size=size,
        condition={"speed_delay": size},
        truth={"lag": size},
    )


def _number(kind: str, name: str, key: str) -> Draw:
    def draw(rng: np.random.Generator, craft: Craft, size: float) -> Implant:
        signed = size * (_either(rng) if key in ("airspeed_bias", "voltage_offset") else 1.0)
        rotor = int(rng.integers(craft.rotors))
        condition = {key: signed, "rotor": rotor} if key in ("flex", "band") else {key: signed}
        return Implant(kind=kind, name=name, size=size, condition=condition)

    return draw


SINGLE: Mapping[str, Draw] = MappingProxyType(
    {
        "rotor": _rotor,
        "rotor onset": _rotor_onset,
        "mass": _mass,
        "cg": _cg,
        "cg of tank": _cg_tank,
        "gauge gain": _gauge,
        "air": _air,
        "wind": _wind,
        "drag": _drag,
        "ground": _ground,
        "climb": _climb,
        "booms": _booms,
        "fouling": _number("fouling", "thrust_drift", "fouling"),
        "speed with voltage": _number(
            "speed with voltage", "battery_voltage", "speed_with_voltage"
        ),
        "tilt": _tilt,
        "lag": _lag,
    }
)
OUTSIDE: Mapping[str, Draw] = MappingProxyType(
    {
        k: _number(k, "", k)
        for k in ("wake", "flex", "slosh", "jet", "shed", "band", "thermal", "flap")
    }
)
INSTRUMENTS: Mapping[str, Draw] = MappingProxyType(
    {
        "late ESC": _number("late ESC", "sensor_lag", "speed_delay"),
        "1 Hz speeds": _number("1 Hz speeds", "", "period"),
        "rounded speeds": _number("rounded speeds", "", "quantum"),
        "repeated speeds": _number("repeated speeds", "", "repeats"),
        "warm thermometer": _number("warm thermometer", "", "warm"),
        "gauge drift": _number("gauge drift", "", "gauge_drift"),
        "airspeed bias": _number("airspeed bias", "", "airspeed_bias"),
        "voltage offset": _number("voltage offset", "", "voltage_offset"),
    }
)


def draw(kind: str, rng: np.random.Generator, craft: Craft, size: float | None = None) -> Implant:
    """One change of a kind, its size, unless given, even in the logarithm over its range."""
    drawn = float(np.exp(rng.uniform(*np.log(RANGES[kind]))))
    return {**SINGLE, **OUTSIDE, **INSTRUMENTS}[kind](rng, craft, size or drawn)
