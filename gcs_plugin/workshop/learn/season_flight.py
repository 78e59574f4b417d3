"""Turn one log into the flights that the season's store keeps, in a process of `learn`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.commands.shared.anonymous import anonymous, pseudonym
from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    ReadingOptions,
    chosen_model,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.stored_answer import answer_columns, stored_answer
from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.logs.findings import report_findings
from thrustmargin.gcs_plugin.logs.log_answer import answer_log, matched_flights
from thrustmargin.gcs_plugin.reports.margin import ReportedFlight, report_flight
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of
from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, Hangar, KnownAircraft
from thrustmargin.gcs_plugin.store.ingest_run import LogSource, local_file, store_flights
from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight
from thrustmargin.gcs_plugin.store.schema import ROTORS, analysis_columns
from thrustmargin.gcs_plugin.store.season_store import (
    SeasonStore,
    aircraft_identity,
    array_cells,
    firmware,
)
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, drop_flight, stage
from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
from thrustmargin.gcs_plugin.wording.check_words import in_english, note_words
from thrustmargin.gcs_plugin.wording.flight_words import not_flown
from thrustmargin.gcs_plugin.wording.language import clean, speaking
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.errors import DataError, ThrustMarginError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.season.flight_sums import flight_sums, to_arrays
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import (
    FlightAnalysis,
    analyse,
    analysis_for_verdict,
    with_bad_part,
    worst_rotor,
)
from thrustmargin.models.model.inferred.speed_basis import measured_only
from thrustmargin.models.model.model_file import model_digest
from thrustmargin.models.model.rotor_model import RotorModel, without_state
from thrustmargin.models.physics.known_battery import battery_resistance
from thrustmargin.models.physics.smoothing import known_mean, known_median, known_most

#: Seconds for which a landed flight waits for another writer of the season's store.
WAIT_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class IngestSettings:
    """The settings of one run of `learn --store`, in values that another machine can use."""

    store: str
    model: str | None = None
    airframe: str | None = None
    aircraft: str | None = None
    reading: ReadingOptions = AS_HEARD
    max_utilisation: float = 0.5
    key: str | None = None  # secret of the pseudonyms; None: names and places are kept


@lru_cache(maxsize=4)
def season_model(model: str | None, airframe: str | None) -> tuple[RotorModel, str]:
    """Return the rotor speed model that a store's flights are analysed with, and its digest.

    `model` and `airframe` are those of the options.
    """
    chosen = chosen_model(None if model is None else Path(model), airframe)
    return chosen, model_digest(chosen)


def stage_log(log: LogSource, content: str, *, settings: IngestSettings) -> list[str]:
    """Read a log, write its flights to the store's staging area, and return the flights' names.

    `content` is the log's digest, which begins each name: a log has a flight for each vehicle and
    sortie. The flight named by the digest alone is staged last, because its presence marks the log
    as stored. Raises ThrustMarginError for a log without a flight.
    """
    from threadpoolctl import threadpool_limits

    store = SeasonStore.open(settings.store)
    # One thread: each core reads a log of its own, and sums are reproducible on other machines.
    with threadpool_limits(1), local_file(log.path) as path:
        flights = season_flights(path, content, settings, name=log.name)
    for flight in reversed(flights):
        stage(store, flight)
    return [flight.summary["flight"] for flight in flights]


def season_flights(
    path: Path, content: str, settings: IngestSettings, *, name: str
) -> list[SeasonFlight]:
    """Return the flights in the log at `path`: all sorties, of all vehicles unless one is chosen.

    `content` is the log's digest; `name` is what the store calls the log. Vehicles without a flight
    are listed in the first flight. Raises ThrustMarginError if the first vehicle has no flight.
    """
    found, log = _sortie_flights(path, content, settings, settings.reading, name=name)
    first = found[0]
    alone = settings.reading.vehicle is not None
    for other in () if alone else (v for v in log.vehicles if v != log.vehicle):
        reading = replace(settings.reading, vehicle=other)
        try:
            found += _sortie_flights(path, f"{content}-{other}", settings, reading, name=name)[0]
        except ThrustMarginError as error:  # often a camera or an antenna tracker
            del error  # its words would be those of one language
            first.summary["no_flight_of"].append(other)
    return found


def _sortie_flights(
    path: Path, content: str, settings: IngestSettings, reading: ReadingOptions, *, name: str
) -> tuple[list[SeasonFlight], FlightLog]:
    """Return the flights of one vehicle's sorties, and the log of the first sortie.

    The first flight is named `content`, the other flights `content` with the sortie's number
    appended. `name` is the log's name in the store, left out in an anonymous store.
    """
    model, _ = season_model(settings.model, settings.airframe)
    given = settings.model is not None or settings.airframe is not None
    read = matched_flights(path, model, given=given, **reading_keywords(reading))
    found = []
    for log, airframe_match in read:
        flight = content if log.sortie == 1 else f"{content}-sortie-{log.sortie}"
        made = flight_of_log(log, airframe_match, flight, settings)
        shown = None if settings.key is not None else f"{clean(name)}{log.sortie_suffix}"
        made.summary["log_name"] = shown
        found.append(made)
    return found, read[0][0]


def flight_of_log(
    log: FlightLog, airframe_match: AirframeMatch, name: str, settings: IngestSettings
) -> SeasonFlight:
    """Analyse one sortie with the model of `settings` and return its flight for the store.

    `name` is the flight's name there. Raises DataError if the sortie has no row in flight, or more
    rotors than the store has columns for.
    """
    model, digest = season_model(settings.model, settings.airframe)
    _check_rows(log)
    analysis = analyse(log.track, model, airframe_match=airframe_match)
    return stored_flight(log, analysis, name, settings, digest=digest)


def flight_of_known(flight: LearntFlight, log: FlightLog, aircraft: KnownAircraft) -> SeasonFlight:
    """Return a known aircraft's flight for the store, with its effect on the aircraft's state.

    Margins are by the model in the state before the flight. The sums for identification are by the
    model as trained, so that a season shows the changes that the state adapts to. Raises DataError
    if the flight has no row in flight, or too many rotors.
    """
    _check_rows(log)
    settings = IngestSettings(store="", aircraft=aircraft.name, max_utilisation=flight.advice.limit)
    digest = model_digest(aircraft.model())
    made = stored_flight(log, flight.analysis, flight.row.flight, settings, digest=digest)
    made.summary.update(learnt_columns(flight.row), log_name=clean(flight.row.log_name))
    return made


def _check_rows(log: FlightLog) -> None:
    """Raise DataError if a flight has no row in flight, or too many rotors for the store."""
    if log.track.rotor_count > ROTORS:
        raise DataError(f"{log.track.rotor_count} rotors; the store has columns for {ROTORS}")
    if not np.any(log.track.flying):
        raise DataError(not_flown(log.track))


def stored_flight(
    log: FlightLog, analysis: FlightAnalysis, name: str, settings: IngestSettings, *, digest: str
) -> SeasonFlight:
    """Return an analysed flight as the store's row of `flights`, its 10 Hz rows and its sums.

    `name` is the flight's name, `digest` that of the model that `analysis` used. With a key in
    `settings`, names, serial numbers and places are replaced by pseudonyms.
    """
    sums, reason = _sums(analysis)
    identity, program = aircraft_identity(log, settings.aircraft), firmware(log)
    marks = marks_of(log)
    hardware, motors = marks.board or None, marks.layout or None
    aircraft, of_verdict = identity.name, analysis_for_verdict(analysis)
    if settings.key is not None:
        aircraft = f"aircraft-{pseudonym(settings.key, aircraft)[:8]}"
        hardware = pseudonym(settings.key, hardware) if hardware else None
        of_verdict = anonymous(of_verdict, log, name)[0]
        analysis, log = anonymous(analysis, log, name)
    limit = settings.max_utilisation
    answer = answer_log(log, of_verdict, limit)
    report = report_flight(of_verdict, log, max_utilisation=limit, answer=answer)
    known = None if analysis.no_verdict else digest
    started = log.track.start_unix_s
    worst = report.worst
    kept_answer = stored_answer(
        answer.advice,
        answer.analysis.airframe_match,
        answer.analysis.track,
        worst and worst.time_s,
    )
    summary = (
        _summary(analysis, log, report)
        | answer_columns(kept_answer)
        | {
            "flight": name,
            "aircraft_by": identity.by,
            "board": hardware,
            "layout": motors,
            "firmware": program,
            "model_digest": known,
            "sums_reason": reason,
        }
    )
    damaged = report.advice.level is FlightLevel.DAMAGED
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
    """Return (sums, None): sums over a flight's rows, as named arrays, from which effects are
    identified.

    Where they cannot be computed, return (None, reason), "no_verdict" or "no_evidence".
    """
    if analysis.no_verdict:
        return None, "no_verdict"
    try:
        flown = before_loss(analysis.track, loss_of_control(analysis.track))
        return to_arrays(flight_sums(without_state(analysis.model), measured_only(flown))), None
    except ThrustMarginError:
        return None, "no_evidence"


def _summary(analysis: FlightAnalysis, log: FlightLog, report: ReportedFlight) -> dict[str, Any]:
    """Return the flight's values for the columns `schema.FLIGHTS`, by name.

    Units are in the names; unknown numbers are NaN, or None for texts and counts. `analysis` uses
    the load of the whole flight, `report` the load that the verdict is based on. A good margin that
    rests on a prediction alone is unknown; a bad one is kept.
    """
    track, verdict, flight = log.track, report.json["verdict"], report.json["flight"]
    advice = report.advice
    # A good margin that only a prediction supports is not stored; a bad one is.
    no_ground = advice.predicted_alone and advice.level is FlightLevel.UNKNOWN
    worst, quality = None if no_ground else report.worst, report.json["quality"]
    no_verdict, airframe = bool(report.json["no_verdict"]), analysis.model.airframe
    use = analysis.utilisation if no_ground else analysis.known_utilisation
    use = np.where(track.flying[:, None], use, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = track.rotor_speed_rpm / analysis.prediction.rotor_speed_rpm
    ratio[~track.flying] = np.nan
    overall = report.json["accuracy"]["overall"]
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
        "airframe": None if no_verdict else airframe.name,
        "airframe_basis": report.json["airframe_basis"],
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
        "takeoff_mass_kg": airframe.empty_mass + started_kg,
        "verdict": advice.level,
        "limit": advice.limit,
        "worst_margin": worst.margin if worst else nan,
        "worst_margin_low": 1.0 - worst.utilisation_high if worst else nan,
        "worst_rotor": worst.rotor + 1 if worst else None,
        "worst_time_s": worst.time_s if worst else nan,
        "mean_margin": 1.0 - known_mean(worst_rotor(use)[0]),
        "rows_above_limit_s": advice.use.above_limit_s if worst else nan,
        "lasting_above_limit_s": advice.use.lasting_above_limit_s if worst else nan,
        "measured_share": verdict["measured_share"],
        "redundancy_min": advice.rotor_lost.redundancy_min,
        "not_survivable_s": advice.rotor_lost.not_survivable_s
        if np.isfinite(advice.rotor_lost.redundancy_min)
        else nan,
        "fill_kg": verdict["fill"]["kg"],
        "fill_limit_kg": advice.fill.limit_kg,
        "fill_low_kg": advice.fill.low_kg,
        "margin_by_rotor": [1.0 - known_most(u) for u in use.T],
        "speed_ratio": [known_median(r) for r in ratio.T],
        "prediction_bias_rpm": overall.bias_rpm.value if overall else nan,
        "prediction_rmse_rpm": overall.rmse_rpm.value if overall else nan,
        "battery_ohm": ohm,
        "battery_ohm_error": ohm_error,
        **{name: flight[name] for name in REPORT_COLUMNS},
        "latitude_deg": track.origin.latitude_deg if track.origin else nan,
        "longitude_deg": track.origin.longitude_deg if track.origin else nan,
        "notes": _notes(track),
        "findings": _findings_json(report),
        "no_flight_of": [],
        "missing_channels": [c.name for c in log.channels if not c.samples],
        "unmeasured": list(map(in_english, log.unmeasured)),
        **{name: quality[name] for name in QUALITY_COLUMNS},
    }


def keep_flights(
    flights: Sequence[tuple[LearntFlight, FlightLog]], aircraft: KnownAircraft, hangar: Hangar
) -> None:
    """Write flights of a known aircraft to the season's store in the folder of the hangar.

    Flights without a row in flight, or with more rotors than the store has columns for, are left
    out. Raises DataError if the store cannot be written.
    """
    made = []
    for flight, log in flights:
        if log.track.rotor_count <= ROTORS and np.any(log.track.flying):
            made.append(flight_of_known(flight, log, aircraft))
    store_flights(SeasonStore.open(str(hangar.folder)), made, wait_s=WAIT_S)


def forget_flight(flight: str, hangar: Hangar) -> None:
    """Remove a flight from the season's store. Raises DataError where another process writes."""
    store = SeasonStore.open(str(hangar.folder))
    if store.keys("flights"):
        with writer_lock(store, wait_s=WAIT_S):
            drop_flight(store, flight)


#: Fields of a row that are lists in the store.
WHOLE_LISTS = ("fault_kinds", "fault_rotors", "caveats", "suspects", "bad_arms")


def learnt_columns(row: AircraftFlight) -> dict[str, Any]:
    """Return the fields of a known aircraft's flight as columns of `schema.FLIGHTS`, nested ones as
    JSON."""
    values = {field.name: getattr(row, field.name) for field in fields(row)}
    return {
        name: json.dumps(to_json_values(value)) if is_dataclass(value) else value
        for name, value in values.items()
    } | {name: list(values[name]) for name in WHOLE_LISTS}


def _notes(track: FlightTrack) -> list[str]:
    """Return the notes of a track in English, because a store has readers of every language."""
    with speaking("en"):
        return note_words(track)


def _findings_json(report: ReportedFlight) -> str:
    """Return the report's findings as JSON, without their words."""
    kept = ("check", "level", "time_s", "values", "spoils")
    found = report_findings(report.json["findings"])
    return json.dumps([to_json_values({k: getattr(f, k) for k in kept}) for f in found])


#: Keys of the report that are columns of the store by the same names.
REPORT_COLUMNS = (
    *("voltage_start", "voltage_end", "voltage_min", "current_median"),
    *("airspeed_median", "ground_speed_median", "wind_speed_median"),
    *("height_agl_max", "density_median"),
)
QUALITY_COLUMNS = (
    *("bytes_skipped", "damaged_places", "frames_missing"),
    *("silences", "longest_silence_s", "clock_jumps"),
)
