"""What an effect is: a name, parameters with bounds, the channels it needs, and one pure function.

Apparent thrust of a rotor is a0 N². An effect changes one of four things, in this order:

1. input        what the airspeed or the tank mass really was,
2. demand       the collective thrust that the flight asks for,
3. moments      how the rotors share it,
4. coefficient  the thrust that a rotor makes at a speed, as a factor kappa.

The functions are written with operators and the array namespace that they are given, so the same
code runs on numpy arrays (prediction) and on torch tensors (derivatives by torch.func).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

Array = Any  # numpy array or torch tensor of T rows
Values = Mapping[str, Array]  # parameter name -> number or (T,) array


class Kind(StrEnum):
    """Which of the four things an effect changes."""

    INPUT = "input"
    DEMAND = "demand"
    MOMENTS = "moments"
    COEFFICIENT = "coefficient"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One number of an effect: unit, value at which it does nothing, bounds and usual size."""

    name: str
    unit: str
    absent: float | None  # the value at which the effect does nothing; None if there is none
    start: float  # where a fit starts
    lower: float
    upper: float
    scale: float  # usual size: a weak prior and the step of the fit
    smallest: float = 0.0  # least distance from `absent` that is worth reporting
    per_flight: bool = False  # one value a flight instead of one for all
    detail: bool = False  # shapes the effect but does not make it: may stand at a bound
    resolution: float = 0.0  # half width that no number of rows gets an interval below
    accuracy: float = 0.0  # the same as a share of the value: what the form itself is good for


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """One physical effect. `apply` takes and returns by kind:

    input        (p, x, airspeed, tank_kg, xp) -> (airspeed, tank_kg), each (T,)
    demand       (p, x, thrust, xp) -> thrust, (T,) N, all rotors together
    moments      (p, x, thrust, xp) -> (roll, pitch, yaw), each (T,) N m
    coefficient  (p, x, xp) -> kappa (T,), of all rotors or, when `of_one_rotor`, of that rotor
    """

    name: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...]  # fields of Channels that must be reported
    shape_channels: tuple[str, ...]  # channels along which the effect has its form
    source: str  # where the physics comes from
    tell: str  # the flight that would tell it from its look-alikes
    apply: Callable[..., Any]
    torque: Callable[..., Any] | None = None  # of a coefficient: torque at a speed, as a factor
    of_one_rotor: bool = False
    variant: str = ""  # tells forms of one effect apart
    affine: bool = False  # at its start it already differs from doing nothing
    delays: bool = False  # its "lag" is how late all rotor speeds are reported
    #: (p, x, xp) -> size of what it changes, 1 being the least worth a name
    weight: Callable[..., Any] | None = None
    begins: bool = False  # a step in time, found by `models.identification.onset`
    seeds: tuple[Mapping[str, float], ...] = ()  # other starts of a fit that has several valleys

    @property
    def key(self) -> str:
        """Name with the variant, unique in the catalogue."""
        return f"{self.name}:{self.variant}" if self.variant else self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """An effect with its values, on one rotor (0-based) where it is of one."""

    effect: Effect
    values: Values
    rotor: int | None = None
