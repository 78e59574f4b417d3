"""The catalogue of physical effects. Adding one is adding one file to the room of its kind.

Each module of a room (inputs, demand, moments, coefficient) has its effects in `EFFECTS`. The
catalogue has them in the order of the kinds, then of their names.
`models.effects.compose` puts effects together into rotor speeds; `identification.loop` searches
this catalogue and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from difflib import get_close_matches
from importlib import import_module
from pkgutil import iter_modules

from thrustmargin.models.effects.base import Effect, Kind, Parameter, Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.unnamed import UNNAMED
from thrustmargin.models.errors import ModelError
from thrustmargin.models.physics.airframe import Airframe


def _found() -> Iterator[Effect]:
    for room in (module.name for module in iter_modules(__path__) if module.ispkg):
        for module in iter_modules(import_module(f"{__name__}.{room}").__path__):
            yield from import_module(f"{__name__}.{room}.{module.name}").EFFECTS


def with_known_channels(effects: Iterable[Effect]) -> list[Effect]:
    """The effects as they are.

    Raises ModelError when one asks for a channel that no flight has, and no effect makes for
    itself: it would never be looked for, in silence.
    """
    found = list(effects)
    known = {channel.name for channel in fields(Channels)}
    known |= {effect.name for effect in found if effect.own_channel is not None}
    for effect in found:
        for name in (*effect.needs, *effect.neutral):
            if name not in known:
                near = get_close_matches(name, known, 1)
                hint = f"; is it {near[0]}?" if near else ""
                raise ModelError(f"effect {effect.key}: no channel {name!r} is known{hint}")
    return found


CATALOGUE: tuple[Effect, ...] = tuple(
    sorted(
        with_known_channels(_found()),
        key=lambda effect: (list(Kind).index(effect.kind), effect.name),
    )
)
#: as in model files
BY_KEY: dict[str, Effect] = {effect.key: effect for effect in (*CATALOGUE, *UNNAMED.values())}


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
