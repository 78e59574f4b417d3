"""Read the day that the user states in a file, and keep the day last stated for twelve hours.

A command without an own statement takes the day of an earlier one of the same day, and its answer
names the time at which it was stated. The battery's voltage is not kept: the next battery has
another.

The day is kept in `thrustmargin/day.json` in the user's folder for state: XDG_STATE_HOME, else
LOCALAPPDATA on Windows, else ~/.local/state.
"""

from __future__ import annotations

import json
import math
import os
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from thrustmargin.models.errors import DataError
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.physics.day import DAY_FIELDS, Day, DaySource, DayValue, stated_value
from thrustmargin.models.whole_file import regular, whole_file

KEPT_S = 12.0 * 3600.0
#: Fields that are not kept: they are of one battery at one moment.
_OF_ONE_BATTERY = ("battery_voltage", "loaded_voltage")
#: Field stated anew -> fields that an older statement no longer completes.
_REPLACES: Mapping[str, tuple[str, ...]] = {
    "pressure": ("height",),
    "height": ("pressure",),
    "wind": ("gusts",),
}
#: Keys of a file of --day: all that a user can state.
KEYS = {how.key: name for name, how in DAY_FIELDS.items() if how.option}


@dataclass(frozen=True, slots=True)
class _Kept:
    """A remembered value, in the unit people write, and when it was stated, s since 1970."""

    value: float
    stated_s: float


@dataclass(frozen=True, slots=True)
class _KeptDay:
    """The content of the file of the remembered day; values by the keys of a file of --day."""

    schema: str
    values: dict[str, _Kept]


SCHEMA = "thrustmargin.day/1"


def day_file() -> Path:
    """Return the path of the remembered day of this user."""
    base = os.environ.get("XDG_STATE_HOME")
    if not base and os.name == "nt":
        base = os.environ.get("LOCALAPPDATA")
    return (Path(base) if base else Path.home() / ".local" / "state") / "thrustmargin" / "day.json"


def read_day(path: Path) -> Day:
    """Read the conditions of a day (air, wind, battery) from a TOML or JSON file.

    Each key is one of KEYS, each value a number in the unit of its key. Raises DataError for
    another file, an unknown key, an impossible value, or a file without a value.
    """
    if path.suffix.lower() not in (".toml", ".json"):
        raise DataError(f"cannot read a day from {path}; end its name in .toml or .json")
    try:
        text = regular(path).read_text("utf-8")
        content = tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is no {path.suffix[1:].upper()}: {error!s:.80}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path} is no table of values; write lines such as air_temperature_c = 31")
    found: dict[str, DayValue] = {}
    for key, written in content.items():
        name = KEYS.get(key)
        if name is None:
            raise DataError(f"{path} has an unknown {key!r}; a day has {', '.join(KEYS)}")
        value = _in_si(name, written, f"{path}: {key}")
        found[name] = stated_value(name, value, DaySource.FILE)
    if not found:
        raise DataError(f"{path} has no value; a day has {', '.join(KEYS)}")
    return Day(**found)


def _in_si(name: str, written: Any, where: str) -> float:
    """Return the value `written` for the field `name` of Day, converted to SI.

    Raises DataError, beginning with `where`, unless it is a number within the field's limits.
    """
    how = DAY_FIELDS[name]
    if isinstance(written, bool) or not isinstance(written, int | float):
        raise DataError(f"{where} is {written!r:.40}; it must be a number in {how.unit}")
    if not (math.isfinite(written) and how.low <= written <= how.high):
        raise DataError(
            f"{where} is {written:g}; it must be between {how.low:g} and {how.high:g} {how.unit}"
        )
    return how.to_si(float(written))


def remembered_day(now_s: float | None = None) -> Day:
    """Return the conditions that the user stated within the last KEPT_S s, each with its local
    time.

    `now_s` is the Unix time, s; None means now. Conditions not stated are unknown; all are without
    a file. Raises DataError if the file is damaged.
    """
    now_s = time.time() if now_s is None else now_s
    found: dict[str, DayValue] = {}
    for key, kept in _read(day_file()).items():
        if 0.0 <= now_s - kept.stated_s <= KEPT_S:
            name = KEYS[key]
            at = time.strftime("%H:%M", time.localtime(kept.stated_s))
            value = DAY_FIELDS[name].to_si(kept.value)
            found[name] = stated_value(name, value, DaySource.REMEMBERED, given_at=at)
    return Day(**found)


def remember(day: Day, now_s: float | None = None) -> None:
    """Store the conditions of `day` that the user stated, with those stored within the last KEPT_S
    s.

    Values of one single battery are not stored. A new value replaces a stored one that contradicts
    it. `now_s` is the Unix time, s; None means now. Raises OSError if the file cannot be written,
    DataError if the present one is damaged.
    """
    now_s = time.time() if now_s is None else now_s
    stated = {one.name: value for one in fields(day) if (value := getattr(day, one.name)).known}
    stated = {
        name: value
        for name, value in stated.items()
        if value.source.stated and name not in _OF_ONE_BATTERY
    }
    if not stated:
        return
    path = day_file()
    kept = {k: one for k, one in _read(path).items() if 0.0 <= now_s - one.stated_s <= KEPT_S}
    for name in stated:
        for gone in _REPLACES.get(name, ()):
            kept.pop(DAY_FIELDS[gone].key, None)
    for name, value in stated.items():
        how = DAY_FIELDS[name]
        kept[how.key] = _Kept(round(how.written(value.value), 6), now_s)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as draft:
        text = json.dumps(to_json_values(_KeptDay(SCHEMA, kept)), indent=1)
        draft.write_text(text + "\n", encoding="utf-8")


def _read(path: Path) -> dict[str, _Kept]:
    """Return the stored values, each with the time it was stated at, by key; empty without a file.

    Raises DataError for a damaged file.
    """
    if not path.exists():
        return {}
    try:
        content: _KeptDay = from_json_values(
            _KeptDay, json.loads(regular(path).read_text("utf-8")), "day"
        )
        if content.schema != SCHEMA:
            raise ValueError(f"its schema is {content.schema!r:.40}")
        for key, one in content.values.items():
            if key not in KEYS:
                raise ValueError(f"it has an unknown {key!r:.40}")
            _in_si(KEYS[key], one.value, key)
    except (OSError, ValueError, RecursionError, DataError) as error:
        raise DataError(
            f"{path} is no remembered day ({error!s:.80}); remove it, and state the day anew"
        ) from error
    return content.values
