"""Frozen dataclasses of numbers, text and tuples as JSON values and back, by cattrs."""

from __future__ import annotations

import math
from enum import StrEnum
from reprlib import repr as shortly
from types import MappingProxyType
from typing import Any, get_origin

from cattrs import Converter, transform_error
from cattrs.errors import ForbiddenExtraKeysError

from thrustmargin.models.errors import ModelError

_CONVERTER = Converter(forbid_extra_keys=True)


def to_json_values(value: Any) -> Any:
    """Lists, dicts, text and numbers; NaN becomes None, because JSON has no NaN."""
    return _CONVERTER.unstructure(value)


def from_json_values(kind: Any, data: Any, where: str) -> Any:
    """The inverse of `to_json_values` for a type; None becomes NaN where a number is due.

    Raises ValueError that names the place, from `where` on, when data is missing, unknown or of
    another type.
    """
    try:
        return _CONVERTER.structure(data, kind)
    except Exception as error:  # cattrs raises groups of whatever its hooks raised
        first = transform_error(error, where, format_exception=_words)[0]
        what, _, place = first.partition(" @ ")
        raise ValueError(f"{place} {what}") from error


class Refused(TypeError):
    """A value that is not of the type that is due."""


def _words(error: BaseException, kind: type | None) -> str:  # noqa: ARG001
    if isinstance(error, KeyError):
        return "is missing"
    if isinstance(error, ForbiddenExtraKeysError):
        return f"has an unknown {min(error.extra_fields)!r}"
    return str(error) if isinstance(error, (Refused, ModelError)) else "is not a table"


def _scalar(data: Any, kind: Any) -> Any:
    if kind is float and data is None:
        return math.nan
    if issubclass(kind, StrEnum):
        return _member(data, kind)
    accepted = (int, float) if kind is float else kind
    if not isinstance(data, accepted) or (isinstance(data, bool) and kind is not bool):
        raise Refused(f"is {shortly(data)}, not {kind.__name__}")
    return kind(data)


def _member(data: Any, kind: type[StrEnum]) -> StrEnum:
    try:
        return kind(data)
    except ValueError as error:
        known = ", ".join(kind)
        raise Refused(f"is {shortly(data)}, none of {known}") from error


def _lists_only(kind: Any, converter: Converter) -> Any:
    """What makes tuples from lists, and from nothing else that can be walked through."""
    arguments = kind.__args__

    def structure(data: Any, _: Any) -> Any:
        if not isinstance(data, list):
            raise Refused(f"is {type(data).__name__}, not a list")
        kinds = arguments[:1] * len(data) if arguments[-1] is Ellipsis else arguments
        if len(kinds) != len(data):
            raise Refused(f"has {len(data)} entries, not {len(kinds)}")
        return tuple(converter.structure(d, k) for d, k in zip(data, kinds, strict=True))

    return structure


for _kind in (float, int, str, bool):
    _CONVERTER.register_structure_hook(_kind, _scalar)
_CONVERTER.register_structure_hook_factory(lambda kind: get_origin(kind) is tuple)(_lists_only)
_CONVERTER.register_unstructure_hook(
    float, lambda v: None if isinstance(v, float) and not math.isfinite(v) else v
)
_CONVERTER.register_unstructure_hook(
    MappingProxyType, lambda v: {str(k): _CONVERTER.unstructure(x) for k, x in v.items()}
)
_CONVERTER.register_unstructure_hook(tuple, lambda v: [_CONVERTER.unstructure(x) for x in v])
_CONVERTER.register_unstructure_hook_func(
    lambda kind: get_origin(kind) is tuple, lambda v: [_CONVERTER.unstructure(x) for x in v]
)
