"""Prediction error of one flight with honest intervals: from blocks of time, not sample counts.

Samples of one flight follow each other, so their number says little about how sure a figure is.
Moving-block bootstrap (Kuensch 1989): the flight is put together again and again from stretches of
`BLOCK_S` drawn at random; the spread of a figure over these is its standard error. With few blocks
a percentile interval is too narrow (about 80 % of intervals made to hold 95 % do), so the interval
is the figure +- Student's t with one degree of freedom less than blocks; RMSE on a log scale, R2 by
log(1 - R2), coverage cut to 0..1. It tells about gusts and turns of this flight; another day may
differ by more.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath

import numpy as np
from scipy import stats

from thrustmargin.gcs_plugin.reports.margin.data import Accuracy, Estimate, RotorError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis

#: Longer than a line end with its turns, so that blocks are nearly independent of each other.
BLOCK_S = 20.0
#: With fewer blocks than this the spread cannot be told.
FEWEST_BLOCKS = 5
CONFIDENCE = 0.95
REPLICATES = 2000
TRAINED_ON = (
    "The network learnt from a flight of this name: the error on a new flight is likely larger."
)

# Columns of the sums from which every figure is made.
_N, _E, _EE, _Y, _YY, _INSIDE, _WITH_INTERVAL = range(7)


def accuracy(analysis: FlightAnalysis, rotor_names: tuple[str, ...]) -> Accuracy:
    """RMSE, bias, R2 and interval coverage per rotor and overall, over the airborne rows.

    Overall RMSE and coverage pool the rotors; overall R2 is the mean of the rotors' R2, as the
    paper's table has it.
    """
    track, prediction = analysis.track, analysis.prediction
    sums = np.stack(
        [
            error_sums(
                track.rotor_speed_rpm[:, k],
                prediction.rotor_speed_rpm[:, k],
                prediction.lower_rpm[:, k],
                prediction.upper_rpm[:, k],
                track.flying,
            )
            for k in range(track.rotor_count)
        ],
        axis=1,
    )  # (T, R, 7)
    used = np.any(sums[..., _N] > 0, axis=1)
    if not np.any(used):
        return _nothing(prediction.coverage, analysis)
    first, last = np.flatnonzero(used)[[0, -1]]
    span = slice(int(first), int(last) + 1)
    whole = sums[span].sum(axis=0)
    drawn, blocks = moving_block_sums(track.time_s[span], sums[span], block_s=BLOCK_S)
    rotors = tuple(
        _rotor_error(k + 1, name, whole[k], drawn[:, k], blocks)
        for k, name in enumerate(rotor_names)
        if whole[k, _N] > 0
    )
    overall = _rotor_error(0, "all rotors", whole.sum(axis=0), drawn.sum(axis=1), blocks)
    r2 = _estimate(float(_mean_r2(whole)), _mean_r2(drawn), blocks, scale="explained")
    overall = replace(overall, r2=r2)
    trained = trained_on(analysis)
    if blocks >= FEWEST_BLOCKS:
        words = (
            f"In brackets the {CONFIDENCE * 100:.0f} % interval, from {blocks} blocks of "
            f"{BLOCK_S:.0f} s of this flight: it covers its gusts and turns, not other days."
        )
    else:
        words = (
            f"No intervals: the flight has {blocks} blocks of {BLOCK_S:.0f} s, and fewer than "
            f"{FEWEST_BLOCKS} cannot tell how sure a figure is."
        )
    return Accuracy(
        rotors=rotors,
        overall=overall,
        promised_coverage=float(prediction.coverage),
        block_s=BLOCK_S,
        blocks=blocks,
        confidence=CONFIDENCE,
        trained_on=trained,
        words=f"{TRAINED_ON} {words}" if trained else words,
    )


def trained_on(analysis: FlightAnalysis) -> bool:
    """True when a flight of this name, whatever the format of its log, trained the network."""
    envelope = analysis.model.envelope
    name = PurePath(analysis.track.name).stem
    return envelope is not None and name in {PurePath(f).stem for f in envelope.flights}


def error_sums(
    measured: Floats, predicted: Floats, lower: Floats, upper: Floats, rows: Bools
) -> Floats:
    """(T, 7) terms of one rotor whose sums give its figures; zero in rows that do not count.

    Measured speed is taken about its own mean, so that squares do not cancel digits.
    """
    good = rows & np.isfinite(measured) & np.isfinite(predicted)
    bounded = good & np.isfinite(lower) & np.isfinite(upper)
    error = np.where(good, measured - predicted, 0.0)
    centre = float(measured[good].mean()) if np.any(good) else 0.0
    about = np.where(good, measured - centre, 0.0)
    inside = bounded & (measured >= lower) & (measured <= upper)
    return np.stack([good, error, error**2, about, about**2, inside, bounded], axis=1).astype(
        np.float64
    )


def moving_block_sums(
    time_s: Floats, terms: Floats, *, block_s: float, replicates: int = REPLICATES, seed: int = 0
) -> tuple[Floats, int]:
    """Sums of `terms` (T, ...) over flights put together from random blocks: (replicates, ...).

    A block starts at any row that leaves room for it. Also returns how many blocks make a flight;
    with fewer than FEWEST_BLOCKS nothing is drawn and the sums are NaN.
    """
    duration = float(time_s[-1] - time_s[0])
    blocks = int(duration // block_s)
    if blocks < FEWEST_BLOCKS:
        return np.full((1, *terms.shape[1:]), np.nan), blocks
    running = np.concatenate([np.zeros((1, *terms.shape[1:])), np.cumsum(terms, axis=0)])
    starts = np.flatnonzero(time_s <= time_s[-1] - block_s)
    ends = np.searchsorted(time_s, time_s[starts] + block_s)
    of_block = running[ends] - running[starts]
    picks = np.random.default_rng(seed).integers(0, starts.size, (replicates, blocks))
    drawn = np.zeros((replicates, *terms.shape[1:]))
    for k in range(blocks):
        drawn += of_block[picks[:, k]]
    return drawn, blocks


def _rotor_error(rotor: int, name: str, whole: Floats, drawn: Floats, blocks: int) -> RotorError:
    def figure(of, scale: str) -> Estimate:
        return _estimate(float(of(whole)), of(drawn), blocks, scale=scale)

    return RotorError(
        rotor=rotor,
        name=name,
        rows=int(whole[_N]),
        rmse_rpm=figure(_rmse, "positive"),
        bias_rpm=figure(_bias, "plain"),
        r2=figure(_r2, "explained"),
        coverage=figure(_coverage, "share"),
    )


def _rmse(s: Floats) -> Floats:
    return np.sqrt(_over(s[..., _EE], s[..., _N]))


def _bias(s: Floats) -> Floats:
    return _over(s[..., _E], s[..., _N])


def _r2(s: Floats) -> Floats:
    spread = s[..., _YY] - _over(s[..., _Y] ** 2, s[..., _N])
    return 1.0 - _over(s[..., _EE], spread)


def _mean_r2(s: Floats) -> Floats:
    """Mean over the rotors (last but one axis) of those that have an R2."""
    each = _r2(s)
    known = np.isfinite(each)
    return _over(np.where(known, each, 0.0).sum(axis=-1), known.sum(axis=-1))


def _coverage(s: Floats) -> Floats:
    return _over(s[..., _INSIDE], s[..., _WITH_INTERVAL])


def _over(top: Floats, bottom: Floats) -> Floats:
    return np.divide(top, bottom, out=np.full(np.shape(top), np.nan), where=np.asarray(bottom) > 0)


def _estimate(value: float, drawn: Floats, blocks: int, *, scale: str) -> Estimate:
    there = {
        "plain": lambda v: v,
        "share": lambda v: v,
        "positive": lambda v: np.log(np.maximum(v, 1e-12)),
        "explained": lambda v: np.log(np.maximum(1.0 - v, 1e-12)),
    }[scale]
    back = {
        "plain": lambda v: v,
        "share": lambda v: min(max(v, 0.0), 1.0),
        "positive": np.exp,
        "explained": lambda v: 1.0 - np.exp(v),
    }[scale]
    drawn = drawn[np.isfinite(drawn)]
    if blocks < FEWEST_BLOCKS or not np.isfinite(value) or drawn.size < 2:
        return Estimate(value=value, low=float("nan"), high=float("nan"))
    # The spread of means over blocks drawn from few is too small by the same factor as a variance.
    error = float(np.std(there(drawn))) * np.sqrt(blocks / (blocks - 1.0))
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, blocks - 1)) * error
    ends = sorted(float(back(there(value) + side * reach)) for side in (-1.0, 1.0))
    return Estimate(value=value, low=ends[0], high=ends[1])


def _nothing(coverage: float, analysis: FlightAnalysis) -> Accuracy:
    measured = np.isfinite(analysis.track.rotor_speed_rpm)
    predicted = np.isfinite(analysis.prediction.rotor_speed_rpm)
    if not measured.any():
        words = "No rotor speeds in this log: the prediction cannot be checked against it."
    elif not predicted.any():
        words = "No prediction for this log: an input of the model is missing throughout."
    else:
        words = "No airborne row has both a measured and a predicted rotor speed."
    return Accuracy(
        rotors=(),
        overall=None,
        promised_coverage=float(coverage),
        block_s=BLOCK_S,
        blocks=0,
        confidence=CONFIDENCE,
        trained_on=trained_on(analysis),
        words=words,
    )
