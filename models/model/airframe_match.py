"""Decide whether a flight may be analysed as one of an airframe: given, recognised or unknown.

Without such grounds no margin is claimed. The flight is then analysed with a model of an unknown
aircraft, so that no number of a wrong airframe can reach a screen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from math import cos, isfinite, nan, pi, sin
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from thrustmargin.models.checks.output_evidence import OutputEvidence, output_evidence
from thrustmargin.models.checks.plausible import comparisons, recognition
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import QUANTITIES, Airframe, Quantity
from thrustmargin.models.physics.atmosphere import SEA_LEVEL_DENSITY
from thrustmargin.models.physics.motor_layouts import motor_layouts
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import VehicleFacts

#: m, propeller diameter of an unknown aircraft, for drawing
DRAWN_PROPELLER = 0.9
USUAL_LAYOUTS = {4: "quad-x", 6: "hexa-x", 8: "octo-x"}
#: Quantities that widen the interval of a margin if guessed.
RESTS_ON = ("empty_mass", "thrust_coefficient", "max_rotor_speed_rpm", "ceiling_voltage")
AirframeBasis = Literal["given", "recognised", "not known"]


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownFrom:
    """A known aircraft recognised in a flight, and the flights and days its model is based on."""

    aircraft: str
    flights: int
    days: int
    last_log: str = ""  # of its last flight that has a verdict; empty without one
    last_unix_s: float = nan  # start of that flight

    @property
    def last_flight(self) -> str:
        """Return the start of the last flight as ISO 8601, UTC; empty without one."""
        if not isfinite(self.last_unix_s):
            return ""
        return datetime.fromtimestamp(self.last_unix_s, UTC).isoformat(timespec="seconds")

    def to_json(self) -> dict[str, Any]:
        """Return `aircraft`, `flights`, `days`, and of the last flight `last_log` and
        `last_flight`."""
        return {
            "aircraft": self.aircraft,
            "flights": self.flights,
            "days": self.days,
            "last_log": self.last_log or None,
            "last_flight": self.last_flight or None,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeMatch:
    """The grounds on which a flight is analysed with an airframe, or the reasons why it is not."""

    basis: AirframeBasis = "given"
    airframe: str = ""  # its name; empty of a flight that is only calculated
    known_from: KnownFrom | None = None  # if the aircraft is a known one
    guessed: tuple[str, ...] = ()  # quantities of `RESTS_ON` that the airframe file guesses
    recognised_by: tuple[Statement, ...] = ()  # what matches it, if nobody gave it
    no_verdict: tuple[
        Statement, ...
    ] = ()  # why no margin is reported; empty if nothing contradicts
    contradicted: tuple[str, ...] = ()  # names of the comparisons that contradict a given airframe
    unlike: Statement | None = None  # why the flight is not recognised, if no airframe was given
    source: str = "LOG"  # log or link of the flight, as a shell takes it
    #: Contradictions found later in a flight that was accepted before: findings.
    misfit: tuple[Statement, ...] = ()
    other_order: bool = False  # its motors are not in the airframe's order
    #: Pairs of rotors, from 0, that the flight's manoeuvres cannot distinguish.
    open_pairs: tuple[tuple[int, int], ...] = ()
    outputs: OutputEvidence | None = None  # thrust by motor outputs, independent of the gauge

    def __str__(self) -> str:
        """Return the airframe and how it was recognised, or the reasons for no margin; for
        debugging.

        Empty without either.
        """
        if self.no_verdict:
            return f"no margin: {'; '.join(map(str, self.no_verdict))}"
        return f"{self.airframe} {self.basis}" if self.airframe else ""

    @property
    def odd_voltage(self) -> bool:
        """Return True if only the voltage contradicts the airframe."""
        return self.contradicted == ("voltage",)


def match_airframe(
    track: FlightTrack,
    airframe: Airframe,
    facts: VehicleFacts,
    parameters: Mapping[str, float],
    *,
    given: bool,
) -> AirframeMatch:
    """Decide whether a flight may be analysed with `airframe`; return the decision with its
    reasons.

    With `given` (the user stated the airframe) it is accepted unless a comparison contradicts it;
    otherwise only if the flight is recognised as this airframe's. `facts` are what the vehicle
    reports of itself, `parameters` the autopilot's, by name. `no_verdict` of the result lists why
    it was not accepted; empty if it was.
    """
    found = comparisons(track, airframe, facts, parameters)
    outputs = output_evidence(track, airframe, parameters)
    against = [c for c in found if c.verdict == "contradicts"]
    guessed = tuple(name for name in RESTS_ON if name in airframe.guessed)
    if given:
        return AirframeMatch(
            airframe=airframe.name,
            guessed=guessed,
            no_verdict=tuple(c.found for c in against),
            contradicted=tuple(c.check for c in against),
            source=track.name,
            outputs=outputs,
        )
    if by := recognition(found):
        return AirframeMatch(
            basis="recognised",
            airframe=airframe.name,
            guessed=guessed,
            recognised_by=by,
            outputs=outputs,
        )
    unlike = [c for c in found if c.verdict != "close" and c.check != "frame"]
    first = (*against, *unlike)[:1]
    return AirframeMatch(
        basis="not known",
        no_verdict=(state("no airframe given"),),
        unlike=state(
            "not recognised",
            airframe=airframe.name,
            why=first[0].found if first else state("too little to compare"),
        ),
        source=track.name,
    )


@lru_cache(maxsize=16)
def unknown_aircraft(rotor_count: int) -> RotorModel:
    """Return a model of an aircraft of which only the number of rotors is known.

    Its quantities and predictions are NaN. For drawing alone its rotors are on arms of 1 m, in the
    autopilots' usual layout for that number, else evenly round.
    """
    layout = motor_layouts().get(USUAL_LAYOUTS.get(rotor_count, ""))
    angles = [2.0 * pi * (k + 0.5) / rotor_count for k in range(rotor_count)]
    places = np.array([(cos(a), sin(a)) for a in angles]) if layout is None else layout.place
    unknown: dict[str, Any] = dict.fromkeys(QUANTITIES, nan)
    unknown["propeller_diameter"] = DRAWN_PROPELLER
    airframe = Airframe(
        name="not known",
        title="aircraft not known",
        layout="not known",
        rotor_position_frd=np.pad(places.reshape(rotor_count, 2), ((0, 0), (0, 1))),
        rotor_spin=np.ones(rotor_count) if layout is None else layout.spin,
        rotor_effectiveness=np.ones(rotor_count),
        rotor_names=tuple(f"motor {k + 1}" for k in range(rotor_count)),
        quantities=MappingProxyType(
            {name: Quantity(nan, unit, "not known") for name, unit in QUANTITIES.items()}
        ),
        **unknown,
    )
    return RotorModel(airframe=airframe, reference_density=SEA_LEVEL_DENSITY, reference_voltage=nan)
