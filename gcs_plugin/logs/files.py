"""Read a file into one padded byte array, and name the largest damaged places."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from thrustmargin.gcs_plugin.telemetry.recording import Damage

_WORST_PLACES = 20


def worst_places(
    skipped: Sequence[tuple[int, int]], time_before: Callable[[int], float]
) -> tuple[Damage, ...]:
    """The longest of the skipped stretches (offset, length), in file order."""
    worst = sorted(skipped, key=lambda place: -place[1])[:_WORST_PLACES]
    return tuple(Damage(byte, length, time_before(byte)) for byte, length in sorted(worst))
