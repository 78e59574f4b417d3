"""The answer of `identify` in words: what its owner does next, how sure it is, what stays open.

Console, page and JSON all show these sentences. Those that ask for something come first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.alarm_words import fault_amount
from thrustmargin.gcs_plugin.wording.effect_amounts import rotor_words
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_sentence, effect_thing
from thrustmargin.gcs_plugin.wording.language import (
    chance,
    duration,
    joined,
    number,
    percent,
    percent_within,
    shown_unit,
    within,
)
from thrustmargin.gcs_plugin.workshop.identify.asked_words import unexplained, unnamed_causes
from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.identification.answer.model_update import WORST_SHARE, MarginChange
from thrustmargin.models.identification.answer.result import (
    Errors,
    Excluded,
    Identification,
    Mentioned,
    OneOf,
)
from thrustmargin.models.identification.answer.standing_shares import StandingCause, StandingShares
from thrustmargin.models.identification.certainty import CHOICE, SURE
from thrustmargin.models.identification.next_flight.next_flight import NextFlight
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.output_shares import lacks_sound_flights
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.rotor_faults import faults_in_model

#: Share of thrust by which a margin must move to be reported as a change.
NOTICED = 0.005


def answer(
    found: Identification,
    margin: MarginChange,
    following: NextFlight | None = None,
    mission: str = "",
) -> tuple[str, ...]:
    """The sentences, most urgent first; `margin` is that of all effects, on the worst rotor, and
    `mission` the file with the flight that is `following`."""
    names = found.model.airframe.rotor_names
    suspects = suspected(found, following)
    rotors_first = sorted(found.found, key=lambda f: f.term.rotor is None)
    lines = (
        [] if found.standing is None else standing_words(found.standing, names, found.problem.names)
    )
    lines += [effect_sentence(f, found) for f in rotors_first]
    flights = found.problem.flights
    lines += [mentioned(m, names, flights) for m in found.mentioned]
    lines += [one_of(o, names, flights) for o in found.one_of]
    lines += [held_damage(fault, names) for fault in faults_in_model(found.model)]
    open_mode = unexplained(found)
    only_open = not lines and bool(found.open_causes) and found.nothing_probability < CHOICE
    if not lines and not open_mode and not only_open:
        lines.append(nothing(found))
    lines += [open_mode] if open_mode else []
    lines += [unnamed_causes(found)] if found.open_causes else []
    if only_open and (cleared := excluded_losses(found)):
        lines.append(f"A loss {cleared}")
    lines += [effect_sentence(f, found) for f in found.followed]
    if following is not None:
        lines.append(next_flight_words(following, names, mission, suspects))
    lines.append(error_words(found, margin))
    return tuple(f"{line}." for line in (*lines, *open_questions(found), *claims(found)))


def suspected(found: Identification, following: NextFlight | None = None) -> tuple[int, ...]:
    """Rotors, from 1, that may be bad: named, one of several, not cleared, or in question."""
    terms = [f.term for f in found.found]
    terms += [term for one in found.one_of for term in one.terms]
    terms += [term for side in (following.separates if following else ()) for term in side]
    rotors = {term.rotor for term in terms} | {one.rotor for one in found.mentioned}
    rotors |= {one.rotor for one in found.standing.weak_rotors} if found.standing else set()
    return tuple(sorted(rotor + 1 for rotor in rotors if rotor is not None))


def looked_first(rotors: Sequence[int]) -> str:
    """That nobody flies to find out what a look at the rotors, from 1, may show; else empty."""
    if not rotors:
        return ""
    return f"first, {actions.inspect_rotors(rotors).text}; only if sound, "


def one_of(one: OneOf, names: Sequence[str], flights: int) -> str:
    """Effects of which only together nearly all weight holds one."""
    shares = [
        f"{effect_thing(term, names)} ({chance(share)})"
        for term, share in zip(one.terms, one.probabilities, strict=True)
    ]
    by = f"{flights} flights do" if flights > 1 else "one flight does"
    return f"Either {' or '.join(shares)}: {by} not tell which"


def mentioned(one: Mentioned, names: tuple[str, ...], flights: int) -> str:
    """A rotor that is not named and that the flights do not clear."""
    sign, more = (1.0, "less") if one.loss >= 0.0 else (-1.0, "more")
    low, high = sorted(sign * end for end in one.ci95)
    amount, interval = within(sign * one.loss, low, high, "%", factor=100.0, most=1)
    thrust = f"it may make {amount} {more} thrust {interval}"
    if low < 0.0 < high:
        most, least = (at_most(end, "1") for end in (one.ci95[1], -one.ci95[0]))
        thrust = f"it may make up to {most} less or {least} more thrust"
    return (
        f"{rotor_words(one.rotor, names).capitalize()} cannot be ruled out "
        f"({chance(one.probability, flights)}): {thrust}, so {actions.INSPECT.text}"
    )


def standing_words(
    shares: StandingShares, names: tuple[str, ...], flights: tuple[str, ...]
) -> list[str]:
    """What stands between outputs and model with the two ways to find out, then what it may be.

    `names` are the places of the rotors, `flights` the names of the logs.
    """
    when = "all along" if shares.flight is None else f"most in {flights[shares.flight]}"
    off = ", ".join(number(rpm, "", 0) for rpm in shares.rotor_rpm)
    causes = [*filter(None, [shares.trim]), *shares.weak_rotors]
    sizes = "".join(f", or {_standing_cause(one, names)}" for one in causes)
    return [
        "Motor outputs alone cannot tell a weak rotor from a shifted centre of gravity or trim; "
        f"{when} they differ from the model by {off} rpm on rotors 1 to {len(names)}: learn a "
        "model from sound flights of this aircraft (thrustmargin train GOOD... --out-model FILE) "
        f"and give it with --model, or, {actions.SWAP_ALIKE.text}",
        f"It may be motors or ESCs that differ{sizes}",
    ]


def _standing_cause(one: StandingCause, names: tuple[str, ...]) -> str:
    shift = (
        f"{_millimetres(one.cg_x)} {'aft' if one.cg_x < 0.0 else 'forward'} and "
        f"{_millimetres(one.cg_y)} to the {'left' if one.cg_y < 0.0 else 'right'}"
    )
    if one.rotor is None:
        moment = within(abs(one.yaw_moment), math.nan, math.nan, "N m", most=1)[0]
        side = "left" if one.yaw_moment < 0.0 else "right"
        return f"a centre of gravity {shift} with a steady yaw moment of {moment} to the {side}"
    return (
        f"{percent_within(one.loss, *one.loss_range)} less thrust of "
        f"{rotor_words(one.rotor, names)} with a centre of gravity {shift}"
    )


def _millimetres(metres: float) -> str:
    return number(1000.0 * abs(metres), "mm", 0)


def held_damage(fault: RotorFault, names: tuple[str, ...]) -> str:
    """That the model was given a weak rotor before, which repaired nothing."""
    return (
        f"The model already holds {rotor_words(fault.rotor, names)} at {fault_amount(fault)} less "
        f"thrust: unless that was repaired, {actions.INSPECT.text}"
    )


def nothing(found: Identification) -> str:
    """That no effect is named, how sure that is, and the loss of a rotor that is excluded."""
    if found.problem.of_outputs:
        return "Motor outputs show nothing that is missing, but they cannot clear a rotor"
    if unusual := more_than_sound(found):
        return unusual
    verdict, cleared = _nothing_or_what(found), excluded_losses(found)
    return f"{verdict}: a loss {cleared}" if cleared else verdict


def excluded_losses(found: Identification) -> str:
    """`above 1.8 % on any rotor is excluded, a smaller one is not`; empty where none is."""
    of_rotors = {
        e.term.rotor: e.above
        for e in found.excluded
        if e.term.effect.key == ROTOR_DEGRADATION.key and e.parameter == "loss"
    }
    if not of_rotors or found.problem.of_outputs:
        return ""
    most = at_most(max(of_rotors.values()), "1")
    where = "any rotor"
    if len(of_rotors) < found.model.airframe.rotor_count:
        where = (
            f"rotor {', '.join(str(r + 1) for r in sorted(r for r in of_rotors if r is not None))}"
        )
    return f"above {most} on {where} is excluded, a smaller one is not"


def _nothing_or_what(found: Identification) -> str:
    """`Nothing is found missing`, with its probability where not sure; else that something is.

    What is likely and was not borne out by flights left out is in the table, and asks for nothing.
    """
    none = found.nothing_probability
    if none >= SURE:
        return "Nothing is found missing"
    if none >= CHOICE:
        return f"Nothing is found missing ({chance(none, found.problem.flights)})"
    if found.likeliest is not None:
        term, likely = found.likeliest
        what = effect_thing(term, found.model.airframe.rotor_names)
        return (
            f"Something small may be missing, likeliest {what} "
            f"({chance(likely, found.problem.flights)}): nothing to repair"
        )
    some = 1.0 - none if none else sum(one.probability for one in found.alternatives)
    return (
        f"Something small may be missing ({chance(some, found.problem.flights)}), and these "
        "flights do not show what: nothing to repair"
    )


def more_than_sound(found: Identification) -> str:
    """What the channels could explain of the error, where sound flights have less; else empty."""
    known, error = found.model.good_flights, found.after
    most = known.most_rmse_rpm() if known else math.nan
    systematic = math.sqrt(max(error.rmse_rpm**2 - found.floor_rpm**2, 0.0))
    if not systematic > most:
        return ""
    *others, worst = sorted(error.per_rotor_rmse_rpm)
    rotor = error.per_rotor_rmse_rpm.index(worst)
    where = "and no rotor stands out"
    if worst**2 - float(np.mean(np.square(others))) > most**2:  # that it has beyond the others
        names = found.model.airframe.rotor_names
        where = f"most on {rotor_words(rotor, names)}: {actions.LOOK_FIRST.text}"
    return (
        f"These flights are not like sound ones, and no effect explains it: off by "
        f"{number(error.rmse_rpm, 'rpm', 0)}, sound flights by up to {number(most, 'rpm', 0)} "
        f"(95 %), {where}"
    )


def at_most(size: float, unit: str, name: str = "") -> str:
    """A limit with two digits that count, rounded away from zero: `2.1 %` of 0.0204."""
    factor, unit = shown_unit(unit, name)
    if not math.isfinite(size) or size <= 0.0:
        return number(size * factor, unit)
    decimals = 1 - math.floor(math.log10(size * factor))
    up = math.ceil(size * factor * 10.0**decimals - 1e-6) / 10.0**decimals
    text = number(up, "", max(0, decimals))
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} {unit}".rstrip()


def excluded_rows(found: Identification) -> list[tuple[str, str]]:
    """What was not seen and the size that is excluded; a row for all rotors, one for all cables."""
    largest: dict[str, Excluded] = {}
    spoken_of = {m.rotor for m in found.mentioned} | {f.term.rotor for f in found.found}
    another = "any other weak rotor" if spoken_of - {None} else "any weak rotor"
    for one in found.excluded:
        thing = effect_thing(one.term, found.model.airframe.rotor_names)
        if one.term.rotor is not None:
            thing = another
        if len([p for p in one.term.effect.parameters if not p.detail]) > 1:
            thing += f", {one.parameter.replace('_', ' ')}"
        if thing not in largest or one.above > largest[thing].above:
            largest[thing] = one
    return [
        (thing, f"above {at_most(e.above, e.unit, e.parameter)}") for thing, e in largest.items()
    ]


def set_words(terms: Sequence[Term], names: Sequence[str]) -> str:
    """A set of effects: `hidden mass and a weak rotor 1 (front right)`."""
    things = [effect_thing(term, names) for term in terms] or ["nothing"]
    return " and ".join(filter(None, (", ".join(things[:-1]), things[-1])))


def next_flight_words(
    following: NextFlight, names: Sequence[str], mission: str, suspects: Sequence[int] = ()
) -> str:
    """The flight that distinguishes two explanations, after a look at the rotors `suspects`."""
    ours, theirs = following.separates
    both = {t.key for t in ours} & {t.key for t in theirs}
    sides = [[t for t in side if t.key not in both] for side in (ours, theirs)]
    asked = " from ".join(set_words(side, names) for side in sides if side)
    question = asked if all(sides) else f"whether the cause is {asked}"
    times = f", {following.repeats} times" if following.repeats > 1 else ""
    sure = ""
    if following.certainty < SURE:
        sure = f"; even that is right in only {chance(following.certainty)} of cases"
    return (
        f"To tell {question}, {looked_first(suspects)}{following.manoeuvre.words}{times} "
        f"({duration(60.0 * following.minutes)}){sure}; "
        + (f"{mission} is its mission" if mission else "--next-flight FILE.plan writes its mission")
    )


def error_words(found: Identification, margin: MarginChange) -> str:
    """Rotor speed error before and after, on which rows, its floor, and the margin."""
    error = rmse_words(found.after)
    changed = found.found or found.open_causes
    if changed:
        error = f"{number(found.before.rmse_rpm, '', 0)} -> {error}"
    floor = f"at best {number(found.floor_rpm, 'rpm', 0)} with these channels"
    moved = f"; {margin_words(margin, found.model.airframe.rotor_names)}" if changed else ""
    return f"Rotor speed error (RMSE) {error} on {where_from(found)}, {floor}{moved}"


def rmse_words(errors: Errors, unit: str = "rpm") -> str:
    """`12.9 rpm (12.5 to 13.4)`."""
    return joined(within(errors.rmse_rpm, *errors.rmse_ci95_rpm, unit, most=1))


def where_from(found: Identification) -> str:
    """Which rows the errors before and after are of."""
    if found.held_out is not None:
        count = found.held_out.flights
        return f"{count} flight{'s' if count > 1 else ''} not used"
    if found.problem.flights > 1:
        return f"{found.problem.flights} flights, each predicted without itself"
    return "one flight, each fifth predicted without itself"


def margin_words(change: MarginChange, names: tuple[str, ...]) -> str:
    """The predicted margin without and with effects: typical, or at the worst moments if more."""
    who = "the worst rotor" if change.rotor is None else rotor_words(change.rotor, names)
    typical = change.typical_after - change.typical_before
    worst = change.worst_after - change.worst_before
    if abs(worst) > 2.0 * abs(typical) and abs(worst) >= NOTICED:
        when = f"at the worst moments ({percent(WORST_SHARE)} of the time) "
        return f"{when}margin of {who} {_moves(change.worst_before, change.worst_after)}"
    if abs(typical) < NOTICED:
        return f"margin of {who} stays at {percent(change.typical_after)}"
    return f"margin of {who} {_moves(change.typical_before, change.typical_after)}"


def _moves(before: float, after: float) -> str:
    decimals = 0 if round(before * 100) != round(after * 100) else 1
    way = "falls" if after < before else "rises"
    return f"{way} from {percent(before, decimals)} to {percent(after, decimals)}"


def open_questions(found: Identification) -> list[str]:
    """What stays open about a rotor, and what could not be tried."""
    lines = []
    if found.problem.of_outputs:
        lines.append(
            "From motor outputs: only each rotor's share of the thrust was looked at, for battery, "
            "air and load move all outputs together"
        )
        if lacks_sound_flights(found.model) and found.standing is None:
            lines.append(
                "Outputs alone do not show by how much sound flights of this aircraft differ, so "
                "no rotor is named: give --model with a file learnt from good flights "
                "(thrustmargin train GOOD... --out-model FILE)"
            )
    elif any("airspeed" in lacking for lacking in found.untried.values()):
        lines.append("No airspeed is measured, so drag, lift and an unknown wind were not tried")
    return lines


def claims(found: Identification) -> tuple[str, ...]:
    """What so few flights do not allow to say."""
    if found.problem.flights == 1:
        return (
            "One flight only: that this holds on another flight cannot be claimed, and effects "
            "that differ from flight to flight (air, battery, fill, wind) cannot be distinguished "
            "from each other; the intervals are of this flight alone. Give two flights or more, at "
            "different tank levels, and one more with --held-out",
        )
    if found.problem.flights == 2:
        return (
            "Two flights only: the intervals show how stretches of these flights differ, not how "
            "flights do. Three or more would show it",
        )
    return ()
