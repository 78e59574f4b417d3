"""Counts over many scores, each with its own uncertainty, and the tables that show them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

from tests.lab.undeclared.judging import Score
from tests.lab.undeclared.methods import Sparse

GROUPS = ("none", "single", "pair", "triple", "outside", "instrument")
BINS = (0.0, 1.0, 2.0, 4.0, 8.0, np.inf)  # size over the oracle's standard error
SEEN_BY_ORACLE = 1.96
VISIBLE = 1.15  # error of the old model over that of one who knows the truth


def share(hits: int, of: int) -> dict[str, Any]:
    """A share with its 95 % interval (Wilson); None where there is nothing to count."""
    if not of:
        return {"hits": hits, "of": of, "share": None, "ci95": None}
    low, high = binomtest(hits, of).proportion_ci(0.95, "wilson")
    return {"hits": hits, "of": of, "share": hits / of, "ci95": [low, high]}


def percent(counted: dict[str, Any]) -> str:
    if counted["share"] is None:
        return "-"
    low, high = (100 * edge for edge in counted["ci95"])
    return (
        f"{100 * counted['share']:.0f} % ({counted['hits']}/{counted['of']}, {low:.0f}-{high:.0f})"
    )


def flight_error(scores: Iterable[Score]) -> dict[str, float]:
    """The oracle's error in one flight by kind of change, in the unit of its size; robust."""
    errors: dict[str, list[float]] = {}
    for s in scores:
        for (kind, *_, size), row in zip(s.implants, s.oracle, strict=False):
            errors.setdefault(kind, []).extend(size * abs(e) for e in row if np.isfinite(e))
    # The median of |normal| is 0.6745 standard deviations.
    return {k: float(np.median(v)) / 0.6745 for k, v in errors.items() if v}


def asked(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Each change that has a name: its size over the oracle's standard error, and its verdicts."""
    of_flight = flight_error(scores)
    rows = []
    for s in scores:
        if s.group not in ("single", "pair", "triple"):
            continue
        for k, (kind, name, _, size) in enumerate(s.implants):
            error = of_flight.get(kind, np.nan) / np.sqrt(s.flights)
            own = [1.0 + e for e in (s.oracle[k] if s.oracle else ()) if np.isfinite(e)]
            rows.append(
                {
                    "kind": kind,
                    "name": name,
                    "group": s.group,
                    "size": size,
                    "z": size / error if error else np.nan,
                    "told": s.told[k] if s.told else np.nan,
                    "mixed": is_mixed(s),
                    "error4": of_flight.get(kind, np.nan) / 2.0,
                    "verdict": s.verdicts[k],
                    "probability": s.probabilities[k],
                    "oracle": bool(own) and abs(np.mean(own)) * size > SEEN_BY_ORACLE * error,
                    **{m: v[k] == "named" for m, (v, _) in s.others.items()},
                }
            )
    return rows


def is_mixed(score: Score) -> bool:
    """A bad rotor, hidden mass and a shifted centre of gravity, all at once."""
    return {"rotor", "mass", "cg"} == {i[0] for i in score.implants}


def named_and_listed(rows: Sequence[dict[str, Any]], prefix: str) -> dict[str, dict[str, Any]]:
    """Shares of changes that are named, and named or listed."""
    return {
        f"named{prefix}": share(sum(r["verdict"] == "named" for r in rows), len(rows)),
        f"named_or_listed{prefix}": share(sum(r["verdict"] != "missed" for r in rows), len(rows)),
    }


def summary(scores: Sequence[Score]) -> dict[str, Any]:
    """The figures that the goals are about."""
    by = {g: [s for s in scores if s.group == g] for g in GROUPS}
    rows = asked(scores)
    visible = [r for r in rows if r["z"] >= 4.0]
    told = [r for r in rows if r["told"] >= 4.0]
    mixed = [s for s in by["triple"] if is_mixed(s)]
    plain = [s for g in ("single", "pair", "triple") for s in by[g] if max(s.told, default=0) >= 5]
    shows = [s for s in by["outside"] if s.before_rmse_rpm > VISIBLE * s.knowing_rmse_rpm]
    intervals = [(i, len(s.implants)) for s in scores for i in s.intervals]
    errors = [s for s in scores if np.isfinite(s.after_rmse_rpm)]
    missing = [s for s in errors if s.group != "none" and np.isfinite(s.knowing_rmse_rpm)]
    trees = [s for s in errors if np.isfinite(s.trees_rmse_rpm)]

    def ratio(values: Iterable[float]) -> float | None:
        finite = [v for v in values if np.isfinite(v)]
        return float(np.median(finite)) if finite else None

    return {
        "sets": len(scores),
        "failed": [f"{s.seed}: {s.failed}" for s in scores if s.failed],
        "false_alarm": share(sum(bool(s.wrong) for s in by["none"]), len(by["none"])),
        "false_alarm_not_natural": share(
            sum(len(s.wrong) > len(s.natural) for s in by["none"]), len(by["none"])
        ),
        "sound_set_with_an_action": share(sum(bool(s.asked) for s in by["none"]), len(by["none"])),
        "sound_set_first_line_nothing": share(
            sum(s.first == "nothing" for s in by["none"]), len(by["none"])
        ),
        "first_line_right_above_5_errors_told": share(
            sum(s.first == "right" for s in plain), len(plain)
        ),
        "visible_outside_first_line_true": share(
            sum(
                s.first == "right" or (s.first == "unexplained" and s.unexplained_right)
                for s in shows
            ),
            len(shows),
        ),
        "visible_outside_first_line_wrong": share(
            sum(s.first == "wrong" for s in shows), len(shows)
        ),
        "sound_rotor_asked": share(sum(bool(s.sound_rotors_asked) for s in scores), len(scores)),
        "after_within_115_of_truth": share(
            sum(s.after_rmse_rpm <= 1.15 * s.knowing_rmse_rpm for s in missing), len(missing)
        ),
        **named_and_listed(rows, ""),
        **named_and_listed(visible, "_above_4_errors"),
        **named_and_listed(told, "_above_4_errors_told_the_names"),
        **named_and_listed([r for r in told if r["mixed"]], "_of_mixtures_above_4_told"),
        "wrong_name_beside": {
            g: share(sum(bool(s.wrong) for s in by[g]), len(by[g]))
            for g in ("single", "pair", "triple")
        },
        "mixture_whole": share(sum("missed" not in s.verdicts for s in mixed), len(mixed)),
        "coverage": share(sum(i.covers for i, _ in intervals), len(intervals)),
        "coverage_of_several": share(
            sum(i.covers for i, n in intervals if n > 1), sum(n > 1 for _, n in intervals)
        ),
        "outside_named": share(sum(bool(s.wrong) for s in by["outside"]), len(by["outside"])),
        "outside_right_rotor": sum(s.right_rotor for s in by["outside"]),
        "unexplained_right": share(
            sum(s.unexplained_right for s in by["outside"]), len(by["outside"])
        ),
        "instrument_wrong_name": share(
            sum(bool(s.wrong) for s in by["instrument"]), len(by["instrument"])
        ),
        "falsely_excluded": share(
            sum(s.falsely_excluded for s in scores), sum(s.excluded for s in scores)
        ),
        "after_over_truth": ratio(s.after_rmse_rpm / s.knowing_rmse_rpm for s in errors),
        "trees_over_after": ratio(s.trees_rmse_rpm / s.after_rmse_rpm for s in trees),
        "trees_below_floor": share(sum(s.trees_rmse_rpm < s.floor_rpm for s in trees), len(trees)),
        "seconds": {
            "median": ratio(s.seconds for s in scores),
            "largest": max((s.seconds for s in scores), default=None),
        },
    }


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left")
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="right" if i else "left", no_wrap=True)
    return table


def kinds_table(scores: Sequence[Score]) -> Table:
    rows = asked(scores)
    table = _table(
        "Each change: smallest size that the oracle sees in four flights, and what was found",
        "kind", "oracle sees", "asked", "named", "listed", "missed", "smallest named",
        "largest missed", "ridge", "lasso", "stlsq",
    )  # fmt: skip
    for kind in sorted({r["kind"] for r in rows}):
        of = [r for r in rows if r["kind"] == kind]
        named = [r["size"] for r in of if r["verdict"] == "named"]
        missed = [r["size"] for r in of if r["verdict"] == "missed"]
        table.add_row(
            kind,
            f"{SEEN_BY_ORACLE * of[0]['error4']:.4f}",
            str(len(of)),
            *(str(sum(r["verdict"] == v for r in of)) for v in ("named", "listed", "missed")),
            f"{min(named):.4f}" if named else "-",
            f"{max(missed):.4f}" if missed else "-",
            *(str(sum(bool(r.get(m)) for r in of)) for m in Sparse.METHODS),
        )
    return table


def power_table(scores: Sequence[Score], by: str, whose: str) -> Table:
    rows = asked(scores)
    table = _table(
        f"Power: share named by size over the standard error of {whose}",
        "size / error", "group", "asked", "named", "or listed", "oracle", *Sparse.METHODS,
    )  # fmt: skip
    for low, high in pairwise(BINS):
        for group in ("single", "pair", "triple"):
            of = [r for r in rows if low <= r[by] < high and r["group"] == group]
            if of:
                table.add_row(
                    f"{low:.0f} to {high:.0f}", group, str(len(of)),
                    f"{np.mean([r['verdict'] == 'named' for r in of]):.0%}",
                    f"{np.mean([r['verdict'] != 'missed' for r in of]):.0%}",
                    f"{np.mean([r['oracle'] for r in of]):.0%}",
                    *(f"{np.mean([bool(r.get(m)) for r in of]):.0%}" for m in Sparse.METHODS),
                )  # fmt: skip
    return table


def confusion_table(scores: Sequence[Score]) -> Table:
    """Wrong names by kind of set."""
    table = _table(
        "Names that are true of nothing in the set", "set", "sets", "with one", "which", "by lasso"
    )
    kinds = [(s.group, s.kind if s.group in ("outside", "instrument") else s.group) for s in scores]
    for group, kind in sorted(set(kinds), key=lambda k: (GROUPS.index(k[0]), k[1])):
        of = [s for s, k in zip(scores, kinds, strict=True) if k == (group, kind)]
        names = Counter(n.split()[0] for s in of for n in s.wrong)
        lasso = sum(s.others["lasso"][1] > 0 for s in of if "lasso" in s.others)
        table.add_row(
            f"{group}: {kind}" if kind != group else kind,
            str(len(of)),
            str(sum(bool(s.wrong) for s in of)),
            ", ".join(f"{n} {c}" if c > 1 else n for n, c in names.most_common()),
            str(lasso),
        )
    return table


def print_tables(scores: Sequence[Score], console: Console) -> None:
    """Power, confusion, coverage, alarms, errors and time."""
    console.print(kinds_table(scores), power_table(scores, "z", "the oracle"))
    if any(s.told for s in scores):
        console.print(power_table(scores, "told", "who is told the names and knows sound flights"))
    console.print(confusion_table(scores))
    figures = summary(scores)
    for key, value in figures.items():
        words = key.replace("_", " ")
        if isinstance(value, dict) and "share" in value:
            console.print(f"{words}: {percent(value)}", highlight=False)
        elif key == "wrong_name_beside":
            parts = ", ".join(f"{g} {percent(v)}" for g, v in value.items())
            console.print(f"{words}: {parts}", highlight=False)
        else:
            console.print(f"{words}: {value}", highlight=False)
