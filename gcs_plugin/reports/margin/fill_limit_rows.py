"""The fills that keep both limits, and what one lost rotor would have meant along a flight."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import JsonObject, end_rows, share
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import ceiling, hover_use, largest_fill, weight
from thrustmargin.models.physics.smoothing import known_least, known_median


def redundancy_rows(
    analysis: FlightAnalysis, rows: Mapping[str, Floats], seconds: Floats
) -> JsonObject:
    """What one lost rotor would have meant along the flight, and how much may be filled.

    The fills are those at which thrust in use in hover meets the limit, and at which redundancy
    with yaw uncontrolled is 1: at the start of the flight, and the least over it.
    """
    track = analysis.track
    flying, (first, _) = track.flying, end_rows(track)
    free, kept = analysis.redundancy_yaw_uncontrolled[flying], analysis.redundancy_yaw_kept[flying]
    known = np.isfinite(free)
    air_s = seconds[flying]
    fills = {name: rows[f"{name}_kg"] for name in ("fill_limit", "fill_one_rotor_out")}
    return {
        "yaw_free_min": known_least(free),
        "yaw_free_min_time_s": float(track.time_s[flying][np.nanargmin(free)])
        if known.any()
        else np.nan,
        "yaw_free_median": known_median(free),
        "yaw_kept_min": known_least(kept),
        "yaw_kept_median": known_median(kept),
        "below_one_share": share(float(air_s[free < 1.0].sum()), float(air_s[known].sum())),
        "trimmable_loss_min": known_least(analysis.trimmable_loss[flying]),
        **{
            f"{name}_{when}_kg": value
            for name, fill in fills.items()
            for when, value in (
                ("start", known_median(fill[first])),
                ("min", known_least(fill[flying])),
            )
        },
        "tank_capacity_kg": analysis.model.airframe.tank_capacity_kg,
    }


def one_rotor_out_use(airframe: Airframe) -> float:
    """Thrust utilisation in hover at redundancy 1 with yaw uncontrolled; 0.5 on a quad."""
    limits = ceiling(airframe, airframe.reference_density, airframe.ceiling_voltage)
    fill = largest_fill(airframe, limits, criterion="yaw uncontrolled")
    return float(hover_use(airframe, limits, weight(airframe, fill)).item())
