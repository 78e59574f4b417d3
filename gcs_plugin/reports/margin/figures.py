"""The plots of one flight's report, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import ReportedFlight
from thrustmargin.gcs_plugin.reports.shared import plot_style as style
from thrustmargin.gcs_plugin.reports.shared.route_map import add_surroundings, route_map
from thrustmargin.gcs_plugin.wording import palette
from thrustmargin.gcs_plugin.wording import report_words as words
from thrustmargin.gcs_plugin.wording.alarm_words import HELD, MAXIMUM_FILL, SPINS
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.mission.field import sprayed_field
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import SpeedBasis, worst_rotor
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.utilisation_peaks import UtilisationPeak

Rows = Mapping[str, Floats]


def figures(report: ReportedFlight) -> Mapping[str, style.Figure]:
    """Return the figures of a flight by name: "use", "rotors", "residual", "redundancy", "map_use",
    "map_redundancy", and for a flight without a verdict "map_speed".

    A figure is missing if the flight lacks its data; all are missing if it has no row in flight. A
    map needs positions.
    """
    rows, limit, worst = airborne(report.rows), report.advice.limit, report.worst
    if not rows["time_s"].size:
        return {}
    names = report.json["model"]["rotor_names"]
    use = rows["known_utilisation"]
    knows_use = bool(np.any(np.isfinite(use)))
    knows_redundancy = bool(np.any(np.isfinite(rows["redundancy_yaw_uncontrolled"])))
    placed = bool(np.any(np.isfinite(rows["position_north"]) & np.isfinite(rows["position_east"])))
    made: dict[str, style.Figure] = {}
    if knows_use:
        made["use"] = use_figure(rows, use, limit, worst)
        made["rotors"] = rotors_figure(rows, limit, names)
    if knows_use and placed:
        made["map_use"] = use_map(rows, worst_rotor(use)[0], limit, worst)
    if report.json["no_verdict"] and placed:
        speed = rows["ground_speed"]
        made["map_speed"] = _map(rows, {"speed": (speed, speed)}, palette.GROUND_SPEED)
    if knows_redundancy and placed:
        made["map_redundancy"] = redundancy_map(rows)
    if knows_redundancy:
        made["redundancy"] = redundancy_figure(rows, limit)
    residual = rows["rotor_speed_rpm"] - rows["rotor_speed_predicted_rpm"]
    inferred = np.isfinite(rows["tank_error_kg"])  # from these speeds: the residual shows nothing
    if np.any(np.isfinite(residual[~inferred])):
        made["residual"] = residual_figure(rows, names)
    if placed:
        place = rows["position_north"], rows["position_east"]
        at = np.column_stack([*place, np.zeros(place[0].size)])
        field = sprayed_field(rows["time_s"], at, rows["spraying"])
        wind = {key: report.json["flight"][f"wind_{key}"] for key in ("speed_median", "from_deg")}
        for name in ("map_use", "map_speed", "map_redundancy"):
            if name in made:
                add_surroundings(
                    made[name],
                    place,
                    field,
                    wind_speed=wind["speed_median"],
                    wind_from_deg=wind["from_deg"],
                )
    return made


def use_figure(
    rows: Rows, use: Floats, limit: float, worst: UtilisationPeak | None
) -> style.Figure:
    """Draw thrust left, %, of the worst rotor and on average over time, above the tank level, kg.

    `use` (T, R) is the known utilisation, and `limit` the largest that may be used for long, both
    shares. `worst` is the peak to mark; None marks none.
    """
    time_s, tank, least = rows["time_s"], rows["tank_kg"], 1.0 - limit
    worst_left = 100.0 * (1.0 - worst_rotor(use)[0])
    mean_left = 100.0 * (1.0 - use.mean(axis=1))
    traces = [
        style.below_limit(time_s, worst_left, least),
        style.line(time_s, worst_left, color=style.MEASURED, name="worst rotor"),
        style.line(time_s, mean_left, color=style.MEAN, name=words.MEAN_ROTOR, width=2),
    ]
    axis = style.left_axis(words.LEFT, np.append(worst_left, mean_left), least)
    panels = [style.Panel(traces=traces, axis=axis, height_px=280, limit=style.limit_across(least))]
    if np.any(np.isfinite(tank)):
        reach = INTERVAL * rows["tank_error_kg"]
        inferred = np.any(np.isfinite(reach))
        named = words.LOAD_INFERRED if inferred else "tank"
        within = [style.band(time_s, np.maximum(tank - reach, 0.0), tank + reach, color=style.BAND)]
        traces = [
            *(within if inferred else ()),
            *style.in_tank(time_s, tank, rows["spraying"], named),
        ]
        axis = style.titled("tank, kg", range=[0.0, float(np.nanmax(tank)) * 1.1 + 0.1])
        panels.append(style.Panel(traces=traces, axis=axis, height_px=80))
    made = style.over_time(panels, end_s=float(time_s[-1]))
    if worst is not None:
        made.note(
            f"<b>{left_words(1.0 - worst.utilisation)} {say('rotor')} {worst.rotor + 1}</b>",
            x=style.milliseconds(np.array(worst.time_s)).item(),
            y=100.0 * (1.0 - worst.utilisation),
            ax=0,
            ay=36,
            showarrow=True,
            arrowhead=2,
            arrowwidth=2,
            font={"size": 18},
        )
    return made


def rotors_figure(rows: Rows, limit: float, names: Sequence[str]) -> style.Figure:
    """Draw thrust left, %, of each rotor over time, by its speed and as predicted, one panel a
    rotor.

    `limit` is the largest share of thrust that may be used for long; `names` are the rotors'
    places.
    """
    time_s = rows["time_s"]
    use = rows["utilisation"], rows["utilisation_from_outputs"], rows["utilisation_predicted"]
    measured, inferred, predicted = (100.0 * (1.0 - shares) for shares in use)
    shown = (measured, SpeedBasis.MEASURED), (inferred, SpeedBasis.MOTOR_OUTPUTS)
    by_speed = [(values, name) for values, name in shown if np.isfinite(values).any()]
    as_predicted = {"color": style.PREDICTED, "name": "predicted", "width": 3, "dash": "dash"}
    panels = style.rotor_panels(
        names,
        lambda k, legend: [
            *(
                style.line(time_s, values[:, k], color=style.MEASURED, name=name, legend=legend)
                for values, name in by_speed or shown[:1]
            ),
            style.line(time_s, predicted[:, k], legend=legend, **as_predicted),
        ],
        axis=style.left_axis("", np.array([measured, inferred, predicted]), 1.0 - limit),
        limit=style.limit_across(1.0 - limit),
    )
    return style.over_time(panels, end_s=float(time_s[-1]))


def residual_figure(rows: Rows, names: Sequence[str]) -> style.Figure:
    """Draw measured minus predicted rotor speed, rpm, over time, one panel for each of the rotors
    `names`.

    The band is the prediction's interval. At least one residual must be finite.
    """
    time_s, predicted = rows["time_s"], rows["rotor_speed_predicted_rpm"]
    residual, lower, upper = (
        rows[f"rotor_speed_{name}rpm"] - predicted for name in ("", "lower_", "upper_")
    )
    reach = max(float(np.nanmax(np.abs(residual))) * 1.08, 1.0)
    promised = {"color": style.BAND, "name": "promised interval"}
    left = {"color": style.MEASURED, "name": words.MEASURED_MINUS_PREDICTED, "width": 2}
    panels = style.rotor_panels(
        names,
        lambda k, legend: [
            style.band(time_s, lower[:, k], upper[:, k], legend=legend, **promised),
            style.line(time_s, residual[:, k], legend=legend, **left),
        ],
        axis=style.titled("rpm", range=[-reach, reach]),
    )
    return style.over_time(panels, end_s=float(time_s[-1]))


def redundancy_figure(rows: Rows, limit: float) -> style.Figure:
    """Draw redundancy with one rotor lost over time, yaw uncontrolled and controlled.

    Below it are the tank level and the largest fills, kg: for redundancy 1, and for the utilisation
    `limit`, a share. At least one redundancy must be finite.
    """
    time_s, tank = rows["time_s"], rows["tank_kg"]
    free, kept = rows["redundancy_yaw_uncontrolled"], rows["redundancy_yaw_kept"]
    one_out, of_limit = rows["fill_one_rotor_out_kg"], rows["fill_limit_kg"]
    held = [
        style.line(time_s, free, color=style.MEASURED, name=SPINS),
        style.line(time_s, kept, color=style.PREDICTED, name=HELD, dash="dash"),
    ]
    fills = [
        style.line(time_s, tank, color=style.INK, name=words.IN_THE_TANK),
        style.line(time_s, one_out, color=style.OVER, name=MAXIMUM_FILL, dash="dash"),
    ]
    if not np.allclose(one_out, of_limit, atol=0.05, equal_nan=True):
        name = words.fill_line(limit)
        fills.append(style.line(time_s, of_limit, color=style.PREDICTED, name=name, dash="dot"))
    high = max(1.2, float(np.nanmax([free, kept])) * 1.1)
    over_weight = style.titled(words.OVER_WEIGHT, range=[-0.03, high])
    kilograms = np.concatenate([tank, one_out, of_limit])
    low, high = min(0.0, float(np.nanmin(kilograms))), float(np.nanmax(kilograms)) * 1.1 + 0.1
    kg = style.titled("kg", range=[low, high])
    carries = (1.0, "1 = just\ncarries")
    panels = [
        style.Panel(traces=held, axis=over_weight, height_px=190, limit=carries),
        style.Panel(traces=fills, axis=kg, height_px=190),
    ]
    return style.over_time(panels, end_s=float(time_s[-1]))


def use_map(rows: Rows, use: Floats, limit: float, worst: UtilisationPeak | None) -> style.Figure:
    """Draw the route coloured by the worst rotor's thrust left, with a ring at the peak `worst`.

    `use` (T,) is that rotor's utilisation and `limit` the largest that may be used for long, both
    shares. No ring for None or an unknown position.
    """
    made = _map(rows, {"left": (1.0 - use, use)}, palette.thrust_left(1.0 - limit))
    if worst is not None and np.isfinite(worst.north) and np.isfinite(worst.east):
        ring = style.scatter(
            [worst.east],
            [worst.north],
            mode="markers+text",
            marker={"size": 22, "symbol": "circle-open", "color": style.INK, "line": {"width": 4}},
            text=[f"<b>{say('worst')}</b>"],
            textposition="top center",
            textfont={"size": 17, "color": style.INK},
            hoverinfo="skip",
            showlegend=False,
        )
        made.add([ring])
    return made


def redundancy_map(rows: Rows) -> style.Figure:
    """Draw the route coloured by redundancy with yaw uncontrolled.

    If that with yaw controlled is known, buttons switch between the two.
    """
    free, kept = rows["redundancy_yaw_uncontrolled"], rows["redundancy_yaw_kept"]
    coloured = {SPINS: (free, -free)}
    if not np.any(np.isfinite(kept)):
        return _map(rows, coloured, palette.REDUNDANCY)
    made = _map(rows, coloured | {HELD: (kept, -kept)}, palette.REDUNDANCY)
    made.layout["height"] = 650
    made.layout["margin"]["b"] = 150
    return made


def _map(
    rows: Rows, coloured: Mapping[str, tuple[Floats, Floats]], scale: palette.ColourScale
) -> style.Figure:
    return route_map(
        (rows["position_north"], rows["position_east"]),
        rows["time_s"],
        coloured,
        scale,
        form=".2f",
        height=560,
        margin={"l": 70, "r": 20, "t": 90, "b": 90},
    )


def airborne(rows: Rows) -> Rows:
    """Return the rows from first take-off to last landing; empty arrays if it never flew.

    Values of rotors, (T, R), become NaN where the aircraft is on the ground between flights.
    """
    flown = np.flatnonzero(rows["flying"])
    span = slice(int(flown[0]), int(flown[-1]) + 1) if flown.size else slice(0, 0)
    cut = {key: values[span] for key, values in rows.items()}
    landed = cut["flying"] == 0.0
    for key, of_rotors in cut.items():
        if of_rotors.ndim < 2:
            continue
        cut[key] = np.where(landed[:, None], np.nan, cut[key])
    return cut
