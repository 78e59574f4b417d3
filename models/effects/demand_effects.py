"""Effects on the total thrust that the rotors must make.

Extra mass, load factor, parasite drag and a slung load. A load on a cable swings, so its pull is
not its share of the aircraft's own load factor. The load hangs at distance l in direction q (a unit
vector) below the hook. The hook's specific force f (what an accelerometer reads, turned into NED
axes) drives it, whatever the load's mass m:

    l q'' = -(f - (f.q) q) - l |q'|² q - 2 zeta sqrt(g l) q'      tension = m (l |q'|² - f.q)

Source: spherical pendulum on a moving hook in Newtonian mechanics (for multirotors: Sreenath, Lee
and Kumar 2013). The log contains f, so every cable length gives one history of the tension. A table
of lengths, interpolated between its columns, makes the length a parameter with a derivative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from thrustmargin.models.effects.base import USUAL_ARM, Effect, Kind, Parameter, shaping
from thrustmargin.models.effects.channels import (
    ALONG_SPAN,
    LOAD_LOOK,
    Channels,
    derivative_look,
    lag_weights,
    shifts_look,
)
from thrustmargin.models.flight import Bools, FlightTrack, Floats, body_axes
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0

EXTRA_MASS = Effect(
    name="extra_mass",
    kind=Kind.DEMAND,
    parameters=(
        # Smallest: 0.5 % of the empty aircraft, by what is taken along or left in hoses.
        Parameter(name="mass", unit="kg", lower=-10.0, upper=20.0, scale=2.0, smallest=0.1),
    ),
    needs=("total_mass",),
    source="weight: mass that the tank gauge does not see",
    apply=lambda p, x, thrust: thrust * (1.0 + p["mass"] / x.total_mass),
    on_airframe=lambda p, airframe, rotor: replace(
        airframe, empty_mass=airframe.empty_mass + float(p["mass"])
    ),
    one_variant=True,
)

#: It shifts the centre of gravity too, and by how much is known with the mass.
ARM_WEIGHT = replace(
    EXTRA_MASS,
    variant="on an arm",
    parameters=tuple(replace(p, upper=10.0) for p in EXTRA_MASS.parameters),
    of_one_rotor=True,
    source="weight at the end of one arm, which that rotor and its neighbours carry",
)


def _with_load_factor(p, x: Channels, thrust):
    """Scale the thrust (T,) N by the load factor, a blend of motion and IMU."""
    weights = lag_weights(p["lag"] - x.delay, p["derivative_correction"])
    kinematic = x.load_factor_shifts @ weights
    felt = x.manoeuvre_load_shifts @ weights
    blend = kinematic + p["imu_share"] * (felt - kinematic)
    return thrust * (1.0 + p["gain"] * (blend - 1.0))


LOAD_FACTOR = Effect(
    name="load_factor",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="gain",
            unit="1",
            start=0.5,
            lower=-0.5,
            upper=2.0,
            scale=1.0,
            smallest=0.05,  # by how well a velocity a few times a second shows an acceleration
            accuracy=0.05,  # of the derivative of a velocity that is sampled and noisy
        ),
        shaping("imu_share", "1", start=0.5, lower=0.0, upper=1.0, scale=1.0),
        shaping("derivative_correction", "1", start=0.0, lower=-0.33, upper=0.5, scale=0.2),
        shaping("lag", "s", start=0.05, lower=0.0, upper=0.3, scale=0.2),
    ),
    needs=("load_factor_shifts",),
    neutral={"load_factor_shifts": 1.0, "manoeuvre_load_shifts": 1.0},
    of_every_aircraft=True,
    source="Newton: thrust over weight is |specific force| / g in turns, climbs and gusts; "
    "the derivative correction gives back what reports a few times a second smooth away, or "
    "smooths their noise",
    apply=_with_load_factor,
    change=lambda effect, has, scatter: None,  # Newton's law is the same on every day
    looks=lambda p: shifts_look(p["lag"], LOAD_LOOK),
)


def _with_drag(p, x: Channels, thrust):
    """Return the thrust (T,) N with parasite drag and its work while speeding up."""
    area = p["drag_area"]
    pressure = 0.5 * x.density * x.airspeed**2
    pushed = 2.0 * pressure * area * thrust / G0 * x.along_acceleration
    square = thrust**2 + pressure**2 * area * abs(area) + pushed
    floor = 0.25 * thrust**2
    return np.sqrt(np.where(square > floor, square, floor))


PARASITE_DRAG = Effect(
    name="parasite_drag",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="drag_area",
            unit="m^2",
            start=0.5,
            lower=-1.0,  # the base model may already contain so much
            upper=6.0,
            scale=1.0,
            smallest=0.05,  # hoses, wet covers, and wind that nobody reports
        ),
    ),
    needs=("airspeed", "density"),
    neutral={"airspeed": 0.0},
    of_every_aircraft=True,
    source="thrust carries weight, drag and acceleration: |m (a - g) - D|, D = rho CdA V^2 / 2, so "
    "its square has D^2 and, while speeding up along the way, 2 D m a",
    apply=_with_drag,
    looks=lambda p: (derivative_look(ALONG_SPAN), derivative_look(ALONG_SPAN)),
)


SHORTEST = 4.0  # arms of the aircraft
RATIO = 1.035  # of neighbouring lengths
LENGTHS = 82  # the longest is 16 times the shortest
DAMPING = 0.03  # zeta, share of critical: assumed, the air drag of a load and its cable
MOST_PULL = 4.0  # weights of the load; a larger pull is not credible
FINEST = 0.2  # rad of swing phase for each step, at most
FORGOTTEN = 10.0  # s without a row, after which the load is assumed at rest
BRACKETS = 7  # parts of the range of lengths, each searched from its middle
OVERLAP = 1.1


def cable_lengths(airframe: Airframe) -> Floats:
    """Return the cable lengths (LENGTHS,) m of the table."""
    return SHORTEST * airframe.arm * RATIO ** np.arange(LENGTHS, dtype=np.float64)


class SwingState(NamedTuple):
    """The state of L swinging loads at one row."""

    load: Floats  # (6, L) direction and its rate, NED
    force: Floats  # (3,) m/s² NED, the last known


class _Cables(NamedTuple):
    """The constants of L cables in the equation of motion, (L,) each."""

    shortness: Floats  # 1/m
    damping: Floats  # 1/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Swing:
    """The motion of a load on each of L cables over a flight of T rows; NaN without force or
    attitude."""

    direction_ned: Floats  # (T, L, 3) unit vector from the hook to the load
    pull: Floats  # (T, L) tension along the thrust axis, in weights of the load
    last: SwingState | None  # at the last row; None before any force was known


def cable_pull(
    track: FlightTrack, airframe: Airframe, start: SwingState | None = None
) -> tuple[Floats, SwingState | None]:
    """Return the extra pull (T, LENGTHS) of a swinging load along the thrust axis, over its weight.

    It is the cable's tension along the axis less that of a load that does not swing, which is |f|/g
    with f the specific force: 0 in a steady hover. One column for each cable length. NaN without
    accelerometer or attitude. Also return the state after the last row, to pass as `start` with the
    next rows.
    """
    if start is not None:
        return _compute_pull(track, airframe, start)
    made = _PULL_CACHE.setdefault(track, {})
    if airframe.arm not in made:
        made[airframe.arm] = _compute_pull(track, airframe, None)
    return made[airframe.arm]


#: Cache by track and arm: a training needs each flight about ten times.
_PULL_CACHE: WeakKeyDictionary[FlightTrack, dict[float, tuple[Floats, SwingState | None]]] = (
    WeakKeyDictionary()
)


def _compute_pull(
    track: FlightTrack, airframe: Airframe, start: SwingState | None
) -> tuple[Floats, SwingState | None]:
    """Compute the additional pull, as `cable_pull` without its cache."""
    felt = np.linalg.norm(track.specific_force_frd, axis=1) / G0
    swung = swing(track, cable_lengths(airframe), start)
    return swung.pull - felt[:, None], swung.last


def swing(track: FlightTrack, lengths: Floats, start: SwingState | None = None) -> Swing:
    """Simulate the direction (T, L, 3) and pull (T, L) of a load on cables of `lengths` (L,) m.

    Direction is a unit vector, NED, from aircraft to load; pull is along the thrust axis, over the
    load's weight. Without `start`, and after a pause of FORGOTTEN s, the load hangs at rest along
    the apparent gravity of the row. Rows without a specific force use the last known one; their
    results are NaN.
    """
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
    """Return direction and rate (6, L) of `count` loads that hang along the apparent gravity."""
    state = np.zeros((6, count))
    state[:3] = (-force / np.linalg.norm(force))[:, None]
    return state


def _step(state: Floats, force: list[Floats], cables: _Cables, span: float) -> Floats:
    """Advance direction and rate (6, L) of L cables by `span` s by a Runge-Kutta step of order 4.

    `force` has the specific forces (3,), m/s² NED, at the start, in the middle and at the end of
    the step. Directions are normalised to the unit sphere, rates made tangential to it.
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
    """Return the time derivative (6, L) of direction and rate."""
    direction, rate = state[:3], state[3:]
    inward = (force @ direction) * cables.shortness - _products(rate, rate)
    moved = np.empty_like(state)
    moved[:3] = rate
    moved[3:] = inward * direction - force[:, None] * cables.shortness - cables.damping * rate
    return moved


def _products(one: Floats, other: Floats) -> Floats:
    """Return the scalar products (L,) of vectors (3, L)."""
    return np.einsum("il,il->l", one, other)


def force_ned(track: FlightTrack) -> tuple[Floats, Floats]:
    """Return the specific force (T, 3) m/s² in NED and the body's down axis (T, 3) in NED."""
    forward, right, down = body_axes(track.attitude)
    body = track.specific_force_frd
    return body[:, :1] * forward + body[:, 1:2] * right + body[:, 2:] * down, down


def _with_slung_load(p, x: Channels, thrust):
    """Add the pull of a slung load to the thrust (T,) N, interpolated in the cable length."""
    columns = np.arange(LENGTHS, dtype=np.float64)
    u = np.abs(np.log(p["cable"] / (SHORTEST * x.arm) + 0.0 * columns) / log(RATIO) - columns)
    near = (1.5 * u - 2.5) * u * u + 1.0  # cubic convolution (Keys 1981), as for delays
    far = ((-0.5 * u + 2.5) * u - 4.0) * u + 2.0
    weights = np.where(u < 1, near, np.where(u < 2, far, 0.0 * u))
    return thrust + p["mass"] * G0 * (x.own["slung_load"] @ weights)


def _cable_bracket(number: int) -> Effect:
    """Return the effect of a slung load whose cable length, m, is limited to part `number` of the
    range, from 0.

    The range of lengths is divided into BRACKETS parts of equal ratio, which overlap, because the
    fit can follow a swing's phase only from a length near the true one.
    """
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
        apply=_with_slung_load,
        own_channel=cable_pull,
    )


SLUNG_LOADS = tuple(_cable_bracket(k) for k in range(BRACKETS))


EFFECTS = (EXTRA_MASS, ARM_WEIGHT, LOAD_FACTOR, PARASITE_DRAG, *SLUNG_LOADS)
