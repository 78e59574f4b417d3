"""What a model file remembers of how its network was trained."""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.models.network.network import NetConfig
from thrustmargin.models.scores import Score


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitScore:
    """One network on its own three sets, as the paper's table has it."""

    split: str  # "samples" or "flights"
    training: Score
    validation: Score
    test: Score
    epochs: int
    best_epoch: int
    lowest_loss: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionScore:
    """The ensemble on flights left out, on the rows of one condition."""

    condition: str
    score: Score


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRecord:
    """How a network came to be and how good it is."""

    date: str  # ISO 8601
    version: str  # of thrustmargin
    seed: int
    members: int
    config: NetConfig
    rows: int  # training rows of all flights
    learnt_rows: int  # those outside yaw turns, from which the members learn
    splits: tuple[SplitScore, ...]
    left_out: tuple[ConditionScore, ...]  # each flight predicted by members that never saw it
    speed: str = "measured"  # or "from motor outputs": what the rotor speeds learnt from were
