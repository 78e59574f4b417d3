"""Estimate an aircraft's load from the thrust of its level flight, by least squares.

    M = sum(T_i)/f                     apparent mass of a row [kg]
    M (1 + k (1 - v_i/v_h)) = m_empty + load,      load = L - r S,  r >= 0

T_i thrust by the airframe's curve [N], f specific force along the body's up axis [m/s²], so that
tilt and acceleration are included; k gain of translational lift, v_i/v_h by Glauert; L load at the
take-off [kg]; S seconds of spraying if the pump is reported, else of flight. There is one L for
each leg (time in the air), and one r and k for the flight, by least squares over means of 10 s,
which are nearly independent of each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.forward_flight import hover_induced_velocity, induced_ratio
from thrustmargin.models.physics.margin import rotor_thrust

SPAN = 10.0  # s of one mean
LEAST_SPAN = 3.0  # s of level rows that a mean needs
#: Live, rows are compared with the earlier evidence in blocks of BLOCK s, four to a span, with
#: LEAST_BLOCK s of level flight or more; JUMP standard errors off is another load.
BLOCK, LEAST_BLOCK, JUMP = SPAN / 4.0, 1.0, 5.0
LEVEL_CLIMB = 0.5  # m/s, beyond which climb changes the thrust of a rotor speed
LONGEST_STEP = 1.0  # s that one row may count for
#: s on the ground after which the load may differ; the shorter one if the evidence of a whole
#: flight prefers more legs.
ON_GROUND, BRIEFLY = 5.0, 1.0
#: Translational lift: blade theory for pitch over diameter of 0.3 to 0.4 gives 0.5 to 0.7, flights
#: have shown 0.1 to 0.6.
LIFT_GAIN, LIFT_GAIN_ERROR = 0.4, 0.3
SURELY_NONE = 3.0  # standard errors of it beyond which no rotor has such a gain
#: Standard errors as shares: the scatter of a mean before the flight shows it, as if by so many
#: means; one motor and propeller against the next.
MEAN_ERROR, WORTH, ROTOR_ERROR = 0.01, 3.0, 0.03
EMPTYING = 300.0  # s in which a pump of unknown flow may empty the tank
SLOWEST = 1e-3  # kg/s below which it counts as constant
KNOTS = 13  # times at which the fall may begin or end


class Means(NamedTuple):
    """Means over n stretches of level flight; arrays (n,)."""

    seconds: Floats
    leg: Floats
    mass: Floats  # kg, apparent
    lift: Floats  # 1 - v_i/v_h
    sprayed: Floats  # s since the start
    flown: Floats  # s since the start
    error: Floats  # variance of ln M by speeds that were themselves inferred


@dataclass(frozen=True, slots=True, eq=False)
class LoadEvidence:
    """The sums over a flight's level rows so far, and the state needed to continue them.

    The keys are (leg, span of SPAN s). The six sums of each are the s of level flight, and the
    integrals over time of `Means.mass`, `lift`, `sprayed`, `flown` and `error`.
    """

    sums: Mapping[tuple[int, int], Floats] = field(default_factory=dict)  # (leg, span) -> (6,)
    #: Sums of the last rows, not yet compared, and of rows before them that differed from the fit.
    newest: Mapping[tuple[int, int], Floats] = field(default_factory=dict)
    parted: Mapping[tuple[int, int], Floats] = field(default_factory=dict)
    gauged: bool = False  # the load was reported
    spraying: frozenset[float] = frozenset()  # reported states of the pump
    leg: int = 0  # number of legs so far
    flew_s: float = -np.inf  # when it last flew
    last_s: float = np.nan
    sprayed: float = 0.0
    flown: float = 0.0

    @property
    def whole(self) -> dict[tuple[int, int], Floats]:
        """Return the accepted sums plus those of the newest rows: (leg, span) -> (6,), as in
        `sums`."""
        return _add_sums(self.sums, self.newest)

    def before(self, span: int) -> LoadEvidence:
        """Return the evidence from spans earlier than number `span`, accepted sums alone."""
        kept = {key: s for key, s in self.sums.items() if key[1] < span}
        return replace(self, sums=kept, newest={}, parted={})

    def means(self) -> Floats:
        """Return (n, 7) `Means`, one in each row, of all spans with LEAST_SPAN s of level
        flight."""
        kept = [
            (s[0], leg, *(s[1:] / s[0])) for (leg, _), s in self.whole.items() if s[0] >= LEAST_SPAN
        ]
        return np.array(kept, dtype=np.float64).reshape(-1, 7)


class LoadFit(NamedTuple):
    """Load at the take-off of each leg and its fall for each second of S, with their covariance."""

    legs: tuple[int, ...]
    values: Floats  # (legs + 1,) kg, and kg/s
    covariance: Floats
    speeds: float  # variance of ln M by speeds that were themselves inferred
    scatter: float  # kg, of a mean about the fit
    gain: float  # k
    joint: Floats  # (legs + 2, legs + 2) covariance with that of k
    span: tuple[float, float] = (0.0, np.inf)  # s of S between which the load falls
    by_spraying: bool = False

    @property
    def falls(self) -> bool:
        """Return True if the load falls by more than SLOWEST kg/s."""
        return bool(self.values[-1] > SLOWEST)


def load_fit(shown: LoadEvidence, airframe: Airframe) -> LoadFit | None:
    """Fit the load to the means; None without means or if no credible gain of lift explains them.

    With the pump's state known the load falls while the pump is on, but may stop to: a pump may run
    on an empty tank. With it unknown, the load falls between two times of flight. The times are
    chosen by the Bayesian information criterion.
    """
    means = shown.means()
    return _cached_fit(means.tobytes(), shown.spraying, airframe) if means.size else None


@lru_cache(maxsize=256)  # a listener calls it with every row, but the means change every 10 s
def _cached_fit(shown: bytes, spraying: frozenset[float], airframe: Airframe) -> LoadFit | None:
    """Fit the load to block means, given as the bytes of an (n, 7) array of `Means`; cached.

    `spraying` are the distinct values of the pump's channel in flight: 1 on, 0 off, none unknown.
    The load falls while sprayed, or, with the pump unknown, between two times of flight that the
    fit selects. None if no fit has a credible lift gain.
    """
    means = Means(*np.frombuffer(shown).reshape(-1, 7).T)
    by_spraying = 1.0 in spraying
    seconds = means.sprayed if by_spraying else means.flown
    flow = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
    fastest = flow if by_spraying and flow > 0.0 else airframe.tank_capacity_kg / EMPTYING
    usual = 0.5 * fastest if by_spraying else 0.0
    if not by_spraying and spraying:  # the pump is reported to be off
        fastest = usual = 0.0
    knots = np.unique(np.quantile(seconds, np.linspace(0.0, 1.0, KNOTS)))[1:-1]
    if fastest == 0.0:
        knots = knots[:0]
    begins, ends = (0.0,) if by_spraying else (0.0, *knots), (np.inf, *knots)
    best, least = None, np.inf
    for begin, end in ((b, e) for b in begins for e in ends if b < e):
        fit = _least_squares(means, np.clip(seconds, begin, end) - begin, usual, fastest, airframe)
        found = (begin > 0.0) + np.isfinite(end)
        count = means.mass.size
        criterion = 2.0 * count * np.log(fit.scatter) + found * np.log(count)
        # A frozen or wrong airspeed would explain a change of load as lift.
        credible = abs(fit.gain - LIFT_GAIN) <= SURELY_NONE * LIFT_GAIN_ERROR
        if credible and criterion < least:
            best, least = fit._replace(span=(begin, end), by_spraying=by_spraying), criterion
    return best


def _least_squares(
    means: Means, seconds: Floats, usual: float, fastest: float, airframe: Airframe
) -> LoadFit:
    """Solve for the load at each leg's start, its rate of fall and the lift gain, with their
    priors.

    `seconds` (n,) is the time during which the load fell. The rate, kg/s, has the prior mean
    `usual` and standard deviation half of `fastest`; it is never negative.
    """
    legs = tuple(int(leg) for leg in np.unique(means.leg))
    rows = np.column_stack(
        [*(means.leg == leg for leg in legs), -seconds, -means.mass * means.lift]
    ).astype(np.float64)
    wanted = means.mass - airframe.empty_mass
    prior = np.array([*np.zeros(len(legs)), usual, LIFT_GAIN])
    spread = np.array([*np.full(len(legs), 1e3), max(0.5 * fastest, 1e-9), LIFT_GAIN_ERROR])
    usual_scatter = MEAN_ERROR * float(np.mean(means.mass))
    scatter = usual_scatter
    values, covariance = prior, np.diag(spread**2)
    for _ in range(3):
        weight = means.seconds / SPAN / scatter**2
        covariance = np.linalg.inv(np.diag(spread**-2.0) + rows.T @ (weight[:, None] * rows))
        values = covariance @ (prior / spread**2 + rows.T @ (weight * wanted))
        if values[-2] < 0.0:  # a tank does not fill in flight
            spread[-2], prior[-2] = 1e-9, 0.0
            continue
        square = np.sum(means.seconds / SPAN * (wanted - rows @ values) ** 2)
        free = max(means.mass.size - len(legs) - 1, 0)
        square += WORTH * usual_scatter**2
        scatter = float(np.sqrt(square / (WORTH + free)))
    return LoadFit(
        legs=legs,
        values=values[:-1],
        covariance=covariance[:-1, :-1].astype(np.float64),
        speeds=float(np.mean(means.error)),
        scatter=scatter,
        gain=float(values[-1]),
        joint=covariance.astype(np.float64),
    )


def load_at(
    fit: LoadFit, leg: Floats, seconds: Floats, airframe: Airframe
) -> tuple[Floats, Floats]:
    """Return the load (T,), kg, and its standard error (T,), kg.

    `leg` (T,) is each row's leg, `seconds` (T,) the time during which the load fell by then:
    sprayed or flown. NaN in legs that the fit does not contain. The error excludes the part that
    `shared_error` adds, which is the same for all rows.
    """
    fallen = np.clip(seconds, *fit.span) - fit.span[0]
    rows = np.column_stack([*(leg == one for one in fit.legs), -fallen]).astype(np.float64)
    load = rows @ fit.values
    variance = np.einsum("ti,ij,tj->t", rows, fit.covariance, rows) + fit.scatter**2
    rotors = ROTOR_ERROR**2 / airframe.rotor_count
    variance += (fit.speeds + rotors) * (airframe.empty_mass + load) ** 2
    known = np.isin(leg, fit.legs)
    return np.where(known, load, np.nan), np.where(known, np.sqrt(variance), np.nan)


def whole_flight_evidence(
    track: FlightTrack, airframe: Airframe
) -> tuple[LoadEvidence, Floats, Floats]:
    """Collect the evidence of load in a whole flight.

    A leg is a part of the flight with one load at its start. It begins after each stay on the
    ground, or only after long ones: after each if the Bayesian information criterion prefers it and
    both can be fitted. Return the evidence, the number of each row's leg (T,), and the seconds
    sprayed and flown since the leg began (T, 2).
    """
    long = collect_evidence(track, airframe, LoadEvidence())
    each = collect_evidence(track, airframe, LoadEvidence(), BRIEFLY)
    if each[0].leg == long[0].leg:
        return long
    fits = [load_fit(one[0], airframe) for one in (long, each)]
    if fits[0] is None or fits[1] is None:
        return long
    count = float(long[0].means()[:, 0].sum()) / SPAN
    criteria = [2.0 * count * np.log(f.scatter) + len(f.legs) * np.log(count) for f in fits if f]
    return each if criteria[1] < criteria[0] else long


def collect_evidence(
    track: FlightTrack, airframe: Airframe, so_far: LoadEvidence, on_ground: float = ON_GROUND
) -> tuple[LoadEvidence, Floats, Floats]:
    """Add the rows of a track to the evidence of load, `so_far`.

    Return the new evidence, each row's leg (T,), and the seconds sprayed and flown by then (T, 2).
    A leg begins after more than `on_ground` s on the ground.
    """
    time_s, flying = track.time_s, track.flying
    before = time_s[0] if np.isnan(so_far.last_s) else so_far.last_s
    step = np.minimum(np.diff(time_s, prepend=before), LONGEST_STEP)
    flew = np.maximum.accumulate(np.append(so_far.flew_s, np.where(flying, time_s, -np.inf)))
    leg = so_far.leg + np.cumsum(flying & (time_s - flew[:-1] > on_ground))
    sprayed = so_far.sprayed + np.cumsum(step * (flying & (track.spraying == 1.0)))
    flown = so_far.flown + np.cumsum(step * flying)
    air = track_air(track)
    thrust = rotor_thrust(airframe, track.rotor_speed_rpm, air.density).sum(axis=1)
    cosine = np.prod(np.cos(track.attitude[:, :2]), axis=1)
    felt = -track.specific_force_frd[:, 2]
    speed = np.hypot(*track.velocity_ned[:, :2].T)
    speed = np.nan_to_num(np.where(np.isfinite(track.airspeed), track.airspeed, speed))
    with np.errstate(invalid="ignore", divide="ignore"):
        mass = thrust / np.where(np.isfinite(felt), felt, G0 / cosine)
        lift = 1.0 - induced_ratio(speed / hover_induced_velocity(mass, air.density, airframe))
        inferred = track.standard_errors.get("rotor_speed_rpm")
        error = np.zeros(mass.size)
        if inferred is not None:
            error = np.mean((2.0 * inferred / track.rotor_speed_rpm) ** 2, axis=1)
    climb = np.nan_to_num(track.velocity_ned[:, 2])
    low = track.height_agl < airframe.propeller_diameter  # ground effect
    rows = np.stack([np.ones_like(mass), mass, lift, sprayed, flown, error], axis=1)
    used = flying & (np.abs(climb) < LEVEL_CLIMB) & ~low & np.all(np.isfinite(rows), axis=1)
    used &= (mass > 0.0) & (step > 0.0)
    sums = dict(so_far.sums)
    spans = spans_of(track)
    for key in {(int(a), int(b)) for a, b in zip(leg[used], spans[used], strict=True)}:
        here = used & (leg == key[0]) & (spans == key[1])
        sums[key] = sums.get(key, np.zeros(6)) + step[here] @ rows[here]
    heard = frozenset(track.spraying[flying & np.isfinite(track.spraying)].tolist())
    shown = replace(
        so_far,
        sums=sums,
        spraying=so_far.spraying | heard,
        leg=int(leg[-1]),
        flew_s=float(flew[-1]),
        last_s=float(time_s[-1]),
        sprayed=float(sprayed[-1]),
        flown=float(flown[-1]),
    )
    return shown, leg.astype(np.float64), np.stack([sprayed, flown], axis=1)


def accept_newest(shown: LoadEvidence, airframe: Airframe) -> LoadEvidence:
    """Add the newest rows to the sums of `shown`, or keep them apart if their load disagrees.

    Rows whose load is more than JUMP standard errors from the earlier fit's are kept apart. If the
    next rows disagree as much in the same direction, a load was dropped or taken up, and both sets
    of rows begin a new leg with its own load. Fewer than LEAST_BLOCK rows are only compared with
    rows kept apart before them.
    """
    rows = sum(shown.newest.values(), np.zeros(6))
    if not shown.newest or (rows[0] < LEAST_BLOCK and not shown.parted):
        return replace(shown, sums=_add_sums(shown.sums, shown.newest), newest={})
    if rows[0] < LEAST_BLOCK:
        return shown  # too few rows to compare
    leg, span = max(shown.newest)
    before = shown.parted if all(key[0] == leg for key in shown.parted) else {}
    fit = load_fit(shown.before(span), airframe)
    off = _standard_errors_off(fit, leg, rows, airframe)
    if abs(off) <= JUMP:
        sums = _add_sums(_add_sums(shown.sums, before), shown.newest)
        return replace(shown, sums=sums, newest={}, parted={})
    earlier = sum(before.values(), np.zeros(6))
    again = before and off * _standard_errors_off(fit, leg, earlier, airframe) > 0.0
    if not again:
        return replace(shown, newest={}, parted=shown.newest)
    apart = _add_sums(before, shown.newest)
    begun = {(shown.leg + 1, span): values for (_, span), values in apart.items()}
    return replace(
        shown, sums=_add_sums(shown.sums, begun), leg=shown.leg + 1, newest={}, parted={}
    )


def _standard_errors_off(fit: LoadFit | None, leg: int, sums: Floats, airframe: Airframe) -> float:
    """Return how many standard errors more load rows show than `fit` predicts for leg number `leg`.

    `sums` (6,) are over the rows: seconds, then mass, lift term, s sprayed, s flown and squared
    error, each times seconds. Return 0 if the fit is missing or does not contain `leg`.
    """
    if fit is None or leg not in fit.legs:
        return 0.0
    mass, lift, sprayed, flown, _ = sums[1:] / sums[0]
    fallen = np.clip(sprayed if fit.by_spraying else flown, *fit.span) - fit.span[0]
    row = np.array([*(one == leg for one in fit.legs), -fallen, -mass * lift], dtype=np.float64)
    off = mass - airframe.empty_mass - row @ np.append(fit.values, fit.gain)
    variance = row @ fit.joint @ row + fit.scatter**2 * SPAN / sums[0]
    return float(off / np.sqrt(variance))


def _add_sums(
    one: Mapping[tuple[int, int], Floats], other: Mapping[tuple[int, int], Floats]
) -> dict[tuple[int, int], Floats]:
    """Add two sets of sums, key by key."""
    return {**one, **{key: one.get(key, 0.0) + values for key, values in other.items()}}


def blocks_of(track: FlightTrack) -> Floats:
    """Return the number (T,) of each row's block of BLOCK s."""
    return np.floor(track.time_s / BLOCK).astype(np.float64)


def spans_of(track: FlightTrack) -> Floats:
    """Return the number (T,) of each row's span of SPAN s."""
    return np.floor(track.time_s / SPAN)
