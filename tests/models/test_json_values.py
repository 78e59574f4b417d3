"""Dataclasses as JSON values and back: what is of another type is refused with its place."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from thrustmargin.models.json_values import from_json_values, to_json_values


@dataclass(frozen=True)
class Part:
    size: float
    count: int


@dataclass(frozen=True)
class Whole:
    name: str
    good: bool
    parts: tuple[Part, ...]
    pair: tuple[float, int]
    table: dict[str, float]
    maybe: Part | None


WHOLE = Whole("a", True, (Part(1.5, 2), Part(-0.5, 3)), (0.25, 4), {"x": 1.0}, None)
PLAIN = {
    "name": "a",
    "good": True,
    "parts": [{"size": 1.5, "count": 2}, {"size": -0.5, "count": 3}],
    "pair": [0.25, 4],
    "table": {"x": 1.0},
    "maybe": None,
}


def test_there_and_back():
    assert to_json_values(WHOLE) == PLAIN
    assert from_json_values(Whole, PLAIN, "it") == WHOLE
    given = {**PLAIN, "maybe": {"size": 2, "count": 1}}
    assert from_json_values(Whole, given, "it").maybe == Part(2.0, 1)


def test_one_of_several_texts_is_read_and_another_is_refused():
    kind = Literal["propeller", "motor"] | None
    assert from_json_values(kind, "motor", "it") == "motor"
    assert from_json_values(kind, None, "it") is None
    with pytest.raises(ValueError, match="it is 'wing', none of propeller, motor"):
        from_json_values(kind, "wing", "it")


def test_what_is_no_number_is_null_and_null_is_no_number():
    for value in (float("nan"), float("inf"), -float("inf")):
        assert to_json_values(Part(value, 1)) == {"size": None, "count": 1}
    assert np.isnan(from_json_values(Part, {"size": None, "count": 1}, "it").size)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": 7}, "it.name is 7, not str"),
        ({"good": 1}, "it.good is 1, not bool"),
        ({"parts": {}}, "it.parts is dict, not a list"),
        ({"parts": [3]}, "it.parts is not a table"),
        ({"parts": [{"size": 1.0}]}, "it.parts.count is missing"),
        ({"parts": [{"size": 1.0, "count": 2, "more": 3}]}, "it.parts has an unknown 'more'"),
        ({"parts": [{"size": True, "count": 2}]}, "it.parts.size is True, not float"),
        ({"parts": [{"size": "1", "count": 2}]}, "it.parts.size is '1', not float"),
        ({"parts": [{"size": 1.0, "count": True}]}, "it.parts.count is True, not int"),
        ({"parts": [{"size": 1.0, "count": 2.0}]}, "it.parts.count is 2.0, not int"),
        ({"parts": [{"size": 1.0, "count": None}]}, "it.parts.count is None, not int"),
        ({"pair": [0.25]}, "it.pair has 1 entries, not 2"),
        ({"pair": [0.25, 4, 5]}, "it.pair has 3 entries, not 2"),
        ({"table": []}, "it.table is not a table"),
        ({"table": {"x": "y"}}, r"it.table\['x'\] is 'y', not float"),
        ({"maybe": 3}, "it.maybe is not a table"),
    ],
)
def test_data_of_another_kind_is_refused_with_its_place(change, message):
    with pytest.raises(ValueError, match=message):
        from_json_values(Whole, {**PLAIN, **change}, "it")
