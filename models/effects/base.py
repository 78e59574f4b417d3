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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe

Array = Any  # numpy array or torch tensor of T rows
Values = Mapping[str, Array]  # parameter name -> number or (T,) array
Look = tuple[float, float]  # s before and s after a row
#: (track, airframe, state at the first row or None) -> (channel (T, ...), state at the last row)
OwnChannel = Callable[[FlightTrack, Airframe, Any], tuple[Array, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightState:
    """What effects carry from row to row, at one row of a flight: by the name of the effect.

    A window of rows that begins there, analysed from this state, gives what the flight in one
    piece gives.
    """

    carried: Mapping[str, Any] = field(default_factory=dict)


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


def _at_the_row(p: Values) -> Look:  # noqa: ARG001
    return 0.0, 0.0


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
    #: p -> how far around a row its channels look
    looks: Callable[[Values], Look] = _at_the_row
    own_channel: OwnChannel | None = None  # `Channels.own[name]`, made for this effect alone

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


def look_of(placed: Sequence[Placed]) -> Look:
    """How far around a row effects look, s; a late report of rotor speeds moves all of it back."""
    late = sum(float(item.values["lag"]) for item in placed if item.effect.delays)
    looks = [item.effect.looks(item.values) for item in placed]
    back, ahead = (max(side) for side in zip((0.0, 0.0), *looks, strict=True))
    return back + max(late, 0.0), ahead + max(-late, 0.0)
