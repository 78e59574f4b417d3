"""Sentences on a known aircraft: how well it is known, what changed, and what must be asked."""

from __future__ import annotations

import math
from collections.abc import Sequence

from thrustmargin.gcs_plugin.wording.actions import WEIGH, Phase, bad_rotor
from thrustmargin.gcs_plugin.wording.effect_sentences import words_of
from thrustmargin.gcs_plugin.wording.language import (
    Verbatim,
    joined,
    known,
    number,
    percent,
    percent_within,
    say,
    shown_unit,
    within,
)
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.mission.forecast.experience import FlownMission
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.model.aircraft_change import (
    AircraftChange,
    CauseKind,
    ChangeCause,
    ChangeKind,
    ChangeMode,
)
from thrustmargin.models.physics.electric_power import NORMAL, PowerLaw, power_factors
from thrustmargin.models.physics.known_battery import KnownBattery


def mission_words(mission: FlownMission) -> str:
    """Return time, energy and thrust left of a flown mission in words, each as forecast and as
    flown.
    """
    parts = []
    for words, pair in (
        ("{said} s, flown {flown}", mission.seconds),
        ("{said} Wh, flown {flown}", mission.energy_wh),
    ):
        said, flown = (number(value, "", 0) for value in (pair.said, pair.flown))
        parts.append(say(words, said=said, flown=flown))
    for words, pair in (
        ("thrust left on legs {said}, flown {flown}", mission.leg_use),
        ("at least {said}, flown {flown}", mission.peak_use),
    ):
        said, flown = (left_words(1.0 - use) for use in (pair.said, pair.flown))
        parts.append(say(words, said=said, flown=flown))
    text = say("its forecast said {parts}", parts="; ".join(parts))
    return text if mission.complete else f"{text} ({say('the plan was left before its end')})"


def counted_words(flights: int, days: int) -> str:
    """Return `5 flights on 3 days`."""
    of_flights = say("1 flight") if flights == 1 else say("{count} flights", count=flights)
    of_days = say("1 day") if days == 1 else say("{count} days", count=days)
    return say("{flights} on {days}", flights=Verbatim(of_flights), days=Verbatim(of_days))


def noted_words(name: str, changed: str) -> str:
    """Return that a change of an aircraft is noted."""
    known = {"name": Verbatim(name), "changed": Verbatim(changed)}
    return say("{name}: noted: {changed}; its next flight is the check of it", **known)


def walk_words(flight: float, day: float) -> str:
    """Return how much rotor speeds vary from flight to flight and from day to day, in words.

    Both arguments are standard deviations, as shares of rotor speed.
    """
    return say(
        "rotor speeds move by {flight:.1f} % from flight to flight and {day:.1f} % more from day "
        "to day",
        flight=100.0 * flight,
        day=100.0 * day,
    )


def flight_line(
    log_name: str,
    *,
    verdict: str,
    use: float,
    coverage: float,
    trained: bool,
    not_taught: str | None,
    faults: Sequence[tuple[str, int]],
    change: AircraftChange | None,
) -> str:
    """Return the line of a flight in its aircraft's timeline.

    `use` is the utilisation in steady flight, `coverage` the share of rotor speeds within the
    interval. `trained`: the model was trained on the flight; `not_taught` is why it did not update
    the aircraft's state, None if it did. `faults` are (kind, rotor from 1). `change` is the
    difference from earlier flights.
    """
    taught = say("trained") if trained else say("taught")
    if not_taught is not None:
        taught = say("taught nothing: {why}", why=say(not_taught))
    parts = (
        say(verdict),
        say("thrust left {left}", left=Verbatim(left_words(1.0 - use))),
        say("interval held {share}", share=Verbatim(percent(coverage))),
        taught,
    )
    bad = "".join(f"; {say(kind)} {rotor}" for kind, rotor in faults)
    odd = "" if change is None else f"; {change_words(change)}"
    return f"{log_name}: {', '.join(parts)}{bad}{odd}"


def learnt_words(*, use: float, coverage: float, trained: bool, not_taught: str | None) -> str:
    """Return a flight's least thrust left in steady flight, and what the aircraft's model learnt
    from it.

    `use` is the utilisation, `coverage` the share of rotor speeds within the interval, NaN if
    unknown. `trained`: the model was trained on it; `not_taught` is why it did not update the
    state, None if it did.
    """
    left = Verbatim(left_words(1.0 - use))
    first = say("steady flight: thrust left down to {left}", left=left)
    if trained:
        return f"{first}; {say('the model was made from it')}"
    held = ""
    if math.isfinite(coverage):
        held = say("interval held {share}", share=Verbatim(percent(coverage)))
    taught = "" if not_taught is None else say("taught nothing: {why}", why=say(not_taught))
    return "; ".join(filter(None, (first, held, taught)))


def not_learnt_words(log: str, reason: str) -> str:
    """Return the sentence that a log was not learnt from, with the reason."""
    return say("not learnt: {log}: {reason}", log=Verbatim(log), reason=Verbatim(say(reason)))


def owner_words() -> str:
    """Return the one command that an owner types instead of `airframe new` and `train`."""
    return say("airframe and model in one command: thrustmargin learn LOGS --aircraft NAME")


def card_lines(
    name: str, folder: str, *, flights: int, days: int, held: Sequence[float], day_step: float
) -> tuple[str, ...]:
    """Return lines on a known aircraft: its flights, and how well it is predicted.

    `held` are the coverages of the interval, 0 to 1, in later flights: their mean and least are
    stated. Without any, the line states `day_step`, the share of rotor speed by which the interval
    is widened for a new day. With 0 `flights` the lines say that no flight made the model, and what
    to do next.
    """
    known = {"name": Verbatim(name), "folder": Verbatim(folder)}
    counted = Verbatim(counted_words(flights, days))
    if not flights:
        first = say("{name}: no flight has made its model, kept in {folder}", **known)
        nothing = say("its airframe is all: a rotor that is weak from the start does not show")
        following = say(
            "next: learn three sound flights or more together: thrustmargin learn LOGS "
            "--aircraft {name}",
            name=known["name"],
        )
        return first, f"  {nothing}", f"  {following}"
    first = say("{name}: known from {counted}, kept in {folder}", counted=counted, **known)
    if held:
        line = say(
            "its interval, made for 90 %, held {mean:.0f} % on {count} later flights, each "
            "predicted before it was taught; least {least:.0f} %",
            mean=100.0 * sum(held) / len(held),
            count=len(held),
            least=100.0 * min(held),
        )
    else:
        line = say(
            "how well it predicts another day is not known yet: the interval is widened by "
            "{step:.1f} % of rotor speed for a new day",
            step=100.0 * day_step,
        )
    return first, f"  {line}"


def power_and_battery_words(law: PowerLaw | None, battery: KnownBattery) -> tuple[str, ...]:
    """Return one line on the power law and the battery measured in an aircraft's flights.

    Unknown parts are left out; empty if nothing is known.
    """
    parts = []
    if law is not None:
        reach = percent(power_factors(law.error)[1] - 1.0)
        words = "power known from {flights} flights, ± {reach}"
        parts.append(say(words, flights=len(law.flights), reach=reach))
    if battery.resistance > 0.0:
        ohm = number(1e3 * battery.resistance, "mOhm", 0)
        reach = percent(NORMAL * battery.resistance_error / battery.resistance)
        parts.append(say("battery {ohm} ± {reach}", ohm=ohm, reach=reach))
    if battery.rest_voltage > 0.0:
        parts.append(
            say("{volts} at rest before take-off", volts=number(battery.rest_voltage, "V"))
        )
    return ("; ".join(parts),) if parts else ()


def change_words(change: AircraftChange) -> str:
    """Return how a flight differs from earlier ones of its aircraft, in words.

    The sentence has size, first log, the cause that the search over effects found, and the action.
    """
    parts = [_what_changed(change)]
    if change.explanation is not None:
        parts.append(_explained(change.explanation))
    if change.rotor is not None:
        rotors = (change.rotor.rotor + 1,)
        parts.append(bad_rotor(rotors, change.rotor.low, Phase.RECORDED).action.text)
    elif change.kind is ChangeKind.OFFSET and known(change.mass_kg):
        parts.append(WEIGH.text)
    if change.rotor is None:
        parts.append(
            say("note what was repaired or fitted: thrustmargin aircraft NAME --changed PART")
        )
    return "; ".join(parts)


def _what_changed(change: AircraftChange) -> str:
    """Return how flights differ from earlier ones since a log: a rotor's loss, coverage or speeds.

    The first of these that is known is named. A loss and speeds have their interval; speeds, by
    mode, also the mass, kg, that would explain them. The text names the first log with the change.
    """
    if (total := change.rotor) is not None:
        return say(
            "since {log} rotor {rotor} has come to lose {loss} of its thrust, by all {flights} "
            "flights together",
            log=Verbatim(change.since_log),
            rotor=total.rotor + 1,
            loss=percent_within(total.loss, total.low, total.high),
            flights=total.flights,
        )
    if change.kind is ChangeKind.COVERAGE:
        return say(
            "since {log} the prediction no longer fits: {held} of rotor speeds are inside its "
            "interval, by chance at least {least}",
            log=Verbatim(change.since_log),
            held=percent(change.coverage),
            least=percent(change.coverage_by_chance),
        )
    parts = []
    for one in change.modes:
        low, high = sorted(
            (-one.low_rpm, -one.high_rpm) if one.rpm < 0.0 else (one.low_rpm, one.high_rpm)
        )
        size = joined(within(abs(one.rpm), low, high, "rpm"))
        if one.mode is ChangeMode.COLLECTIVE:
            words = (
                "all rotors turn {rpm} faster" if one.rpm > 0.0 else "all rotors turn {rpm} slower"
            )
            parts.append(say(words, rpm=size))
            continue
        up, down = (", ".join(str(k + 1) for k in side) for side in (one.faster, one.slower))
        words = "rotors {up} turn {rpm} faster and {down} slower"
        parts.append(say(words, up=up, rpm=size, down=down))
    text = say(
        "since {log} {parts}", log=Verbatim(change.since_log), parts=Verbatim(", ".join(parts))
    )
    if known(change.mass_kg):
        sign = -1.0 if change.mass_kg < 0.0 else 1.0
        ends = (change.mass_low_kg, change.mass_high_kg)
        mass = joined(within(change.mass_kg, *ends, "kg", factor=sign, most=1))
        heavier = "{text}, as if it were {mass} heavier"
        lighter = "{text}, as if it were {mass} lighter"
        text = say(heavier if sign > 0.0 else lighter, text=Verbatim(text), mass=mass)
    return text


def _explained(found: ChangeCause) -> str:
    """Return the effects that a search found as the cause of a change, each with its value and 95 %
    interval, and the RMSE before and after, rpm.

    If no search was made for lack of flight time, or no effect explains the change, the text says
    that instead.
    """
    if found.kind is CauseKind.NOT_SEARCHED:
        return say("too little flight to search for its cause")
    if found.kind is CauseKind.UNEXPLAINED:
        return say(
            "no effect explains it (error {error} by the state before)",
            error=number(found.error_before_rpm, "rpm", 0),
        )
    names = {effect.key: effect for effect in CATALOGUE}
    parts = []
    for one in found.effects:
        factor, unit = shown_unit(one.unit, one.parameter)
        thing = Verbatim(one.effect.replace("_", " "))
        if one.effect in names:
            placed = Placed(effect=names[one.effect], values={}, rotor=one.rotor)
            rotor = "" if one.rotor is None else say("rotor {number}", number=one.rotor + 1)
            thing = Verbatim(say(words_of(placed).thing, rotor=rotor, where=""))
        size = joined(within(one.value, one.low, one.high, unit, factor=factor))
        parts.append(f"{thing} {size}")
    return say(
        "the search finds {effects}: error {before} -> {after}",
        effects=Verbatim(", ".join(parts)),
        before=number(found.error_before_rpm, "", 0),
        after=number(found.error_after_rpm, "rpm", 0),
    )


def open_words(found: Sequence[tuple[str, str]]) -> str:
    """Return the question of which known aircraft a log is, from pairs (name, reason)."""
    listed = "; ".join(f"{name} ({say(why)})" for name, why in found)
    return say(
        "its aircraft may be that of {listed}; give --aircraft NAME, a new name for a new aircraft",
        listed=listed,
    )
