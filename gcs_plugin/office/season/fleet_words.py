"""Word the findings of a season: what changed on an aircraft, when, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from thrustmargin.gcs_plugin.office.season.stored_words import (
    flight_damage,
    flight_doing,
    flight_reason,
)
from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.actions import Action, Trouble, answer_to
from thrustmargin.gcs_plugin.wording.effect_sentences import WORDS
from thrustmargin.gcs_plugin.wording.language import known, number, say, shown_unit, within
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.identification.season.change_points import SeasonEntry
from thrustmargin.models.identification.season.flight_sums import LOSS_NAME
from thrustmargin.models.model.model_misfit import Caveat


@dataclass(frozen=True, slots=True)
class ValueWords:
    """Title, unit and action of one value of a season; displayed numbers are times `factor`."""

    title: str
    unit: str
    factor: float
    decimals: int
    action: Action

    def amount(self, value: float, decimals: int = 0) -> str:
        """Return `3.1 %` of 0.031, with at least so many decimals."""
        return number(value * self.factor, self.unit, max(decimals, self.decimals))

    def amounts(self, before: float, after: float) -> tuple[str, str]:
        """Return two amounts as texts, with as many decimals, up to four, as it takes to tell them
        apart.
        """
        for decimals in range(self.decimals, 5):
            made = self.amount(before, decimals), self.amount(after, decimals)
            if made[0] != made[1]:
                break
        return made


BATTERY = "battery resistance"


def _after(trouble: Trouble) -> Action:
    """Return the action that a finding asks for after the flights."""
    return answer_to(trouble).action


VALUES: Mapping[str, ValueWords] = {
    "yaw_trim.moment": ValueWords("yaw moment", "N m", 1.0, 2, actions.LEVEL_MOTORS),
    "cg_offset.x": ValueWords("centre of gravity forward", "mm", 1e3, 0, actions.BALANCE),
    "cg_offset.y": ValueWords("centre of gravity to the right", "mm", 1e3, 0, actions.BALANCE),
    "cg_offset:tank.x_full": ValueWords(
        "centre of gravity forward with a full tank", "mm", 1e3, 0, actions.BALANCE
    ),
    "cg_offset:tank.y_full": ValueWords(
        "centre of gravity to the right with a full tank", "mm", 1e3, 0, actions.BALANCE
    ),
    "extra_mass.mass": ValueWords("mass not reported", "kg", 1.0, 2, _after(Trouble.MASS)),
    "tank_scale.gain": ValueWords(
        "load above the tank gauge", "%", 100.0, 1, _after(Trouble.GAUGE_SCALE)
    ),
    BATTERY: ValueWords(
        BATTERY, "m\N{GREEK CAPITAL LETTER OMEGA}", 1e3, 0, _after(Trouble.RESISTANCE)
    ),
}
TRENDS = ("yaw_trim.moment", "cg_offset.x", "cg_offset.y", "extra_mass.mass", "tank_scale.gain")
SWAP_UNKNOWN = "as after a new propeller or motor; enter it into parts.csv"
SILENT = "nothing was reported then"
HEALTHY = "nothing changed"
NAME_EACH = "take its logs in with learn --store --again --aircraft, a name for each aircraft"
MIXED = (
    "no change is followed: most flights are at the time of another one, so several aircraft have "
    "this name"
)
BETTER_BATTERY = "nothing: a newer battery or a warmer day"
NO_SUMS = "no flight has sums: they need measured rotor speeds and a model"
SET_AIRFRAME = (
    "set the airframe: thrustmargin airframe new --from one of its logs, then "
    "thrustmargin learn --store --again --airframe with that file"
)
OTHER_AIRFRAME = (
    "set the airframe: these flights do not fit the one given; take them in with "
    "learn --store --again --airframe and their own"
)


def rotor_of(name: str) -> int | None:
    """Return the rotor, from 1, whose loss the value `name` is; None for another value."""
    return int(name.removeprefix(LOSS_NAME)) if name.startswith(LOSS_NAME) else None


def value_words(name: str) -> ValueWords:
    """Return title, unit, scale factor, decimals and action for a value that a season follows.

    `name` is the value's name in the sums of flights. The displayed amount is value * factor, in
    the unit returned. An unknown name becomes the title itself, without a unit, and the action is
    IDENTIFY.
    """
    rotor = rotor_of(name)
    if rotor is not None:
        action = actions.change_propeller(rotor)
        title = say("thrust lost by rotor {rotor}", rotor=rotor)
        return ValueWords(title, "%", 100.0, 1, action)
    if name in VALUES:
        return VALUES[name]
    effect, _, value = name.rpartition(".")
    words = WORDS.get(effect) or WORDS.get(effect.partition(":")[0])
    table = BY_KEY.get(effect)
    if words is None or table is None:
        title = f"{effect} {value}".replace("_", " ").replace(":", ", ")
        return ValueWords(title, "", 1.0, 3, actions.IDENTIFY)
    unit = next((p.unit for p in table.parameters if p.name == value), "1")
    of_the_model = (None, actions.KEEP, actions.ARMS_CARRY)
    action = actions.IDENTIFY if words.action in of_the_model else words.action
    title = f"{words.thing}, {value.replace('_', ' ')}"
    if unit == "1":
        return ValueWords(title, "", 1.0, 3, action)
    factor, shown = shown_unit(unit)
    return ValueWords(title, shown, factor, 0 if shown == "mm" else 1, action)


def day(unix_s: float | None) -> str:
    """Return a date such as `12 Jun 2026` in the chosen language; empty for an unknown time."""
    if not known(unix_s):
        return ""
    when = datetime.fromtimestamp(unix_s, tz=UTC)
    return f"{when.day} {say(f'{when:%b}')} {when.year}"


def flight_words(index: int, unix_s: float | None) -> str:
    """Return `flight 61 (12 Jun 2026)` for the flight of index 60."""
    date = day(unix_s)
    return f"{say('flight')} {index + 1}" + (f" ({date})" if date else "")


def entry_sentence(name: str, entry: SeasonEntry, when: str, ended: bool) -> str:
    """Return the sentence on a change of the value `name`: from and to which amount, at which
    flight.

    `when` is the flight, in words; the flights of its 95 % interval follow. For a ramp the sentence
    has the amount per flight, and when it `ended`, or that it goes on.
    """
    words = value_words(name)
    since = when
    if entry.latest > entry.earliest:
        since += say(
            ", between {first} and {last}", first=entry.earliest + 1, last=entry.latest + 1
        )
    start, end = words.amounts(entry.before, entry.after)
    if entry.ramp:
        each = number(entry.per_flight * words.factor, words.unit, words.decimals + 1)
        until = say("still going on")
        if ended:
            until = say("until flight {flight}", flight=entry.until)
        more = say(
            "{each} more a flight since {since}: from {start} to {end}, {until}",
            each=each,
            since=since,
            start=start,
            end=end,
            until=until,
        )
        return f"{say(words.title)}: {more}"
    back = rotor_of(name) is not None and back_to_sound(entry)
    step = "back from {start} to {end} at {since}" if back else "from {start} to {end} at {since}"
    return f"{say(words.title)}: {say(step, start=start, end=end, since=since)}"


def back_to_sound(entry: SeasonEntry) -> bool:
    """Return True if a change is a step to a smaller value, as a new propeller causes."""
    return not entry.ramp and entry.size < 0.0 and abs(entry.after) < abs(entry.before)


def shared_sentence(name: str, value: float, error: float) -> str:
    """Return the sentence on a value by which all flights differ from the model in the same way.

    `name` is the value's name; `value` and its standard `error` are in its unit in files. The
    sentence has the 95 % interval.
    """
    words = value_words(name)
    ends = (value - 1.96 * error, value + 1.96 * error)
    amount, interval = within(value, *ends, words.unit, factor=words.factor)
    return f"{say(words.title)}: {amount} {say('in all flights')} {interval}".rstrip()


def several_aircraft(overlap_count: int, flights: int) -> str:
    """Return the sentence that `overlap_count` of `flights` flights overlap in time with another
    one.

    More than one aircraft must then have the name.
    """
    return say(
        "{count} of {all} flights are at the time of another one: more than one aircraft has this "
        "name, so its figures may mix them",
        count=overlap_count,
        all=flights,
    )


def frame_words(rotors: int | None, layout: str | None) -> str:
    """Return number and layout of rotors, such as `6 rotors, hexa-x`."""
    counted = say("rotors not known") if rotors is None else say("{count} rotors", count=rotors)
    return f"{counted}, {layout}" if layout else counted


def one_name(frames: Mapping[str, int]) -> str:
    """Return the sentence that several aircraft share a name, each with its number of flights.

    `frames` maps an aircraft's frame in words to that number.
    """
    each = "; ".join(
        f"{words}: {say('{count} flights', count=count)}" for words, count in frames.items()
    )
    return say(
        "its name is that of {count} aircraft, each shown by itself ({each})",
        count=len(frames),
        each=each,
    )


def several_boards(boards: int) -> str:
    """Return the finding that several autopilots flew alternately under one name."""
    return say(
        "{count} autopilots flew in turns under this name: more than one aircraft has it, so its "
        "figures may mix them",
        count=boards,
    )


def older_model(flights: int) -> str:
    """Return the remark that sums of older models or versions are left out, and the remedy."""
    return say(
        "{count} flights are about an older model, or of an older version, and are left out; "
        "learn --store --again takes them in",
        count=flights,
    )


def battery_prefix(name: str, elsewhere: str) -> str:
    """Return the start of a battery's sentence, such as `B-3 (then on sprayer-2), `.

    Empty for an unnamed battery. `elsewhere` is the aircraft of the time of the change, if another.
    """
    then = say(" (then on {aircraft})", aircraft=elsewhere) if elsewhere else ""
    return f"{name}{then}, " if name else ""


def no_verdict(flight: Mapping[str, Any]) -> tuple[str, str]:
    """Return why a stored flight has no verdict, and what to do to get one, both in words.

    `flight` is its row of the store. The step is on the airframe if it is unknown or contradicted,
    else on missing rotor speeds, else on the load, else to inspect the log.
    """
    reason = flight_reason(flight)
    if flight["airframe_basis"] == "not known":
        return reason, say(SET_AIRFRAME)
    if flight["airframe_basis"] is not None and flight["airframe"] is None:
        return reason, say(OTHER_AIRFRAME)
    if "rotor_speed_rpm" in (flight["missing_channels"] or ()):
        return reason, actions.ESC_TELEMETRY.text
    if "tank_kg" in (flight["missing_channels"] or ()):
        return reason, _after(Trouble.LOAD_UNKNOWN).text
    return reason, actions.INSPECT_LOG.text


def least_loss(least: float) -> str:
    """Return the smallest loss, a share of thrust, that the season would have shown, in words."""
    words = "a loss of {loss} in the last 10 flights would have been seen"
    return say(words, loss=number(100 * least, "%", 2))


def second_recordings(count: int) -> str:
    """Return how many logs, one or more, record flights that other logs record too."""
    if count == 1:
        return say("One log is a second recording of the same flight and is left out.")
    words = "{count} logs are second recordings of the same flights and are left out."
    return say(words, count=count)


#: What the last flight left open -> its words in a count of flights.
_OPEN: Mapping[Caveat, str] = {
    Caveat.GAUGE: "the tank gauge was left out",
    Caveat.LOAD: "thrust showed more load than was reported",
    Caveat.VOLTAGE: "the voltmeter was left out",
    Caveat.ROTOR_SPEEDS: "rotor speed sensors were to be checked",
    Caveat.BAROMETER: "the barometer was left out",
    Caveat.ROTORS_NOT_SOUGHT: "weak rotors were not looked for",
    Caveat.ROTORS_BY_OUTPUTS: "rotors were looked at by motor outputs alone",
    Caveat.ROTORS_UNLEARNT: "a rotor weak from the start would not have shown",
    Caveat.UNSEEN: "a part was not in the log",
}
#: Verdict -> its words in a count of flights.
_VERDICTS: Mapping[str, str] = {
    "damaged": "a rotor or motor was bad",
    "lost": "lost control",
    "battery": "the battery collapsed",
    "no_thrust": "no thrust was left",
    "critical": "a failed rotor would have brought it down",
    "over": "thrust left below the limit",
    "order": "motors were in another order than the airframe's",
    "near": "thrust left near the limit, cannot tell",
}


def grounding_sentence(verdict: str, count: int, recent: int, last: Mapping[str, Any]) -> str:
    """Return how many recent flights ended with a grounding verdict, and the cause of the last."""
    cause = flight_damage(last) if verdict == "damaged" else ""
    if verdict == "no_thrust" and known(last["worst_margin"]):
        cause = _least_margin_words(last)
    tail = f": {cause}" if cause else ""
    return _count_words(verdict, count, recent) + tail


def _count_words(verdict: str, count: int, recent: int) -> str:
    """Return how many of the `recent` flights had a verdict."""
    words = "{what} in {count} of the last {recent} flights"
    return say(words, what=say(_VERDICTS[verdict]), count=count, recent=recent)


def open_sentence(caveat: Caveat, count: int, recent: int) -> str:
    """Return the sentence that a caveat was open in `count` of the last `recent` flights.

    Empty for a caveat that another finding reports.
    """
    if caveat not in _OPEN:
        return ""
    words = "{what} in {count} of the last {recent} flights"
    return say(words, what=say(_OPEN[caveat]), count=count, recent=recent)


def _least_margin_words(flight: Mapping[str, Any]) -> str:
    """Return a flight's smallest margin and its rotor."""
    words = "least thrust left {margin}, rotor {rotor}"
    margin = left_words(flight["worst_margin"])
    return say(words, margin=margin, rotor=flight["worst_rotor"])


def margin_sentence(verdict: str, bad: int, recent: int, worst: Mapping[str, Any]) -> str:
    """Return how many recent flights were too heavy or may have been, and the worst flight's
    figures."""
    parts = filter(None, (_least_margin_words(worst), flight_doing(worst)))
    return f"{_count_words(verdict, bad, recent)}; {', '.join(parts)}"


def without_verdict(without: int, flights: int, reason: str) -> str:
    """Return how many flights have no verdict, and why the last one has none."""
    words = "{count} of {all} flights have no verdict: {reason}"
    return say(words, count=without, all=flights, reason=reason)
