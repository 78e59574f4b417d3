"""Whether a new model is fit for use, by flights it has not seen: the first line of `train`."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.identification.modes import modes
from thrustmargin.models.model.good_flights import GoodFlights
from thrustmargin.models.model.rotor_model import RotorModel

#: Share of rotor speed: 10 % of thrust, which at the 50 % limit is 5 points of margin. A model that
#: is off by more cannot say on which side of the limit a flight is.
USABLE = 0.05

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


def _share(shown: GoodFlights, condition: str) -> float | None:
    for one in shown.errors:
        if one.condition == condition:
            return one.score.rmse_rpm / shown.mean_speed_rpm
    return None


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
