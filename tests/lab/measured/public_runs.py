"""The program's commands on measured flights, run as a user runs them, with default settings."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PROGRAM = (sys.executable, "-m", "thrustmargin.gcs_plugin.cli")
LIMIT = 900.0  # s that one command may take


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one command did."""

    words: tuple[str, ...]  # the command as typed
    code: int  # its exit code
    seconds: float
    output: str
    errors: str

    @property
    def traceback(self) -> bool:
        return "Traceback (most recent call last)" in self.errors

    @property
    def refusal(self) -> str:
        """The last line of what a command that failed has to say; empty when it did not."""
        lines = self.errors.strip().splitlines()
        return lines[-1] if self.code and lines else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What `identify` says of the rotors of one session; rotors are numbered from 1."""

    run: Run
    named: tuple[int, ...] = ()  # rotors that make less thrust, by name
    listed: tuple[int, ...] = ()  # rotors that are not named but mentioned
    #: rotors to look at first, where no effect explains an error beyond that of sound flights
    pointed: tuple[int, ...] = ()
    effects: tuple[str, ...] = ()  # everything that is named
    result: dict[str, Any] = field(default_factory=dict)  # the whole JSON

    def value(self, effect: str, parameter: str) -> float:
        """A parameter of a named effect; NaN where it is not named."""
        for one in self.result.get("effects", ()):
            if one["name"] == effect:
                return float(one["parameters"][parameter]["value"])
        return float("nan")

    def error(self, when: str) -> float:
        """RMSE in rpm `before` or `after`; NaN without an answer."""
        return float(self.result.get(when, {}).get("rmse_rpm", "nan"))


def run(*words: str | Path) -> Run:
    """One command of the program, without its own name."""
    typed = tuple(str(word) for word in words)
    start = time.monotonic()
    done = subprocess.run(
        [*PROGRAM, *typed], capture_output=True, text=True, timeout=LIMIT, check=False
    )
    return Run(
        words=typed,
        code=done.returncode,
        seconds=time.monotonic() - start,
        output=done.stdout,
        errors=done.stderr,
    )


def identify(logs: Sequence[Path], *options: str | Path, into: Path) -> Answer:
    """`identify LOG... OPTIONS --json FILE`, with the file in the folder `into`."""
    target = into / f"{logs[0].stem}-{len(logs)}.json"
    target.unlink(missing_ok=True)
    done = run("identify", *logs, *options, "--json", target)
    if not target.exists():
        return Answer(run=done)
    result = json.loads(target.read_text(encoding="utf-8"))
    named = _rotors(result.get("effects", ()))
    groups = [one["effects"] for one in result.get("one_of", ())]
    single = (*result.get("mentioned", ()), *result.get("possible", ()))
    listed = {*_rotors([*single, *(e for group in groups for e in group)])} - {*named}
    return Answer(
        run=done,
        named=named,
        listed=tuple(sorted(listed)),
        pointed=tuple((result.get("excess_error") or {}).get("rotors", ())),
        effects=tuple(_words(one) for one in result.get("effects", ())),
        result=result,
    )


def _rotors(effects: Sequence[Any]) -> tuple[int, ...]:
    """Rotors of the losses among `effects`, which are objects or their names alone."""
    return tuple(
        sorted(
            int(one["rotor"])
            for one in effects
            if isinstance(one, dict)
            and one.get("rotor")
            and one.get("name", "rotor_degradation") == "rotor_degradation"
        )
    )


def _words(effect: dict[str, Any]) -> str:
    return effect["name"] + (f" {effect['rotor']}" if effect.get("rotor") else "")
