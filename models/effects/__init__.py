"""Catalogue of the physical effects that identification searches.

An effect is defined in the module of the quantity that it changes (instrument, demand, moment or
thrust effects) and listed in that module's `EFFECTS`. The catalogue sorts them by kind, then name.
`models.effects.compose` combines effects into rotor speeds; `identification.loop` searches only
this catalogue.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from difflib import get_close_matches

from thrustmargin.models.effects import (
    demand_effects,
    instrument_effects,
    moment_effects,
    thrust_effects,
)
from thrustmargin.models.effects.base import Effect, Kind, Parameter, Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.unnamed import UNNAMED
from thrustmargin.models.errors import ModelError
from thrustmargin.models.physics.airframe import Airframe


def with_known_channels(effects: Iterable[Effect]) -> list[Effect]:
    """Return the effects as a list after checking that all channels they need exist.

    Raises ModelError when an effect needs a channel that no flight has and no effect computes: the
    effect would silently never be searched.
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


#: The modules of effects, one for what each changes; each lists its own in `EFFECTS`.
_KINDS = (instrument_effects, demand_effects, moment_effects, thrust_effects)

CATALOGUE: tuple[Effect, ...] = tuple(
    sorted(
        with_known_channels(effect for kind in _KINDS for effect in kind.EFFECTS),
        key=lambda effect: (list(Kind).index(effect.kind), effect.name),
    )
)
#: as in model files
BY_KEY: dict[str, Effect] = {effect.key: effect for effect in (*CATALOGUE, *UNNAMED.values())}


def effects_for(airframe: Airframe, effects: Iterable[Effect] = CATALOGUE) -> tuple[Effect, ...]:
    """Return the effects that are possible on an aircraft, with parameters scaled to its size.

    For an aircraft of the F16's size the original objects are returned.
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
