"""Store identified effects in a model file, and turn them into `Placed` effects.

Rotors are numbered from 1 in files, from 0 in arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.errors import ModelError

#: Part of parameter names in older model files, and its present form.
FORMER_NAME = ("sharpening", "derivative_correction")


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """The value of one parameter of an effect, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRecord:
    """An identified effect as model files and `identify` write it; rotors count from 1."""

    name: str
    rotor: int | None
    parameters: dict[str, Identified]
    variant: str = ""  # form of the effect, if it has several
    flights: tuple[str, ...] = ()  # flights on which it was found
    date: str = ""  # ISO 8601, of the identification

    def __post_init__(self) -> None:
        named = {name.replace(*FORMER_NAME): found for name, found in self.parameters.items()}
        object.__setattr__(self, "parameters", named)

    @property
    def loss(self) -> Identified | None:
        """Return the share of thrust that one rotor loses, of a curve the largest; None for
        other effects."""
        of_curve = [v for name, v in self.parameters.items() if name.startswith("at_")]
        losses = [self.parameters["loss"]] if "loss" in self.parameters else of_curve
        return max(losses, key=lambda v: v.value) if self.rotor is not None else None


def losses_of(records: Sequence[EffectRecord]) -> dict[int, Identified]:
    """Sum the share of thrust lost by each weak rotor, from 1, over all records."""
    losses: dict[int, Identified] = {}
    for record in records:
        if record.loss is not None and record.rotor is not None:
            one, other = record.loss, losses.get(record.rotor)
            if other is not None:
                ends = one.ci95[0] + other.ci95[0], one.ci95[1] + other.ci95[1]
                one = Identified(value=one.value + other.value, unit=one.unit, ci95=ends)
            losses[record.rotor] = one
    return losses


def placed_from(records: Sequence[EffectRecord], rotor_count: int) -> tuple[Placed, ...]:
    """Return the effects of a model file. Raises ModelError for an unknown effect, rotor, value
    or unit."""
    return tuple(_place_effect(record, rotor_count) for record in records)


def _place_effect(record: EffectRecord, rotor_count: int) -> Placed:
    """Return the effect of one record. Raises ModelError as `placed_from`."""
    key = f"{record.name}:{record.variant}" if record.variant else record.name
    effect = BY_KEY.get(key)
    if effect is None:
        raise ModelError(
            f"it has the effect {key!r}, which this version does not know; "
            "update thrustmargin or identify the effect again"
        )
    if effect.of_one_rotor != (record.rotor is not None):
        raise ModelError(f"its effect {key} names rotor {record.rotor!r}")
    if record.rotor is not None and not 1 <= record.rotor <= rotor_count:
        raise ModelError(f"its effect {key} names rotor {record.rotor} of {rotor_count}")
    values: dict[str, float] = {}
    for parameter in effect.parameters:
        given = record.parameters.get(parameter.name)
        if given is None and parameter.detail and parameter.absent is not None:
            values[parameter.name] = parameter.absent  # older files lack this parameter
            continue
        if given is None or given.unit != parameter.unit or not np.isfinite(given.value):
            raise ModelError(f"its effect {key} needs {parameter.name} in {parameter.unit!r}")
        values[parameter.name] = given.value
    rotor = None if record.rotor is None else record.rotor - 1
    return Placed(effect=effect, values=values, rotor=rotor)
