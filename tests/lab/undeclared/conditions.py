"""What is not as on the sound aircraft: numbers of one flight's aircraft and instruments.

`Condition` holds all of them and is neutral by itself. An `Implant` is one change that a set has,
with the name under which the code under test knows it ("" for one that no table has), its size
and, where the number has one physical meaning, its truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tests.lab.undeclared.crafts import Craft
from tests.lab.undeclared.days import Day, elsewhere
from tests.lab.undeclared.rotor_aero import cut_for_loss, hover

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
    cut_until: float = np.inf
    fouling: float = 0.0  # share of lift slope lost after long flight
    tilt: float = 0.0  # rad by which one motor leans to turn the aircraft clockwise
    tilted: int = 0
    speed_delay: float = 0.0  # s
    speed_with_voltage: float = 0.0  # share of speed misread for each share of voltage
    blind_to_wind: bool = False  # airspeed is ground speed
    level_air: bool = False  # rotors that feel no climb
    no_ground: bool = False  # nor the ground
    # what no table names
    wake: float = 0.0  # share of the front rotors' wash that the rear ones meet
    flex: float = 0.0  # thrust of one rotor lost for each share of load above half of hover's
    slosh: float = 0.0  # share of the liquid that swings
    jet: float = 0.0  # spray pump's moment over weight times arm, to one side
    shed: float = 0.0  # thrust of all rotors lost to ice that builds up and falls off
    band: float = 0.0  # thrust of one rotor lost in a narrow band of its speed
    thermal: float = 0.0  # m/s of rising air over patches of ground
    flap: float = 0.0  # nose-up moment of a cover that opens above a speed
    worn: float = 0.0  # thrust that a rotor and the next one lose at 6 m/s, with airspeed squared
    sail: float = 0.0  # roll moment of a side wind of 5 m/s, with its square
    recoil: tuple[float, float] = (0.0, 0.0)  # spray's roll, pitch moment over weight times arm
    swing: float = 0.0  # m of the line on which the liquid swings as the aircraft accelerates
    hung: float = 0.0  # kg hung at the end of an arm, that of `rotor`
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
    without: Mapping[str, object] = field(default_factory=dict)  # condition that lacks it

    def on(self, condition: Condition) -> Condition:
        """The condition with this change."""
        return replace(condition, **self.condition)  # type: ignore[arg-type]

    @property
    def absent(self) -> Implant:
        """The same flown without this change."""
        return replace(self, condition=self.without, altitude=None)

    def at(self, day: Day) -> Day:
        """The day at the field of this change."""
        return day if self.altitude is None else elsewhere(day, self.altitude, self.warmer)


Fields = dict[str, Any]  # of an Implant
Draw = Callable[[np.random.Generator, Craft, float], Fields]


def _either(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _way(rng: np.random.Generator, length: float) -> tuple[float, float]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return float(length * np.cos(angle)), float(length * np.sin(angle))


def _rotor(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    rotor = int(rng.integers(craft.rotors))
    cut = cut_for_loss(craft.blade, size)
    return {
        "rotor": rotor,
        "condition": {"cut": cut, "rotor": rotor},
        "truth": {"loss": size},
    }


def _rotor_onset(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    one = _rotor(rng, craft, size)
    at = PAUSE_S * int(rng.integers(0, 3)) + float(rng.uniform(60.0, 130.0))
    return {**one, "condition": {**one["condition"], "cut_from": at}}


def _longer_blade(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    """A propeller longer by a share of its radius."""
    rotor = int(rng.integers(craft.rotors))
    sound, longer = (hover(replace(craft.blade, cut=c))[0] for c in (0.0, -size))
    truth = {"loss": 1.0 - longer / sound}
    return {"rotor": rotor, "condition": {"cut": -size, "rotor": rotor}, "truth": truth}


def _late_rotor(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    """A rotor that went bad between two flights, half way through the season."""
    one = _rotor(rng, craft, size)
    at = PAUSE_S * (FLIGHTS["late rotor"] // 2) - 60.0
    return {**one, "condition": {**one["condition"], "cut_from": at}}


def _repaired_rotor(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    one = _rotor(rng, craft, size)
    at = PAUSE_S * (FLIGHTS["repaired rotor"] // 2) - 60.0
    return {**one, "condition": {**one["condition"], "cut_until": at}}


def _mass(_: np.random.Generator, craft: Craft, size: float) -> Fields:
    mass = size * craft.typical_mass
    return {"condition": {"hidden_mass": mass}, "truth": {"mass": mass}}


def _cg(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    x, y = _way(rng, size * craft.arm)
    return {"condition": {"cg": (x, y)}, "truth": {"x": x, "y": y}}


def _cg_tank(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    x, y = _way(rng, size * craft.arm)
    return {"condition": {"cg_full": (x, y)}, "truth": {"x_full": x, "y_full": y}}


def _gauge(rng: np.random.Generator, _: Craft, size: float) -> Fields:
    gain = float(np.exp(_either(rng) * size))
    return {"condition": {"gauge_gain": gain}, "truth": {"gain": gain}}


def _air(rng: np.random.Generator, _: Craft, size: float) -> Fields:
    """Higher or hotter (or colder, to 12 %) than the calibration field."""
    if rng.random() < 0.5:
        return {"altitude": 10_400.0 * size}
    size = min(size, 0.12)
    warmer = 288.15 * float(np.expm1(_either(rng) * size))
    return {"altitude": 0.0, "warmer": warmer, "size": size}


def _wind(rng: np.random.Generator, _: Craft, size: float) -> Fields:
    north, east = _way(rng, size)
    truth = {"wind_north": north, "wind_east": east}
    return {"condition": {"blind_to_wind": True}, "wind": (north, east), "truth": truth}


def _drag(_: np.random.Generator, craft: Craft, size: float) -> Fields:
    return {"condition": {"drag_area": size * craft.disc * craft.rotors}}


def _ground(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    low = max(craft.radius / size, 0.3)
    period = float(rng.uniform(15, 40))
    style = {"height": 3.0 * low, "hills": 2.0 * low, "hill_period": period}
    return {"style": style, "without": {"no_ground": True}}


def _climb(rng: np.random.Generator, _: Craft, size: float) -> Fields:
    style = {"climb": float(rng.uniform(6.0, 14.0)), "climb_speed": size}
    return {"style": style, "without": {"level_air": True}}


def _booms(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    scale = float(np.exp(_either(rng) * size))
    axes = ("inertia_roll", "inertia_pitch", "inertia_yaw")
    more = map(float, craft.inertia * (scale - 1.0))
    return {
        "condition": {"inertia_scale": scale},
        "truth": dict(zip(axes, more, strict=True)),
    }


def _tilt(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    rotor = int(rng.integers(craft.rotors))
    return {"condition": {"tilt": size * _either(rng), "tilted": rotor}}


def _tilted_arm(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    tilted = _tilt(rng, craft, size)
    return {**tilted, "rotor": tilted["condition"]["tilted"]}


def _hung(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
    rotor = int(rng.integers(craft.rotors))
    condition = {"hung": size, "rotor": rotor}
    return {"rotor": rotor, "condition": condition, "truth": {"mass": size}}


def _recoil(rng: np.random.Generator, _: Craft, size: float) -> Fields:
    return {"condition": {"recoil": _way(rng, size)}}


def _lag(_: np.random.Generator, __: Craft, size: float) -> Fields:
    return {"condition": {"speed_delay": size}, "truth": {"lag": size}}


def _number(key: str, signed: bool = False, of_rotor: bool = False) -> Draw:
    """A size that is one number of the condition, of either sign or of one rotor."""

    def fields(rng: np.random.Generator, craft: Craft, size: float) -> Fields:
        size *= _either(rng) if signed else 1.0
        rotor = int(rng.integers(craft.rotors))
        return {"condition": {key: size, "rotor": rotor} if of_rotor else {key: size}}

    return fields


#: Name in the code under test, smallest and largest size, and what it changes. Sizes are drawn
#: evenly in the logarithm and never drawn again for being small.
SINGLE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "rotor": ("rotor_degradation", 0.003, 0.15, _rotor),  # share of its thrust
        "rotor onset": ("rotor_degradation", 0.005, 0.15, _rotor_onset),
        "mass": ("extra_mass", 0.002, 0.08, _mass),  # of the typical mass
        "cg": ("cg_offset", 0.001, 0.04, _cg),  # of the arm
        "cg of tank": ("cg_offset", 0.003, 0.08, _cg_tank),
        "gauge gain": ("tank_scale", 0.01, 0.25, _gauge),
        "air": ("air_density", 0.005, 0.2, _air),  # of density
        "wind": ("wind", 1.0, 8.0, _wind),  # m/s
        "drag": ("parasite_drag", 0.05, 1.0, _drag),  # of the rotors' discs
        "ground": ("ground_effect", 0.3, 1.5, _ground),  # radius over the legs' lowest height
        "climb": ("climb_inflow", 0.5, 3.0, _climb),  # m/s
        "booms": ("manoeuvre_moment", 0.05, 0.6, _booms),  # of inertia
        "fouling": ("thrust_drift", 0.004, 0.12, _number("fouling")),  # of thrust in five minutes
        "speed with voltage": ("battery_voltage", 0.05, 1.0, _number("speed_with_voltage")),
        "tilt": ("yaw_trim", 0.0005, 0.02, _tilt),  # rad
        "lag": ("sensor_lag", 0.05, 0.8, _lag),  # s
    }
)
OUTSIDE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "wake": ("", 0.3, 1.5, _number("wake")),
        "flex": ("", 0.01, 0.15, _number("flex", of_rotor=True)),
        "slosh": ("", 0.3, 2.0, _number("slosh")),
        "jet": ("", 0.001, 0.02, _number("jet")),
        "shed": ("", 0.01, 0.1, _number("shed")),
        "band": ("", 0.02, 0.2, _number("band", of_rotor=True)),
        "thermal": ("", 0.2, 2.0, _number("thermal")),
        "flap": ("", 0.002, 0.04, _number("flap")),
    }
)
INSTRUMENTS: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "late ESC": ("sensor_lag", 0.3, 0.3, _number("speed_delay")),
        "1 Hz speeds": ("", 1.0, 1.0, _number("period")),
        "rounded speeds": ("", 0.005, 0.03, _number("quantum")),
        "repeated speeds": ("", 0.1, 0.6, _number("repeats")),
        "warm thermometer": ("", 3.0, 20.0, _number("warm")),  # K
        "gauge drift": ("", 0.01, 0.1, _number("gauge_drift")),
        "airspeed bias": ("", 0.3, 2.0, _number("airspeed_bias", signed=True)),  # m/s
        "voltage offset": ("", 0.01, 0.06, _number("voltage_offset", signed=True)),
    }
)
#: Of the second plan alone.
MORE_SINGLE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "longer blade": ("rotor_degradation", 0.005, 0.03, _longer_blade),  # of its radius
        "late rotor": ("rotor_degradation", 0.02, 0.1, _late_rotor),
        "repaired rotor": ("rotor_degradation", 0.03, 0.1, _repaired_rotor),
    }
)
MORE_OUTSIDE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "worn": ("", 0.02, 0.12, _number("worn", of_rotor=True)),
        "sail": ("", 0.002, 0.02, _number("sail", signed=True)),
    }
)
#: Of the third plan alone.
THIRD_SINGLE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "tilted arm": ("yaw_trim", 0.035, 0.09, _tilted_arm),  # rad
        "hung weight": ("extra_mass", 0.3, 1.0, _hung),  # kg
    }
)
THIRD_OUTSIDE: Mapping[str, tuple[str, float, float, Draw]] = MappingProxyType(
    {
        "recoil": ("", 0.004, 0.02, _recoil),  # of weight times arm
        "swing": ("", 0.1, 0.5, _number("swing")),  # m
    }
)
EVERY_OUTSIDE = MappingProxyType({**OUTSIDE, **MORE_OUTSIDE, **THIRD_OUTSIDE})
KINDS = MappingProxyType({**SINGLE, **MORE_SINGLE, **THIRD_SINGLE, **EVERY_OUTSIDE, **INSTRUMENTS})
#: Flights to identify from, where it is not three to five.
FLIGHTS = MappingProxyType({"late rotor": 12, "repaired rotor": 8})


def draw(kind: str, rng: np.random.Generator, craft: Craft, size: float | None = None) -> Implant:
    """One change of a kind, its size, unless given, even in the logarithm over its range."""
    name, low, high, fields = KINDS[kind]
    drawn = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return Implant(
        **{"kind": kind, "name": name, "size": size or drawn} | fields(rng, craft, size or drawn)
    )
