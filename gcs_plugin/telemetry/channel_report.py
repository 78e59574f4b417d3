"""How complete each channel of a flight is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.recording import ChannelReport, FlightLog
from thrustmargin.gcs_plugin.telemetry.resample import known_rows
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack

_ABSENT = "not in the log"


def with_track(log: FlightLog, track: FlightTrack) -> FlightLog:
    """The log with this track; channels that were filled since are reported as it has them."""
    channels = []
    for report in log.channels:
        values, source = getattr(track, report.name), track.sources.get(report.name, "")
        if report.samples == 0 and np.any(np.isfinite(values)):
            filled = Signal(report.name, source, track.time_s, values)
            report = channel_report(track, report.name, [filled])
        channels.append(report)
    return replace(log, track=track, channels=tuple(channels))


def channel_report(track: FlightTrack, name: str, signals: list[Signal]) -> ChannelReport:
    """Rate and pauses of the channel's reports, and the range of its numbers in the table."""
    values = getattr(track, name)
    finite = values[np.isfinite(values)]
    if not signals or finite.size == 0:
        nan = float("nan")
        return ChannelReport(
            name=name,
            unit=TRACK_CHANNELS[name].unit,
            source=track.sources.get(name, _ABSENT),
            samples=0,
            rate_hz=nan,
            gaps=0,
            longest_gap_s=nan,
            minimum=nan,
            median=nan,
            maximum=nan,
        )
    signal = max(signals, key=lambda s: s.time_s.size)
    known = known_rows(signal.values)
    step = np.diff(signal.time_s[known])
    step = step[step > 0]
    return ChannelReport(
        name=name,
        unit=TRACK_CHANNELS[name].unit,
        source=track.sources.get(name, _ABSENT),
        samples=int(known.sum()),
        rate_hz=float(1.0 / np.median(step)) if step.size else float("nan"),
        gaps=int(np.sum(step > TRACK_CHANNELS[name].max_age)),
        longest_gap_s=float(step.max()) if step.size else float("nan"),
        minimum=float(finite.min()),
        median=float(np.median(finite)),
        maximum=float(finite.max()),
    )
