"""The verdict of a flight, its facts, its moments and what to do: the figures and their words.

What the report says first, and the replay with it. The fields of the classes are keys of the JSON
(gcs_plugin/reports/margin/data.py states units and spelling).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.fault_words import ONE_LOST, SPINS, TOO_HEAVY
from thrustmargin.gcs_plugin.wording.fill_words import amount, sure
from thrustmargin.gcs_plugin.wording.numbers import (
    UNKNOWN,
    clock,
    duration,
    joined,
    known,
    number,
    percent,
    percent_within,
    place,
    within,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fill_limits import Reason
from thrustmargin.models.provenance import Meaning, SourceKind
from thrustmargin.models.scores import Estimate

#: lost: control was lost, whatever the margin before.
#: under: below the limit all flight. over: above it at times or always, and one lost rotor could be
#: survived throughout. critical: at times one lost rotor could not. near: the limit, or a rotor
#: whose loss is just survived, lies within the 90 % interval. unknown: no thrust utilisation.
Level = Literal["under", "near", "over", "critical", "lost", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One row of the flight at which some rotor worked hardest."""

    time_s: float
    clock_utc: str | None
    rotor: int
    rotor_name: str
    capacity_use: float
    capacity_use_low: float  # ends of its 90 % interval: the same where nothing was inferred
    capacity_use_high: float
    margin: float
    basis: str  # "measured", "from motor outputs" or "predicted"
    doing: tuple[str, ...]  # what the vehicle was doing, in words
    tank_kg: float
    ground_speed: float
    airspeed: float
    climb_rate: float
    height_agl: float
    north: float
    east: float
    latitude_deg: float
    longitude_deg: float
    redundancy_yaw_free: float


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing to know, with the word that it is found by."""

    label: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginVerdict:
    """The answer to "how close was it?"."""

    level: Level
    headline: str
    facts: tuple[Fact, ...]
    limit: float
    one_rotor_out_use: float  # utilisation in hover at which one lost rotor is just survived
    worst: Moment | None
    basis: str  # what the utilisation rests on, in words
    speed_basis: str  # "measured", or what stands in for a rotor's speed
    measured_share: float  # of the airborne time
    over_limit_s: float
    over_limit_share: float  # of the airborne time with a known utilisation
    redundancy_yaw_free_min: float
    redundancy_yaw_free_low: float  # ends of its 90 % interval
    redundancy_yaw_free_high: float
    not_survivable_s: float  # airborne time with redundancy, yaw uncontrolled, below 1
    fill_kg: float = float("nan")  # largest that keeps both limits in hover, battery at its lowest
    fill_low_kg: float = float("nan")  # ends of its 90 % interval
    fill_high_kg: float = float("nan")
    fill_start_kg: float = float("nan")  # the same with the battery as it was at the start
    tank_start_kg: float = float("nan")
    beyond_gauge_kg: float = 0.0  # that hover thrust shows beyond gauge or statement; 0: they agree


#: The verdict by its level, the worst first; {limit} is like "50 %".
_VERDICTS: Mapping[Level, str] = {
    "lost": "LOST CONTROL",
    "critical": "TOO HEAVY TO LOSE A ROTOR",
    "over": "ABOVE THE {limit} LIMIT AT TIMES",
    "near": "NEAR THE {limit} LIMIT: CANNOT TELL",
    "under": "BELOW THE {limit} LIMIT",
    "unknown": "NO VERDICT",
}


#: Behind the verdict of a flight whose end is not in the log.
_UNSEEN = " (LOG ENDS IN FLIGHT)"


def headline(
    level: Level,
    limit: float,
    lost_s: float = 0.0,
    over_share: float = 0.0,
    *,
    ends_in_flight: bool = False,
) -> str:
    """The verdict of a flight in capitals, to be read first; `lost_s` s no rotor could be lost, and
    `over_share` of the flight above the limit. One that `ends_in_flight` is of the log alone."""
    words = _VERDICTS[level].format(limit=percent(limit))
    if percent(over_share) == "100 %":
        words = words.replace("AT TIMES", "ALL FLIGHT")
    if level == "critical" and lost_s:
        words = f"{words} FOR {duration(lost_s).upper()}"
    return f"{words}{_UNSEEN}" if ends_in_flight else words


def gravity(level: Level) -> int:
    """0 for the worst verdict, and more the better it is; no verdict is last."""
    return list(_VERDICTS).index(level)


def several_headline(levels: Sequence[Level], limit: float) -> tuple[Level, str]:
    """The worst level of the flights, and how many of several have it, in capitals."""
    level = min(levels, key=gravity)
    words = headline(level, limit)
    if len(levels) == 1:
        return level, words
    words = words.replace("NO VERDICT", "WITHOUT VERDICT")
    count = levels.count(level)
    counted = f"ALL {count}" if count == len(levels) else f"{count} OF {len(levels)}"
    return level, f"{counted} FLIGHTS {words}"


def facts(
    verdict: MarginVerdict,
    claim: AirframeClaim,
    not_flown: str = "",
    *,
    full_at_once: Reason | None = None,
    suspects: tuple[int, ...] = (),
) -> tuple[Fact, ...]:
    """What a pilot needs beside the big numbers, one thing a line.

    `not_flown` says why the log has no flight to check; empty where it has one. `full_at_once` is
    why nothing fits in even where it is light enough, and `suspects` are rotors, from 1, for which
    an alarm was raised.
    """
    airframe = Fact("airframe", claim.words.removeprefix("airframe "))
    if not_flown:
        return (Fact("why", not_flown), airframe)
    if claim.withheld:
        why = (Fact("why", reason) for reason in claim.withheld)
        return (*why, Fact("what helps", claim.remedy), airframe)
    if verdict.worst is None:
        why = "neither rotor speeds nor what a prediction needs is in this log"
        return (Fact("why", why), airframe)
    above = "never"
    if verdict.over_limit_s > 0.0:
        share = percent(verdict.over_limit_share)
        above = f"{duration(verdict.over_limit_s)}, {share} of the flight"
    if verdict.level == "near":
        above += "; the limit lies within the error"
    if verdict.level == "lost":
        # What was left before it went wrong explains nothing, and advises nothing.
        until = Fact("worst before it", moment_words(verdict.worst))
        return (until, Fact("from", verdict.basis), airframe)
    return (
        Fact("what to do", action(verdict, full_at_once=full_at_once, suspects=suspects)),
        Fact("worst", moment_words(verdict.worst)),
        *_beyond(verdict.worst),
        Fact(f"above {percent(verdict.limit)}", above),
        Fact(ONE_LOST, _one_rotor_out(verdict)),
        Fact("from", verdict.basis),
        airframe,
    )


def action(
    verdict: MarginVerdict,
    *,
    full_at_once: Reason | None = None,
    suspects: tuple[int, ...] = (),
) -> str:
    """What the pilot does next time, for this air and this battery; see `facts`."""
    then = _next_fill(verdict, full_at_once)
    if verdict.beyond_gauge_kg > 0.0:
        more = number(verdict.beyond_gauge_kg, "kg", 0)
        why = f"thrust shows {more} more than was reported"
        then = f"{actions.CHECK_LOAD.text}: {why}; until then {then}"
    if suspects:
        return f"{actions.not_before_looked_at(suspects).text}; for the load: {then}"
    return then


#: Why nothing goes into an aircraft that is light enough.
_FULL_AT_ONCE: Mapping[Reason, str] = {
    "tank": "it has no tank to fill",
    "take-off mass": "empty it has the maker's maximum take-off mass already",
}


def _next_fill(verdict: MarginVerdict, full_at_once: Reason | None) -> str:
    fill = amount(verdict.fill_kg, verdict.fill_low_kg, verdict.fill_high_kg)
    limit, do_not = percent(verdict.limit), actions.DO_NOT_FILL.text
    if not math.isfinite(verdict.fill_kg):
        return "state mass and rotors in the airframe file: no fill can be worked out"
    if full_at_once is not None and verdict.fill_kg >= 0.0:
        why = _FULL_AT_ONCE[full_at_once]
        if verdict.level in ("under", "near"):
            return f"nothing: {why}" if verdict.level == "under" else why
        return f"{actions.FLY_GENTLY.text}: {why}"
    if full_at_once == "tank":
        return "it has no tank to fill, and is too heavy for this air and this battery"
    if verdict.fill_kg <= 0.0:
        return f"{do_not}: even empty it is too heavy for this air and this battery"
    if verdict.fill_low_kg <= 0.0:
        return f"{do_not}: the limit is at {fill}, too unsure to fill anything"
    fresh = verdict.fill_start_kg - (verdict.fill_kg - verdict.fill_low_kg)  # as sure as the other
    surely = sure(verdict.fill_kg, verdict.fill_low_kg, verdict.fill_high_kg)
    most = f"fill at most {surely} on this battery"
    if fresh > verdict.fill_low_kg + 0.05:
        most += f", {amount(fresh, fresh, fresh)} as long as it is fresh"
    if verdict.level == "critical":
        return f"{most}: {TOO_HEAVY[0]}"
    if verdict.level == "under":
        return f"nothing: in hover up to {surely} stay within the limits on this battery"
    if verdict.level == "near":
        return most
    if verdict.tank_start_kg > verdict.fill_low_kg:
        return f"{most}, which is {limit} in hover"
    return f"{actions.FLY_GENTLY.text}: in hover up to {surely} are within {limit}"


def _beyond(worst: Moment) -> tuple[Fact, ...]:
    """That a rotor made more than the airframe says that it can, and what may be wrong."""
    if not worst.capacity_use > 1.0:
        return ()
    more = percent(worst.capacity_use)
    return (
        Fact(
            "beyond the ceiling",
            f"rotor {worst.rotor} shows {more} of what the airframe says it can make: check the "
            "battery voltage, max_rotor_speed_rpm and motor_poles (eRPM)",
        ),
    )


def load_facts(track: FlightTrack) -> tuple[Fact, ...]:
    """What is on board and how that is known, where no gauge says it."""
    source = track.source("tank_kg")
    known = track.tank_kg[track.flying & np.isfinite(track.tank_kg)]
    reported = source.kind is not SourceKind.STATED and source.meaning is not Meaning.HOVER_THRUST
    if not known.size or reported:
        return ()
    start, end = number(float(known[0]), "", 1), number(float(known[-1]), "kg", 1)
    return (Fact("load", f"{start} to {end}, {source.words}"),)


def ends_in_flight(track: FlightTrack) -> bool:
    """Whether a log ends before the flight did: the file is cut short, or recording stopped."""
    return bool(track.flying.size and track.flying[-1])


def ending_facts(track: FlightTrack) -> tuple[Fact, ...]:
    """From when on the flight is unseen, where its log ends in it."""
    if not ends_in_flight(track):
        return ()
    return (
        Fact("log", f"ends in flight, at {clock(float(track.time_s[-1]))}: the rest is unseen"),
    )


def _one_rotor_out(verdict: MarginVerdict) -> str:
    least = verdict.redundancy_yaw_free_min
    if not math.isfinite(least):
        return "not known, because the tank level is unknown"
    held = number(least, "×", 2)
    low, high = verdict.redundancy_yaw_free_low, verdict.redundancy_yaw_free_high
    if low < 1.0 <= high:
        held += f", {number(low, '', 2)} to {number(high, '', 2)}"
        return f"cannot tell: the weight is within the error of what could be held ({held})"
    if verdict.not_survivable_s > 0.0:
        too_long = duration(verdict.not_survivable_s)
        return f"too heavy for {too_long} (at worst {held} the weight can be held)"
    return f"the weight can be held all flight, {SPINS} ({held} or more)"


def moment_words(moment: Moment) -> str:
    """Which, when and in what movement: `rotor 1, front right, at 0:52, turning left, 9.0 kg`."""
    parts = [f"rotor {moment.rotor}, {moment.rotor_name}, at {clock(moment.time_s)}"]
    if moment.capacity_use_high - moment.capacity_use_low > 1e-9:
        use = moment.capacity_use, moment.capacity_use_low, moment.capacity_use_high
        parts.append(f"{percent_within(*use)} in use, {moment.basis}")
    parts += [", ".join(moment.doing)] if moment.doing else []
    if math.isfinite(moment.tank_kg):
        parts.append(f"{number(moment.tank_kg, 'kg')} in the tank")
    where = place(moment.north, moment.east)
    return ", ".join([*parts, where] if where else parts)


def estimate(figure: Estimate, unit: str = "", decimals: int = 1, factor: float = 1.0) -> str:
    """`41 (38 to 45) rpm`, with the digits that the interval allows; without one no bracket."""
    ends = figure.value, figure.low, figure.high
    if not known(figure.value):
        return UNKNOWN
    return f"{joined(within(*ends, factor=factor, most=decimals))} {unit}".rstrip()


def basis_words(
    analysis: FlightAnalysis, measured_s: float, known_s: float, airborne_s: float
) -> str:
    """What the thrust utilisation of a flight rests on, s of which each is known."""
    if known_s == 0.0:
        return "nothing measured, nothing predicted"
    missing = airborne_s - known_s
    tail = "" if missing < 0.05 * airborne_s else f"; unknown for {duration(missing)}"
    if measured_s == 0.0:
        why = "in the air " if analysis.track.reports("rotor_speed_rpm") else ""
        return f"predicted; no rotor speeds {why}in this log{tail}"
    if measured_s < 0.999 * known_s:
        part = percent(measured_s / known_s)
        basis = analysis.speed_basis
        return f"rotor speeds {basis} for {part} of the flight, predicted for the rest{tail}"
    if np.any(analysis.from_outputs):
        return f"rotor speeds {analysis.track.source('rotor_speed_rpm').words}{tail}"
    return f"measured rotor speeds{tail}"
