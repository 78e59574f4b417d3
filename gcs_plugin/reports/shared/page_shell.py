"""What every page that is written to a file shares: head, style, scripts and their policy.

A page asks nothing of any network: plotly.js is in it once, figures are JSON in inert <script>
elements, and its content security policy lets only the two scripts run whose hash it names. Text
from a log reaches the page through jinja2's autoescape or through JSON with < > & as \\u escapes.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import jinja2
from markupsafe import Markup

from thrustmargin.gcs_plugin.wording import numbers as words

_ESCAPES = {
    "<": "\\u003c",
    ">": "\\u003e",
    "&": "\\u0026",
    "\u2028": "\\u2028",
    "\u2029": "\\u2029",
}
_SHELL = "thrustmargin.gcs_plugin.reports.shared"


def page_text(
    package: str,
    context: Mapping[str, Any],
    *,
    functions: Mapping[str, Callable[..., Any]],
    own_style: bool = False,
    draws: bool = True,
) -> str:
    """The page.html of `package` in the shell, its figures drawn when they come into view.

    `context` and `functions` are what the template may name; with `own_style` the package's
    page.css follows that of all pages. A page that draws nothing holds no script.
    """
    library = draw = ""
    if draws:
        from plotly.offline import get_plotlyjs

        library, draw = get_plotlyjs().replace("\r\n", "\n"), _text(_SHELL, "draw.js")
    style = _text(_SHELL, "page.css") + (_text(package, "page.css") if own_style else "")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(
            lambda name: _text(package if name == "page.html" else _SHELL, name)
        ),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= functions
    environment.filters["unbroken"] = words.unbroken
    return environment.get_template("page.html").render(
        context,
        policy=content_policy(library, draw),
        style=Markup(style),
        library=Markup(library),
        draw=Markup(draw),
    )


def script_safe(text: str) -> Markup:
    """JSON text with every character escaped that could end or open an HTML element."""
    for character, escape in _ESCAPES.items():
        text = text.replace(character, escape)
    return Markup(text)


def content_policy(*scripts: str) -> str:
    """The page's policy: nothing from anywhere, and only the scripts given, known by their hash."""
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
    """Version of thrustmargin as installed."""
    try:
        return version("thrustmargin")
    except PackageNotFoundError:
        return "not installed"


def _text(package: str, name: str) -> str:
    return (resources.files(package) / name).read_text(encoding="utf-8")
