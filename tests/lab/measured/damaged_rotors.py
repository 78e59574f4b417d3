"""Real flights with a damaged propeller, named or not by the public commands with default settings.

crazypad_flights: github.com/AerialRoboticsUUST/CrazyPAD, commit 5448265, MIT; Masalimov et al.,
Data 2024, 9, 79. CSV files `CONDITION__CRAFT_logNN.csv` of a 33 g quad whose rotor speeds follow
from commands; the logs of one condition and craft are one session. `normal_flight` is healthy.

cut_propeller_quad: github.com/srikanthgoli1/rrc_fault_tolerant_control, no licence stated.
ArduCopter logs of motor outputs only: `good_prop_...`, `10_mm_cut_...`; the cut propeller is on
motor 1. Each log is taken by itself.

A model is learnt from healthy flights; a healthy session or log that is judged is not among them.
"""

from __future__ import annotations

import re
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.public_runs import Answer, Run, identify, run
from thrustmargin.models.errors import DataError

SESSIONS, LOGS = "crazypad_flights", "cut_propeller_quad"
LOG = re.compile(r"(?P<condition>.+)__(?P<craft>E\d+)_log(?P<number>\d+)\.csv")
HEALTHY = "normal_flight"
CUT = re.compile(r"(?P<cut>\d+)_mm_cut_|good_prop_")
CUT_ROTOR = 1
#: of the quad, as docs/your-aircraft.md has it: mass and arm are assumed, for no source states them
QUAD = (
    *("--mass", "1.5", "--arm", "0.225", "--tank-litres", "0", "--propeller", "10x4.5"),
    *("--max-thrust-kgf", "0.8", "--cells", "3"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One session: which rotors are damaged and what was said of it."""

    name: str
    damaged: frozenset[int]  # from 1, empty on a healthy aircraft
    answer: Answer

    @property
    def verdict(self) -> str:
        """`named`, `listed` and `pointed` are right; `wrong` and `false` are not; `missed`;
        `refused`."""
        said = self.answer
        if not said.result:
            return "traceback" if said.run.traceback else f"refused: {said.run.refusal}"
        if not self.damaged:
            return "false" if said.effects or said.pointed else "nothing"
        if not self.damaged.issuperset(said.named):
            return "wrong"
        if said.named:
            return "named"
        if self.damaged & set(said.listed):
            return "listed"
        return "pointed" if self.damaged & set(said.pointed) else "missed"


def find_sessions(folder: Path) -> Finding:
    """Each session of crazypad_flights against a model of the craft's healthy flights."""
    with tempfile.TemporaryDirectory() as place:
        judged = judge_sessions(folder, Path(place))
    single = [j for j in judged if j.damaged == {3}]
    return _finding(
        SESSIONS,
        "Damaged rotors of a 33 g quad, by session",
        judged,
        (
            Number("sessions_rotor_3", len(single)),
            Number("named_rotor_3", sum(j.verdict == "named" for j in single)),
            Number("listed_rotor_3", sum(j.verdict == "listed" for j in single)),
        ),
    )


def judge_sessions(folder: Path, place: Path) -> list[Judged]:
    """Healthy logs first, each against a model of the craft's others; then the sessions.

    Files are made in `place`. Raises DataError when the folder has no healthy log.
    """
    sessions: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for path in sorted(folder.glob("*.csv")):
        if match := LOG.fullmatch(path.name):
            sessions[match["craft"], match["condition"]].append(path)
    crafts = sorted({craft for craft, condition in sessions if condition == HEALTHY})
    if not crafts:
        raise DataError(f"{folder} has no file {HEALTHY}__*.csv to learn a model from")
    airframe = folder / "crazypad.toml"
    judged: list[Judged] = []
    for craft in crafts:
        good = sessions[craft, HEALTHY]
        for log in good:
            others = _learnt([g for g in good if g != log], airframe, place / f"{log.stem}.st")
            judged.append(_judged(log.stem, (), [log], others, place))
        model = _learnt(good, airframe, place / f"{craft}.st")
        for (of, condition), logs in sorted(sessions.items()):
            if of == craft and condition != HEALTHY:
                name = f"{craft} {condition}"
                judged.append(_judged(name, _rotors(condition), logs, model, place))
    return judged


def find_logs(folder: Path) -> Finding:
    """Each log of cut_propeller_quad against a model of the flights with whole propellers."""
    with tempfile.TemporaryDirectory() as place:
        judged = judge_logs(folder, Path(place))
    deep = [j for j in judged if _cut(j.name) >= 20]
    return _finding(
        LOGS,
        "A quad with one propeller cut, motor outputs only, by log",
        judged,
        (
            Number("logs_20_mm_or_more", len(deep)),
            Number("named_20_mm_or_more", sum(j.verdict == "named" for j in deep)),
        ),
    )


def judge_logs(folder: Path, place: Path) -> list[Judged]:
    """Whole propellers first, each log against a model of the others; then each cut log."""
    logs = sorted(path for path in folder.glob("*.BIN") if CUT.match(path.name))
    good = [log for log in logs if not _cut(log.name)]
    hover = [log for log in good if "hover" in log.name]
    if len(good) < 2 or not hover:
        raise DataError(
            f"{folder} has {len(good)} logs good_prop_*.BIN; a hover and two are needed"
        )
    airframe = place / "quad.toml"
    made = run("airframe", "new", "--hover", *hover, *QUAD, "--out", airframe)
    if made.code:
        raise DataError(f"{folder}: airframe new: {made.refusal}")
    judged: list[Judged] = []
    for log in good:
        others = _learnt([g for g in good if g != log], airframe, place / f"{log.stem}.st")
        judged.append(_judged(log.stem, (), [log], others, place))
    model = _learnt(good, airframe, place / "good.st")
    for log in sorted(set(logs) - set(good), key=lambda log: (_cut(log.name), log.name)):
        judged.append(_judged(log.stem, (CUT_ROTOR,), [log], model, place))
    return judged


def _cut(name: str) -> int:
    """mm that the propeller lacks, 0 when it is whole."""
    match = CUT.match(name)
    return int(match["cut"] or 0) if match else 0


def _rotors(condition: str) -> tuple[int, ...]:
    """Rotors that a condition names: M3, or M1 and M2."""
    return tuple(sorted({int(n) for n in re.findall(r"M(\d)", condition, re.IGNORECASE)}))


def _learnt(good: Sequence[Path], airframe: Path, out: Path) -> Path | Run:
    """The model file of good flights, by `train`; what that said where there is none."""
    out = out.with_suffix(".safetensors")
    done = run("train", *good, "--airframe", airframe, "--out", out, "--force")
    return done if done.code else out


def _judged(
    name: str, damaged: Iterable[int], logs: Sequence[Path], model: Path | Run, place: Path
) -> Judged:
    if isinstance(model, Run):
        answer = Answer(run=model)
    else:
        answer = identify(logs, "--model", model, into=place)
    return Judged(name=name, damaged=frozenset(damaged), answer=answer)


def _finding(name: str, title: str, judged: Sequence[Judged], first: Sequence[Number]) -> Finding:
    sick = [j for j in judged if j.damaged]
    seconds = sum(j.answer.run.seconds for j in judged)

    def count(verdict: str, of: Sequence[Judged] = judged) -> int:
        return sum(j.verdict.startswith(verdict) for j in of)

    return Finding(
        name=name,
        title=title,
        numbers=(
            *first,
            Number("damaged", len(sick)),
            Number("named_right", count("named")),
            Number("listed_right", count("listed")),
            Number("pointed_right", count("pointed")),
            Number("missed", count("missed")),
            Number("wrong_rotor", count("wrong"), "1", 0, "at most"),
            Number("healthy", len(judged) - len(sick)),
            Number("named_on_healthy", count("false"), "1", 0, "at most"),
            Number("refused", count("refused"), "1", 0, "at most"),
            Number("tracebacks", count("traceback"), "1", 0, "at most"),
            Number("seconds", seconds, "s"),
        ),
        notes=tuple(_line(j) for j in judged),
        details={"sessions": [_details(j) for j in judged]},
    )


def _line(one: Judged) -> str:
    said = one.answer
    parts = [", ".join(said.effects) or "nothing named"]
    if said.listed:
        parts.append(f"rotor {', '.join(map(str, said.listed))} listed")
    if said.pointed:
        parts.append(f"look first at rotor {', '.join(map(str, said.pointed))}")
    parts.append(f"{said.error('before'):.0f} -> {said.error('after'):.0f} rpm")
    return f"{one.name}: {one.verdict}: {'; '.join(parts)}"


def _details(one: Judged) -> Mapping[str, object]:
    said = one.answer
    return {
        "name": one.name,
        "damaged": sorted(one.damaged),
        "verdict": one.verdict,
        "effects": list(said.effects),
        "listed": list(said.listed),
        "pointed": list(said.pointed),
        "seconds": said.run.seconds,
    }
