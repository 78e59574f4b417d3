"""Describe effects found by `identify`: name in a list, sentence with the amount, requested action.

The action follows the amount after a colon. An effect without an entry in WORDS is described by its
parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording import effect_amounts as amounts
from thrustmargin.gcs_plugin.wording.actions import Action, Trouble
from thrustmargin.gcs_plugin.wording.effect_amounts import DescribedEffect, rotor_words
from thrustmargin.gcs_plugin.wording.language import CHANNEL_WORDS, say
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.instrument_effects import FOLLOWED_WIND
from thrustmargin.models.effects.unnamed import CONSTANT, NAME, place_of
from thrustmargin.models.model.rotor_model import RotorModel

if TYPE_CHECKING:
    from thrustmargin.models.identification.answer.result import Identification, ReportedEffect
    from thrustmargin.models.identification.rows.candidates import Term


@dataclass(frozen=True, slots=True)
class EffectWords:
    """The name of an effect in a list, the function that writes its sentence, and its action."""

    thing: str  # with the placeholders {rotor} and {where}
    sentence: Callable[[DescribedEffect], str]
    action: Action | None = actions.KEEP  # None if nothing is to be done


def effect_sentence(found: ReportedEffect, whole: Identification) -> str:
    """Return part, amount and action of one effect as a sentence without a full stop."""
    action = action_of(found, whole)
    asked = [action] if action else []
    if action is actions.INSPECT and whole.problem.of_outputs:
        asked.append(actions.THEN_MOTOR)
    return ": ".join(filter(None, (amount_of(found, whole), ", ".join(a.text for a in asked))))


def amount_of(found: ReportedEffect, whole: Identification) -> str:
    """Return the part and amount of one effect in words."""
    return words_of(found.term).sentence(DescribedEffect(found, whole))


def action_of(found: ReportedEffect, whole: Identification) -> Action | None:
    """Return the action that a reported effect asks for; None if it asks for none.

    A weak rotor asks for the action of its loss, one with more thrust than expected for a propeller
    of the same kind. Extra drag asks to look for mounted parts only if the model was trained on
    flights; another model has no drag. An effect that asks to be kept in the model must be left out
    if the error, RMSE, does not fall.
    """
    action = words_of(found.term).action
    if action is actions.LOOK_FOR_MOUNTED and not whole.model.taught:
        action = actions.KEEP
    if action is actions.KEEP and not whole.after.rmse_rpm < whole.before.rmse_rpm:
        return actions.LEAVE_OUT
    if action is not actions.INSPECT:
        return action
    loss, low = found.value[found.flight, 0], float(found.lower[found.flight, 0])
    if loss < 0.0:
        return actions.SAME_KIND
    rotors = () if found.term.rotor is None else (found.term.rotor + 1,)
    return actions.bad_rotor(rotors, low, actions.Phase.RECORDED).action if rotors else action


def effect_thing(
    term: Term | Placed, rotor_names: Sequence[str], gaining: Collection[int] = ()
) -> str:
    """Return an effect as a noun for lists: `a weak rotor 1 (front right)`.

    `rotor_names` are the places of all rotors. Rotors in `gaining`, from 0, make more thrust than
    expected and are called strong instead of weak.
    """
    rotor = "" if term.rotor is None else rotor_words(term.rotor, tuple(rotor_names))
    where = unnamed_place(term, rotor_names) if term.effect.name == NAME else ""
    thing = words_of(term).thing
    if term.rotor in gaining:
        thing = thing.replace(WEAK, STRONG)
    return say(thing, rotor=rotor, where=where)


def unnamed_place(term: Term | Placed, rotor_names: Sequence[str]) -> str:
    """Return which mode an unnamed cause changes, and along which channel: `pitch along speed
    forward`.

    A constant cause is `yaw all along`; one on a rotor names the rotor in place of the mode.
    `rotor_names` are the places of all rotors.
    """
    mode, channel = place_of(term.effect)
    mode = say(mode)
    if term.rotor is not None:
        mode = say("the loss of {rotor}", rotor=rotor_words(term.rotor, tuple(rotor_names)))
    if channel == CONSTANT:
        return say("{mode} all along", mode=mode)
    return say("{mode} along {channel}", mode=mode, channel=along_name(channel))


def effect_things(model: RotorModel) -> tuple[str, ...]:
    """Return the effects in a model as nouns, `a weak rotor 1 (front right)`, in the model's order.

    Equal texts are listed once.
    """
    names = model.airframe.rotor_names
    gaining = {
        one.rotor
        for one in model.placed
        if one.rotor is not None and one.values.get("loss", 0.0) < 0.0
    }
    things = (effect_thing(placed, names, gaining) for placed in model.placed)
    return tuple(dict.fromkeys(things))


def words_of(term: Term | Placed) -> EffectWords:
    """Return name, sentence and action of an effect, looked up by its key, then its name.

    An effect in neither table gets its name, a list of its parameters and no action.
    """
    key, name = term.effect.key, term.effect.name
    spelt = name.replace("_", " ") + ("" if term.rotor is None else " of {rotor}")
    return WORDS.get(key) or WORDS.get(name) or EffectWords(spelt, amounts.by_parameters, None)


#: Channels of figures and unnamed causes -> name, unit, factor to that unit.
ALONG_WORDS = {
    **CHANNEL_WORDS,
    "forward_speed": ("speed forward", "m/s", 1.0),
    "side_speed": ("speed to the right", "m/s", 1.0),
    "along_acceleration": ("speeding up", "m/s²", 1.0),
    "air_temperature": ("air temperature", "K", 1.0),
    "load": ("the thrust that all rotors make", "kg", 1.0),
}


def along_name(channel: str) -> str:
    """Return the name of a channel of ALONG_WORDS."""
    return say(ALONG_WORDS[channel][0])


#: Channel of an unnamed cause -> a common cause of what goes with it.
COMMON_CAUSES = {
    "spraying": "the recoil of the spray",
    "along_acceleration": "a load that moves",
}


def common_cause(channel: str) -> str:
    """Return an example of what goes with a channel, in brackets with a leading space; empty
    without one."""
    cause = COMMON_CAUSES.get(channel)
    return "" if cause is None else f" ({say('as by {cause}', cause=say(cause))})"


WEAK, STRONG = "a weak {rotor}", "more thrust of {rotor}"
#: Key of the effect, or its name if all variants are described alike -> its words.
WORDS: Mapping[str, EffectWords] = {
    "rotor_degradation": EffectWords("a weak {rotor}", amounts.weak_rotor, actions.INSPECT),
    "rotor_degradation:onset": EffectWords(
        "a weak {rotor} in flight", amounts.weakened_in_flight, actions.INSPECT
    ),
    "rotor_degradation:for a while": EffectWords(
        "a weak {rotor} for a while", amounts.weakened_for_a_while, actions.LOOK_AT_MOTOR
    ),
    "rotor_degradation:in each flight": EffectWords(
        "{rotor} weakening in every flight", amounts.weakens_each_flight, actions.FEEL_HEAT
    ),
    "rotor_degradation:since": EffectWords(
        "a weak {rotor} since a flight", amounts.weak_since_a_flight, actions.INSPECT
    ),
    "rotor_degradation:until repaired": EffectWords(
        "a weak {rotor} until it was repaired", amounts.weak_until_repaired, actions.REPAIRED
    ),
    "extra_mass:on an arm": EffectWords(
        "a weight near {rotor}", amounts.arm_weight, actions.BALANCE
    ),
    "extra_mass": EffectWords(
        "hidden mass", amounts.hidden_mass, actions.answer_to(Trouble.MASS).action
    ),
    "air_density": EffectWords("air density", amounts.air_density),
    "tank_scale": EffectWords(
        "a wrong tank gauge",
        partial(amounts.wrong_gain, *amounts.GAUGE_SHOWS),
        actions.answer_to(Trouble.GAUGE_SCALE).action,
    ),
    "tank_zero": EffectWords("a tank gauge off its zero", amounts.tank_zero, actions.ZERO_GAUGE),
    "tank_drift": EffectWords("a tank gauge that drifts", amounts.tank_drift, actions.CHECK_GAUGE),
    "airspeed_bias": EffectWords(
        "an airspeed sensor off its zero", amounts.airspeed_bias, actions.ZERO_AIRSPEED
    ),
    "airspeed_gain": EffectWords(
        "a wrong airspeed sensor",
        partial(amounts.wrong_gain, *amounts.AIRSPEED_SHOWS),
        actions.CHECK_AIRSPEED,
    ),
    "sensor_lag": EffectWords("a late airspeed", amounts.late_airspeed, actions.AIRSPEED_RATE),
    "sensor_lag:rotor speed": EffectWords(
        "late rotor speeds", amounts.late_rotor_speed, actions.ESC_RATE
    ),
    "parasite_drag": EffectWords("drag", amounts.drag, actions.LOOK_FOR_MOUNTED),
    "load_factor": EffectWords("the load factor of manoeuvres", amounts.load_factor),
    "slung_load": EffectWords("a swinging load", amounts.slung_load, actions.LOOK_BELOW),
    "cg_offset": EffectWords("a shifted centre of gravity", amounts.balance, actions.BALANCE),
    "yaw_trim:tilted arm": EffectWords(
        "a tilted arm of {rotor}", amounts.tilted_arm, actions.LEVEL_MOTORS
    ),
    "yaw_trim": EffectWords("a steady yaw moment", amounts.yaw_moment, actions.LEVEL_MOTORS),
    "manoeuvre_moment": EffectWords("the moments of turning", amounts.turning),
    "manoeuvre_moment:changed": EffectWords("another inertia", amounts.inertia, actions.ARMS_CARRY),
    "translational_lift": EffectWords("lift of forward flight", amounts.forward_lift),
    "climb_inflow": EffectWords("the inflow of climbs", amounts.climb),
    "ground_effect": EffectWords("ground effect", amounts.ground_effect),
    "thrust_drift": EffectWords("all rotors weakening", amounts.thrust_drift, actions.CLEAN_BLADES),
    "flow_moment": EffectWords("the moment of forward flight", amounts.flow_moment),
    "weathervane": EffectWords("the yaw moment of air from the side", amounts.weathervane),
    "drag_moment": EffectWords("the moment of leaning into wind", amounts.drag_moment),
    "battery_voltage": EffectWords(
        "rotor speeds that follow the voltage", amounts.voltage, actions.ESC_SPEEDS
    ),
    "wind": EffectWords("wind", amounts.wind, actions.answer_to(Trouble.WIND).action),
    "unnamed_cause": EffectWords(
        "a cause without a name in {where}", amounts.by_parameters, actions.KEEP_AS_SEEN
    ),
    FOLLOWED_WIND.key: EffectWords("wind", amounts.followed_wind, None),
}


#: Part of an action -> key of its costs in COSTS.
KIND_OF_PART = {
    "propeller": "rotor",
    "motor": "rotor",
    "rotor": "rotor",
    "tank gauge": "instrument",
    "airspeed sensor": "instrument",
    "settings": "instrument",
}
