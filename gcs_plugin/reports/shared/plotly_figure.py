"""A figure as plotly.js reads it: plain tables, which `drawn_figure` draws on paper.

Every property is plotly's own (plotly.com/javascript/reference), nested as it is there.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.json_values import to_json_values

Trace = dict[str, Any]


@dataclass(slots=True)
class Figure:
    """Traces and their layout; made step by step, and not changed any more once it is shown."""

    layout: dict[str, Any]
    data: list[Trace] = field(default_factory=list)

    def add(self, traces: Iterable[Trace | None], axes: str = "") -> None:
        """Add traces, None being none, to the axes of this number; the first have none."""
        on = {"xaxis": f"x{axes}", "yaxis": f"y{axes}"} if axes else {}
        self.data += [trace | on for trace in traces if trace is not None]

    def note(self, text: str, **properties: Any) -> None:
        """Add a text; an arrow is drawn only where the properties ask for one."""
        one = {"text": text, "showarrow": False, **properties}
        self.layout.setdefault("annotations", []).append(one)

    def to_json(self) -> str:
        """JSON of what plotly.js draws; arrays as base64, which it reads as they are."""
        made = to_json_values({"data": self.data, "layout": self.layout})
        return json.dumps(made, default=_packed, ensure_ascii=False, allow_nan=False)


def scatter(x: Any, y: Any, **properties: Any) -> Trace:
    """A trace of lines, marks or an area through x and y (N,)."""
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, **properties}


def titled(text: str, **properties: Any) -> dict[str, Any]:
    """Properties of an axis with this title."""
    return {"title": {"text": say(text)}, **properties}


def _packed(array: np.ndarray) -> dict[str, str]:
    data = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {"dtype": array.dtype.str[1:], "bdata": data}
