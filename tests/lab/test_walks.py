"""The walks count what they name: each end of a way and each type on it is in the source."""

import ast
from functools import cache

import pytest

from tests.import_graph import modules, nodes
from tests.lab.walks import WAYS


@cache
def defined() -> dict[str, set[str]]:
    """Return the names of the classes, functions and assigned types of each module."""
    found: dict[str, set[str]] = {}
    for name, path in modules().items():
        names = found.setdefault(name, set())
        for node in nodes(path):
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.Assign):
                names |= {one.id for one in node.targets if isinstance(one, ast.Name)}
    return found


@pytest.mark.parametrize("way", WAYS)
def test_ends_and_types_of_a_way_are_in_the_source(way: str):
    _, end, types, _ = WAYS[way]
    found = defined()
    if end:
        module, _, function = end.partition(":")
        assert function in found[module]
    everywhere = set[str]().union(*found.values())
    assert [one for one in types.split() if one not in everywhere] == []
