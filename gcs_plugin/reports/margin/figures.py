"""The plots of one flight's report as plotly figures, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import FlightReport, Moment
from thrustmargin.gcs_plugin.reports.margin.maps import map_figure, redundancy_map
from thrustmargin.gcs_plugin.reports.margin.series import Series
from thrustmargin.gcs_plugin.reports.shared.plot_style import (
    BAND,
    INK,
    MEAN,
    MEASURED,
    OVER,
    OVER_FILL,
    PREDICTED,
    SPRAYING,
    Panel,
    PlotJson,
    ground,
    line,
    milliseconds,
    over_time,
)
from thrustmargin.gcs_plugin.reports.shared.route_map import moved
from thrustmargin.gcs_plugin.wording.palette import LOAD
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import worst_rotor

ROTOR_PANEL_PX = 96


def figures(report: FlightReport) -> Mapping[str, PlotJson]:
    """Name -> plotly figure; those whose channels the flight lacks are left out."""
    series, limit = airborne(report.series), report.verdict.limit
    if not series.time_s.size:
        return {}
    names = tuple(f"rotor {k + 1}, {n}" for k, n in enumerate(report.model.rotor_names))
    use = judged_use(series)
    knows_use = bool(np.any(np.isfinite(use)))
    knows_redundancy = bool(np.any(np.isfinite(series.redundancy_yaw_free)))
    placed = bool(np.any(np.isfinite(series.north) & np.isfinite(series.east)))
    made: dict[str, PlotJson] = {}
    if knows_use:
        made["use"] = use_figure(series, use, limit, report.verdict.worst)
        made["rotors"] = rotors_figure(series, limit, names)
    if knows_use and placed:
        scale = moved(LOAD, limit)
        made["map_use"] = map_figure(series, worst_rotor(use)[0], scale, report.verdict.worst)
    if knows_redundancy and placed:
        made["map_redundancy"] = redundancy_map(series)
    if knows_redundancy:
        made["redundancy"] = redundancy_figure(series, limit)
    if np.any(np.isfinite(series.residual_rpm)):
        made["residual"] = residual_figure(series, names)
    return made


def use_figure(series: Series, use: Floats, limit: float, worst: Moment | None) -> PlotJson:
    """Capacity use of the worst rotor and of the mean rotor over time, above the tank level."""
    time_s, top = series.time_s, worst_rotor(use)[0] * 100
    mean = np.where(np.all(np.isfinite(use), axis=1), use.mean(axis=1), np.nan) * 100
    over = np.where(top > limit * 100, top, limit * 100)
    panels = [
        Panel(
            traces=[
                ground(time_s, np.full(top.size, limit * 100), over, color=OVER_FILL),
                line(time_s, top, color=MEASURED, name="worst rotor"),
                line(time_s, mean, color=MEAN, name="mean of the rotors", width=2),
            ],
            height_px=280,
            unit="thrust in use",
            suffix=" %",
            low=0.0,
            high=max(float(np.nanmax(top)) * 1.3, limit * 130),
            lines=[_limit(limit)],
            notes=[_arrow(worst)] if worst is not None else [],
        )
    ]
    if np.any(np.isfinite(series.tank_kg)):
        sprayed = np.where(series.spraying > 0.5, series.tank_kg, np.nan)
        panels.append(
            Panel(
                traces=[
                    line(time_s, series.tank_kg, color=INK, name="tank", width=2),
                    line(time_s, sprayed, color=SPRAYING, name="tank while spraying", width=5),
                ],
                height_px=80,
                unit="tank, kg",
                low=0.0,
                high=float(np.nanmax(series.tank_kg)) * 1.1 + 0.1,
            )
        )
    return over_time(panels, end_s=float(time_s[-1]))


def rotors_figure(series: Series, limit: float, names: tuple[str, ...]) -> PlotJson:
    """Capacity use of each rotor, measured and predicted, one strip a rotor."""
    both = np.concatenate([series.capacity_use, series.capacity_use_predicted])
    high = max(limit * 1.3, float(np.nanmax(both)) * 1.08) * 100
    panels = [
        Panel(
            traces=[
                line(
                    series.time_s,
                    series.capacity_use[:, k] * 100,
                    color=MEASURED,
                    name="measured",
                    legend=k == 0,
                ),
                line(
                    series.time_s,
                    series.capacity_use_predicted[:, k] * 100,
                    color=PREDICTED,
                    name="predicted",
                    width=3,
                    dash="dash",
                    legend=k == 0,
                ),
            ],
            height_px=ROTOR_PANEL_PX,
            unit="",
            suffix=" %",
            low=0.0,
            high=high,
            lines=[_limit(limit)],
            title=name,
        )
        for k, name in enumerate(names)
    ]
    return over_time(panels, end_s=float(series.time_s[-1]))


def residual_figure(series: Series, names: tuple[str, ...]) -> PlotJson:
    """Measured minus predicted rotor speed over time, with the promised interval as a band."""
    residual = series.residual_rpm
    reach = max(float(np.nanmax(np.abs(residual))) * 1.08, 1.0)
    predicted = series.rotor_speed_predicted_rpm
    lower, upper = (
        series.rotor_speed_lower_rpm - predicted,
        series.rotor_speed_upper_rpm - predicted,
    )
    panels = [
        Panel(
            traces=[
                ground(
                    series.time_s,
                    lower[:, k],
                    upper[:, k],
                    color=BAND,
                    name="promised interval",
                    legend=k == 0,
                ),
                line(
                    series.time_s,
                    residual[:, k],
                    color=MEASURED,
                    name="measured minus predicted",
                    width=2,
                    legend=k == 0,
                ),
            ],
            height_px=ROTOR_PANEL_PX,
            unit="rpm",
            low=-reach,
            high=reach,
            title=name,
        )
        for k, name in enumerate(names)
    ]
    return over_time(panels, end_s=float(series.time_s[-1]))


def redundancy_figure(series: Series, limit: float) -> PlotJson:
    """Redundancy over time, heading given up and kept; below it the tank against the fills."""
    time_s = series.time_s
    free, kept = series.redundancy_yaw_free, series.redundancy_yaw_kept
    one_out, of_limit = series.fill_one_rotor_out_kg, series.fill_limit_kg
    fills = [
        line(time_s, series.tank_kg, color=INK, name="in the tank"),
        line(time_s, one_out, color=OVER, name="most to lose a rotor", dash="dash"),
    ]
    if not np.allclose(one_out, of_limit, atol=0.05, equal_nan=True):
        name = f"most for {limit * 100:.0f} % in hover"
        fills.append(line(time_s, of_limit, color=PREDICTED, name=name, dash="dot"))
    kilograms = np.concatenate([series.tank_kg, one_out, of_limit])
    panels = [
        Panel(
            traces=[
                line(time_s, free, color=MEASURED, name="heading given up"),
                line(time_s, kept, color=PREDICTED, name="heading kept", dash="dash"),
            ],
            height_px=190,
            unit="thrust over weight",
            low=-0.03,
            high=max(1.2, float(np.nanmax(np.concatenate([free, kept]))) * 1.1),
            lines=[(1.0, "1 = just\ncarries")],
        ),
        Panel(
            traces=fills,
            height_px=190,
            unit="kg",
            low=min(0.0, float(np.nanmin(kilograms))),
            high=float(np.nanmax(kilograms)) * 1.1 + 0.1,
        ),
    ]
    return over_time(panels, end_s=float(time_s[-1]))


def airborne(series: Series) -> Series:
    """The rows from take-off to landing; rotors on the ground between are blanked."""
    rows = np.flatnonzero(series.airborne)
    span = slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)
    cut = {f.name: getattr(series, f.name)[span] for f in fields(series)}
    landed = ~cut["airborne"]
    for name in ("capacity_use", "capacity_use_predicted", "rotor_speed_rpm"):
        cut[name] = np.where(landed[:, None], np.nan, cut[name])
    return replace(series, **cut)


def judged_use(series: Series) -> Floats:
    """(T, R) measured capacity use, predicted in rows in which none was measured."""
    measured = np.any(np.isfinite(series.capacity_use), axis=1)
    return np.where(measured[:, None], series.capacity_use, series.capacity_use_predicted)


def _limit(limit: float) -> tuple[float, str]:
    return limit * 100, f"{limit * 100:.0f} %\nline"


def _arrow(worst: Moment) -> PlotJson:
    return {
        "text": f"<b>{worst.capacity_use * 100:.0f} % rotor {worst.rotor}</b>",
        "x": float(milliseconds(np.array([worst.time_s]))[0]),
        "y": worst.capacity_use * 100,
        "ax": 0,
        "ay": -36,
        "arrowhead": 2,
        "arrowwidth": 2,
        "font": {"size": 18},
    }
