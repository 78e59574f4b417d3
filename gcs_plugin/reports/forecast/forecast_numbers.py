"""A plan's forecast as JSON, schema thrustmargin.forecast/1, and row by row as CSV: ten a second.

Null in the one and empty in the other where a number is not known.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict

import numpy as np

from thrustmargin.gcs_plugin.reports.shared import written
from thrustmargin.gcs_plugin.wording.plans.forecast_words import assumed_words, verdict
from thrustmargin.mission.ahead.plan_forecast import PlanForecast
from thrustmargin.models.model.analysis import worst_rotor


def json_text(made: PlanForecast) -> str:
    """The forecast; kg, s, Wh and shares of thrust."""
    use, weakest = made.advised.advice.use, made.weakest
    sorties = () if made.needs.short_of else made.needs.sorties  # no split is possible
    content = {
        "schema": "thrustmargin.forecast/1",
        "verdict": {"level": made.level, "words": verdict(made), "caveats": made.caveats},
        "conditions": made.given,  # `report --assumed` reads them
        "flight_s": made.flight_s,
        "tank_end_kg": float(made.flight.track.tank_kg[-1]),
        "energy_wh": sum(s.energy_wh for s in made.needs.sorties),
        "utilisation": {
            "typical": use.lasting_most,
            "peak": use.peak,
            "peak_interval": weakest and weakest.interval,
        },
        "weakest": weakest and {"what": weakest.kind, **asdict(weakest)},
        "largest_fill_kg": made.largest_fill_kg,
        "rotor_loss_survivable_below_kg": made.survivable_below_kg,
        "sorties": [
            {
                "items": [s.first_item, s.last_item],
                "refill": s.last_item if k + 1 < len(sorties) else None,
                "litres": s.kg / made.advised.analysis.model.airframe.liquid_density,
                "hectares": s.lines * made.swath / 1e4,
                "minutes": s.seconds / 60.0,
                "energy_wh": s.energy_wh,
            }
            for k, s in enumerate(sorties)
        ],
        "point_of_no_return": made.way_back,
        "sorties_short_of": made.needs.short_of or None,
        "legs": made.legs,
        "plan_faults": made.findings,
        "assumed": assumed_words(made),
        "not_understood": made.not_understood,
    }
    return written.json_text(content, digits=8)


def csv_text(made: PlanForecast) -> str:
    """The rows of the part that was flown in detail."""
    flight, analysis = made.flight, made.advised.analysis
    track = flight.track
    use, rotor = worst_rotor(analysis.utilisation_predicted)
    which = np.nan_to_num(rotor).astype(int)
    low, high = (end[np.arange(use.size), which] for end in analysis.use_ends)
    items = np.array([timed.leg.item for timed in flight.course.legs])
    columns = {
        "time [s]": track.time_s,
        "item": items[flight.course.active],
        "north [m]": track.position_ned[:, 0],
        "east [m]": track.position_ned[:, 1],
        "height above home [m]": -track.position_ned[:, 2],
        "speed over ground [m/s]": np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1]),
        "airspeed [m/s]": track.airspeed,
        "heading [deg]": np.degrees(track.attitude[:, 2]) % 360.0,
        "spraying [0/1]": track.spraying,
        "tank [kg]": track.tank_kg,
        "voltage [V]": track.voltage,
        "energy [Wh]": flight.energy_wh,
        "worst rotor": rotor + 1.0,
        "utilisation [1]": use,
        "utilisation low [1]": low,
        "utilisation high [1]": high,
        "redundancy yaw uncontrolled [1]": analysis.redundancy_yaw_uncontrolled,
    }
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        rows.writerow(["" if math.isnan(value) else f"{value:.6g}" for value in row])
    return text.getvalue()
