"""Sentences on a known aircraft: how well it is known, what changed, and what must be asked."""

from __future__ import annotations

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
    """Return a mission as its forecast said it and as it was flown."""
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


def power_and_battery_words(law: PowerLaw | None, battery: KnownBattery) -> tuple[str, ...]:
    """Return what the flights of an aircraft show of its power and its battery; empty without."""
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
    """Return how a flight differs from the flights of its aircraft before it, with its size, since
    when, what the search over effects says of it, and what to do.
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
    """Return the change itself, with its size and the log since which it is there."""
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
    """Return what the search over effects says of the flights since a change."""
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
    """Return the question of which aircraft a log is, from names and reasons."""
    listed = "; ".join(f"{name} ({say(why)})" for name, why in found)
    return say(
        "its aircraft may be that of {listed}; give --aircraft NAME, a new name for a new aircraft",
        listed=listed,
    )
