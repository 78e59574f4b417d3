"""Decide which rotor speeds of a flight are measured, and which are to be made from motor outputs.

A rotor that never reported a speed gets one from its output. A rotor that stops reporting alone may
stand still, so it gets none. If no rotor reports for LOST s, telemetry failed: two or more rotors
that fell silent together get speeds from outputs until one reports again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack

LOST = 3.0  # s without the speed of any rotor, and within which several stop reporting together


class SpeedBasis(StrEnum):
    """The basis of a rotor speed, and of the margin by it."""

    UNKNOWN = ""
    MEASURED = "measured"
    MOTOR_OUTPUTS = "from motor outputs"
    SOME_OF_EACH = "measured, or from motor outputs"
    PREDICTED = "predicted"


def speed_basis(track: FlightTrack) -> SpeedBasis:
    """Classify the rotor speeds of a flight as measured, from motor outputs, or some of each.

    A known speed with a standard error above 0 is from outputs. A flight without any known speed
    counts as measured.
    """
    known = np.isfinite(track.rotor_speed_rpm)
    error = track.standard_errors.get("rotor_speed_rpm", np.zeros_like(known))
    inferred = known & (error > 0.0)
    if not np.any(inferred):
        return SpeedBasis.MEASURED
    if np.array_equal(inferred, known):
        return SpeedBasis.MOTOR_OUTPUTS
    return SpeedBasis.SOME_OF_EACH


def measured_only(track: FlightTrack) -> FlightTrack:
    """Drop rotor speeds inferred from motor outputs, if each rotor has measured ones as well.

    Return other flights unchanged.
    """
    source = track.source("rotor_speed_rpm")
    made = track.standard_errors.get("rotor_speed_rpm", np.zeros(track.rotor_speed_rpm.shape)) > 0.0
    measured = np.isfinite(track.rotor_speed_rpm) & ~made
    if not source.parts or not made.any() or not measured.any(axis=0).all():
        return track
    errors = {name: e for name, e in track.standard_errors.items() if name != "rotor_speed_rpm"}
    return replace(
        track,
        rotor_speed_rpm=np.where(made, np.nan, track.rotor_speed_rpm),
        standard_errors=errors,
        sources={**track.sources, "rotor_speed_rpm": source.parts[0]},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardSpeeds:
    """The time, s, of the last row with a measured speed, for each rotor (0-based) that had one."""

    last_s: Mapping[int, float] = field(default_factory=dict)

    @property
    def rotors(self) -> frozenset[int]:
        """Return the rotors that ever reported a speed."""
        return frozenset(self.last_s)

    def readings(self, track: FlightTrack) -> Bools:
        """Flag the known speeds (T, R), except those inferred from outputs for a rotor that once
        reported."""
        error = track.standard_errors.get("rotor_speed_rpm")
        made = False if error is None else (error > 0.0) & self.mask(track.rotor_count)
        return np.isfinite(track.rotor_speed_rpm) & ~np.asarray(made)

    def mask(self, count: int) -> Bools:
        """Flag (count,) the rotors that ever reported a speed."""
        return np.isin(range(count), list(self.last_s))


def heard_speeds(
    track: FlightTrack, before: HeardSpeeds | None
) -> tuple[Bools, Bools, HeardSpeeds]:
    """Flag rotors with current speed reports (T, R), and rotors of which telemetry was lost (T, R).

    A rotor that no mask flags has its speed inferred from its output. A speed of 0 is no report.
    Telemetry is lost if several rotors stop reporting together, in flight, for more than LOST s.
    Also return the last report of each rotor, to pass as `before` with the flight's next rows.
    Without `before` later rows are used too, with it no row depends on later ones.
    """
    # Zero is no reading: on the ground an ESC that measures and one that does not both report 0.
    known = np.abs(track.rotor_speed_rpm) > 0.0
    time_s, ever = track.time_s[:, None], known.any(axis=0)
    times = np.where(known, time_s, np.nan)
    last_s = np.fmax.accumulate(times, axis=0)
    next_s = np.full_like(last_s, np.inf)
    if before is None:  # a silence counts from its first row on, as does one from the start
        last_s = np.where(ever & np.isnan(last_s), time_s[:1], last_s)
        next_s = np.fmin.accumulate(times[::-1], axis=0)[::-1]
        next_s = np.where(np.isnan(next_s), np.inf, next_s)
        until_s = np.minimum(np.min(next_s, axis=1, initial=np.inf, keepdims=True), time_s[-1:])
    else:
        for rotor, heard_s in before.last_s.items():
            last_s[:, rotor] = np.where(np.isnan(last_s[:, rotor]), heard_s, last_s[:, rotor])
        until_s = time_s
    heard = np.isfinite(last_s)
    newest_s = np.max(np.where(heard, last_s, -np.inf), axis=1, initial=-np.inf, keepdims=True)
    together = heard & (newest_s - last_s <= LOST)
    several = together.sum(axis=1, keepdims=True) > 1
    lost = together & several & (until_s - newest_s > LOST) & track.flying[:, None]
    now = {r: float(last_s[-1, r]) for r in np.flatnonzero(heard[-1:].any(axis=0)).tolist()}
    return heard & ~lost, lost, HeardSpeeds(last_s=now)
