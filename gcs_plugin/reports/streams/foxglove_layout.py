"""A layout of Foxglove that shows the topics of a flight's MCAP file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any


def layout_text(rotor_names: Sequence[str]) -> str:
    """The layout as JSON, with a line a rotor; Foxglove takes it by "Import from file"."""
    rotors = range(len(rotor_names))
    rotor_names = [name or f"rotor {r + 1}" for r, name in enumerate(rotor_names)]
    panels: dict[str, dict[str, Any]] = {
        "Plot!margin": _plot(
            "Thrust margin of the worst rotor, 90 % interval",
            [
                ("/margin.margin", "margin"),
                ("/margin.low", "low"),
                ("/margin.high", "high"),
                ("/margin.least", "least"),
            ],
        ),
        "Plot!use": _plot(
            "Thrust in use", [(f"/rotors.rotors[{r}].utilisation", rotor_names[r]) for r in rotors]
        ),
        "Plot!speeds": _plot(
            "Rotor speed, measured and predicted",
            [
                (f"/rotors.rotors[{r}].{key}", f"{rotor_names[r]} {caption}")
                for r in rotors
                for key, caption in (
                    ("rotor_speed_rpm", "measured"),
                    ("rotor_speed_predicted_rpm", "predicted"),
                )
            ],
        ),
        "Plot!load": _plot(
            "Liquid and battery", [("/flight.tank_kg", "tank, kg"), ("/flight.voltage", "V")]
        ),
        "map!position": {"enabledTopics": {"/position": True}, "topicColors": {}},
        "Log!log": {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []},
        "RawMessages!findings": {"topicPath": "/findings", "diffEnabled": False},
        "RawMessages!report": {"topicPath": "/report.verdict", "diffEnabled": False},
    }
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(
            "row",
            _split("column", "Plot!margin", _split("column", "Plot!use", "Plot!speeds")),
            _split(
                "column",
                _split("row", "map!position", "Plot!load"),
                _split(
                    "row", "Log!log", _split("column", "RawMessages!report", "RawMessages!findings")
                ),
            ),
        ),
    }
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def _plot(title: str, paths: Sequence[tuple[str, str]]) -> dict[str, Any]:
    return {
        "title": title,
        "paths": [
            {
                "value": path,
                "label": label,
                "enabled": True,
                "timestampMethod": "receiveTime",
                "showLine": True,
            }
            for path, label in paths
        ],
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _split(direction: str, first: Any, second: Any) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": 50}
