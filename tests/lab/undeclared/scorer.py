"""Score the loop on data whose cause it is not told: `python -m tests.lab.undeclared.scorer`.

Example: python -m tests.lab.undeclared.scorer --seeds 1 60 --models /tmp/models --json out.json

A seed is one data set of the frozen plan (`tests/lab/undeclared/plan.py`); sixty are a round with
every kind. Each aircraft's model comes from `thrustmargin train` on its good flights, is kept in
the folder of `--models` and used again: empty it when `train` changes.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tests.lab.undeclared.crafts import CRAFTS, HEXACOPTER, OTHER_CRAFTS, Craft
from tests.lab.undeclared.judging import Score, judge
from tests.lab.undeclared.methods import Sparse, density_slope, oracle_errors, tree_errors
from tests.lab.undeclared.plan import OPEN, DataSet, build, case_of, good_flights
from tests.lab.undeclared.recorded import build_recorded, hosts, recorded_case_of
from tests.lab.undeclared.rotor_aero import Array
from tests.lab.undeclared.table import print_tables, summary

EVERY_CRAFT = (*CRAFTS, *OTHER_CRAFTS, HEXACOPTER)
NOTHING = {"effects": [], "before": {"rmse_rpm": None}, "after": {"rmse_rpm": None}}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One set to score; without a folder of models, of recorded flights and the shipped model."""

    seed: int
    kind: str
    craft: Craft
    models: Path | None
    compare: bool = True
    size: float | None = None  # of a single change, in place of the drawn one

    def build(self) -> DataSet:
        if self.models is None:
            return build_recorded(self.seed, self.kind)
        return build(self.seed, self.kind, self.craft, self.size)


def score_one(case: Case) -> Score:
    """Build one data set, identify on its tracks alone, and judge the answer."""
    from tests.lab.undeclared import subject

    data = case.build()
    model = subject.model_of(case.craft, case.models)
    fit, held_out = ([f.track for f in flights] for flights in (data.fit, data.held_out))
    start, failed, result = time.perf_counter(), "", NOTHING
    try:
        result = subject.run_identify(model, fit, held_out)
    except Exception as error:  # a traceback is an answer too, and the worst one
        failed = f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - start
    residuals = subject.residuals(model, fit), subject.residuals(model, held_out)
    return judge(data, result, seconds=seconds, failed=failed, **beside(case, data, *residuals))


def beside(
    case: Case, data: DataSet, fit: Sequence[Array], held_out: Sequence[Array]
) -> dict[str, Any]:
    """The oracle, the error of who knows the truth, and, when asked for, the other methods."""
    from tests.lab.undeclared import subject

    model = subject.model_of(case.craft, case.models)
    slope, sparse = of_good_flights(case.craft, case.models)
    tracks, new = ([f.track for f in flights] for flights in (data.fit, data.held_out))
    known = [
        r + 0.5 * slope * t.rotor_speed_rpm * d
        for r, t, d in zip((*fit, *held_out), (*tracks, *new), data.dense, strict=True)
    ]
    signals = [
        [
            w - wo
            for w, wo in zip(
                (*fit, *held_out), subject.residuals(model, [f.track for f in of]), strict=True
            )
        ]
        for of in data.without
    ]
    figures: dict[str, Any] = {}
    if signals:
        figures["oracle"] = oracle_errors(signals, known[: len(fit)])
    left = [r - sum(s[f] for s in signals) if signals else r for f, r in enumerate(known)]
    figures["knowing_rmse_rpm"] = float(np.sqrt(np.nanmean(np.concatenate(left[len(fit) :]) ** 2)))
    if data.implants and data.group != "outside":
        figures["told"] = subject.told_the_names(model, tracks, data.implants)
    if case.compare:
        figures["others"] = sparse.names(tracks, fit)
        figures["trees_rmse_rpm"] = tree_errors(tracks, new, {"fit": fit, "held_out": held_out})
    return figures


@cache
def of_good_flights(craft: Craft, models: Path | None) -> tuple[float, Sparse]:
    """What the oracle knows of air density, and the sparse methods with their limits."""
    from tests.lab.undeclared import subject

    model = subject.model_of(craft, models)
    if models is None:
        return 0.0, Sparse(craft, hosts(), subject.residuals(model, hosts()))
    good = good_flights(craft)
    tracks = [f.track for f in good]
    left = subject.residuals(model, tracks)
    return density_slope(tracks, [f.dense for f in good], left), Sparse(craft, tracks, left)


def score_all(cases: Sequence[Case], jobs: int = 1) -> Iterator[Score]:
    """Scores as they come, in any order when `jobs` is more than one."""
    from tests.lab.undeclared import subject

    for case in {c.craft.name: c for c in cases}.values():
        subject.model_of(case.craft, case.models)
    if jobs == 1:
        yield from map(score_one, cases)
        return
    # torch and forked threads do not mix
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for done in as_completed([pool.submit(score_one, case) for case in cases]):
            yield done.result()


def line(score: Score) -> str:
    """One line on a data set, as it comes."""
    asked = ", ".join(
        f"{kind} {rotor or ''} {size:.3g} {verdict}"
        for (kind, _, rotor, size), verdict in zip(score.implants, score.verdicts, strict=True)
    )
    cause = asked if score.implants and score.group != "outside" else score.kind
    words = f"{score.seed} {score.craft}: {cause} | {', '.join(score.reported) or '-'}"
    words += f" | first line {score.first}"
    if score.wrong:
        words += f" | WRONG {', '.join(score.wrong)}"
    if score.unexplained_mode:
        words += f" | unexplained {score.unexplained_mode} {score.unexplained_channel or ''}"
    return f"{words} | {score.seconds:.1f} s {score.failed}"


def main(
    seeds: tuple[int, int] = (1, 60),
    only: tuple[str, ...] = (),
    craft: str | None = None,
    size: float | None = None,
    source: Literal["plant", "recorded"] = "plant",
    models: Path | None = None,
    jobs: int = 1,
    compare: bool = True,
    sealed: bool = False,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> int:
    """Score the residual loop on data sets of the frozen plan and print the tables.

    Example: python -m tests.lab.undeclared.scorer --seeds 1 60 --jobs 2 --models /tmp/models

    Args:
        seeds: First and last data set. Open are 1 to 999 and, of the second plan, 20000 to 29999,
            of the third 40000 to 40999; others are for the end.
        only: Only sets of these kinds (see the plan), or groups: none, single, pair, triple,
            outside, instrument.
        craft: Only sets of this aircraft, for example quad-x-21kg.
        size: Every set has the one kind of --only at this size, on the aircraft of --craft.
        source: Flights of the plant, or recorded ones with changes put in and the shipped model.
        models: Folder where trained models are kept and taken from; else a new one each time.
        jobs: Processes.
        compare: Also score ridge, lasso, STLSQ and boosted trees on the same sets.
        sealed: Allow sealed seeds. Whoever has looked at them cannot tune on anything any more.
        json_file: Where to write every score and the summary.
    """
    if size is not None and (len(only) != 1 or craft is None or source == "recorded"):
        print("--size needs --craft and one kind: --only rotor --craft quad-x-21kg --size 0.01")
        return 2
    if not sealed and not any(seeds[0] in some and seeds[1] in some for some in OPEN):
        ranges = " and ".join(f"{some[0]} to {some[-1]}" for some in OPEN)
        print(f"seeds {ranges} are open, others are sealed: give --sealed once, at the end")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        recorded = source == "recorded"
        kept = None if recorded else models or Path(folder)
        cases = [
            Case(seed=seed, kind=kind, craft=flown, models=kept, compare=compare)
            for seed in range(seeds[0], seeds[1] + 1)
            for kind, flown in [recorded_case_of(seed) if recorded else case_of(seed)]
            if craft in (None, flown.name) and (not only or {kind, group_of(kind)} & set(only))
        ]
        if size is not None:
            cases = [
                Case(seed=seed, kind=only[0], craft=of, models=kept, compare=compare, size=size)
                for seed in range(seeds[0], seeds[1] + 1)
                for of in EVERY_CRAFT
                if craft == of.name
            ]
        if not cases:
            print(f"no such set; aircraft are {', '.join(c.name for c in EVERY_CRAFT)}")
            return 2
        scores = list(shown_as_they_come(cases, jobs))
    scores.sort(key=lambda s: s.seed)
    print_tables(scores, Console(width=150))
    if json_file is not None:
        answer = {"summary": summary(scores), "sets": [s.to_json() for s in scores]}
        json_file.write_text(json.dumps(answer, indent=1), encoding="utf-8")
    return 0


def shown_as_they_come(cases: Sequence[Case], jobs: int) -> Iterator[Score]:
    columns = (TextColumn("data sets"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=len(cases))
        for one in score_all(cases, jobs):
            bar.advance(task)
            bar.console.print(line(one), highlight=False, markup=False, soft_wrap=True)
            yield one


def group_of(kind: str) -> str:
    from tests.lab.undeclared.conditions import (
        EVERY_OUTSIDE,
        INSTRUMENTS,
        MORE_SINGLE,
        SINGLE,
        THIRD_SINGLE,
    )

    groups = {
        "single": {**SINGLE, **MORE_SINGLE, **THIRD_SINGLE},
        "outside": EVERY_OUTSIDE,
        "instrument": INSTRUMENTS,
    }
    named = next((g for g, kinds in groups.items() if kind in kinds), kind)
    return "triple" if named == "mixed" else named


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
