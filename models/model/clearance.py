"""Decide what the flights of an aircraft leave open for its next take-off.

A forecast is made of a plan and a model, and both know nothing of the aircraft as it stands there.
Its last flights do: a rotor that was weak, a battery that collapsed or a control that was lost
forbids the take-off until somebody has looked. What those flights do not show, because a sensor was
left out or the log ends in the air, is a condition of every good answer.

Levels of load (`critical`, `over`, `near`, `under`) are not carried over: the next flight has a
load, a day and a battery of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from thrustmargin.models.model.advice import LEAST_FLIGHT_S, Advice, FlightLevel
from thrustmargin.models.model.airframe_match import KnownFrom
from thrustmargin.models.model.model_misfit import Caveat

#: Levels that forbid the next take-off until somebody has looked at the aircraft.
GROUNDING = (FlightLevel.DAMAGED, FlightLevel.LOST, FlightLevel.BATTERY, FlightLevel.NO_THRUST)
#: Caveats of a flight in which a weak rotor could not have been seen.
BLIND = (
    Caveat.ROTORS_NOT_SOUGHT,
    Caveat.ROTORS_BY_OUTPUTS,
    Caveat.ROTORS_UNLEARNT,
    Caveat.ROTOR_SPEEDS,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condition:
    """A limit on what the last flights can show, which the pilot must check, and its flight."""

    caveat: Caveat
    flight: Advice | None = None  # None: of the flight only its row in a hangar is known


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clearance:
    """Consequence of an aircraft's last flights for its next take-off.

    `level` is the level that forbids it: one of GROUNDING, or UNKNOWN if the last flight supports
    no verdict; None where nothing forbids it. `flight` is the flight with that level.
    """

    level: FlightLevel | None = None
    flight: Advice | None = None
    conditions: tuple[Condition, ...] = ()
    rotors: tuple[int, ...] = ()  # from 1, that `level` is about; empty where unknown
    unrecognised: bool = False  # the flight is not recognised as one of the airframe
    log_name: str = ""  # of a flight of which only its row in a hangar is known
    known_from: KnownFrom | None = None  # the known aircraft whose flights these are

    @property
    def caveats(self) -> tuple[Caveat, ...]:
        """Return the caveats of the conditions, in the order of `Caveat`."""
        return tuple(one.caveat for one in self.conditions)


#: Nothing is known that forbids a take-off, and no flight was assessed: a plan alone.
NO_FLIGHT = Clearance()
#: A log without a flight shows nothing of the aircraft.
NOT_SEEN = Clearance(conditions=(Condition(caveat=Caveat.ROTORS_NOT_SOUGHT),))


def both(of_log: Clearance, of_aircraft: Clearance) -> Clearance:
    """Combine the clearance by the flights in a log with that by the aircraft's earlier flights.

    The graver level counts, of equal ones that of the log; the conditions of both are listed, each
    caveat once.
    """
    first, second = of_log, of_aircraft
    if _gravity(second) < _gravity(first):
        first, second = second, first
    here = first.caveats
    more = tuple(one for one in second.conditions if one.caveat not in here)
    known_from = first.known_from or second.known_from
    return replace(first, conditions=(*first.conditions, *more), known_from=known_from)


def _gravity(one: Clearance) -> float:
    return float("inf") if one.level is None else one.level.gravity


def grounding_level(advice: Advice) -> FlightLevel | None:
    """Return the gravest level of a flight that forbids the next take-off; None without one.

    NO_THRUST forbids it only if one rotor alone was exhausted, which is then faulty. All rotors
    exhausted means too heavy a flight, and the next may be lighter.
    """
    found = [level for level in GROUNDING if level in advice.levels]
    alone = advice.use.spent_alone is not None
    return next((one for one in found if one is not FlightLevel.NO_THRUST or alone), None)


def clearance(flights: Sequence[Advice]) -> Clearance:
    """Return the consequence of one aircraft's flights, oldest first, for its next take-off.

    A faulty part forbids the take-off until a later flight could have shown the fault and did not.
    It is then only a condition, because nobody has stated a repair. A loss of control always
    forbids.
    """
    if not flights:
        return NO_FLIGHT
    last = flights[-1]
    grounded = [(one, level) for one in flights if (level := grounding_level(one)) is not None]
    still = [(one, level) for one, level in grounded if not _shown_sound(one, level, flights)]
    if last.airborne_s < LEAST_FLIGHT_S and FlightLevel.LOST not in last.levels:
        found = list(NOT_SEEN.conditions)
    else:
        found = [Condition(caveat=caveat, flight=last) for caveat in last.caveats]
    repaired = [one for one, _ in grounded if all(one is not other for other, _ in still)]
    found += [Condition(caveat=Caveat.BAD_BEFORE, flight=one) for one in repaired[-1:]]
    conditions = tuple(sorted(found, key=lambda one: list(Caveat).index(one.caveat)))
    if not still:
        unknown = last.no_verdict or Caveat.MODEL in last.caveats
        level = FlightLevel.UNKNOWN if unknown else None
        return Clearance(level=level, flight=last if unknown else None, conditions=conditions)
    flight, level = min(still, key=lambda one: one[1].gravity)
    alone = flight.use.spent_alone
    rotors = {r for e in flight.faults for r in (e.fault.rotors or (e.fault.rotor,))}
    if level is FlightLevel.NO_THRUST and alone is not None:
        rotors = {alone}
    known = sorted(rotors) if flight.rotor_names else ()
    return Clearance(
        level=level,
        flight=flight,
        conditions=conditions,
        rotors=tuple(rotor + 1 for rotor in known),
    )


def _shown_sound(bad: Advice, level: FlightLevel, flights: Sequence[Advice]) -> bool:
    """Return True if a flight after `bad` grounds nothing and could have shown the fault of `bad`.

    `level` is that by which `bad` grounds; False for LOST. A flight with level UNKNOWN or a caveat
    of BLIND (for BATTERY: VOLTAGE) could show nothing. `flights`, by time, contain `bad`.
    """
    if level is FlightLevel.LOST:
        return False
    after = flights[next(k for k, one in enumerate(flights) if one is bad) + 1 :]
    blind = (Caveat.VOLTAGE,) if level is FlightLevel.BATTERY else BLIND
    return any(
        grounding_level(one) is None
        and one.level is not FlightLevel.UNKNOWN
        and not set(blind) & set(one.caveats)
        for one in after
    )
