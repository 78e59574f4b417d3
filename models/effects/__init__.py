"""The catalogue of physical effects. Adding one is adding one file to the room of its kind.

Each module of a room (inputs, demand, moments, coefficient) has its effects in `EFFECTS`. The
catalogue has them in the order of the kinds, then of their names.
`models.effects.compose` puts effects together into rotor speeds; `identification.loop` searches
this catalogue and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from pkgutil import iter_modules

from thrustmargin.models.effects.base import Effect, Kind, Parameter, Placed
from thrustmargin.models.physics.airframe import Airframe


def _found() -> Iterator[Effect]:
    for room in (module.name for module in iter_modules(__path__) if module.ispkg):
        for module in iter_modules(import_module(f"{__name__}.{room}").__path__):
            yield from import_module(f"{__name__}.{room}.{module.name}").EFFECTS


CATALOGUE: tuple[Effect, ...] = tuple(
    sorted(_found(), key=lambda effect: (list(Kind).index(effect.kind), effect.name))
)
BY_KEY: dict[str, Effect] = {effect.key: effect for effect in CATALOGUE}  # as in model files


def effects_for(airframe: Airframe, effects: Iterable[Effect] = CATALOGUE) -> tuple[Effect, ...]:
    """The effects that an aircraft can have, with their parameters scaled to it.

    For an aircraft of the F16's size they are the same objects.
    """
    return tuple(effect.scaled(airframe) for effect in effects if effect.possible_on(airframe))


__all__ = [
    "BY_KEY",
    "CATALOGUE",
    "Effect",
    "Kind",
    "Parameter",
    "Placed",
    "effects_for",
]
