"""Write the answer of a flight in words: first line, reason, action, and further facts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np

from thrustmargin.gcs_plugin.wording import actions, alarm_words
from thrustmargin.gcs_plugin.wording.actions import OF_CAVEAT, Phase, Trouble
from thrustmargin.gcs_plugin.wording.arm_words import arm_sentences
from thrustmargin.gcs_plugin.wording.fill_words import fill_advice, how_sure
from thrustmargin.gcs_plugin.wording.language import (
    clock,
    duration,
    number,
    percent,
    say,
)
from thrustmargin.gcs_plugin.wording.thrust_left import least_words, left_words
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.fault_test import LEAST, MOST, RotorFault
from thrustmargin.models.model.fill_limits import FillLevel
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_faults import FaultEpisode

#: Level -> its name when flights are counted; {limit} is the thrust that must be left, as "50 %".
SEVERAL: Mapping[FlightLevel, str] = {
    FlightLevel.DAMAGED: "A BAD ROTOR OR MOTOR",
    FlightLevel.LOST: "LOST CONTROL",
    FlightLevel.BATTERY: "A COLLAPSED BATTERY",
    FlightLevel.NO_THRUST: "NO THRUST LEFT AT TIMES",
    FlightLevel.CRITICAL: "TOO HEAVY TO LOSE A ROTOR",
    FlightLevel.OVER: "THRUST LEFT BELOW THE {limit} LIMIT",
    FlightLevel.ORDER: "MOTORS IN ANOTHER ORDER",
    FlightLevel.NEAR: "THRUST LEFT NEAR THE {limit} LIMIT: CANNOT TELL",
    FlightLevel.UNDER: "THRUST LEFT ABOVE THE {limit} LIMIT",
    FlightLevel.UNKNOWN: "NO VERDICT",
}
#: Levels in which a flight that goes on should end.
LAND_FIRST = (FlightLevel.DAMAGED, FlightLevel.LOST, FlightLevel.BATTERY, FlightLevel.NO_THRUST)
#: Behind the first line of a flight of which the log has only a part: whether it flew already where
#: the log begins, and still where it ends; and of one with a pause.
_UNSEEN = {
    (True, True): " (LOG BEGINS AND ENDS IN FLIGHT)",
    (True, False): " (LOG BEGINS IN FLIGHT)",
    (False, True): " (LOG ENDS IN FLIGHT)",
}
_PAUSED = " (NOTHING IN THE LOG FOR {long} OF IT)"
#: What a good verdict is not based on -> the note behind it, for the first line is read alone.
_NOTES: Mapping[Caveat, str] = {
    Caveat.GAUGE: "TANK GAUGE LEFT OUT",
    Caveat.VOLTAGE: "VOLTMETER LEFT OUT",
    Caveat.ROTOR_SPEEDS: "ROTOR SPEED SENSORS TO CHECK",
    Caveat.BAROMETER: "BAROMETER LEFT OUT",
    Caveat.ROTORS_NOT_SOUGHT: "WEAK ROTORS NOT LOOKED FOR",
    Caveat.ROTORS_BY_OUTPUTS: "ROTORS LOOKED AT BY OUTPUTS ALONE",
    Caveat.ROTORS_UNLEARNT: "A WORN ROTOR WOULD NOT HAVE SHOWN",
}
PREDICTED_ALONE = (
    "predicted: for most of the flight no rotor speed was measured, nor made from motor outputs"
)
NOT_SOUGHT = (
    "not looked for in {long}: that takes the speed of every rotor, the airspeed and the load"
)
BY_OUTPUTS = (
    "by motor outputs alone in {long}: a sudden change is found, a rotor weak from the start is not"
)

UNLEARNT = (
    "no flight has shown how its sound rotors turn: a change in flight is found, a rotor weak from "
    "the start is not"
)

PEAK_S = 1.5  # s from reading to reading, from which the peak of a turn can lie between two
_PEAKS = "readings come every {seconds} s: peaks between them are not seen"


def headline(advice: Advice) -> str:
    """Return a flight's headline in capitals: its gravest level, with the caveats in brackets.

    A wrong motor order, and parts of the flight that the log lacks, are added.
    """
    first = [level for level in (FlightLevel.DAMAGED, FlightLevel.LOST) if level in advice.levels]
    which = [FlightLevel.ORDER] if FlightLevel.ORDER in advice.levels[1:] else []
    words = "; ".join(_first_line(advice, one) for one in (*(first or advice.levels[:1]), *which))
    words += open_notes(advice)
    if advice.complete or FlightLevel.LOST in first or advice.level is FlightLevel.UNKNOWN:
        return words
    if unseen := _UNSEEN.get((advice.begun_before, advice.ends_in_flight)):
        return f"{words}{say(unseen)}"
    return f"{words}{say(_PAUSED, long=duration(advice.paused_s).upper())}"


def open_notes(advice: Advice) -> str:
    """Return the caveats of a good verdict in capitals, in brackets; empty for another verdict.

    Empty while in flight too, where alarms report them.
    """
    if advice.in_progress or advice.level not in (FlightLevel.UNDER, FlightLevel.NEAR):
        return ""
    # A speed whose error motor outputs show is corrected, and its ESC is named below.
    corrected = advice.misread is not None and advice.misread.witnessed
    settled = (Caveat.ROTOR_SPEEDS,) if corrected else ()
    notes = [say(_NOTES[one]) for one in advice.caveats if one in _NOTES and one not in settled]
    return f" ({', '.join(notes)})" if notes else ""


def _first_line(advice: Advice, level: FlightLevel) -> str:
    """Return the headline for one warning level of a flight, mostly in capitals: `NO VERDICT`.

    Amounts in it are of that level: a duration, a time or a voltage. A limit not exceeded is
    restricted to the time with data, if the log ends in flight.
    """
    use, limit = advice.use, least_words(advice.limit)
    if level is FlightLevel.DAMAGED:
        return damage_words(advice)
    if level is FlightLevel.LOST:
        return say("LOST CONTROL AT {clock}", clock=clock(advice.losses[0].time_s))
    if level is FlightLevel.BATTERY:
        least = number(advice.battery.least_cell, "V", 2)
        words = "BATTERY COLLAPSED: {volts} A CELL AT {clock}"
        if advice.battery.at_most:
            words = "BATTERY COLLAPSED: AT MOST {volts} A CELL AT {clock}"
        return say(words, volts=least, clock=clock(advice.battery.at_s))
    if level is FlightLevel.NO_THRUST:
        words, rotor = "NO THRUST LEFT FOR {long}", _spent_alone(advice)
        if rotor:
            words = "ROTOR {rotor} ALONE HAD NO THRUST LEFT FOR {long}"
        return say(words, rotor=rotor, long=duration(use.spent_s).upper())
    if level is FlightLevel.CRITICAL:
        first = say("TOO HEAVY" if advice.fill.nothing_fits else "FILL LESS")
        if _load_known_in_part(advice):
            words = (
                "{first}: FOR {long} OF {known} WITH A KNOWN LOAD "
                "A FAILED ROTOR WOULD HAVE BROUGHT IT DOWN"
            )
            long, known = (
                duration(seconds).upper()
                for seconds in (advice.rotor_lost.not_survivable_s, advice.rotor_lost.known_s)
            )
            return say(words, first=first, long=long, known=known)
        if advice.rotor_lost.not_survivable_s >= advice.airborne_s - 1.0:
            words = "{first}: ALL FLIGHT A FAILED ROTOR WOULD HAVE BROUGHT IT DOWN"
            return say(words, first=first)
        too_long = duration(advice.rotor_lost.not_survivable_s).upper()
        words = "{first}: FOR {long} A FAILED ROTOR WOULD HAVE BROUGHT IT DOWN"
        return say(words, first=first, long=too_long)
    if level is FlightLevel.OVER:
        if use.lasting_above_limit_s >= use.known_s - 1.0:
            return say("THRUST LEFT BELOW THE {limit} LIMIT ALL FLIGHT", limit=limit)
        long = duration(use.lasting_above_limit_s).upper()
        return say("THRUST LEFT BELOW THE {limit} LIMIT FOR {long}", limit=limit, long=long)
    if level is FlightLevel.ORDER:
        return say("MOTOR ORDER DIFFERS: ROTOR NAMES ARE WRONG")
    if level is FlightLevel.UNKNOWN and Caveat.MODEL in advice.caveats:
        return say("CANNOT TELL: ROTOR SPEEDS AND MODEL CONTRADICT EACH OTHER")
    if level is FlightLevel.UNKNOWN:
        return say("NO VERDICT")
    words = say(SEVERAL[level], limit=limit) + _known_in_part(advice)
    if advice.ends_in_flight and level is FlightLevel.UNDER:
        # Parts without data may have been above the limit.
        return say("{words} UP TO {clock}", words=words, clock=clock(advice.unseen_from_s))
    return words


def _known_in_part(advice: Advice) -> str:
    """Return in brackets and capitals for how much of the flight load and thrust are known, or that
    the load is not known.

    Empty if they are known for nearly the whole flight. An unknown load is not mentioned if the
    flight shows a fault, which is the reason.
    """
    if not math.isfinite(advice.rotor_lost.redundancy_min):
        return "" if advice.faults else say(" (LOAD NOT KNOWN)")
    known_s, whole_s = min(advice.use.known_s, advice.rotor_lost.known_s), advice.airborne_s
    if known_s >= 0.95 * whole_s - 1.0:
        return ""
    known, whole = (duration(seconds).upper() for seconds in (known_s, whole_s))
    return say(" (KNOWN FOR {known} OF {all})", known=known, all=whole)


def damage_words(advice: Advice) -> str:
    """Return the bad rotors and motors in capitals, with the amount of each."""
    lines = dict.fromkeys(_fault_line(advice, episode.fault) for episode in advice.faults)
    return f" {say('AND')} ".join(lines)


def _fault_line(advice: Advice, fault: RotorFault) -> str:
    """Return a bad rotor or motor in capitals, with its loss: `ROTOR 3, FRONT LEFT: 12 % LESS
    THRUST`.

    No loss for a rotor that stopped, or if it is not known which rotor is bad. An error of the ESC
    that would explain the loss is named if motor outputs do not confirm it.
    """
    part, does = {
        "propeller": ("ROTOR", "LESS THRUST"),
        "motor": ("MOTOR", "SLOW FOR ITS OUTPUT"),
        "stopped": ("ROTOR", "STOOD STILL IN FLIGHT"),
    }[fault.kind]
    if fault.rotors or not advice.rotor_names:
        which = f" {say('OR')} ".join(str(rotor + 1) for rotor in fault.rotors) or "?"
        if not advice.rotor_names:
            return f"{say(f'A {part}')}: {say(does)}"
        return f"{part} {which}: {say(does)}"
    place = (
        f", {alarm_words.place_words(advice.places[fault.rotor]).upper()}" if advice.places else ""
    )
    amount = "" if fault.kind == "stopped" else f"{alarm_words.fault_amount(fault).upper()} "
    words = f"{part} {fault.rotor + 1}{place}: {amount}{say(does)}"
    if fault.witnessed or fault.upper >= MOST:
        return words
    # Thrust follows the square of speed: the error of the ESC that would explain the loss.
    high = percent((1.0 - fault.size) ** -0.5 - 1.0)
    return say("{words}, OR ITS ESC READS {share} HIGH", words=words, share=high)


def several_headline(levels: Sequence[FlightLevel], limit: float) -> tuple[FlightLevel, str]:
    """Return the gravest of the flights' levels, and a line in capitals on how many have it.

    `2 OF 5 FLIGHTS: ...`; `limit` is the largest share of thrust that may be used for long.
    """
    level = min(levels, key=lambda one: one.gravity)
    count = levels.count(level)
    words = (
        "ALL {count} FLIGHTS: {level}"
        if count == len(levels)
        else "{count} OF {all} FLIGHTS: {level}"
    )
    has = say(SEVERAL[level], limit=least_words(limit))
    return level, say(words, count=count, all=len(levels), level=has)


def suspects(advice: Advice) -> tuple[int, ...]:
    """Return the rotors, from 1, that a fault of the flight may be of; empty without a fault.

    Of a fault with several candidates all are returned; with an unknown motor order all rotors of
    the aircraft.
    """
    faults = [episode.fault for episode in advice.faults]
    if faults and not advice.rotor_names:
        return tuple(range(1, advice.rotor_count + 1))
    return tuple(sorted({r + 1 for f in faults for r in (f.rotors or (f.rotor,))}))


def no_ground(advice: Advice) -> str:
    """Return what contradicts a verdict, or why there is none: the margin is only predicted.

    The first is if rotor speeds contradict the model (`Caveat.MODEL`). Empty for all other flights,
    also for those without a verdict for another reason.
    """
    if Caveat.MODEL in advice.caveats:
        return misfit_words(advice)
    alone = advice.level is FlightLevel.UNKNOWN and advice.predicted_alone
    return say(PREDICTED_ALONE) if alone else ""


def misfit_words(advice: Advice) -> str:
    """Return how rotor speeds contradict load, air or turns by the model, and what to check.

    For level flight it has the bias, %, with its direction, if it is noticeable, and the share of
    the time within the model's error; for turns by how much the speeds seem to be misread.
    """
    found, parts = advice.misfit, []
    if found.interval_fails:
        words = (
            "rotor speeds are {size} {than} than load and air need, in level flight, and within "
            "the model's error for {held} of the time, where {promised} are expected"
        )
        if abs(found.bias) < 0.005:
            words = (
                "rotor speeds are within the model's error for {held} of the time, where "
                "{promised} are expected"
            )
        parts.append(
            say(
                words,
                size=percent(abs(np.expm1(found.bias)), 1),
                than=say("higher" if found.bias > 0.0 else "lower"),
                held=percent(found.coverage),
                promised=percent(found.promised),
            )
        )
    if found.speed_scale != 1.0:
        off = percent(abs(found.speed_scale - 1.0))
        low = "by what turning takes, rotor speeds read {off} too low, or its inertia is another"
        high = "by what turning takes, rotor speeds read {off} too high, or its inertia is another"
        parts.append(say(low if found.speed_scale < 1.0 else high, off=off))
    parts.append(say("check load, gauge and ESC telemetry; `identify` says what is missing"))
    return "; ".join(parts)


class ActionKind(StrEnum):
    """Kind of a step of the advice on what to do next."""

    LAND = "land"
    GROUND = "do_not_fly"
    LOOK_AT_ROTORS = "look_at_rotors"
    CHECK_ESC = "check_ESC"
    TEST_BATTERY = "test_battery"
    FIND_MOTORS = "find_motors"
    CHECK_LOAD = "check_load"
    CHECK_GAUGE = "check_gauge"
    CHECK_VOLTMETER = "check_voltmeter"
    CHECK_BAROMETER = "check_barometer"
    INSPECT_ROTORS = "inspect_rotors"
    NO_FILL = "fill_not_known"
    DO_NOT_FILL = "do_not_fill"
    FILL = "fill_at_most"
    FLY_GENTLY = "fly_gently"
    CARRY_LESS = "carry_less"
    NOTHING = "nothing"
    RECORD_WHOLE = "record_whole_flight"
    SEE_END = "see_how_it_ended"
    CHECK_WIND = "check_airspeed_sensor"


def action(advice: Advice) -> str:
    """Return the actions after a flight, joined by "; ", the gravest first; empty if nothing is
    known.

    The fill in it is for this flight's air and battery.
    """
    return "; ".join(words for _, words in action_steps(advice))


def action_steps(advice: Advice) -> list[tuple[ActionKind, str]]:
    """Return (kind, words) of each step to do next, the gravest first, the fill after it.

    In the air, at a level that asks to land, landing leads. No fill is advised before landing or
    after lost control; without a verdict only the open checks are returned. Steps that only permit
    (nothing to do) occur if the flight kept its limits.
    """
    first: list[tuple[ActionKind, str]] = []
    land = advice.in_progress and advice.level in LAND_FIRST
    if land:
        first.append((ActionKind.LAND, actions.LAND.text))
    if FlightLevel.LOST in advice.levels:
        first.append((ActionKind.GROUND, _answer(Trouble.CONTROL).action.text))
    if FlightLevel.DAMAGED in advice.levels:
        first.append((ActionKind.LOOK_AT_ROTORS, _bad_rotors(advice).action.text))
    elif advice.misread is not None:
        first.append((ActionKind.CHECK_ESC, actions.check_esc(advice.misread.rotor + 1).text))
    elif FlightLevel.NO_THRUST in advice.levels and (rotor := _spent_alone(advice)):
        look = actions.not_before_looked_at((rotor,)).text
        first.append((ActionKind.LOOK_AT_ROTORS, look))
    if FlightLevel.BATTERY in advice.levels:
        first.append((ActionKind.TEST_BATTERY, _answer(Trouble.BATTERY).action.text))
    # No fill is advised before landing.
    if land or FlightLevel.LOST in advice.levels:
        return first
    if advice.level is FlightLevel.UNKNOWN:
        return [*first, *([] if advice.no_verdict else _open_steps(advice))]
    if FlightLevel.DAMAGED not in advice.levels and not advice.rotor_names:
        first.append((ActionKind.FIND_MOTORS, _answer(Trouble.ORDER).action.text))
    within = FlightLevel.UNDER in advice.levels
    load = fill_advice(advice.fill, advice.limit, was_within=within)
    load = load[:1].lower() + load[1:]
    if advice.fill.beyond_gauge_kg > 0.0:
        more = number(advice.fill.beyond_gauge_kg, "kg")
        words = "{action}: thrust shows {more} more than was reported"
        asked = say(words, action=_answer(Trouble.LOAD).action.text, more=more)
        first.append((ActionKind.CHECK_LOAD, asked))
    if FlightLevel.DAMAGED in advice.levels:
        return [*first, (_fill_kind(advice), load)]
    first += _open_steps(advice)
    then: list[tuple[ActionKind, str]] = []
    # If the fill cannot be reduced, only gentle flying helps.
    hard = {FlightLevel.OVER, FlightLevel.NEAR} if advice.fill.nothing_fits is not None else set()
    if not _spent_alone(advice):
        hard.add(FlightLevel.NO_THRUST)
    if not hard.isdisjoint(advice.levels):
        then.append((ActionKind.FLY_GENTLY, actions.FLY_GENTLY.text))
    if advice.fill.nothing_fits == "tank" and advice.fill.start_kg > 0.0 and not within:
        carried = number(advice.fill.start_kg, "kg")
        less = say("carry less than the {kg} of this flight", kg=carried)
        then.append((ActionKind.CARRY_LESS, less))
    if not first:
        kind, done = ActionKind.NOTHING, say("nothing")
        if advice.fill.kg <= 0.0 and advice.fill.nothing_fits is None:
            # It did fly below the limit with a load, so the wind that contradicts it is checked.
            kind, done = ActionKind.CHECK_WIND, actions.CHECK_WIND.text
        return [*([(kind, done)] if within else []), (_fill_kind(advice), load), *then]
    if advice.fill.level is FillLevel.NO_TANK:
        return [*first, *then]  # that there is no tank is no step
    later = advice.fill.beyond_gauge_kg > 0.0
    load = say("until then {load}" if later else "then {load}", load=load)
    return [*first, (_fill_kind(advice), load), *then]


#: What a flight leaves open -> the kind of step that it asks for. The load has words of its own.
_OPEN: Mapping[Caveat, ActionKind] = {
    Caveat.GAUGE: ActionKind.CHECK_GAUGE,
    Caveat.VOLTAGE: ActionKind.CHECK_VOLTMETER,
    Caveat.ROTOR_SPEEDS: ActionKind.CHECK_ESC,
    Caveat.BAROMETER: ActionKind.CHECK_BAROMETER,
    Caveat.ROTORS_NOT_SOUGHT: ActionKind.INSPECT_ROTORS,
    Caveat.ROTORS_BY_OUTPUTS: ActionKind.INSPECT_ROTORS,
    Caveat.ROTORS_UNLEARNT: ActionKind.INSPECT_ROTORS,
}


def _open_steps(advice: Advice) -> list[tuple[ActionKind, str]]:
    """Return (kind, words) of the step that settles a caveat, for each caveat with one; empty while
    in flight.

    A part not in the log asks to see how the flight ended, or to record whole flights.
    """
    if advice.in_progress:
        return []
    steps = []
    for caveat in advice.caveats:
        if caveat is Caveat.UNSEEN:
            # A log that ends in the air lacks what matters most for the next flight.
            ended = advice.ends_in_flight
            kind = ActionKind.SEE_END if ended else ActionKind.RECORD_WHOLE
            steps.append((kind, (actions.SEE_END if ended else actions.RECORD_WHOLE).text))
        elif caveat in _OPEN and not (caveat is Caveat.ROTOR_SPEEDS and advice.misread):
            steps.append((_OPEN[caveat], _answer(OF_CAVEAT[caveat]).action.text))
    return steps


def _answer(trouble: Trouble) -> actions.TroubleAnswer:
    """Return what a finding asks for after the flight: action, urgency and proof of a repair."""
    return actions.answer_to(trouble, Phase.LANDED)


def _fill_kind(advice: Advice) -> ActionKind:
    """Return the kind of step that the fill is: unknown fill, do not fill, or fill."""
    fill = advice.fill
    if fill.reason == "unsound" or not math.isfinite(fill.kg):
        return ActionKind.NO_FILL
    empty = fill.nothing_fits is not None or fill.kg <= 0.0
    return ActionKind.DO_NOT_FILL if empty else ActionKind.FILL


def _bad_rotors(advice: Advice) -> actions.TroubleAnswer:
    """Return the response to the bad rotors of a flight after it."""
    low = max((episode.fault.lower for episode in advice.faults), default=0.0)
    return actions.bad_rotor(suspects(advice), max(low, LEAST), actions.Phase.RECORDED)


def facts(advice: Advice) -> tuple[tuple[str, str], ...]:
    """Return (label, text) lines below a flight's headline.

    They are faults and their proof of repair, model, ESCs, arms, thrust left, battery (only if it
    collapsed), and how sure the fill is, each only if there is something to report. What the loss
    of one rotor would have meant is always there.
    """
    use = advice.use
    found = [("alarm", fault_found(advice, episode)) for episode in advice.faults]
    if advice.faults and not advice.in_progress:
        found.append(("after the repair", _bad_rotors(advice).proof.text))
    found += [("model", sound_again(fault)) for fault in advice.repaired]
    if advice.misread is not None:
        found.append(("ESC", misread_words(advice.misread)))
    found += [("arm", words) for words in arm_sentences(advice.arms)]
    if Caveat.ROTORS_NOT_SOUGHT in advice.caveats:
        found.append(("weak rotors", say(NOT_SOUGHT, long=duration(advice.unsought_s))))
    elif Caveat.ROTORS_BY_OUTPUTS in advice.caveats:
        found.append(("weak rotors", say(BY_OUTPUTS, long=duration(advice.by_outputs_s))))
    elif Caveat.ROTORS_UNLEARNT in advice.caveats:
        found.append(("weak rotors", say(UNLEARNT)))
    if math.isfinite(use.lasting_most):
        found.append(("steady flight", _lasting(advice)))
        seldom = say(_PEAKS, seconds=f"{use.step_s:.2g}") if use.step_s > PEAK_S else ""
        passing = _passing(advice) if use.passing else ""
        if words := "; ".join(filter(None, (passing, seldom))):
            found.append(("turns and gusts", words))
    if math.isfinite(advice.battery.least_cell):
        least = number(advice.battery.least_cell, "V", 2)
        if FlightLevel.BATTERY in advice.levels:
            words = "{volts} a cell at {clock}"
            found.append(("battery", say(words, volts=least, clock=clock(advice.battery.at_s))))
    found.append((alarm_words.ONE_LOST, one_rotor_out(advice)))
    if sure := how_sure(advice.fill):
        found.append(("fill, how sure", sure))
    return tuple(found)


def misread_words(misread: MisreadSpeed) -> str:
    """Return a clause on a rotor whose ESC reports `factor` times the true speed, to follow "ESC:
    ".

    If `witnessed`, the motor output is normal, so the report is wrong, and thrust is computed from
    the corrected speed. Else the ESC reads low, or the propeller is of another kind.
    """
    if not misread.witnessed:
        return say(
            "that of rotor {rotor} reads {factor} times the speed that its thrust takes: it reads "
            "low, or its propeller is of another kind",
            rotor=misread.rotor + 1,
            factor=number(misread.factor, "", 2),
        )
    return say(
        "that of rotor {rotor} reads {factor} times the speed of its rotor, whose motor output is "
        "that of a sound one; its thrust is taken as of the true speed",
        rotor=misread.rotor + 1,
        factor=number(misread.factor, "", 2),
    )


def _lasting(advice: Advice) -> str:
    """Return a phrase on the least thrust left in steady flight, and how long it was below the
    limit.
    """
    use, limit = advice.use, least_words(advice.limit)
    worst = left_words(1.0 - use.lasting_most, 1.0 - use.lasting_high, 1.0 - use.lasting_low)
    never = use.lasting_above_limit_s <= 0.0
    unsure = use.maybe_above.any() if never else not use.surely_above.any()
    near = say("; the limit lies within the error") if unsure else ""
    words = "thrust left down to {worst}, below {limit} for {long} of {all}"
    if never:
        words = "thrust left down to {worst}, never below {limit}"
    long, whole = duration(use.lasting_above_limit_s), duration(use.known_s)
    return say(words, worst=worst, limit=limit, long=long, all=whole) + near


def _passing(advice: Advice) -> str:
    """Return a phrase on thrust left in turns and gusts: the least, how often and how long below
    the limit.
    """
    use = advice.use
    times = say("once") if use.passing == 1 else say("{count} times", count=use.passing)
    return say(
        "thrust left down to {peak}, below {limit} {times} for {long} at most",
        peak=left_words(1.0 - use.peak),
        limit=least_words(advice.limit),
        times=times,
        long=duration(max(use.passing_longest_s, 1.0)),
    )


def one_rotor_out(advice: Advice) -> str:
    """Return whether the other rotors would have carried the aircraft if one rotor had been lost.

    If not, for how long; that it cannot be decided if the interval includes 1; for which time, if
    the load is known for a part only. Unknown without a tank level; with a fault it says what the
    loss of one more would mean.
    """
    lost = advice.rotor_lost
    if not math.isfinite(lost.redundancy_min) and advice.faults:
        return say(alarm_words.ONE_MORE_LOST)
    if not math.isfinite(lost.redundancy_min):
        return say("not known, because the tank level is unknown")
    held = number(lost.redundancy_min, "×", 2)
    if lost.redundancy_min_low < 1.0 <= lost.redundancy_min_high:
        low, high = number(lost.redundancy_min_low, "", 2), number(lost.redundancy_min_high, "", 2)
        held += f", {low} to {high}"
        words = "cannot tell whether the others would have carried it ({held}; 1 just carries it)"
        return say(words, held=held)
    part, whole = _load_known_in_part(advice), duration(advice.airborne_s)
    known = say("; of {all} the load is unknown for the rest", all=whole) if part else ""
    if lost.not_survivable_s > 0.0:
        long, of = duration(lost.not_survivable_s), duration(lost.known_s) if part else whole
        words = (
            "would have brought it down for {long} of {all} "
            "(at worst the others carry {held} its weight)"
        )
        return say(words, long=long, all=of, held=held) + known
    words = "the others could have carried it all flight, {spins} (at least {held} its weight)"
    if part:
        words = "the others could have carried it for {long}, {spins} (at least {held} its weight)"
    elif not advice.complete:
        words = (
            "the others could have carried it as long as the log goes, {spins} "
            "(at least {held} its weight)"
        )
    return say(words, long=duration(lost.known_s), spins=say(alarm_words.SPINS), held=held) + known


def _spent_alone(advice: Advice) -> int:
    """Return the only rotor (1-based) that had no thrust left; 0 if none, several or the motor
    order unknown."""
    alone = advice.use.spent_alone
    return 0 if alone is None or not advice.rotor_names else alone + 1


def _load_known_in_part(advice: Advice) -> bool:
    """Return True if the load is known for less than about 95 % of the flight."""
    return advice.rotor_lost.known_s < 0.95 * advice.airborne_s - 1.0


def sound_again(fault: RotorFault) -> str:
    """Return the sentence that a rotor is sound again, although its loss is still in the model."""
    return say(
        "rotor {rotor} is sound again, and the model still holds its loss of {amount}: use the "
        "model from before it, or train anew",
        rotor=fault.rotor + 1,
        amount=alarm_words.fault_amount(fault),
    )


def fault_found(advice: Advice, episode: FaultEpisode) -> str:
    """Return a fault in words, with the times when it was found and ended.

    A note is added if the motor order is unknown.
    """
    unsure = "" if advice.rotor_names else f": {say(alarm_words.WHICH_ROTOR)}"
    return f"{alarm_words.episode_words(episode, advice.places)}{unsure}"
