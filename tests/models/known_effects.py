"""Effects of the catalogue, and unnamed curves, by their keys."""

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.unnamed import UNNAMED


def known_effect(key: str) -> Effect:
    return BY_KEY[key]


def known_curve(mode: str, channel: str) -> Effect:
    return UNNAMED[mode, channel]
