"""One log to what the season's store keeps of it: in a process of `ingest`, here or elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.commands.shared.anonymous import anonymous, pseudonym, without_name
from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    ReadingOptions,
    chosen_model,
    read_flights,
    unnamed,
)
from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.logs.findings import report_findings
from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.gcs_plugin.reports.margin import FlightReport, report_flight
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.store.ingest_run import LogSource, local_file
from thrustmargin.gcs_plugin.store.schema import ROTORS, analysis_columns
from thrustmargin.gcs_plugin.store.season_store import (
    SeasonStore,
    aircraft_identity,
    array_cells,
    board,
    firmware,
    layout,
)
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, stage
from thrustmargin.gcs_plugin.wording.advice_words import PREDICTED_ALONE
from thrustmargin.gcs_plugin.wording.flight_words import not_flown
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.errors import DataError, ThrustMarginError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.season.flight_sums import flight_sums, to_arrays
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import (
    FlightAnalysis,
    analyse,
    analysis_for_verdict,
    with_bad_part,
    worst_rotor,
)
from thrustmargin.models.model.inferred.speed_basis import measured_only
from thrustmargin.models.model.model_file import model_digest
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.resistance import battery_resistance
from thrustmargin.models.physics.smoothing import known_mean, known_median, known_most


@dataclass(frozen=True, slots=True, kw_only=True)
class IngestSettings:
    """How every log of a run is read, in words that another machine understands too."""

    store: str
    model: str | None = None
    airframe: str | None = None
    aircraft: str | None = None
    reading: ReadingOptions = AS_HEARD
    max_utilisation: float = 0.5
    key: str | None = None  # of pseudonyms, to strip who and where


@lru_cache(maxsize=4)
def season_model(model: str | None, airframe: str | None) -> tuple[RotorModel, str]:
    """The model of a run and its digest."""
    chosen = chosen_model(None if model is None else Path(model), airframe)
    return chosen, model_digest(chosen)


def stage_log(log: LogSource, content: str, *, settings: IngestSettings) -> list[str]:
    """Read a log whose digest is `content` and stage its flights; returns their names.

    A log holds a flight of each vehicle and sortie. The one that bears the content alone is staged
    last: it says that the log is in the store. Raises ThrustMarginError when there is none.
    """
    from threadpoolctl import threadpool_limits

    store = SeasonStore.open(settings.store)
    # One thread: the cores have a log each, and sums come out the same on any machine of a kind.
    with threadpool_limits(1), local_file(log.path) as path:
        flights = season_flights(path, content, settings, name=log.name)
    for flight in reversed(flights):
        stage(store, flight)
    return [flight.summary["flight"] for flight in flights]


def season_flights(
    path: Path, content: str, settings: IngestSettings, *, name: str
) -> list[SeasonFlight]:
    """Every vehicle's sorties in a log of that `name`, each a flight of the store.

    Raises ThrustMarginError when there is none.
    """
    found, log = _sorties(path, content, settings, settings.reading, name=name)
    first = found[0]
    alone = settings.reading.vehicle is not None
    for other in () if alone else (v for v in log.vehicles if v != log.vehicle):
        reading = replace(settings.reading, vehicle=other)
        try:
            found += _sorties(path, f"{content}-{other}", settings, reading, name=name)[0]
        except ThrustMarginError as error:  # often a camera or an antenna tracker
            first.summary["notes"].append(f"no flight of vehicle {other}: {unnamed(error, path)}")
    return found


def _sorties(
    path: Path, content: str, settings: IngestSettings, reading: ReadingOptions, *, name: str
) -> tuple[list[SeasonFlight], FlightLog]:
    """The sorties of one vehicle, and the log of the first.

    The first bears the name that a log of one flight has: so it is found again in a store.
    """
    model, _ = season_model(settings.model, settings.airframe)
    given = settings.model is not None or settings.airframe is not None
    read = read_flights(path, model, given=given, reading=reading)
    found = []
    for log, claim in read:
        flight = content if log.sortie == 1 else f"{content}-sortie-{log.sortie}"
        made = flight_of_log(log, claim, flight, settings, file=path.name)
        shown = None if settings.key is not None else f"{clean(name)}{log.sortie_suffix}"
        made.summary["log_name"] = shown
        found.append(made)
    return found, read[0][0]


def flight_of_log(
    log: FlightLog, claim: AirframeClaim, name: str, settings: IngestSettings, *, file: str = ""
) -> SeasonFlight:
    """What the store keeps of a log that was read from a file. Raises DataError when it is none."""
    model, digest = season_model(settings.model, settings.airframe)
    if log.track.rotor_count > ROTORS:
        raise DataError(f"{log.track.rotor_count} rotors; the store has columns for {ROTORS}")
    if not np.any(log.track.flying):
        raise DataError(not_flown(log.track))
    analysis = analyse(log.track, model, claim=claim)
    sums, reason = _sums(analysis)
    identity, program = aircraft_identity(log, settings.aircraft), firmware(log)
    hardware, motors = board(log), layout(log)
    aircraft, of_verdict = identity.name, analysis_for_verdict(analysis)
    if settings.key is not None:
        aircraft = f"aircraft-{pseudonym(settings.key, aircraft)[:8]}"
        hardware = pseudonym(settings.key, hardware) if hardware else None
        of_verdict = anonymous(of_verdict, log, name)[0]
        analysis, log = anonymous(analysis, log, name)
    report = report_flight(of_verdict, log, max_utilisation=settings.max_utilisation)
    known = None if analysis.withheld else digest
    if reason is not None and settings.key is not None:
        reason = without_name(reason, file)
    started = log.track.start_unix_s
    summary = _summary(analysis, log, report) | {
        "flight": name,
        "aircraft_by": identity.by,
        "board": hardware,
        "layout": motors,
        "firmware": program,
        "model_digest": known,
        "sums_reason": reason,
    }
    damaged = report.verdict.level is FlightLevel.DAMAGED
    shown = with_bad_part(analysis) if damaged else analysis
    rows = {
        "time_s": log.track.time_s,
        "clock_s": log.track.time_s + log.clock_start_s,
        **({} if started is None else {"unix_s": log.track.time_s + started}),
        **analysis_columns(shown, slice(None)),
    }
    head = {"flight": name, "started_unix_s": started, "model_digest": known}
    kept = None if sums is None else head | {"arrays": array_cells(sums)}
    return SeasonFlight(aircraft=aircraft, summary=summary, rows=rows, sums=kept)


def _sums(analysis: FlightAnalysis) -> tuple[dict[str, np.ndarray] | None, str | None]:
    """What identification over many flights needs of this one, or why there is nothing."""
    if analysis.withheld:
        return None, "; ".join(analysis.withheld)
    try:
        flown = before_loss(analysis.track, loss_of_control(analysis.track))
        return to_arrays(flight_sums(analysis.model, measured_only(flown))), None
    except ThrustMarginError as error:
        return None, str(error)


def _summary(analysis: FlightAnalysis, log: FlightLog, report: FlightReport) -> dict[str, Any]:
    """The columns of `schema.FLIGHTS` that the report or the log knows."""
    track, verdict, flight = log.track, report.verdict, report.flight
    # What a prediction alone calls good is no margin of this flight; what it calls bad counts.
    no_ground = verdict.predicted_alone and verdict.level is FlightLevel.UNKNOWN
    worst, quality = None if no_ground else verdict.worst, report.quality
    withheld, airframe = bool(report.withheld), analysis.model.airframe
    use = analysis.utilisation if no_ground else analysis.known_utilisation
    use = np.where(track.flying[:, None], use, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = track.rotor_speed_rpm / analysis.prediction.rotor_speed_rpm
    ratio[~track.flying] = np.nan
    overall = report.accuracy.overall
    started_kg, used_kg = flight["tank_start_kg"], flight["liquid_used_kg"]
    ohm, ohm_error = battery_resistance(track.time_s, track.voltage, track.current, track.flying)
    nan = float("nan")
    return {
        "started_unix_s": track.start_unix_s,
        "log_format": log.format,
        "log_bytes": log.quality.bytes,
        "software": software_version(),
        "system_id": log.vehicle if log.vehicle and log.vehicles else None,
        "autopilot": log.autopilot,
        "airframe": None if withheld else airframe.name,
        "airframe_basis": report.airframe_basis,
        "rotor_count": track.rotor_count or None,
        "duration_s": track.duration,
        "flying_s": flight["airborne_s"],
        "distance_m": flight["distance"],
        "spraying_s": flight["spraying_s"],
        "sprayed_distance_m": flight["sprayed_distance"],
        "hectares": flight["sprayed_area"] / 1e4,
        "hectares_at_least": flight["sprayed_area_at_least"] / 1e4,
        "litres": used_kg / airframe.liquid_density,
        "tank_start_kg": started_kg,
        "tank_end_kg": flight["tank_end_kg"],
        "tank_error_kg": flight["tank_error_kg"],
        "tank_source": _words_of(track, "tank_kg"),
        "takeoff_mass_kg": airframe.empty_mass + started_kg,
        "speed_source": _words_of(track, "rotor_speed_rpm"),
        "airspeed_source": _words_of(track, "airspeed"),
        "verdict": verdict.level,
        "verdict_reason": _why_none(report, track, no_ground) or verdict.headline,
        "action": verdict.action or None,
        "limit": verdict.limit,
        "worst_margin": worst.margin if worst else nan,
        "worst_margin_low": 1.0 - worst.capacity_use_high if worst else nan,
        "worst_rotor": worst.rotor if worst else None,
        "worst_time_s": worst.time_s if worst else nan,
        "worst_doing": ", ".join(worst.doing) if worst else None,
        "mean_margin": 1.0 - known_mean(worst_rotor(use)[0]),
        "rows_above_limit_s": verdict.over_limit_s if worst else nan,
        "lasting_above_limit_s": verdict.lasting_over_limit_s if worst else nan,
        "measured_share": verdict.measured_share,
        "redundancy_min": verdict.redundancy_yaw_free_min,
        "not_survivable_s": verdict.not_survivable_s
        if np.isfinite(verdict.redundancy_yaw_free_min)
        else nan,
        "fill_kg": verdict.fill_kg,
        "fill_limit_kg": verdict.fill_limit_kg,
        "fill_low_kg": verdict.fill_low_kg,
        "margin_by_rotor": [1.0 - known_most(u) for u in use.T],
        "speed_ratio": [known_median(r) for r in ratio.T],
        "prediction_bias_rpm": overall.bias_rpm.value if overall else nan,
        "prediction_rmse_rpm": overall.rmse_rpm.value if overall else nan,
        "battery_ohm": ohm,
        "battery_ohm_error": ohm_error,
        **{name: flight[name] for name in REPORT_COLUMNS},
        "latitude_deg": track.origin.latitude_deg if track.origin else nan,
        "longitude_deg": track.origin.longitude_deg if track.origin else nan,
        "alarms": [str(alarm["words"]) for alarm in report.alarms],
        "notes": [
            *track.notes,
            *(f"{f.check}: {f.words}" for f in report_findings(report.findings)),
        ],
        "missing_channels": [c.name for c in log.channels if not c.samples],
        "unmeasured": list(log.unmeasured),
        **{name: quality[name] for name in QUALITY_COLUMNS},
    }


def _words_of(track: FlightTrack, channel: str) -> str | None:
    return track.source(channel).words if channel in track.sources else None


def _why_none(report: FlightReport, track: FlightTrack, no_ground: bool) -> str:
    """Why a flight has no verdict; empty where it has one."""
    if report.verdict.level is not FlightLevel.UNKNOWN:
        return ""
    if report.withheld or no_ground:
        return "; ".join(report.withheld) or PREDICTED_ALONE
    lacks = (("rotor_speed_rpm", "rotor speed"), ("tank_kg", "tank level"))
    missing = [words for name, words in lacks if not np.isfinite(getattr(track, name)).any()]
    return f"no {' and no '.join(missing)}" if missing else ""


#: Keys of the report that are columns of the store under the same name.
REPORT_COLUMNS = (
    *("voltage_start", "voltage_end", "voltage_min", "current_median"),
    *("airspeed_median", "ground_speed_median", "wind_speed_median"),
    *("height_agl_max", "density_median"),
)
QUALITY_COLUMNS = (
    *("bytes_skipped", "damaged_places", "frames_missing"),
    *("silences", "longest_silence_s", "clock_jumps"),
)
