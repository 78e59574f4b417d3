"""One effect of an identification, its numbers with signs, units and intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

from thrustmargin.gcs_plugin.wording.numbers import number
from thrustmargin.models.identification.result import Found, Identification


def spread(
    value: float, low: float, high: float, unit: str, *, factor: float = 1.0, most: int = 2
) -> str:
    """`8.0 % (7.9 to 8.1 %)`: as many decimals as the interval warrants.

    At most `most`, or one more where the ends would look alike.
    """
    value, ends = value * factor, sorted((low * factor, high * factor))
    half = (ends[1] - ends[0]) / 2
    if not math.isfinite(half) or half <= 0.0:
        return number(value, unit, most)
    decimals = min(most, max(0, -math.floor(math.log10(half) + 1e-6)))
    if number(ends[0], "", decimals) == number(ends[1], "", decimals):
        decimals += 1
    first, second = (number(end, "", decimals) for end in ends)
    again = " %" if unit == "%" else ""
    return f"{number(value, unit, decimals)} ({first} to {second}{again})"


def rotor_words(rotor: int, names: tuple[str, ...]) -> str:
    """`rotor 1 (front right)` of a 0-based rotor."""
    return f"rotor {rotor + 1} ({names[rotor]})"


@dataclass(frozen=True, slots=True, eq=False)
class DescribedEffect:
    """An effect found, within the identification that found it."""

    found: Found
    whole: Identification

    def ends(self, name: str) -> tuple[float, float, float]:
        """Value, lower and upper end of a parameter, as they stand for the effect."""
        k = [p.name for p in self.found.term.effect.parameters].index(name)
        row = self.found.flight
        found = self.found
        return float(found.value[row, k]), float(found.lower[row, k]), float(found.upper[row, k])

    def negative(self, name: str) -> bool:
        return self.ends(name)[0] < 0.0

    def text(self, name: str, unit: str = "", *, factor: float = 1.0, most: int = 2) -> str:
        return spread(*self.ends(name), unit, factor=factor, most=most)

    def size(self, name: str, unit: str, *, factor: float = 1.0, most: int = 2) -> str:
        """The amount without its sign, its interval turned the same way."""
        return self.text(name, unit, factor=-factor if self.negative(name) else factor, most=most)

    @property
    def known(self) -> bool:
        """True when the model has this effect already, so that this changes its size."""
        return self.found.term.effect.name in {e.name for e in self.whole.model.effects}

    @property
    def rotor(self) -> str:
        names = self.whole.model.airframe.rotor_names
        return rotor_words(self.found.term.rotor or 0, names).capitalize()
