"""Infer the rotor speeds and the load of a flight that it does not report, before its analysis.

Each step fills a channel that was not measured, states so in the track's `sources`, and sets its
standard error in `standard_errors`; measured values are kept. Files and links take the same steps.
Speeds come first (`output_speed`). The load is then that of hover thrust, where nothing reports it
or a gauge reports too little.

`load_evidence` fits it over a flight. The standard error includes the scatter of the means and the
errors that more flight does not reduce: thrust coefficient, air density, empty mass, and rotor
speeds that were themselves inferred.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from thrustmargin.models.checks.output_evidence import OutputEvidence, output_evidence
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.inferred.load_evidence import (
    BLOCK,
    LoadEvidence,
    LoadFit,
    accept_newest,
    blocks_of,
    collect_evidence,
    load_at,
    load_fit,
    spans_of,
    whole_flight_evidence,
)
from thrustmargin.models.model.inferred.output_speed import OutputCalibration, filled_speeds
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL, shared_error
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Meaning, Provenance, Reason, Rejected, SourceKind
from thrustmargin.models.statement import Statement, state

#: What may be wrong where thrust shows more load than a gauge.
THEN_CHECK = "check gauge and empty mass, and with the battery off the propellers"
#: Why such a load is no evidence for or against a model.
LOAD_FROM_SPEEDS = (
    "the load was inferred from these rotor speeds; state it with --load to compare them"
)
#: Share of the aircraft's mass that the standard error may be for the load to be used.
GOOD_ENOUGH = 0.15
COVERED = 0.5  # share of a flight from which a gauge's reading is kept
OVERLOAD = 0.25  # share of the full aircraft that may be on board beyond its tank
#: Standard errors to either side of a 99 % interval: a load stated further off is contradicted.
SURELY = 2.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inferred:
    """The evidence of the earlier parts of a live flight, for inference in its next part."""

    outputs: OutputCalibration = field(default_factory=OutputCalibration)
    load: LoadEvidence = field(default_factory=LoadEvidence)


def fill_channels(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
) -> FlightTrack:
    """Return the track of a whole flight with the rotor speeds and the load that other channels
    imply, where they are not reported.

    Return the track unchanged if `airframe` is None. `parameters` are the autopilot's, by name.
    """
    if airframe is None:
        return track
    outputs = output_evidence(track, airframe, parameters)
    track, _ = filled_speeds(track, airframe, parameters)
    return with_load(track, airframe, outputs)


def fill_channels_so_far(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
    so_far: Inferred,
) -> tuple[FlightTrack, Inferred]:
    """Fill in rotor speeds and load of the next rows of a live flight; also return the evidence so
    far.

    No row depends on later ones, so the load differs from that of `fill_channels` for the whole
    flight. Return the arguments unchanged if `airframe` is None.
    """
    if airframe is None:
        return track, so_far
    track, outputs = filled_speeds(track, airframe, parameters, so_far.outputs)
    track, load = with_load_so_far(track, airframe, so_far.load)
    return track, Inferred(outputs=outputs, load=load)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShownLoad:
    """The load that the thrust of a whole flight shows, independent of any gauge."""

    load: Floats  # (T,) kg, below 0 where the aircraft is lighter than its airframe says
    error: Floats  # (T,) kg, standard error
    fit: LoadFit
    flying: Bools  # (T,) rows in flight with a known load

    @property
    def usual(self) -> float:
        """Return the median load in flight, kg."""
        return float(np.median(self.load[self.flying]))

    @property
    def usual_error(self) -> float:
        """Return the median standard error in flight, kg."""
        return float(np.median(self.error[self.flying]))

    def note(self, lacks: str) -> Statement:
        """Return a statement that the inferred load, kg, is not used; `lacks` names the reason."""
        within = INTERVAL * self.usual_error
        return state("load by thrust", lacks, "state load", load=self.usual, within=within)

    def beyond(self, tank_kg: Floats) -> float:
        """Return the median excess in flight of the load over `tank_kg` (T,), in standard errors.

        NaN if no tank level is known in flight.
        """
        apart = (self.load - tank_kg)[self.flying]
        known = np.isfinite(apart)
        return float(np.median(apart[known])) / self.usual_error if known.any() else np.nan


def with_load(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> FlightTrack:
    """Fill in the load (`tank_kg`), inferred from hover thrust, if most of the flight has none.

    A load that a gauge reports or the user states stays; if thrust contradicts a stated one, a
    remark is added to its source. The inferred load is used if its standard error is at most
    GOOD_ENOUGH of the aircraft's mass and its interval includes a possible load; else the track
    stays and a note states the reason. Where motor `outputs` show more thrust than the rotor
    speeds, the error of the inferred load includes the load by outputs.
    """
    source = track.source("tank_kg")
    stated = source.kind is SourceKind.STATED
    gauge = track.reports("tank_kg") and not stated
    if (gauge and _gauge_coverage(track) >= COVERED) or not _has_load(track, airframe):
        return track
    shown = _shown_load(track, airframe, outputs)
    if stated:
        if shown is None or not abs(shown.beyond(track.tank_kg)) > SURELY:
            return track
        within = INTERVAL * shown.usual_error
        disputed = source.remarked(state("but thrust shows", load=shown.usual, within=within))
        return replace(track, sources={**track.sources, "tank_kg": disputed})
    if gauge and (shown is None or shown.usual_error > _largest_error(airframe, shown.usual)):
        return track
    if shown is None:
        return _with_note(track, state("no load shown", "state load"))
    off, usual = shown.usual_error, shown.usual
    if off > _largest_error(airframe, usual):
        return _with_note(track, shown.note("too unsure"))
    if usual < -INTERVAL * off:
        return _with_note(track, shown.note("less than nothing"))
    most = airframe.tank_capacity_kg + OVERLOAD * (airframe.empty_mass + airframe.tank_capacity_kg)
    if usual > most + INTERVAL * off:
        return _with_note(track, shown.note("more than carried"))
    by_thrust = _thrust_source(off, _fall(shown.fit))
    if gauge:
        little = state("covers little", percent=100.0 * _gauge_coverage(track))
        rejected = (Rejected(source, Reason.COVERS_LESS),)
        by_thrust = replace(by_thrust.remarked(little), rejected=rejected)
    return _with_load(track, shown.load, shown.error, by_thrust)


def _largest_error(airframe: Airframe, load: float) -> float:
    """Return the largest standard error, kg, with which a load by thrust is used."""
    return GOOD_ENOUGH * (airframe.empty_mass + max(load, 0.0))


def _gauge_coverage(track: FlightTrack) -> float:
    """Return the share of the rows in flight in which the tank level is known; 1 without a
    flight."""
    known = np.isfinite(track.tank_kg[track.flying])
    return float(known.mean()) if known.size else 1.0


def with_load_for_verdict(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> FlightTrack:
    """Replace a reported or stated load by that of hover thrust, if thrust surely shows more.

    A stuck gauge, an unknown mass and weak rotors look alike in hover; each leaves less margin than
    the gauge would, and a redundancy by thrust is right for all three. Return other flights
    unchanged. Identification keeps the reported load.
    """
    source = track.source("tank_kg")
    known = track.reports("tank_kg") and source.meaning is not Meaning.HOVER_THRUST
    if not known or not _has_load(track, airframe):
        return track
    shown = _shown_load(track, airframe)
    if shown is None or not shown.beyond(track.tank_kg) > SURELY:
        return track
    # Gauge or rotor speeds are wrong, so the error must reach to the load by motor outputs.
    shown = _shown_load(track, airframe, outputs) or shown
    level = float(np.nanmedian(track.tank_kg[shown.flying]))
    stated = source.kind is SourceKind.STATED
    why = state("stated load too little" if stated else "gauge too little", load=level)
    by_thrust = _thrust_source(shown.usual_error, _fall(shown.fit), why)
    turned_down = (Rejected(source, Reason.CONTRADICTED),)
    return _with_load(track, shown.load, shown.error, replace(by_thrust, rejected=turned_down))


@lru_cache(maxsize=1)  # one report needs the same load twice
def _shown_load(
    track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None = None
) -> ShownLoad | None:
    """Infer the load, kg, and its error from hover thrust; None without level flight with every
    rotor's speed.

    With `outputs` the error includes the thrust that motor outputs show beyond the rotor speeds.
    """
    shown, legs, seconds = whole_flight_evidence(track, airframe)
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
        error = np.hypot(error, outputs.more_than(mass) / INTERVAL)
    return ShownLoad(load=load, error=error, fit=fit, flying=flying)


def with_load_so_far(
    track: FlightTrack, airframe: Airframe, so_far: LoadEvidence
) -> tuple[FlightTrack, LoadEvidence]:
    """Fill in the load for the next rows of a flight in progress, without any row using later ones.

    Each row uses earlier spans of time only; `so_far` is the evidence from earlier rows. Also
    return the evidence including these rows. NaN until the load is known well enough, and after a
    sudden change of load until enough rows show the new one. Unchanged where a gauge reports the
    load.
    """
    # A rejected gauge counts as not reported.
    still = so_far.gauged and not track.source("tank_kg").rejected
    so_far = replace(so_far, gauged=still or track.reports("tank_kg"))
    if so_far.gauged or not _has_load(track, airframe):
        return track, so_far
    load, error = np.full((2, track.time_s.size), np.nan)
    blocks, fit = blocks_of(track), None
    for block in np.unique(blocks).tolist():
        now = np.flatnonzero(blocks == block)
        rows = track.rows(slice(now[0], now[-1] + 1))
        if so_far.last_s < block * BLOCK:
            so_far = accept_newest(so_far, airframe)
        shown, legs, seconds = collect_evidence(rows, airframe, replace(so_far, sums=so_far.newest))
        so_far = replace(shown, sums=so_far.sums, newest=shown.sums)
        fit = load_fit(so_far.before(int(spans_of(rows)[0])), airframe)
        if fit is not None and not so_far.parted:
            row_seconds = seconds[:, 0 if fit.by_spraying else 1]
            load[now], error[now] = load_at(fit, legs, row_seconds, airframe)
    error = np.hypot(error, shared_error(track, airframe, load))
    with np.errstate(invalid="ignore"):
        sure = error <= GOOD_ENOUGH * (airframe.empty_mass + np.maximum(load, 0.0))
        sure &= load >= -INTERVAL * error
    load[~sure] = np.nan
    if not np.any(sure) or fit is None:
        return track, so_far
    by_thrust = _thrust_source(float(error[sure][-1]), state("so far"), _fall(fit))
    return _with_load(track, load, error, by_thrust), so_far


def _has_load(track: FlightTrack, airframe: Airframe) -> bool:
    """Return True if the airframe has a tank, and the track has all its rotors and at least one
    row."""
    rotors = track.rotor_count == airframe.rotor_count and track.time_s.size > 0
    return rotors and airframe.tank_volume_l > 0.0


def _with_load(track: FlightTrack, load: Floats, error: Floats, source: Provenance) -> FlightTrack:
    """Set the load (T,) kg, not below 0, its standard error (T,) kg and its source."""
    load, error = np.maximum(load, 0.0), np.where(np.isfinite(load), error, np.nan)
    # Keep the earlier rejections.
    turned_down = (*track.source("tank_kg").rejected, *source.rejected)
    return replace(
        track,
        tank_kg=load,
        standard_errors={**track.standard_errors, "tank_kg": error},
        sources={**track.sources, "tank_kg": replace(source, rejected=turned_down)},
    )


def _with_note(track: FlightTrack, note: Statement) -> FlightTrack:
    """Return the track with `note`, why its load is unknown, added to its statements."""
    return replace(track, statements=(*track.statements, note))


def _thrust_source(error: float, *remarks: Statement) -> Provenance:
    """Return the source of a load by hover thrust with standard error `error` kg."""
    return Provenance(
        kind=SourceKind.INFERRED,
        meaning=Meaning.HOVER_THRUST,
        remarks=(state("load within", within=INTERVAL * error), *remarks),
    )


def _fall(fit: LoadFit) -> Statement:
    """Return what makes the load fall."""
    if not fit.falls:
        return state("constant")
    return state("falling with pump" if fit.by_spraying else "falling by trend")
