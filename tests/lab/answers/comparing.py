"""Compare two folders of answers: what is the same is silent, what differs is named."""

from __future__ import annotations

import csv
import difflib
import gzip
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.lab.answers.asking import CONSOLE

#: Keys of JSON whose values are an answer in short.
SHORT = {"level", "headline", "verdict", "words", "level_name"}
MISSING = "(none)"
MOST = 40  # differences of one file that are listed; the others are counted


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that differs: the `file`, `where` in it (a JSON path, a line, a column), values.

    `brief` marks first lines, levels and headlines.
    """

    file: str
    where: str
    old: str
    new: str
    brief: bool = False

    def __str__(self) -> str:
        return f"{self.file}: {self.where}: {self.old} -> {self.new}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """All differences, and the numbers of files that were compared, that differ, and that lack."""

    differences: tuple[Difference, ...]
    files: int
    differing: int
    only_old: int
    only_new: int

    def lines(self, *, short: bool = False, most: int = MOST) -> Iterator[str]:
        """Yield a line for each difference (in `short` for first lines and levels alone), a sum."""
        shown: dict[str, int] = {}
        for one in self.differences:
            if short and not one.brief:
                continue
            shown[one.file] = shown.get(one.file, 0) + 1
            if shown[one.file] <= most:
                yield str(one)
        for file, count in shown.items():
            if count > most:
                yield f"{file}: {count - most} more"
        changed = len({Path(one.file).parent for one in self.differences if one.brief})
        yield (
            f"{self.files} files compared, {self.differing} differ, {self.only_old} only old, "
            f"{self.only_new} only new; first line or level of {changed} answers changed"
        )


def compare(old: Path, new: Path) -> Comparison:
    """Compare the answers in the folder `new` with those in `old`, byte by byte.

    Only commands that both folders hold are compared: a run may have been of a few.
    """
    commands = {p.name for p in old.iterdir()} & {p.name for p in new.iterdir()}
    names = [
        {
            p.relative_to(folder).as_posix()
            for command in commands
            for p in (folder / command).rglob("*")
            if p.is_file()
        }
        for folder in (old, new)
    ]
    differences: list[Difference] = []
    for name in sorted(names[0] | names[1]):
        if name not in names[1]:
            differences.append(Difference(name, "file", "there", MISSING))
        elif name not in names[0]:
            differences.append(Difference(name, "file", MISSING, "there"))
        elif (old / name).read_bytes() != (new / name).read_bytes():
            differences += file_differences(name, old / name, new / name)
    both = names[0] & names[1]
    return Comparison(
        differences=tuple(differences),
        files=len(both),
        differing=len({one.file for one in differences} & both),
        only_old=len(names[0] - names[1]),
        only_new=len(names[1] - names[0]),
    )


def file_differences(name: str, old: Path, new: Path) -> list[Difference]:
    """Return what differs between two versions of the file `name`; never empty."""
    texts = [_text(path) for path in (old, new)]
    found: list[Difference] = []
    if name.endswith((".json", ".geojson", ".plan")):
        found = list(_values(name, "", *(json.loads(text) for text in texts)))
    elif name.endswith(".csv.gz"):
        found = list(_columns(name, *texts))
    return found or list(_lines(name, *texts))


def _text(path: Path) -> str:
    data = path.read_bytes()
    return (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")


def _values(file: str, path: str, old: Any, new: Any) -> Iterator[Difference]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(k for k in new if k not in old)]:
            inner = f"{path}.{key}" if path else key
            yield from _values(file, inner, old.get(key, MISSING), new.get(key, MISSING))
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield Difference(file, f"{path}: length", str(len(old)), str(len(new)))
        for k, (one, other) in enumerate(zip(old, new, strict=False)):
            yield from _values(file, f"{path}[{k}]", one, other)
        for k in range(min(len(old), len(new)), max(len(old), len(new))):
            pair = (json_text(old[k]), MISSING) if k < len(old) else (MISSING, json_text(new[k]))
            yield Difference(file, f"{path}[{k}]", *pair)
    elif type(old) is not type(new) or (old != new and not (old != old and new != new)):
        brief = path.rsplit(".", 1)[-1] in SHORT
        yield Difference(file, path or "value", json_text(old), json_text(new), brief)


def json_text(value: Any) -> str:
    """Return a value as one line of JSON, cut where it is long."""
    text = value if value == MISSING else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 300 else f"{text[:300]}..."


def _columns(file: str, old: str, new: str) -> Iterator[Difference]:
    """Yield one difference a column: in how many rows, and the row in which it is largest."""
    tables = [list(csv.reader(io.StringIO(text))) for text in (old, new)]
    heads = [table[0] if table else [] for table in tables]
    if len(tables[0]) != len(tables[1]):
        yield Difference(file, "rows", str(len(tables[0]) - 1), str(len(tables[1]) - 1))
    for name in [*heads[0], *(n for n in heads[1] if n not in heads[0])]:
        if name not in heads[0] or name not in heads[1]:
            pair = (MISSING, "there") if name in heads[1] else ("there", MISSING)
            yield Difference(file, f"column {name}", *pair)
            continue
        at = [head.index(name) for head in heads]
        pairs = [
            (k, one[at[0]], other[at[1]])
            for k, (one, other) in enumerate(zip(*(t[1:] for t in tables), strict=False), 1)
            if one[at[0]] != other[at[1]]
        ]
        if pairs:
            row, one, other = max(pairs, key=lambda pair: _apart(pair[1], pair[2]))
            where = f"column {name}: {len(pairs)} rows, most in row {row}"
            yield Difference(file, where, one or MISSING, other or MISSING)


def _apart(old: str, new: str) -> float:
    """Return how far apart two cells are; infinite where one is no number."""
    try:
        return abs(float(old) - float(new))
    except ValueError:
        return float("inf")


def _lines(file: str, old: str, new: str) -> Iterator[Difference]:
    before, after = old.splitlines(), new.splitlines()
    console = file.endswith(CONSOLE)
    matched = difflib.SequenceMatcher(None, before, after, autojunk=False)
    for what, i0, i1, j0, j1 in matched.get_opcodes():
        if what == "equal":
            continue
        for k in range(max(i1 - i0, j1 - j0)):
            was = before[i0 + k] if i0 + k < i1 else MISSING
            now = after[j0 + k] if j0 + k < j1 else MISSING
            # The first line is the command; the next is what is read first, the last how it ended.
            brief = console and (
                min(i0, j0) + k <= 1 or {was[:9], now[:9]} & {"--- exit ", "--- trace", "--- hung "}
            )
            yield Difference(file, f"line {j0 + k + 1}", was, now, bool(brief))
    if before == after:
        yield Difference(file, "bytes", "differ", "where no line does")
