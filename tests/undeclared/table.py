"""Counts over many scores, with their own uncertainty, and the table that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

from tests.undeclared.judging import Score
from tests.undeclared.outside import OUTSIDE


def named_sets(scores: Sequence[Score]) -> list[Score]:
    """Data sets that ask for something of the table and hold nothing outside it."""
    return [s for s in scores if s.asked and not s.outside_rpm]


def verdicts_of(scores: Sequence[Score]) -> list[tuple[str, str, str]]:
    """(name, variant, verdict) of every effect asked for in sets with nothing outside the table."""
    return [
        (name, variant, verdict)
        for s in named_sets(scores)
        for (name, variant, _), verdict in zip(s.asked, s.verdicts, strict=True)
    ]


def share(hits: int, of: int) -> dict[str, Any]:
    """A share with its 95 % interval (Wilson); None where there is nothing to count."""
    if not of:
        return {"hits": hits, "of": of, "share": None, "ci95": None}
    low, high = binomtest(hits, of).proportion_ci(0.95, "wilson")
    return {"hits": hits, "of": of, "share": hits / of, "ci95": [low, high]}


def summary(scores: Sequence[Score]) -> dict[str, Any]:
    """The figures that the goals are about."""
    asked = verdicts_of(scores)
    nothing = [s for s in scores if s.kind == "none"]
    outside = [s for s in scores if s.outside_rpm]
    inside = [s for s in scores if not s.outside_rpm]
    intervals = [i for s in inside for i in s.intervals]
    ratios = np.array([s.ratio for s in inside])
    ratios = ratios[np.isfinite(ratios)]
    return {
        "sets": len(scores),
        "right_name_or_twin": share(sum(v != "missed" for *_, v in asked), len(asked)),
        "right_name": share(sum(v == "exact" for *_, v in asked), len(asked)),
        "whole_answer_right": share(
            sum(s.right for s in named_sets(scores)), len(named_sets(scores))
        ),
        "wrong_name_beside": share(
            sum(bool(s.wrong) for s in named_sets(scores)), len(named_sets(scores))
        ),
        "false_alarm": share(sum(bool(s.wrong) for s in nothing), len(nothing)),
        "coverage": share(sum(i.covers for i in intervals), len(intervals)),
        "outside_unexplained": share(sum(s.says_unexplained for s in outside), len(outside)),
        "outside_right": share(sum(s.right for s in outside), len(outside)),
        "outside_wrong_name": share(sum(bool(s.wrong) for s in outside), len(outside)),
        "unexplained_for_nothing": share(sum(s.says_unexplained for s in inside), len(inside)),
        "error_ratio": {
            "median": float(np.median(ratios)) if ratios.size else None,
            "p90": float(np.quantile(ratios, 0.9)) if ratios.size else None,
            "largest": float(ratios.max()) if ratios.size else None,
            "within_1_1": share(int(np.sum(ratios <= 1.1)), int(ratios.size)),
        },
        "seconds": {
            "median": float(np.median([s.seconds for s in scores])) if scores else None,
            "largest": float(max((s.seconds for s in scores), default=0.0)),
        },
        "unmapped": sorted({u for s in scores for u in s.unmapped}),
    }


@dataclass(frozen=True)
class Goal:
    """A figure of the summary and where it should lie; one with nothing to count is met."""

    words: str
    group: str
    key: str
    low: float = -np.inf
    high: float = np.inf

    def value(self, figures: dict[str, Any]) -> float | None:
        return figures[self.group][self.key]

    def met(self, figures: dict[str, Any]) -> bool:
        value = self.value(figures)
        return value is None or self.low <= value <= self.high


GOALS = (
    Goal("right name or declared twin, >= 95 %", "right_name_or_twin", "share", low=0.95),
    Goal("false alarm where nothing is missing, <= 2 %", "false_alarm", "share", high=0.02),
    Goal("95 % intervals that cover, 90 to 99 %", "coverage", "share", low=0.90, high=0.99),
    Goal("error after over that of the truth, median <= 1.1", "error_ratio", "median", high=1.1),
    Goal("outside effects unexplained, not misnamed, >= 90 %", "outside_right", "share", low=0.90),
)


def goals_met(scores: Sequence[Score]) -> dict[str, bool]:
    figures = summary(scores)
    return {goal.words: goal.met(figures) for goal in GOALS}


def percent(counted: dict[str, Any]) -> str:
    if counted["share"] is None:
        return "-"
    low, high = counted["ci95"]
    return (
        f"{100 * counted['share']:.0f} % ({counted['hits']}/{counted['of']}, "
        f"{100 * low:.0f} to {100 * high:.0f})"
    )


def print_table(scores: Sequence[Score], console: Console) -> None:
    """The table by kind of data set, then each goal with its figure."""
    table = Table(title=f"{len(scores)} sealed data sets")
    for heading in ("kind", "sets", "name", "twin", "missed", "wrong beside", "unexplained",
                    "in 95 %", "error x", "right"):  # fmt: skip
        table.add_column(heading, justify="left" if heading == "kind" else "right", no_wrap=True)
    kinds = sorted({s.kind for s in scores}, key=lambda k: (k in OUTSIDE, k == "two", k))
    for kind in kinds:
        of = [s for s in scores if s.kind == kind]
        verdicts = [v for s in of for v in s.verdicts]
        intervals = [i for s in of for i in s.intervals]
        table.add_row(
            ("outside: " if kind in OUTSIDE else "") + kind,
            str(len(of)),
            *(str(verdicts.count(v)) for v in ("exact", "twin", "missed")),
            str(sum(bool(s.wrong) for s in of)),
            str(sum(s.says_unexplained for s in of)),
            f"{sum(i.covers for i in intervals)}/{len(intervals)}",
            f"{np.median([s.ratio for s in of]):.2f}",
            f"{sum(s.right for s in of)}/{len(of)}",
        )
    console.print(table)
    figures = summary(scores)
    for goal in GOALS:
        value = goal.value(figures)
        number = "nothing to count" if value is None else f"{value:.3f}"
        console.print(f"{'met    ' if goal.met(figures) else 'NOT MET'} {goal.words}: {number}")
    for key in ("right_name", "whole_answer_right", "wrong_name_beside", "outside_unexplained",
                "outside_wrong_name", "unexplained_for_nothing"):  # fmt: skip
        console.print(f"        {key.replace('_', ' ')}: {percent(figures[key])}")
    within = figures["error_ratio"]["within_1_1"]
    console.print(f"        error within 1.1 x of the truth's: {percent(within)}")
    console.print(f"        seconds a set: {figures['seconds']}")
    if figures["unmapped"]:
        console.print(f"        true parameters that no report states: {figures['unmapped']}")
