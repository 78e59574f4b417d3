"""The load that hover thrust shows, where nothing reports it or a gauge says too little.

Fitted over a flight by `load_evidence`. The standard error has the scatter of the means, and what
no amount of flight lessens: thrust coefficient, air density, empty mass, rotor speeds that were
themselves inferred.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from thrustmargin.models.checks.output_evidence import OutputEvidence
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.inferred.load_evidence import (
    BLOCK,
    LoadEvidence,
    LoadFit,
    blocks_of,
    compared,
    gathered,
    load_at,
    load_fit,
    spans_of,
    whole_flight,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.provenance import Meaning, Provenance, Reason, Rejected, SourceKind

#: What may be wrong where thrust shows more load than a gauge.
THEN_CHECK = "check gauge and empty mass, and with the battery off the propellers"
#: Why such a load is no evidence for or against a model.
LOAD_FROM_SPEEDS = (
    "the load was inferred from these rotor speeds; state it with --load to compare them"
)
#: Standard errors as shares: a measured thrust curve on the aircraft, a guessed one; a weighed
#: empty mass, a guessed one.
CURVE_ERROR, MASS_ERROR, GUESSED_ERROR = 0.03, 0.005, 0.1
#: Share of the aircraft's mass that the standard error may be for the load to be used.
GOOD_ENOUGH = 0.15
COVERED = 0.5  # share of a flight from which what a gauge reports stays
OVERLOAD = 0.25  # share of the full aircraft that may be on board beyond its tank
NINETY = 1.645  # standard errors to either side that hold 90 %
SURELY = 2.6  # the same for 99 %: a reported or stated load further off is contradicted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShownLoad:
    """The load that the thrust of a whole flight shows, whatever a gauge says."""

    load: Floats  # (T,) kg, below 0 where the aircraft is lighter than its airframe says
    error: Floats  # (T,) kg, standard error
    fit: LoadFit
    flying: Bools  # (T,) rows of which it is known

    @property
    def usual(self) -> float:
        """kg, median in flight."""
        return float(np.median(self.load[self.flying]))

    @property
    def usual_error(self) -> float:
        """kg, median standard error in flight."""
        return float(np.median(self.error[self.flying]))

    @property
    def words(self) -> str:
        """What it is, for people."""
        return f"hover thrust shows {self.usual:.1f} ± {NINETY * self.usual_error:.1f} kg (90 %)"

    def beyond(self, tank_kg: Floats) -> float:
        """kg by which it is more than a level (T,) kg, in standard errors; NaN for none."""
        apart = (self.load - tank_kg)[self.flying]
        known = np.isfinite(apart)
        return float(np.median(apart[known])) / self.usual_error if known.any() else np.nan


def with_load(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> FlightTrack:
    """The flight with the load that its thrust shows, where most of the flight reports none.

    A reported or stated load stays; the source of a stated one says where thrust contradicts it.
    Used where its standard error is at most GOOD_ENOUGH of the aircraft's mass and it is not below
    nothing by more than its interval; else a note says why not. Where motor `outputs` would lift
    more than the rotor speeds, its error reaches to their load.
    """
    source = track.source("tank_kg")
    stated = source.kind is SourceKind.STATED
    gauge = track.reports("tank_kg") and not stated
    if (gauge and _covered(track) >= COVERED) or not _may_carry(track, airframe):
        return track
    shown = _shown(track, airframe, outputs)
    if stated:
        if shown is None or not abs(shown.beyond(track.tank_kg)) > SURELY:
            return track
        disputed = source.remarked(f"but {shown.words}")
        return replace(track, sources={**track.sources, "tank_kg": disputed})
    if gauge and (shown is None or shown.usual_error > _unsure_from(airframe, shown.usual)):
        return track
    if shown is None:
        return _noted(track, "no level flight with every rotor's speed to show the load")
    off, usual = shown.usual_error, shown.usual
    if off > _unsure_from(airframe, usual):
        return _noted(track, f"{shown.words}, too unsure to be used")
    if usual < -NINETY * off:
        lacks = "less than nothing: check mass and thrust of the airframe"
        return _noted(track, f"{shown.words}, {lacks}")
    most = airframe.tank_capacity_kg + OVERLOAD * (airframe.empty_mass + airframe.tank_capacity_kg)
    if usual > most + NINETY * off:
        lacks = "more than the aircraft can carry: check the airframe"
        return _noted(track, f"{shown.words}, {lacks}")
    by_thrust = _by_thrust(off, _fall(shown.fit))
    if gauge:
        little = f"{source.words} covers {_covered(track):.0%} of the flight"
        rejected = (Rejected(source, Reason.COVERS_LESS),)
        by_thrust = replace(by_thrust.remarked(little), rejected=rejected)
    return _filled(track, shown.load, shown.error, by_thrust)


def _unsure_from(airframe: Airframe, load: float) -> float:
    """kg of standard error from which a load by thrust is of no use."""
    return GOOD_ENOUGH * (airframe.empty_mass + max(load, 0.0))


def _covered(track: FlightTrack) -> float:
    """Share of the rows in flight of which the tank level is known; 1 without a flight."""
    known = np.isfinite(track.tank_kg[track.flying])
    return float(known.mean()) if known.size else 1.0


def with_load_for_verdict(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> FlightTrack:
    """The flight of which a verdict is given: where thrust shows surely more load than a gauge or a
    statement, with the load that thrust shows.

    A gauge that stands still, a mass that nobody knows of and weak rotors look alike in hover; each
    leaves less margin than the gauge would, and a redundancy by thrust is right for all three.
    What a model lacks is found with the load as it was reported.
    """
    source = track.source("tank_kg")
    known = track.reports("tank_kg") and source.meaning is not Meaning.HOVER_THRUST
    if not known or not _may_carry(track, airframe):
        return track
    shown = _shown(track, airframe)
    if shown is None or not shown.beyond(track.tank_kg) > SURELY:
        return track
    # Gauge or rotor speeds are wrong: what the outputs say beyond both may be the truth.
    shown = _shown(track, airframe, outputs) or shown
    level = float(np.nanmedian(track.tank_kg[shown.flying]))
    origin = "as stated" if source.kind is SourceKind.STATED else f"by {source.words}"
    why = f"{level:.1f} kg {origin} are too little for these rotor speeds: {THEN_CHECK}"
    by_thrust = _by_thrust(shown.usual_error, _fall(shown.fit), why)
    turned_down = (Rejected(source, Reason.CONTRADICTED),)
    return _filled(track, shown.load, shown.error, replace(by_thrust, rejected=turned_down))


@lru_cache(maxsize=1)  # a report asks for its own verdict's load and once more
def _shown(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> ShownLoad | None:
    """The load by thrust; None without level flight with every rotor's speed."""
    shown, legs, seconds = whole_flight(track, airframe)
    fit = load_fit(shown, airframe)
    if fit is None:
        return None
    load, error = load_at(
        fit, np.maximum(legs, 1), seconds[:, 0 if fit.by_spraying else 1], airframe
    )
    error = np.hypot(error, shared_error(track, airframe, load))
    flying = track.flying & np.isfinite(load)
    if not np.any(flying):
        return None
    if outputs is not None:
        mass = airframe.empty_mass + float(np.median(load[flying]))
        error = np.hypot(error, outputs.more_than(mass) / NINETY)
    return ShownLoad(load=load, error=error, fit=fit, flying=flying)


def with_load_so_far(
    track: FlightTrack, airframe: Airframe, so_far: LoadEvidence
) -> tuple[FlightTrack, LoadEvidence]:
    """The same for the next rows of a flight: each has what the spans before its own have shown.

    Where rows part from that as by a load that was dropped, it is unknown until they show it.
    """
    # A gauge that was turned down reported nothing.
    still = so_far.gauged and not track.source("tank_kg").rejected
    so_far = replace(so_far, gauged=still or track.reports("tank_kg"))
    if so_far.gauged or not _may_carry(track, airframe):
        return track, so_far
    load, error = np.full((2, track.time_s.size), np.nan)
    blocks, fit = blocks_of(track), None
    for block in np.unique(blocks).tolist():
        now = np.flatnonzero(blocks == block)
        rows = track.rows(slice(now[0], now[-1] + 1))
        if so_far.last_s < block * BLOCK:
            so_far = compared(so_far, airframe)
        shown, legs, seconds = gathered(rows, airframe, replace(so_far, sums=so_far.newest))
        so_far = replace(shown, sums=so_far.sums, newest=shown.sums)
        fit = load_fit(so_far.before(int(spans_of(rows)[0])), airframe)
        if fit is not None and not so_far.parted:
            row_seconds = seconds[:, 0 if fit.by_spraying else 1]
            load[now], error[now] = load_at(fit, legs, row_seconds, airframe)
    error = np.hypot(error, shared_error(track, airframe, load))
    with np.errstate(invalid="ignore"):
        sure = error <= GOOD_ENOUGH * (airframe.empty_mass + np.maximum(load, 0.0))
        sure &= load >= -NINETY * error
    load[~sure] = np.nan
    if not np.any(sure) or fit is None:
        return track, so_far
    by_thrust = _by_thrust(float(error[sure][-1]), "so far", _fall(fit))
    return _filled(track, load, error, by_thrust), so_far


def shared_error(track: FlightTrack, airframe: Airframe, load: Floats) -> Floats:
    """(T,) kg of an inferred load's standard error that its redundancy is free of.

    A wrong curve, air density or empty mass shifts the weight that the rotors show and the largest
    thrust that they have alike.
    """
    curve = GUESSED_ERROR if "thrust_coefficient" in airframe.guessed else CURVE_ERROR
    mass = GUESSED_ERROR if "empty_mass" in airframe.guessed else MASS_ERROR
    air = track_air(track)
    of_thrust = np.hypot(curve, air.density_error / air.density) * (airframe.empty_mass + load)
    return np.hypot(of_thrust, mass * airframe.empty_mass)


def _may_carry(track: FlightTrack, airframe: Airframe) -> bool:
    """True when there is a tank, and rotors whose thrust shows what it holds."""
    rotors = track.rotor_count == airframe.rotor_count and track.time_s.size > 0
    return rotors and airframe.tank_volume_l > 0.0


def _filled(track: FlightTrack, load: Floats, error: Floats, source: Provenance) -> FlightTrack:
    load, error = np.maximum(load, 0.0), np.where(np.isfinite(load), error, np.nan)
    # What was turned down before is still said.
    turned_down = (*track.source("tank_kg").rejected, *source.rejected)
    return replace(
        track,
        tank_kg=load,
        standard_errors={**track.standard_errors, "tank_kg": error},
        sources={**track.sources, "tank_kg": replace(source, rejected=turned_down)},
    )


def _noted(track: FlightTrack, why: str) -> FlightTrack:
    note = f"load not known: {why}; state it with --load"
    return replace(track, notes=(*track.notes, note))


def _by_thrust(error: float, *remarks: str) -> Provenance:
    return Provenance(
        kind=SourceKind.INFERRED,
        meaning=Meaning.HOVER_THRUST,
        remarks=(f"± {NINETY * error:.1f} kg, 90 %", *remarks),
    )


def _fall(fit: LoadFit) -> str:
    """What makes it fall, for people."""
    if not fit.falls:
        return "constant"
    return "falling with the pump's output" if fit.by_spraying else "falling by its own trend"
