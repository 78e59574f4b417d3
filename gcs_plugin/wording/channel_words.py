"""Channels as people call them, with the unit that they are shown in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

DEGREES = 180.0 / math.pi
#: Channel -> name, unit, and what its numbers are multiplied by for that unit.
CHANNEL_WORDS: Mapping[str, tuple[str, str, float]] = MappingProxyType(
    {
        "airspeed": ("airspeed", "m/s", 1.0),
        "tank_kg": ("tank level", "kg", 1.0),
        "time_s": ("time in the log", "s", 1.0),
        "advance_ratio": ("climb (axial advance ratio)", "", 1.0),
        "radius_over_height": ("rotor radius over height", "", 1.0),
        "voltage": ("battery voltage", "V", 1.0),
        "density": ("air density", "kg/m³", 1.0),
        "heading": ("heading", "°", DEGREES),
        "yaw_rate": ("yaw rate", "°/s", DEGREES),
        "yaw_acceleration": ("yaw acceleration", "°/s²", DEGREES),
        "load_factor": ("load factor", "", 1.0),
    }
)


def channel_name(channel: str) -> str:
    """As people call it; the name itself where there is no other."""
    return CHANNEL_WORDS[channel][0] if channel in CHANNEL_WORDS else channel.replace("_", " ")


def channel_title(channel: str) -> str:
    """The channel with its unit, for an axis."""
    unit = CHANNEL_WORDS[channel][1] if channel in CHANNEL_WORDS else ""
    return f"{channel_name(channel)}{f', {unit}' if unit else ''}"
