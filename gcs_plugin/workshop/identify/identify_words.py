"""Write the answer of `identify` in sentences: what to do next, how certain it is, what stays open.

Console, page and JSON show these sentences; those that request an action come first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.alarm_words import fault_amount
from thrustmargin.gcs_plugin.wording.effect_amounts import rotor_words
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_sentence, effect_thing
from thrustmargin.gcs_plugin.wording.language import (
    Verbatim,
    chance,
    duration,
    joined,
    number,
    percent,
    percent_within,
    say,
    shown_unit,
    within,
)
from thrustmargin.gcs_plugin.workshop.identify.asked_words import (
    minor_words,
    unexplained_words,
    unnamed_causes_words,
)
from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.identification.answer.constant_shares import ConstantShares, ShareCause
from thrustmargin.models.identification.answer.held_out_errors import ExcessError
from thrustmargin.models.identification.answer.model_update import WORST_SHARE, MarginChange
from thrustmargin.models.identification.answer.result import (
    Errors,
    Excluded,
    Identification,
    Mentioned,
    OneOf,
)
from thrustmargin.models.identification.certainty import CHOICE, SURE
from thrustmargin.models.identification.next_flight.manoeuvres import Manoeuvre
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
    """Return the sentences on the result of an identification, the most urgent first.

    `margin` is the change of the worst rotor's predicted margin by all effects. `following` is the
    flight that would distinguish explanations, `mission` its file's name; empty if it is not
    written.
    """
    names = found.model.airframe.rotor_names
    suspects = suspect_rotors(found, following)
    rotors_first = sorted(found.found, key=lambda f: f.term.rotor is None)
    lines = (
        []
        if found.constant_shares is None
        else standing_words(found.constant_shares, names, found.problem.names)
    )
    lines += [effect_sentence(f, found) for f in rotors_first]
    flights = found.problem.flights
    lines += [mentioned_words(m, names, flights) for m in found.mentioned]
    open_mode = unexplained_words(found)
    # An error that nothing explains stands before explanations of which none was added.
    if found.excess is not None and not (found.mentioned or open_mode):
        lines.append(excess_error_words(found.excess, names))
    lines += [one_of_words(o, names, flights, found.gaining) for o in found.one_of]
    lines += [damage_in_model_words(fault, names) for fault in faults_in_model(found.model)]
    lines += [contradicted_words(found)] if found.contradicted else []
    only_open = not lines and bool(found.open_causes)
    if not lines and not open_mode and not only_open and not found.misread:
        lines.append(nothing_missing_words(found))
    lines += [open_mode] if open_mode else []
    lines += [unnamed_causes_words(found)] if found.open_causes else []
    if only_open and (cleared := excluded_losses(found)):
        lines.append(say("A loss {cleared}", cleared=cleared))
    lines += [effect_sentence(f, found) for f in found.followed]
    if following is not None:
        lines.append(next_flight_words(following, names, mission, suspects, found.gaining))
    lines.append(error_words(found, margin))
    return tuple(f"{line}." for line in (*lines, *open_questions(found), *few_flights_words(found)))


def suspect_rotors(found: Identification, following: NextFlight | None = None) -> tuple[int, ...]:
    """Return the rotors, from 1 and sorted, that may be bad by the result or by the flight
    `following`.

    They have a reported effect, are among confounded effects, could not be excluded, or are to be
    distinguished by that flight.
    """
    terms = [f.term for f in found.found]
    terms += [term for one in found.one_of for term in one.terms]
    terms += [term for side in (following.separates if following else ()) for term in side]
    rotors = {term.degraded_rotor for term in terms} | {one.rotor for one in found.mentioned}
    rotors |= (
        {one.rotor for one in found.constant_shares.weak_rotors} if found.constant_shares else set()
    )
    return tuple(sorted(rotor + 1 for rotor in rotors if rotor is not None))


def inspection_words(rotors: Sequence[int]) -> str:
    """Return the words that ask to inspect `rotors` (1-based) before a test flight; empty without
    rotors."""
    if not rotors:
        return ""
    action = actions.inspect_rotors(rotors).text
    return say("first, {action}; only if sound, ", action=action)


def one_of_words(
    one: OneOf, names: Sequence[str], flights: int, gaining: Collection[int] = ()
) -> str:
    """Return the sentence on confounded effects, at least one of which is present, with
    probabilities.

    `names` are the places of all rotors, `flights` is the number of flights; rotors in `gaining`,
    from 0, are called strong instead of weak.
    """
    shares = [
        f"{effect_thing(term, names, gaining)} ({chance(share)})"
        for term, share in zip(one.terms, one.probabilities, strict=True)
    ]
    words = "Either {effects}: one flight does not tell which"
    if flights > 1:
        words = "Either {effects}: {count} flights do not tell which"
    return say(words, effects=f" {say('or')} ".join(shares), count=flights)


def mentioned_words(one: Mentioned, names: tuple[str, ...], flights: int) -> str:
    """Return the sentence on a rotor that may be weak: its weakness is not reported, but not
    excluded either.

    It has the rotor's place, the probability with the number of `flights` it rests on, the loss of
    thrust, %, and an inspection as the action. A negative loss is worded as more thrust. If the 95
    % interval includes zero, only its two ends are given, as upper limits of less and of more
    thrust. `names` are the places of all rotors.
    """
    sign, words = 1.0, "it may make {amount} less thrust {interval}"
    if one.loss < 0.0:
        sign, words = -1.0, "it may make {amount} more thrust {interval}"
    low, high = sorted(sign * end for end in one.ci95)
    amount, interval = within(sign * one.loss, low, high, "%", factor=100.0, most=1)
    thrust = say(words, amount=amount, interval=interval)
    if low < 0.0 < high:
        most, least = (upper_limit(end, "1") for end in (one.ci95[1], -one.ci95[0]))
        words = "it may make up to {most} less or {least} more thrust"
        thrust = say(words, most=most, least=least)
    return say(
        "{rotor} cannot be ruled out ({chance}): {thrust}, so {action}",
        rotor=rotor_words(one.rotor, names).capitalize(),
        chance=chance(one.probability, flights),
        thrust=thrust,
        action=actions.INSPECT.text,
    )


def standing_words(
    shares: ConstantShares, names: tuple[str, ...], flights: tuple[str, ...]
) -> list[str]:
    """Return two sentences on a constant difference between motor outputs and the model.

    The first has its size in rpm and two ways to find the cause, the second the size of each
    possible cause. `names` are the rotors' places, `flights` the logs' names.
    """
    when = say("all along")
    if shares.flight is not None:
        when = say("most in {log}", log=Verbatim(flights[shares.flight]))
    off = ", ".join(number(rpm, "", 0) for rpm in shares.rotor_rpm)
    causes = [*filter(None, [shares.trim]), *shares.weak_rotors]
    sizes = "".join(f", {say('or')} {_standing_cause(one, names)}" for one in causes)
    words = (
        "Motor outputs alone cannot tell a weak rotor from a shifted centre of gravity or trim; "
        "{when} they differ from the model by {off} rpm on rotors 1 to {count}: learn a model from "
        "sound flights of this aircraft (thrustmargin train GOOD... --out-model FILE) and give it "
        "with --model, or, {action}"
    )
    action = actions.SWAP_ALIKE.text
    return [
        say(words, when=Verbatim(when), off=off, count=len(names), action=action),
        say("It may be motors or ESCs that differ{sizes}", sizes=sizes),
    ]


def _standing_cause(one: ShareCause, names: tuple[str, ...]) -> str:
    """Return a possible cause in words with its size: a shifted centre of gravity with a yaw
    moment.

    If the cause has a rotor, it is a loss of thrust of that rotor with a shifted centre of gravity.
    `names` are the rotors' places.
    """
    along, across = (
        say(
            "{amount} aft" if one.cg_x < 0.0 else "{amount} forward", amount=_millimetres(one.cg_x)
        ),
        say(
            "{amount} to the left" if one.cg_y < 0.0 else "{amount} to the right",
            amount=_millimetres(one.cg_y),
        ),
    )
    if one.rotor is None:
        words = (
            "a centre of gravity {along} and {across} with a steady yaw moment of {moment} to the "
            "right"
        )
        if one.yaw_moment < 0.0:
            words = (
                "a centre of gravity {along} and {across} with a steady yaw moment of {moment} to "
                "the left"
            )
        moment = within(abs(one.yaw_moment), math.nan, math.nan, "N m", most=1)[0]
        return say(words, along=along, across=across, moment=moment)
    return say(
        "{loss} less thrust of {rotor} with a centre of gravity {along} and {across}",
        loss=percent_within(one.loss, *one.loss_range),
        rotor=rotor_words(one.rotor, names),
        along=along,
        across=across,
    )


def _millimetres(metres: float) -> str:
    """Return the size of a length in m as text in mm, without its sign."""
    return number(1000.0 * abs(metres), "mm", 0)


def damage_in_model_words(fault: RotorFault, names: tuple[str, ...]) -> str:
    """Return the sentence that the model already contains the loss of a rotor.

    It asks to inspect the rotor unless it was repaired.
    """
    return say(
        "The model already holds {rotor} at {amount} less thrust: unless that was repaired, "
        "{action}",
        rotor=rotor_words(fault.rotor, names),
        amount=fault_amount(fault),
        action=actions.INSPECT.text,
    )


def nothing_missing_words(found: Identification) -> str:
    """Return the sentence for flights without a reported effect.

    It states that nothing is missing, with the loss of a rotor that the flights exclude, if any.
    For motor outputs it says only that they exclude nothing.
    """
    if found.problem.of_outputs:
        return say("Motor outputs show nothing that is missing, but they cannot clear a rotor")
    verdict, cleared = _missing_words(found), excluded_losses(found)
    words = "{verdict}: a loss {cleared}"
    if found.nothing_probability < CHOICE:
        words = "{verdict}; a loss {cleared}"
    return say(words, verdict=verdict, cleared=cleared) if cleared else verdict


def contradicted_words(found: Identification) -> str:
    """Return the sentence on effects that explain some flights but predict others worse.

    Such effects were not added to the model. With one flight, it is parts of this flight.
    """
    what = set_words(found.contradicted, found.model.airframe.rotor_names, found.gaining)
    words = (
        "No effect holds in all of these flights: with {what} some are explained and the others "
        "predicted worse, so none was added; {action}"
    )
    if found.problem.flights == 1:
        words = (
            "No effect holds all along this flight: with {what} a part is explained and the rest "
            "predicted worse, so none was added; {action}"
        )
    return say(words, what=what, action=actions.ONE_KIND.text)


def excluded_losses(found: Identification) -> str:
    """Return the smallest loss of thrust that is excluded for all rotors considered.

    `above 1.8 % on any rotor is excluded, a smaller one is not`; empty if none is excluded, or by
    motor outputs.
    """
    of_rotors = {
        e.term.rotor: e.above
        for e in found.excluded
        if e.term.effect.key == ROTOR_DEGRADATION.key and e.parameter == "loss"
    }
    if not of_rotors or found.problem.of_outputs:
        return ""
    most = upper_limit(max(of_rotors.values()), "1")
    if len(of_rotors) >= found.model.airframe.rotor_count:
        return say("above {limit} on any rotor is excluded, a smaller one is not", limit=most)
    return say(
        "above {limit} on rotor {rotors} is excluded, a smaller one is not",
        limit=most,
        rotors=", ".join(str(r + 1) for r in sorted(r for r in of_rotors if r is not None)),
    )


def _missing_words(found: Identification) -> str:
    """Return the sentence for flights whose error needs no effect to explain it, with its
    probability.

    From probability SURE on it is `Nothing is found missing`; from CHOICE on, that with the
    probability; below, what may be missing. An effect that cross-validation did not confirm is
    named, but requests no action.
    """
    none, flights = found.nothing_probability, found.problem.flights
    nothing = say("Nothing is found missing")
    if none >= SURE:
        return nothing
    if none >= CHOICE:
        return f"{nothing} ({chance(none, flights)})"
    if small := minor_words(found):
        words = "Something small may be missing, {small}: nothing to repair"
        return say(words, small=Verbatim(small))
    if found.most_probable is not None:
        term, likely = found.most_probable
        return say(
            "Something small may be missing, likeliest {effect} ({chance}): nothing to repair",
            effect=effect_thing(term, found.model.airframe.rotor_names),
            chance=chance(likely, flights),
        )
    some = 1.0 - none if none else sum(one.probability for one in found.alternatives)
    return say(
        "Something small may be missing ({chance}), and these flights do not show what: nothing "
        "to repair",
        chance=chance(some, flights),
    )


def excess_error_words(excess: ExcessError, names: Sequence[str]) -> str:
    """Return the sentence on an error larger than that of sound flights, explained by no effect.

    It asks to look first at the rotors that stand out, if any; `names` are the rotors' places.
    """
    where = say("and no rotor stands out")
    if excess.rotors:
        rotors = f" {say('and')} ".join(rotor_words(r, tuple(names)) for r in excess.rotors)
        where = say("most on {rotor}: {action}", rotor=rotors, action=actions.LOOK_FIRST.text)
    return say(
        "These flights are not like sound ones, and no effect explains it: off by {error}, sound "
        "flights by up to {most} (95 %), {where}",
        error=number(excess.rmse_rpm, "rpm", 0),
        most=number(excess.limit_rpm, "rpm", 0),
        where=where,
    )


def upper_limit(size: float, unit: str, name: str = "") -> str:
    """Return an upper limit as text with two significant digits, rounded up: `2.1 %` for 0.0204.

    `unit` is that of `size` in files ("1" is displayed in %), `name` the parameter's, if it has
    one.
    """
    factor, unit = shown_unit(unit, name)
    if not math.isfinite(size) or size <= 0.0:
        return number(size * factor, unit)
    decimals = 1 - math.floor(math.log10(size * factor))
    up = math.ceil(size * factor * 10.0**decimals - 1e-6) / 10.0**decimals
    text = number(up, "", max(0, decimals))
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} {unit}".rstrip()


def excluded_rows(found: Identification) -> list[tuple[str, str]]:
    """Return rows (effect, "above SIZE") of the effects whose larger sizes the flights exclude.

    All rotors share one row. So do effects of equal wording; an effect with several parameters has
    a row for each. A shared row states the largest of its limits.
    """
    largest: dict[str, Excluded] = {}
    spoken_of = {m.rotor for m in found.mentioned} | {f.term.rotor for f in found.found}
    another = say("any other weak rotor" if spoken_of - {None} else "any weak rotor")
    for one in found.excluded:
        thing = effect_thing(one.term, found.model.airframe.rotor_names)
        if one.term.rotor is not None:
            thing = another
        if len([p for p in one.term.effect.parameters if not p.detail]) > 1:
            thing += f", {say(one.parameter.replace('_', ' '))}"
        if thing not in largest or one.above > largest[thing].above:
            largest[thing] = one
    return [
        (thing, say("above {limit}", limit=upper_limit(e.above, e.unit, e.parameter)))
        for thing, e in largest.items()
    ]


def set_words(terms: Sequence[Term], names: Sequence[str], gaining: Collection[int] = ()) -> str:
    """Return a set of effects in words: `hidden mass and a weak rotor 1 (front right)`; `nothing`
    if empty. Rotors in `gaining` (0-based) make more thrust than expected."""
    things = [effect_thing(term, names, gaining) for term in terms] or [say("nothing")]
    return f" {say('and')} ".join(filter(None, (", ".join(things[:-1]), things[-1])))


def next_flight_words(
    following: NextFlight,
    names: Sequence[str],
    mission: str,
    suspects: Sequence[int] = (),
    gaining: Collection[int] = (),
) -> str:
    """Return the sentence on the flight that distinguishes two explanations.

    `names` are the rotors' places, `mission` is the file with the flight's mission, empty if none
    is written. Rotors in `suspects`, from 1, are to be inspected before it; rotors in `gaining`,
    from 0, are called strong instead of weak.
    """
    ours, theirs = following.separates
    both = {t.key for t in ours} & {t.key for t in theirs}
    sides = [[t for t in side if t.key not in both] for side in (ours, theirs)]
    words = [set_words(side, names, gaining) for side in sides if side]
    question = say("whether the cause is {cause}", cause=words[0])
    if all(sides):
        question = say("{one} from {other}", one=words[0], other=words[1])
    flight = manoeuvre_words(following.manoeuvre)
    if following.repeats > 1:
        flight += f", {say('{count} times', count=following.repeats)}"
    flight += f" ({duration(60.0 * following.minutes)})"
    if following.certainty < SURE:
        sure = "; even that is right in only {chance} of cases"
        flight += say(sure, chance=chance(following.certainty))
    plan = say("--next-flight FILE.plan writes its mission")
    if mission:
        plan = say("{file} is its mission", file=Verbatim(mission))
    return say(
        "To tell {question}, {flight}; {mission}",
        question=question,
        flight=Verbatim(f"{inspection_words(suspects)}{flight}"),
        mission=Verbatim(plan),
    )


#: Name of a manoeuvre -> instruction without a full stop, and format of its numbers.
_MANOEUVRES = {
    "hover": ("hover {low} s", ".0f"),
    "legs": ("fly a leg into the wind and back at {low} and at {high} m/s", ".1f"),
    "speed steps": ("change speed in steps between 0, {low} and {high} m/s", ".1f"),
    "squares": ("fly a small square to the right, then one to the left, nose ahead", ""),
    "climb and descent": ("climb from {low} to {high} m and descend, twice", ".0f"),
}


def manoeuvre_words(manoeuvre: Manoeuvre) -> str:
    """Return the instruction to fly a manoeuvre, with the tank levels, kg, that it needs."""
    words, form = _MANOEUVRES[manoeuvre.name]
    numbers = dict(zip(("low", "high"), (format(n, form) for n in manoeuvre.numbers), strict=False))
    fills = manoeuvre.fills_kg
    loads = {
        "full": say(", with {kg} kg in the tank", kg=f"{fills[0]:.3g}"),
        "nearly empty": say(", with {kg} kg in the tank", kg=f"{fills[-1]:.2g}"),
        "both": say(
            ", once with {full} and once with {low} kg in the tank",
            full=f"{fills[0]:.3g}",
            low=f"{fills[-1]:.2g}",
        ),
    }
    return f"{say(words, **numbers)}{loads.get(manoeuvre.load, '')}"


def error_words(found: Identification, margin: MarginChange) -> str:
    """Return the sentence on the rotor speed error, RMSE in rpm, before and after adding the
    effects.

    It names the flights that the error is of, the smallest error that the channels allow, and the
    change of margin. Without an added effect it has one error and no margin.
    """
    error = rmse_words(found.after)
    changed = found.found or found.open_causes
    if changed:
        error = f"{number(found.before.rmse_rpm, '', 0)} -> {error}"
    moved = f"; {margin_words(margin, found.model.airframe.rotor_names)}" if changed else ""
    words = say(
        "Rotor speed error (RMSE) {error} on {flights}; the best that these channels allow is "
        "about {floor}",
        error=error,
        flights=error_rows_words(found),
        floor=number(found.floor_rpm, "rpm", 0),
    )
    return f"{words}{moved}"


def rmse_words(errors: Errors, unit: str = "rpm") -> str:
    """Return the RMSE with its interval: `12.9 rpm (12.5 to 13.4)`."""
    return joined(within(errors.rmse_rpm, *errors.rmse_ci95_rpm, unit, most=1))


def error_rows_words(found: Identification) -> str:
    """Return a phrase on the flights in which the errors before and after are computed.

    They are held-out flights, or the fitted ones, each predicted without itself; of a single
    flight, fifths are.
    """
    if found.held_out is not None:
        count = found.held_out.flights
        words = "{count} flights not used" if count > 1 else "{count} flight not used"
        return say(words, count=count)
    if found.problem.flights > 1:
        words = "{count} flights, each predicted without itself"
        return say(words, count=found.problem.flights)
    return say("one flight in five parts, each predicted from the other four")


def margin_words(change: MarginChange, names: tuple[str, ...]) -> str:
    """Return how the predicted margin of the worst rotor changes by the new model, in words.

    It is in typical rows; or in the worst rows, if their margin changes by NOTICED or more and by
    more than twice the typical change. `names` are the rotors' places.
    """
    who = say("the worst rotor")
    if change.rotor is not None:
        who = rotor_words(change.rotor, names)
    typical = change.typical_after - change.typical_before
    worst = change.worst_after - change.worst_before
    if abs(worst) > 2.0 * abs(typical) and abs(worst) >= NOTICED:
        return say(
            "at the worst moments ({share} of the time) thrust left on {rotor} {change}",
            share=percent(WORST_SHARE),
            rotor=who,
            change=_change_words(change.worst_before, change.worst_after),
        )
    if abs(typical) < NOTICED:
        words = "thrust left on {rotor} stays at {share}"
        return say(words, rotor=who, share=percent(change.typical_after))
    moved = _change_words(change.typical_before, change.typical_after)
    return say("thrust left on {rotor} {change}", rotor=who, change=moved)


def _change_words(before: float, after: float) -> str:
    """Return `falls from 56 % to 53 %`; with a decimal if both would read the same."""
    decimals = 0 if round(before * 100) != round(after * 100) else 1
    words = "falls from {before} to {after}" if after < before else "rises from {before} to {after}"
    return say(words, before=percent(before, decimals), after=percent(after, decimals))


def open_questions(found: Identification) -> list[str]:
    """Return the sentences on what could not be tried for lack of data; empty if all was tried.

    For motor outputs: that only shares of thrust were looked at, and that no rotor is named if the
    model has no fault-free flights. Else, without an airspeed: that drag, lift and wind were not
    tried.
    """
    lines = []
    if found.problem.of_outputs:
        lines.append(
            say(
                "From motor outputs: only each rotor's share of the thrust was looked at, for "
                "battery, air and load move all outputs together"
            )
        )
        if lacks_sound_flights(found.model) and found.constant_shares is None:
            lines.append(
                say(
                    "Outputs alone do not show by how much sound flights of this aircraft differ, "
                    "so no rotor is named: give --model with a file learnt from good flights "
                    "(thrustmargin train GOOD... --out-model FILE)"
                )
            )
    elif any("airspeed" in lacking for lacking in found.untried.values()):
        lines.append(
            say("No airspeed is measured, so drag, lift and an unknown wind were not tried")
        )
    return lines


def few_flights_words(found: Identification) -> tuple[str, ...]:
    """Return a sentence on what one or two flights cannot show; empty for three or more."""
    if found.problem.flights == 1:
        words = (
            "One flight only: that this holds on another flight cannot be claimed, and effects "
            "that differ from flight to flight (air, battery, fill, wind) cannot be distinguished "
            "from each other; the intervals are of this flight alone. Give two flights or more, at "
            "different tank levels, and one more with --held-out"
        )
        return (say(words),)
    if found.problem.flights == 2:
        words = (
            "Two flights only: the intervals show how stretches of these flights differ, not how "
            "flights do. Three or more would show it"
        )
        return (say(words),)
    return ()
