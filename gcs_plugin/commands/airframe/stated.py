"""What the owner of an aircraft states on the command line, and its quantities."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.options import UsageError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe
    from thrustmargin.models.physics.airframe import Quantity

#: A power set that does not ship: its propeller and thrust are stated.
OTHER = "other"
#: option -> quantity, unit of the file, and what the stated number is multiplied by.
_NUMBERS = {
    "mass": ("empty_mass", "kg", 1.0),
    "max_takeoff_kg": ("max_takeoff_mass", "kg", 1.0),
    "arm": ("arm", "m", 1.0),
    "wheelbase": ("arm", "m", 0.5),
    "max_thrust_kgf": ("nameplate_max_thrust", "N", 9.80665),
    "max_speed_rpm": ("max_rotor_speed_rpm", "rpm", 1.0),
    "tank_litres": ("tank_volume_l", "L", 1.0),
    "liquid_density": ("liquid_density", "kg/L", 1.0),
    "pump_litres_min": ("pump_max_flow_l_min", "L/min", 1.0),
    "cells": ("nominal_voltage", "V", 3.7),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnerStatement:
    """What the owner of an aircraft says of it; None is left open."""

    name: str | None = None
    """Short name of the aircraft; without it the name of the file."""
    title: str | None = None
    """What the aircraft is, in a line."""
    mass: float | None = None
    """kg, ready to fly with its battery and without liquid."""
    max_takeoff_kg: float | None = None
    """kg, the maker's largest mass in flight, liquid included; no fill is recommended beyond it."""
    arm: float | None = None
    """m from the centre to a motor."""
    wheelbase: float | None = None
    """m from motor to motor across the centre, instead of --arm."""
    power_set: str | None = None
    """Motor and propeller by a name of `thrustmargin airframe list`, or other."""
    propeller: str | None = None
    """Propeller diameter x pitch in inches, such as 24x8."""
    max_thrust_kgf: float | None = None
    """kgf of one rotor at full throttle, by the maker's data sheet."""
    max_speed_rpm: float | None = None
    """rpm of the rotor at that thrust, by the maker's data sheet."""
    tank_litres: float | None = None
    """L of the full tank; 0 when it carries no liquid."""
    liquid_density: float | None = None
    """kg/L; without it water."""
    pump_litres_min: float | None = None
    """L/min, largest flow of the pump."""
    cells: int | None = None
    """Battery cells in series, when the vehicle does not say."""
    layout: str | None = None
    """Layout of the motors, such as hexa-x, when the vehicle does not say or says it wrongly."""


def stated(owner: OwnerStatement, reported: ReportedAirframe) -> dict[str, Quantity]:
    """Quantities of the power set, over them the vehicle's, over them what the owner states.

    Raises UsageError for a number or propeller that cannot be one, or a power set not known.
    """
    from thrustmargin.models.physics.airframe import Quantity
    from thrustmargin.models.physics.airframe_draft import INCH, power_sets

    quantities: dict[str, Quantity] = {}
    if owner.power_set not in (None, OTHER):
        if owner.power_set not in power_sets():
            raise UsageError(
                f"no power set {owner.power_set!r}; known are {', '.join(power_sets())}; for "
                "another give --propeller and --max-thrust-kgf"
            )
        chosen = power_sets()[owner.power_set]
        quantities |= {
            name: replace(q, source=f"{chosen.name}: {q.source}")
            for name, q in chosen.quantities.items()
        }
    if owner.propeller is not None:
        sizes = re.fullmatch(r"\s*([\d.]+)\s*[xX*]\s*([\d.]+)\s*", owner.propeller)
        if sizes is None:
            raise UsageError(f"--propeller {owner.propeller!r}; write it in inches, as in 24x8")
        quantities.pop("thrust_coefficient", None)  # it is that of the set's own propeller
        source = f"stated: propeller {owner.propeller} in"
        for name, size in (("propeller_diameter", sizes[1]), ("propeller_pitch", sizes[2])):
            quantities[name] = Quantity(round(float(size) * INCH, 5), "m", source)
    if owner.propeller is not None or owner.max_thrust_kgf is not None:
        quantities.pop("max_rotor_speed_rpm", None)  # another thrust is reached at another speed
    quantities |= reported.quantities
    check_numbers(owner)  # those that were asked for
    for option, (name, unit, factor) in _NUMBERS.items():
        value = getattr(owner, option)
        if value is not None:
            words = f"stated: {_flag(option)} {value:g}"
            quantities[name] = Quantity(round(value * factor, 5), unit, words)
    return quantities


def check_numbers(owner: OwnerStatement) -> None:
    """Raise UsageError for a number that no aircraft has."""
    for option in _NUMBERS:
        value = getattr(owner, option)
        if value is None:
            continue
        if not isfinite(value) or value < 0 or (value == 0 and option != "tank_litres"):
            raise UsageError(f"{_flag(option)} {value:g} is not a number above 0")


def _flag(option: str) -> str:
    return "--" + option.replace("_", "-")
