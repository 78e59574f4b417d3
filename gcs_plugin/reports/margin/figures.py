"""The plots of one flight's report as plotly figures, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import FlightReport, Moment
from thrustmargin.gcs_plugin.reports.margin.maps import redundancy_map, use_map
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
    band,
    line,
    milliseconds,
    over_time,
    rotor_panels,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import worst_rotor

Rows = Mapping[str, Floats]


def figures(report: FlightReport) -> Mapping[str, PlotJson]:
    """Name -> plotly figure; those whose channels the flight lacks are left out."""
    rows, limit, worst = airborne(report.rows), report.verdict.limit, report.verdict.worst
    if not rows["time_s"].size:
        return {}
    names = report.model["rotor_names"]
    use = rows["known_utilisation"]
    knows_use = bool(np.any(np.isfinite(use)))
    knows_redundancy = bool(np.any(np.isfinite(rows["redundancy_yaw_free"])))
    placed = bool(np.any(np.isfinite(rows["north"]) & np.isfinite(rows["east"])))
    made: dict[str, PlotJson] = {}
    if knows_use:
        made["use"] = use_figure(rows, use, limit, worst)
        made["rotors"] = rotors_figure(rows, limit, names)
    if knows_use and placed:
        made["map_use"] = use_map(rows, worst_rotor(use)[0], limit, worst)
    if knows_redundancy and placed:
        made["map_redundancy"] = redundancy_map(rows)
    if knows_redundancy:
        made["redundancy"] = redundancy_figure(rows, limit)
    if np.any(np.isfinite(rows["rotor_speed_rpm"] - rows["rotor_speed_predicted_rpm"])):
        made["residual"] = residual_figure(rows, names)
    return made


def use_figure(rows: Rows, use: Floats, limit: float, worst: Moment | None) -> PlotJson:
    """Thrust in use of the worst rotor and of the mean rotor over time, above the tank level."""
    time_s, tank = rows["time_s"], rows["tank_kg"]
    top, mean = worst_rotor(use)[0] * 100, use.mean(axis=1) * 100
    above = np.where(top > limit * 100, top, limit * 100)
    panels = [
        Panel(
            traces=[
                band(time_s, np.full(top.size, limit * 100), above, color=OVER_FILL),
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
    if np.any(np.isfinite(tank)):
        sprayed = np.where(rows["spraying"] > 0.5, tank, np.nan)
        panels.append(
            Panel(
                traces=[
                    line(time_s, tank, color=INK, name="tank", width=2),
                    line(time_s, sprayed, color=SPRAYING, name="tank while spraying", width=5),
                ],
                height_px=80,
                unit="tank, kg",
                low=0.0,
                high=float(np.nanmax(tank)) * 1.1 + 0.1,
            )
        )
    return over_time(panels, end_s=float(time_s[-1]))


def rotors_figure(rows: Rows, limit: float, names: Sequence[str]) -> PlotJson:
    """Thrust in use of each rotor, measured and predicted, one strip a rotor."""
    time_s = rows["time_s"]
    measured, predicted = rows["capacity_use"] * 100, rows["capacity_use_predicted"] * 100
    high = max(limit * 130, float(np.nanmax([measured, predicted])) * 1.08)
    panels = rotor_panels(
        names,
        lambda k, legend: [
            line(time_s, measured[:, k], color=MEASURED, name="measured", legend=legend),
            line(
                time_s,
                predicted[:, k],
                color=PREDICTED,
                name="predicted",
                width=3,
                dash="dash",
                legend=legend,
            ),
        ],
        unit="",
        suffix=" %",
        low=0.0,
        high=high,
        lines=[_limit(limit)],
    )
    return over_time(panels, end_s=float(time_s[-1]))


def residual_figure(rows: Rows, names: Sequence[str]) -> PlotJson:
    """Measured minus predicted rotor speed over time, with the promised interval as a band."""
    time_s, predicted = rows["time_s"], rows["rotor_speed_predicted_rpm"]
    residual, lower, upper = (
        rows[f"rotor_speed_{name}rpm"] - predicted for name in ("", "lower_", "upper_")
    )
    reach = max(float(np.nanmax(np.abs(residual))) * 1.08, 1.0)
    panels = rotor_panels(
        names,
        lambda k, legend: [
            band(
                time_s,
                lower[:, k],
                upper[:, k],
                color=BAND,
                name="promised interval",
                legend=legend,
            ),
            line(
                time_s,
                residual[:, k],
                color=MEASURED,
                name="measured minus predicted",
                width=2,
                legend=legend,
            ),
        ],
        unit="rpm",
        low=-reach,
        high=reach,
    )
    return over_time(panels, end_s=float(time_s[-1]))


def redundancy_figure(rows: Rows, limit: float) -> PlotJson:
    """Redundancy over time, yaw uncontrolled and controlled; below it the tank and the fills."""
    time_s, tank = rows["time_s"], rows["tank_kg"]
    free, kept = rows["redundancy_yaw_free"], rows["redundancy_yaw_kept"]
    one_out, of_limit = rows["fill_one_rotor_out_kg"], rows["fill_limit_kg"]
    fills = [
        line(time_s, tank, color=INK, name="in the tank"),
        line(time_s, one_out, color=OVER, name="most to lose a rotor", dash="dash"),
    ]
    if not np.allclose(one_out, of_limit, atol=0.05, equal_nan=True):
        name = f"most for {limit * 100:.0f} % in hover"
        fills.append(line(time_s, of_limit, color=PREDICTED, name=name, dash="dot"))
    kilograms = np.concatenate([tank, one_out, of_limit])
    panels = [
        Panel(
            traces=[
                line(time_s, free, color=MEASURED, name="yaw uncontrolled"),
                line(time_s, kept, color=PREDICTED, name="yaw controlled", dash="dash"),
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


def airborne(rows: Rows) -> Rows:
    """The rows from take-off to landing; rotors on the ground between are blanked."""
    flown = np.flatnonzero(rows["airborne"])
    span = slice(int(flown[0]), int(flown[-1]) + 1) if flown.size else slice(0, 0)
    cut = {key: values[span] for key, values in rows.items()}
    landed = cut["airborne"] == 0.0
    for key in ("known_utilisation", "capacity_use", "capacity_use_predicted", "rotor_speed_rpm"):
        cut[key] = np.where(landed[:, None], np.nan, cut[key])
    return cut


def _limit(limit: float) -> tuple[float, str]:
    return limit * 100, f"{limit * 100:.0f} %\nlimit"


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
