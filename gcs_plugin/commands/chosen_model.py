"""Which rotor speed model a command works with, from the model file and airframe asked for."""

from __future__ import annotations

from pathlib import Path

from thrustmargin.models.errors import DataError
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    load_model,
    physics_model,
    shipped_model,
)
from thrustmargin.models.physics.airframe import load_airframe


def chosen_model(model: Path | None, airframe: str | None) -> RotorModel:
    """The model file, else the shipped model, else weight and thrust curve of another airframe.

    Raises ModelError or AirframeError when a file is unfit, DataError when the two disagree.
    """
    if model is not None:
        return _model_of(model, airframe)
    shipped = shipped_model()
    if airframe is None:
        return shipped
    wanted = load_airframe(airframe)
    return shipped if wanted.name == shipped.airframe.name else physics_model(wanted)


def judged_model(model: Path | None, airframe: str | None) -> tuple[RotorModel, str]:
    """The model to be judged, and its name for the result.

    Unlike `chosen_model`, an airframe alone always means its weight and thrust curve, so that the
    search can begin without what a network has learnt. Raises as `chosen_model`.
    """
    if model is not None:
        return _model_of(model, airframe), str(model)
    if airframe is None:
        return shipped_model(), "shipped"
    return physics_model(load_airframe(airframe)), f"airframe {airframe}"


def _model_of(file: Path, airframe: str | None) -> RotorModel:
    chosen = load_model(file)
    wanted = chosen.airframe.name if airframe is None else load_airframe(airframe).name
    if wanted != chosen.airframe.name:
        raise DataError(
            f"{file.name} is a model of {chosen.airframe.name}, not of {wanted}; give one"
        )
    return chosen
