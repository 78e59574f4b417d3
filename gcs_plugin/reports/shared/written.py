"""What every report writes alike: JSON, CSV, times in UTC, and the tables of a terminal."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from thrustmargin.models.json_values import to_json_values

if TYPE_CHECKING:
    from rich.table import Table


def json_text(values: Any, digits: int | None = None) -> str:
    """Dataclasses, mappings and sequences as JSON, null where a number is not known.

    `digits` are those that are kept of a fraction; None: all.
    """
    whole = _rounded(to_json_values(values), digits) if digits else to_json_values(values)
    return json.dumps(whole, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _rounded(value: Any, digits: int) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(one, digits) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one, digits) for one in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


#: With which a spreadsheet lets a formula begin; the wide ones in some countries.
FORMULA = tuple("=+-@\t\r\uff1d\uff0b\uff0d\uff20")


def csv_text(heads: Iterable[Any], rows: Iterable[Iterable[Any]]) -> str:
    """Rows under their heads; no text begins as a formula of a spreadsheet."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(heads)
    for row in rows:
        writer.writerow(
            f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell
            for cell in row
        )
    return out.getvalue()


def utc_text(when: datetime | None = None) -> str:
    """ISO time in UTC to the second, of now without one."""
    when = (when or datetime.now(UTC)).astimezone(UTC)
    return when.isoformat(timespec="seconds").replace("+00:00", "Z")


def unix_text(unix_s: float | None) -> str | None:
    """ISO time in UTC of a Unix time; None where it is not known, or is no time."""
    try:
        return None if unix_s is None else utc_text(datetime.fromtimestamp(unix_s, UTC))
    except (OverflowError, ValueError, OSError):
        return None


def grid(
    heads: Sequence[str],
    rows: Iterable[Sequence[Any]] = (),
    *,
    title: str = "",
    caption: str = "",
    left: Sequence[int] = (0,),
) -> Table:
    """A table for a terminal of 80 columns; the columns `left` hold words, the others numbers.

    Texts of files are shown as they are, whatever they hold.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title) if title else None,
        caption=Text(caption) if caption else None,
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for k, head in enumerate(heads):
        words = k in left
        table.add_column(
            head,
            justify="left" if words else "right",
            no_wrap=not words,
            overflow="fold" if words else "ellipsis",
        )
    for row in rows:
        table.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    return table
