"""Check the table of an airframe file, and list all of its problems at once.

A table is a parsed TOML file: `quantities` of `{ value, unit, source, guessed }` and a list of
`rotors`. Nothing here reads a file.

Read an airframe, the description of one aircraft, from a TOML file.

A file contains tables of quantities `{ value = 21.1, unit = "kg", source = "..." }`, with `guessed
= true` where nobody measured or printed the value. A guess may have a `thrust_error`: the standard
error that it leaves in thrust, as a share of it. `extends = "other"` takes every value of another
airframe and replaces those given; other is a shipped name, or the path of a .toml file relative to
this one. `tank_source` may name the message that reports the tank level, for example
"BATTERY_STATUS 1"; without it the best source is used. `pump_on` may say where the pump is on in a
plan that does not switch it: "always" or "lines". Without `[[rotors]]` they are made from a
known `layout` (`motor_layouts`) and the quantity `arm`. Rotor order is the autopilot's motor order;
positions are `_frd` from the centre of gravity. `spin` is +1 for a rotor that turns
counter-clockwise seen from above, -1 for clockwise.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib import resources
from math import inf, isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.motor_layouts import motor_layouts
from thrustmargin.models.whole_file import regular

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
_KEYS = ("name", "title", "layout", "tank_source", "pump_on", "extends", "quantities", "rotors")
_QUANTITY_KEYS = ("value", "unit", "source", "guessed", "thrust_error", "note")
#: Where the pump is on in a plan that does not switch it; "": not known.
PUMP_RULES = ("always", "lines")
_ROTOR_KEYS = ("name", "position_frd", "spin", "effectiveness")


def wrong_kinds(table: dict[str, Any]) -> list[str]:
    """List the problems of sections that have the wrong type, which prevents all further checks."""
    kinds = (("quantities", dict), ("rotors", list))
    return [
        f"{key} must be a table, is {table[key]!r}"
        for key, kind in kinds
        if not isinstance(table.get(key, kind()), kind)
    ]


def with_rotors(table: dict[str, Any]) -> dict[str, Any]:
    """Return an airframe table with [[rotors]] added from its layout and arm length.

    Return it unchanged if it has rotors, an unknown layout or no valid arm.
    """
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
    if table.get("pump_on", "") not in ("", *PUMP_RULES):
        problems.append(f"pump_on is {table['pump_on']!r:.40}; write {' or '.join(PUMP_RULES)}")
    given = table.get("quantities", {})
    for name, unit in (QUANTITIES | OPTIONAL_QUANTITIES).items():
        if name in given or name in QUANTITIES:
            problems += _quantity_problems(name, unit, given.get(name))
    problems += _unknown(given, (*QUANTITIES, *OPTIONAL_QUANTITIES), "quantity")
    rotors = _rotors_problems(table)
    return [*problems, *rotors] or _impossible_together(table)


def _quantity_problems(name: str, unit: str, entry: Any) -> list[str]:
    """List the problems of the table `entry` of quantity `name`, in words; empty without one.

    `unit` is the required unit. The value must be above 0, for the quantities of MAY_BE_ZERO 0 or
    more.
    """
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
    error = entry.get("thrust_error", 0.1)
    if not _is_number(error) or not 0.0 < error < 1.0:
        problems.append(f"{name}: thrust_error is {error!r:.40}; write a share, such as 0.1")
    return problems


def _rotors_problems(table: dict[str, Any]) -> list[str]:
    """List the problems of an airframe table's layout and rotors, in words; empty without one.

    Without rotors the layout must be known, and then the arm is missing. With fewer than 3 rotors,
    or a problem of one rotor's table, the places are not compared with layout and arm.
    """
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
    """List the problems of one rotor's table (name, position, spin, effectiveness) in words; empty
    without one.

    `number` counts from 1 and names the rotor. An effectiveness that is absent counts as 1.
    """
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
    """List values of a table that are plausible alone but impossible together, in words.

    Compared are thrust coefficient and propeller, the masses, the thrust of all rotors with the
    empty weight and with a full tank, and the liquid's density. Mostly a unit is wrong. Empty
    without any.
    """
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
    """List a message for each key of `given` not in `known`, with the most similar known key."""
    known = tuple(known)
    return [
        f"unknown {kind} {key!r}{_suggestion(key, known) or '; check its spelling'}"
        for key in sorted(map(str, given))
        if key not in known
    ]


def _suggestion(word: str, known: Iterable[str]) -> str:
    """Return "; did you mean WORD?" with the most similar known word; empty without one."""
    near = get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def _is_text(table: dict[str, Any], key: str) -> bool:
    """Return True if the value of a key is text."""
    return isinstance(table.get(key), str)


def _is_number(value: Any) -> bool:
    """Return True if a value is an int or float, no bool, with a magnitude below _LARGEST."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) < _LARGEST


def _value(table: dict[str, Any], name: str) -> float:
    """Return a quantity's number; NaN if there is none."""
    entry = table.get("quantities", {}).get(name)
    value = entry.get("value") if isinstance(entry, dict) else None
    return float("nan") if value is None or not _is_number(value) else float(value)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of the airframe file with its unit and its source."""

    value: float
    unit: str
    source: str
    guessed: bool = False  # nobody measured or printed it; results that depend on it say so
    thrust_error: float = nan  # of a guess: standard error of ln thrust; NaN: not known


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """An aircraft: masses, tank, rotors in motor order, thrust curve and its ceiling. SI units."""

    name: str
    title: str
    layout: str
    empty_mass: float  # kg with batteries, without liquid
    tank_volume_l: float  # L
    liquid_density: float  # kg/L
    pump_max_flow_l_min: float  # L/min
    propeller_diameter: float  # m
    propeller_pitch: float  # m
    propeller_blades: float
    thrust_coefficient: float  # N/rpm², at reference_density
    reference_density: float  # kg/m³
    max_rotor_speed_rpm: float  # rpm reached at full throttle and ceiling_voltage
    nameplate_max_thrust: float  # N a rotor, as the maker prints it
    ceiling_voltage: float  # V at which max_rotor_speed_rpm is reached
    ceiling_voltage_exponent: (
        float  # max rotor speed is proportional to (voltage/ceiling_voltage)^this
    )
    nominal_voltage: float  # V of the battery
    torque_ratio: float  # m, rotor torque over rotor thrust
    motor_poles: float
    rotor_position_frd: Floats  # (R, 3) m
    rotor_spin: Floats  # (R,) +1 CCW from above, -1 CW
    rotor_effectiveness: Floats  # (R,) thrust at a speed over that of a free rotor (coaxial)
    rotor_names: tuple[str, ...]
    quantities: MappingProxyType[str, Quantity] = field(repr=False)
    tank_source: str = "auto"  # which message its tank level comes from, as readers name sources
    pump_on: str = ""  # rule for plans that do not switch the pump: always, lines; "": not known

    def __repr__(self) -> str:
        return (
            f"Airframe {self.name}: {self.title}\n"
            f"  {self.layout}, {self.rotor_count} rotors on arms of {self.arm:.3g} m, "
            f"{self.empty_mass:.4g} kg empty, tank of {self.tank_capacity_kg:.4g} kg"
        )

    @property
    def rotor_count(self) -> int:
        """Return the number of rotors, R."""
        return self.rotor_spin.size

    @property
    def arm(self) -> float:
        """Return the largest horizontal distance of a rotor from the centre, m."""
        return float(np.max(np.hypot(*self.rotor_position_frd[:, :2].T), initial=0.0))

    @property
    def max_takeoff_mass(self) -> float:
        """Return the maker's largest mass in flight, kg; inf where the file states none."""
        stated = self.quantities.get("max_takeoff_mass")
        return float("inf") if stated is None else stated.value

    @property
    def guessed(self) -> tuple[str, ...]:
        """Return the names of the guessed quantities, in the order of the file."""
        return tuple(name for name, quantity in self.quantities.items() if quantity.guessed)

    @property
    def tank_capacity_kg(self) -> float:
        """Return the mass of a full tank, kg."""
        return self.tank_volume_l * self.liquid_density


def airframe_names() -> list[str]:
    """List the names of the shipped airframes, sorted."""
    folder = resources.files("thrustmargin.models") / "airframes"
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def load_airframe(name_or_path: str | Path) -> Airframe:
    """Load a shipped airframe by name, or an airframe file by its path, which ends in .toml.

    Raises AirframeError when it is missing, lacks a value, or a value is in another unit.
    """
    return airframe_from_table(_read(str(name_or_path), ()), where=str(name_or_path))


def _read(name_or_path: str, children: tuple[str, ...]) -> dict[str, Any]:
    """Read the table of an airframe, with the values it inherits by `extends` (`_extend`).

    `name_or_path` is a shipped airframe's name, or a path ending in .toml; a relative path in
    `extends` is from the file's folder. `children` are the files that extend it, to find cycles.
    Raise AirframeError for an unknown name, a file that cannot be read or is no such table, and a
    cycle.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        try:
            text = regular(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise AirframeError(
                f"cannot read airframe file {path}: {reason}; give a path to a .toml file"
            ) from error
    else:
        names = airframe_names()
        if name_or_path not in names:
            raise AirframeError(
                f"no airframe {name_or_path!r}; shipped are {', '.join(names)}, "
                "or give a path ending in .toml"
            )
        text = (
            resources.files("thrustmargin.models") / "airframes" / f"{name_or_path}.toml"
        ).read_text("utf-8")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: too many digits, too
        raise AirframeError(f"{name_or_path}: not a TOML file: {error}") from error
    _raise_problems(wrong_kinds(table), name_or_path)
    parent = table.pop("extends", None)
    if parent is None:
        return table
    parent = str(parent)
    if path.suffix == ".toml" and parent.endswith(".toml"):
        parent = str(path.parent / parent)
    if parent in (name_or_path, *children):
        raise AirframeError(f"{name_or_path}: extends {parent!r}, which extends it again")
    base = _read(parent, (name_or_path, *children))
    return _extend(base, table)


def _extend(base: dict[str, Any], table: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of an airframe's TOML table `base` in which the keys of `table` replace those
    of `base` whole, but "quantities" one by one.

    Rotors and the quantity "arm" both place the rotors. So rotors in `table` drop the arm of
    `base`; without them, an arm or a different layout in `table` drops the rotors of `base`. A
    different layout also drops the arm. What `table` itself has is kept.
    """
    own, inherited = table.get("quantities", {}), dict(base.get("quantities", {}))
    base = dict(base)
    if "rotors" in table:
        inherited.pop("arm", None)
    elif "arm" in own or table.get("layout", base.get("layout")) != base.get("layout"):
        base.pop("rotors", None)
        if "layout" in table and table["layout"] != base.get("layout"):
            inherited.pop("arm", None)
    return {**base, **table, "quantities": {**inherited, **own}}


def quantity_table(quantity: Quantity) -> dict[str, Any]:
    """Return a quantity as the table of an airframe file: value, unit, source.

    Keys `guessed` and `thrust_error` are only added where they are set.
    """
    table = {"value": quantity.value, "unit": quantity.unit, "source": quantity.source}
    known = {} if np.isnan(quantity.thrust_error) else {"thrust_error": quantity.thrust_error}
    return table | ({"guessed": True} if quantity.guessed else {}) | known


def airframe_table(airframe: Airframe) -> dict[str, Any]:
    """Return the airframe as the table of its file: `name`, `title`, `layout`, `tank_source`,
    `quantities`, `rotors`, and `pump_on` if it is not empty.

    A rotor has `name`, `position_frd` (m), `spin` ("cw" or "ccw") and `effectiveness`.
    """
    return {
        "name": airframe.name,
        "title": airframe.title,
        "layout": airframe.layout,
        "tank_source": airframe.tank_source,
        **({"pump_on": airframe.pump_on} if airframe.pump_on else {}),
        "quantities": {name: quantity_table(q) for name, q in airframe.quantities.items()},
        "rotors": [
            {
                "name": name,
                "position_frd": position.tolist(),
                "spin": "ccw" if spin > 0 else "cw",
                "effectiveness": float(effectiveness),
            }
            for name, position, spin, effectiveness in zip(
                airframe.rotor_names,
                airframe.rotor_position_frd,
                airframe.rotor_spin,
                airframe.rotor_effectiveness,
                strict=True,
            )
        ],
    }


def airframe_from_table(table: dict[str, Any], where: str) -> Airframe:
    """Build the airframe of a complete table; `where` names its origin in messages.

    Missing rotors are made from a known layout and its arm. Raises AirframeError, which lists every
    value that is missing, impossible, misspelt or in another unit.
    """
    _raise_problems(wrong_kinds(table), where)
    table = with_rotors(table)
    _raise_problems(table_problems(table), where)
    given, rotors = table["quantities"], table["rotors"]
    quantities = {
        name: Quantity(
            float(given[name]["value"]),
            unit,
            str(given[name]["source"]),
            given[name].get("guessed", False),
            float(given[name].get("thrust_error", nan)),
        )
        for name, unit in (QUANTITIES | OPTIONAL_QUANTITIES).items()
        if name in given
    }
    return Airframe(
        name=str(table.get("name", Path(where).stem)),
        title=table["title"],
        layout=table["layout"],
        rotor_position_frd=np.array([r["position_frd"] for r in rotors], dtype=np.float64),
        rotor_spin=np.array([1.0 if r["spin"] == "ccw" else -1.0 for r in rotors]),
        rotor_effectiveness=np.array([float(r.get("effectiveness", 1.0)) for r in rotors]),
        rotor_names=tuple(r["name"] for r in rotors),
        quantities=MappingProxyType(quantities),
        tank_source=str(table.get("tank_source", "auto")),
        pump_on=str(table.get("pump_on", "")),
        **{name: quantities[name].value for name in QUANTITIES},
    )


def _raise_problems(problems: list[str], where: str) -> None:
    """Raise AirframeError with all problems, if there are any."""
    if len(problems) == 1:
        raise AirframeError(f"{where}: {problems[0]}")
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        raise AirframeError(f"{where}: {len(problems)} things to correct:{listed}")
