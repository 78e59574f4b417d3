"""Score the residual loop on sealed random data sets: `python -m tests.undeclared.scorer`.

Example: python -m tests.undeclared.scorer --sets 100 --seed 1 --jobs 2 --json undeclared.json
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tests.undeclared.changes import NAMED
from tests.undeclared.datasets import CURVE_ONLY, KINDS, TRAINED_ONLY, build
from tests.undeclared.judging import Score, judge
from tests.undeclared.outside import OUTSIDE
from tests.undeclared.recorded import IMPLANTS, OUTSIDE_IMPLANTS, RECORDED_KINDS, build_recorded
from tests.undeclared.table import goals_met, print_table, summary
from tests.undeclared.truth import Base

#: One round: every named effect and every outside one once, more of nothing and of two at a time.
ROUND = (*["none"] * 5, *NAMED, CURVE_ONLY, *["two"] * 6, *OUTSIDE)
#: The same for changes put into recorded flights.
RECORDED_ROUND = (*["none"] * 4, *IMPLANTS, *OUTSIDE_IMPLANTS)
Source = Base | Literal["recorded"]
SLOW_START = "spawn"  # torch and forked threads do not mix


def round_of(source: Source | None) -> tuple[str, ...]:
    """One round of the kinds that a source can fly."""
    if source == "recorded":
        return RECORDED_ROUND
    if source == "trained":
        return tuple(kind for kind in ROUND if kind != CURVE_ONLY)
    if source == "curve":
        return tuple(kind for kind in ROUND if kind not in TRAINED_ONLY)
    return ROUND


def plan(sets: int, seed: int, kinds: Sequence[str] = ROUND) -> list[tuple[str, int]]:
    """(kind, seed) of each data set: whole rounds with every kind, then a random part of one."""
    rng = np.random.default_rng([seed, 3])
    order: list[str] = []
    while len(order) < sets:
        order.extend(kinds[int(i)] for i in rng.permutation(len(kinds)))
    return [(kind, 1000 * seed + i) for i, kind in enumerate(order[:sets])]


def score_one(kind: str, seed: int, source: Source | None, trained: Path | None) -> Score:
    """Build one data set, identify on its tracks alone, and judge the answer."""
    from tests.undeclared import subject

    if source == "recorded":
        data, model = build_recorded(kind, seed), subject.shipped()
    else:
        data = build(kind, seed, source)
        if data.base == "trained" and trained is not None:
            model = subject.load_base(trained)
        else:
            with tempfile.TemporaryDirectory() as folder:
                model = subject.curve_model(data.layout, Path(folder))
    start = time.perf_counter()
    result = subject.run_identify(
        model, [f.track for f in data.fit], [f.track for f in data.held_out]
    )
    return judge(data, result, time.perf_counter() - start)


def score_all(
    cases: Sequence[tuple[str, int]],
    *,
    source: Source | None = None,
    trained: Path | None = None,
    jobs: int = 1,
) -> Iterator[Score]:
    """Scores as they come, in any order when `jobs` is more than one."""
    if jobs == 1:
        for kind, seed in cases:
            yield score_one(kind, seed, source, trained)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context(SLOW_START)) as pool:
        waiting = [pool.submit(score_one, kind, seed, source, trained) for kind, seed in cases]
        for done in as_completed(waiting):
            yield done.result()


def score(
    sets: int,
    seed: int,
    *,
    only: Sequence[str] = (),
    source: Source | None = None,
    jobs: int = 1,
    tell: Callable[[Score], None] | None = None,
) -> list[Score]:
    """Score `sets` data sets; `tell` hears each score as it comes."""
    from tests.undeclared import subject

    cases = plan(sets, seed, tuple(only) or round_of(source))
    with tempfile.TemporaryDirectory() as folder:
        own = source in ("curve", "recorded")
        trained = None if own else subject.save_base(Path(folder))
        scores = []
        for one in score_all(cases, source=source, trained=trained, jobs=jobs):
            if tell is not None:
                tell(one)
            scores.append(one)
    return sorted(scores, key=lambda s: s.seed)


def main(
    sets: int = 100,
    seed: int = 1,
    only: tuple[str, ...] = (),
    source: Literal["plant", "curve", "trained", "recorded"] = "plant",
    jobs: int = 1,
    json_file: Path | None = None,
    verbose: bool = False,
) -> int:
    """Score the residual loop on sealed random data sets and print the table.

    Args:
        sets: How many data sets.
        seed: Of the draw; another seed gives other data sets.
        only: Only these kinds, for looking closer; never tune on sets that are scored.
        source: Flights of the plant against a model of either kind (plant), against the airframe's
            curve alone (curve) or a trained model (trained); or recorded flights against the
            shipped model (recorded).
        jobs: Processes.
        json_file: Where to write every score and the summary.
        verbose: Print a line for each data set.
    """
    kinds = RECORDED_KINDS if source == "recorded" else KINDS
    unknown = set(only) - set(kinds)
    if unknown:
        print(f"no kind {sorted(unknown)[0]!r}; there are: {', '.join(kinds)}")
        return 2
    console = Console(width=None if sys.stdout.isatty() else 120)
    chosen: Source | None = None if source == "plant" else source
    columns = (
        TextColumn("data sets"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=sets)

        def tell(one: Score) -> None:
            bar.advance(task)
            if verbose:
                bar.console.print(line(one), highlight=False, markup=False)

        scores = score(sets, seed, only=only, source=chosen, jobs=jobs, tell=tell)
    print_table(scores, console)
    if json_file is not None:
        answer: dict[str, Any] = {
            "seed": seed,
            "summary": summary(scores),
            "sets": [s.to_json() for s in scores],
        }
        json_file.write_text(json.dumps(answer, indent=1), encoding="utf-8")
    return 0 if all(goals_met(scores).values()) else 1


def line(one: Score) -> str:
    """One data set in one line."""
    asked = ", ".join(
        f"{name}{f' ({variant})' if variant else ''} {rpm:.0f} rpm: {verdict}"
        for (name, variant, rpm), verdict in zip(one.asked, one.verdicts, strict=True)
    )
    outside = f"outside {one.outside_rpm:.0f} rpm; " if one.outside_rpm else ""
    said = "says unexplained; " if one.says_unexplained else ""
    off = [
        f"{i.effect}.{i.parameter} {i.truth:.4g} not in {i.low:.4g}..{i.high:.4g}"
        for i in one.intervals
        if not i.covers
    ]
    return (
        f"{'ok ' if one.right else 'BAD'} {one.kind} seed {one.seed} {one.base}: "
        f"{outside}{said}asked [{asked}] reported [{', '.join(one.reported)}] "
        f"wrong [{', '.join(one.wrong)}] {'; '.join(off)} error x {one.ratio:.2f}, "
        f"{one.seconds:.1f} s"
    )


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
