"""A plain regression of rotor speed on flights with every channel: what a search must reach.

For each rotor by least squares, with n the accelerometer's load factor |f|/g, J the advance ratio
of the climb along the thrust axis, u and v the speeds forward and right in the rotors' plane:

    N² = b0 + n (b1 + b2 J + b3 u + b4 v + b5 (u² + v²)) + b6..8 rate + b9..11 angular acceleration

It shares nothing with `identification.loop` and names nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests.lab.measured.crazyflie import MeasuredFlight
from tests.lab.measured.findings import rmse
from tests.lab.measured.thrust_check import DIAMETER
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats, body_axes
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.physics.smoothing import derivative

G0 = 9.80665  # m/s²

RATE_SPAN = 0.1  # s over which the turn rate is differentiated


def regression_rmse_rpm(fit: Sequence[MeasuredFlight], held: Sequence[MeasuredFlight]) -> float:
    """RMSE over rotors and rows of the flights `held`, learnt from the flights `fit`.

    Raises DataError when either has no row with every channel.
    """
    (x, squares), (new, new_squares) = _rows(fit), _rows(held)
    found = np.linalg.lstsq(x, squares, rcond=None)[0]
    return rmse(np.sqrt(new_squares) - np.sqrt(np.maximum(new @ found, 0.0)))


def _rows(flights: Sequence[MeasuredFlight]) -> tuple[Floats, Floats]:
    """Columns (T, 12) and squared speeds (T, R) rpm² of the flights' rows in the air."""
    columns, squares = [], []
    for flight in flights:
        track = flight.track
        forward, right, up = (
            np.sum(track.velocity_ned * axis, axis=1) * sign
            for axis, sign in zip(body_axes(track.attitude), (1, 1, -1), strict=True)
        )
        factor = np.linalg.norm(track.specific_force_frd, axis=1) / G0
        ratio = up * 60.0 / (np.nanmedian(track.rotor_speed_rpm) * DIAMETER)
        rate = track.angular_rate_frd
        plane = [np.ones_like(up), ratio, forward, right, forward**2 + right**2]
        x = np.column_stack(
            [
                np.ones_like(up),
                *(factor * column for column in plane),
                rate,
                derivative(track.time_s, rate, RATE_SPAN),
            ]
        )
        n2 = track.rotor_speed_rpm**2
        good = training_rows(track) & np.isfinite(x).all(axis=1) & np.isfinite(n2).all(axis=1)
        columns.append(x[good])
        squares.append(n2[good])
    if not columns or not sum(map(len, columns)):
        raise DataError("no row in flight with every channel of the regression")
    return np.concatenate(columns), np.concatenate(squares)
