"""Define an effect: a name, parameters with bounds, the channels it needs, and one pure function.

Apparent thrust of a rotor is a0 N². An effect changes one of four quantities, in this order:

1. input the true airspeed or tank mass, 2. demand the collective thrust that the flight requires,
3. moments how the rotors share it, 4. coefficient the thrust that a rotor makes at a speed, as a
factor kappa.

An effect also defines everything else that other modules need from it: how its parameters scale
with the aircraft, its change of the airframe, its time window around a row, and the neutral value
of each channel, at which it has no influence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe

Array = Any  # (T, ...)
Values = Mapping[str, Array]  # parameter name -> number or (T,) array
Look = tuple[float, float]  # s before and s after a row
Neutral = float | Callable[[Values, Any], Array]  # a number, or (p, channels) -> array
#: (track, airframe, state at the first row or None) -> (channel (T, ...), state at the last row)
OwnChannel = Callable[[FlightTrack, Airframe, Any], tuple[Array, Any]]

#: The aircraft for which bounds and sizes of parameters are defined: the F16 (Han et al.
#: 2024), kg empty and m from centre to rotor.
USUAL_MASS, USUAL_ARM = 21.1, 0.9595439
#: Half of the 95 % interval of a torque ratio as a share of it: read off a bench or a data sheet,
#: or worked out with a figure of merit of 0.7 that may be 0.6 or 0.8.
KNOWN_TORQUE, GUESSED_TORQUE = 0.05, 0.15
#: least factor of a loss on the thrust and torque of a rotor
KAPPA_FLOOR = 0.05
SAME_SIZE = 0.01  # share by which mass or arm may differ from it and nothing is scaled


class Kind(StrEnum):
    """The quantity that an effect changes; effects are applied in this order."""

    INPUT = "input"
    DEMAND = "demand"
    MOMENTS = "moments"
    COEFFICIENT = "coefficient"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightState:
    """State of the effects at a row of a flight, by the name of the effect.

    A window of rows that begins there, analysed from this state, gives the results of the whole
    flight.
    """

    carried: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A number of an effect: unit, value at which it has no influence, bounds and usual size.

    Values are those of an aircraft of USUAL_MASS and USUAL_ARM.
    """

    name: str
    unit: str
    absent: float | None = 0.0  # where the effect does nothing; None if there is no such value
    start: float = 0.0  # where a fit starts
    lower: float
    upper: float
    scale: float  # usual size: a weak prior and the step of the fit
    #: standard deviation between flights of a sound aircraft, as a prior
    smallest: float = 0.0
    per_flight: bool = False  # one value a flight instead of one for all
    detail: bool = False  # of the effect's form, not its size: may be at a bound
    resolution: float = 0.0  # least half width of an interval, however many rows
    accuracy: float = 0.0  # likewise, as a share of the value: accuracy of the model form
    of_torque: bool = False  # proportional to the airframe's torque ratio, which may be a guess

    def scaled(self, airframe: Airframe) -> Parameter:
        """Return the parameter scaled to another aircraft, by the dimension of its unit.

        Mass scales with mass, length with the arm, area with arm², moment of force with weight x
        arm, moment of inertia with mass x arm², moment over turn rate with that over the time scale
        sqrt(arm/g). Other units do not scale. The accuracy of a yaw moment is that of the torque
        ratio.
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
    """Return a parameter of an effect's shape, which has no value at which the effect is absent."""
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
    """Return the parameter `gain` of an instrument: true over reported value, 1 if absent.

    `smallest` is its standard deviation between flights.
    """
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
    """Return a time window of zero length."""
    return 0.0, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """A physical effect. `apply` takes and returns by kind:

    input        (p, x, airspeed, tank_kg) -> (airspeed, tank_kg), each (T,)
    demand       (p, x, thrust) -> thrust, (T,) N, all rotors together
    moments      (p, x, thrust) -> (roll, pitch, yaw), each (T,) N m
    coefficient  (p, x) -> kappa (T,), of all rotors or, when `of_one_rotor`, of that rotor
    """

    name: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...] = ()  # channels that flights must report for a search
    #: channel that rows may lack -> its neutral value, at which the effect has no influence
    neutral: Mapping[str, Neutral] = field(default_factory=dict)
    source: str  # where the physics comes from
    apply: Callable[..., Any]
    torque: Callable[..., Any] | None = (
        None  # of a coefficient effect: factor of the torque at a speed
    )
    of_one_rotor: bool = False
    variant: str = ""  # names forms of one effect
    one_variant: bool = False  # an aircraft has at most one of the variants
    delays: bool = False  # its "lag" is how late all rotor speeds are reported
    #: (p, x) -> size of its influence, 1 being the least that is reported
    weight: Callable[..., Any] | None = None
    begins: bool = False  # a step in time, found by `models.identification.onset`
    gone: bool = False  # ended in the past: later flights do not have it
    afterwards: Effect | None = None  # the effect of later flights, after its step
    #: p -> s before and after a row that its channels depend on
    looks: Callable[[Values], Look] = _at_the_row
    own_channel: OwnChannel | None = None  # `Channels.own[name]`, made for this effect alone
    #: (p, airframe, rotor from 0) -> airframe with the effect; None: unchanged
    on_airframe: Callable[[Values, Airframe, int | None], Airframe] | None = None
    #: p -> K by which the air is warmer than the standard; an effect with it follows air density
    temperature_offset: Callable[[Values], float] | None = None
    by_flights: bool = False  # shows only between flights: not searched for in one flight
    with_tank: bool = True  # searched for on an aircraft with a tank
    of_every_aircraft: bool = False  # sound aircraft have it too: not a fault
    #: (itself, its values in a model, scatter of good flights by "key.parameter") -> the effect
    #: that describes its change since the model; None: no change is possible. If the field is None,
    #: the whole effect is added once more
    change: Callable[[Effect, Sequence[Values], Mapping[str, float]], Effect | None] | None = None
    #: of such a change: p -> values of the effect without variant, for a model file
    kept_as: Callable[[Values], Values] | None = None
    #: (p, channels) -> (T,) true inside the range in which it was identified; held beyond
    seen: Callable[[Values, Any], Array] | None = None

    @property
    def of_its_flights(self) -> bool:
        """Return True if later flights do not have the effect: values of single flights, or a
        past loss."""
        return self.gone or any(p.per_flight for p in self.parameters)

    @property
    def of_one_arm(self) -> bool:
        """Return whether it is the variant of an effect on one arm, which leaves the rotor's own
        thrust as it is."""
        return self.of_one_rotor and self.one_variant

    @property
    def key(self) -> str:
        """Return "name:variant", or the name without a variant; unique in the catalogue."""
        return f"{self.name}:{self.variant}" if self.variant else self.name

    def possible_on(self, airframe: Airframe) -> bool:
        """Return True if the effect is searched for on an aircraft of this kind."""
        return self.with_tank if airframe.tank_capacity_kg > 0.0 else "tank_kg" not in self.needs

    def scaled(self, airframe: Airframe) -> Effect:
        """Return the effect with parameters scaled to an aircraft; the same object where none
        changes."""
        parameters = tuple(p.scaled(airframe) for p in self.parameters)
        return self if parameters == self.parameters else replace(self, parameters=parameters)


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """An effect with its values, on one rotor (0-based) if it acts on one."""

    effect: Effect
    values: Values
    rotor: int | None = None


def look_of(placed: Sequence[Placed]) -> Look:
    """Return the s before and after a row that effects depend on; late reports of rotor speeds
    shift the window back."""
    late = sum(float(item.values["lag"]) for item in placed if item.effect.delays)
    looks = [item.effect.looks(item.values) for item in placed]
    past, future = (max(side) for side in zip((0.0, 0.0), *looks, strict=True))
    return past + max(late, 0.0), future + max(-late, 0.0)
