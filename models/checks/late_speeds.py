"""Do rotor speeds and acceleration have the same clock?

What the rotors do more, the body feels at once: their squared speeds together rise and fall with
the upward specific force. A table put together from two logs, or telemetry that queues, has one of
the two seconds later, and manoeuvres would be explained by inertias that nothing has. Delays up to
`USUAL` are a matter of the fit (effect `sensor_lag` of the rotor speeds); beyond is another clock.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.checks.motor_order import ANSWERS, DECISIVE, FEWEST_ROWS
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.smoothing import running_mean

USUAL = 1.4  # s, either way
REACH = 10.0  # s, either way, that are tried
TREND = 5.0  # s of the running mean that is taken out: the tank and climbs drift
SMOOTH_ROWS = 3  # rows over which a body feels what its rotors do, and its noise evens out


def late_speeds(track: FlightTrack) -> str | None:
    """Why the rotor speeds of a flight are of other seconds than its acceleration, and what to do.

    None where they are not, or where the flight moves too little to tell.
    """
    delay_s, correlation, likelihood = delays(track)
    if not delay_s.size:
        return None
    usual = np.abs(delay_s) <= USUAL + (delay_s[1] - delay_s[0]) / 2.0
    best, at_usual = np.argmax(likelihood), np.argmax(np.where(usual, likelihood, -1.0))
    lead = likelihood[best] - likelihood[at_usual]
    if usual[best] or correlation[best] < ANSWERS or lead < DECISIVE:
        return None
    late = delay_s[best]
    return (
        f"rotor speeds come {abs(late):.1f} s {'after' if late > 0 else 'before'} the acceleration "
        f"that they make (correlation {correlation[best]:.2f}; {correlation[at_usual]:.2f} within "
        f"{USUAL:g} s): they have another clock; move them by {-late:+.1f} s"
    )


def delays(track: FlightTrack) -> tuple[Floats, Floats, Floats]:
    """Delays (D,) s of rotor speeds, correlation at each (D,), log-likelihood over none (D,).

    Empty where specific force or rotor speeds are not known in `FEWEST_ROWS` rows of the flight.
    """
    time_s = track.time_s
    squares = np.sum(track.rotor_speed_rpm**2, axis=1)
    upward = -track.specific_force_frd[:, 2]
    known = track.flying & np.isfinite(squares) & np.isfinite(upward)
    empty = np.empty(0)
    if np.sum(known) < FEWEST_ROWS:
        return empty, empty, empty
    step = float(np.median(np.diff(time_s[known])))
    if not REACH / 1000.0 < step <= USUAL / 2.0:
        return empty, empty, empty
    grid = np.arange(time_s[known][0], time_s[known][-1], step)
    # Rows beside pauses and landings are joined by a line; a delay that is real outweighs them.
    together, felt = (
        _quick(np.interp(grid, time_s[known], c[known]), step) for c in (squares, upward)
    )
    furthest = min(round(REACH / step), grid.size - FEWEST_ROWS)
    if furthest < 1:
        return empty, empty, empty
    rows = np.arange(-furthest, furthest + 1)
    found = np.array([_alike(together[max(k, 0) :], felt[max(-k, 0) :]) for k in rows])
    return (rows * step).astype(np.float64), found[:, 0], found[:, 1]


def _quick(values: Floats, step: float) -> Floats:
    """Without its running mean, and smoothed."""
    values = values - running_mean(values, round(TREND / step) | 1)
    return running_mean(values, SMOOTH_ROWS)


def _alike(one: Floats, other: Floats) -> tuple[float, float]:
    """Correlation of what two have in common from their first row on, and its log-likelihood.

    Neighbours are alike: independent samples are fewer by Bartlett's rule (1935) for two
    autoregressive series of first order.
    """
    rows = min(one.size, other.size)
    one, other = one[:rows], other[:rows]
    powers = float(one @ one), float(other @ other)
    if min(powers) <= 0.0:
        return 0.0, 0.0
    correlation = float(one @ other) / np.sqrt(powers[0] * powers[1])
    both = float(one[1:] @ one[:-1]) * float(other[1:] @ other[:-1]) / (powers[0] * powers[1])
    samples = rows * (1.0 - both) / (1.0 + both)
    explained = min(max(correlation, 0.0), 0.999999) ** 2
    return correlation, -0.5 * samples * float(np.log1p(-explained))
