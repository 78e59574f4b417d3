"""Define the facts that a vehicle reports on itself, with their evidence: kind, number of
rotors, battery."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from thrustmargin.models.provenance import NOT_REPORTED, Provenance

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


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedBattery:
    """The facts that a battery in use reports on itself; 0 where it does not."""

    cells: int = 0  # in series, of lithium polymer or ion
    nominal_voltage: float = 0.0  # V
    capacity_mah: float = 0.0
    source: Provenance = NOT_REPORTED

    @property
    def words(self) -> str:
        """Return the facts for people, as "14 cells, 51.8 V, 16000 mAh by BATTERY_INFO
        cells_in_series of id 0"."""
        facts = (
            (self.cells, f"{self.cells} cells"),
            (self.nominal_voltage, f"{self.nominal_voltage:.4g} V"),
            (self.capacity_mah, f"{self.capacity_mah:.0f} mAh"),
        )
        return f"{', '.join(words for number, words in facts if number)} by {self.source.words}"


def can_be_cells(cells: int, volts: float) -> bool:
    """Return whether a battery of `cells` cells can have this voltage; True where it is unknown."""
    return not (volts < CELL_IN_USE[0] * cells or volts > CELL_IN_USE[1] * cells)


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFacts:
    """The kind of vehicle and its number of lifting rotors, with evidence in words, as
    "FRAME_CLASS 1"."""

    kind: VehicleKind = "unknown"
    evidence: str = ""  # for the kind
    rotor_count: int = 0  # 0: not reported
    rotor_evidence: str = ""  # for the number of rotors
    rotor_conflict: str = ""  # a contradicting number and its source, as "6 by MAV_TYPE 13"
    battery: StatedBattery = field(default_factory=StatedBattery)

    @property
    def has_lifting_rotors(self) -> bool:
        """Return False for a vehicle known to be no multirotor; an unknown kind may be one."""
        return self.kind in ("multirotor", "quadplane", "unknown")

    def refusal(self, name: str) -> str:
        """Return why vehicle `name` cannot have a thrust margin, in words; empty if it can."""
        article = "an" if self.kind[0] in "aeiou" else "a"
        is_a = f"{name}: this is {article} {self.kind} (by {self.evidence})"
        if not self.has_lifting_rotors:
            return f"{is_a}, and thrustmargin is for multirotors"
        if self.kind == "quadplane" and not self.rotor_count:
            return f"{is_a}, and nothing says which outputs are its hover motors (SERVOn_FUNCTION)"
        return ""

    @property
    def words(self) -> str:
        """Return kind and number of rotors with their evidence, for people."""
        kind = (
            f"{self.kind} by {self.evidence}" if self.evidence else "kind of vehicle: not reported"
        )
        if not self.has_lifting_rotors:
            return kind
        rotors = f"{self.rotor_count} rotors by {self.rotor_evidence}"
        if self.rotor_conflict:
            rotors += f", but {self.rotor_conflict}"
        battery = f"; battery of {self.battery.words}" if self.battery.source.name else ""
        return f"{kind}; {rotors if self.rotor_count else 'rotors: not reported'}{battery}"
