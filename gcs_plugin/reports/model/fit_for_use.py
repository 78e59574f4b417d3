"""Whether a new model is fit for use, by flights it has not seen: the first line of `train`."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from thrustmargin.models.identification.modes import modes
from thrustmargin.models.model.good_flights import GoodFlights
from thrustmargin.models.model.rotor_model import RotorModel

#: Share of rotor speed: 10 % of thrust, which at the 50 % limit is 5 points of margin. A model that
#: is off by more cannot say on which side of the limit a flight is.
USABLE = 0.05

ODD = 0.05  # of trainings on good flights only, that call one of them odd
FEWEST_OTHERS = 3  # whose scatter can be known

#: what to look at where flights differ from each other in a mode
CAUSES = {
    "collective": "weigh the load (--load), state the --air-temperature, check the tank gauge",
    "roll": "put load and battery in the same place each flight, or leave out odd flights",
    "pitch": "put load and battery in the same place each flight, or leave out odd flights",
    "yaw": "level the motors, and leave out flights with other propellers",
}


def fit_for_use(shown: GoodFlights, model: RotorModel) -> str:
    """One sentence: usable and how well, or not, why, and what to do."""
    whole, straight, turning = (
        _share(shown, condition) for condition in ("all rows", "outside yaw turns", "in yaw turns")
    )
    most = straight if straight is not None else whole
    assert most is not None
    said = f"rotor speed to {_percent(most)}" + ("" if turning is None else " outside turns")
    tested = f"RMS on {shown.flights} flights, each predicted by a model made without it"
    if most > USABLE:
        return f"not usable: {said} ({tested}), because {why(shown, model)}"
    if turning is None:
        return f"usable: {said} ({tested})"
    said += f", {_percent(turning)} in turns"
    if turning > USABLE:
        return f"usable outside turns only: {said} ({tested}), because {why(shown, model)}"
    return f"usable: {said} ({tested})"


def why(shown: GoodFlights, model: RotorModel) -> str:
    """The largest part of the error, and what to do about it."""
    squares = {name: rmse**2 for name, rmse in shown.flight_rmse_rpm.items()}
    worst = max(squares, key=lambda name: squares[name])
    if squares[worst] > 0.5 * sum(squares.values()):
        off = _percent(shown.flight_rmse_rpm[worst] / shown.mean_speed_rpm)
        return f"{worst} alone is off by {off}: leave it out, or give more flights like it"
    between = np.square(shown.mode_scatter_rpm) / model.airframe.rotor_count
    if between.sum() > 0.5 * np.mean(list(squares.values())):
        mode = modes(model.airframe).names[int(np.argmax(between))]
        cause = CAUSES.get(mode, "leave out flights of an aircraft that was not in order")
        return f"flights differ from each other, most in {mode}: {cause}"
    if not any(record.name == "manoeuvre_moment" for record in model.effects):
        return "what turning takes is not known: give logs with turn rates (ATTITUDE at 4 Hz)"
    return "the channels do not say what changes: thrustmargin identify LOG... --model FILE"


def odd_flights(shown: GoodFlights) -> list[str]:
    """A sentence for each flight whose error is another's than that of the rest: is it a good one?

    The logarithm of its RMSE lies beyond Student's prediction interval of those of the others, at
    5 % shared among all flights.
    """
    logs = np.log(list(shown.flight_rmse_rpm.values()))
    sentences = []
    for k, (name, rmse) in enumerate(shown.flight_rmse_rpm.items()):
        rest = np.delete(logs, k)
        if rest.size < FEWEST_OTHERS:
            continue
        spread = np.std(rest, ddof=1) * np.sqrt(1.0 + 1.0 / rest.size)
        limit = student.ppf(1.0 - ODD / logs.size, rest.size - 1) * spread
        if logs[k] - rest.mean() > limit:
            off, usual = (_percent(v / shown.mean_speed_rpm) for v in (rmse, np.exp(rest.mean())))
            sentences.append(
                f"look at {name}: off by {off}, the others by {usual}; if the aircraft was not in "
                "order, train without it"
            )
    return sentences


def _share(shown: GoodFlights, condition: str) -> float | None:
    for one in shown.errors:
        if one.condition == condition:
            return one.score.rmse_rpm / shown.mean_speed_rpm
    return None


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
