"""Describe the forecast of a plan: may it take off, weakest place, fill, sorties, and
assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.advice_words import damage_words
from thrustmargin.gcs_plugin.wording.check_words import last_known_words
from thrustmargin.gcs_plugin.wording.clearance_words import (
    conditions_words,
    first_steps,
    grounding_words,
)
from thrustmargin.gcs_plugin.wording.day_words import day_line
from thrustmargin.gcs_plugin.wording.fill_words import UNSOUND, amount, with_day
from thrustmargin.gcs_plugin.wording.language import (
    area,
    duration,
    joined,
    number,
    percent,
    say,
    within,
)
from thrustmargin.gcs_plugin.wording.plan_words import fault_words, not_understood_words
from thrustmargin.gcs_plugin.wording.thrust_left import least_words, left_words
from thrustmargin.mission.forecast.fill_along import Weakest
from thrustmargin.mission.forecast.legs import Sortie
from thrustmargin.mission.forecast.plan_forecast import PlanForecast
from thrustmargin.models.model.advice import LEAST_FLIGHT_S, FlightLevel
from thrustmargin.models.physics.electric_power import power_factors

NO_VERDICT = "NO VERDICT: the model predicts nothing for this aircraft in these conditions"
UNLIKE = "NO VERDICT: the flight in this log does not fit the airframe"
NO_FLIGHT_SEEN = "NO VERDICT: the log shows no flight of this aircraft"
NOT_RECOGNISED = "NO VERDICT: the flight in this log is not recognised as one of this aircraft"
CONTRADICTED = "NO VERDICT: in the flight of this log rotor speeds and model contradict each other"
#: Unknown value -> the words about its assumption; {0} is the assumed value.
ASSUMED: Mapping[str, str] = {
    "aircraft": "the aircraft is {0}: give --airframe",
    "unlike": "the aircraft is {0}; its last flight speaks against that: {1}",
    "limits": "{0} not reported, so the autopilot's default is taken: give its parameters with "
    "--parameters",
    "full battery": "battery full, {0} V at rest: give --voltage",
    "earlier battery": "battery at {0} V at rest, usual before its earlier flights: give --voltage",
    "no capacity": "battery held at {0} V, its capacity is not known: give --capacity",
    "resistance": "battery resistance usual for lithium polymer packs: give --resistance",
    "no wind": "no wind: give --wind",
    "worst wind": "wind from {0}°, the worst of all directions: give --wind-from",
    "usual air": "air at {0} °C: give --air-temperature",
    "sea level": "field at sea level: give --altitude",
    "no flow": "nothing is sprayed, so the tank stays full: give --flow or --rate",
    "pump rate": "flow by SPRAY_PUMP_RATE of a pump of {0} L/min at full output: give --flow",
    "pump always": "pump: on from the first place to the last, as the airframe file says",
    "pump always stated": "pump: on from the first place to the last, as --pump says",
    "pump lines": "pump: on along {0} parallel lines, {1} m apart, as the airframe file says",
    "pump lines stated": "pump: on along {0} parallel lines, {1} m apart, as --pump says",
    "straight splines": "splines as straight legs: the way flown is longer",
    "circles as waits": "circles as time at their middle: no bank and no drag of the circle",
    "efficiency": "motors and speed controllers pass on {0} % of the battery's power: no flight "
    "measured it, so it may be {1} % less or {2} % more",
    "level ground": "heights above the ground as above home: no terrain is known",
    "PX4 corners": "corners cut by ArduPilot's rule: that of PX4 is not modelled",
    "pump by speed": "the flow falls with the speed over ground in turns",
    "no forward flight": "drag and lift of forward flight are not known of this aircraft",
    "no turns": "what turning the nose takes is not known of this aircraft: the thrust left is "
    "that without turns",
    "nose ahead": "the nose points along the first leg at take-off: a turn there is not in it",
    "nose gives way": "the nose gains at most {0} °/s² in turns: the rotors give no more",
    "first part": "only {0} of {1} min are flown in detail: the rest as these",
    "alike": "{0} of {1} min are flown in detail: the rest is like them",
    "hidden mass": "{0} kg that thrust showed in the last flight, and nobody reported: weigh it",
    "extrapolated": "beyond what the model has learnt in part: extrapolated by physics",
}
LEFT_OUT = "gusts and turbulence are not in it, nor the time of ways to and from a refill"
_KINDS: Mapping[str, str] = {
    "leg": "on the way to item {item}",
    "turn": "in the turn at item {item}",
    "climb": "in climb or descent to item {item}",
    "wait": "while it waits at item {item}",
}
#: Kinds of stretch in a table.
STRETCHES: Mapping[str, str] = {
    "leg": "leg",
    "turn": "turn",
    "climb": "climb, descent",
    "wait": "wait",
}
_SHORT: Mapping[str, str] = {
    "tank": "one line alone takes more than the tank holds: fill more, or shorten the lines",
    "battery": "one line alone takes more than the battery gives: shorten the lines",
    "unsure": "one line alone may take more than the battery gives: shorten the lines",
}
LEAST_SHARE = 0.005  # of utilisation, worth a word


def verdict(made: PlanForecast) -> str:
    """Return the forecast's first line: may the aircraft take off with this fill, and why.

    `TAKE OFF WITH 9.0 kg ONLY IF ...: thrust left 55 %, ...`; `DO NOT TAKE OFF ...`, `MAY TAKE OFF
    ...`, or that it is too close to decide. Open conditions come before the reason, since the line
    may be read no further; a line that forbids the take-off names none. A grounded aircraft and one
    over its maximum take-off mass come first. Without a verdict it says so.
    """
    advice = made.advised.advice
    use, limit = advice.use, least_words(advice.limit)
    by_battery = made.battery_unsure and advice.level is FlightLevel.UNDER
    fill = ""
    if _has_tank(made):
        fill = say(" WITH {amount}", amount=amount(_fill(made), _liquid(made)))
        if made.pump_never_on:
            fill += say(" AND THE PUMP OFF")
        if hidden := made.assumed.get("hidden mass"):
            fill += say(" AND {kg} kg THAT NOBODY REPORTED", kg=hidden[0])
    left = left_words(1.0 - use.lasting_most, 1.0 - use.lasting_high, 1.0 - use.lasting_low)
    no = f"{say('DO NOT TAKE OFF{fill}', fill=fill)}: "
    if made.grounded:
        return no + grounding_words(made.clearance)
    if made.too_heavy:
        return no + say("over the maker's maximum take-off mass")
    level = made.level
    if level is FlightLevel.UNKNOWN:
        return say(_no_verdict(made))
    if level is FlightLevel.BATTERY:
        return no + say("the battery does not last")
    if level is FlightLevel.NO_THRUST and not use.spent_s > 0.0:
        return no + say("a turn or the wind takes more thrust than there is")
    if level is FlightLevel.NO_THRUST:
        return no + say("no thrust is left for {long}", long=duration(use.spent_s))
    if level is FlightLevel.CRITICAL:
        long = duration(advice.rotor_lost.not_survivable_s)
        return no + say("for {long} a lost rotor brings it down", long=long)
    if level is FlightLevel.ORDER:
        return no + say("its motors are not in the airframe's order; test it, propellers off")
    known = {"left": left, "limit": limit}
    if level is FlightLevel.OVER:
        return no + say("thrust left {left}, below the {limit} limit", **known)
    why = say("thrust left {left}, limit {limit}", **known)
    if level is FlightLevel.DAMAGED:
        return no + damage_words(advice)
    only, far = _only_if(made), _as_far(made)
    if made.planned_level is FlightLevel.NEAR:
        why = say("the battery may not last") if by_battery else why
        if only:
            far = say(", IF {conditions}", conditions=only) + far
        return f"{say('TOO CLOSE TO TELL{fill}', fill=fill)}{far}: {why}"
    if only:
        words = say("TAKE OFF{fill} ONLY IF {conditions}", fill=fill, conditions=only)
        return f"{words}{far}: {why}"
    return f"{say('MAY TAKE OFF{fill}', fill=fill)}{far}: {why}"


def _no_verdict(made: PlanForecast) -> str:
    """Return the English line, in capitals, for a plan without a verdict.

    It names the reason if that is an earlier flight of the aircraft: too short to show anything,
    not recognised, of another airframe, or contradicted; else it is NO_VERDICT.
    """
    before = made.clearance.flight
    if made.clearance.level is not FlightLevel.UNKNOWN or before is None:
        return NO_VERDICT
    if before.no_verdict and before.airborne_s < LEAST_FLIGHT_S:
        return NO_FLIGHT_SEEN
    if before.no_verdict:
        return NOT_RECOGNISED if made.clearance.unrecognised else UNLIKE
    return CONTRADICTED


def before_words(made: PlanForecast) -> tuple[str, ...]:
    """Return the lines about what to do before take-off, and how that is proved."""
    return tuple(_cut(first_steps(made.clearance, grounded=made.grounded)))


def weakest_words(weakest: Weakest | None) -> str:
    """Return where thrust left is least, how much it is, and which causes take the thrust.

    `Weakest in the turn at item 5: thrust left 31 % (27 to 35); of the thrust go 22 % to the 15.0
    kg on board, 12 % to the turn.` None is an unknown place. Causes below LEAST_SHARE are left out.
    """
    if weakest is None:
        return say("Weakest place unknown.")
    parts = [
        (
            weakest.manoeuvre,
            "{share} to the turn"
            if weakest.kind == "turn"
            else "{share} to turning and speeding up",
        ),
        (weakest.load, "{share} to the {kg} on board"),
        (weakest.wind, "{share} to the wind"),
        (weakest.battery, "{share} to the fallen voltage"),
    ]
    named = [
        say(why, share=percent(share), kg=number(weakest.tank_kg, "kg"))
        for share, why in sorted(parts, reverse=True)
        if share >= LEAST_SHARE
    ]
    low, high = weakest.interval
    left = left_words(1.0 - weakest.utilisation, 1.0 - high, 1.0 - low)
    beyond = say(" (it takes more than the rotors can give)") if weakest.utilisation > 1.0 else ""
    where = say(_KINDS[weakest.kind], item=weakest.item)
    why = f"; {say('of the thrust go')} {', '.join(named)}" if named else ""
    words = say("Weakest {where}: thrust left {left}", where=where, left=left)
    return f"{words}{beyond}{why}."


#: Places where thrust is short; amount and reference as in `ThrustPlace`.
_PLACES: Mapping[str, str] = {
    "slope slows": (
        "the slope to item {item} slows the vehicle to {amount} m/s, of {reference} m/s ordered"
    ),
    "slope beyond thrust": (
        "the slope to item {item} takes more thrust than there is at {reference} m/s of climb: "
        "fly it slower, or with less"
    ),
    "loses height": (
        "the vehicle loses {amount} m of height or more where it leans to brake or turn on the "
        "way to item {item}"
    ),
    "motors at idle": (
        "a motor is at idle in the descent of {reference} m/s to item {item}: descend slower"
    ),
    "into the ground": "the way to item {item} leads {amount} m into the ground: plan it higher",
}


def place_words(made: PlanForecast) -> tuple[str, ...]:
    """Return lines on places of the plan that are short of thrust, steep or below ground.

    The gravest kind comes first; a long list is cut.
    """
    order = {kind: rank for rank, kind in enumerate(reversed(tuple(_PLACES)))}
    found = sorted(made.places, key=lambda place: (order[place.kind], -place.amount))
    words = [
        say(
            _PLACES[place.kind],
            item=place.item,
            amount=f"{place.amount:.1f}",
            reference=f"{place.secondary:.1f}",
        )
        for place in found
    ]
    return tuple(_cut([f"{one[0].upper()}{one[1:]}." for one in words]))


def fill_words(made: PlanForecast) -> str:
    """Return the sentence on the largest fill, kg, with which the plan keeps the limit and survives
    a lost rotor throughout.

    In this order it says instead: that the aircraft is damaged; that it is grounded; that the fill
    is unknown; that there is no tank; or, for 0 kg, that no fill will do.
    """
    liquid, limit = _liquid(made), least_words(made.advised.advice.limit)
    if made.advised.advice.faults or made.clearance.level is FlightLevel.DAMAGED:
        return f"{say(UNSOUND)}."
    if made.grounded:
        return say("No fill before it is known why, and looked at.")
    if made.level is FlightLevel.UNKNOWN or not math.isfinite(made.largest_fill_kg):
        return say("Largest fill unknown.")
    if not _has_tank(made):
        return f"{say('Nothing to fill: {why}', why=say('it has no tank'))}."
    if made.largest_fill_kg <= 0.0:
        words = "No fill{day} leaves {limit} thrust and survives a lost rotor all along."
        return say(words, day=with_day(made.day), limit=limit)
    words = "Fill at most {fill}{day}: leaves {limit} thrust and survives a lost rotor all along."
    fill = amount(made.largest_fill_kg, liquid)
    return say(words, fill=fill, day=with_day(made.day), limit=limit)


def survivable_words(made: PlanForecast) -> str:
    """Return the sentence on the tank level below which losing a rotor is survivable, and when in
    the plan that is reached.

    Other sentences: unknown; never, even with an empty tank; throughout; not reached in this plan.
    """
    below = made.survivable_below_kg
    if made.level is FlightLevel.UNKNOWN or not math.isfinite(below):
        return say("Whether a lost rotor is survivable is unknown.")
    if below <= 0.0:
        return say("A lost rotor is never survivable, not even with an empty tank.")
    track = made.flight.track
    after = track.time_s[track.tank_kg > below + 1e-9]
    if not after.size:
        return say("A lost rotor is survivable all along, spinning.")
    words = say(
        "With this fill a lost rotor is survivable from {amount} down, spinning",
        amount=amount(below, _liquid(made)),
    )
    if track.tank_kg[-1] > below:
        return f"{words}: {say('the plan never gets there')}."
    return f"{words}: {say('after {long}', long=duration(float(after[-1])))}."


def sortie_words(made: PlanForecast) -> tuple[str, ...]:
    """Return lines on flight time, liquid, energy, and the whole field with its refills.

    For several sorties each has a line. Without a tank there is one line, on time and energy.
    """
    sorties, liquid = made.needs.sorties, _liquid(made)
    sprayed = sum(s.kg for s in sorties)
    energy = joined(within(*made.energy_wh, "Wh"))
    last = _fill(made) - (sorties[-1].kg if sorties else 0.0)
    flown = {"long": duration(made.flight_s), "energy": energy}
    if not _has_tank(made):
        return (say("Flight {long}, {energy}.", **flown),)
    found = [
        say(
            "Flight {long}, sprays {kg}, {energy}, lands with {left}.",
            kg=number(sprayed, "kg"),
            left=amount(max(last, 0.0), liquid),
            **flown,
        )
    ]
    if sprayed > 0.0 and not made.needs.short_of:
        found.append(_field_words(made, sprayed / liquid))
    if made.needs.short_of:
        short = made.needs.short_of
        if short == "battery" and made.expected_needs.short_of != "battery":
            short = "unsure"
        found.append(f"{say('No split is possible')}: {say(_SHORT[short])}.")
    elif len(sorties) > 1:
        places = [str(s.last_item) for s in sorties[:-1]]
        more = say(" and {count} more", count=len(places) - 8) if len(places) > 8 else ""
        found.append(
            say(
                "{count} sorties, each with a full tank and a fresh battery: refill after item "
                "{items}.",
                count=len(sorties),
                items=f"{', '.join(places[:8])}{more}",
            )
        )
        found += _cut([_sortie(k, s, liquid, made.swath) for k, s in enumerate(sorties, start=1)])
    return tuple(found)


def _field_words(made: PlanForecast, litres: float) -> str:
    """Return the line on the whole field: liquid, area, and number of sorties.

    `litres` is the liquid needed. The number with the largest fill is added if it differs from that
    with the planned fill.
    """
    sorties, liquid = made.needs.sorties, _liquid(made)
    with_area = math.isfinite(made.swath)
    field = f" ({area(sum(s.lines for s in sorties) * made.swath)})" if with_area else ""
    known = {"litres": number(litres, "L"), "field": field}
    if len(sorties) == 1:
        words = say("The field takes {litres}{field}: one sortie, no refill.", **known)
    else:
        words = say(
            "The field takes {litres}{field}: {count} sorties with {fill}, {refills} to refill.",
            count=len(sorties),
            fill=amount(_fill(made), liquid),
            refills=_times(len(sorties) - 1),
            **known,
        )
    most = made.sorties_at_largest
    if not most or most == len(sorties):
        return words
    fill = amount(made.largest_fill_kg, liquid)
    more = "{count} with the largest fill, {fill}." if most > 1 else "One with the largest, {fill}."
    return f"{words} {say(more, count=most, fill=fill)}"


def _times(count: int) -> str:
    return say("once") if count == 1 else say("{count} times", count=count)


def _sortie(which: int, one: Sortie, liquid: float, swath: float) -> str:
    """Return ` sortie 2: items 10 to 17, 4.1 L, 0.42 ha, 3 min 10 s, 120 Wh`, indented.

    `which` is the sortie's number, from 1; `liquid` is the liquid's density, kg/L; `swath` is in m,
    and NaN leaves the area out.
    """
    field = f"{area(one.lines * swath)}, " if math.isfinite(swath) else ""
    items = say(
        "  sortie {which}: items {first} to {last}",
        which=which,
        first=one.first_item,
        last=one.last_item,
    )
    long, energy = duration(one.seconds), number(one.energy_wh, "Wh", 0)
    return f"{items}, {number(one.kg / liquid, 'L')}, {field}{long}, {energy}"


def power_words(made: PlanForecast) -> tuple[str, ...]:
    """Return a line on the voltage at landing, and on the flights that measured the power.

    A part is left out if it is unknown; empty without both.
    """
    volts, law = made.landing_voltage, made.advised.analysis.model.power
    parts = []
    if math.isfinite(volts[2]):
        parts.append(say("Lands at {volts}", volts=landing_volts(volts)))
    if law is not None:
        flights, reach = (
            len(law.flights),
            number(100.0 * (power_factors(law.error)[1] - 1.0), "%", 0),
        )
        one = "power as measured on one flight of this aircraft, ± {reach}"
        several = "power as measured on {flights} flights of this aircraft, ± {reach}"
        parts.append(say(one if flights == 1 else several, flights=flights, reach=reach))
    text = "; ".join(parts)
    return (f"{text[:1].upper()}{text[1:]}.",) if text else ()


def as_flown_words(made: PlanForecast) -> tuple[str, ...]:
    """Return a line with flight time and least thrust left, corrected by earlier missions'
    deviations.

    The deviations are those of flown missions from their forecasts. Empty without any.
    """
    known = made.as_flown
    if known is None:
        return ()
    peak, least, most = known.peak
    return (
        say(
            "By how {missions} earlier missions differed from their forecasts: {long} ({low} to "
            "{high}), thrust left {peak} at least.",
            missions=known.missions,
            long=duration(known.seconds[0]),
            low=duration(known.seconds[1]),
            high=duration(known.seconds[2]),
            peak=left_words(1.0 - peak, 1.0 - most, 1.0 - least),
        ),
    )


def landing_volts(ends: tuple[float, float, float]) -> str:
    """Return the voltage at landing with its interval as text.

    `ends` are the expected voltage and the interval's low and high end, V. A NaN as low end means
    that the battery may be used up before.
    """
    middle, low, high = ends
    if math.isfinite(low):
        return joined(within(middle, low, high, "V"))
    return say(
        "{volts} (to {high}, and it may be used up before)",
        volts=number(middle, "V"),
        high=number(high, "V"),
    )


def way_back_words(made: PlanForecast) -> str:
    """Return the sentence on the point of no return, after which the battery does not last to home.

    It is the earliest one within the uncertainty, with the expected one in brackets. If home is
    always within reach, the sentence has the smallest reserve of energy instead.
    """
    back = made.way_back
    if not math.isfinite(back.spare_wh):
        return say("Point of no return unknown: give --capacity.")
    known = {
        "kept": percent(back.charge_kept),
        "item": back.item,
        "away": number(back.distance, "m", 0),
    }
    if math.isfinite(back.time_s):
        expected = say("home stays in reach")
        if math.isfinite(back.expected_time_s):
            expected = say("after {long}", long=duration(back.expected_time_s))
        return say(
            "Point of no return after {long} at the earliest (expected: {expected}), on the way to "
            "item {item}, {away} from home, with {kept} of the battery kept.",
            long=duration(back.time_s),
            expected=expected,
            **known,
        )
    return say(
        "Home is in reach all along, with {kept} of the battery kept: at least {spare} to spare "
        "(expected: {expected}), on the way to item {item}, {away} from home.",
        spare=number(back.spare_wh, "Wh", 0),
        expected=number(back.expected_spare_wh, "Wh", 0),
        **known,
    )


def plan_faults(made: PlanForecast) -> tuple[str, ...]:
    """Return the lines about faults of the plan and about items that are not understood."""
    faults = [fault_words(f.fault, f.items, f.height) for f in made.findings]
    wrong = [f"{say('Plan')}: {words}{'' if words.endswith('?') else '.'}" for words in faults]
    unknown = [f"{say('Not reckoned')}: {not_understood_words(n)}." for n in made.not_understood]
    return (*_cut(wrong), *_cut(unknown))


def assumed_words(made: PlanForecast) -> tuple[str, ...]:
    """Return the lines about values that were assumed because they are unknown.

    The first names the known aircraft and its last flight, after which nothing is known of it.
    """
    known = made.clearance.known_from
    return (
        *filter(None, ["" if known is None else last_known_words(known)]),
        *map(say, made.plan.notes),
        day_line(made.day),
        *(_assumed(key, values) for key, values in made.assumed.items()),
        say(LEFT_OUT),
    )


def _only_if(made: PlanForecast) -> str:
    """Return the conditions under which it may take off, in capitals; empty without one."""
    craft = made.assumed.get("aircraft")
    parts = [say("THE AIRCRAFT IS {name}", name=craft[0])] if craft else []
    parts += filter(None, [conditions_words(made.clearance)])
    return f" {say('AND')} ".join(parts)


def _as_far(made: PlanForecast) -> str:
    """Return what the verdict leaves out, in capitals, to be appended to it; empty if nothing."""
    parts = []
    if made.wind_left_out and made.turns_left_out:
        parts.append(say(", LEAVING OUT WIND AND TURNS, WHICH TAKE MORE THRUST"))
    elif made.wind_left_out:
        parts.append(say(", LEAVING OUT THE WIND, WHOSE DRAG IS NOT KNOWN"))
    elif made.turns_left_out:
        parts.append(say(", LEAVING OUT TURNS, WHICH TAKE MORE THRUST"))
    if made.not_understood:
        parts.append(say(", AS FAR AS THE PLAN IS UNDERSTOOD"))
    if "first part" in made.assumed:
        parts.append(say(", AS {minutes} MIN OF IT SHOW", minutes=made.assumed["first part"][0]))
    return "".join(parts)


def _assumed(key: str, values: Sequence[str]) -> str:
    """Return the line of one assumption with its values."""
    listed = values if ASSUMED[key].count("{") > 1 else [", ".join(values)]
    return say(ASSUMED[key], *listed)


def _cut(lines: Sequence[str], most: int = 6) -> list[str]:
    """Return at most `most` lines, and one with the number of the others."""
    rest = len(lines) - most
    return [
        *lines[:most],
        *([say("... and {count} more of these.", count=rest)] if rest > 0 else []),
    ]


def _has_tank(made: PlanForecast) -> bool:
    """Return True if the aircraft has a tank."""
    return made.advised.analysis.model.airframe.tank_volume_l > 0.0


def _fill(made: PlanForecast) -> float:
    """Return the tank level at take-off, kg."""
    return float(made.flight.track.tank_kg[0])


def _liquid(made: PlanForecast) -> float:
    """Return the liquid's density, kg/L."""
    return made.advised.analysis.model.airframe.liquid_density


def gate_limit(limit: float) -> str:
    """Return the condition that the vehicle's fill gate checks."""
    left = least_words(limit)
    return f"{left} of a rotor's maximum thrust left, and the weight held with one rotor lost"


def gate_sag(resistance: float) -> str:
    """Return the remark on the battery resistance, ohm, that the script's table is based on."""
    return f", by {number(1e3 * resistance, 'mOhm', 0)} of the pack"
