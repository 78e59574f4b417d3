"""What a vehicle says it is: its kind, its number of rotors, and the evidence for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
class VehicleFacts:
    """Kind and number of rotors that lift it; evidence in words, as "FRAME_CLASS 1"."""

    kind: VehicleKind = "unknown"
    evidence: str = ""  # for the kind
    rotor_count: int = 0  # 0: not reported
    rotor_evidence: str = ""  # for the number of rotors

    @property
    def has_lifting_rotors(self) -> bool:
        """False where it is known to be no multirotor; an unknown kind may be one."""
        return self.kind in ("multirotor", "quadplane", "unknown")

    def refusal(self, name: str) -> str:
        """Why no thrust margin can be had of the vehicle `name`, in words; empty for none."""
        article = "an" if self.kind[0] in "aeiou" else "a"
        is_a = f"{name}: this is {article} {self.kind} (by {self.evidence})"
        if not self.has_lifting_rotors:
            return f"{is_a}, and thrustmargin is for multirotors"
        if self.kind == "quadplane" and not self.rotor_count:
            return f"{is_a}, and nothing says which outputs are its hover motors (SERVOn_FUNCTION)"
        return ""

    @property
    def words(self) -> str:
        """Kind and number of rotors with their evidence, for people."""
        kind = (
            f"{self.kind} by {self.evidence}" if self.evidence else "kind of vehicle: not reported"
        )
        if not self.has_lifting_rotors:
            return kind
        if not self.rotor_count:
            return f"{kind}; rotors: not reported"
        return f"{kind}; {self.rotor_count} rotors by {self.rotor_evidence}"
