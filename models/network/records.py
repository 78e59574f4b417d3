"""What a model file remembers: how its network was trained, and how its good flights differ.

A number found on new flights means nothing where sound flights scatter as much by themselves. A
model file keeps that scatter, so that a search on new flights needs none of the old ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.network.network import NetConfig
from thrustmargin.models.scores import Score, t_quantile

ROUNDING = 1e-12


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


@dataclass(frozen=True, slots=True, kw_only=True)
class GoodFlights:
    """Scatter over the flights that a model was made from, with its standard effects in place.

    Raises ModelError when a scatter is negative or not a number.
    """

    flights: int
    #: "effect_key.parameter" -> standard deviation from flight to flight, in the parameter's unit
    scatter: Mapping[str, float] = field(default_factory=dict)
    mode_scatter_rpm: tuple[float, ...] = ()  # of each mode's mean residual; R, or none
    slow_rpm: tuple[float, ...] = ()  # by which each mode wanders within a flight; R, or none
    #: in model files from before 0.3; nothing reads it any more
    free_form_rpm: tuple[float, ...] = ()
    #: "mode.channel" -> RMS in rpm of the smooth curve of the residual over that channel, as far as
    #: flights left out confirm it; 0 where they do not
    curve_rpm: Mapping[str, float] = field(default_factory=dict)
    #: of each flight left out of its own prediction in turn, all choices made without it
    errors: tuple[ConditionScore, ...] = ()
    flight_rmse_rpm: Mapping[str, float] = field(default_factory=dict)  # name of the flight -> rpm
    mean_speed_rpm: float = float("nan")
    delay_s: float = float("nan")  # of their rotor speeds beyond the model's, by fast rows
    delay_scatter_s: float = float("nan")  # its standard deviation from flight to flight

    def __post_init__(self) -> None:
        named = {**self.scatter, **self.curve_rpm}
        named |= {f"mode {k + 1}": v for k, v in enumerate(self.mode_scatter_rpm)}
        named |= {f"slow mode {k + 1}": v for k, v in enumerate(self.slow_rpm)}
        named |= {f"free form of mode {k + 1}": v for k, v in enumerate(self.free_form_rpm)}
        for name, value in named.items():
            if not 0.0 <= value < float("inf"):
                raise ModelError(f"has the scatter {value} of {name}")

    def most_rmse_rpm(self, confidence: float = 0.95) -> float:
        """rpm that the RMSE of a new sound flight stays below: Student's prediction limit of the
        logarithm. NaN from fewer than 3 flights."""
        logs = np.log(list(self.flight_rmse_rpm.values()))
        if logs.size < 3:
            return float("nan")
        spread = np.std(logs, ddof=1) * np.sqrt(1.0 + 1.0 / logs.size)
        return float(np.exp(logs.mean() + t_quantile(logs.size - 1, confidence) * spread))


def scatter_between(estimates: Floats, errors: Floats) -> float:
    """Standard deviation between flights of a quantity that each flight shows with its own error.

    estimates and errors (F,), errors standard deviations above 0. What the errors alone make
    flights differ is taken off, so that 0 means "no more than chance". NaN for fewer than 2
    flights, and where one alone is known. Method of moments: DerSimonian and Laird, Control. Clin.
    Trials 7, 177 (1986), Eq. 8.
    """
    if estimates.size < 2:
        return float("nan")
    weight = errors**-2.0
    mean = np.sum(weight * estimates) / np.sum(weight)
    excess = np.sum(weight * (estimates - mean) ** 2) - (estimates.size - 1)
    others = np.sum(weight) - np.sum(weight**2) / np.sum(weight)
    if others <= ROUNDING * np.sum(weight):
        return float("nan")
    return float(np.sqrt(max(excess / others, 0.0)))
