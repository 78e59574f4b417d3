"""Frozen dataclasses of numbers, text and tuples as plain JSON data and back."""

from __future__ import annotations

import math
import types
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints


def to_plain(value: Any) -> Any:
    """Lists, dicts, text and numbers; NaN becomes None, because JSON has no NaN."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict | types.MappingProxyType):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [to_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def from_plain(kind: Any, data: Any, where: str) -> Any:
    """The inverse of `to_plain` for a type; None becomes NaN where a number is due.

    `kind` is a dataclass, float, int, str, bool, tuple, dict with text keys, or one of these or
    None. Raises ValueError that names the place, from `where` on, when data is missing, unknown or
    of another type.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return _dataclass(kind, data, where)
    if origin in (Union, types.UnionType):
        if data is None:
            return None
        return from_plain(next(a for a in arguments if a is not type(None)), data, where)
    if origin is tuple:
        if not isinstance(data, list):
            raise ValueError(f"{where} is {type(data).__name__}, not a list")
        kinds = arguments[:1] * len(data) if arguments[-1] is Ellipsis else arguments
        if len(kinds) != len(data):
            raise ValueError(f"{where} has {len(data)} entries, not {len(kinds)}")
        return tuple(from_plain(k, d, where) for k, d in zip(kinds, data, strict=True))
    if origin is dict:
        if not isinstance(data, dict):
            raise ValueError(f"{where} is {type(data).__name__}, not a table")
        return {str(k): from_plain(arguments[1], d, f"{where}.{k}") for k, d in data.items()}
    return _scalar(kind, data, where)


def _dataclass(kind: Any, data: Any, where: str) -> Any:
    if not isinstance(data, dict):
        raise ValueError(f"{where} is {type(data).__name__}, not a table")
    names = {f.name for f in fields(kind)}
    if data.keys() != names:
        wrong = sorted(data.keys() ^ names)[0]
        raise ValueError(f"{where} {'lacks' if wrong in names else 'has an unknown'} {wrong!r}")
    hints = get_type_hints(kind)
    return kind(**{n: from_plain(hints[n], data[n], f"{where}.{n}") for n in names})


def _scalar(kind: Any, data: Any, where: str) -> Any:
    if kind is float:
        if data is None:
            return math.nan
        if isinstance(data, int | float) and not isinstance(data, bool):
            return float(data)
    elif isinstance(data, kind) and (kind is bool or not isinstance(data, bool)):
        return data
    raise ValueError(f"{where} is {data!r}, not {kind.__name__}")
