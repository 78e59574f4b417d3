"""Analysed flights and their logs to the numbers of a report: no files, no screen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import get_args

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.logs.findings import Spoils
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.reports.margin.accuracy import accuracy, model_use
from thrustmargin.gcs_plugin.reports.margin.csv_rows import rows_of
from thrustmargin.gcs_plugin.reports.margin.data import (
    FlightReport,
    JsonObject,
    Overview,
    Report,
    end_rows,
    least,
    median,
    most,
    share,
)
from thrustmargin.gcs_plugin.reports.margin.fill_limit_rows import (
    fills,
    one_rotor_out_use,
    redundancy_rows,
)
from thrustmargin.gcs_plugin.reports.margin.first_contact import first_contact
from thrustmargin.gcs_plugin.reports.margin.load import load_rows
from thrustmargin.gcs_plugin.reports.margin.moments import (
    airborne_use,
    alarm_facts,
    alarm_row,
    look_facts,
    suspected,
    utc_words,
    worst_moments,
)
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.wording.flight_words import (
    LEAST_FLIGHT_S,
    loss_words,
    lost_headline,
    not_flown,
    too_short,
)
from thrustmargin.gcs_plugin.wording.margin_verdict import (
    Fact,
    Level,
    MarginVerdict,
    Moment,
    basis_words,
    ending_facts,
    ends_in_flight,
    facts,
    gravity,
    headline,
    load_facts,
    several_headline,
)
from thrustmargin.gcs_plugin.wording.report_words import WITHOUT, contact_facts, contact_headline
from thrustmargin.mission.field import sprayed_field
from thrustmargin.models.checks.loss_of_control import (
    LossOfControl,
    before_loss,
    loss_of_control,
)
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, for_verdict
from thrustmargin.models.model.fill_limits import full_at_once
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.predict import flown_airframe
from thrustmargin.models.model.rotor_faults import fault_episodes, fault_history
from thrustmargin.models.physics.margin import ceiling, largest_fill


def report_flight(
    analysis: FlightAnalysis, log: FlightLog, *, max_utilisation: float
) -> FlightReport:
    """Everything that the report says about one flight.

    `max_utilisation` is the largest share of a rotor's maximum thrust that may be in use.
    """
    limit, whole = max_utilisation, for_verdict(analysis)
    losses = loss_of_control(whole.track)
    analysis = replace(whole, track=before_loss(whole.track, losses))
    track, airframe = analysis.track, analysis.model.airframe
    as_flown = flown_airframe(analysis.model)
    limits = ceiling(as_flown, analysis.density, track.voltage)
    rows = rows_of(
        analysis,
        fill_limit_kg=largest_fill(as_flown, limits, limit=limit),
        fill_one_rotor_out_kg=largest_fill(as_flown, limits, criterion="yaw uncontrolled"),
    )
    seconds = track.row_seconds
    moments = worst_moments(analysis, airframe.rotor_names)
    verdict = replace(
        _verdict(analysis, losses, limit, moments[0] if moments else None),
        **fills(analysis, as_flown, rows),
    )
    contact = first_contact(log, analysis.claim)
    if contact is not None and verdict.level == "unknown":
        verdict = replace(verdict, headline=contact_headline(contact))
    alarms = fault_episodes(fault_history(analysis))
    found = inspect_log(log, airframe, analysis.claim).findings
    names_known = all(one.spoils is not Spoils.ROTOR_NAMES for one in found)
    answer = facts(
        verdict,
        analysis.claim,
        _no_flight(whole.track),
        full_at_once=full_at_once(as_flown),
        suspects=suspected(alarms, 0 if names_known else track.rotor_count),
    )
    if contact is not None:
        answer = contact_facts(contact)
    said = (
        *((Fact("control", loss_words(losses)),) if losses else ()),
        *look_facts(found),
        *alarm_facts(alarms, names_known=names_known),
        *answer,
        *(*load_facts(track), *ending_facts(whole.track)),
    )
    return FlightReport(
        name=track.name,
        verdict=replace(verdict, facts=said),
        flight=_flight(whole, rows["ground_speed"], seconds),
        model=model_use(analysis),
        load=load_rows(analysis, limits),
        rotors=_rotors(analysis, seconds, limit),
        moments=moments,
        losses=losses,
        first_contact=contact,
        findings=found,
        alarms=tuple(map(alarm_row, alarms)),
        redundancy=redundancy_rows(analysis, rows, seconds),
        accuracy=accuracy(analysis, airframe.rotor_names),
        quality=_quality(log),
        airframe_basis=analysis.claim.basis,
        withheld=analysis.withheld,
        rows=rows,
    )


def flight_verdict(analysis: FlightAnalysis, *, max_utilisation: float) -> MarginVerdict:
    """The report's verdict of one flight, without its worst moment, fills and facts."""
    analysis = for_verdict(analysis)
    losses = loss_of_control(analysis.track)
    until = replace(analysis, track=before_loss(analysis.track, losses))
    return _verdict(until, losses, max_utilisation, None)


def _no_flight(track: FlightTrack) -> str:
    """Why there is no flight to check; empty where there is one."""
    seconds = float(track.row_seconds[track.flying].sum())
    return not_flown(track) or (too_short(seconds) if seconds < LEAST_FLIGHT_S else "")


def _verdict(
    analysis: FlightAnalysis,
    losses: tuple[LossOfControl, ...],
    limit: float,
    worst: Moment | None,
) -> MarginVerdict:
    """All of it but its facts, of the rows before the `losses` of control."""
    track, seconds = analysis.track, analysis.track.row_seconds
    known = np.any(np.isfinite(airborne_use(analysis)), axis=1)
    airborne_s = float(seconds[track.flying].sum())
    known_s = float(seconds[known].sum())
    measured_s = float(seconds[known & analysis.any_measured].sum())
    over_s = float(seconds[analysis.above_limit(limit)].sum())
    free = analysis.redundancy_yaw_uncontrolled[track.flying]
    reach = np.exp(INTERVAL * analysis.redundancy_error[track.flying])
    lost_s = float(seconds[track.flying][free < 1.0].sum())
    level: Level = "unknown"
    if losses:
        level = "lost"
    elif np.any(known) and not _no_flight(track):
        level = "under"
        if np.any(analysis.maybe_above(limit)) or np.any(free / reach < 1.0):
            level = "near"
        if np.any(analysis.surely_above(limit)):
            level = "over"
        if np.any(free * reach < 1.0):
            level = "critical"
    return MarginVerdict(
        level=level,
        headline=lost_headline(losses)
        if losses
        else headline(
            level, limit, lost_s, share(over_s, known_s), ends_in_flight=ends_in_flight(track)
        ),
        facts=(),
        limit=limit,
        one_rotor_out_use=one_rotor_out_use(analysis.model.airframe),
        worst=worst,
        basis=basis_words(analysis, measured_s, known_s, airborne_s),
        speed_basis=analysis.speed_basis,
        measured_share=share(measured_s, airborne_s),
        over_limit_s=over_s,
        over_limit_share=share(over_s, known_s),
        redundancy_yaw_free_min=least(free),
        redundancy_yaw_free_low=least(free / reach),
        redundancy_yaw_free_high=least(free * reach),
        not_survivable_s=lost_s,
    )


def _flight(analysis: FlightAnalysis, speed: Floats, seconds: Floats) -> JsonObject:
    """The flight in a dozen figures, of its airborne rows; `speed` (T,) is over ground, m/s."""
    track = analysis.track
    flying = track.flying
    first, last = end_rows(track)
    tank = track.tank_kg[flying & np.isfinite(track.tank_kg)]
    start_kg, end_kg = (float(tank[0]), float(tank[-1])) if tank.size else (np.nan, np.nan)
    spraying = flying & (track.spraying > 0.5)
    knows_spraying = bool(np.any(np.isfinite(track.spraying[flying])))
    sprayed = sprayed_field(track.position_ned, np.where(flying, track.spraying, np.nan))
    wind = track.wind_ned[flying & np.all(np.isfinite(track.wind_ned[:, :2]), axis=1), :2]
    wind_speed = np.hypot(wind[:, 0], wind[:, 1])
    mean_wind = wind.mean(axis=0) if wind.size else np.full(2, np.nan)
    return {
        "start_utc": utc_words(track.start_unix_s, 0.0),
        "log_duration_s": track.duration,
        "airborne_s": float(seconds[flying].sum()),
        "distance": _path_length(speed, seconds, flying),
        "tank_start_kg": start_kg,
        "tank_end_kg": end_kg,
        "liquid_used_kg": start_kg - end_kg,
        "tank_source": track.source("tank_kg").words,
        "tank_error_kg": median(track.standard_errors.get("tank_kg", np.empty(0))),
        "spraying_s": float(seconds[spraying].sum()) if knows_spraying else np.nan,
        "sprayed_distance": _path_length(speed, seconds, spraying) if knows_spraying else np.nan,
        "swath_width": sprayed.swath_width if sprayed else np.nan,
        "sprayed_area": sprayed.area if sprayed else np.nan,  # m²
        "ground_speed_median": median(speed[flying]),
        "ground_speed_max": most(speed[flying]),
        "airspeed_median": median(track.airspeed[flying]),
        "airspeed_max": most(track.airspeed[flying]),
        "wind_speed_median": median(wind_speed),
        "wind_speed_max": most(wind_speed),
        "wind_from_deg": float(np.degrees(np.arctan2(-mean_wind[1], -mean_wind[0])) % 360.0),
        "height_agl_median": median(track.height_agl[flying]),
        "height_agl_max": most(track.height_agl[flying]),
        "altitude_median": median(track.altitude[flying]),
        "density_median": median(analysis.density[flying]),  # kg/m³
        "density_error": median(analysis.density_error[flying]),  # kg/m³, standard error
        "density_basis": analysis.density_basis,
        "voltage_start": median(track.voltage[first]),
        "voltage_end": median(track.voltage[last]),
        "voltage_min": least(track.voltage[flying]),
        "voltage_basis": analysis.voltage_basis,
        "current_median": median(track.current[flying]),
    }


def _path_length(speed: Floats, seconds: Floats, rows: Bools) -> float:
    """Ground speed summed over the rows; NaN when speed is unknown in all of them."""
    known = rows & np.isfinite(speed)
    if np.any(rows) and not np.any(known):
        return float("nan")
    return float(np.sum(speed[known] * seconds[known]))


def _rotors(analysis: FlightAnalysis, seconds: Floats, limit: float) -> tuple[JsonObject, ...]:
    """Thrust utilisation of each rotor; over_limit_share is of the time in which it is known."""
    flying, use = analysis.track.flying, airborne_use(analysis)
    measured, predicted = analysis.utilisation[flying], analysis.utilisation_predicted[flying]
    known_s = seconds @ np.isfinite(use)
    over_s = seconds @ (use > limit)
    return tuple(
        {
            "rotor": k + 1,
            "name": name,
            "measured_max": most(measured[:, k]),
            "measured_median": median(measured[:, k]),
            "predicted_max": most(predicted[:, k]),
            "predicted_median": median(predicted[:, k]),
            "over_limit_share": share(float(over_s[k]), float(known_s[k])),
        }
        for k, name in enumerate(analysis.model.airframe.rotor_names)
    )


def _quality(log: FlightLog) -> JsonObject:
    """How whole the log is, and what had to be assumed; a silence is over 1 s without a message."""
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
        "channels": log.channels,
        "missing": tuple(text for name, text in WITHOUT.items() if not track.reports(name)),
        "notes": track.notes,
        "messages": log.messages,
    }


def build_report(
    flights: Iterable[tuple[FlightAnalysis, FlightLog]],
    *,
    max_utilisation: float = 0.5,
    unread: Iterable[UnusedLog] = (),
) -> Report:
    """The numbers of a report over flights, in their order, checked against `max_utilisation`.

    That is the largest share of a rotor's maximum thrust that may be in use.

    `unread` are logs that could not be read, to be named in it. Raises DataError when the
    share is not between 0 and 1, or there is no flight.
    """
    if not 0.0 < max_utilisation < 1.0:
        raise DataError(f"max_utilisation {max_utilisation:g} is no share; give one such as 0.5")
    reports = tuple(
        report_flight(analysis, log, max_utilisation=max_utilisation) for analysis, log in flights
    )
    if not reports:
        raise DataError("no flight to report on; give at least one log that can be read")
    return Report(
        made_utc=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        version=software_version(),
        max_utilisation=max_utilisation,
        overview=overview_of(reports, max_utilisation),
        flights=reports,
        unread=tuple(unread),
    )


def overview_of(reports: Sequence[FlightReport], limit: float) -> Overview:
    """How many flights have which verdict, and which is the worst."""
    levels: list[Level] = [report.verdict.level for report in reports]
    level, headline = several_headline(levels, limit)
    first, report = worst_first(reports)[0]
    return Overview(
        level=level,
        headline=headline,
        worst_flight=first + 1 if report.verdict.worst else None,
        **{level: levels.count(level) for level in get_args(Level)},
    )


def worst_first(reports: Sequence[FlightReport]) -> list[tuple[int, FlightReport]]:
    """(index in the list, report), the worst verdict first, of equal ones the most thrust in use.

    Those without a verdict come last.
    """

    def rank(item: tuple[int, FlightReport]) -> tuple[int, float]:
        verdict = item[1].verdict
        return gravity(verdict.level), -verdict.worst.capacity_use if verdict.worst else 1.0

    return sorted(enumerate(reports), key=rank)
