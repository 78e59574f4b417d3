"""Which rotor speeds of a flight are measured, and which are to be made from motor outputs.

A rotor that was never heard is made from its output. One that was heard and falls silent alone may
stand still, and is not. Where no rotor is heard for LOST seconds, it is telemetry that stopped: of
those that fell silent together, two or more, the outputs speak until one is back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack

LOST = 3.0  # s without the speed of any rotor, and within which several fall silent together


class SpeedBasis(StrEnum):
    """What a rotor speed, and the margin by it, rests on."""

    UNKNOWN = ""
    MEASURED = "measured"
    MOTOR_OUTPUTS = "from motor outputs"
    SOME_OF_EACH = "measured, or from motor outputs"
    PREDICTED = "predicted"


def speed_basis(track: FlightTrack) -> SpeedBasis:
    """What the rotor speeds of a flight are: measured, from motor outputs, or some of each."""
    known = np.isfinite(track.rotor_speed_rpm)
    error = track.standard_errors.get("rotor_speed_rpm", np.zeros_like(known))
    inferred = known & (error > 0.0)
    if not np.any(inferred):
        return SpeedBasis.MEASURED
    if np.array_equal(inferred, known):
        return SpeedBasis.MOTOR_OUTPUTS
    return SpeedBasis.SOME_OF_EACH


def to_learn_from(track: FlightTrack) -> FlightTrack:
    """A flight whose rotors were all measured, without what outputs said while telemetry was lost;
    others as they are."""
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
    """Rotor, from 0, whose speed was ever measured -> s of the last row that had it."""

    last_s: Mapping[int, float] = field(default_factory=dict)

    @property
    def rotors(self) -> frozenset[int]:
        """Those that were ever heard."""
        return frozenset(self.last_s)

    def readings(self, track: FlightTrack) -> Bools:
        """(T, R) speeds that are known, but for those that outputs say of a rotor once heard."""
        error = track.standard_errors.get("rotor_speed_rpm")
        made = False if error is None else (error > 0.0) & self.mask(track.rotor_count)
        return np.isfinite(track.rotor_speed_rpm) & ~np.asarray(made)

    def mask(self, count: int) -> Bools:
        """(count,) the same."""
        return np.isin(range(count), list(self.last_s))


def heard_speeds(
    track: FlightTrack, before: HeardSpeeds | None
) -> tuple[Bools, Bools, HeardSpeeds]:
    """(T, R) rotors that are not to be made from outputs, (T, R) those whose telemetry is lost,
    and what was heard by the last row.

    With what was heard `before`, no row looks ahead.
    """
    # Standing still on the ground, an ESC that measures reads as one that does not.
    known = np.abs(track.rotor_speed_rpm) > 0.0
    time_s, ever = track.time_s[:, None], known.any(axis=0)
    times = np.where(known, time_s, np.nan)
    last_s = np.fmax.accumulate(times, axis=0)
    next_s = np.full_like(last_s, np.inf)
    if before is None:  # the whole silence counts, from its first row on, and from the start on
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
