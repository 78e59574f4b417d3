"""The catalogue of physical effects.

An effect is added to the module of what it changes (instrument, demand, moment, thrust effects) and
to the `EFFECTS` of that module. The catalogue lists them in the order of the kinds, then of names.
`models.effects.compose` combines effects into rotor speeds; `identification.loop` searches this
catalogue and nothing else.
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
