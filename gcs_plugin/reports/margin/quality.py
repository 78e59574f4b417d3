"""Data quality of a log: how whole it is, where each channel came from, what is missing."""

from __future__ import annotations

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import Channel, Quality

#: What a flight without a channel cannot say; channels that nothing depends on are left out.
WITHOUT = {
    "rotor_speed_rpm": "no rotor speeds in this log: all figures are predicted",
    "tank_kg": "no tank level: weight, redundancy and largest fill are unknown",
    "voltage": "no pack voltage: the ceiling is taken at the pack's nominal voltage",
    "airspeed": "no airspeed: the network cannot predict",
    "position_ned": "no position: nothing can be drawn on the map",
    "velocity_ned": "no velocity: ground speed, distance and climb are unknown",
    "spraying": "no pump state: sprayed time, distance and area are unknown",
    "wind_ned": "no wind report",
    "angular_rate_frd": "no angular rate: turns are not named",
    "pressure": "no static pressure",
}


def quality_of(log: FlightLog) -> Quality:
    """The report's data quality from what the reader kept."""
    track, whole = log.track, log.quality
    return Quality(
        format=log.format,
        autopilot=log.autopilot,
        vehicle=log.vehicle,
        vehicles=tuple(log.vehicles),
        bytes=whole.bytes,
        frames=whole.frames,
        bytes_skipped=whole.bytes_skipped,
        damaged_places=whole.damaged_places,
        bad_checksum=whole.bad_checksum,
        unknown_frames=sum(whole.unknown_ids.values()),
        frames_missing=whole.frames_missing,
        clock_jumps=len(whole.clock_jumps),
        silences=len(whole.gaps),
        longest_silence_s=max((float(length) for _, length in whole.gaps), default=0.0),
        channels=tuple(
            Channel(
                name=c.name,
                unit=c.unit,
                source=c.source,
                samples=int(c.samples),
                rate_hz=float(c.rate_hz),
                gaps=int(c.gaps),
                longest_gap_s=float(c.longest_gap_s),
                minimum=float(c.minimum),
                median=float(c.median),
                maximum=float(c.maximum),
            )
            for c in log.channels
        ),
        missing=tuple(text for name, text in WITHOUT.items() if not track.reports(name)),
        notes=tuple(track.notes),
        messages=tuple((float(time_s), str(text)) for time_s, text in log.messages),
    )
