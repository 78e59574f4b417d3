"""Convert frozen dataclasses of numbers, text and tuples to JSON values and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum, StrEnum
from functools import cache
from reprlib import repr as shortly
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from thrustmargin.models.errors import ModelError

#: Metadata of a dataclass field that JSON does not show.
NOT_IN_JSON: Mapping[str, bool] = MappingProxyType({"not in JSON": True})


def to_json_values(value: Any) -> Any:
    """Convert a value to lists, dicts, text and numbers; a dataclass becomes a dict by field name,
    an enum its value.

    NaN and infinity become None, because JSON has neither. Values of other types are returned
    unchanged.
    """
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if is_dataclass(value):
        written = (f for f in fields(value) if f.init and not f.metadata.get("not in JSON"))
        return {f.name: to_json_values(getattr(value, f.name)) for f in written}
    if isinstance(value, Mapping):
        return {str(key): to_json_values(one) for key, one in value.items()}
    if isinstance(value, (tuple, list, set, frozenset)):
        return [to_json_values(one) for one in value]
    return value


def from_json_values(kind: Any, data: Any, where: str) -> Any:
    """Convert JSON values back to the type `kind`; None becomes NaN where a number is required.

    `kind` is a number, text, enum or literal, a tuple, mapping or dataclass of them, or a union;
    None stays where the union has it. A text where a dataclass is required becomes what the
    dataclass's `of_text` makes of it, if it has one. Raise ValueError that names the place, from
    `where` on, when data is missing, unknown or of another type.
    """
    of = get_args(kind)
    if get_origin(kind) is Literal:
        if data not in of:
            raise ValueError(f"{where} is {shortly(data)}, none of {', '.join(map(str, of))}")
        return data
    if get_origin(kind) in (Union, UnionType) and NoneType not in of:
        return from_json_values(_alternative(of, data, where), data, where)
    if NoneType in of:
        (kind,) = (one for one in of if one is not NoneType)
        return None if data is None else from_json_values(kind, data, where)
    if get_origin(kind) is tuple:
        if not isinstance(data, list):
            raise ValueError(f"{where} is {type(data).__name__}, not a list")
        kinds = of[:1] * len(data) if of[-1] is Ellipsis else of
        if len(kinds) != len(data):
            raise ValueError(f"{where} has {len(data)} entries, not {len(kinds)}")
        return tuple(from_json_values(k, d, where) for k, d in zip(kinds, data, strict=True))
    if kind in (float, int, str, bool) or issubclass(get_origin(kind) or kind, StrEnum):
        return _scalar(kind, data, where)
    if isinstance(data, str) and (of_text := getattr(kind, "of_text", None)):
        return of_text(data)
    if not isinstance(data, dict):
        raise ValueError(f"{where} is not a table")
    if not is_dataclass(kind):
        return {key: from_json_values(of[1], one, f"{where}[{key!r}]") for key, one in data.items()}
    return _dataclass(kind, data, where)


def _alternative(kinds: tuple[Any, ...], data: Any, where: str) -> Any:
    """Return the first of several types that JSON `data` can be; raise ValueError for none.

    A dict fits a dataclass that has all its keys, a list any tuple, None and a number a float.
    """
    for kind in kinds:
        if is_dataclass(kind):
            fits = isinstance(data, dict) and data.keys() <= {f.name for f in fields(kind)}
        elif get_origin(kind) is tuple:
            fits = isinstance(data, list)
        elif kind is float:
            fits = data is None or (isinstance(data, (int, float)) and not isinstance(data, bool))
        else:
            fits = kind is str and isinstance(data, str)
        if fits:
            return kind
    raise ValueError(f"{where} is {shortly(data)}, of no type that it can have")


def _scalar(kind: Any, data: Any, where: str) -> Any:
    """Convert a number, text or enum; None for a float becomes NaN. Raise ValueError for another
    type or an unknown enum value."""
    if kind is float and data is None:
        return math.nan
    if issubclass(kind, StrEnum):
        if data not in list(kind):
            raise ValueError(f"{where} is {shortly(data)}, none of {', '.join(kind)}")
        return kind(data)
    accepted = (int, float) if kind is float else kind
    if not isinstance(data, accepted) or (isinstance(data, bool) and kind is not bool):
        raise ValueError(f"{where} is {shortly(data)}, not {kind.__name__}")
    try:
        return kind(data)
    except OverflowError as error:  # an int that no float can hold
        raise ValueError(f"{where} is {shortly(data)}, not {kind.__name__}") from error


def _dataclass(kind: Any, data: dict[str, Any], where: str) -> Any:
    """Build a dataclass from its fields, of which those with a default may be missing. Raise
    ValueError for missing, unknown or wrong ones."""
    expected = {f.name: f for f in fields(kind) if f.init}
    for name, field in expected.items():
        if name not in data and field.default is field.default_factory is MISSING:
            raise ValueError(f"{where}.{name} is missing")
    if more := data.keys() - expected.keys():
        raise ValueError(f"{where} has an unknown {min(more)!r}")
    kinds = _kinds(kind)
    values = {n: from_json_values(kinds[n], one, f"{where}.{n}") for n, one in data.items()}
    try:
        return kind(**values)
    except ModelError as error:
        raise ValueError(f"{where} {error}") from error


@cache
def _kinds(kind: type) -> dict[str, Any]:
    """Return the types of a dataclass's fields, by name."""
    return get_type_hints(kind)
