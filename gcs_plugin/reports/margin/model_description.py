"""Which airframe and model a report rests on, in words, and how far the model covers the flight."""

from __future__ import annotations

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.models.effects.stored import EffectRecord
from thrustmargin.models.model.analysis import Basis, FlightAnalysis
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
        "airframe_words": analysis.claim.words,
        "rotor_count": airframe.rotor_count,
        "rotor_names": airframe.rotor_names,
        "empty_mass": airframe.empty_mass,
        "tank_capacity_kg": airframe.tank_capacity_kg,
        "model": "none" if analysis.withheld else model.description,
        "model_words": (*model_words(model), *_kinds_of_speed(analysis)),
        "network_share": shares[Basis.NETWORK],
        "physics_share": shares[Basis.PHYSICS],
        "none_share": shares[Basis.NONE],
        "inside_envelope": None if model.network is None else inside,
        "effects": tuple(_effect(e) for e in model.effects),
    }


def _kinds_of_speed(analysis: FlightAnalysis) -> tuple[str, ...]:
    """A word where the model learnt from another kind of rotor speed than this flight has."""
    training, here = analysis.model.training, analysis.words_of_speed
    if training is None or training.speed == here or not analysis.any_measured.any():
        return ()
    return (
        f"it learnt from rotor speeds {training.speed} and this flight's are {here}: part of the "
        "difference from the prediction is that of the two kinds",
    )


def model_words(model: RotorModel) -> list[str]:
    """Training domain and interval of a model, in words."""
    words = []
    if model.training_domain is not None:
        covers = model.training_domain
        words.append(
            "trained at "
            f"{covers.airspeed[0]:.1f} to {covers.airspeed[1]:.1f} m/s airspeed, "
            f"{covers.tank_kg[0]:.1f} to {covers.tank_kg[1]:.1f} kg in the tank, "
            f"{covers.density[0]:.3f} to {covers.density[1]:.3f} kg/m³"
        )
    if model.interval is not None:
        words.append(
            f"interval made to hold {model.interval.coverage * 100:.0f} % on flights like its "
            f"{model.interval.flights} training flights"
        )
    return words


def _effect(effect: EffectRecord) -> str:
    where = "" if effect.rotor is None else f" of rotor {effect.rotor}"
    values = ", ".join(f"{name} {p.value:.4g} {p.unit}" for name, p in effect.parameters.items())
    return f"{effect.name}{where} ({values})"
