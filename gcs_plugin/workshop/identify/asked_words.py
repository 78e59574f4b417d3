"""Describe the actions that `identify` advises, and what no effect explains, for the aircraft's
owner."""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.actions import Action, When
from thrustmargin.gcs_plugin.wording.effect_amounts import rotor_words
from thrustmargin.gcs_plugin.wording.effect_sentences import (
    ALONG_WORDS,
    KIND_OF_PART,
    action_of,
    along_name,
    amount_of,
    common_cause,
    effect_thing,
    unnamed_place,
)
from thrustmargin.gcs_plugin.wording.language import Verbatim, chance, number, say
from thrustmargin.models.effects.unnamed import CONSTANT, ONLY_ROTORS
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.identification.certainty import COSTS, SURE


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestedAction:
    """An action that the result of an identification asks a person to do."""

    part: str  # with the number of the rotor, from 1
    action: str
    probability: float  # that the part is bad
    expected_cost: float  # in inspections of a propeller


def requested_actions(found: Identification) -> tuple[RequestedAction, ...]:
    """Return the actions that the result asks for, with probabilities.

    Actions of reported effects come first, rotors before others, then inspections of rotors that
    could not be excluded, then of one with an unexplained loss, then of those with an error beyond
    that of sound flights. Effects that need only be kept in the model ask for none.
    """
    out = [
        _request(action, f.term.degraded_rotor, f.probability)
        for f in sorted(found.found, key=lambda f: f.term.rotor is None)
        if (action := action_of(f, found)) and action.part != actions.KEEP.part
    ]
    out += [_request(actions.INSPECT, one.rotor, one.probability) for one in found.mentioned]
    left = found.left
    if left is not None and left.rotor is not None:
        out.append(_request(actions.INSPECT, left.rotor, 1.0))
    if found.excess is not None and not out:
        out += [_request(actions.LOOK_FIRST, rotor, SURE) for rotor in found.excess.rotors]
    return tuple(out)


def _request(action: Action, rotor: int | None, probability: float) -> RequestedAction:
    """Return the request to do `action`, with the probability of the cause and the expected cost.

    `rotor` counts from 0; None if it is of no rotor.
    """
    kind = KIND_OF_PART.get(action.part, "aircraft")
    hands_on = action.when is When.BATTERY_OFF
    return RequestedAction(
        part=f"rotor {rotor + 1}" if rotor is not None and hands_on else action.part,
        action=action.text,
        probability=probability,
        expected_cost=COSTS[kind].expected_cost(probability),
    )


def unexplained_words(found: Identification) -> str:
    """Return the sentence on the residual that no effect explains: RMS, rpm, mode or rotor,
    channels, and what to do.

    One that comes and goes within flights has no channel. The effects that resemble it are named,
    if there are some. Empty if there is no such residual, or a minor one.
    """
    left = found.unexplained()
    if left["mode"] is None or left["minor"]:
        return ""
    share, rms = chance(left["fraction_of_variance"]), number(left["rms_rpm"], "rpm", 0)
    channels = f" {say('or')} ".join(
        along_name(one) + common_cause(one) for one in left["channels"]
    )
    along = say("goes with {channels}", channels=Verbatim(channels))
    action = actions.COMPARE_SOUND.text
    if not found.open_causes:
        action = say("nothing was added for it; {action}", action=action)
    if left["wanders"]:
        along = say(
            "comes and goes within flights more than in good ones, and goes with no channel"
        )
        action = f"{actions.LOOK_FOR_ICE.text}; {actions.COMPARE_WIND.text}"
    names = found.model.airframe.rotor_names
    if left.get("rotor"):
        goes = say("goes with its own thrust") if left["channel"] in ONLY_ROTORS else along
        rotor = left["rotor"] - 1
        words = (
            "{rotor} does not lose the same share of its thrust all along: the loss {goes} "
            "({rms}), and no effect of the table does that, so none was added; {action}, and {look}"
        )
        if any(one.found.term.rotor == rotor for one in found.open_causes):
            words = (
                "{rotor} does not lose the same share of its thrust all along: the loss {goes} "
                "({rms}), and no effect of the table does that; {action}, and {look}"
            )
        return say(
            words,
            rotor=rotor_words(rotor, names).capitalize(),
            goes=goes,
            rms=rms,
            action=actions.INSPECT.text,
            look=actions.UNSTEADY.text,
        )
    closest = dict.fromkeys(effect_thing(term, names, found.gaining) for term in found.closest)
    close = ""
    if closest:
        close = say("; closest in the table: {effects}", effects=f" {say('or')} ".join(closest))
    words = "No effect explains {rms} in {mode}, {share} of what is left, that {goes}"
    line = say(words, rms=rms, mode=say(left["mode"]), share=share, goes=along)
    return f"{line}{close}: {action}"


def minor_words(found: Identification) -> str:
    """Return a clause on a minor unexplained residual: RMS, mode, channels, share; empty without
    one.
    """
    left = found.unexplained()
    if not left["minor"]:
        return ""
    along = say("comes and goes within flights")
    if not left["wanders"]:
        channels = f" {say('or')} ".join(along_name(one) for one in left["channels"])
        along = say("goes with {channels}", channels=channels)
    return say(
        "{rms} in {mode} that {goes}, {share} of what is left",
        rms=number(left["rms_rpm"], "rpm", 0),
        mode=say(left["mode"]),
        goes=along,
        share=chance(left["fraction_of_variance"]),
    )


def unnamed_causes_words(found: Identification) -> str:
    """Return the sentence on the unnamed causes added to the model: mode or rotor, channel, its
    range, RMS, rpm.

    An effect of the catalogue among them is stated with its amount and probability. A loss of a
    rotor is an alarm until repaired, a weight near one or a tilted arm is not. Needs at least one
    unnamed cause.
    """
    each, names, curves = [], found.model.airframe.rotor_names, False
    for one in found.open_causes:
        size, bad = f"({number(one.rms_rpm, 'rpm', 0)})", one.found.term.degraded_rotor
        until = "" if bad is None else say(", an alarm until it is repaired")
        if one.place is None:
            words = amount_of(one.found, found)
            likely = say("{chance} likely", chance=chance(one.found.probability))
            each.append(f"{words[0].lower()}{words[1:]}, {likely}{until}")
            continue
        where = unnamed_place(one.found.term, names)
        if one.range is None:
            each.append(f"{where} {size}{until}")
            continue
        _, unit, factor = ALONG_WORDS[one.place[1]]
        low, high = (end * factor for end in one.range)
        span = f"{number(low, '', 1)} {say('to')} {number(high, unit, 1)}"
        as_well = [along_name(other) for other in one.alike if other != CONSTANT]
        others = f" ({say('or')} {', '.join(as_well)})" if as_well else ""
        example = common_cause(one.place[1])
        each.append(f"{where}{others}{example}, {span} {size}{until}")
        curves = True
    seen = say("Without a name, as it was seen: {causes}", causes=Verbatim("; ".join(each)))
    beyond = say(", held at its edge beyond that range, with twice the interval")
    return f"{seen}; {actions.KEEP_AS_SEEN.text}{beyond if curves else ''}"
