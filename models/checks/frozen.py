"""Find instruments whose readings cannot be true, and drop the readings from a flight.

Each instrument is compared with other measurements of the same flight, in two ways.

A frozen reading stays the same to the last digit while its quantity must change: a battery under
load never keeps its voltage; a tank does not keep its level while the thrust shows that the
aircraft becomes lighter; an aircraft that tilts does not keep its airspeed. Of voltage and airspeed
only the frozen rows are dropped; of a tank gauge all rows, because a gauge that stuck once is not
trusted before or after either.

A reading that changes, but not as its quantity does (`instruments.py`), is dropped in all rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.checks.instruments import (
    LIGHTER,
    barometer_fault,
    copied_rotors,
    gauge_unfollowed,
    lifted_masses,
    share_lighter,
    voltage_without_sag,
)
from thrustmargin.models.checks.speed_readings import FEWEST_ROWS
from thrustmargin.models.checks.voltage import VoltageSoFar, broken_voltage
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, FlightTrack
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import Provenance, Reason, Rejected, SourceKind

LEAST_S = 60.0  # s in flight of one and the same reading
#: s between changes, on average, above which a reading is too coarse to call it frozen.
FINE_S = 6.0
#: Channels that can be frozen -> what measures them.
INSTRUMENTS = {
    "voltage": "battery voltage",
    "tank_kg": "tank gauge",
    "airspeed": "airspeed reading",
    "pressure": "barometer",
    "temperature": "barometer",
    "rotor_speed_rpm": "rotor speed sensors",
}
#: rad, range of tilt (without the share SELDOM at either end) that surely changes the speed;
#: a hover shakes by less.
TILTED, SELDOM = 0.1, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """A faulty instrument reading: its value, rows and reason."""

    value: float  # in the unit of its channel
    rows: Bools  # (T,) in which it is dropped
    throughout: bool  # it never changed in flight
    reason: Reason = Reason.FROZEN
    rotors: tuple[int, ...] = ()  # rotors concerned, from 0; empty for other channels


def without_frozen(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> FlightTrack:
    """Set NaN where an instrument is frozen, faulty or the voltage broke down, and add a note
    that says so."""
    track, _ = without_broken_voltage(track)
    return drop_readings(track, frozen_channels(track, airframe, parameters))


def without_broken_voltage(
    track: FlightTrack, so_far: VoltageSoFar | None = None
) -> tuple[FlightTrack, VoltageSoFar]:
    """Set NaN where the voltage broke down; `so_far` and the second result are the state between
    parts of a flight."""
    broke, found = broken_voltage(track, so_far)
    if not broke.any():
        return track, found
    least = float(np.nanmin(track.voltage[broke]))
    stand = Stand(value=least, rows=broke, throughout=False, reason=Reason.BROKEN)
    return drop_readings(track, {"voltage": stand}), found


def frozen_channels(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> dict[str, Stand]:
    """Find the channels whose instrument was frozen or faulty in flight, each with its last such
    run.

    `parameters` are the autopilot's, by name.
    """
    found = {}
    flown = track.flying & np.isfinite(track.voltage)
    for rows in _frozen_runs(track, "voltage"):
        throughout, else_s = bool(rows[flown].all()), track.row_seconds[flown & ~rows].sum()
        moves = np.count_nonzero(np.diff(track.voltage[flown & ~rows]))
        if throughout or else_s < FINE_S * moves:
            left = rows | ~track.flying if throughout else rows
            found["voltage"] = Stand(
                value=float(track.voltage[rows][0]), rows=left, throughout=throughout
            )
    for rows in _frozen_runs(track, "tank_kg"):
        if _grew_lighter(track, rows, airframe, parameters):
            known = track.flying & np.isfinite(track.tank_kg)
            found["tank_kg"] = Stand(
                value=float(track.tank_kg[rows][0]),
                rows=np.ones_like(rows),
                throughout=bool(rows[known].all()),
            )
    for rows in _frozen_runs(track, "airspeed"):
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
    whole = np.ones(track.time_s.size, dtype=np.bool_)
    for channel, reason, rotors in _contradictions(track, airframe, parameters):
        values = getattr(track, channel)[track.flying]
        value = known_median(values[:, list(rotors)] if rotors else values)
        stand = Stand(value=value, rows=whole, throughout=True, reason=reason, rotors=rotors)
        found.setdefault(channel, stand)
    return found


def _contradictions(
    track: FlightTrack, airframe: Airframe, parameters: Mapping[str, float]
) -> Iterator[tuple[str, Reason, tuple[int, ...]]]:
    """Yield channel, reason and rotors of each reading that other measurements contradict."""
    if rotors := copied_rotors(track):
        yield "rotor_speed_rpm", Reason.COPIED, rotors
    if voltage_without_sag(track):
        yield "voltage", Reason.UNLOADED, ()
    if gauge_unfollowed(track, airframe, parameters):
        yield "tank_kg", Reason.UNFOLLOWED, ()
    if barometer_fault(track):
        yield "pressure", Reason.IMPOSSIBLE, ()
        yield "temperature", Reason.IMPOSSIBLE, ()


def drop_readings(track: FlightTrack, frozen: Mapping[str, Stand]) -> FlightTrack:
    """Set NaN in the rows of faulty readings, by channel, and note the reason in source and
    notes."""
    if not frozen:
        return track
    channels, sources, notes = {}, {}, []
    for channel, stand in frozen.items():
        source, values = track.source(channel), getattr(track, channel)
        if stand.rotors:
            of_rotor = np.isin(np.arange(track.rotor_count), stand.rotors)
            channels[channel] = np.where(stand.rows[:, None] & of_rotor, np.nan, values)
        else:
            channels[channel] = np.where(stand.rows, np.nan, values)
        gone = Rejected(source, stand.reason)
        sources[channel] = replace(source, rejected=(*source.rejected, gone))
        if not np.isfinite(channels[channel]).any():
            sources[channel] = Provenance(kind=SourceKind.ABSENT, rejected=(gone,))
        notes.append(
            f"{INSTRUMENTS[channel]} {_fault_words(channel, stand)}: no measurement, and left out"
        )
    return replace(
        track, **channels, sources={**track.sources, **sources}, notes=(*track.notes, *notes)
    )


def _fault_words(channel: str, stand: Stand) -> str:
    """Describe the fault of a reading, for people."""
    value = f"{stand.value:.4g} {TRACK_CHANNELS[channel].unit}"
    if stand.reason is Reason.BROKEN:
        return f"{stand.reason}, to {value}"
    if stand.rotors:
        which = " and ".join(str(rotor + 1) for rotor in stand.rotors)
        return f"of rotors {which}: one {stand.reason}"
    if stand.reason is not Reason.FROZEN:
        return f"{stand.reason}, {value} in flight"
    lasted = "throughout the flight" if stand.throughout else "for a minute or more"
    return f"stood at {value} {lasted}"


def _frozen_runs(track: FlightTrack, channel: str) -> list[Bools]:
    """List the rows (T,) of each run in flight in which a reported channel kept one value for
    LEAST_S or more."""
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
    """Return whether the mass by thrust falls by more than LIGHTER from the first to the last
    quarter of `rows` (T,)."""
    known = (m[rows & np.isfinite(m)] for m in lifted_masses(track, airframe, parameters))
    return any(share_lighter(m) > LIGHTER for m in known if m.size >= 4 * FEWEST_ROWS)
