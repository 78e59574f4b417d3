"""One effect of an identification, its numbers with signs, units and intervals."""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.gcs_plugin.wording.numbers import within
from thrustmargin.models.identification.result import Found, Identification


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

    def size(
        self, name: str, unit: str = "", *, factor: float = 1.0, most: int = 2
    ) -> tuple[str, str]:
        """The amount without its sign, and its interval turned the same way."""
        sign = -1.0 if self.negative(name) else 1.0
        return within(*self.ends(name), unit, factor=sign * factor, most=most)

    def text(self, name: str, unit: str = "", *, factor: float = 1.0, most: int = 2) -> str:
        """The amount with its sign and its interval, in one."""
        return joined(within(*self.ends(name), unit, factor=factor, most=most))

    @property
    def known(self) -> bool:
        """True when the model has this effect already, so that this changes its size."""
        return self.found.term.effect.name in {e.name for e in self.whole.model.effects}

    @property
    def rotor(self) -> str:
        names = self.whole.model.airframe.rotor_names
        return rotor_words(self.found.term.rotor or 0, names).capitalize()


def joined(parts: tuple[str, str]) -> str:
    """Amount and interval in one."""
    return " ".join(parts).rstrip()
