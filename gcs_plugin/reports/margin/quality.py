"""Data quality of a log: how whole it is, where each channel came from, what is missing."""

from __future__ import annotations

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject

#: What a flight without a channel cannot say; channels that nothing depends on are left out.
WITHOUT = {
    "rotor_speed_rpm": "no rotor speeds in this log: all figures are predicted",
    "tank_kg": "no tank level: weight, redundancy and largest fill are unknown",
    "voltage": "no battery voltage: the rotors' maximum is taken at the nominal voltage",
    "airspeed": "no airspeed: the network cannot predict",
    "position_ned": "no position: nothing can be drawn on the map",
    "velocity_ned": "no velocity: ground speed, distance and climb are unknown",
    "spraying": "no pump state: sprayed time, distance and area are unknown",
    "wind_ned": "no wind report",
    "angular_rate_frd": "no angular rate: turns are not named",
    "pressure": "no static pressure",
}


def quality_of(log: FlightLog) -> JsonObject:
    """How whole the log is, and what had to be assumed; a silence is over 1 s without a message."""
    track, whole = log.track, log.quality
    counted = ("bytes", "frames", "bytes_skipped", "damaged_places", "bad_checksum")
    return {
        **{name: getattr(log, name) for name in ("format", "autopilot", "vehicle", "vehicles")},
        **{name: getattr(whole, name) for name in counted},
        "unknown_frames": sum(whole.unknown_ids.values()),
        "frames_missing": whole.frames_missing,
        "clock_jumps": len(whole.clock_jumps),
        "silences": len(whole.gaps),
        "longest_silence_s": max((float(length) for _, length in whole.gaps), default=0.0),
        "channels": log.channels,
        "missing": tuple(text for name, text in WITHOUT.items() if not track.reports(name)),
        "notes": track.notes,
        "messages": log.messages,
    }
