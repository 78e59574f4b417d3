"""Whether an aircraft flew at all, and by what that is known, in words."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from thrustmargin.models.flight import FlightTrack, FlyingBy

#: Why no row of a log is in flight.
GROUNDED_BY: Mapping[FlyingBy, str] = MappingProxyType(
    {
        FlyingBy.DISARMED: "the vehicle says that it was disarmed throughout",
        FlyingBy.IDLE_OUTPUTS: "its motor outputs never rose above idle",
        FlyingBy.CONSTANT_OUTPUTS: "its motor outputs never changed",
        FlyingBy.SLOW_ROTORS: "its rotors never carried half of the empty weight",
        FlyingBy.NEVER_ROSE: "it was armed and never rose from where it stood",
        FlyingBy.NOT_KNOWN: "neither landed state, rotor speeds, motor outputs nor height is in it",
        FlyingBy.LANDED_STATE: "by its own landed state",
        FlyingBy.HEIGHT: "it was never more than 1 m above home",
        FlyingBy.ROTOR_SPEEDS: "by its rotor speeds",
        FlyingBy.MOTOR_OUTPUTS: "by its motor outputs",
        FlyingBy.GIVEN: "as the table says",
    }
)


def not_flown(track: FlightTrack) -> str:
    """Why a log without a row in flight has none; empty where one flies."""
    if track.flying.any():
        return ""
    why = GROUNDED_BY[track.flying_by]
    if track.flying_by is FlyingBy.NOT_KNOWN:
        return f"whether it flew is not known: {why}"
    return f"by this log it never left the ground: {why}"
