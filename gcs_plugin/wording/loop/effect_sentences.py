"""What each effect of the table is called, says about the aircraft, and asks of its owner.

A sentence names the part and the amount, with its interval behind it; the action follows a colon.
An effect without words of its own is described by its parameters.

What no effect explains, in words: what is left, and what of it goes into the new model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.actions import Action, When
from thrustmargin.gcs_plugin.wording.language import CHANNEL_WORDS, chance, number
from thrustmargin.gcs_plugin.wording.loop import effect_amounts as amounts
from thrustmargin.gcs_plugin.wording.loop.effect_amounts import DescribedEffect, rotor_words
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.instrument_effects import FOLLOWED_WIND
from thrustmargin.models.effects.unnamed import CONSTANT, NAME, ONLY_ROTORS, place_of
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.identification.certainty import COSTS
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.model.rotor_model import RotorModel

if TYPE_CHECKING:
    from thrustmargin.models.identification.answer.result import Found, Identification
    from thrustmargin.models.identification.rows.candidates import Term


@dataclass(frozen=True, slots=True)
class EffectWords:
    """What an effect is called in a list, what it says, and what its owner does next."""

    thing: str  # "{rotor}" stands for the rotor
    sentence: Callable[[DescribedEffect], str]
    action: Action | None = actions.KEEP  # None where there is nothing to do


def effect_sentence(found: Found, whole: Identification) -> str:
    """Part, amount and action of one effect, without a full stop."""
    action = action_of(found, whole)
    asked = [action] if action else []
    if action is actions.INSPECT and whole.problem.of_outputs:
        asked.append(actions.THEN_MOTOR)
    return ": ".join(filter(None, (amount_of(found, whole), ", ".join(a.text for a in asked))))


def amount_of(found: Found, whole: Identification) -> str:
    """Part and amount of one effect."""
    return words_of(found.term).sentence(DescribedEffect(found, whole))


def action_of(found: Found, whole: Identification) -> Action | None:
    """What is asked for an effect; a rotor that makes more than it should has another propeller.

    A model that no flight has taught knows no drag: then it is no sign of what was mounted.
    """
    action = words_of(found.term).action
    if action is actions.LOOK_FOR_MOUNTED and not whole.model.taught:
        return actions.KEEP
    gains = action is actions.INSPECT and found.value[found.flight, 0] < 0.0
    return actions.SAME_KIND if gains else action


def effect_thing(term: Term | Placed, rotor_names: Sequence[str]) -> str:
    """What an effect is called in a list: `a weak rotor 1 (front right)`."""
    rotor = "" if term.rotor is None else rotor_words(term.rotor, tuple(rotor_names))
    where = unnamed_place(term, rotor_names) if term.effect.name == NAME else ""
    return words_of(term).thing.format(rotor=rotor, where=where)


def unnamed_place(term: Term | Placed, rotor_names: Sequence[str]) -> str:
    """Where a cause without a name acts: `pitch along speed forward`, `yaw all along`."""
    mode, channel = place_of(term.effect)
    if term.rotor is not None:
        mode = f"the loss of {rotor_words(term.rotor, tuple(rotor_names))}"
    return f"{mode} all along" if channel == CONSTANT else f"{mode} along {ALONG_WORDS[channel][0]}"


def effect_things(model: RotorModel) -> tuple[str, ...]:
    """What the effects of a model are called, each once."""
    names = model.airframe.rotor_names
    things = (effect_thing(placed, names) for placed in model.placed)
    return tuple(dict.fromkeys(things))


def words_of(term: Term | Placed) -> EffectWords:
    """The words of an effect by its key, else by its name, else by its parameters."""
    key, name = term.effect.key, term.effect.name
    spelt = name.replace("_", " ") + ("" if term.rotor is None else " of {rotor}")
    return WORDS.get(key) or WORDS.get(name) or EffectWords(spelt, amounts.by_parameters, None)


#: What only causes without a name go along, beside the channels of the figures.
ALONG_WORDS = {
    **CHANNEL_WORDS,
    "forward_speed": ("speed forward", "m/s", 1.0),
    "side_speed": ("speed to the right", "m/s", 1.0),
    "along_acceleration": ("speeding up", "m/s²", 1.0),
    "air_temperature": ("air temperature", "K", 1.0),
    "load": ("the thrust that all rotors make", "kg", 1.0),
}

WEAK = "a weak {rotor}"
#: key of the effect, or its name where all variants are described alike -> its words
WORDS: Mapping[str, EffectWords] = {
    "rotor_degradation": EffectWords(WEAK, amounts.weak_rotor, actions.INSPECT),
    "rotor_degradation:onset": EffectWords(
        WEAK + " in flight", amounts.weakened_in_flight, actions.INSPECT
    ),
    "rotor_degradation:for a while": EffectWords(
        WEAK + " for a while", amounts.weakened_for_a_while, actions.LOOK_AT_MOTOR
    ),
    "rotor_degradation:in each flight": EffectWords(
        "{rotor} weakening in every flight", amounts.weakens_each_flight, actions.FEEL_HEAT
    ),
    "rotor_degradation:since": EffectWords(
        WEAK + " since a flight", amounts.weak_since_a_flight, actions.INSPECT
    ),
    "rotor_degradation:until repaired": EffectWords(
        WEAK + " until it was repaired", amounts.weak_until_repaired, actions.REPAIRED
    ),
    "extra_mass": EffectWords("hidden mass", amounts.hidden_mass, actions.WEIGH),
    "air_density": EffectWords("air density", amounts.air_density),
    "tank_scale": EffectWords(
        "a wrong tank gauge", partial(amounts.wrong_gain, "tank gauge"), actions.SET_GAUGE
    ),
    "tank_zero": EffectWords("a tank gauge off its zero", amounts.tank_zero, actions.ZERO_GAUGE),
    "tank_drift": EffectWords("a tank gauge that drifts", amounts.tank_drift, actions.CHECK_GAUGE),
    "airspeed_bias": EffectWords(
        "an airspeed sensor off its zero", amounts.airspeed_bias, actions.ZERO_AIRSPEED
    ),
    "airspeed_gain": EffectWords(
        "a wrong airspeed sensor",
        partial(amounts.wrong_gain, "airspeed sensor"),
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
    "wind": EffectWords("wind", amounts.wind, actions.CHECK_WIND),
    "unnamed_cause": EffectWords(
        "a cause without a name in {where}", amounts.by_parameters, actions.KEEP_AS_SEEN
    ),
    FOLLOWED_WIND.key: EffectWords("wind", amounts.followed_wind, None),
}


#: Part of an action -> whose costs it has.
KIND_OF_PART = {
    "propeller": "rotor",
    "motor": "rotor",
    "rotor": "rotor",
    "tank gauge": "instrument",
    "airspeed sensor": "instrument",
    "settings": "instrument",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedAction:
    """One action that a person is asked for."""

    part: str  # with the number of the rotor, from 1
    action: str
    probability: float  # that it is right
    expected_cost: float  # of asking, in times a look at a propeller


def asked_of(found: Identification) -> tuple[AskedAction, ...]:
    """The actions of the answer in its order; what only keeps something in the model is none."""
    out = [
        _asked(action, f.term.rotor, f.probability)
        for f in sorted(found.found, key=lambda f: f.term.rotor is None)
        if (action := action_of(f, found)) and action.part != actions.KEEP.part
    ]
    out += [_asked(actions.INSPECT, one.rotor, one.probability) for one in found.mentioned]
    left = found.left
    if left is not None and left.rotor is not None:
        out.append(_asked(actions.INSPECT, left.rotor, 1.0))
    return tuple(out)


def _asked(action: Action, rotor: int | None, probability: float) -> AskedAction:
    kind = KIND_OF_PART.get(action.part, "aircraft")
    hands_on = action.when is When.BATTERY_OFF
    return AskedAction(
        part=f"rotor {rotor + 1}" if rotor is not None and hands_on else action.part,
        action=action.text,
        probability=probability,
        expected_cost=COSTS[kind].expected_cost(probability),
    )


def unexplained(found: Identification) -> str:
    """What is left that no effect explains; empty when nothing is."""
    left = found.unexplained()
    if left["mode"] is None:
        return ""
    share, rms = chance(left["fraction_of_variance"]), number(left["rms_rpm"], "rpm", 0)
    along = f"goes with {' or '.join(ALONG_WORDS[one][0] for one in left['channels'])}"
    action = actions.COMPARE_SOUND.text
    if not found.open_causes:
        action = f"nothing was added for it; {action}"
    if left["wanders"]:
        along = "comes and goes within flights more than in good ones, and goes with no channel"
        action = f"{actions.LOOK_FOR_ICE.text}; {actions.COMPARE_WIND.text}"
    names = found.model.airframe.rotor_names
    if left.get("rotor"):
        goes = "goes with its own thrust" if left["channel"] in ONLY_ROTORS else along
        rotor = left["rotor"] - 1
        seen = any(one.found.term.rotor == rotor for one in found.open_causes)
        return (
            f"{rotor_words(rotor, names).capitalize()} does not lose the same share of "
            f"its thrust all along: the loss {goes} ({rms}), and no effect of the table does "
            f"that{'' if seen else ', so none was added'}; {actions.INSPECT.text}, "
            f"and {actions.UNSTEADY.text}"
        )
    things = " or ".join(dict.fromkeys(_thing_of(w, names) for w in left.get("closest") or ()))
    close = f"; closest in the table: {things}" if things else ""
    return (
        f"No effect explains {rms} in {left['mode']}, {share} of what is left, that {along}{close}"
        f": {action}"
    )


def unnamed_causes(found: Identification) -> str:
    """What has no name and is in the new model: of a curve axis, channel, range and size."""
    each, names, curves = [], found.model.airframe.rotor_names, False
    for one in found.open_causes:
        size, rotor = f"({number(one.rms_rpm, 'rpm', 0)})", one.found.term.rotor
        until = "" if rotor is None else ", an alarm until it is repaired"
        if one.place is None:
            words = amount_of(one.found, found)
            each.append(
                f"{words[0].lower()}{words[1:]}, {chance(one.found.probability)} likely{until}"
            )
            continue
        where = unnamed_place(one.found.term, names)
        if one.range is None:
            each.append(f"{where} {size}{until}")
            continue
        _, unit, factor = ALONG_WORDS[one.place[1]]
        low, high = (end * factor for end in one.range)
        span = f"{number(low, '', 1)} to {number(high, unit, 1)}"
        as_well = [ALONG_WORDS[other][0] for other in one.alike if other != CONSTANT]
        others = f" (or {', '.join(as_well)})" if as_well else ""
        each.append(f"{where}{others}, {span} {size}{until}")
        curves = True
    seen = f"Without a name, as it was seen: {'; '.join(each)}"
    if not found.found and found.after.rmse_rpm > found.before.rmse_rpm:
        return f"{seen}; {actions.LEAVE_OUT.text}"
    beyond = ", held at its edge beyond that range, with twice the interval" if curves else ""
    return f"{seen}; {actions.KEEP_AS_SEEN.text}{beyond}"


def _thing_of(words: str, names: Sequence[str]) -> str:
    """What an effect is called, from `Term.words`: its name, and its rotor from 1."""
    name, _, rotor = words.partition(" of rotor ")
    if name not in BY_KEY:
        return words.replace("_", " ")
    return effect_thing(Term(effect=BY_KEY[name], rotor=int(rotor) - 1 if rotor else None), names)
