"""Probabilities and costs that decide what is reported and which action is advised.

SURE is the probability for reported effects, intervals, limits and dates. An action on a part is
advised where it costs less on average than no action: no action costs `missed` if the part is bad,
the action costs `needless` if the part is sound (Berger 1985, Statistical Decision Theory, section
1.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from types import MappingProxyType

SURE = 0.95  # posterior probability of a reported effect; coverage of intervals and limits
CHOICE = 0.5  # probability above which an effect is more probable than not
OPEN_PROBABILITY = 1.0 - SURE  # probability from which anything else is listed as possible
#: Standard errors on either side of an interval of SURE.
ERRORS = NormalDist().inv_cdf(1.0 - OPEN_PROBABILITY / 2.0)


@dataclass(frozen=True, slots=True)
class Cost:
    """Costs of a needless and of a missed action; the unit is one inspection of a propeller."""

    needless: float
    missed: float

    @property
    def action_threshold(self) -> float:
        """Return the probability of a bad part from which the action costs less than no action."""
        return self.needless / (self.needless + self.missed)

    def expected_cost(self, probability: float) -> float:
        """Return the expected cost of advising the action for a part that is bad with
        `probability`."""
        return (1.0 - probability) * self.needless


#: Part -> costs of errors. Inspecting a propeller takes minutes, and a bad one breaks in flight; a
#: needless inspection sometimes ends in the exchange of a sound part. After a needless weighing,
#: levelling or setting the aircraft is set wrongly, so these wait for a probability above CHOICE.
COSTS: Mapping[str, Cost] = MappingProxyType(
    {
        "rotor": Cost(needless=1.0, missed=4.0),
        "aircraft": Cost(needless=2.0, missed=2.0),
        "instrument": Cost(needless=2.0, missed=2.0),
    }
)
