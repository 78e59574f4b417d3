"""`thrustmargin measured`: what the project's code finds on a folder of measured data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from tests.measured.study import Study

FEWEST_SURROGATES = 49  # of 50 equal chances, one is 2 %: what the search asks of an effect


def measured(
    folder: Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]],
    *,
    json: Path | None = None,
    html: Path | None = None,
    only: tuple[str, ...] = (),
    surrogates: int = 99,
    quick: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """Check this program on measured data: real flights with rotor speeds, benches, wind tunnel.

    Reads the data sets in a folder, closes the loop on the flights (which effect is missing, how
    large, error before and after on flights left out), fits the benches, and puts what is quoted
    elsewhere beside each number. The data are not part of this program: docs/measured.md says where
    they come from. The flights take three to four minutes, the rest seconds.

    Example: thrustmargin measured ../shared/measured --html measured.html

    Args:
        folder: Folder with one subfolder for each data set.
        json: Write the numbers as JSON to this file.
        html: Write a page with figures to this file.
        only: Names of the data sets to look at, one after the other; without it all.
        surrogates: How often the search is repeated on chance alone, 49 or more; an effect is
            taken only when less than 2 % of them give as much.
        quick: Leave out only the first third of the flights without payload, not each in turn.
    """
    from rich.console import Console
    from rich.progress import Progress

    from tests.measured.study import study

    if surrogates < FEWEST_SURROGATES:
        raise DataError(
            f"{surrogates} surrogates cannot tell an effect from chance at 2 %; give "
            f"{FEWEST_SURROGATES} or more"
        )
    check_outputs(folder, json=json, html=html)
    errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    with Progress(console=errors, transient=True) as bar:
        task = bar.add_task("reading", total=1.0)
        told = study(
            folder,
            only=only,
            surrogates=surrogates,
            quick=quick,
            progress=lambda what, share: bar.update(task, description=what, completed=share),
        )
        bar.update(task, description="writing", completed=0.0)
        written = write_study(told, json=json, html=html)
    show(told, written)
    return 1 if told.missing else 0


def check_outputs(folder: Path, *, json: Path | None, html: Path | None) -> None:
    """Before minutes of work: raise DataError when a result would have no place or do harm."""
    if html is not None and html.suffix.lower() not in (".html", ".htm"):
        raise DataError(f"cannot write {html} as a page; end its name in .html")
    if json is not None and html is not None and json.resolve() == html.resolve():
        raise DataError(f"{json} is given for the numbers and for the page; give two names")
    for path in (json, html):
        if path is None:
            continue
        if not path.parent.is_dir():
            raise DataError(f"no folder {path.parent} for {path.name}; make it first")
        if folder.resolve() in path.resolve().parents:
            raise DataError(f"{path} is inside the folder of measured data; write elsewhere")


def write_study(told: Study, *, json: Path | None, html: Path | None) -> list[Path]:
    """Write what was asked for, each file whole or not at all; returns the paths."""
    from json import dumps

    from tests.measured.page import html_text
    from thrustmargin.models.whole_file import whole_file

    contents: list[tuple[Path, str]] = []
    if json is not None:
        text = dumps(told.to_json(), ensure_ascii=False, allow_nan=False, indent=1)
        contents.append((json, text + "\n"))
    if html is not None:
        contents.append((html, html_text(told)))
    for path, content in contents:
        try:
            with whole_file(path) as draft:
                draft.write_text(content, encoding="utf-8")
        except OSError as error:
            raise DataError(f"cannot write {path}: {error.strerror or error}") from error
    return [path for path, _ in contents]


def show(told: Study, written: list[Path]) -> None:
    """What was found, with the numbers that something is quoted for."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from tests.measured.page import named, shown, verdict

    console = Console(highlight=False, markup=False, soft_wrap=True)
    for finding in told.findings:
        console.print(Text(f"\n{finding.title} ({finding.name})", style="bold"))
        for sentence in finding.answer:
            console.print(f"  {sentence}")
        beside = [n for n in finding.numbers if n.quoted is not None]
        if beside:
            table = Table("number", "found", "quoted", "", box=box.SIMPLE_HEAD)
            for number in beside:
                cells = (named(number), shown(number), shown(number, quoted=True), verdict(number))
                table.add_row(*map(Text, cells))
            console.print(table)
        for note in finding.notes:
            console.print(f"  note: {note}")
    errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    for missing in told.missing:
        errors.print(f"not used: {missing.name}: {missing.why}")
    for path in written:
        console.print(f"wrote {path}")
