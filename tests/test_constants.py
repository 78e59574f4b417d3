"""docs/constants.md has every number of the residual loop, with the value that the code has.

What a number is for stands in a comment at its line.
"""

import ast
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
LOOP = ROOT / "models" / "identification"
TEXT = (ROOT / "docs/constants.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `([\w.]+)\.(\w+)` \| ([^|]+) \| ([^|]+) \|", re.M)
REASONED = {(module, name): value for module, name, value, _ in ROW.findall(TEXT)}
#: module and its numbers that are listed without a reason: `NAME` 1.0, `NAME` 1.0; 2.0
MODULES = re.findall(r"^\| `([\w.]+)` \| (`[A-Z].*) \|$", TEXT, re.M)
ALONE = {
    (module, name): value.replace(";", ",")
    for module, numbers in MODULES
    for name, value in re.findall(r"`(\w+)` ([^,]+)", numbers)
}
LISTED = REASONED | ALONE
#: not numbers that decide anything: places, names, and grids that flights left out choose from
OTHERS = {"ALL_FLIGHTS", "ALL_MODES", "RIDGES", "SMOOTHNESS"}


def numbers() -> set[tuple[str, str]]:
    """(module, name) of each constant that is a number or numbers."""
    found = set()
    for path in LOOP.rglob("*.py"):
        module = ".".join(path.relative_to(LOOP).with_suffix("").parts)
        for node in ast.parse(path.read_text("utf-8")).body:
            if not isinstance(node, ast.Assign):
                continue
            of = [n.id for t in node.targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            names = [n for n in of if n.isupper() and n not in OTHERS]
            found |= {(module, n) for n in names if is_number(value_of(module, n))}
    return found


def value_of(module: str, name: str) -> Any:
    return getattr(import_module(f"thrustmargin.models.identification.{module}"), name)


def is_number(value: Any) -> bool:
    every = value if isinstance(value, tuple) and value else (value,)
    return all(isinstance(v, (int, float, np.number)) for v in every)


def test_every_number_of_the_loop_is_listed_once():
    assert set(LISTED) == numbers()
    assert not REASONED.keys() & ALONE.keys()


@pytest.mark.parametrize(("module", "name"), sorted(LISTED))
def test_a_comment_at_its_line_says_what_a_number_is_for(module: str, name: str):
    lines = (LOOP / f"{module.replace('.', '/')}.py").read_text("utf-8").splitlines()
    (at,) = (n for n, one in enumerate(lines) if re.match(rf"(\w+, )*{name}(, \w+)* = ", one))
    assert "  # " in lines[at] or lines[at - 1].startswith("#: ")


def test_listed_values_are_those_of_the_code():
    for one, listed in LISTED.items():
        written = [float(v) for v in listed.split(", ")]
        assert np.atleast_1d(value_of(*one)) == pytest.approx(written, rel=0.005), one
