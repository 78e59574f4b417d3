"""The verdict of a flight in words: its facts, its worst peaks of utilisation and what to do.

A fact is a pair (label, sentence). What the report says first, and the replay with it.
"""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.gcs_plugin.wording import language
from thrustmargin.gcs_plugin.wording.advice_words import action, facts, fault_found, no_ground
from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.check_words import (
    grounds_words,
    no_verdict_words,
    remedy_words,
    source_words,
)
from thrustmargin.gcs_plugin.wording.flight_words import doing_words
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import Advice, FlightLevel, pauses_in_flight
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.speed_basis import SpeedBasis
from thrustmargin.models.model.utilisation_peaks import UtilisationPeak
from thrustmargin.models.provenance import Meaning, SourceKind
from thrustmargin.models.scores import Estimate

#: Sentences, each with the label that it is found by.
Facts = tuple[tuple[str, str], ...]


def verdict_facts(
    worst: UtilisationPeak | None,
    advice: Advice,
    airframe_match: AirframeMatch,
    basis: str,
    not_flown: str = "",
) -> Facts:
    """Return the (label, text) lines below a report's first line: action, faults, worst peak,
    basis.

    `worst` is the worst utilisation peak, None if none is known. `basis` describes the source of
    the utilisation. `not_flown` is why the log has no flight; empty if it has one. Without a flight
    or a verdict the lines state the reason and the remedy.
    """
    airframe = ("airframe", grounds_words(airframe_match))
    found = tuple(("alarm", fault_found(advice, one)) for one in advice.faults)
    if FlightLevel.LOST in advice.levels:
        # What was left before it went wrong explains nothing, and advises no fill.
        until = () if worst is None else (("worst before it", peak_words(worst)),)
        return (*_to_do(advice), *found, *until, ("from", basis), airframe)
    if not_flown:
        return (("why", not_flown), airframe)
    if airframe_match.no_verdict:
        why = (("why", reason) for reason in no_verdict_words(airframe_match))
        of = (
            () if airframe_match.basis == "not known" else (airframe,)
        )  # the reason says that already
        return (*_to_do(advice), *found, *why, ("what helps", remedy_words(airframe_match)), *of)
    if worst is None:
        why = "neither rotor speeds nor what a prediction needs is in this log"
        return (("why", say(why)), airframe)
    return (
        *((("why", why),) if (why := no_ground(advice)) else ()),
        *_to_do(advice),
        *facts(advice),
        ("worst", peak_words(worst)),
        *_beyond(worst),
        ("from", basis),
        airframe,
    )


def _to_do(advice: Advice) -> Facts:
    return (("what to do", do),) if (do := action(advice)) else ()


def _beyond(worst: UtilisationPeak) -> Facts:
    """Return a (label, text) line if a rotor made more thrust than its airframe allows; else empty.

    That is so if the low end of its utilisation's interval is above 1. The text lists what to
    check; motor poles only if rotor speeds are measured, because outputs do not depend on them.
    """
    if not worst.utilisation_low > 1.0:  # one reading of sensors that scatter shows nothing
        return ()
    more = language.percent(worst.utilisation - 1.0)
    words = (
        "rotor {rotor} shows {more} more thrust than the airframe says it can make: check the "
        "battery voltage, max_rotor_speed_rpm and motor_poles (eRPM)"
    )
    if worst.basis == SpeedBasis.MOTOR_OUTPUTS:
        words = (
            "rotor {rotor} shows {more} more thrust than the airframe says it can make: check "
            "the battery voltage and max_rotor_speed_rpm"
        )
    return (("beyond the ceiling", say(words, rotor=worst.rotor + 1, more=more)),)


def load_facts(track: FlightTrack) -> Facts:
    """Return a (label, text) line on the load in the tank, kg at start and end, and its source.

    Empty if a gauge reports the load, or if no load is known.
    """
    source = track.source("tank_kg")
    known = track.tank_kg[track.flying & np.isfinite(track.tank_kg)]
    reported = source.kind is not SourceKind.STATED and source.meaning is not Meaning.HOVER_THRUST
    if not known.size or reported:
        return ()
    start, end = language.number(float(known[0]), "", 1), language.number(float(known[-1]), "kg", 1)
    falls = not end.startswith(f"{start} ")
    load = f"{start} {say('to')} {end}" if falls else end
    return (("load", f"{load}, {source_words(source)}"),)


def voltage_facts(analysis: FlightAnalysis) -> Facts:
    """Return a (label, text) line if the battery voltage is unknown for over 5 % of the flight
    time.

    It states for how long, and the nominal voltage used instead. Else empty; empty too without a
    verdict.
    """
    track, craft = analysis.track, analysis.model.airframe
    unknown_s = float(track.row_seconds[track.flying & ~(track.voltage > 0.0)].sum())
    if analysis.no_verdict or unknown_s <= 0.05 * track.flying_s:
        return ()
    words = "not known for {long} of {all}: the most thrust is taken at {volts}"
    long, whole = language.duration(unknown_s), language.duration(track.flying_s)
    volts = language.number(craft.nominal_voltage, "V")
    return (("battery voltage", say(words, long=long, all=whole, volts=volts)),)


def unseen_facts(track: FlightTrack) -> Facts:
    """Return a (label, text) line on the parts of the flight that the log lacks; empty if none.

    They are the start of a log that begins in flight, pauses, and the end of one that ends in
    flight.
    """
    words = [say("begins in flight: what was before is unseen")] if track.flying[:1].any() else []
    for begin_s, long_s in zip(*pauses_in_flight(track), strict=True):
        pause = {"long": language.duration(float(long_s)), "clock": language.clock(float(begin_s))}
        words.append(say("has nothing of {long} of the flight from {clock} on", **pause))
    if track.flying[-1:].any():
        last = language.clock(float(track.time_s[-1]))
        words.append(say("ends in flight, at {clock}: the rest is unseen", clock=last))
    return (("log", "; ".join(words)),) if words else ()


def peak_left(peak: UtilisationPeak) -> str:
    """Return the thrust left at a peak with its interval: `34 % (29 to 39)`."""
    low, high = peak.utilisation_low, peak.utilisation_high
    return left_words(1.0 - peak.utilisation, 1.0 - high, 1.0 - low)


def worst_words(peak: UtilisationPeak) -> str:
    """Return rotor, time, thrust left and basis of the worst peak, as a line of text.

    `Worst: rotor 1, front right, at 2:58: 34 % (29 to 39), from motor outputs`. If the utilisation
    is measured, and so has no interval, thrust left is not repeated.
    """
    place = place_words(peak.rotor_name)
    rotor = say("rotor {rotor}", rotor=peak.rotor + 1) + (f", {place}" if place else "")
    known = {
        "rotor": rotor,
        "clock": language.clock(peak.time_s),
        "basis": say(peak.basis),
    }
    if peak.utilisation_high - peak.utilisation_low < 1e-9:
        return say("Worst: {rotor}, at {clock}, {basis}", **known)
    return say("Worst: {rotor}, at {clock}: {left}, {basis}", left=peak_left(peak), **known)


def peak_words(peak: UtilisationPeak) -> str:
    """Return `rotor 1, front right, at 0:52, turning left, 9.0 kg on board, ...` for a peak.

    The kg are in the tank; the position relative to take-off comes last. If the utilisation has an
    interval, thrust left and its basis follow the time. Unknown parts are left out.
    """
    known = {"rotor": peak.rotor + 1, "clock": language.clock(peak.time_s)}
    words, place = "rotor {rotor}, {place}, at {clock}", place_words(peak.rotor_name)
    parts = [say(words if place else "rotor {rotor}, at {clock}", place=place, **known)]
    if peak.utilisation_high - peak.utilisation_low > 1e-9:
        parts.append(say("thrust left {left}", left=peak_left(peak)))
        parts.append(say(peak.basis))
    parts += [doing_words(peak.activities)] if peak.activities else []
    if math.isfinite(peak.tank_kg):
        parts.append(say("{kg} on board", kg=language.number(peak.tank_kg, "kg")))
    where = language.place(peak.north, peak.east)
    return ", ".join([*parts, where] if where else parts)


def estimate(figure: Estimate, unit: str = "", decimals: int = 1, factor: float = 1.0) -> str:
    """Return a value with its 95 % interval as text: `41 (38 to 45) rpm`.

    It has the digits that the interval allows, with at most `decimals` decimals. Without an
    interval the brackets are missing; "unknown" for NaN. Value and ends are multiplied by `factor`;
    `unit` is appended.
    """
    ends = figure.value, figure.low, figure.high
    if not language.known(figure.value):
        return language.UNKNOWN
    return (
        f"{language.joined(language.within(*ends, factor=factor, most=decimals))} {unit}".rstrip()
    )


def _outputs_go_on(analysis: FlightAnalysis) -> str:
    """Return a clause if motor outputs continue in flight where reported rotor speeds are missing.

    Such outputs are not used. Empty if they do not continue, or if no rotor speed was reported in
    the whole flight.
    """
    heard = np.isfinite(analysis.utilisation) & ~analysis.from_outputs
    if not heard.any():
        return ""
    silent = analysis.track.flying & ~analysis.any_measured
    outputs = np.any(analysis.track.throttle > 0.0, axis=1)[silent]
    known = outputs.size and float(np.mean(outputs)) > 0.5
    return say("; motor outputs went on, not used: look at ESC telemetry") if known else ""


def basis_words(
    analysis: FlightAnalysis, measured_s: float, known_s: float, airborne_s: float
) -> str:
    """Return in words whether a flight's thrust utilisation is measured, inferred or predicted.

    Of `airborne_s` seconds in the air it is known for `known_s`, and by rotor speeds, reported or
    inferred, for `measured_s` of these. The time unknown is added from 5 % on, the share predicted
    if any is. With 0 `known_s` it says that nothing is known.
    """
    if known_s == 0.0:
        return say("nothing measured, nothing predicted")
    missing = airborne_s - known_s
    tail = ""
    if missing >= 0.05 * airborne_s:
        tail = say("; unknown for {long}", long=language.duration(missing))
    if measured_s == 0.0:
        on_the_ground = analysis.track.reports("rotor_speed_rpm")
        where = "in the air in this log" if on_the_ground else "in this log"
        return f"{say(f'predicted; no rotor speeds {where}')}{tail}"
    if measured_s < 0.999 * known_s:
        words = say(
            "rotor speeds {basis} for {part} of the flight, predicted for the rest",
            basis=say(analysis.speed_basis),
            part=language.percent(measured_s / known_s),
        )
        silent = _outputs_go_on(analysis) if measured_s < 0.95 * known_s else ""
        return f"{words}{silent}{tail}"
    if np.any(analysis.from_outputs):
        return (
            f"{say('rotor speeds')} {source_words(analysis.track.source('rotor_speed_rpm'))}{tail}"
        )
    return f"{say('measured rotor speeds')}{tail}"
