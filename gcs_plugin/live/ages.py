"""What a vehicle once reported and no longer does: each field with its age.

A value older than its limit (telemetry/resample) is used for nothing; these are the words by
which people are told that it is missing, and for how long.
"""

from __future__ import annotations

import math

from thrustmargin.gcs_plugin.live.tank import TankReading
from thrustmargin.gcs_plugin.live.vehicle_state import VehicleState
from thrustmargin.models.flight import TRACK_CHANNELS

#: field for people -> its channels in a VehicleState, any of which will do, and the limit's name
FIELDS: dict[str, tuple[tuple[str, ...], str]] = {
    "attitude": (("attitude",), "attitude"),
    "position": (("geodetic", "position_ned"), "position_ned"),
    "speed over ground": (("velocity_ned",), "velocity_ned"),
    "height": (("height_agl",), "height_agl"),
    "airspeed": (("airspeed",), "airspeed"),
    "wind": (("wind_ned",), "wind_ned"),
    "pack voltage": (("battery_voltage", "voltage", "esc_voltage"), "voltage"),
    "air pressure": (("pressure",), "pressure"),
    "motor outputs": (("servo_us",), "throttle"),
}


def stale(state: VehicleState, tank: TankReading | None, now_us: int) -> dict[str, float]:
    """Field -> s since it was last known, of those that have been known and are too old to be used.

    `now_us` is the ground's clock. `tank` is the last tank reading, which has an age of its own.
    """
    now = state.now(now_us)
    newest: dict[str, float] = {}
    for (channel, _, _), reading in state.readings.items():
        newest[channel] = max(reading.clock_s, newest.get(channel, -math.inf))
    ages: dict[str, float] = {}
    for words, (channels, limit) in FIELDS.items():
        known = [newest[channel] for channel in channels if channel in newest]
        if known and now - max(known) > TRACK_CHANNELS[limit].max_age:
            ages[words] = now - max(known)
    if tank is not None and now - tank.clock_s > TRACK_CHANNELS["tank_kg"].max_age:
        ages["tank level"] = now - tank.clock_s
    return ages


def stale_words(ages: dict[str, float]) -> str:
    """One sentence, longest missing first; empty when all is fresh."""
    if not ages:
        return ""
    parts = [f"{words} ({age:.0f} s)" for words, age in sorted(ages.items(), key=lambda a: -a[1])]
    return "no longer reported: " + ", ".join(parts)
