"""What gauges, pilot bar, 3D scene and replay say; numbers come with their unit from `numbers`."""

from __future__ import annotations

import math
from collections.abc import Sequence

from thrustmargin.gcs_plugin.wording.fault_words import ONE_LOST, outcome
from thrustmargin.gcs_plugin.wording.numbers import BEYOND_CEILING, margin_or_beyond, percent
from thrustmargin.models.model.inferred.output_speed import SpeedBasis

NO_DATA = "no data"
WORST_MARGIN = "Thrust margin, worst rotor"
MARGIN_IN_THE_AIR = "On the ground: margin in the air"
FOR_THIS_LOAD = "predicted for this load"
PREDICTED = "predicted"
NOTHING_KNOWN = "no rotor speed and no prediction"
ROTOR_LOST = ONE_LOST.capitalize()
LOAD_UNKNOWN = "load or weight unknown"
NO_TANK, TANK_SIZE_UNKNOWN = "no gauge and no pump reported", "its size is not known"
#: State of an aircraft in gauges, tabs and bar.
ON_GROUND, NO_MARGIN, NO_MARGIN_YET = "on the ground", "no margin", "no margin yet"
WORST_ROTOR = "thrust margin of the worst rotor"
BAR_WITHOUT_VERDICT = "no verdict"
BAR_REFUSES = "only the page of this view may acknowledge"
ALARMS_SOUGHT = "alarms still being looked for"
ALARMS_UNKNOWN = "alarms are not known: this flight could not be searched for them"
#: Words of the bar's own script, by their names in it.
BAR_SCRIPT = {
    "connecting": "connecting",
    "acknowledge": "Acknowledge",
    "sound_on": "Sound on",
    "sound_off": "Sound off",
    "history": "History",
    "region": "Margin and alarms",
    "old": "OLD: {}",
    "vehicle": "vehicle {}, ",
    "age": ", {} s old",
    "more": " (and {} more)",
    "whole_flight": " · Whole flight: {}",
    "no_vehicle": "No vehicle heard yet",
    "no_alarm": "No alarm",
    "no_alarm_yet": "No alarm so far.",
    "no_connection": "NO CONNECTION for {} s",
    "no_connection_title": "! no connection",
    "settings": "Settings of the page",
}
#: Controls.
TIME, TO_THE_WORST = "Time, s", "Go to the worst moment"
MARGIN = "Thrust margin"
WHOLE_FIELD, NORTH_UP, NOSE_AHEAD = "Whole field", "Follow, north up", "Follow, nose ahead"
PAUSED, ENDED = ", paused", "ended: the worst moment"
PREDICTED_WITHIN = "predicted with its interval, rpm"
RESIDUAL_BEFORE, RESIDUAL_AFTER = "Residual before", "Residual after"
ALL_PREDICTED = "predicted: no rotor speed was measured"
WITHOUT_EFFECTS = "model without effects"
TRUE_SIZE = "true size"
HOME, BEFORE = "Home", "Before take-off"
#: The charts of a live page.
LAST_MINUTES, SECONDS_BACK, LIVE_NOW = "Last minutes", "Seconds back", "live"
BACK_TO_LIVE = "Back to live"
SPRAY = {1.0: "spray on", 0.0: "spray off"}


def wind_words(speed: float) -> str:
    return f"wind {speed:.1f} m/s"


def fill_rests_on(density: float, basis: str, voltage: float, airspeed: float) -> str:
    """What an advice before take-off holds for: kg/m³ and its basis, V, m/s."""
    return (
        f"in air of {density:.2f} kg/m³ ({basis}), battery at {voltage:.1f} V under load, "
        f"{airspeed:.0f} m/s through the air; thrustmargin fill has other conditions"
    )


def charts_end(back_s: float, age_s: float) -> str:
    """Where charts end that are `back_s` before the newest row, which is `age_s` old."""
    if back_s > 0.0:
        return f"NOT LIVE: {back_s + age_s:.0f} s ago. Numbers and map are of now."
    return f"NOT LIVE: nothing new for {age_s:.0f} s"


TURNS_LEFT, TURNS_RIGHT = "turns left (CCW)", "turns right (CW)"


def rotor_legend(basis: str) -> str:
    return f"rpm: {basis} / predicted · bar mark: 50 % limit"


def rotor_place(number: int, name: str) -> str:
    return f"rotor {number}, {name}"


def not_measured(count: int) -> str:
    return f"{count} rotor{'s' if count > 1 else ''} not measured"


def margin_rests(basis: str, reach: float, unmeasured: int) -> str:
    """What the worst margin rests on, for the bar; `reach` is half of its 90 % interval."""
    parts = [f"worst rotor, {basis}" if basis != SpeedBasis.MEASURED else WORST_ROTOR]
    parts += [f"± {math.ceil(100 * reach)} %"] if reach > 0.0 else []
    parts += [not_measured(unmeasured)] if unmeasured else []
    return ", ".join(parts)


def share_words(share: float) -> str:
    """`64 %` of a margin, that it is beyond the ceiling below 0, "no data" for NaN."""
    if share < 0.0:
        return BEYOND_CEILING
    return percent(share) if math.isfinite(share) else NO_DATA


def of_the_weight(uncontrolled: float, controlled: float) -> str:
    return f"the weight: {outcome(uncontrolled, controlled)}"


def tank_share(share: float, capacity_kg: float) -> str:
    return f"{100 * share:.0f} % of {capacity_kg:g} kg"


def inferred_within(error_kg: float) -> str:
    return f"inferred, ± {error_kg:.1f} kg"


def figures_below(airspeed: str, height: str, voltage: str, spraying: float) -> str:
    """`spraying` is 1 on, 0 off; unknown is left out."""
    spray = f" · {SPRAY[spraying]}" if spraying in SPRAY else ""
    return f"airspeed {airspeed} · height {height} · battery {voltage}{spray}"


def age_words(age_s: float, *, silent: bool) -> str:
    """Whether the vehicle is silent, or only its figures are late."""
    return f"no data for {age_s:.0f} s" if silent else f"figures {age_s:.0f} s old"


def age_short(age_s: float, *, silent: bool) -> str:
    return f"no data {age_s:.0f} s" if silent else f"{age_s:.0f} s old"


def more_alarms(count: int) -> str:
    return f"and {count} more"


def empties_in(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"empty in {minutes}:{rest:02d} of spraying"


def margin_ahead(share: float) -> str:
    """No bound: the forecast knows no turns, climbs and gusts, which take more."""
    said = margin_or_beyond(share)
    return f"rest of the route, straight and level: {said}; turns and climbs take more"


def margin_full(share: float) -> str:
    return f"with a full tank: {margin_or_beyond(share)}"


def alarm_line(number: int, what: str, text: str) -> str:
    """A line of the history: what happened to an alarm (the kind of its event, or acknowledged)."""
    return f"vehicle {number}, {what}: {text}"


def of_vehicle(number: int, text: str) -> str:
    return f"Vehicle {number}: {text}"


def vehicle_name(number: int) -> str:
    return f"Vehicle {number}"


def titled(title: str, number: int) -> str:
    return f"{title} · vehicle {number}"


def model_with(effects: Sequence[str]) -> str:
    return f"model with {', '.join(effects)}" if effects else WITHOUT_EFFECTS


def measured_share(basis: str, share: float) -> str:
    return f"{basis} for {100 * share:.0f} %, predicted for the rest"


def drawn_larger(scale: float) -> str:
    return f"aircraft drawn {scale:.0f} x its size" if scale > 1.0 else TRUE_SIZE


def grid_words(cell: float) -> str:
    return f"grid {cell:g} m"


def replay_state(speed: float, *, playing: bool, ended: bool) -> str:
    return ENDED if ended else f"x{speed:g}{'' if playing else PAUSED}"
