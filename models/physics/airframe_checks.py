"""Check the table of an airframe file, and list all of its problems at once.

A table is a parsed TOML file: `quantities` of `{ value, unit, source, guessed }` and a list of
`rotors`. Nothing here reads a file.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from math import inf, isfinite
from types import MappingProxyType
from typing import Any

import numpy as np

from thrustmargin.models.physics.motor_layouts import motor_layouts

#: name of the quantity -> unit that its file must state.
QUANTITIES = MappingProxyType(
    {
        "empty_mass": "kg",
        "tank_volume_l": "L",
        "liquid_density": "kg/L",
        "pump_max_flow_l_min": "L/min",
        "propeller_diameter": "m",
        "propeller_pitch": "m",
        "propeller_blades": "1",
        "thrust_coefficient": "N/rpm^2",
        "reference_density": "kg/m^3",
        "max_rotor_speed_rpm": "rpm",
        "nameplate_max_thrust": "N",
        "ceiling_voltage": "V",
        "ceiling_voltage_exponent": "1",
        "nominal_voltage": "V",
        "torque_ratio": "m",
        "motor_poles": "1",
    }
)
#: Quantities that a file may lack. The first two serve to make missing [[rotors]]: distance of the
#: farthest rotor from the centre, and thrust of a lower coaxial rotor over that of a free one. The
#: third is the maker's largest mass in flight.
OPTIONAL_QUANTITIES = MappingProxyType(
    {"arm": "m", "lower_rotor_effectiveness": "1", "max_takeoff_mass": "kg"}
)
#: Quantities for which zero has a meaning: a ceiling that voltage does not move, no tank, no pump.
MAY_BE_ZERO = frozenset({"ceiling_voltage_exponent", "tank_volume_l", "pump_max_flow_l_min"})
#: C_T = a 3600/(rho D^4) of propellers: UIUC's and the makers' tables lie between 0.02 and 0.2.
_COEFFICIENT_RANGE = (0.01, 0.5)
_LIQUIDS = (0.5, 3.0)  # kg/L, of sprayed liquids
#: Weight of a full tank over the lift of all rotors, beyond which its unit is wrong: ml are 1000.
_MILLILITRES = 10.0
_GRAVITY = 9.80665  # m/s^2
_LARGEST = 1e30  # of any number in a file
_KEYS = ("name", "title", "layout", "tank_source", "extends", "quantities", "rotors")
_QUANTITY_KEYS = ("value", "unit", "source", "guessed", "note")
_ROTOR_KEYS = ("name", "position_frd", "spin", "effectiveness")


def wrong_kinds(table: dict[str, Any]) -> list[str]:
    """List the sections that have the wrong type, so that the rest cannot be checked."""
    kinds = (("quantities", dict), ("rotors", list))
    return [
        f"{key} must be a table, is {table[key]!r}"
        for key, kind in kinds
        if not isinstance(table.get(key, kind()), kind)
    ]


def with_rotors(table: dict[str, Any]) -> dict[str, Any]:
    """Add the [[rotors]] of the layout, if the table has none but a known layout and an arm."""
    layout = motor_layouts().get(str(table.get("layout")))
    arm = _value(table, "arm")
    if "rotors" in table or layout is None or not 0.0 < arm < inf:
        return table
    effectiveness = _value(table, "lower_rotor_effectiveness")
    if any(layout.lower) and not 0.0 < effectiveness <= 1.0:
        return table
    return {**table, "rotors": layout.rotors(arm, effectiveness)}


def table_problems(table: dict[str, Any]) -> list[str]:
    """List all problems of a complete table, each with its correction; empty without one."""
    problems = _unknown(table, _KEYS, "key")
    problems += [f"{key} must be text" for key in ("title", "layout") if not _is_text(table, key)]
    given = table.get("quantities", {})
    for name, unit in (QUANTITIES | OPTIONAL_QUANTITIES).items():
        if name in given or name in QUANTITIES:
            problems += _quantity_problems(name, unit, given.get(name))
    problems += _unknown(given, (*QUANTITIES, *OPTIONAL_QUANTITIES), "quantity")
    rotors = _rotors_problems(table)
    return [*problems, *rotors] or _impossible_together(table)


def _quantity_problems(name: str, unit: str, entry: Any) -> list[str]:
    """List the problems of one quantity."""
    if not isinstance(entry, dict) or not {"value", "unit", "source"} <= entry.keys():
        return [f"{name} needs value, unit ({unit}) and source"]
    problems = _unknown(entry, _QUANTITY_KEYS, f"key of {name}")
    value = entry["value"]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if entry["unit"] != unit:
        problems.append(f"{name} is in {entry['unit']!r}; give it in {unit!r}")
    elif not is_number or not (0 < value < _LARGEST or (value == 0 and name in MAY_BE_ZERO)):
        problems.append(f"{name} is {value!r}; it must be a number above 0")
    if not isinstance(entry.get("guessed", False), bool):
        problems.append(f"{name}: guessed is {entry['guessed']!r}; write true or false")
    return problems


def _rotors_problems(table: dict[str, Any]) -> list[str]:
    """List the problems of layout and rotors."""
    name = table.get("layout")
    layout = motor_layouts().get(str(name))
    if "rotors" not in table:
        if layout is None:
            near = _suggestion(str(name), motor_layouts())
            return [f"layout {name!r} is none of the known ones{near}; give its [[rotors]]"]
        lower = ", lower_rotor_effectiveness" if any(layout.lower) else ""
        return [
            f"layout {name} without rotors: give its {layout.rotor_count} [[rotors]], or in "
            f"[quantities] arm{lower}, from which they are made"
        ]
    rotors = table["rotors"]
    if len(rotors) < 3:
        return [f"{len(rotors)} [[rotors]]; a multirotor has at least 3"]
    problems = [p for n, rotor in enumerate(rotors, 1) for p in _rotor_problems(n, rotor)]
    if problems:
        return problems
    positions = np.array([rotor["position_frd"] for rotor in rotors], dtype=np.float64)
    arm = float(np.max(np.hypot(*positions[:, :2].T)))
    if arm == 0.0:
        return ["all rotors are at the centre; give position_frd in m"]
    if layout is not None and (words := layout.mismatch(positions)):
        problems.append(
            f"layout and [[rotors]] disagree: {words}; correct one of them (a layout of your own "
            "may have any other name, such as 'custom')"
        )
    stated = _value(table, "arm")
    if isfinite(stated) and abs(stated - arm) > 0.01 * arm:
        problems.append(
            f"arm is {stated:g} m, but the farthest of the [[rotors]] is {arm:.4g} m from the "
            "centre; correct one of them, or leave the [[rotors]] out and they are made from arm"
        )
    return problems


def _rotor_problems(number: int, rotor: Any) -> list[str]:
    """List the problems of one rotor; `number` counts from 1."""
    where = f"rotor {number}"
    if not isinstance(rotor, dict):
        return [f"{where} must be a table with name, position_frd and spin"]
    problems = _unknown(rotor, _ROTOR_KEYS, f"key of {where}")
    if not isinstance(rotor.get("name"), str):
        problems.append(f"{where} needs a name, such as 'front right'")
    position = rotor.get("position_frd")
    if (
        not isinstance(position, list | tuple)
        or len(position) != 3
        or not all(map(_is_number, position))
    ):
        problems.append(f"{where}: position_frd must be three numbers in m")
    elif max(map(abs, position)) > 50.0:
        problems.append(f"{where}: position_frd {position} is not in m")
    if rotor.get("spin") not in ("ccw", "cw"):
        problems.append(f"{where}: spin is {rotor.get('spin')!r}; write 'ccw' or 'cw'")
    effectiveness = rotor.get("effectiveness", 1.0)
    if not _is_number(effectiveness) or not 0.0 < effectiveness <= 1.0:
        problems.append(f"{where}: effectiveness of a rotor must be above 0 and at most 1")
    return problems


def _impossible_together(table: dict[str, Any]) -> list[str]:
    """List values that are plausible alone but impossible together, mostly due to a wrong unit."""
    problems = []
    slope, top = _value(table, "thrust_coefficient"), _value(table, "max_rotor_speed_rpm")
    density, diameter = _value(table, "reference_density"), _value(table, "propeller_diameter")
    low, high = _COEFFICIENT_RANGE
    per_coefficient = density * diameter**4  # rounds to 0 for an impossibly small diameter
    coefficient = slope * 3600.0 / per_coefficient if per_coefficient > 0.0 else inf
    if not isfinite(coefficient):
        problems.append(
            f"propeller_diameter is {diameter:g} m and reference_density {density:g} kg/m^3, which "
            "no propeller and no air has: check both units"
        )
    elif not low <= coefficient <= high:
        problems.append(
            f"thrust_coefficient {slope:g} N/rpm^2 and propeller_diameter {diameter:g} m make a "
            f"C_T of {coefficient:.3g}; a propeller has {low:g} to {high:g}: check both units"
        )
    largest, empty = _value(table, "max_takeoff_mass"), _value(table, "empty_mass")
    if largest < empty:
        problems.append(
            f"max_takeoff_mass {largest:g} kg is below empty_mass {empty:g} kg: check both"
        )
    share = sum(rotor.get("effectiveness", 1.0) for rotor in table["rotors"])
    lift, weight = share * slope * top**2, empty * _GRAVITY
    if lift <= weight:
        problems.append(
            f"all rotors at max_rotor_speed_rpm make {lift:.4g} N, which does not lift the empty "
            f"weight of {weight:.4g} N: check empty_mass, thrust_coefficient, max_rotor_speed_rpm"
        )
    litres, heavy = _value(table, "tank_volume_l"), _value(table, "liquid_density")
    thin, thick = _LIQUIDS
    if not thin <= heavy <= thick:
        problems.append(
            f"liquid_density is {heavy:g} kg/L; a liquid has {thin:g} to {thick:g}: check its unit"
        )
    elif (liquid := litres * heavy * _GRAVITY) > _MILLILITRES * lift:
        problems.append(
            f"a full tank of {litres:g} L alone weighs {liquid:.4g} N, which all rotors with their "
            f"{lift:.4g} N do not lift: check tank_volume_l"
        )
    return problems


def _unknown(given: dict[str, Any], known: Iterable[str], kind: str) -> list[str]:
    """List unknown keys, each with the nearest known one."""
    known = tuple(known)
    return [
        f"unknown {kind} {key!r}{_suggestion(key, known) or '; check its spelling'}"
        for key in sorted(map(str, given))
        if key not in known
    ]


def _suggestion(word: str, known: Iterable[str]) -> str:
    """Return a question with the nearest known word; empty without."""
    near = get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def _is_text(table: dict[str, Any], key: str) -> bool:
    """Return whether the value of a key is text."""
    return isinstance(table.get(key), str)


def _is_number(value: Any) -> bool:
    """Return whether a value is a number below _LARGEST."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) < _LARGEST


def _value(table: dict[str, Any], name: str) -> float:
    """Return a quantity's number; NaN if there is none."""
    entry = table.get("quantities", {}).get(name)
    value = entry.get("value") if isinstance(entry, dict) else None
    return float("nan") if value is None or not _is_number(value) else float(value)
