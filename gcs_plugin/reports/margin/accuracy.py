"""The model of a report in words, and its prediction error with intervals from blocks of time.

Samples of one flight follow each other, so their number says little about how sure a figure is:
the flight is resampled in stretches of `BLOCK_S` (models/scores.py). It describes gusts and turns
of this flight; another day may differ by more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import PurePath

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import Accuracy, JsonObject, RotorAccuracy
from thrustmargin.gcs_plugin.wording import report_words as words
from thrustmargin.gcs_plugin.wording.check_words import claim_words
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_things
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models import scores
from thrustmargin.models.effects.compose import EffectRecord
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import Basis, FlightAnalysis, SpeedBasis
from thrustmargin.models.model.inferred.load_inference import LOAD_FROM_SPEEDS
from thrustmargin.models.model.rotor_model import RotorModel


def model_use(analysis: FlightAnalysis) -> JsonObject:
    """Airframe and model, and the shares of the airborne rows that each basis predicted.

    `inside_envelope` is None when the model has no network.
    """
    model, airframe = analysis.model, analysis.model.airframe
    basis = analysis.prediction.basis[analysis.track.flying]
    shares = {b: float(np.mean(basis == b)) if basis.size else np.nan for b in Basis}
    inside = shares[Basis.NETWORK] == 1.0
    return {
        "airframe": airframe.name,
        "airframe_title": airframe.title,
        "airframe_words": claim_words(analysis.claim),
        "rotor_count": airframe.rotor_count,
        "rotor_names": analysis.places,
        "empty_mass": airframe.empty_mass,
        "tank_capacity_kg": airframe.tank_capacity_kg,
        "model": "none" if analysis.withheld else model.description,
        "model_words": (*model_words(model), *_kinds_of_speed(analysis)),
        "network_share": shares[Basis.NETWORK],
        "physics_share": shares[Basis.PHYSICS],
        "none_share": shares[Basis.NONE],
        "inside_envelope": None if model.network is None else inside,
        "effects": tuple(_effect(e) for e in model.effects),
        "effect_words": effect_things(model),
    }


def _kinds_of_speed(analysis: FlightAnalysis) -> tuple[str, ...]:
    """A word where the model learnt from another kind of rotor speed than this flight has."""
    training, here = analysis.model.training, analysis.speed_basis
    if training is None or training.speed == here or not analysis.any_measured.any():
        return ()
    return (words.other_kind(training.speed, here),)


def model_words(model: RotorModel) -> list[str]:
    """Training domain and interval of a model, in words."""
    text = []
    if model.training_domain is not None:
        covers = model.training_domain
        text.append(words.trained_at(covers.airspeed, covers.tank_kg, covers.density))
    if model.interval is not None:
        text.append(words.interval_made(model.interval.coverage, model.interval.flights))
    return text


def _effect(effect: EffectRecord) -> str:
    where = "" if effect.rotor is None else f" of rotor {effect.rotor}"
    values = ", ".join(f"{name} {p.value:.4g} {p.unit}" for name, p in effect.parameters.items())
    return f"{effect.name}{where} ({values})"


#: Longer than a line end with its turns, so that blocks are nearly independent of each other.
BLOCK_S = 20.0


def accuracy(analysis: FlightAnalysis, rotor_names: tuple[str, ...]) -> Accuracy:
    """RMSE, bias, R2 and interval coverage per rotor and overall, over the airborne rows.

    Overall RMSE and coverage pool the rotors; overall R2 is the mean of the rotors' R2, as the
    paper's table has it.
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
    trained = trained_on(analysis)
    made = partial(
        Accuracy,
        promised_coverage=float(prediction.coverage),
        block_s=BLOCK_S,
        confidence=scores.CONFIDENCE,
        trained_on=trained,
    )
    if not np.any(used):
        return made(rotors=(), overall=None, blocks=0, words=_why_none(analysis))
    first, last = np.flatnonzero(used)[[0, -1]]
    span = slice(int(first), int(last) + 1)
    whole = terms[span].sum(axis=0)
    drawn, blocks = scores.by_moving_block(terms[span], track.time_s[span], block_s=BLOCK_S)
    rotors = tuple(
        _rotor_accuracy(k + 1, name, whole[k], drawn[:, k], blocks)
        for k, name in enumerate(rotor_names)
        if whole[k, scores.N] > 0
    )
    overall = _rotor_accuracy(0, "all rotors", whole.sum(axis=0), drawn.sum(axis=1), blocks)
    overall = replace(overall, r2=scores.estimate(scores.mean_r2, whole, drawn, blocks))
    if blocks >= scores.FEWEST_BLOCKS:
        text = words.in_brackets(scores.CONFIDENCE, blocks, BLOCK_S)
    else:
        text = words.no_intervals(blocks, scores.FEWEST_BLOCKS, BLOCK_S)
    text = f"{say(words.TRAINED_ON)} {text}" if trained else text
    return made(rotors=rotors, overall=overall, blocks=blocks, words=text)


def trained_on(analysis: FlightAnalysis) -> bool:
    """True when a flight of this name, whatever the format of its log, trained the network."""
    domain = analysis.model.training_domain
    name = PurePath(analysis.track.name).stem
    return domain is not None and name in {PurePath(f).stem for f in domain.flights}


def _rotor_accuracy(
    rotor: int, name: str, whole: Floats, drawn: Floats, blocks: int
) -> RotorAccuracy:
    def figure(of: Callable[[Floats], Floats]) -> scores.Estimate:
        return scores.estimate(of, whole, drawn, blocks)

    return RotorAccuracy(
        rotor=rotor,
        name=name,
        rows=int(whole[..., scores.N].sum()),
        rmse_rpm=figure(scores.rmse),
        bias_rpm=figure(scores.bias),
        r2=figure(scores.r2),
        coverage=figure(scores.coverage),
    )


def _why_none(analysis: FlightAnalysis) -> str:
    """Why the prediction is not checked."""
    known = np.isfinite(analysis.track.rotor_speed_rpm)
    measured = known & ~analysis.from_outputs
    predicted = np.isfinite(analysis.prediction.rotor_speed_rpm)
    if known.any() and not measured.any():
        return words.not_measured(SpeedBasis.MOTOR_OUTPUTS)
    if not known.any():
        return words.NO_SPEEDS
    if not predicted.any():
        return words.NO_PREDICTION
    if not np.isfinite(analysis.track.measured("tank_kg")).any():
        return words.no_error(LOAD_FROM_SPEEDS)
    return words.NO_ROW_OF_BOTH
