"""What an identification asks of people, as data: part, action, probability, expected cost."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.actions import Action, When
from thrustmargin.gcs_plugin.wording.loop.effect_sentences import action_of
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.identification.certainty import COSTS

#: Part of an action -> whose costs it has.
KIND_OF_PART = MappingProxyType(
    {
        "propeller": "rotor",
        "motor": "rotor",
        "rotor": "rotor",
        "tank gauge": "instrument",
        "airspeed sensor": "instrument",
        "settings": "instrument",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedAction:
    """One action that a person is asked for."""

    part: str  # with the number of the rotor, from 1
    action: str
    probability: float  # that it is right
    expected_cost: float  # of asking, in times a look at a propeller


def asked_of(found: Identification) -> tuple[AskedAction, ...]:
    """The actions of the answer in its order; what only keeps something in the model is none."""
    out = [
        _asked(action, f.term.rotor, f.probability)
        for f in sorted(found.found, key=lambda f: f.term.rotor is None)
        if (action := action_of(f, found)) and action.part != actions.KEEP.part
    ]
    out += [_asked(actions.INSPECT, one.rotor, one.probability) for one in found.mentioned]
    left = found.left
    if left is not None and left.rotor is not None:
        out.append(_asked(actions.INSPECT, left.rotor, 1.0))
    return tuple(out)


def _asked(action: Action, rotor: int | None, probability: float) -> AskedAction:
    kind = KIND_OF_PART.get(action.part, "aircraft")
    hands_on = action.when is When.BATTERY_OFF
    return AskedAction(
        part=f"rotor {rotor + 1}" if rotor is not None and hands_on else action.part,
        action=action.text,
        probability=probability,
        expected_cost=COSTS[kind].of_asking(probability),
    )
