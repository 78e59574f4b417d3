"""What each effect of the table is called, says about the aircraft, and asks of its owner.

A sentence names the part and the amount, with its interval behind it; the action follows a colon.
An effect without words of its own is described by its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from thrustmargin.gcs_plugin.wording import effect_amounts as amounts
from thrustmargin.gcs_plugin.wording.effect_amounts import DescribedEffect, rotor_words
from thrustmargin.models.identification.answer.already_followed import FOLLOWED_WIND
from thrustmargin.models.identification.answer.result import Found, Identification
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.model.rotor_model import RotorModel

KEEP = "nothing to repair; keep it in the model with --out"


@dataclass(frozen=True, slots=True)
class EffectWords:
    """What an effect is called in a list, what it says, and what its owner does next."""

    thing: str  # "{rotor}" stands for the rotor
    sentence: Callable[[DescribedEffect], str]
    action: str = KEEP  # empty where there is nothing to do


def effect_sentence(found: Found, whole: Identification) -> str:
    """Part, amount and action of one effect, without a full stop."""
    words, it = words_of(found.term), DescribedEffect(found, whole)
    action = words.action
    if action == INSPECT and whole.problem.of_outputs:
        action += ", then look at its motor and ESC, which outputs cannot distinguish from it"
    return f"{words.sentence(it)}: {action}" if action else words.sentence(it)


def effect_thing(term: Term, rotor_names: Sequence[str]) -> str:
    """What an effect is called in a list: `a weak rotor 1 (front right)`."""
    rotor = "" if term.rotor is None else rotor_words(term.rotor, tuple(rotor_names))
    return words_of(term).thing.format(rotor=rotor)


def effect_things(model: RotorModel) -> tuple[str, ...]:
    """What the effects of a model are called, each once."""
    names = model.airframe.rotor_names
    things = (effect_thing(Term(effect=p.effect, rotor=p.rotor), names) for p in model.placed)
    return tuple(dict.fromkeys(things))


def words_of(term: Term) -> EffectWords:
    """The words of an effect by its key, else by its name, else by its parameters."""
    key, name = term.effect.key, term.effect.name
    spelt = name.replace("_", " ") + ("" if term.rotor is None else " of {rotor}")
    return WORDS.get(key) or WORDS.get(name) or EffectWords(spelt, amounts.by_parameters, "")


INSPECT = "inspect or swap its propeller"
WEAK = "a weak {rotor}"
#: key of the effect, or its name where all variants are described alike -> its words
WORDS: Mapping[str, EffectWords] = MappingProxyType(
    {
        "rotor_degradation": EffectWords(WEAK, amounts.weak_rotor, INSPECT),
        "rotor_degradation:onset": EffectWords(
            WEAK + " in flight", amounts.weakened_in_flight, INSPECT
        ),
        "rotor_degradation:for a while": EffectWords(
            WEAK + " for a while",
            amounts.weakened_for_a_while,
            "look at its motor, ESC and wiring",
        ),
        "rotor_degradation:in each flight": EffectWords(
            "{rotor} weakening in every flight",
            amounts.weakens_each_flight,
            "feel its motor and ESC for heat",
        ),
        "rotor_degradation:since": EffectWords(
            WEAK + " since a flight", amounts.weak_since_a_flight, INSPECT
        ),
        "extra_mass": EffectWords("hidden mass", amounts.hidden_mass, "weigh it"),
        "air_density": EffectWords("air density", amounts.air_density),
        "tank_scale": EffectWords(
            "a wrong tank gauge", partial(amounts.wrong_gain, "tank gauge"), "check it"
        ),
        "tank_zero": EffectWords(
            "a tank gauge off its zero", amounts.tank_zero, "set it to zero with an empty tank"
        ),
        "tank_drift": EffectWords(
            "a tank gauge that drifts", amounts.tank_drift, "check it against what was filled in"
        ),
        "airspeed_bias": EffectWords(
            "an airspeed sensor off its zero", amounts.airspeed_bias, "set its zero before take-off"
        ),
        "airspeed_gain": EffectWords(
            "a wrong airspeed sensor",
            partial(amounts.wrong_gain, "airspeed sensor"),
            "check its tube and its calibration",
        ),
        "sensor_lag": EffectWords(
            "a late airspeed", amounts.late_airspeed, "check its filter and message rate"
        ),
        "sensor_lag:rotor speed": EffectWords(
            "late rotor speeds", amounts.late_rotor_speed, "raise the rate of ESC telemetry"
        ),
        "parasite_drag": EffectWords(
            "drag", amounts.drag, "look for what was mounted or left open"
        ),
        "load_factor": EffectWords("the load factor of manoeuvres", amounts.load_factor),
        "slung_load": EffectWords(
            "a swinging load", amounts.slung_load, "look at what hangs below"
        ),
        "cg_offset": EffectWords(
            "a shifted centre of gravity",
            amounts.balance,
            "move battery or load back to the middle",
        ),
        "yaw_trim": EffectWords(
            "a steady yaw moment",
            amounts.yaw_moment,
            "level the motors, then swap two propellers between the clockwise and "
            "counter-clockwise pairs",
        ),
        "manoeuvre_moment": EffectWords("the moments of turning", amounts.turning),
        "manoeuvre_moment:changed": EffectWords(
            "another inertia",
            amounts.inertia,
            "look at what arms and booms carry; keep it in the model with --out",
        ),
        "translational_lift": EffectWords("lift of forward flight", amounts.forward_lift),
        "climb_inflow": EffectWords("the inflow of climbs", amounts.climb),
        "ground_effect": EffectWords("ground effect", amounts.ground_effect),
        "thrust_drift": EffectWords(
            "all rotors weakening",
            amounts.thrust_drift,
            "check gauge and ESC readings first, then clean the blades",
        ),
        "flow_moment": EffectWords("the moment of forward flight", amounts.flow_moment),
        "weathervane": EffectWords("the yaw moment of air from the side", amounts.weathervane),
        "drag_moment": EffectWords("the moment of leaning into wind", amounts.drag_moment),
        "battery_voltage": EffectWords(
            "rotor speeds that follow the voltage",
            amounts.voltage,
            "no measured speed does, so check whether the ESCs estimate it",
        ),
        "wind": EffectWords("wind", amounts.wind, "check the airspeed sensor"),
        FOLLOWED_WIND.key: EffectWords("wind", amounts.followed_wind, ""),
    }
)
