"""Define the facts that a vehicle reports on itself, with their evidence: kind, number of
rotors, battery."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from thrustmargin.models.provenance import NOT_REPORTED, Provenance
from thrustmargin.models.statement import Statement, state

#: V of one lithium cell in use: from a worn one, or of 3.6 V, to 4.35 V full on a gauge 3 % off.
CELL_IN_USE = (2.9, 4.5)

VehicleKind = Literal[
    "multirotor",
    "quadplane",  # lifted by rotors in hover, by wings in forward flight
    "plane",
    "helicopter",
    "rover",
    "boat",
    "submarine",
    "airship",
    "antenna tracker",
    "other vehicle",
    "unknown",
]


#: A name, as "FRAME_CLASS 1", or a statement; empty for none.
Evidence = str | Statement


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedBattery:
    """The facts that a battery in use reports on itself; 0 where it does not."""

    cells: int = 0  # in series, of lithium polymer or ion
    nominal_voltage: float = 0.0  # V
    capacity_mah: float = 0.0
    source: Provenance = NOT_REPORTED

    @property
    def statement(self) -> Statement:
        """Return the known cells, voltage and capacity as `14 cells, 51.8 V, 16000 mAh by
        BATTERY_INFO`."""
        numbers = {
            "battery cells": self.cells,
            "battery voltage": self.nominal_voltage,
            "battery capacity": self.capacity_mah,
        }
        known = tuple(state(kind, number=number) for kind, number in numbers.items() if number)
        return state("battery", known=known, source=self.source)


def can_be_cells(cells: int, volts: float) -> bool:
    """Return True if a battery of `cells` cells can have this voltage; True where it is unknown."""
    return not (volts < CELL_IN_USE[0] * cells or volts > CELL_IN_USE[1] * cells)


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFacts:
    """The kind of vehicle and its number of lifting rotors, with evidence, as
    "FRAME_CLASS 1"."""

    kind: VehicleKind = "unknown"
    evidence: Evidence = ""  # for the kind
    rotor_count: int = 0  # 0: not reported
    rotor_evidence: Evidence = ""  # for the number of rotors
    rotor_conflict: Evidence = ""  # a contradicting number and its source, 6 by MAV_TYPE 13
    battery: StatedBattery = field(default_factory=StatedBattery)

    @property
    def has_lifting_rotors(self) -> bool:
        """Return False for a vehicle known to be no multirotor; an unknown kind may be one."""
        return self.kind in ("multirotor", "quadplane", "unknown")

    def refusal(self, name: str) -> Statement | None:
        """State why no thrust margin can be computed for vehicle `name`; None if it can.

        The reasons: it has no lifting rotors, or a quadplane does not report its hover motors.
        """
        if not self.has_lifting_rotors:
            clause = "for multirotors"
        elif self.kind == "quadplane" and not self.rotor_count:
            clause = "hover motors not known"
        else:
            return None
        article = "an" if self.kind[0] in "aeiou" else "a"
        kind = f"{article} {self.kind}"
        return state("vehicle is", clause, name=name, vehicle=kind, evidence=self.evidence)

    @property
    def statement(self) -> Statement:
        """Return the kind of vehicle with its evidence, and the number of rotors with its own, or
        that none is reported.

        The battery is added if reported. A vehicle without lifting rotors has its kind alone.
        """
        kind = "vehicle by" if self.evidence else "vehicle not reported"
        if not self.has_lifting_rotors:
            return state(kind, vehicle=self.kind, evidence=self.evidence)
        rotors = "of rotors" if self.rotor_count else "no rotors reported"
        return state(
            kind,
            rotors,
            *(("of battery",) if self.battery.source.name else ()),
            vehicle=self.kind,
            evidence=self.evidence,
            rotors=rotors_reported(self),
            battery=self.battery.statement,
        )


def rotors_reported(facts: VehicleFacts) -> Statement:
    """Return the number of rotors that a vehicle reports, its evidence, and what contradicts it."""
    return state(
        "rotors by",
        *(("but",) if facts.rotor_conflict else ()),
        count=facts.rotor_count,
        evidence=facts.rotor_evidence,
        conflict=facts.rotor_conflict,
    )
