"""Mutation score: breaks single places of the source on purpose and counts what fast tests notice.

    python tests/lab/mutation/mutate.py ROOM... [--sample N] [--seed S] [--list] [--only PART]

A room is a folder of source; its tests are the folder of the same name under tests/. For each
sampled place cosmic-ray makes one change in a copy of the tree, and the room's fast tests run until
one fails. The score is killed / (sampled - equivalent); what does the same is in equivalent.toml.
"""

# pyright: reportMissingImports=false
# cosmic-ray is in the extra `mutation`, which only this script needs.

from __future__ import annotations

import argparse
import ast
import compileall
import contextlib
import difflib
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from py_compile import PycInvalidationMode

import hypothesis  # noqa: F401  what tests import and no mutant changes is loaded once, here
import pytest
import scipy.optimize
import scipy.signal
import scipy.stats  # noqa: F401
from cosmic_ray.commands import init
from cosmic_ray.mutating import use_mutation
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec

ROOT = Path(__file__).resolve().parents[3]
ROOMS = ("models/physics", "models/model", "gcs_plugin/telemetry", "gcs_plugin/mavlink")
PACKAGES = ("models", "mission", "gcs_plugin")
LONGEST = 120.0  # s of processor time that the tests of one mutant may take
WAIT = 4.0  # times as long by the clock, for a machine that others use too

#: A change of one arithmetic sign to another, or of one bit sign to another. From one kind to the
#: other most only crash, which every test notices: they would make the score look better.
KINDS = (
    {"Add", "Sub", "Mul", "Div", "Pow"},
    {"Mul", "Div", "FloorDiv", "Mod"},
    {"BitOr", "BitAnd", "BitXor"},
    {"LShift", "RShift"},
)

Place = tuple[int, int]  # line from 1, column from 0


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("rooms", nargs="*", default=ROOMS, help=f"default: {' '.join(ROOMS)}")
    parser.add_argument(
        "--sample", type=int, default=60, help="mutants a room (0: one at each place)"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="only files whose path has this in it")
    parser.add_argument("--list", action="store_true", help="print the sample, run nothing")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="mutants") as folder:
        copy_tree(Path(folder))
        os.chdir(folder)
        os.environ |= {
            "PYTHONPATH": f"{folder}/.venv/links",
            "HYPOTHESIS_STORAGE_DIRECTORY": folder,
        }
        sys.path[:1] = [folder, f"{folder}/.venv/links"]
        rooms = [room.rstrip("/") for room in args.rooms]
        scores = [run_room(room, args.sample, args.seed, args.only, args.list) for room in rooms]
    print("\n".join(scores))


def copy_tree(folder: Path) -> None:
    """The source, the tests and the import name; recorded flights are linked, not copied."""
    for name in (*PACKAGES, "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("sitl_logs", "docs"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("pyproject.toml", "README.md", "constraints.txt"):
        shutil.copy(ROOT / name, folder / name)
    links = folder / ".venv" / "links" / "thrustmargin"
    links.mkdir(parents=True)
    (links / "__init__.py").symlink_to(folder / "gcs_plugin" / "api" / "__init__.py")
    for name in PACKAGES:
        (links / name).symlink_to(folder / name)
        # By the text, not by the time: two changes within one second are two.
        mode = PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(folder / name, quiet=1, invalidation_mode=mode)


def run_room(room: str, count: int, seed: int, only: str, list_only: bool) -> str:
    """Print the survivors of a room; returns its line of the score."""
    files = [p for p in sorted(Path(room).rglob("*.py")) if only in str(p)]
    sample = sampled(files, count, seed)
    if list_only:
        for item in sample:
            print(f"{item.module_path}:{item.start_pos[0]} {item.operator_name.partition('/')[2]}")
        return f"{room}: {len(sample)} mutants"
    start = time.monotonic()
    if not tests_pass(room, None, LONGEST):
        sys.exit(f"{room}: its tests fail without any mutant, or take over {LONGEST:.0f} s")
    alone = time.monotonic() - start
    with Path(__file__).with_name("equivalent.toml").open("rb") as file:
        same = {(e["file"], e["was"], e["now"]) for e in tomllib.load(file).get("equivalent", [])}
    survived = equivalent = 0
    for number, item in enumerate(sample, 1):
        operator = get_operator(item.operator_name)(**item.operator_args)
        with use_mutation(item.module_path, operator, item.occurrence) as (before, after):
            passed = tests_pass(room, item.module_path, min(LONGEST, 10.0 + 5.0 * alone))
        was, now = changed_lines(before, after or before)
        if not passed:
            print(f"{room} {number}/{len(sample)} killed", file=sys.stderr)
        elif (str(item.module_path), was, now) in same:
            equivalent += 1
        else:
            survived += 1
            where = f"{item.module_path}:{item.start_pos[0]}"
            print(f"{where} survived\n  - {was}\n  + {now}", flush=True)
    taken, real = time.monotonic() - start, len(sample) - equivalent
    return (
        f"{room}: {real - survived} of {real} killed, {(real - survived) / max(real, 1):.1%} "
        f"({equivalent} equivalent left out; tests {alone:.0f} s, all {taken:.0f} s, seed {seed})"
    )


def tests_pass(room: str, mutated: Path | None, longest: float) -> bool:
    """Whether the room's fast tests pass in `longest` s, those named after the file first.

    They run in a fork of this process, which has loaded the libraries but nothing of the source.
    """
    folder = Path("tests") / room
    named = folder / f"test_{mutated.stem}.py" if mutated else folder
    parts = [[str(named)], [str(folder), f"--ignore={named}"]] if named.is_file() else [[folder]]
    # What a number of the loop is, one page says: see the test of it.
    parts += [["tests/test_constants.py"]] * room.startswith("models/identification")
    marks = "not slow and not browser and not measured"
    child = os.fork()
    if child == 0:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (round(longest), round(longest)))
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        sys.dont_write_bytecode = True
        failed = 1
        with contextlib.suppress(BaseException):
            codes = (pytest.main(["-xq", "--tb=no", "-m", marks, *map(str, p)]) for p in parts)
            failed = any(code not in (0, pytest.ExitCode.NO_TESTS_COLLECTED) for code in codes)
        os._exit(failed)
    until = time.monotonic() + WAIT * longest
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        if time.monotonic() > until:
            break
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1] == 0


def sampled(files: list[Path], count: int, seed: int) -> list[MutationSpec]:
    """One change at each of `count` places drawn without return; the same for the same seed."""
    places: dict[tuple[str, Place], list[MutationSpec]] = defaultdict(list)
    idle = {path: list(idle_spans(path)) for path in files}
    with use_db("session.sqlite", WorkDB.Mode.create) as session:
        init(files, session, {})
        for work in session.work_items:
            (item,) = work.mutations
            if makes_sense(item) and not within(item.start_pos, idle[item.module_path]):
                places[str(item.module_path), item.start_pos].append(item)
    dice = random.Random(seed)
    drawn = sorted(places)
    if count and count < len(drawn):
        drawn = sorted(dice.sample(drawn, count))
    return [
        dice.choice(sorted(places[place], key=lambda m: (m.operator_name, m.occurrence)))
        for place in drawn
    ]


def makes_sense(item: MutationSpec) -> bool:
    """False for changes that only crash, or that are the same but for identity."""
    name = item.operator_name
    if "ReplaceBinaryOperator" in name:
        return any(set(name.split("_")[-2:]) <= kind for kind in KINDS)
    if "ReplaceComparisonOperator" in name:
        was, now = name.split("_")[-2:]
        return was.startswith("Is") == now.startswith("Is")
    return "ExceptionReplacer" not in name


def idle_spans(path: Path) -> Iterator[tuple[Place, Place]]:
    """From and to of what changes no result: annotations, decorators, `strict` of a zip."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        parts = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        parts += getattr(node, "decorator_list", [])
        if isinstance(node, ast.keyword) and node.arg == "strict":
            parts.append(node.value)
        for part in parts:
            if isinstance(part, ast.expr):
                end = part.end_lineno or part.lineno, part.end_col_offset or part.col_offset
                yield (part.lineno, part.col_offset - 1), end


def within(place: Place, spans: list[tuple[Place, Place]]) -> bool:
    return any(start <= place <= end for start, end in spans)


def changed_lines(before: str, after: str) -> tuple[str, str]:
    """The lines taken out and put in, joined by a space."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    was, now = (
        " ".join(line[1:].strip() for line in lines if line.startswith(f"{sign} ")) for sign in "-+"
    )
    return was, now


if __name__ == "__main__":
    main()
