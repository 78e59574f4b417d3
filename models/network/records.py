"""Define the records of a model file: how its network was trained, and how good flights differ.

A change found on new flights is not significant where sound flights vary as much. A model file
stores that variance, so that a search on new flights does not need the old ones.
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
    """The scores of one network on its own three sets, as in the paper's table."""

    split: str  # "samples" or "flights"
    training: Score
    validation: Score
    test: Score
    epochs: int
    best_epoch: int
    lowest_loss: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionScore:
    """The score of the ensemble on held-out flights, on the rows of one condition."""

    condition: str
    score: Score


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRecord:
    """The record of a training run, with its scores."""

    date: str  # ISO 8601
    version: str  # of thrustmargin
    seed: int
    members: int
    config: NetConfig
    rows: int  # training rows of all flights
    learnt_rows: int  # rows outside yaw turns, on which the members are trained
    splits: tuple[SplitScore, ...]
    left_out: tuple[ConditionScore, ...]  # each flight predicted by members that held it out
    speed: str = "measured"  # or "from motor outputs": basis of the training rotor speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class GoodFlights:
    """The variation between the flights that a model was made from, with its standard effects.

    Raises ModelError when a scatter is negative or not a number.
    """

    flights: int
    #: "effect_key.parameter" -> standard deviation from flight to flight, in the parameter's unit
    scatter: Mapping[str, float] = field(default_factory=dict)
    mode_scatter_rpm: tuple[float, ...] = ()  # of each mode's mean residual; R, or none
    slow_rpm: tuple[float, ...] = ()  # slow variation of each mode within a flight; R, or none
    #: in model files from before 0.3; nothing reads it any more
    free_form_rpm: tuple[float, ...] = ()
    #: "mode.channel" -> RMS in rpm of the smooth curve of the residual over that channel, as far as
    #: held-out flights confirm it; 0 where they do not
    curve_rpm: Mapping[str, float] = field(default_factory=dict)
    #: cross-validated over flights, with all choices made without the held-out flight
    errors: tuple[ConditionScore, ...] = ()
    flight_rmse_rpm: Mapping[str, float] = field(default_factory=dict)  # name of the flight -> rpm
    mean_speed_rpm: float = float("nan")
    delay_s: float = float("nan")  # of the rotor speeds beyond the model's, by fast rows
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
        """Return the RMSE, rpm, that a new sound flight stays below with `confidence`.

        Student's prediction limit of the logarithm. NaN with fewer than 3 flights.
        """
        logs = np.log(list(self.flight_rmse_rpm.values()))
        if logs.size < 3:
            return float("nan")
        spread = np.std(logs, ddof=1) * np.sqrt(1.0 + 1.0 / logs.size)
        return float(np.exp(logs.mean() + t_quantile(logs.size - 1, confidence) * spread))


def scatter_between(estimates: Floats, errors: Floats) -> float:
    """Estimate the standard deviation between flights of a quantity with an error in each flight.

    estimates and errors (F,), errors standard deviations above 0. The variation due to the errors
    is subtracted, so that 0 means "no more than chance". NaN for fewer than 2 flights, or if the
    errors leave weight on one alone. Method of moments: DerSimonian and Laird, Control. Clin.
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
