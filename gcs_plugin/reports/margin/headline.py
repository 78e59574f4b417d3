"""What the margin report says first: the verdict, its facts and its moments, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from thrustmargin.gcs_plugin.reports.margin.data import Fact, Level, Moment, Verdict
from thrustmargin.gcs_plugin.wording.numbers import (
    UNKNOWN,
    clock,
    duration,
    number,
    percent,
    place,
)
from thrustmargin.models.scores import Estimate


def estimate(figure: Estimate, unit: str = "", decimals: int = 1, factor: float = 1.0) -> str:
    """`41.2 (38.0 to 44.6) rpm`; without the bracket where there is no interval."""
    middle = number(figure.value * factor, "", decimals)
    if middle == UNKNOWN or figure.low - figure.low != 0.0 or figure.high - figure.high != 0.0:
        return number(figure.value * factor, unit, decimals)
    low, high = (number(end * factor, "", decimals) for end in (figure.low, figure.high))
    return f"{middle} ({low} to {high}) {unit}".rstrip()


def moment_words(moment: Moment) -> str:
    """Which, when and in what movement: `rotor 1, front right, at 0:52, turning left, 9.0 kg`."""
    parts = [f"rotor {moment.rotor}, {moment.rotor_name}, at {clock(moment.time_s)}"]
    if moment.doing:
        parts.append(", ".join(moment.doing))
    if moment.tank_kg - moment.tank_kg == 0.0:
        parts.append(f"{number(moment.tank_kg, 'kg')} in the tank")
    where = place(moment.north, moment.east)
    return ", ".join([*parts, where] if where else parts)


def headline(verdict: Verdict) -> str:
    """The verdict in capitals, to be read first."""
    line = f"THE {percent(verdict.limit)} LINE"
    return {
        "under": f"UNDER {line}",
        "over": f"OVER {line} AT TIMES",
        "critical": "TOO HEAVY TO LOSE A ROTOR",
        "unknown": "NO VERDICT",
    }[verdict.level]


#: What is said of several flights by the level of the worst, worst first; {line} is the limit.
_SEVERAL: Mapping[Level, str] = {
    "critical": "TOO HEAVY TO LOSE A ROTOR",
    "over": "OVER {line} AT TIMES",
    "under": "UNDER {line}",
    "unknown": "WITHOUT VERDICT",
}


def several_headline(levels: Sequence[Level], limit: float) -> tuple[Level, str]:
    """The worst level of several flights, and how many of them have it, in capitals."""
    level = min(levels, key=list(_SEVERAL).index)
    said = _SEVERAL[level].format(line=f"THE {percent(limit)} LINE")
    count = sum(one == level for one in levels)
    if count == len(levels):
        return level, f"ALL {count} FLIGHTS {said}"
    return level, f"{count} OF {len(levels)} FLIGHTS {said}"


def facts(verdict: Verdict) -> tuple[Fact, ...]:
    """What a pilot needs beside the big numbers, one thing a line."""
    if verdict.worst is None:
        return (Fact("why", "neither rotor speeds nor what a prediction needs is in this log"),)
    if verdict.over_limit_s > 0.0:
        share = percent(verdict.over_limit_share)
        over = f"{duration(verdict.over_limit_s)}, {share} of the flight"
    else:
        over = "never"
    return (
        Fact("worst", moment_words(verdict.worst)),
        Fact(f"over {percent(verdict.limit)}", over),
        Fact("one rotor lost", _one_rotor_out(verdict)),
        Fact("from", verdict.basis),
    )


def _one_rotor_out(verdict: Verdict) -> str:
    least = verdict.redundancy_yaw_free_min
    if least - least != 0.0:
        return "cannot be said, the tank level is unknown"
    if verdict.not_survivable_s > 0.0:
        too_long = duration(verdict.not_survivable_s)
        return f"too heavy for {too_long} ({number(least, '×', 2)} the weight can be held at worst)"
    return f"the weight can be held all flight, heading given up ({number(least, '×', 2)} or more)"


def with_words(verdict: Verdict) -> Verdict:
    """The verdict with its headline and facts."""
    return replace(verdict, headline=headline(verdict), facts=facts(verdict))
