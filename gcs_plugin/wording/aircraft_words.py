"""Sentences on a known aircraft: how well it is known, what changed, and what must be asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.models.flight import Floats


def known_words(name: str, flights: int, days: int) -> str:
    """Return on what the prediction of an aircraft rests, as the grounds of a verdict."""
    if flights == 1:
        return say("aircraft {name}, known from 1 flight", name=name)
    if days == 1:
        words = "aircraft {name}, known from {flights} flights on one day"
        return say(words, name=name, flights=flights)
    words = "aircraft {name}, known from {flights} flights on {days} days"
    return say(words, name=name, flights=flights, days=days)


def changed_words(by_rpm: Floats, modes: Sequence[int], columns: Floats) -> str:
    """Return what is different in a flight from the flights before it, with its size.

    `by_rpm` (R,) is the change of each mode, rpm, `modes` are those to name, from 0, and `columns`
    (R, R) the directions of the modes.
    """
    parts = []
    for mode in modes:
        by, size = by_rpm[mode], number(abs(by_rpm[mode]), "rpm", 0)
        if mode == 0:
            words = "all rotors turn {rpm} faster" if by > 0.0 else "all rotors turn {rpm} slower"
            parts.append(say(words, rpm=size))
            continue
        side = np.sign(by) * columns[:, mode]
        up, down = (
            ", ".join(str(k + 1) for k in np.flatnonzero(way > 0.1)) for way in (side, -side)
        )
        words = "rotors {up} turn {rpm} faster and {down} slower"
        parts.append(say(words, up=up, rpm=size, down=down))
    return say(
        "changed since the flights before it: {parts}; weigh it, look at what was repaired or "
        "fitted, and note that: thrustmargin aircraft NAME --changed PART",
        parts=", ".join(parts),
    )


def open_words(found: Sequence[tuple[str, str]]) -> str:
    """Return the question of which aircraft a log is, from names and reasons."""
    listed = "; ".join(f"{name} ({say(why)})" for name, why in found)
    return say(
        "its aircraft may be that of {listed}; give --aircraft NAME, a new name for a new aircraft",
        listed=listed,
    )
