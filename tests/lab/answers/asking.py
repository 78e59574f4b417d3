"""Put questions to the commands of one source tree and store what they answer.

Each is asked in a process forked from one that has loaded everything: as quick as in one process,
and nothing that a command changes reaches the next. What is no answer is taken out of it: today's
date, the version, how long it took, and where the files were.
"""

from __future__ import annotations

import csv
import dataclasses
import enum
import gzip
import io
import json
import math
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tests.lab.answers.questions import OUT, ROOT, STORE, Question

CONSOLE = "console.txt"
LONGEST_S = 600.0  # after that a command is ended, and its answer is that it hung
WIDTH = 160  # columns of the console
#: Keys of JSON, and columns of tables, that hold when or by what an answer was made, or how fast.
NO_ANSWER = {
    *("made_utc", "version", "ingested_utc", "made_at", "read_s", "seconds_taken", "elapsed_s"),
    *("sha256", "software", "created", "created_utc", "generated", "generator"),
}
#: The same, of one file alone: how long it took is named as what a flight takes elsewhere.
NO_ANSWER_OF = {"learn.json": "seconds"}


def ask_all(questions: Sequence[Question], out: Path) -> None:
    """Ask all `questions` and store their answers below `out`; prints one line for each command."""
    _warm_up()
    asked: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory(prefix="answers_") as folder:
        for question in questions:
            began = time.monotonic()
            ask(question, out, Path(folder))
            asked[question.command].append(time.monotonic() - began)
            if sys.stdout.isatty():
                shown = f"{question.command} {question.label}"[: WIDTH // 2].ljust(WIDTH // 2)
                print(shown, end="\r", flush=True)
    for command, seconds in asked.items():
        print(f"{command}: {len(seconds)} answers in {sum(seconds):.0f} s")


def ask(question: Question, out: Path, folder: Path) -> None:
    """Ask one question in a forked process and store the answer below `out`.

    `folder` holds what lasts from one question to the next: the store of a season.
    """
    place = out / question.command / question.label
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    work = Path(tempfile.mkdtemp(dir=folder))
    store = folder / "store"
    argv = [w.replace(OUT, str(work)).replace(STORE, str(store)) for w in question.argv]
    said, wrong = folder / "stdout", folder / "stderr"
    ended = _forked(argv, said, wrong, work)
    secret = {str(work): "OUT", str(store): "STORE", str(ROOT): "ROOT", work.name: "OUT"}
    words = [w.replace(OUT, "OUT").replace(STORE, "STORE") for w in question.argv]
    text = f"$ thrustmargin {' '.join(words)}\n{_read(said)}"
    complaint = _read(wrong)
    text += f"--- stderr\n{complaint}" if complaint else ""
    text += f"--- {ended}\n"
    (place / CONSOLE).write_text(plain(text, secret), encoding="utf-8")
    for pattern in ("replay.json", *question.kept):
        for path in sorted(work.glob(pattern)):
            _store(path, place, secret)
    shutil.rmtree(work)


def plain(text: str, secret: dict[str, str]) -> str:
    """Return `text` without paths of this run (`secret`: each by its name), dates and durations."""
    text = text.replace(f"trained {datetime.now(UTC):%Y-%m-%d}", "trained TODAY")
    for path, name in secret.items():
        text = text.replace(path, name)
    text = re.sub(r"\b(recording to OUT/)\S+?(?=:)", r"\1WHEN", text)
    text = re.sub(r"answers_\w+", "FOLDER", text)
    return re.sub(r"\b(in|took|after) [\d.,]+ m?s of (?:a core|processor)\b", r"\1 a while", text)


def without_moments(value: Any) -> Any:
    """Return a JSON value without the keys that hold no answer, at any depth."""
    if isinstance(value, dict):
        return {k: without_moments(v) for k, v in value.items() if k not in NO_ANSWER}
    return [without_moments(v) for v in value] if isinstance(value, list) else value


def _store(path: Path, place: Path, secret: dict[str, str]) -> None:
    """Store a written file as text that two runs have in common; tables are packed."""
    if path.suffix == ".mcap":
        told = json.dumps(mcap_sums(path), indent=1)
        (place / "mcap_sums.json").write_text(told, encoding="utf-8")
        return
    text = plain(path.read_text(encoding="utf-8", errors="replace"), secret)
    if path.suffix == ".csv":
        with gzip.GzipFile(place / f"{path.name}.gz", "wb", 3, mtime=0) as packed:
            packed.write(_table_without_moments(text).encode())
        return
    if path.suffix in {".json", ".geojson", ".plan"}:
        value = without_moments(json.loads(text))
        if path.name in NO_ANSWER_OF:
            value.pop(NO_ANSWER_OF[path.name], None)
        text = json.dumps(value, indent=1, ensure_ascii=False)
    (place / path.name).write_text(text, encoding="utf-8")


def _table_without_moments(text: str) -> str:
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or not NO_ANSWER & set(rows[0]):
        return text
    kept = [k for k, name in enumerate(rows[0]) if name not in NO_ANSWER]
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([row[k] for k in kept] for row in rows)
    return table.getvalue()


def mcap_sums(path: Path) -> dict[str, Any]:
    """Return, for each topic of an MCAP file, its messages, and of each number count and sums."""
    from mcap.reader import make_reader

    sums: dict[str, Any] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            topic = sums.setdefault(channel.topic, {"messages": 0, "numbers": {}, "words": {}})
            topic["messages"] += 1
            _add(topic, "", json.loads(message.data))
    return sums


def _add(topic: dict[str, Any], name: str, value: Any) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _add(topic, f"{name}.{key}", inner)
    elif isinstance(value, list):
        for inner in value:
            _add(topic, f"{name}[]", inner)
    elif isinstance(value, str):
        if value:
            topic["words"].setdefault(name, {}).setdefault(value, 0)
            topic["words"][name][value] += 1
    elif value is not None:
        count, total, least, most = topic["numbers"].get(name, (0, 0.0, math.inf, -math.inf))
        grown = (count + 1, total + value, min(least, value), max(most, value))
        topic["numbers"][name] = grown


def as_data(value: Any) -> Any:
    """Return a value of frozen dataclasses, enumerations and arrays as JSON has it."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: as_data(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, dict):
        return {str(k): as_data(v) for k, v in value.items()}
    if isinstance(value, tuple | list | np.ndarray):
        return [as_data(v) for v in value]
    if isinstance(value, np.generic):
        return as_data(value.item())
    return value if isinstance(value, str | int | float | bool | None) else repr(type(value))


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _warm_up() -> None:
    """Load what nearly every command needs, before processes are forked."""
    os.environ["COLUMNS"] = str(WIDTH)
    sys.path_importer_cache.clear()
    from thrustmargin.gcs_plugin.cli import run

    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nowhere:
        streams = sys.stdout, sys.stderr
        sys.stdout = sys.stderr = nowhere
        try:
            run(["report", "demo", "--json", f"{folder}/warm.json"])
        finally:
            sys.stdout, sys.stderr = streams


def _forked(argv: list[str], said: Path, wrong: Path, work: Path) -> str:
    """Run a command line in a forked process with its output in files; return how it ended."""
    sys.stdout.flush()
    process = os.fork()
    if process == 0:
        code = 70
        try:
            for path, number in ((said, 1), (wrong, 2)):
                os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.chdir(work)
            code = _run(argv, work)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return f"exit {code}" if code != 70 else "traceback"
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return f"hung for {LONGEST_S:.0f} s"


def _run(argv: list[str], work: Path) -> int:
    """Run a command in this process; return its exit code, 70 with a traceback."""
    from thrustmargin.gcs_plugin.cli import run

    try:
        if argv[0] == "replay":
            _replay_without_a_page(work)
        return run(argv)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        # Without places in the source: a line that moved is no other answer.
        print(traceback.format_exc(limit=0), file=sys.stderr)
        return 70


def _replay_without_a_page(work: Path) -> None:
    """Let `replay` write the answer that its page would show, instead of serving the page."""
    from thrustmargin.gcs_plugin.view import replay_view

    def write(view: Any, **_: object) -> None:
        whole = getattr(view, "whole", None)  # as the page has it, of the whole flight
        (work / "replay.json").write_text(json.dumps(as_data(whole), indent=1))

    replay_view.run_replay = write
