"""A plan's forecast row by row: ten a second, units in the header, empty where not known."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from thrustmargin.mission.ahead.plan_forecast import PlanForecast
from thrustmargin.models.model.analysis import worst_rotor


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
