"""Read and write plan files: QGroundControl's `.plan` and `.mission`, and `QGC WPL 110`.

The format is recognised by the content, not by the name.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from thrustmargin.mission.plan_items import (
    CHANGE_SPEED,
    DO_JUMP,
    DO_SPRAYER,
    FIRMWARE_ARDUPILOT,
    FIRMWARE_GENERIC,
    FIRMWARE_PX4,
    FLOAT_FRAME,
    FRAME_ABOVE_GROUND,
    FRAME_ABOVE_HOME,
    FRAME_AMSL,
    FRAME_MISSION,
    LAND,
    MOST_ITEMS,
    PLACE_COMMANDS,
    RETURN_TO_LAUNCH,
    TAKEOFF,
    WAYPOINT,
    MissionPlan,
    PlanItem,
    plan_from_items,
    too_many,
)
from thrustmargin.mission.qgc_plan import SAVE_AGAIN, plan_of_json, plan_text
from thrustmargin.models.errors import PlanError
from thrustmargin.models.whole_file import regular, whole_file

__all__ = [
    "CHANGE_SPEED",
    "DO_JUMP",
    "DO_SPRAYER",
    "FIRMWARE_ARDUPILOT",
    "FIRMWARE_GENERIC",
    "FIRMWARE_PX4",
    "FLOAT_FRAME",
    "FRAME_ABOVE_GROUND",
    "FRAME_ABOVE_HOME",
    "FRAME_AMSL",
    "FRAME_MISSION",
    "LAND",
    "PLACE_COMMANDS",
    "RETURN_TO_LAUNCH",
    "TAKEOFF",
    "WAYPOINT",
    "MissionPlan",
    "PlanItem",
    "plan_from_items",
    "plan_text",
    "read_plan",
    "waypoints_text",
    "write_plan",
]

LARGEST_FILE = 32 * 2**20
#: More of them than the most items have, with patterns and a fence.
MOST_COMMAS = 32 * MOST_ITEMS
_WPL = "QGC WPL"
_WPL_VERSION = "110"
_COLUMNS = 12
#: Words of other writers that JSON does not have: NaN is null, and the others name their item.
_CONSTANTS = {"Infinity": math.inf, "-Infinity": -math.inf}


def read_plan(path: Path) -> MissionPlan:
    """Read the mission of a `.plan`, `.mission`, `.waypoints` or `.txt` file.

    Surveys and corridor scans become their items; geofence and rally points are included. Raise
    PlanError, with the item and the remedy, if the file is no plan, is damaged, or contains an item
    that cannot be flown.
    """
    name = path.name
    try:
        if regular(path).stat().st_size > LARGEST_FILE:
            raise PlanError(f"{name} has more than {LARGEST_FILE >> 20} MiB; that is no plan file")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise PlanError(
            f"{name} is not a QGroundControl plan (it is no text); {SAVE_AGAIN}"
        ) from error
    if not text.strip():
        raise PlanError(f"{name} is empty; {SAVE_AGAIN}")
    if text.startswith(_WPL):
        return _plan_of_waypoints(text, name)
    if text.count(",") > MOST_COMMAS:
        raise too_many(name)
    try:
        content = json.loads(text, parse_constant=_CONSTANTS.get)
    except (ValueError, RecursionError) as error:
        why = f"{error!s:.80}"
        if isinstance(error, json.JSONDecodeError) and _cut_short(text, error):
            raise PlanError(
                f"{name} ends in line {error.lineno}, cut short; {SAVE_AGAIN}"
            ) from error
        raise PlanError(f"{name} is not a QGroundControl plan ({why}); {SAVE_AGAIN}") from error
    return plan_of_json(_newer(content), name)


def _cut_short(text: str, error: json.JSONDecodeError) -> bool:
    """Return True if JSON text is fine up to its end, but ends too early."""
    rest = text[error.pos :].strip()
    begun_word = any(word.startswith(rest) for word in ("null", "true", "false"))
    return begun_word or len(rest) <= 1 or error.msg.startswith("Unterminated string")


def _newer(content: Any) -> Any:
    """Return the content of a `.mission` of version 1 with the keys of version 2; any other content
    unchanged.

    It is the parsed JSON. Firmware is generic if the content states none.
    """
    if not isinstance(content, dict) or "fileType" in content:
        return content
    entries = content.get("items")
    if content.get("version") not in ("1.0", 1) or not isinstance(entries, list):
        return content
    home = content.get("plannedHomePosition")
    return {
        "items": [_newer_item(e) if isinstance(e, dict) else e for e in entries],
        "complexItems": content.get("complexItems"),
        "plannedHomePosition": home.get("coordinate") if isinstance(home, dict) else home,
        "firmwareType": content.get("MAV_AUTOPILOT", FIRMWARE_GENERIC),
        "version": 2,
    }


def _newer_item(entry: dict[str, Any]) -> dict[str, Any]:
    item = {key: value for key, value in entry.items() if key != "id"}
    item["params"] = [entry.get(f"param{k}") for k in range(1, 5)]
    return item | ({"doJumpId": entry["id"]} if "id" in entry else {})


def _plan_of_waypoints(text: str, name: str) -> MissionPlan:
    """Parse `QGC WPL 110` text: one item a line; a first waypoint above sea level is home, else the
    first place of the mission, with a note.

    Empty lines and comments (#) are skipped. Raise PlanError, which begins with `name`, for another
    version, invalid lines, or items not numbered from 0.
    """
    head, _, rest = text.partition("\n")
    version = head[len(_WPL) :].strip()
    if version != _WPL_VERSION:
        raise PlanError(
            f"{name} is of version {version!r:.40}; QGC WPL {_WPL_VERSION} is understood: save it "
            "again from the ground station"
        )
    if rest.count("\n") > MOST_ITEMS + 1:
        raise too_many(name)
    rows = enumerate(rest.splitlines(), start=2)
    items = [_row(line, f"{name} line {k}") for k, line in rows if line.strip() and line[0] != "#"]
    for count, item in enumerate(items):
        if item.number != count:
            raise PlanError(
                f"{name} has item {item.number} where {count} is due; save it again from the "
                "ground station"
            )
    if not items:
        raise PlanError(f"{name} has no mission items; plan the flight and save it again")
    first = items[0]
    home_first = first.command == WAYPOINT and first.frame == FRAME_AMSL
    return plan_from_items(items, home_first=home_first, source=name)


def _row(line: str, where: str) -> PlanItem:
    words = line.split()
    if len(words) != _COLUMNS:
        raise PlanError(f"{where} has {len(words)} columns; an item has {_COLUMNS}")
    try:
        number, frame, command = int(words[0]), int(words[2]), int(words[3])
        one, two, three, four, latitude, longitude, altitude = map(float, words[4:11])
        autocontinue = int(words[11]) != 0
    except ValueError as error:
        raise PlanError(f"{where} has a word where a number belongs; save it again") from error
    parameters = (one, two, three, four, latitude, longitude, altitude)
    if any(math.isinf(value) for value in parameters):
        raise PlanError(f"{where} has an infinite number; save it again")
    return PlanItem(
        number=number,
        command=command,
        frame=frame,
        parameters=parameters,
        autocontinue=autocontinue,
    )


def waypoints_text(plan: MissionPlan) -> str:
    """Return the text of a `.waypoints` file (QGC WPL 110), without geofence and rally points.

    Items are renumbered from 1, jump targets too. An unknown home height becomes 0, because the
    format has no empty cell; the vehicle replaces it when armed.
    """
    row_of = {item.number: row for row, item in enumerate(plan.items, start=1)}
    latitude, longitude, altitude = plan.home
    height = altitude if math.isfinite(altitude) else 0.0
    rows = [(0, 1, FRAME_AMSL, WAYPOINT, 0.0, 0.0, 0.0, 0.0, latitude, longitude, height, 1)]
    for row, item in enumerate(plan.items, start=1):
        values = item.parameters
        if item.command == DO_JUMP:
            values = (float(row_of.get(int(values[0]), values[0])), *values[1:])
        rows.append((row, 0, item.frame, item.command, *values, int(item.autocontinue)))
    lines = ["\t".join(map(_word, row)) for row in rows]
    return "\n".join([f"{_WPL} {_WPL_VERSION}", *lines]) + "\n"


def _word(value: float) -> str:
    """Format a number with all its digits and without an exponent, which some ground stations
    reject; `NaN` for NaN.

    Very small and very large numbers have 15 decimals.
    """
    if isinstance(value, int):
        return str(value)
    if math.isnan(value):
        return "NaN"
    shortest = repr(value)
    return f"{value:.15f}" if "e" in shortest else shortest


def write_plan(plan: MissionPlan, path: Path) -> None:
    """Write `plan` atomically, in the format of the suffix: `.waypoints`, `.txt`, else `.plan`.

    Raise PlanError if the folder does not exist or cannot be written.
    """
    other = path.suffix.lower() in (".waypoints", ".txt")
    try:
        with whole_file(path) as draft:
            draft.write_text(waypoints_text(plan) if other else plan_text(plan), encoding="utf-8")
    except OSError as error:
        raise PlanError(f"{path} cannot be written: {error.strerror}; choose another -o") from error
