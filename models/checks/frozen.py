"""Instruments that stand still while what they measure cannot: they are none, and left out.

A battery under load never keeps its voltage to the last digit; a tank whose aircraft becomes
lighter by the thrust of its rotors does not keep its level; who tilts does not keep its airspeed.
Of a voltage and an airspeed the rows in which it stands are left out; a gauge that stuck once is
not believed before or after either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.checks.broken_voltage import VoltageSoFar, broken_voltage
from thrustmargin.models.checks.output_evidence import thrust_by_outputs, thrust_by_speeds
from thrustmargin.models.checks.speed_scale import FEWEST_ROWS, lifted_mass
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.motor_output import output_curve
from thrustmargin.models.provenance import Provenance, Reason, Rejected, SourceKind

LEAST_S = 60.0  # s in flight of one and the same reading
#: s for which a reading stays at most, on average, that is fine enough to show a change.
FINE_S = 6.0
#: Share of its mass by which an aircraft of constant load cannot become lighter: lift of forward
#: flight and a battery that gets warm are less.
LIGHTER = 0.08
#: Channels that can be frozen -> what measures them.
INSTRUMENTS = {
    "voltage": "battery voltage",
    "tank_kg": "tank gauge",
    "airspeed": "airspeed reading",
}
#: rad between which an aircraft tilts, but for the SELDOM most to either side, that surely changed
#: its speed; a hover shakes by less.
TILTED, SELDOM = 0.1, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """A reading that an instrument kept too long."""

    value: float  # in the unit of its channel
    rows: Bools  # (T,) in which it is left out
    throughout: bool  # it never moved in flight
    reason: Reason = Reason.FROZEN


def without_frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> FlightTrack:
    """The track of T rows with NaN where an instrument is frozen, or its voltage broke, and a note
    that says so."""
    track, _ = without_broken_voltage(track)
    return left_out(track, frozen(track, airframe, parameters))


def without_broken_voltage(
    track: FlightTrack, so_far: VoltageSoFar | None = None
) -> tuple[FlightTrack, VoltageSoFar]:
    """The same of a broken voltage alone; `so_far` is of the rows before those of the track."""
    broke, found = broken_voltage(track, so_far)
    if not broke.any():
        return track, found
    least = float(np.nanmin(track.voltage[broke]))
    stand = Stand(value=least, rows=broke, throughout=False, reason=Reason.BROKEN)
    return left_out(track, {"voltage": stand}), found


def frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> dict[str, Stand]:
    """Channels whose instrument stood still in flight -> the last time that it did."""
    found = {}
    flown = track.flying & np.isfinite(track.voltage)
    for rows in _stands(track, "voltage"):
        throughout, else_s = bool(rows[flown].all()), track.row_seconds[flown & ~rows].sum()
        moves = np.count_nonzero(np.diff(track.voltage[flown & ~rows]))
        if throughout or else_s < FINE_S * moves:
            left = rows | ~track.flying if throughout else rows
            found["voltage"] = Stand(
                value=float(track.voltage[rows][0]), rows=left, throughout=throughout
            )
    for rows in _stands(track, "tank_kg"):
        if _grew_lighter(track, rows, airframe, parameters):
            known = track.flying & np.isfinite(track.tank_kg)
            found["tank_kg"] = Stand(
                value=float(track.tank_kg[rows][0]),
                rows=np.ones_like(rows),
                throughout=bool(rows[known].all()),
            )
    for rows in _stands(track, "airspeed"):
        tilt = track.attitude[rows, :2]
        tilt = tilt[np.isfinite(tilt).all(axis=1)]
        ends = np.quantile(tilt, [SELDOM, 1.0 - SELDOM], axis=0) if tilt.size else np.zeros((2, 2))
        if np.max(ends[1] - ends[0]) > TILTED:
            known = track.flying & np.isfinite(track.airspeed)
            found["airspeed"] = Stand(
                value=float(track.airspeed[rows][0]),
                rows=rows,
                throughout=bool(rows[known].all()),
            )
    return found


def left_out(track: FlightTrack, frozen: Mapping[str, Stand]) -> FlightTrack:
    """The track with NaN in the channels that stand, and why."""
    if not frozen:
        return track
    channels, sources, notes = {}, {}, []
    for channel, stand in frozen.items():
        source = track.source(channel)
        channels[channel] = np.where(stand.rows, np.nan, getattr(track, channel))
        gone = Rejected(source, stand.reason)
        sources[channel] = replace(source, rejected=(*source.rejected, gone))
        if not np.isfinite(channels[channel]).any():
            sources[channel] = Provenance(kind=SourceKind.ABSENT, rejected=(gone,))
        value = f"{stand.value:.4g} {TRACK_CHANNELS[channel].unit}"
        did = f"stood at {value} for a minute or more"
        did = f"stood at {value} throughout the flight" if stand.throughout else did
        did = f"{stand.reason}, to {value}" if stand.reason is Reason.BROKEN else did
        notes.append(f"{INSTRUMENTS[channel]} {did}: no measurement, and left out")
    return replace(
        track, **channels, sources={**track.sources, **sources}, notes=(*track.notes, *notes)
    )


def _stands(track: FlightTrack, channel: str) -> list[Bools]:
    """For each time in flight that a reported channel had one value for LEAST_S, its rows (T,)."""
    values = getattr(track, channel)
    known = np.flatnonzero(track.flying & np.isfinite(values))
    if not track.source(channel).reported or known.size < FEWEST_ROWS:
        return []
    changes = np.flatnonzero(np.diff(values[known])) + 1
    starts, ends = np.append(0, changes), np.append(changes, known.size)
    long = np.flatnonzero(ends - starts >= FEWEST_ROWS)
    runs = [known[starts[k] : ends[k]] for k in long]
    number = np.arange(values.size)
    return [np.isin(number, run) for run in runs if track.row_seconds[run].sum() >= LEAST_S]


def _grew_lighter(
    track: FlightTrack, rows: Bools, airframe: Airframe, parameters: Mapping[str, float]
) -> bool:
    """Whether thrust in the last quarter of the rows (T,) is less than in the first by LIGHTER."""
    if track.rotor_count != airframe.rotor_count:
        return False
    curve = output_curve(parameters, track.source("throttle"))
    by = thrust_by_speeds(track, airframe), thrust_by_outputs(track, airframe, curve)
    masses = [lifted_mass(track, thrust) for thrust in by]
    known = [mass[rows & np.isfinite(mass)] for mass in masses]
    return any(_drop(mass) > LIGHTER for mass in known if mass.size >= 4 * FEWEST_ROWS)


def _drop(mass: Floats) -> float:
    """Share that (n,) falls by from its first quarter to its last."""
    quarter = mass.size // 4
    return 1.0 - float(np.median(mass[-quarter:]) / np.median(mass[:quarter]))
