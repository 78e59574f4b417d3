"""Plans and fields that are made to break a reader: `python -m tests.lab.plans.hostile`.

Each is given to the commands that read such a file. What counts: one line and an exit code, or an
answer, within 2 s of the processor beyond what the command takes for its help. Rows that do not
hold are marked.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.lab.plans.hostile_fields import fields
from tests.lab.plans.hostile_plans import plans

MOST_S = 2.0
FORECAST = ("--fill", "10", "--flow", "2", "--airframe", "topxgun-f16-sitl")
TRACEBACK = "Traceback"
WGS84 = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'
)


def commands(file: Path, flight: Path) -> Iterator[tuple[str, list[str]]]:
    """The commands that read a file of its kind."""
    name = str(file)
    if file.parent.name == "fields":
        yield (
            "cover",
            [
                "cover",
                name,
                "--swath",
                "5",
                "-o",
                str(file.parent / "out.plan"),
            ],
        )
        return
    yield "forecast", ["forecast", name, *FORECAST]
    yield (
        "report --plan",
        ["report", str(flight), "--plan", name, "--out", str(file.parent / "out.html")],
    )
    yield "monitor --plan", ["monitor", str(flight), "--speed", "1000", "--plan", name]


def run(line: list[str], most_s: float) -> tuple[float, int | None, str]:
    """s of the processor, exit code (None: was ended) and all that was printed."""
    begun = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", "from thrustmargin.gcs_plugin.cli import main; main()", *line]
    try:
        made = subprocess.run(command, capture_output=True, text=True, timeout=most_s, check=False)
    except subprocess.TimeoutExpired:
        return most_s, None, ""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime
    return took, made.returncode, made.stdout + made.stderr


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("folder", type=Path)
    asked.add_argument("--only", default="")
    asked.add_argument("--command", default="")
    asked.add_argument("--flight", type=Path, default=Path("sitl_logs/campaign/v4_m4_q3.5.tlog"))
    given = asked.parse_args()
    makers: dict[str, Callable[[], Iterator[tuple[str, str | bytes]]]] = {
        "plans": plans,
        "fields": fields,
    }
    bare: dict[str, float] = {}
    for kind, maker in makers.items():
        folder = given.folder / kind
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in maker():
            if given.only not in f"{kind}/{name}":
                continue
            file = folder / name
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
            if file.suffix == ".shp":
                file.with_suffix(".prj").write_text(WGS84)
            for command, line in commands(file, given.flight):
                if given.command not in command:
                    continue
                word = line[0]
                bare.setdefault(word, min(run([word, "--help"], 60.0)[0] for _ in range(3)))
                took, code, printed = run(line, 60.0)
                lines = [one for one in printed.splitlines() if one.strip()]
                bad = [
                    *(["SLOW"] if took > bare[word] + MOST_S else []),
                    *(["CRASH"] if TRACEBACK in printed or code not in (0, 1, 2) else []),
                    *(["LINES"] if code != 0 and len(lines) != 1 else []),
                ]
                first = lines[0] if lines else ""
                print(
                    f"{' '.join(bad):12} {took:5.1f} s  {code} {command:14} {name:28} {first:.170}",
                    flush=True,
                )
            file.unlink()


if __name__ == "__main__":
    main()
