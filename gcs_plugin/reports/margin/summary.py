"""One analysed flight and its log to the numbers of a report: no files, no clock, no screen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin import headline
from thrustmargin.gcs_plugin.reports.margin.accuracy import accuracy
from thrustmargin.gcs_plugin.reports.margin.data import (
    Flight,
    FlightReport,
    Level,
    ModelUse,
    Redundancy,
    RotorUse,
    Verdict,
)
from thrustmargin.gcs_plugin.reports.margin.load import load_rows
from thrustmargin.gcs_plugin.reports.margin.model_description import describe_model
from thrustmargin.gcs_plugin.reports.margin.moments import (
    capacity_rows,
    utc_words,
    worst_moments,
)
from thrustmargin.gcs_plugin.reports.margin.quality import quality_of
from thrustmargin.gcs_plugin.reports.margin.series import series_of
from thrustmargin.gcs_plugin.wording import numbers as words
from thrustmargin.mission.field import sprayed_field
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.analysis import Basis, FlightAnalysis, worst_rotor
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import Ceiling, ceiling, hover_use, largest_fill, weight

#: A pause of the log longer than this many usual steps is not counted as time over a line.
LONGEST_STEP = 2.5
#: Share of the airborne rows that counts as the start and as the end of a flight.
END_SHARE = 0.1


def report_flight(
    analysis: FlightAnalysis, log: FlightLog, *, max_utilisation: float
) -> FlightReport:
    """Everything that the report says about one flight.

    `max_utilisation` is the largest share of a rotor's maximum thrust that may be in use.
    """
    track, airframe = analysis.track, analysis.model.airframe
    limits = ceiling(airframe, analysis.density, track.voltage)
    series = series_of(
        analysis,
        fill_limit_kg=largest_fill(airframe, limits, limit=max_utilisation),
        fill_one_rotor_out_kg=largest_fill(airframe, limits, criterion="yaw free"),
    )
    seconds = row_seconds(track)
    moments = worst_moments(analysis, airframe.rotor_names)
    verdict = _verdict(analysis, airframe, seconds, max_utilisation)
    verdict = replace(verdict, worst=moments[0] if moments else None)
    return FlightReport(
        name=track.name,
        verdict=replace(
            verdict, headline=headline.headline(verdict), facts=headline.facts(verdict)
        ),
        flight=_flight(analysis, seconds),
        model=_model_use(analysis),
        load=load_rows(analysis, limits, first_rows(track), last_rows(track)),
        rotors=_rotor_uses(analysis, airframe, seconds, max_utilisation),
        moments=moments,
        redundancy=_redundancy(analysis, airframe, series.fill_limit_kg, seconds, limits),
        accuracy=accuracy(analysis, airframe.rotor_names),
        quality=quality_of(log),
        series=series,
    )


def row_seconds(track: FlightTrack) -> Floats:
    """(T,) s that each row stands for: the step to the next, without the log's pauses."""
    if track.time_s.size < 2:
        return np.zeros(track.time_s.size)
    steps = np.diff(track.time_s)
    usual = float(np.median(steps))
    return np.minimum(np.append(steps, usual), LONGEST_STEP * usual)


def first_rows(track: FlightTrack) -> Bools:
    """(T,) the first tenth of the airborne rows."""
    return _end_rows(track, first=True)


def last_rows(track: FlightTrack) -> Bools:
    """(T,) the last tenth of the airborne rows."""
    return _end_rows(track, first=False)


def _end_rows(track: FlightTrack, *, first: bool) -> Bools:
    airborne = np.flatnonzero(track.flying)
    count = max(1, round(END_SHARE * airborne.size))
    chosen = np.zeros(track.time_s.size, dtype=np.bool_)
    chosen[airborne[:count] if first else airborne[-count:]] = True
    return chosen


def _verdict(
    analysis: FlightAnalysis, airframe: Airframe, seconds: Floats, limit: float
) -> Verdict:
    track = analysis.track
    use, measured = capacity_rows(analysis)
    worst, _ = worst_rotor(use)
    known = np.isfinite(worst)
    airborne_s = float(seconds[track.flying].sum())
    known_s = float(seconds[known].sum())
    over_s = float(seconds[known & (worst > limit)].sum())
    free = np.where(track.flying, analysis.redundancy_yaw_free, np.nan)
    lost_s = float(seconds[free < 1.0].sum())
    measured_s = float(seconds[known & measured].sum())
    level: Level = "unknown"
    if np.any(known):
        level = "critical" if lost_s > 0.0 else "over" if over_s > 0.0 else "under"
    return Verdict(
        level=level,
        headline="",
        facts=(),
        limit=limit,
        one_rotor_out_use=_one_rotor_out_use(airframe),
        worst=None,
        basis=_basis_words(track, measured_s, known_s, airborne_s),
        measured_share=_share(measured_s, airborne_s),
        over_limit_s=over_s,
        over_limit_share=_share(over_s, known_s),
        redundancy_yaw_free_min=_least(free),
        not_survivable_s=lost_s,
    )


def _one_rotor_out_use(airframe: Airframe) -> float:
    """Capacity use in hover at redundancy 1 with heading given up; 0.5 on a quad."""
    limits = ceiling(airframe, airframe.reference_density, airframe.ceiling_voltage)
    fill = largest_fill(airframe, limits, criterion="yaw free")
    return float(hover_use(airframe, limits, weight(airframe, fill)).item())


def _basis_words(track: FlightTrack, measured_s: float, known_s: float, airborne_s: float) -> str:
    if known_s == 0.0:
        return "nothing measured, nothing predicted"
    missing = airborne_s - known_s
    tail = "" if missing < 0.05 * airborne_s else f"; unknown for {words.duration(missing)}"
    if measured_s == 0.0:
        why = "in the air " if track.reports("rotor_speed_rpm") else ""
        return f"predicted; no rotor speeds {why}in this log{tail}"
    if measured_s < 0.999 * known_s:
        share = words.percent(measured_s / known_s)
        return f"rotor speeds measured for {share} of the flight, predicted for the rest{tail}"
    return f"measured rotor speeds{tail}"


def _flight(analysis: FlightAnalysis, seconds: Floats) -> Flight:
    track = analysis.track
    flying = track.flying
    speed = np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1])
    tank = track.tank_kg[flying & np.isfinite(track.tank_kg)]
    start_kg, end_kg = (float(tank[0]), float(tank[-1])) if tank.size else (np.nan, np.nan)
    spraying = flying & (track.spraying > 0.5)
    knows_spraying = bool(np.any(np.isfinite(track.spraying[flying])))
    sprayed = sprayed_field(track.position_ned, np.where(flying, track.spraying, np.nan))
    wind = track.wind_ned[flying & np.all(np.isfinite(track.wind_ned[:, :2]), axis=1), :2]
    voltage = track.voltage
    mean_wind = wind.mean(axis=0) if wind.size else np.full(2, np.nan)
    return Flight(
        start_utc=utc_words(track.start_unix_s, 0.0),
        log_duration_s=track.duration,
        airborne_s=float(seconds[flying].sum()),
        distance=_path_length(speed, seconds, flying),
        tank_start_kg=start_kg,
        tank_end_kg=end_kg,
        liquid_used_kg=start_kg - end_kg,
        spraying_s=float(seconds[spraying].sum()) if knows_spraying else np.nan,
        sprayed_distance=_path_length(speed, seconds, spraying) if knows_spraying else np.nan,
        swath_width=sprayed.swath_width if sprayed else np.nan,
        sprayed_area=sprayed.area if sprayed else np.nan,
        ground_speed_median=_median(speed[flying]),
        ground_speed_max=_most(speed[flying]),
        airspeed_median=_median(track.airspeed[flying]),
        airspeed_max=_most(track.airspeed[flying]),
        wind_speed_median=_median(np.hypot(wind[:, 0], wind[:, 1])),
        wind_speed_max=_most(np.hypot(wind[:, 0], wind[:, 1])),
        wind_from_deg=float(np.degrees(np.arctan2(-mean_wind[1], -mean_wind[0])) % 360.0),
        height_agl_median=_median(track.height_agl[flying]),
        height_agl_max=_most(track.height_agl[flying]),
        altitude_median=_median(track.altitude[flying]),
        density_median=_median(analysis.density[flying]),
        density_basis=analysis.density_basis,
        voltage_start=_median(voltage[first_rows(track)]),
        voltage_end=_median(voltage[last_rows(track)]),
        voltage_min=_least(voltage[flying]),
        voltage_basis=analysis.voltage_basis,
        current_median=_median(track.current[flying]),
    )


def _path_length(speed: Floats, seconds: Floats, rows: Bools) -> float:
    """Ground speed summed over the rows; NaN when speed is unknown in all of them."""
    known = rows & np.isfinite(speed)
    if np.any(rows) and not np.any(known):
        return float("nan")
    return float(np.sum(speed[known] * seconds[known]))


def _model_use(analysis: FlightAnalysis) -> ModelUse:
    airframe = analysis.model.airframe
    basis = analysis.prediction.basis[analysis.track.flying]
    shares = {b: float(np.mean(basis == b)) if basis.size else np.nan for b in Basis}
    described = describe_model(analysis.model)
    return ModelUse(
        airframe=airframe.name,
        airframe_title=airframe.title,
        rotor_count=airframe.rotor_count,
        rotor_names=airframe.rotor_names,
        empty_mass=airframe.empty_mass,
        tank_capacity_kg=airframe.tank_capacity_kg,
        model=described.name,
        model_words=described.words,
        network_share=shares[Basis.NETWORK],
        physics_share=shares[Basis.PHYSICS],
        none_share=shares[Basis.NONE],
        inside_envelope=bool(shares[Basis.NETWORK] == 1.0) if described.has_network else None,
        effects=described.effects,
    )


def _rotor_uses(
    analysis: FlightAnalysis, airframe: Airframe, seconds: Floats, limit: float
) -> tuple[RotorUse, ...]:
    flying = analysis.track.flying
    use, _ = capacity_rows(analysis)
    measured, predicted = analysis.capacity_use[flying], analysis.capacity_use_predicted[flying]
    uses = []
    for k, name in enumerate(airframe.rotor_names):
        known = np.isfinite(use[:, k])
        over = known & (use[:, k] > limit)
        uses.append(
            RotorUse(
                rotor=k + 1,
                name=name,
                measured_max=_most(measured[:, k]),
                measured_median=_median(measured[:, k]),
                predicted_max=_most(predicted[:, k]),
                predicted_median=_median(predicted[:, k]),
                over_limit_share=_share(float(seconds[over].sum()), float(seconds[known].sum())),
            )
        )
    return tuple(uses)


def _redundancy(
    analysis: FlightAnalysis,
    airframe: Airframe,
    fill_limit_kg: Floats,
    seconds: Floats,
    limits: Ceiling,
) -> Redundancy:
    track = analysis.track
    flying = track.flying
    free = np.where(flying, analysis.redundancy_yaw_free, np.nan)
    kept = analysis.redundancy_yaw_kept[flying]
    known = np.isfinite(free)
    below = float(seconds[known & (free < 1.0)].sum())
    one_out = largest_fill(airframe, limits, criterion="yaw free")
    first = first_rows(track)
    return Redundancy(
        yaw_free_min=_least(free),
        yaw_free_min_time_s=float(track.time_s[np.nanargmin(free)]) if known.any() else np.nan,
        yaw_free_median=_median(free),
        yaw_kept_min=_least(kept),
        yaw_kept_median=_median(kept),
        below_one_share=_share(below, float(seconds[known].sum())),
        trimmable_loss_min=_least(analysis.trimmable_loss[flying]),
        fill_limit_start_kg=_median(fill_limit_kg[first]),
        fill_limit_min_kg=_least(fill_limit_kg[flying]),
        fill_one_rotor_out_start_kg=_median(one_out[first]),
        fill_one_rotor_out_min_kg=_least(one_out[flying]),
        tank_capacity_kg=airframe.tank_capacity_kg,
    )


def _known(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _median(values: Floats) -> float:
    known = _known(values)
    return float(np.median(known)) if known.size else float("nan")


def _most(values: Floats) -> float:
    known = _known(values)
    return float(known.max()) if known.size else float("nan")


def _least(values: Floats) -> float:
    known = _known(values)
    return float(known.min()) if known.size else float("nan")


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else float("nan")
