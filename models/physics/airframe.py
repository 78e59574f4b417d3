"""Read an airframe, the description of one aircraft, from a TOML file.

A file contains tables of quantities `{ value = 21.1, unit = "kg", source = "..." }`, with `guessed
= true` where nobody measured or printed the value. `extends = "other"` takes every value of another
airframe and replaces those given; other is a shipped name, or the path of a .toml file relative to
this one. `tank_source` may name the message that reports the tank level, for example
"BATTERY_STATUS 1"; without it the best source is used. Without `[[rotors]]` they are made from a
known `layout` (`motor_layouts`) and the quantity `arm`. Rotor order is the autopilot's motor order;
positions are `_frd` from the centre of gravity. `spin` is +1 for a rotor that turns
counter-clockwise seen from above, -1 for clockwise.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe_checks import (
    OPTIONAL_QUANTITIES,
    QUANTITIES,
    table_problems,
    with_rotors,
    wrong_kinds,
)
from thrustmargin.models.whole_file import regular


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of the airframe file with its unit and its source."""

    value: float
    unit: str
    source: str
    guessed: bool = False  # nobody measured or printed it; results that depend on it say so


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """One aircraft: masses, tank, rotors in motor order, thrust curve and its ceiling. SI units."""

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
    ceiling_voltage: float  # V at which max_rotor_speed_rpm holds
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
    """Read the table of an airframe, with the values it extends; `children` are the files that
    extend it."""
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
    """Return `base` with the values that `table` replaces.

    Rotors depend on layout and arm: if `table` has a new layout or arm but no rotors, those of
    `base` are dropped.
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
    """Return a quantity as in its file; `guessed` is there only if true."""
    table = {"value": quantity.value, "unit": quantity.unit, "source": quantity.source}
    return table | ({"guessed": True} if quantity.guessed else {})


def airframe_table(airframe: Airframe) -> dict[str, Any]:
    """Return the airframe as the table of its file: plain strings, numbers, lists and tables."""
    return {
        "name": airframe.name,
        "title": airframe.title,
        "layout": airframe.layout,
        "tank_source": airframe.tank_source,
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
        **{name: quantities[name].value for name in QUANTITIES},
    )


def _raise_problems(problems: list[str], where: str) -> None:
    """Raise AirframeError with all problems, if there are any."""
    if len(problems) == 1:
        raise AirframeError(f"{where}: {problems[0]}")
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        raise AirframeError(f"{where}: {len(problems)} things to correct:{listed}")
