"""Analysed flights and their logs to the numbers of a report: no files, no screen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.logs.findings import Finding, Spoils, report_findings
from thrustmargin.gcs_plugin.logs.log_answer import LogAnswer, answer_log
from thrustmargin.gcs_plugin.reports.margin import data, load
from thrustmargin.gcs_plugin.reports.margin.csv_rows import rows_of
from thrustmargin.gcs_plugin.reports.margin.events import (
    alarm_row,
    misread_row,
    said_rows,
    takeoff_rows,
    timeline_rows,
    yaw_rows,
)
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version, unix_text, utc_text
from thrustmargin.gcs_plugin.telemetry.recording import channel_values
from thrustmargin.gcs_plugin.wording import margin_verdict, report_words
from thrustmargin.gcs_plugin.wording.advice_words import action, several_headline
from thrustmargin.gcs_plugin.wording.aircraft_words import change_words
from thrustmargin.gcs_plugin.wording.check_words import (
    airframe_match_words,
    no_verdict_words,
    note_words,
    source_words,
    statement_words,
)
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_things
from thrustmargin.gcs_plugin.wording.fill_words import safe_kg
from thrustmargin.gcs_plugin.wording.flight_words import (
    NAMES_WRONG,
    activity_words,
    loss_words,
    not_flown,
    too_short,
)
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.report_words import (
    WITHOUT,
    contact_facts,
    first_line,
    prediction_checked,
)
from thrustmargin.mission.field import sprayed_field
from thrustmargin.models.checks.arms.arm_json import answer_json
from thrustmargin.models.effects.compose import EffectRecord
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.advice import LEAST_FLIGHT_S, Advice, FlightLevel
from thrustmargin.models.model.aircraft_change import AircraftChange
from thrustmargin.models.model.analysis import Basis, FlightAnalysis, SpeedBasis
from thrustmargin.models.model.inferred.load_inference import LOAD_FROM_SPEEDS
from thrustmargin.models.model.model_misfit import margin_check
from thrustmargin.models.model.prediction_error import prediction_error, trained_on
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.model.utilisation_peaks import (
    UtilisationPeak,
    airborne_use,
    utilisation_peaks,
)
from thrustmargin.models.physics.day import day_json
from thrustmargin.models.physics.margin import ceiling
from thrustmargin.models.physics.smoothing import known_least, known_median, known_most
from thrustmargin.models.scores import FEWEST_BLOCKS

if TYPE_CHECKING:
    from thrustmargin.mission.forecast.plan_flight import PlanConditions
    from thrustmargin.mission.plan_items import MissionPlan


def report_flight(
    analysis: FlightAnalysis,
    log: FlightLog,
    *,
    max_utilisation: float,
    plan: MissionPlan | None = None,
    assumed: PlanConditions | None = None,
    answer: LogAnswer | None = None,
) -> data.ReportedFlight:
    """Return the report of one flight.

    `max_utilisation` is the largest share of a rotor's maximum thrust that may be in use. The
    flight is compared with the forecast of `plan`, if given, under the conditions `assumed`.
    `answer` is the flight's assessment; None makes it here. Raises PlanError if the plan flies
    nowhere.
    """
    answer = answer or answer_log(log, analysis, max_utilisation)
    findings, contact = answer.findings, answer.contact
    advice, whole, analysis = answer.advice, answer.whole, answer.analysis
    track = analysis.track
    limits = ceiling(identified_airframe(analysis.model), analysis.density, track.voltage)
    rows = rows_of(
        analysis,
        fill_limit_kg=answer.fill_limit_kg,
        fill_one_rotor_out_kg=answer.fill_one_rotor_out_kg,
    )
    seconds = track.row_seconds
    peaks = utilisation_peaks(analysis)
    worst = peaks[0] if peaks else None
    basis, measured_share = _basis(answer)
    flown_s = whole.track.flying_s
    no_flight = not_flown(whole.track) or (too_short(flown_s) if flown_s < LEAST_FLIGHT_S else "")
    shown = margin_verdict.verdict_facts(worst, advice, analysis.airframe_match, basis, no_flight)
    check = None if analysis.no_verdict else margin_check(analysis)
    checked = prediction_checked(check, trained_on=trained_on(analysis)) if check else ""
    against = None
    if plan and not analysis.no_verdict:
        from thrustmargin.gcs_plugin.reports.margin.plan_comparison import plan_comparison

        against = plan_comparison(analysis, log, plan, assumed)
    lines = (
        *((("control", loss_words(advice.losses)),) if advice.losses else ()),
        *((("changed", change_words(advice.change)),) if advice.change else ()),
        *look_facts(findings),
        *(shown if contact is None or advice.level is not FlightLevel.UNKNOWN else ()),
        *(() if contact is None else contact_facts(contact)),
        *margin_verdict.voltage_facts(analysis),
        *(*margin_verdict.load_facts(track), *margin_verdict.unseen_facts(whole.track)),
        *((("prediction", checked),) if checked else ()),
        *((("plan", against["words"]),) if against else ()),
    )
    starts = takeoff_rows(whole)
    reported = said_rows(answer.statements, advice)
    json = {
        "name": track.name,
        "verdict": {
            "headline": first_line(advice, contact),
            "action": action(advice),
            "facts": [{"label": label, "text": text} for label, text in lines],
            "worst": worst and peak_row(worst, track.start_unix_s),
            "basis": basis,
            "speed_basis": analysis.speed_basis,
            "measured_share": measured_share,
            "above_limit_share": data.share(advice.use.above_limit_s, advice.use.known_s),
            "one_rotor_out_use": load.one_rotor_out_use(analysis.model.airframe),
            **advice_values(advice),
        },
        "flight": _flight(whole, rows["ground_speed"], seconds),
        "model": model_use(analysis),
        "load": load.load_rows(analysis, limits),
        "rotors": _rotors(analysis, seconds, max_utilisation),
        "moments": [peak_row(one, track.start_unix_s) for one in peaks],
        "losses": advice.losses,  # of control, in order of time; no row after counts
        "first_contact": contact,  # what a log of an aircraft that is not known shows
        "findings": findings,  # those of `inspect`, the gravest first
        "alarms": [alarm_row(one, advice.rotor_names) for one in advice.faults],
        "misread_speed": misread_row(advice.misread),
        "takeoff": starts,  # the run-ups before it lifted
        "vehicle_said": reported,  # reports of the vehicle, with what the log shows
        "notes": log.engineer_notes,
        "timeline": timeline_rows(starts, reported, log.engineer_notes, advice),
        "redundancy": {**load.redundancy_rows(analysis, rows, seconds), **yaw_rows(analysis)},
        "accuracy": error_row(analysis),
        "margin_check": check,  # thrust in use, predicted against measured
        "quality": _quality(log),
        "airframe_basis": analysis.airframe_match.basis,
        # empty where the airframe is known
        "no_verdict": no_verdict_words(analysis.airframe_match),
        "plan_comparison": against,  # with the forecast of its plan; None without a plan
    }
    return data.ReportedFlight(json=json, advice=advice, peaks=peaks, rows=rows)


def peak_row(peak: UtilisationPeak, start_unix_s: float | None) -> data.JsonObject:
    """Return a peak of thrust utilisation as a dict for JSON; rotors count from 1.

    `capacity_use` is the utilisation, `capacity_use_low` and `_high` its interval, `margin` 1 less
    it: shares. It has the time, s and UTC text, the rotor, what the aircraft was doing, its place,
    speeds and load, and the redundancy with yaw uncontrolled. `start_unix_s` is the Unix time of
    the flight's first row; if None, `clock_utc` is None.
    """
    row = {
        "time_s": peak.time_s,
        "clock_utc": None if start_unix_s is None else unix_text(start_unix_s + peak.time_s),
        "rotor": peak.rotor + 1,
        "rotor_name": peak.rotor_name,
        "capacity_use": peak.utilisation,
        "capacity_use_low": peak.utilisation_low,
        "capacity_use_high": peak.utilisation_high,
        "margin": peak.margin,
        "basis": peak.basis,
        "doing": [activity_words(one) for one in peak.activities],
    }
    as_named = (
        *("tank_kg", "ground_speed", "airspeed", "climb_rate", "height_agl", "north", "east"),
        *("latitude_deg", "longitude_deg"),
    )
    row |= {name: getattr(peak, name) for name in as_named}
    return row | {"redundancy_yaw_free": peak.redundancy_yaw_uncontrolled}


def look_facts(findings: Iterable[Finding]) -> Iterator[tuple[str, str]]:
    """Yield the findings on the log to display next to its verdict, those on rotor names first."""
    order = sorted(report_findings(findings), key=lambda one: one.spoils is not Spoils.ROTOR_NAMES)
    for one in order:
        if one.spoils is Spoils.ROTOR_NAMES:
            yield "rotor names", f"{NAMES_WRONG}{one.words}"
        else:
            yield one.check, one.words


def _basis(answer: LogAnswer) -> tuple[str, float]:
    """Return the source of the thrust utilisation in words, and the share of time with rotor
    speeds.

    That share is of the time in the air; speeds are measured or inferred from motor outputs.
    """
    analysis, seconds = answer.analysis, answer.analysis.track.row_seconds
    known = np.any(np.isfinite(airborne_use(analysis)), axis=1)
    measured_s = float(seconds[known & analysis.any_measured].sum())
    airborne_s = answer.advice.airborne_s
    words = margin_verdict.basis_words(
        analysis, measured_s, float(seconds[known].sum()), airborne_s
    )
    return words, data.share(measured_s, airborne_s)


#: Parts of a verdict that the report lists as rows of their own, and the rotors' names.
_AS_ROWS = ("faults", "repaired", "losses", "misread", "no_verdict", "rotor_names", "rotor_count")


def advice_values(advice: Advice) -> dict[str, Any]:
    """Return the figures of a flight's assessment as a dict for JSON, by their names in `Advice`.

    Arrays over the flight are left out, since the CSV has them, and so are fields that the report
    lists as rows. Rotors count from 1; `fill.kg` is rounded down, as pilots read it.
    """
    values = {f.name: getattr(advice, f.name) for f in fields(advice) if f.name not in _AS_ROWS}
    for part in ("use", "rotor_lost", "battery", "fill", "misfit"):
        whole = {f.name: getattr(values[part], f.name) for f in fields(values[part])}
        values[part] = {k: v for k, v in whole.items() if not isinstance(v, np.ndarray)}
    alone = advice.use.spent_alone
    values["use"]["spent_alone"] = None if alone is None else alone + 1
    values["arms"] = answer_json(advice.arms)
    values["fill"]["kg"] = safe_kg(advice.fill)
    values["fill"]["day"] = day_json(advice.fill.day)
    values["fill"]["fresh_day"] = day_json(advice.fill.fresh_day)
    values["change"] = None if advice.change is None else change_row(advice.change)
    return {"level": advice.level, **values}


def change_row(change: AircraftChange) -> data.JsonObject:
    """Return how a flight differs from earlier ones of its aircraft as a dict for JSON, with the
    fields of `AircraftChange` as keys.

    Rotors count from 1 (0-based in `change`).
    """
    row = to_json_values(change)
    for mode in row["modes"]:
        mode["faster"] = [rotor + 1 for rotor in mode["faster"]]
        mode["slower"] = [rotor + 1 for rotor in mode["slower"]]
    effects = row["explanation"]["effects"] if row["explanation"] else ()
    for one in (row["rotor"], *effects):
        if one is not None and one["rotor"] is not None:
            one["rotor"] += 1
    return row


def _flight(analysis: FlightAnalysis, speed: Floats, seconds: Floats) -> data.JsonObject:
    """Return time, distance, liquid, area, speeds, wind, air and voltage of a flight, for JSON.

    They are of the rows in flight, in SI unless the key has a unit; NaN where unknown. `speed` (T,)
    is over ground, m/s, `seconds` (T,) the duration of each row.
    """
    track = analysis.track
    flying = track.flying
    first, last = data.end_rows(track)
    tank = track.tank_kg[flying & np.isfinite(track.tank_kg)]
    start_kg, end_kg = (float(tank[0]), float(tank[-1])) if tank.size else (np.nan, np.nan)
    spraying = flying & (track.spraying > 0.5)
    knows_spraying = bool(np.any(np.isfinite(track.spraying[flying])))
    pump = np.where(flying, track.spraying, 0.0)
    sprayed = sprayed_field(track.time_s, track.position_ned, pump)
    area, whole = (sprayed.area, sprayed.whole) if sprayed else (np.nan, False)
    wind = track.wind_ned[flying & np.all(np.isfinite(track.wind_ned[:, :2]), axis=1), :2]
    wind_speed = np.hypot(wind[:, 0], wind[:, 1])
    mean_wind = wind.mean(axis=0) if wind.size else np.full(2, np.nan)
    return {
        "start_utc": unix_text(track.start_unix_s),
        "log_duration_s": track.duration,
        "airborne_s": float(seconds[flying].sum()),
        "distance": _path_length(speed, seconds, flying),  # at least, where speed is lost
        "distance_lost_s": _lost_s(speed, seconds, flying),
        "tank_start_kg": start_kg,
        "tank_end_kg": end_kg,
        "liquid_used_kg": start_kg - end_kg,
        "tank_source": source_words(track.source("tank_kg")),
        "tank_error_kg": known_median(track.standard_errors.get("tank_kg", np.empty(0))),
        "spraying_s": float(seconds[spraying].sum()) if knows_spraying else np.nan,
        "sprayed_distance": _path_length(speed, seconds, spraying) if knows_spraying else np.nan,
        "sprayed_distance_lost_s": _lost_s(speed, seconds, spraying),
        "swath_width": sprayed.swath_width if sprayed else np.nan,
        "sprayed_area": area if whole else np.nan,  # m²
        "sprayed_area_at_least": np.nan if whole else area,  # m², in its place of a part alone
        "sprayed_lost_s": sprayed.lost_s if sprayed else np.nan,
        "ground_speed_median": known_median(speed[flying]),
        "ground_speed_max": known_most(speed[flying]),
        "airspeed_median": known_median(track.airspeed[flying]),
        "airspeed_max": known_most(track.airspeed[flying]),
        "wind_speed_median": known_median(wind_speed),
        "wind_speed_max": known_most(wind_speed),
        "wind_from_deg": float(np.degrees(np.arctan2(-mean_wind[1], -mean_wind[0])) % 360.0),
        "height_agl_median": known_median(track.height_agl[flying]),
        "height_agl_max": known_most(track.height_agl[flying]),
        "altitude_median": known_median(track.altitude[flying]),
        "density_median": known_median(analysis.density[flying]),  # kg/m³
        "density_error": known_median(analysis.density_error[flying]),  # kg/m³, standard error
        "density_basis": statement_words(analysis.density_basis),
        "voltage_start": known_median(track.voltage[first]),
        "voltage_end": known_median(track.voltage[last]),
        "voltage_min": known_least(track.voltage[flying]),
        "voltage_basis": statement_words(analysis.voltage_basis),
        "current_median": known_median(track.current[flying]),
    }


def _path_length(speed: Floats, seconds: Floats, rows: Bools) -> float:
    """Return the length, m, of the path over the flagged rows (T,), from ground speed (T,), m/s,
    and row durations (T,), s; NaN if the speed is unknown in all of them."""
    known = rows & np.isfinite(speed)
    if np.any(rows) and not np.any(known):
        return float("nan")
    return float(np.sum(speed[known] * seconds[known]))


def _lost_s(speed: Floats, seconds: Floats, rows: Bools) -> float:
    """Return the total duration, s, of the flagged rows (T,) without a known ground speed."""
    return float(np.sum(seconds[rows & ~np.isfinite(speed)]))


def _rotors(analysis: FlightAnalysis, seconds: Floats, limit: float) -> tuple[data.JsonObject, ...]:
    """Return a dict for each rotor: `rotor` (from 1), `name`, and its thrust utilisation in flight,
    a share.

    `measured_max`, `measured_median`, `predicted_max` and `predicted_median` are over the rows in
    flight. `over_limit_share` is the share of the time with known utilisation in which that is
    above `limit`, also a share. `seconds` (T,) is the duration of each row. Unknown values are NaN.
    """
    flying, use = analysis.track.flying, airborne_use(analysis)
    measured, predicted = analysis.utilisation[flying], analysis.utilisation_predicted[flying]
    known_s = seconds @ np.isfinite(use)
    over_s = seconds @ (use > limit)
    return tuple(
        {
            "rotor": k + 1,
            "name": name,
            "measured_max": known_most(measured[:, k]),
            "measured_median": known_median(measured[:, k]),
            "predicted_max": known_most(predicted[:, k]),
            "predicted_median": known_median(predicted[:, k]),
            "over_limit_share": data.share(float(over_s[k]), float(known_s[k])),
        }
        for k, name in enumerate(analysis.places)
    )


def model_use(analysis: FlightAnalysis) -> data.JsonObject:
    """Return airframe, model and its effects as a dict for JSON.

    `network_share`, `physics_share` and `none_share` are the shares of rows in flight predicted by
    network, by physics, and not at all; NaN without such rows. `inside_envelope` is True if the
    network predicted all; None without a network. `model` is "none" without a verdict. `empty_mass`
    is kg.
    """
    model, airframe = analysis.model, analysis.model.airframe
    basis = analysis.prediction.basis[analysis.track.flying]
    shares = {b: float(np.mean(basis == b)) if basis.size else np.nan for b in Basis}
    inside = shares[Basis.NETWORK] == 1.0
    return {
        "airframe": airframe.name,
        "airframe_title": airframe.title,
        "airframe_words": airframe_match_words(analysis.airframe_match),
        "rotor_count": airframe.rotor_count,
        "rotor_names": analysis.places,
        "empty_mass": airframe.empty_mass,
        "tank_capacity_kg": airframe.tank_capacity_kg,
        "model": "none" if analysis.no_verdict else model.description,
        "model_words": (*model_words(model), *_kinds_of_speed(analysis)),
        "network_share": shares[Basis.NETWORK],
        "physics_share": shares[Basis.PHYSICS],
        "none_share": shares[Basis.NONE],
        "inside_envelope": None if model.network is None else inside,
        "effects": tuple(_effect(e) for e in model.effects),
        "effect_words": effect_things(model),
    }


def _kinds_of_speed(analysis: FlightAnalysis) -> tuple[str, ...]:
    """Return a note if the model was trained on another kind of rotor speed than this flight
    has."""
    training, here = analysis.model.training, analysis.speed_basis
    if training is None or training.speed == here or not analysis.any_measured.any():
        return ()
    return (report_words.other_kind(training.speed, here),)


def model_words(model: RotorModel) -> list[str]:
    """Return sentences on a model's training domain and interval; a missing one is left out."""
    text = []
    if model.training_domain is not None:
        covers = model.training_domain
        text.append(report_words.trained_at(covers.airspeed, covers.tank_kg, covers.density))
    if model.interval is not None:
        text.append(report_words.interval_made(model.interval.coverage, model.interval.flights))
    return text


def _effect(effect: EffectRecord) -> str:
    where = "" if effect.rotor is None else f" of rotor {effect.rotor}"
    values = ", ".join(f"{name} {p.value:.4g} {p.unit}" for name, p in effect.parameters.items())
    return f"{effect.name}{where} ({values})"


def error_row(analysis: FlightAnalysis) -> data.JsonObject:
    """Return the error of predicted rotor speeds in a flight as a dict for JSON: the fields of
    `PredictionError` (`overall`, `rotors`, ...) and `words`.

    `words` explains the intervals, or says why there are none, or why there is no error (`overall`
    None); it begins with a note if the model was trained on the flight.
    """
    found = prediction_error(analysis, analysis.places)
    if found.overall is None:
        text = _without_error(analysis)
    elif found.blocks >= FEWEST_BLOCKS:
        text = report_words.in_brackets(found.confidence, found.blocks, found.block_s)
    else:
        text = report_words.no_intervals(found.blocks, FEWEST_BLOCKS, found.block_s)
    if found.overall is not None and found.trained_on:
        text = f"{say(report_words.TRAINED_ON)} {text}"
    return {**{f.name: getattr(found, f.name) for f in fields(found)}, "words": text}


def _without_error(analysis: FlightAnalysis) -> str:
    """Return why the predicted rotor speeds of a flight cannot be compared with measured ones.

    The first of: speeds by motor outputs only, no speeds, no prediction, a load inferred from the
    speeds; else that no row has both.
    """
    known = np.isfinite(analysis.track.rotor_speed_rpm)
    measured = known & ~analysis.from_outputs
    predicted = np.isfinite(analysis.prediction.rotor_speed_rpm)
    if known.any() and not measured.any():
        return report_words.not_measured(SpeedBasis.MOTOR_OUTPUTS)
    if not known.any():
        return report_words.NO_SPEEDS
    if not predicted.any():
        return report_words.NO_PREDICTION
    if not np.isfinite(analysis.track.measured("tank_kg")).any():
        return report_words.no_error(LOAD_FROM_SPEEDS)
    return report_words.NO_ROW_OF_BOTH


def _quality(log: FlightLog) -> data.JsonObject:
    """Return format, damage, gaps, channels and messages of a log as a dict for JSON.

    Damage is counted in frames or places, but `bytes` and `bytes_skipped`. A silence is a gap of
    all messages longer than 1 s; `longest_silence_s` is 0 without one. `missing` are texts on
    missing channels, `notes` are assumptions made in reading.
    """
    track, whole = log.track, log.quality
    counted = ("bytes", "frames", "bytes_skipped", "damaged_places", "bad_checksum")
    return {
        **{name: getattr(log, name) for name in ("format", "autopilot", "vehicle", "vehicles")},
        **{name: getattr(whole, name) for name in counted},
        "unknown_frames": sum(whole.unknown_ids.values()),
        "frames_missing": whole.frames_missing,
        "clock_jumps": len(whole.clock_jumps),
        "silences": len(log.silences),
        "longest_silence_s": max((float(length) for _, length in log.silences), default=0.0),
        "channels": tuple(map(channel_values, log.channels)),
        "missing": tuple(text for name, text in WITHOUT.items() if not track.reports(name)),
        "notes": tuple(note_words(track)),
        "messages": log.messages,
    }


def build_report(
    flights: Iterable[tuple[FlightAnalysis, FlightLog]],
    *,
    max_utilisation: float = 0.5,
    unread: Iterable[UnusedLog] = (),
    plan: MissionPlan | None = None,
    assumed: PlanConditions | None = None,
) -> data.Report:
    """Build the report on flights, in their order.

    `max_utilisation` is the largest share of a rotor's maximum thrust that may be in use. Each
    flight is compared with the forecast of `plan`, if given, under the conditions `assumed`, or if
    None under the conditions before take-off. `unread` are logs that could not be read, to be
    listed. Raises DataError if the share is not between 0 and 1, or there is no flight.
    """
    if not 0.0 < max_utilisation < 1.0:
        raise DataError(f"max_utilisation {max_utilisation:g} is no share; give one such as 0.5")
    reports = tuple(
        report_flight(analysis, log, max_utilisation=max_utilisation, plan=plan, assumed=assumed)
        for analysis, log in flights
    )
    if not reports:
        raise DataError("no flight to report on; give at least one log that can be read")
    return data.Report(
        made_utc=utc_text(),
        version=software_version(),
        max_utilisation=max_utilisation,
        overview=overview_of(reports, max_utilisation),
        flights=reports,
        unread=tuple(unread),
    )


def overview_of(reports: Sequence[data.ReportedFlight], limit: float) -> data.JsonObject:
    """Return level and headline of all flights together, and the number of flights of each level.

    `worst_flight` is the number, from 1, of the worst one; None if its utilisation is unknown.
    """
    levels = [report.advice.level for report in reports]
    first, report = worst_first(reports)[0]
    level, words = report.advice.level, report.json["verdict"]["headline"]
    if len(levels) > 1:
        level, words = several_headline(levels, limit)
    return {
        "level": level,
        "headline": words,
        "worst_flight": first + 1 if report.peaks else None,
        **{one.value: levels.count(one) for one in FlightLevel},
    }


def worst_first(reports: Sequence[data.ReportedFlight]) -> list[tuple[int, data.ReportedFlight]]:
    """Return (index in `reports`, report), the flight with the gravest level first.

    Of equal levels the flight with the largest utilisation comes first, one without a known
    utilisation last.
    """

    def rank(item: tuple[int, data.ReportedFlight]) -> tuple[int, float]:
        level, worst = item[1].advice.level, item[1].worst
        return level.gravity, 1.0 if worst is None else -worst.utilisation

    return sorted(enumerate(reports), key=rank)
