"""What a rotor speed model is, in words for a report."""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.models.model.rotor_model import EffectRecord, RotorModel


@dataclass(frozen=True, slots=True, kw_only=True)
class DescribedModel:
    """A model's name, what to know about it, and the effects added to it."""

    name: str
    words: tuple[str, ...]
    has_network: bool
    effects: tuple[str, ...]


def describe_model(model: RotorModel) -> DescribedModel:
    """Description, envelope, interval and effects of a model, in words."""
    words = []
    if model.envelope is not None:
        covers = model.envelope
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
    return DescribedModel(
        name=model.description,
        words=tuple(words),
        has_network=model.network is not None,
        effects=tuple(_effect(e) for e in model.effects),
    )


def _effect(effect: EffectRecord) -> str:
    where = "" if effect.rotor is None else f" of rotor {effect.rotor}"
    values = ", ".join(f"{name} {p.value:.4g} {p.unit}" for name, p in effect.parameters.items())
    return f"{effect.name}{where} ({values})"
