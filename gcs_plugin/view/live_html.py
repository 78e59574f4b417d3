"""What the live view says beside the gauges: alarms, age, outlook, link. Safe for any text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from gcs_plugin.view.gauges import percent
from gcs_plugin.watch import Outlook

RED, GREY = "#b00020", "#666"


def alarms_html(alarms: Sequence[str], problem: str, age: float, old: float) -> str:
    """What stands, above the gauges; `age` s of what is shown is told beyond `old` s."""
    lines = [f'<div data-alarm style="background:{RED}">{escape(text)}</div>' for text in alarms]
    if problem:
        lines.append(f'<div data-problem style="background:{RED}">{escape(problem)}</div>')
    if age > old:
        lines.append(f'<div data-age style="background:{GREY}">no data for {age:.0f} s</div>')
    style = "color:#fff;font:700 17px system-ui;margin:4px 8px"
    return f'<div style="{style}">{"".join(lines)}</div>' if lines else ""


def aged(html: str, old: bool) -> str:
    """Faint when it is old: an old number must not pass for a new one."""
    return f'<div data-old style="opacity:.35">{html}</div>' if old else html


def outlook_html(outlook: Outlook) -> str:
    """Time to empty, the least margin ahead and the margin after a refill, as far as known."""
    parts = []
    if math.isfinite(outlook.seconds_to_empty):
        minutes, seconds = divmod(int(outlook.seconds_to_empty), 60)
        parts.append(f"empty in {minutes}:{seconds:02d} of spraying")
    if math.isfinite(outlook.margin_ahead):
        parts.append(f"rest of the route: margin {percent(outlook.margin_ahead)} or more")
    if math.isfinite(outlook.margin_full):
        parts.append(f"with a full tank: {percent(outlook.margin_full)}")
    lines = "".join(f"<div>{escape(part)}</div>" for part in parts)
    return f'<div class="tm"><div class="txt" data-gauge="outlook">{lines}</div></div>'


def status_html(lines: Sequence[str]) -> str:
    """Lines about link and recording."""
    body = "".join(f"<div>{escape(line)}</div>" for line in lines)
    return (
        '<div data-status style="font:500 13px system-ui;color:#111;margin:2px 10px;'
        f'overflow-wrap:anywhere">{body}</div>'
    )
