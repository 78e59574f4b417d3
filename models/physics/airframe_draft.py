"""Complete the quantities of a new airframe by formulas and typical values.

    k      = C_T rho D^4/3600            thrust coefficient [N/rpm^2] (Eq. 1 of the paper)
    N_max  = sqrt(T_max/k)               largest rotor speed [rpm]
    v_i    = sqrt(T/(2 rho A)),  q = v_i/(FM w)     rotor torque over thrust [m] in hover

T thrust of one rotor [N], D propeller diameter [m], A its disc [m^2], w = 2 pi N/60 [rad/s], FM the
figure of merit. Quantities that are filled in are marked as guessed.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from math import pi, sqrt
from types import MappingProxyType
from typing import Any

from thrustmargin.models.physics.airframe import (
    OPTIONAL_QUANTITIES,
    QUANTITIES,
    Airframe,
    Quantity,
    airframe_table,
)

INCH = 0.0254  # m
#: C_T of two-blade propellers: median of the makers' tables of 19 of them, 18 to 40 in, whose
#: standard deviation is 0.007 (T-Motor and KDE Direct; pitch 0.30 to 0.35 of the diameter).
TYPICAL_C_T = 0.070
_STANDARD_DENSITY = 1.225  # kg/m^3
_FIGURE_OF_MERIT = 0.7
#: L/min of pump for each litre of tank: the F16's 0.28, the T20's and T40's 0.30.
_PUMP_PER_LITRE = 0.29


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerSet:
    """A motor, ESC and propeller as described by their maker."""

    name: str
    title: str
    quantities: Mapping[str, Quantity]


@cache
def power_sets() -> MappingProxyType[str, PowerSet]:
    """Return the shipped power sets (motor, propeller, thrust) by name."""
    text = (resources.files("thrustmargin.models.shipped") / "power_sets.toml").read_text("utf-8")
    return MappingProxyType(
        {
            name: PowerSet(
                name=name,
                title=table["title"],
                quantities={key: Quantity(**q) for key, q in table["quantities"].items()},
            )
            for name, table in tomllib.loads(text).items()
        }
    )


def guess(name: str, value: float, source: str) -> Quantity:
    """Return a guessed quantity: `value` in the unit that airframe files use for `name`."""
    return Quantity(value, (QUANTITIES | OPTIONAL_QUANTITIES)[name], f"guessed: {source}", True)


def lower_effectiveness() -> Quantity:
    """Return the assumed thrust of the lower rotor of a coaxial pair over that of a free rotor."""
    return guess("lower_rotor_effectiveness", 0.8, "it works in the wash of the upper rotor")


def complete_quantities(given: Mapping[str, Quantity]) -> dict[str, Quantity]:
    """Return all quantities of an airframe, in the order of its file; missing ones are derived.

    `given` must contain empty_mass, tank_volume_l, propeller_diameter, propeller_pitch,
    nominal_voltage, and nameplate_max_thrust or thrust_coefficient with max_rotor_speed_rpm. Raises
    KeyError when it does not.
    """
    q = dict(given)

    def fill(name: str, value: float, source: str) -> None:
        """Add a guessed quantity unless it is given."""
        if name not in q:
            q[name] = guess(name, value, source)

    diameter, litres = q["propeller_diameter"].value, q["tank_volume_l"].value
    if "liquid_density" not in q:
        q["liquid_density"] = Quantity(1.0, "kg/L", "water; change it for another liquid")
    if litres == 0.0 and "pump_max_flow_l_min" not in q:
        q["pump_max_flow_l_min"] = Quantity(0.0, "L/min", "it has no tank")
    fill("pump_max_flow_l_min", _PUMP_PER_LITRE * litres, "0.29 L/min for each litre of tank")
    fill("propeller_blades", 2.0, "two blades")
    fill("reference_density", _STANDARD_DENSITY, "standard air at sea level")
    density = q["reference_density"].value
    if {
        "nameplate_max_thrust",
        "max_rotor_speed_rpm",
    } <= q.keys() and "thrust_coefficient" not in q:
        top, speed = q["nameplate_max_thrust"], q["max_rotor_speed_rpm"]
        q["thrust_coefficient"] = Quantity(
            float(f"{top.value / speed.value**2:.4g}"),
            "N/rpm^2",
            "derived: nameplate_max_thrust at max_rotor_speed_rpm",
            top.guessed or speed.guessed,
        )
    fill(
        "thrust_coefficient",
        float(f"{TYPICAL_C_T * density * diameter**4 / 3600.0:.4g}"),
        f"C_T = {TYPICAL_C_T} (0.057 to 0.078 in makers' tables) at this diameter, by Eq. 1",
    )
    slope = q["thrust_coefficient"]
    if "nameplate_max_thrust" not in q:
        reached = slope.value * q["max_rotor_speed_rpm"].value ** 2
        fill("nameplate_max_thrust", round(reached, 2), "thrust curve at max_rotor_speed_rpm")
    fill(
        "max_rotor_speed_rpm",
        round(sqrt(q["nameplate_max_thrust"].value / slope.value), 0),
        "where the thrust curve reaches nameplate_max_thrust",
    )
    fill("ceiling_voltage", q["nominal_voltage"].value, "nominal_voltage")
    fill("ceiling_voltage_exponent", 1.0, "at full duty the speed of a motor goes with its voltage")
    # v_i/omega in hover, whatever the thrust: sqrt(T/(2 rho A)) over sqrt(T/slope).
    turn = sqrt(slope.value / (2.0 * density * pi * diameter**2 / 4.0)) * 60.0 / (2.0 * pi)
    fill(
        "torque_ratio",
        float(f"{turn / _FIGURE_OF_MERIT:.3g}"),
        f"momentum theory in hover, figure of merit {_FIGURE_OF_MERIT}",
    )
    fill("motor_poles", 28.0, "usual for motors of this class")
    optional = [name for name in OPTIONAL_QUANTITIES if name in q]
    return {name: q[name] for name in (*QUANTITIES, *optional)}


def airframe_toml(airframe: Airframe, heading: str = "") -> str:
    """Return the text of the airframe's file; each line of `heading` becomes a comment at the
    top."""
    table = airframe_table(airframe)
    lines = [f"# {line}".rstrip() for line in heading.splitlines()]
    keys = ("name", "title", "layout", "tank_source", "pump_on")
    lines += [f"{key} = {_toml(table[key])}" for key in keys if key in table]
    lines += ["", "[quantities]"]
    lines += [f"{name} = {_toml(quantity)}" for name, quantity in table["quantities"].items()]
    for rotor in table["rotors"]:
        lines += ["", "[[rotors]]", *(f"{key} = {_toml(value)}" for key, value in rotor.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """Format a dict (as an inline table), list, text, number or flag as a TOML value."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        # A JSON string is a TOML string but for the one control character that JSON leaves.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value)
