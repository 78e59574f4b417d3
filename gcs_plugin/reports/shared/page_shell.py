"""Shell of every page that is written to a file: head, style, scripts and their policy.

A page asks nothing of any network: plotly.js (its basic bundle, MIT) and the figures' JSON are in
it, packed with gzip as base64 in inert <script> elements, and its content security policy lets only
the two scripts run whose hash it names. Text from a log reaches the page through jinja2's
autoescape or inside such a figure. Without scripts the page is whole but for its charts.

What every report writes alike: JSON, CSV, times in UTC, and the tables of a terminal.
"""

from __future__ import annotations

import base64
import csv
import gzip
import hashlib
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup, escape

from thrustmargin.gcs_plugin.wording import language as words
from thrustmargin.gcs_plugin.wording.language import say, sentence, spoken
from thrustmargin.models.json_values import to_json_values

if TYPE_CHECKING:
    from rich.table import Table


_SHELL = "thrustmargin.gcs_plugin.reports.shared"


def page_text(package: str, context: Mapping[str, Any], *, draws: bool = True) -> str:
    """Return an HTML page made of the template page.html in `package`, within the common frame.

    `context` holds the names that the template uses; the functions of `wording.numbers` and the
    software's version are added. A page.css in the package follows the common one. With `draws`,
    scripts draw a figure when it scrolls into view; without, the page has no script.
    """
    library, draw = b"", ""
    if draws:
        library, draw = _bytes(_SHELL, "plotly-basic.min.js.gz"), _text(_SHELL, "draw.js")
    own_style = (resources.files(package) / "page.css").is_file()
    style = _text(_SHELL, "page.css") + (_text(package, "page.css") if own_style else "")
    return _template(package, spoken()).render(
        context,
        software=software_version(),
        policy=content_policy(gzip.decompress(library).decode() if draws else "", draw),
        style=Markup(style),
        library=_in_base64(library),
        draw=Markup(draw),
    )


@cache  # jinja2 takes 0.1 s to compile a page
def _template(package: str, _language: str) -> jinja2.Template:
    """Compile the template page.html of `package`; its fixed words are translated while compiling.

    `_language` only separates the cached templates of different languages.
    """
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(
            lambda name: _text(package if name == "page.html" else _SHELL, name)
        ),
        autoescape=True,
        optimized=False,  # it would take longer to compile, for a page that is made once
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["unbroken"] = words.unbroken
    environment.filters["with_heads"] = with_heads
    environment.filters["sentence"] = sentence
    environment.filters["spoken"] = environment.globals["say"] = say
    environment.globals["language"] = spoken
    environment.globals |= {
        name: function
        for name, function in vars(words).items()
        if getattr(function, "__module__", "") == words.__name__ and not name.startswith("_")
    }
    return environment.get_template("page.html")


def with_heads(rows: Markup, heads: Sequence[str]) -> Markup:
    """Return the HTML table rows with their column's heading as attribute `data-head` of each cell.

    On a phone, where a row is displayed as a card, each cell shows its heading. `heads` are in
    English, as for the macro `table`.
    """
    spoken_heads = [escape(say(head.removeprefix("words:"))) for head in heads]

    def row(found: re.Match[str]) -> str:
        """Return the matched table row with its heading in `data-head` of every cell."""
        of = iter(spoken_heads)
        return re.sub(r"<td\b", lambda _: f'<td data-head="{next(of, "")}"', found[0])

    return Markup(re.sub(r"<tr\b.*?</tr>", row, str(rows), flags=re.DOTALL))


def packed(text: str) -> Markup:
    """Return the text as base64 of its gzip, in which no character can end an HTML element."""
    return _in_base64(gzip.compress(text.encode(), mtime=0))


def _in_base64(data: bytes) -> Markup:
    return Markup(base64.b64encode(data).decode())


def content_policy(*scripts: str) -> str:
    """Return a Content-Security-Policy that allows no external content and only these scripts.

    `scripts` are the texts of the scripts, which are allowed by their hashes.
    """
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
        for s in scripts
    )
    # plotly.js places style rules and draws its download through data and blob addresses.
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def software_version() -> str:
    """Return the installed version of thrustmargin; "not installed" where there is none."""
    try:
        return version("thrustmargin")
    except PackageNotFoundError:
        return "not installed"


def _text(package: str, name: str) -> str:
    return _bytes(package, name).decode()


def _bytes(package: str, name: str) -> bytes:
    return (resources.files(package) / name).read_bytes()


def json_text(values: Any, digits: int | None = None) -> str:
    """Return dataclasses, mappings and sequences as JSON, null where a number is unknown.

    `digits` is the number of significant digits of floats; None: all.
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
    """Return `heads` and `rows` as CSV.

    A text that a spreadsheet would take for a formula gets an apostrophe in front.
    """
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
    """Return the ISO 8601 time in UTC, to the second, of `when`; of now for None."""
    when = (when or datetime.now(UTC)).astimezone(UTC)
    return when.isoformat(timespec="seconds").replace("+00:00", "Z")


def unix_text(unix_s: float | None) -> str | None:
    """Return the ISO 8601 time in UTC of a Unix time, s; None where unknown or beyond what
    datetime holds."""
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
    """Return a table for a terminal of 80 columns.

    The columns with indices in `left` contain words, are left-aligned and wrap; the other columns
    contain numbers. Texts are displayed without interpreting markup.
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
