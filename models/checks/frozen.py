"""Instruments that stand still while what they measure cannot: they are none, and left out.

A battery under load never keeps its voltage to the last digit; a tank whose aircraft becomes
lighter by the thrust of its rotors does not keep its level.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from thrustmargin.models.checks.output_evidence import thrust_by_outputs, thrust_by_speeds
from thrustmargin.models.checks.speed_scale import FEWEST_ROWS, lifted_mass
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.motor_output import output_curve
from thrustmargin.models.provenance import Provenance, Reason, Rejected, SourceKind

LEAST_S = 60.0  # s in flight of one and the same reading
#: Share of its mass by which an aircraft of constant load cannot become lighter: lift of forward
#: flight and a battery that gets warm are less.
LIGHTER = 0.08
_REPORTED = (SourceKind.MESSAGE, SourceKind.TOPIC, SourceKind.COLUMN)


def without_frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> FlightTrack:
    """The track of T rows with NaN in the channels whose instrument is frozen, which says so."""
    return left_out(track, frozen(track, airframe, parameters))


def frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> dict[str, float]:
    """Channels whose instrument stood still in flight -> where."""
    found = {}
    if _stands(track, "voltage"):
        found["voltage"] = _level(track, "voltage")
    if _stands(track, "tank_kg") and _grew_lighter(track, airframe, parameters):
        found["tank_kg"] = _level(track, "tank_kg")
    return found


def left_out(track: FlightTrack, frozen: Mapping[str, float]) -> FlightTrack:
    """The track with NaN in the channels that stand at these values, and why."""
    if not frozen:
        return track
    sources = {
        channel: Provenance(
            kind=SourceKind.ABSENT, rejected=(Rejected(track.source(channel), Reason.FROZEN),)
        )
        for channel in frozen
    }
    nothing = {channel: np.full(track.time_s.size, np.nan) for channel in frozen}
    notes = [
        f"{_NAMES[channel]} stood at {value:.4g} {TRACK_CHANNELS[channel].unit} throughout the "
        "flight: no measurement, and left out"
        for channel, value in frozen.items()
    ]
    return replace(
        track, **nothing, sources={**track.sources, **sources}, notes=(*track.notes, *notes)
    )


def _level(track: FlightTrack, channel: str) -> float:
    return float(np.nanmedian(getattr(track, channel)[track.flying]))


_NAMES = {"voltage": "battery voltage", "tank_kg": "tank gauge"}


def _stands(track: FlightTrack, channel: str) -> bool:
    """Whether a reported channel has one value in all of a flight that is long enough."""
    values = getattr(track, channel)
    known = track.flying & np.isfinite(values)
    if track.source(channel).kind not in _REPORTED or np.count_nonzero(known) < FEWEST_ROWS:
        return False
    return float(track.row_seconds[known].sum()) >= LEAST_S and bool(np.ptp(values[known]) == 0.0)


def _grew_lighter(track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]) -> bool:
    """Whether thrust in the last quarter of the flight is less than in the first by LIGHTER."""
    if track.rotor_count != airframe.rotor_count:
        return False
    curve = output_curve(parameters, track.source("throttle"))
    by = thrust_by_speeds(track, airframe), thrust_by_outputs(track, airframe, curve)
    masses = [lifted_mass(track, thrust) for thrust in by]
    known = [mass[np.isfinite(mass)] for mass in masses]
    return any(_drop(mass) > LIGHTER for mass in known if mass.size >= 4 * FEWEST_ROWS)


def _drop(mass: Floats) -> float:
    """Share that (n,) falls by from its first quarter to its last."""
    quarter = mass.size // 4
    return 1.0 - float(np.median(mass[-quarter:]) / np.median(mass[:quarter]))
