"""A small flight for the view's tests: a square at 5 m, loads that differ from rotor to rotor."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

ROWS, STEP_S = 400, 0.1


def flight(
    *, airframe: str = "topxgun-f16-sitl", name: str = "square.tlog", **changes
) -> FlightAnalysis:
    """The analysed flight; `changes` replace channels of its track by name."""
    craft = load_airframe(airframe)
    rotors = craft.rotor_count
    time_s = np.arange(ROWS, dtype=np.float64) * STEP_S
    side = np.linspace(0, 4, ROWS, endpoint=False)
    north = 40 * np.clip(np.minimum(side, 3 - side), 0, 1)
    east = 40 * np.clip(np.minimum(side - 1, 4 - side), 0, 1)
    hover = np.sqrt((craft.empty_mass + 8) * 9.80665 / rotors / craft.thrust_coefficient)
    rpm = hover * (1 + 0.02 * np.arange(rotors) + 0.1 * np.sin(time_s[:, None] / 3))
    channels = {
        "position_ned": np.column_stack([north, east, np.full(ROWS, -5.0)]),
        "attitude": np.column_stack([np.zeros(ROWS), np.zeros(ROWS), np.pi / 2 * np.floor(side)]),
        "airspeed": np.full(ROWS, 4.0),
        "tank_kg": np.linspace(10, 6, ROWS),
        "rotor_speed_rpm": rpm,
        "voltage": np.full(ROWS, craft.nominal_voltage),
        "pressure": np.full(ROWS, 101325.0),
        "altitude": np.full(ROWS, 5.0),
        "height_agl": np.full(ROWS, 5.0),
        "spraying": np.ones(ROWS),
    }
    track = FlightTrack.of(
        name=name,
        time_s=time_s,
        rotor_count=rotors,
        origin=Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=0.0),
        **{**channels, **changes},
    )
    return analyse(track, physics_model(craft))
