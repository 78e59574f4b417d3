"""What this program finds on a folder of measured data: `python -m tests.lab.measured FOLDER`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from json import dumps
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.study import Study, study
from thrustmargin.models.errors import ThrustMarginError

WIDTH = 110


def main(
    folder: Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]],
    *,
    only: tuple[str, ...] = (),
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    out: Path | None = None,
) -> int:
    """Check this program on measured data: real flights with rotor speeds, benches, wind tunnel.

    Prints every number beside what an independent check or the source has for it, and whether it
    reaches that. Ends with 1 when a data set is missing or damaged.

    Args:
        folder: Folder with one subfolder for each data set (docs/measured.md).
        only: Names of the data sets to look at; without it all.
        json: All numbers as JSON instead of a table.
        out: File to write to instead of the screen.
    """
    errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    try:
        with Progress(console=errors, transient=True) as bar:
            task = bar.add_task("reading", total=1.0)
            found = study(
                folder,
                only=only,
                progress=lambda what, share: bar.update(task, description=what, completed=share),
            )
    except ThrustMarginError as error:
        errors.print(error)
        return 1
    with ExitStack() as files:
        to = sys.stdout if out is None else files.enter_context(out.open("w", encoding="utf-8"))
        if json:
            to.write(dumps(found.to_json(), ensure_ascii=False, allow_nan=False, indent=1) + "\n")
        else:
            show(found, Console(file=to, highlight=False, markup=False, width=WIDTH))
    for missing in found.missing:
        errors.print(f"not used: {missing.name}: {missing.why}")
    return 1 if found.missing else 0


def show(found: Study, console: Console) -> None:
    """Every number, beside what is quoted for it, and what was left out."""
    for finding in found.findings:
        console.print(_table(finding))
        for note in finding.notes:
            console.print(f"  note: {note}", soft_wrap=True)


def _table(finding: Finding) -> Table:
    title = f"{finding.title} ({finding.name})"
    columns = ("number", "found", "quoted", "")
    table = Table(*columns, box=box.SIMPLE_HEAD, title=title, title_justify="left")
    for number in finding.numbers:
        verdict = {None: "", True: "reached", False: "NOT reached"}[number.met]
        cells = (number.label or number.name.replace("_", " "), _shown(number, number.value))
        table.add_row(*map(Text, (*cells, _shown(number, number.quoted), verdict)))
    return table


def _shown(number: Number, value: float | None) -> str:
    """With four digits and the unit; a dash where there is none."""
    if value is None or value != value:
        return "-"
    return f"{value:.4g}{'' if number.unit == '1' else f' {number.unit}'}"


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
