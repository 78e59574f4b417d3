"""Count the files that a reader opens to follow a datum: `python -m tests.lab.walks`.

A command runs under a profiler until a function is called that ends the way, such as the one that
colours a row. Code that runs at import is not counted. Of the files with a function that ran:

- `ran`: all;
- `way`: those with a function that returns one of the types that the datum passes through, by its
  annotation, and the command itself: there the datum gets its next form;
- `climbs`: files that files of lower rooms call back, for which a reader goes back up.

`--list` names the files of the way.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import re
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from tests.import_graph import ROOT, module_graph, modules, nodes, room
from thrustmargin.gcs_plugin import cli

LOGS = ROOT / "sitl_logs"
SIX = [LOGS / f"dev/worn_prop_{k}.tlog" for k in (1, 2, 3)] + [
    LOGS / f"dev/extra_mass_{k}.tlog" for k in (1, 2, 3)
]
PLAN = (
    "QGC WPL 110\n"
    "0 1 0 16 0 0 0 0 47.0 8.0 400 1\n"
    "1 0 3 22 0 0 0 0 47.0 8.0 4 1\n"
    "2 0 3 16 0 0 0 0 47.0005 8.0 4 1\n"
    "3 0 3 16 0 0 0 0 47.0005 8.0002 4 1\n"
    "4 0 3 16 0 0 0 0 47.0 8.0002 4 1\n"
    "5 0 3 20 0 0 0 0 0 0 0 1\n"
).replace(" ", "\t")
PLAN = PLAN.replace("QGC\tWPL\t110", "QGC WPL 110")
#: Types that a datum passes through, by way: those of docs/architecture.md and of their steps.
ROWS = "Stream Signal Signals Recording FlightLog FlightRows FlightTrack"
MODEL = "Prediction FlightAnalysis Advice Advised"
#: Way -> the command line, the function at its end ("": the command's), types, and the aim.
WAYS: dict[str, tuple[tuple[str, ...], str, str, int]] = {
    "plan -> forecast": (
        ("forecast", "{plan}", "--fill", "8"),
        "",
        "MissionPlan PlanSteps Course TimedLeg WayLeg PlanConditions PlanFlight PlanForecast "
        f"{MODEL}",
        25,
    ),
    "frame -> colour": (
        ("monitor", str(LOGS / "campaign/v4_m16_q2.5.tlog"), "--port", "0", "--record", "{out}"),
        "gcs_plugin.view.scene.aircraft:show",
        f"Frame Signal Signals FlightRows LiveRows FlightTrack {MODEL} Update ShownRow Colours",
        20,
    ),
    "log -> report": (
        ("report", str(LOGS / "campaign/v4_m16_q2.5.tlog"), "--out", "{out}/x.html"),
        "",
        f"{ROWS} {MODEL} LogAnswer ReportedFlight",
        22,
    ),
    "six logs -> effect": (
        ("identify", *map(str, SIX)),
        "",
        "FlightTrack Problem Reduced Search Posterior EffectSet AcceptedEffects Identification "
        "ReportedEffect Result",
        20,
    ),
}


class Trace:
    """The calls between files of the project, from a command to the end of its way."""

    def __init__(self, end: str) -> None:
        self.calls: set[tuple[str, str]] = set()
        self.ran: set[tuple[str, int]] = set()  # file and first line of each function
        self.done = threading.Event()
        self._end = end
        self._files = {str(path): name for name, path in modules().items()}
        self._names: dict[str, str | None] = {}

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        if event != "call" or self.done.is_set():
            return
        called = self._module(frame)
        if called is None or frame.f_code.co_name == "<module>":
            return
        caller, at = None, frame.f_back
        while at is not None and caller is None:
            if at.f_code.co_name == "<module>" and self._module(at) is not None:
                return  # at import
            caller, at = self._module(at), at.f_back
        self.ran.add((called, frame.f_code.co_firstlineno))
        if caller is not None and caller != called:
            self.calls.add((caller, called))
        if f"{called}:{frame.f_code.co_name}" == self._end:
            self.done.set()

    def _module(self, frame: FrameType) -> str | None:
        name = frame.f_code.co_filename
        if name not in self._names:
            self._names[name] = self._files.get(str(Path(name).resolve()))
        return self._names[name]


def traced(argv: list[str], end: str) -> Trace:
    """Run a command line until it ends, or until the function `end` was called."""
    trace = Trace(end)
    command: Callable[[list[str]], Any] = cli.main
    if end:
        threading.Thread(target=_interrupt, args=(trace.done,), daemon=True).start()
    threading.setprofile(trace)
    sys.setprofile(trace)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            command(argv)
    except SystemExit as ended:
        if ended.code and not trace.done.is_set():
            raise
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return trace


def upward() -> set[tuple[str, str]]:
    """Return pairs of rooms of which the second imports the first, directly or by others."""
    graph = module_graph()
    above: dict[str, set[str]] = {}
    for name, targets in graph.items():
        for target in targets:
            if room(target) != room(name):
                above.setdefault(room(target), set()).add(room(name))
    pairs = {(low, high) for low, rooms in above.items() for high in rooms}
    while True:
        more = {(a, d) for a, b in pairs for c, d in pairs if b == c} - pairs
        if not more:
            return pairs
        pairs |= more


def main() -> None:
    """Walk each way in a process of this program's own order and print its row."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.walks", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=WAYS, help="one way")
    parser.add_argument("--list", action="store_true", help="name the files of the way")
    options = parser.parse_args()
    pairs = upward()
    print("| way | ran | on the way | aim | climbs |\n|---|---|---|---|---|")
    for way in [options.only] if options.only else WAYS:
        argv, end, types, aim = WAYS[way]
        with tempfile.TemporaryDirectory() as folder:
            plan = Path(folder) / "field.waypoints"
            plan.write_text(PLAN)
            given = {"{out}": folder, "{plan}": str(plan)}
            for word, value in given.items():
                argv = tuple(one.replace(word, value) for one in argv)
            trace = traced(list(argv), end)
        if end and not trace.done.is_set():
            raise SystemExit(f"{way}: {end} was not called")
        ran = {name for name, _ in trace.ran}
        on_way = {name for name in ran if name.endswith(f".{argv[0]}")}
        on_way |= {name for name, line in trace.ran if line in handing_on(name, types)}
        climbs = {b for a, b in trace.calls if a in on_way and (room(a), room(b)) in pairs}
        print(f"| {way} | {len(ran)} | {len(on_way)} | {aim} | {len(climbs)} |")
        if options.list:
            print(*sorted(on_way), *(f"^ {name}" for name in sorted(climbs)), sep="\n")


def handing_on(module: str, types: str) -> set[int]:
    """Return the first lines of a module's functions whose return annotation names a type."""
    names = set(types.split())
    return {
        min([node.lineno, *(one.lineno for one in node.decorator_list)])
        for node in nodes(modules()[module])
        if isinstance(node, ast.FunctionDef) and node.returns is not None
        if names & set(re.findall(r"\w+", ast.unparse(node.returns)))
    }


def _interrupt(done: threading.Event) -> None:
    import _thread

    done.wait()
    _thread.interrupt_main()


if __name__ == "__main__":
    main()
