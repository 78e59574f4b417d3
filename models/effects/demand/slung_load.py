"""A load on a cable: it swings, so its pull is not its share of the aircraft's own load factor.

The load hangs at distance l in direction q (a unit vector) below the hook. The hook's specific
force f (what an accelerometer reads, turned into room axes) drives it, whatever the load's mass m:

    l q'' = -(f - (f.q) q) - l |q'|² q - 2 zeta sqrt(g l) q'      tension = m (l |q'|² - f.q)

Source: spherical pendulum on a moving hook in Newtonian mechanics (for multirotors: Sreenath, Lee
and Kumar 2013). f is known from the log, so every cable length gives one history of the tension:
a table of lengths, read between its columns, makes the length a parameter with a derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from thrustmargin.models.effects.base import USUAL_ARM, Effect, Kind, Parameter, shaping
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import Bools, FlightTrack, Floats, body_axes
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0

SHORTEST = 4.0  # arms of the aircraft
RATIO = 1.035  # of neighbouring lengths
LENGTHS = 82  # the longest is 16 times the shortest
DAMPING = 0.03  # zeta, share of critical: assumed, the air drag of a load and its cable
MOST_PULL = 4.0  # weights of the load; beyond it a swing is not one
FINEST = 0.2  # rad of swing phase a step
FORGOTTEN = 10.0  # s without a row, after which the load is taken to hang at rest again
BRACKETS = 7  # pieces of the range of lengths, each searched from its middle
OVERLAP = 1.1


def cable_lengths(airframe: Airframe) -> Floats:
    """Cable lengths of the table, (LENGTHS,) m."""
    return SHORTEST * airframe.arm * RATIO ** np.arange(LENGTHS, dtype=np.float64)


class SwingState(NamedTuple):
    """Where the loads are at one row, and what drives them."""

    load: Floats  # (6, L) direction and its rate, NED
    force: Floats  # (3,) m/s² NED, the last known


class _Cables(NamedTuple):
    """What L cables do in the equation of motion, (L,) each."""

    shortness: Floats  # 1/m
    damping: Floats  # 1/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Swing:
    """A load on L cables, worked out along a flight of T rows; NaN where the log is silent."""

    direction_ned: Floats  # (T, L, 3) unit vector from the hook to the load
    pull: Floats  # (T, L) tension along the thrust axis, in weights of the load
    last: SwingState | None  # at the last row; None before any force was known


def cable_pull(
    track: FlightTrack, airframe: Airframe, start: SwingState | None = None
) -> tuple[Floats, SwingState | None]:
    """What a swinging load adds along the thrust axis, (T, lengths) in weights of the load.

    It is the tension along the axis less |f|/g, what the load would take if it did not swing: 0 in
    a steady hover. NaN without accelerometer or attitude. With it comes the state at the last row,
    and `start` is that at the first.
    """
    if start is not None:
        return _pulled(track, airframe, start)
    made = _PULLED.setdefault(track, {})
    if airframe.arm not in made:
        made[airframe.arm] = _pulled(track, airframe, None)
    return made[airframe.arm]


#: What was found of the tracks in use, by arm: a training asks for each of its flights ten times.
_PULLED: WeakKeyDictionary[FlightTrack, dict[float, tuple[Floats, SwingState | None]]] = (
    WeakKeyDictionary()
)


def _pulled(
    track: FlightTrack, airframe: Airframe, start: SwingState | None
) -> tuple[Floats, SwingState | None]:
    felt = np.linalg.norm(track.specific_force_frd, axis=1) / G0
    swung = swing(track, cable_lengths(airframe), start)
    return swung.pull - felt[:, None], swung.last


def swing(track: FlightTrack, lengths: Floats, start: SwingState | None = None) -> Swing:
    """The load on cables of `lengths` (L,) m. Without a `start`, and after a pause of the rows, it
    hangs at rest, along the row's apparent gravity. It takes the last known force where a row has
    none."""
    rows = track.time_s.size
    force, down = force_ned(track)
    known: Bools = np.all(np.isfinite(force) & np.isfinite(down), axis=1)
    directions = np.full((rows, lengths.size, 3), np.nan)
    pull = np.full((rows, lengths.size), np.nan)
    if start is None and not known.any():
        return Swing(direction_ned=directions, pull=pull, last=None)
    if start is None:
        first = int(np.argmax(known))
        f = force[first]
        state = _at_rest(f, lengths.size)
    else:
        first, (state, f) = 0, start
    swings = np.sqrt(G0 / lengths)
    cables, fastest = _Cables(1.0 / lengths, 2.0 * DAMPING * swings), float(swings.max())
    for t in range(first, rows):
        direction, rate = state[:3], state[3:]
        if known[t]:
            tension = lengths * _products(rate, rate) - f @ direction
            directions[t] = direction.T
            pull[t] = np.clip(tension * (down[t] @ direction) / G0, 0.0, MOST_PULL)
        if t + 1 < rows:
            after = force[t + 1] if known[t + 1] else f
            span = float(track.time_s[t + 1] - track.time_s[t])
            if span > FORGOTTEN:
                state, f = _at_rest(after, lengths.size), after
                continue
            steps = max(1, int(np.ceil(span * fastest / FINEST)))
            for k in range(steps):
                part = [f + (after - f) * (k + c) / steps for c in (0.0, 0.5, 1.0)]
                state = _step(state, part, cables, span / steps)
            f = after
    return Swing(direction_ned=directions, pull=pull, last=SwingState(state, f))


def _at_rest(force: Floats, count: int) -> Floats:
    """Direction and rate (6, L) of `count` loads that hang along the apparent gravity."""
    state = np.zeros((6, count))
    state[:3] = (-force / np.linalg.norm(force))[:, None]
    return state


def _step(state: Floats, force: list[Floats], cables: _Cables, span: float) -> Floats:
    """Direction and rate (6, L) `span` s later: Runge-Kutta of order 4, back on the sphere.

    `force` is that at the start, in the middle and at the end of the step.
    """
    start, middle, end = force
    k1 = _motion(state, start, cables)
    k2 = _motion(state + 0.5 * span * k1, middle, cables)
    k3 = _motion(state + 0.5 * span * k2, middle, cables)
    k4 = _motion(state + span * k3, end, cables)
    after = state + span / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    after[:3] /= np.sqrt(_products(after[:3], after[:3]))
    after[3:] -= _products(after[3:], after[:3]) * after[:3]
    return after


def _motion(state: Floats, force: Floats, cables: _Cables) -> Floats:
    """Time derivative of direction and rate, (6, L)."""
    direction, rate = state[:3], state[3:]
    inward = (force @ direction) * cables.shortness - _products(rate, rate)
    moved = np.empty_like(state)
    moved[:3] = rate
    moved[3:] = inward * direction - force[:, None] * cables.shortness - cables.damping * rate
    return moved


def _products(one: Floats, other: Floats) -> Floats:
    """(L,) products of vectors (3, L)."""
    return np.einsum("il,il->l", one, other)


def force_ned(track: FlightTrack) -> tuple[Floats, Floats]:
    """Specific force (T, 3) m/s² in NED and the body's down axis (T, 3) in NED."""
    forward, right, down = body_axes(track.attitude)
    body = track.specific_force_frd
    return body[:, :1] * forward + body[:, 1:2] * right + body[:, 2:] * down, down


def _slung_load(p, x: Channels, thrust):
    columns = np.arange(LENGTHS, dtype=np.float64)
    u = np.abs(np.log(p["cable"] / (SHORTEST * x.arm) + 0.0 * columns) / log(RATIO) - columns)
    near = (1.5 * u - 2.5) * u * u + 1.0  # cubic convolution (Keys 1981), as for delays
    far = ((-0.5 * u + 2.5) * u - 4.0) * u + 2.0
    weights = np.where(u < 1, near, np.where(u < 2, far, 0.0 * u))
    return thrust + p["mass"] * G0 * (x.own["slung_load"] @ weights)


def _bracket(number: int) -> Effect:
    """The effect with the cable in one piece of the range: the fit follows a swing's phase only
    from a length near the true one."""
    width = RATIO ** ((LENGTHS - 1) / BRACKETS)
    low, longest = SHORTEST * width**number, SHORTEST * RATIO ** (LENGTHS - 1)
    return Effect(
        name="slung_load",
        variant=f"cable of {low:.0f} to {low * width:.0f} arms",
        one_variant=True,
        kind=Kind.DEMAND,
        parameters=(
            Parameter(name="mass", unit="kg", lower=-2.0, upper=20.0, scale=2.0, smallest=0.1),
            shaping(
                "cable",
                "m",
                start=low * width**0.5 * USUAL_ARM,
                lower=max(SHORTEST, low / OVERLAP) * USUAL_ARM,
                upper=min(longest, low * width * OVERLAP) * USUAL_ARM,
                scale=0.2 * low * USUAL_ARM,
            ),
        ),
        needs=("slung_load",),
        neutral={"slung_load": 0.0},
        with_tank=False,
        source="a load on a cable swings as a spherical pendulum below the aircraft, driven by the "
        "specific force that the aircraft feels; its mass is part of the weight already",
        apply=_slung_load,
        own_channel=cable_pull,
    )


SLUNG_LOADS = tuple(_bracket(k) for k in range(BRACKETS))
EFFECTS = SLUNG_LOADS
