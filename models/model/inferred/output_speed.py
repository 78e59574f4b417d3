"""Make rotor speeds for a flight that reports motor outputs only, calibrated where thrust is known.

    ln N_i² = a + s ln(f(x_i)/f_hover) + n ln(V/V_c)

N_i equivalent rotor speed [rpm], x_i motor output, f the autopilot's thrust curve
(`physics.motor_output`), V battery voltage, V_c that of the airframe's ceiling. Priors: a
from the airframe's ceiling at full output, s = 1 by the curve, and n = 1, between an ESC that keeps
its speed (0; the Quiver's) and one that passes the voltage on (2). The flight updates all three by
least squares over means of 10 s, from any of the evidence it has:

    weight   N² = W/(cos(tilt) k rho/rho_ref sum e_i)   where the liquid is known
    power    N² ~ (V I/rho)^(2/3) up to a factor        battery's sag from load, as in hover
    rotors   N_r² of the rotors whose speed is measured

Each is one row of the same regression, so the standard error of each speed follows from it.
Nothing turns faster than at full output, and at full output a rotor turns as fast as it can: there
the ceiling is the speed, however the weight has set the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.inferred.speed_basis import HeardSpeeds, heard_speeds
from thrustmargin.models.model.inferred.utilisation_error import guessed_variance
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.flight_phases import hover_rows
from thrustmargin.models.physics.margin import ceiling, weight
from thrustmargin.models.physics.motor_output import OutputCurve, output_curve
from thrustmargin.models.physics.thrust_fits import check_one_hover
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.scores import Estimate
from thrustmargin.models.statement import state

SPAN = 10.0  # s of one mean
HOVER_SHARE = 0.35  # of full thrust, about which the curve is turned
#: Standard errors before the flight, of ln N²: maker's full thrust, voltage exponent
CEILING_ERROR, VOLTAGE_ERROR = 0.25, 1.0
#: Standard errors of one 10 s mean of ln N²: thrust against weight, against power, rotor's speed
MEAN_ERRORS = (0.02, 0.04, 0.02)
#: of ln N²: one motor and propeller against the next, and translational lift at 5 m/s (as square)
ROTOR_ERROR, LIFT_ERROR = 0.03, 0.05
STATED_ERROR = 0.03  # of ln N²: scale and bench, a stated weight over a fitted thrust curve
WAIT = 3.0  # s after which an ESC that reports has sent a speed
FULL = 0.98  # share of full thrust from which an output is full
EXACT = 1e-12  # of ln N²: not 0, for 0 is measured
LAG = 0.2  # s by which a rotor and the report of its speed follow its output (Quiver 77 and 80)
#: share of full thrust from which a row shows the ceiling, and s for which it must have lasted
NEAR_FULL, HELD = 0.9, 1.0
_WEIGHT, _POWER, _ROTORS = range(3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OutputCalibration:
    """The evidence of a flight so far for its output calibration, in sums for each 10 s.

    The three rows are the kinds of evidence (weight, power, rotors). Their five sums are weight w
    [s], w ln N², w ln f, w ln V and w (lift error)².
    """

    bins: Mapping[int, Floats] = field(default_factory=dict)  # time_s // SPAN -> (3, 5)
    heard: HeardSpeeds = field(default_factory=HeardSpeeds)
    last_s: float = np.nan  # s, time of the last row
    last_share: Floats | None = None

    def before(self, index: int) -> Self:
        """Return the evidence without bin `index` and later ones."""
        return replace(self, bins={k: sums for k, sums in self.bins.items() if k < index})

    @property
    def in_use(self) -> bool:
        """Return True if all rotor speeds so far were inferred from outputs, and some were."""
        return bool(self.bins) and not self.heard.rotors

    def seconds(self, kind: int) -> float:
        """Return the total time, s, of evidence of one kind: by weight, by power or by measured
        rotors.
        """
        return float(sum(sums[kind, 0] for sums in self.bins.values()))

    def fit(self, airframe: Airframe, curve: OutputCurve) -> tuple[Floats, Floats]:
        """Fit (a, s, n, p) to the bins and the priors; return the estimate (4,) and covariance (4,
        4).

        ln N² = a + s ln(f/f_hover) + n ln(V/V_c), with f the thrust share of an output and V_c the
        ceiling voltage; p is the offset of evidence by power.
        """
        full = np.log(airframe.max_rotor_speed_rpm**2)
        before = np.array([full + np.log(HOVER_SHARE), 1.0, 1.0, 0.0])
        spread = np.array([CEILING_ERROR, curve.steepness_error, VOLTAGE_ERROR, 100.0])
        information = np.diag(spread**-2.0)
        pull = information @ before
        for sums in self.bins.values():
            for kind, (seconds, *moments, _) in enumerate(sums):
                if seconds < 0.1 * SPAN:
                    continue
                square, share, volts = np.array(moments) / seconds
                row = np.array([1.0, share, volts, -1.0 if kind == _POWER else 0.0])
                certainty = seconds / SPAN / MEAN_ERRORS[kind] ** 2
                information = information + certainty * np.outer(row, row)
                pull = pull + certainty * row * square
        covariance = np.linalg.inv(information)
        return np.asarray(covariance @ pull), np.asarray(covariance, dtype=np.float64)

    def common_variance(self, airframe: Airframe) -> float:
        """Return the part of the variance of ln N² that more flight does not reduce.

        It comes from lift, and from a guessed mass or thrust curve. 0 without evidence by weight,
        or if any rotor's speed is measured.
        """
        sums = np.sum([bin_[_WEIGHT] for bin_ in self.bins.values()], axis=0)
        if not self.bins or sums[0] <= 0.0 or self.seconds(_ROTORS) > 0.0:
            return 0.0
        guesses = guessed_variance(airframe, "empty_mass", "thrust_coefficient")
        return float(sums[4] / sums[0]) + STATED_ERROR**2 + guesses


def filled_speeds(
    track: FlightTrack,
    airframe: Airframe,
    parameters: Mapping[str, float],
    so_far: OutputCalibration | None = None,
) -> tuple[FlightTrack, OutputCalibration]:
    """Fill in rotor speeds, estimated from the motor output, where a rotor reports no speed.

    `parameters` are the autopilot's, by name. Measured speeds stay; the standard errors and the
    source of the speeds are set in the track. With `so_far` the track continues a flight, and each
    row depends only on 10 s bins completed before it. Also return the calibration including these
    rows.
    """
    then = OutputCalibration() if so_far is None else so_far
    heard, lost, said = heard_speeds(track, None if so_far is None else then.heard)
    then = replace(then, heard=said)
    silent = ~heard & np.isfinite(track.throttle)
    # Rows with measured speeds calibrate the outputs for the rows that follow.
    of_use = silent if so_far is None else np.isfinite(track.throttle)
    if track.rotor_count != airframe.rotor_count or not np.any(of_use):
        return track, then
    curve = output_curve(parameters, track.source("throttle"))
    first = then.last_share is None
    seconds = np.diff(track.time_s, prepend=track.time_s[0] if first else then.last_s)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.log(curve.thrust_share(track.throttle) / HOVER_SHARE)
        volts = np.where(track.voltage > 0.0, track.voltage, airframe.nominal_voltage)
        volts = np.log(volts / airframe.ceiling_voltage)
        before = share[:1] if then.last_share is None else then.last_share[None]
        change = np.diff(share, axis=0, prepend=before) * (LAG / seconds)[:, None]
        bins = _add_evidence(then.bins, track, airframe, share, volts, np.minimum(seconds, 1.0))
    now = replace(then, bins=bins, last_s=float(track.time_s[-1]), last_share=share[-1])
    terms = np.stack([np.ones_like(share), share, np.broadcast_to(volts[:, None], share.shape)], -1)
    square, variance = np.empty_like(share), ROTOR_ERROR**2 + np.nan_to_num(change) ** 2
    place = (
        (track.time_s // SPAN).astype(int)
        if so_far is not None
        else np.zeros(track.time_s.size, int)
    )
    for index in np.unique(place).tolist():
        rows = place == index
        used = now.before(index) if so_far is not None else now
        found, covariance = used.fit(airframe, curve)
        square[rows] = terms[rows] @ found[:3]
        variance[rows] += used.common_variance(airframe)
        variance[rows] += np.einsum(
            "trj,jk,trk->tr", *(terms[rows], covariance[:3, :3], terms[rows])
        )
    if not np.any(silent):
        return track, now
    full = share >= np.log(FULL / HOVER_SHARE)
    most = ceiling(airframe, airframe.reference_density, track.voltage).max_rotor_speed_rpm[:, None]
    speed = np.where(full, most, np.minimum(np.exp(0.5 * square), most))
    variance[full] = EXACT**2
    put = silent & (track.flying & (track.time_s >= WAIT))[:, None] & np.isfinite(speed)
    filled = replace(
        track,
        rotor_speed_rpm=np.where(put, speed, track.rotor_speed_rpm),
        standard_errors={
            **track.standard_errors,
            "rotor_speed_rpm": np.where(put, 0.5 * np.sqrt(variance) * speed, 0.0),
        },
        sources={
            **track.sources,
            "rotor_speed_rpm": _speed_source(
                track, put, track.time_s[(put & lost).any(axis=1)], curve, now
            ),
        },
    )
    return filled, now


def _add_evidence(
    bins: Mapping[int, Floats],
    track: FlightTrack,
    airframe: Airframe,
    share: Floats,
    volts: Floats,
    seconds: Floats,
) -> dict[int, Floats]:
    """Return a copy of `bins` with the level, finite rows of a track added.

    A bin is SPAN seconds of the flight, its key their number. It holds sums (3, 5): one row of
    evidence by weight, by power, by measured rotors; columns 1, ln N², ln(f/f_hover), ln(V/V_c),
    squared error. `share` (T, R) is ln(f/f_hover) with f the thrust share of an output, `volts`
    (T,) is ln(V/V_c), `seconds` (T,) s that each row counts.
    """
    density = track_air(track).density
    density = density / airframe.reference_density
    cosine = np.prod(np.cos(np.nan_to_num(track.attitude[:, :2])), axis=1)
    effectiveness = airframe.rotor_effectiveness
    share_of = np.exp(share) @ effectiveness / effectiveness.sum()
    load = weight(
        airframe, track.tank_kg if airframe.tank_volume_l else np.nan_to_num(track.tank_kg)
    )
    carried = airframe.thrust_coefficient * density * effectiveness.sum() * cosine
    lift = LIFT_ERROR * (_speed_through_air(track) / 5.0) ** 2
    of_load = G0 * track.standard_errors.get("tank_kg", np.zeros_like(load)) / load
    power = (track.voltage * track.current / density) ** (2.0 / 3.0)
    level = _level(track, cosine)
    evidence = [
        (_WEIGHT, np.log(load / carried), np.log(share_of), np.hypot(lift, of_load)),
        (_POWER, np.log(power), np.log(share_of), lift),
    ]
    evidence += [
        (_ROTORS, np.log(track.rotor_speed_rpm[:, r] ** 2), share[:, r], np.zeros_like(lift))
        for r in range(track.rotor_count)
    ]
    found = {index: sums.copy() for index, sums in bins.items()}
    place = (track.time_s // SPAN).astype(int)
    for kind, square, f, error in evidence:
        trust = seconds / (1.0 + (error / MEAN_ERRORS[_WEIGHT]) ** 2)
        rows = np.stack([np.ones_like(f), square, f, volts, error**2], 1) * trust[:, None]
        good = level & np.all(np.isfinite(rows), axis=1)
        for index in np.unique(place[good]).tolist():
            added = rows[good & (place == index)].sum(axis=0)
            found.setdefault(index, np.zeros((3, 5)))[kind] += added
    return found


def _speed_through_air(track: FlightTrack) -> Floats:
    """Return the speed through the air (T,), m/s.

    It is airspeed, else ground speed less wind, else ground speed; 0 if unknown.
    """
    ground = np.hypot(*track.velocity_ned[:, :2].T)
    wind = np.hypot(*(track.velocity_ned - track.wind_ned)[:, :2].T)
    speed = np.where(np.isfinite(track.airspeed), track.airspeed, wind)
    return np.nan_to_num(np.where(np.isfinite(speed), speed, ground))


def _level(track: FlightTrack, cosine: Floats) -> Bools:
    """Flag the rows (T,) in flight with little climb, sink and bank; `cosine` (T,) of the tilt."""
    climb = np.nan_to_num(track.velocity_ned[:, 2])
    return track.flying & (np.abs(climb) < 0.5) & (cosine > 0.9)


def _speed_source(
    track: FlightTrack,
    put: Bools,
    lost_s: Floats,
    curve: OutputCurve,
    calibration: OutputCalibration,
) -> Provenance:
    """Return the provenance of rotor speeds inferred from motor outputs, flagged in `put` (T, R).

    Its remarks say how they are calibrated (by measured rotors, else by weight, else by full
    thrust), and for which rotors and times all speeds are inferred. `lost_s` (n,) are the times, s,
    without a measured speed of any rotor.
    """
    outputs = track.source("throttle")
    by_weight, by_rotors = calibration.seconds(_WEIGHT), calibration.seconds(_ROTORS)
    if by_rotors:
        how = state("set by measured rotors")
    elif by_weight:
        how = state("set by weight", seconds=by_weight)
    else:
        how = state("by full thrust")
    remarks = (state("outputs by curve", outputs=outputs.name, curve=curve.set_by), how)
    measured: tuple[Provenance, ...] = ()
    silent = put.any(axis=0) & ~calibration.heard.mask(put.shape[1])
    if calibration.heard.rotors:
        measured = (track.source("rotor_speed_rpm"),)
        if silent.any():
            rotors = tuple(state("rotor", rotor=str(k + 1)) for k in np.flatnonzero(silent))
            kind = "inferred rotors" if len(rotors) > 1 else "inferred rotor"
            remarks = (state(kind, rotors=rotors), *remarks)
    if lost_s.size:
        ends = (round(float(second)) for second in (lost_s[0], lost_s[-1]))
        start_clock, end_clock = map(float, ends)
        all_rotors = state("all rotors inferred", start_clock=start_clock, end_clock=end_clock)
        remarks = (all_rotors, *remarks)
    return Provenance(
        kind=SourceKind.INFERRED,
        meaning=Meaning.MOTOR_OUTPUTS,
        assumed=curve.is_assumed,
        parts=measured,
        rejected=track.source("rotor_speed_rpm").rejected,
        numbers=curve.numbers,
        remarks=remarks,
    )


def full_output_speed(
    flights: Sequence[tuple[FlightTrack, Mapping[str, float]]], airframe: Airframe
) -> tuple[Estimate, float]:
    """Estimate the rotor speed at full output, rpm, with its 95 % interval; also return its
    voltage, V.

    The voltage is the median over the flights, in flight; the airframe's nominal one where none is
    reported. Each flight comes with its autopilot's parameters; flights without outputs or with
    another number of rotors are left out. The estimate is by measured speeds if there are SPAN s of
    them, else by weight; the curve extrapolates from the outputs flown, which widens the interval.
    The airframe's own ceiling is the prior. Raise DataError with less evidence than SPAN s, or if
    hover rows need very different thrust.
    """
    curve, bins, volts = None, {}, []
    for number, (track, parameters) in enumerate(flights):
        if track.rotor_count != airframe.rotor_count or not track.reports("throttle"):
            continue
        curve = output_curve(parameters, track.source("throttle"))
        voltage = np.where(track.voltage > 0.0, track.voltage, airframe.nominal_voltage)
        volts.append(float(np.median(voltage[track.flying])) if track.flying.any() else np.nan)
        seconds = np.minimum(np.diff(track.time_s, prepend=track.time_s[0]), 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.log(curve.thrust_share(track.throttle) / HOVER_SHARE)
            there = np.log(voltage / airframe.ceiling_voltage)
            needed = np.mean(np.exp(share + there[:, None]), axis=1)
            needed /= airframe.empty_mass + np.nan_to_num(track.tank_kg)
            hover = hover_rows(track) & np.isfinite(needed)
            if hover.any() and not track.reports("rotor_speed_rpm"):
                check_one_hover(needed[hover])
            found = _add_evidence({}, track, airframe, share, there, seconds)
        bins |= {int(1e6 * number) + index: sums for index, sums in found.items()}
    learnt = OutputCalibration(bins=bins)
    if curve is None or learnt.seconds(_ROTORS) + learnt.seconds(_WEIGHT) < SPAN:
        raise DataError("no level flight with motor outputs and either rotor speeds or the weight")
    # Of two independent estimates the nearer one: the weight is by a curve that may be a guess.
    useless = slice(0, _ROTORS) if learnt.seconds(_ROTORS) >= SPAN else slice(_ROTORS, None)
    for sums in bins.values():
        sums[useless] = 0.0
    solution, covariance = learnt.fit(airframe, curve)
    seconds, _, share, *_ = np.sum([sums.sum(axis=0) for sums in bins.values()], axis=0)
    # From the outputs flown to full output the curve's form is only assumed.
    form = 0.5 * curve.steepness_error * (share / seconds + np.log(HOVER_SHARE))
    voltage = float(np.nanmedian(volts))
    row = np.array([1.0, -np.log(HOVER_SHARE), np.log(voltage / airframe.ceiling_voltage), 0.0])
    reach = 1.96 * np.sqrt(row @ covariance @ row + ROTOR_ERROR**2 + form**2)
    middle = float(row @ solution)
    low, value, high = (float(np.exp(0.5 * (middle + d))) for d in (-reach, 0.0, reach))
    return Estimate(value=value, low=low, high=high), voltage


def reached_full_output(
    flights: Sequence[tuple[FlightTrack, Mapping[str, float]]], airframe: Airframe
) -> tuple[Estimate, float] | None:
    """Estimate the rotor speed at full output, rpm, and its voltage, V, from rows near full
    throttle.

    By measured speeds: median of the mean N² of the rotors over their mean share of full thrust, in
    rows in which that share has been NEAR_FULL or more for longer than HELD s. The interval is of
    95 %. None where no flight has such rows.
    """
    squares, shares, volts, steepness = [], [], [], 0.0
    for track, parameters in flights:
        if track.rotor_count != airframe.rotor_count:
            continue
        curve = output_curve(parameters, track.source("throttle"))
        with np.errstate(invalid="ignore"):
            share = np.mean(curve.thrust_share(track.throttle), axis=1)
            square = np.mean(track.rotor_speed_rpm**2, axis=1)
            near = track.flying & (share >= NEAR_FULL) & np.isfinite(square)
        # Rotors spin up after the output rises, so the first HELD s of each climb are excluded.
        began = np.maximum.accumulate(np.where(near, -np.inf, track.time_s))
        rows = near & (track.time_s - np.where(np.isfinite(began), began, np.inf) > HELD)
        squares.append(square[rows])
        shares.append(share[rows])
        volts.append(np.where(track.voltage > 0.0, track.voltage, airframe.nominal_voltage)[rows])
        steepness = max(steepness, curve.steepness_error)
    if not sum(map(len, squares)):
        return None
    above = np.log(np.concatenate(shares))
    middle = float(np.median(np.log(np.concatenate(squares)) - above))
    form = steepness * float(np.median(np.abs(above)))
    reach = 1.96 * np.sqrt(ROTOR_ERROR**2 + MEAN_ERRORS[_ROTORS] ** 2 + form**2)
    low, value, high = (float(np.exp(0.5 * (middle + d))) for d in (-reach, 0.0, reach))
    return Estimate(value=value, low=low, high=high), float(np.median(np.concatenate(volts)))
