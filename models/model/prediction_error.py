"""Measure the prediction error of a model on one flight, with intervals from blocks of time.

Samples of one flight follow each other, so their number says little about how sure a figure is:
the flight is resampled in stretches of `BLOCK_S` (models/scores.py). It describes gusts and turns
of this flight; another day may differ by more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePath

import numpy as np

from thrustmargin.models import scores
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis

#: Longer than a line end with its turns, so that blocks are nearly independent of each other.
BLOCK_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorPredictionError:
    """Prediction error of one rotor, or of all of them together (rotor 0)."""

    rotor: int
    name: str
    rows: int
    rmse_rpm: scores.Estimate
    bias_rpm: scores.Estimate  # mean of measured minus predicted
    r2: scores.Estimate
    coverage: scores.Estimate  # share of rows inside the prediction interval


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionError:
    """Prediction error over the airborne rows with both a measurement and a prediction."""

    rotors: tuple[RotorPredictionError, ...]
    overall: RotorPredictionError | None  # None without such a row
    promised_coverage: float
    block_s: float
    blocks: int
    confidence: float
    trained_on: bool  # the model learnt from a flight of this name: the error flatters it


def prediction_error(analysis: FlightAnalysis, rotor_names: tuple[str, ...]) -> PredictionError:
    """Return RMSE, bias, R2 and interval coverage per rotor and overall.

    Only rows in flight with a measured load count, and only measured speeds. Overall RMSE and
    coverage pool the rotors; overall R2 is the mean of the rotors' R2, as the paper's table has it.
    Intervals are by moving-block bootstrap. Rotors without a value are left out; overall is None
    without any.
    """
    track, prediction = analysis.track, analysis.prediction
    terms = scores.error_terms(
        np.where(analysis.from_outputs, np.nan, track.rotor_speed_rpm),
        prediction.rotor_speed_rpm,
        lower=prediction.lower_rpm,
        upper=prediction.upper_rpm,
        rows=track.flying & np.isfinite(track.measured("tank_kg")),
    )
    used = np.any(terms[..., scores.N] > 0, axis=1)
    made = partial(
        PredictionError,
        promised_coverage=float(prediction.coverage),
        block_s=BLOCK_S,
        confidence=scores.CONFIDENCE,
        trained_on=trained_on(analysis),
    )
    if not np.any(used):
        return made(rotors=(), overall=None, blocks=0)
    first, last = np.flatnonzero(used)[[0, -1]]
    span = slice(int(first), int(last) + 1)
    whole = terms[span].sum(axis=0)
    drawn, blocks = scores.by_moving_block(terms[span], track.time_s[span], block_s=BLOCK_S)
    rotors = tuple(
        _rotor_error(k + 1, name, whole[k], drawn[:, k], blocks)
        for k, name in enumerate(rotor_names)
        if whole[k, scores.N] > 0
    )
    overall = _rotor_error(0, "all rotors", whole.sum(axis=0), drawn.sum(axis=1), blocks)
    overall = replace(overall, r2=scores.estimate(scores.mean_r2, whole, drawn, blocks))
    return made(rotors=rotors, overall=overall, blocks=blocks)


def trained_on(analysis: FlightAnalysis) -> bool:
    """Return True if the network was trained on a flight of this name, whatever the file suffix."""
    domain = analysis.model.training_domain
    name = PurePath(analysis.track.name).stem
    return domain is not None and name in {PurePath(f).stem for f in domain.flights}


def _rotor_error(
    rotor: int, name: str, whole: Floats, drawn: Floats, blocks: int
) -> RotorPredictionError:
    def figure(of: Callable[[Floats], Floats]) -> scores.Estimate:
        return scores.estimate(of, whole, drawn, blocks)

    return RotorPredictionError(
        rotor=rotor,
        name=name,
        rows=int(whole[..., scores.N].sum()),
        rmse_rpm=figure(scores.rmse),
        bias_rpm=figure(scores.bias),
        r2=figure(scores.r2),
        coverage=figure(scores.coverage),
    )
