"""`thrustmargin fleet`: show which aircraft of a season to look at first, and why."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.table import Table
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    UsageError,
    check_outputs,
    write_text,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.page_shell import csv_text, grid
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.office.season.fleet_page import FleetSeason
    from thrustmargin.gcs_plugin.office.season.parts import Part
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore


PARTS = "parts.csv"
#: Columns whose medians --compare shows side by side.
COMPARED = (
    *("worst_margin", "mean_margin", "rows_above_limit_s", "prediction_rmse_rpm", "fill_kg"),
    *("battery_ohm", "voltage_min", "flying_s", "litres", "hectares"),
)


def fleet(
    store: Positional[Annotated[str, tyro.conf.arg(metavar="[STORE]", help_behavior_hint="")]] = "",
    *,
    aircraft: str | None = None,
    parts: Path | None = None,
    out: Path | None = None,
    csv: Path | None = None,
    json: Path | None = None,
    sql: str | None = None,
    compare: tuple[str, str] | None = None,
) -> None:
    """Show which aircraft of a season to look at first, and why.

    Every rotor's thrust, the balance, the gauge and the battery are followed over all flights, and
    what changed is said with its size and date.

    Example: thrustmargin fleet season --out fleet.html

    Args:
        store: Folder or address of the store, as given to `learn --store`; without it that of the
            known aircraft, which `learn` and `report` fill.
        aircraft: Only this aircraft, with all its flights.
        parts: File that says which part was where and when (.csv: part, aircraft, position,
            installed_at, removed_at); without it parts.csv in the store, if there is one.
        out: Page to write (.html).
        csv: One row an aircraft (.csv); - is standard output.
        json: All numbers as JSON (.json); - is standard output.
        sql: Print the answer of one SELECT over flights, rows, sums and rejected, and nothing else.
        compare: Two aircraft, flights or models (digests) side by side.
    """
    from thrustmargin.gcs_plugin.store.hangar import open_hangar
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore

    if (csv, json).count(STDOUT) > 1:
        raise UsageError("only one of --csv and --json can go to standard output")
    check_outputs(
        (
            OutputFile("--out", out, endings=(".html", ".htm")),
            OutputFile("--csv", csv, endings=(".csv",)),
            OutputFile("--json", json, endings=(".json",)),
        ),
        inputs=[parts],
    )
    opened = SeasonStore.open(store or str(open_hangar().folder))
    if not opened.keys("flights"):
        how = shlex.join(["thrustmargin", "learn", "LOGS", *(("--store", store) if store else ())])
        raise DataError(f"no flights in {opened.url}; take logs in with: {how}")
    if sql is not None:
        from thrustmargin.gcs_plugin.office.season.stored_words import SQL_WORDS
        from thrustmargin.gcs_plugin.store.season_store import query

        answer = query(opened, sql, SQL_WORDS)
        _print_rows(answer.column_names, [list(r.values()) for r in answer.to_pylist()], csv)
        return
    if compare is not None:
        _print_rows(["median of flights", *compare], _side_by_side(opened, compare), csv)
        return
    from thrustmargin.gcs_plugin.office.season import fleet_page
    from thrustmargin.gcs_plugin.office.season.fleet_seasons import fleet_season

    season = fleet_season(opened, aircraft, _parts(opened, parts))
    quiet = STDOUT in (csv, json)
    console = Terminal(soft_wrap=True, quiet=quiet)
    console.print(season.call, style="bold")
    console.print(_table(season))
    alone = aircraft is not None
    for one in season.aircraft:
        for found in one.findings if alone else one.findings[:1]:
            console.print(f"{one.name}: {found.sentence}. {say('Do')}: {found.action}")
    texts: Sequence[tuple[Path | None, Callable[[], str]]] = (
        (out, lambda: fleet_page.html_text(season, alone=alone)),
        (csv, lambda: fleet_page.as_csv(season)),
        (json, lambda: fleet_page.as_json(season)),
    )
    for path, text in texts:
        if path is not None:
            write_text(path, text())
            if path != STDOUT:
                console.print(f"wrote {path}")


def _parts(store: SeasonStore, file: Path | None) -> list[Part]:
    """Read the parts from `file`; if None, from the store's parts.csv, which may be missing.

    Empty without either. Raises DataError for a file that cannot be read or is wrong.
    """
    from thrustmargin.gcs_plugin.office.season.parts import read_parts

    if file is not None:
        try:
            return read_parts(regular(file).read_bytes(), str(file))
        except OSError as error:
            raise DataError(
                f"cannot read --parts {file}: {error.strerror or error}; give a .csv file"
            ) from error
    if not store.files.exists(store.path(PARTS)):
        return []
    return read_parts(store.read(PARTS), PARTS)


def _side_by_side(store: SeasonStore, names: tuple[str, str]) -> list[list[Any]]:
    """Return rows (column of COMPARED, its median for the first name, its median for the second).

    A name is that of an aircraft, a flight or a model's digest. The first row is the number of
    flights; a median without a known value is None. Raises DataError for a name without flights.
    """
    from statistics import median

    keys = ["aircraft", "flight", "model_digest"]
    rows = store.table("flights", columns=[*keys, *COMPARED]).to_pylist()
    columns = []
    for name in names:
        chosen = [row for row in rows if name in (row[key] for key in keys)]
        if not chosen:
            raise DataError(f"--compare: no aircraft, flight or model {name!r} in the store")
        own: list[Any] = [len(chosen)]
        for column in COMPARED:
            known = [r[column] for r in chosen if r[column] is not None and r[column] == r[column]]
            own.append(median(known) if known else None)
        columns.append(own)
    return [list(row) for row in zip(("flights", *COMPARED), *columns, strict=True)]


def _print_rows(heads: Sequence[str], rows: Sequence[Sequence[Any]], file: Path | None) -> None:
    """Print a table with the headings `heads`, or write it as CSV to `file` if that is not None."""
    if file is not None:
        write_text(file, csv_text(heads, rows))
        return
    shown = [
        ["" if c is None else f"{c:g}" if isinstance(c, float) else str(c) for c in row]
        for row in rows
    ]
    Terminal().print(grid(heads, shown, left=range(len(heads))))


def _table(season: FleetSeason) -> Table:
    """Return the terminal's table of all aircraft: the first six columns of the page."""
    from thrustmargin.gcs_plugin.office.season.fleet_page import HEADS, cells

    return grid([*map(say, HEADS[:6])], [cells(one)[:6] for one in season.aircraft], left=(0, 1))
