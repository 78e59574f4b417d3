"""The envelope of a network's training: where it may be asked, and which flights it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Bools, Floats

#: How far beyond its training the network is still asked: m/s, kg, share of density.
#: 2 % of density is 1 % of rotor speed, about the error of the network in straight flight.
AIRSPEED_TOLERANCE, TANK_TOLERANCE, DENSITY_TOLERANCE = 0.25, 0.25, 0.02

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """Ranges that the training flights covered, lowest and highest; NaN where unreported."""

    airspeed: Range  # m/s
    tank_kg: Range
    density: Range  # kg/m³
    height_agl: Range  # m
    wind_speed: Range  # m/s
    flights: tuple[str, ...]

    def covers_inputs(self, airspeed: Floats, tank_kg: Floats) -> Bools:
        """(N,) rows whose airspeed and tank level the network has learnt; NaN is not covered."""
        return _within(airspeed, self.airspeed, AIRSPEED_TOLERANCE) & _within(
            tank_kg, self.tank_kg, TANK_TOLERANCE
        )

    def covers(self, airspeed: Floats, tank_kg: Floats, density: Floats) -> Bools:
        """(N,) rows that are covered in airspeed, tank level and air density."""
        return self.covers_inputs(airspeed, tank_kg) & _within(
            density, self.density, DENSITY_TOLERANCE * self.density[1]
        )


def _within(values: Floats, limits: Range, tolerance: float) -> Bools:
    with np.errstate(invalid="ignore"):
        return (values >= limits[0] - tolerance) & (values <= limits[1] + tolerance)
