"""What the margin report and the fill page say of a log, of the prediction and of a table's use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.fault_words import ONE_LOST, SPINS
from thrustmargin.gcs_plugin.wording.numbers import number, percent

#: What a flight without a channel cannot say; channels that nothing depends on are left out.
WITHOUT: Mapping[str, str] = {
    "rotor_speed_rpm": "no rotor speeds in this log: all figures are predicted",
    "tank_kg": "no tank level: weight, redundancy and largest fill are unknown",
    "voltage": "no battery voltage: the rotors' maximum is taken at the nominal voltage",
    "airspeed": "no airspeed: the network cannot predict",
    "position_ned": "no position: nothing can be drawn on the map",
    "velocity_ned": "no velocity: ground speed, distance and climb are unknown",
    "spraying": "no pump state: sprayed time, distance and area are unknown",
    "wind_ned": "no wind report",
    "angular_rate_frd": "no angular rate: turns are not named",
    "pressure": "no static pressure",
}
#: Rows of the table of load matching.
LIQUID, LOAD, RATIO, NAMEPLATE = (
    "liquid in the tank",
    "load a rotor",
    "full over empty, start over end",
    "load over the maker's maximum thrust",
)
IN_HOVER, IN_FLIGHT = (
    "thrust in use in hover, by weight",
    "thrust in use in flight, mean of the rotors",
)
#: Axes and lines of charts.
IN_USE, OVER_WEIGHT, IN_THE_TANK = "thrust in use", "thrust over weight", "in the tank"
MEAN_ROTOR = "mean of the rotors"
LOAD_INFERRED, TANK_SPRAYING = "load inferred, 90 % interval", "tank while spraying"
MEASURED_MINUS_PREDICTED = "measured minus predicted"
NOT_SPRAYING = "flying, not spraying"

#: Why the prediction is or is not checked.
TRAINED_ON = (
    "The network learnt from a flight of this name: the error on a new flight is likely larger."
)
NO_SPEEDS = "No rotor speeds in this log: the prediction cannot be checked against it."
NO_PREDICTION = "No prediction for this log: an input of the model is missing throughout."
NO_ROW_OF_BOTH = "No airborne row has both a measured and a predicted rotor speed."

#: Of a table of fills.
NOTHING_KEPT_BACK = (
    "Turns, climbs and gusts take more; nothing is kept back for the moment of a failure."
)
NO_AIRSPEED_LEARNT = (
    "Wind and speed are not in this: the model has no flights to learn drag from (train makes one)."
)
NO_MAKERS_LIMIT = "The airframe file has no max_takeoff_mass: the maker's limit is not in this."


def other_kind(learnt: str, here: str) -> str:
    return (
        f"it learnt from rotor speeds {learnt} and this flight's are {here}: part of the "
        "difference from the prediction is that of the two kinds"
    )


def trained_at(
    airspeed: Sequence[float], tank_kg: Sequence[float], density: Sequence[float]
) -> str:
    return (
        f"trained at {airspeed[0]:.1f} to {airspeed[1]:.1f} m/s airspeed, "
        f"{tank_kg[0]:.1f} to {tank_kg[1]:.1f} kg in the tank, "
        f"{density[0]:.3f} to {density[1]:.3f} kg/m³"
    )


def interval_made(coverage: float, flights: int) -> str:
    return (
        f"interval made to hold {coverage * 100:.0f} % on flights like its "
        f"{flights} training flights"
    )


def in_brackets(confidence: float, blocks: int, block_s: float) -> str:
    return (
        f"In brackets the {confidence * 100:.0f} % interval, from {blocks} blocks of "
        f"{block_s:.0f} s of this flight: it covers its gusts and turns, not other days."
    )


def no_intervals(blocks: int, fewest: int, block_s: float) -> str:
    return (
        f"No intervals: the flight has {blocks} blocks of {block_s:.0f} s, and fewer than "
        f"{fewest} cannot show how sure a figure is."
    )


def not_measured(basis: str) -> str:
    return f"The rotor speeds are {basis}: they cannot check the prediction."


def no_error(why: str) -> str:
    return f"No prediction error: {why}."


def day_words(temperature_c: float, altitude: float, voltage: float, airspeed: float) -> str:
    """Conditions of a fill: °C, m AMSL, V under load, m/s into the wind."""
    return (
        f"{number(temperature_c, '°C', 0)}, {number(altitude, 'm', 0)} above the sea, battery at "
        f"{number(voltage, 'V')}, {number(airspeed, 'm/s')} through the air"
    )


def fill_line(limit: float) -> str:
    return f"most for {percent(limit)} in steady flight"


def fill_limit(limit: float, *, rotor_lost: bool) -> str:
    also = f", and {ONE_LOST}: {SPINS}." if rotor_lost else "."
    return f"Limit: {percent(limit)} of a rotor's maximum thrust in steady flight{also}"


def guessed(names: Sequence[str]) -> str:
    return f"Guessed in the airframe file: {', '.join(names)}."
