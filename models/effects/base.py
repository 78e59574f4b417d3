"""What an effect is: a name, parameters with bounds, the channels it needs, and one pure function.

Apparent thrust of a rotor is a0 N². An effect changes one of four things, in this order:

1. input        what the airspeed or the tank mass really was,
2. demand       the collective thrust that the flight asks for,
3. moments      how the rotors share it,
4. coefficient  the thrust that a rotor makes at a speed, as a factor kappa.

An effect owns all that other rooms ask of it: how its parameters scale with the aircraft, what it
does to the airframe, how far around a row it looks, and the value of each channel at which it does
nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe

Array = Any  # of T rows
Values = Mapping[str, Array]  # parameter name -> number or (T,) array
Look = tuple[float, float]  # s before and s after a row
Neutral = float | Callable[[Values, Any], Array]  # a number, or (p, channels) -> array
#: (track, airframe, state at the first row or None) -> (channel (T, ...), state at the last row)
OwnChannel = Callable[[FlightTrack, Airframe, Any], tuple[Array, Any]]

#: The aircraft for which bounds and sizes of parameters are written down: the F16 (Han et al.
#: 2024), kg empty and m from centre to rotor.
USUAL_MASS, USUAL_ARM = 21.1, 0.9595439
#: Half of the 95 % interval of a torque ratio as a share of it: read off a bench or a data sheet,
#: or worked out with a figure of merit of 0.7 that may be 0.6 or 0.8.
KNOWN_TORQUE, GUESSED_TORQUE = 0.05, 0.15
SAME_SIZE = 0.01  # share by which mass or arm may differ from it and nothing is scaled


class Kind(StrEnum):
    """Which of the four things an effect changes, in their order."""

    INPUT = "input"
    DEMAND = "demand"
    MOMENTS = "moments"
    COEFFICIENT = "coefficient"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightState:
    """What effects carry from row to row, at one row of a flight: by the name of the effect.

    A window of rows that begins there, analysed from this state, gives what the flight in one
    piece gives.
    """

    carried: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One number of an effect: unit, value at which it does nothing, bounds and usual size.

    Values are those of an aircraft of USUAL_MASS and USUAL_ARM.
    """

    name: str
    unit: str
    absent: float | None = 0.0  # where the effect does nothing; None if there is no such value
    start: float = 0.0  # where a fit starts
    lower: float
    upper: float
    scale: float  # usual size: a weak prior and the step of the fit
    #: standard deviation from flight to flight on a sound aircraft that has not shown its own
    smallest: float = 0.0
    per_flight: bool = False  # one value a flight instead of one for all
    detail: bool = False  # shapes the effect but does not make it: may stand at a bound
    resolution: float = 0.0  # half width that no number of rows gets an interval below
    accuracy: float = 0.0  # the same as a share of the value: what the form itself is good for
    of_torque: bool = False  # in proportion to the airframe's torque ratio, which is a guess

    def scaled(self, airframe: Airframe) -> Parameter:
        """The parameter for another aircraft: a quantity goes with the aircraft's own of its unit.

        Mass goes with mass, length with the arm, area with arm², moment of force with weight x arm,
        moment of inertia with mass x arm², moment over turn rate with that over the time scale
        sqrt(arm/g). What has no such unit stays. A yaw moment is as well known as the torque ratio.
        """
        if self.of_torque and "torque_ratio" not in airframe.guessed:
            return replace(self, of_torque=False, accuracy=KNOWN_TORQUE).scaled(airframe)
        mass, arm = airframe.empty_mass / USUAL_MASS, airframe.arm / USUAL_ARM
        if abs(mass - 1.0) < SAME_SIZE and abs(arm - 1.0) < SAME_SIZE:
            return self
        factors = {
            "kg": mass,
            "kg/s": mass,
            "m": arm,
            "m^2": arm**2,
            "N m": mass * arm,
            "kg m^2": mass * arm**2,
            "N m s": mass * arm**1.5,
        }
        if self.unit not in factors:
            return self
        sizes = ("start", "lower", "upper", "scale", "smallest")
        return replace(self, **{k: getattr(self, k) * factors[self.unit] for k in sizes})


def shaping(
    name: str, unit: str, *, start: float, lower: float, upper: float, scale: float
) -> Parameter:
    """A parameter that shapes an effect and has no value at which the effect is absent."""
    return Parameter(
        name=name,
        unit=unit,
        absent=None,
        start=start,
        lower=lower,
        upper=upper,
        scale=scale,
        detail=True,
    )


def instrument_gain(smallest: float) -> Parameter:
    """True over shown of an instrument, which `smallest` is off by from flight to flight."""
    return Parameter(
        name="gain",
        unit="1",
        absent=1.0,
        start=1.0,
        lower=0.5,
        upper=2.0,
        scale=0.1,
        smallest=smallest,
    )


#: How much of the thrust loss the torque shares: 0 when drag stays, as with dirt or ice, about 1
#: for blades that are soft or of less pitch, 1.25 to 1.5 for a tip that is cut or chipped: torque
#: goes with R^5 where thrust goes with R^4, and drag sits at the tip.
TORQUE_SHARE = shaping("torque_share", "1", start=1.0, lower=-1.0, upper=2.0, scale=0.75)


def _at_the_row(p: Values) -> Look:
    return 0.0, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """One physical effect. `apply` takes and returns by kind:

    input        (p, x, airspeed, tank_kg) -> (airspeed, tank_kg), each (T,)
    demand       (p, x, thrust) -> thrust, (T,) N, all rotors together
    moments      (p, x, thrust) -> (roll, pitch, yaw), each (T,) N m
    coefficient  (p, x) -> kappa (T,), of all rotors or, when `of_one_rotor`, of that rotor
    """

    name: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...] = ()  # channels that flights must report for it to be looked for
    #: each channel that rows may lack -> its value in them, at which the effect does nothing
    neutral: Mapping[str, Neutral] = field(default_factory=dict)
    source: str  # where the physics comes from
    apply: Callable[..., Any]
    torque: Callable[..., Any] | None = None  # of a coefficient: torque at a speed, as a factor
    of_one_rotor: bool = False
    variant: str = ""  # names forms of one effect
    one_variant: bool = False  # of these forms an aircraft has one at a time
    delays: bool = False  # its "lag" is how late all rotor speeds are reported
    #: (p, x) -> size of what it changes, 1 being the least worth a name
    weight: Callable[..., Any] | None = None
    begins: bool = False  # a step in time, found by `models.identification.onset`
    gone: bool = False  # its last flight is over: none to come has it
    afterwards: Effect | None = None  # what it is after its step, for flights to come
    #: p -> how far around a row its channels look
    looks: Callable[[Values], Look] = _at_the_row
    own_channel: OwnChannel | None = None  # `Channels.own[name]`, made for this effect alone
    #: (p, airframe, rotor from 0) -> the aircraft as it is with the effect; None: as in its file
    on_airframe: Callable[[Values, Airframe, int | None], Airframe] | None = None
    #: p -> K by which the air is warmer than the standard; an effect with it follows air density
    temperature_offset: Callable[[Values], float] | None = None
    by_flights: bool = False  # seen only in how flights differ: not looked for in one flight
    with_tank: bool = True  # looked for on an aircraft that carries its load in a tank
    of_every_aircraft: bool = False  # physics that a sound one has too: no sign of anything
    #: (itself, what a model has of it, scatter of good flights by "key.parameter") -> what of it
    #: may be another than the model has it; None: nothing. Without this, all of it once more
    change: Callable[[Effect, Sequence[Values], Mapping[str, float]], Effect | None] | None = None
    #: of such a change: p -> values of the effect without variant, as a model keeps it
    kept_as: Callable[[Values], Values] | None = None
    #: (p, channels) -> (T,) true where it was seen: beyond it is held, and nobody knows
    seen: Callable[[Values, Any], Array] | None = None

    @property
    def of_its_flights(self) -> bool:
        """True for what flights to come do not have: values of single flights, or a past loss."""
        return self.gone or any(p.per_flight for p in self.parameters)

    @property
    def key(self) -> str:
        """Name with the variant, unique in the catalogue."""
        return f"{self.name}:{self.variant}" if self.variant else self.name

    def possible_on(self, airframe: Airframe) -> bool:
        """True when the effect is looked for on an aircraft of this kind."""
        return self.with_tank if airframe.tank_capacity_kg > 0.0 else "tank_kg" not in self.needs

    def scaled(self, airframe: Airframe) -> Effect:
        """The effect with its parameters for an aircraft; itself where nothing changes."""
        parameters = tuple(p.scaled(airframe) for p in self.parameters)
        return self if parameters == self.parameters else replace(self, parameters=parameters)


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
