"""Which constants of the loop shape an answer: each doubled and halved, on the same sets.

    python -m tests.lab.undeclared.sensitivity 8 25 [--json out/constants.json]

An answer is the names, what cannot be told apart, the rotors asked for and what is unexplained, and
the error on the flight left out to 1 %. Sets are open ones of recorded flights (`recorded.py`),
with the model that ships. A share of 1 comes nearer to 1 where another number is doubled. Constants
of the next flight, the season, training and the floor are left out: they come after the names.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import thrustmargin as tm
from tests.lab.undeclared.plan import DataSet
from tests.lab.undeclared.recorded import build_recorded
from tests.test_constants import LISTED, value_of

LOOP = "thrustmargin.models.identification"
LATER = ("next_flight", "season", "good_flights", "answer.floor")
#: numbers by themselves, or sizes of arrays
FIXED = ("sets.evidence.LOG_2_PI", "sets.evidence.IMPOSSIBLE", "sets.evidence.STIFF")
FIXED += ("rows.noise.ORDER",)
#: below 1
SHARES = ("certainty.SURE", "certainty.CHOICE", "rows.noise.MOST_MEMORY")
SHARES += ("answer.model_update.COVERAGE",)
QUANTILES = "rows.candidates.RANGE"
SAME_ERROR = 0.01


def scaled(key: str, value: Any, factor: float) -> Any:
    """The value times a factor; whole numbers and shares of 1 stay what they are."""
    if key == QUANTILES:
        return (value[0] * factor, 1.0 - value[0] * factor)
    if isinstance(value, tuple):
        return tuple(scaled("", one, factor) for one in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return value ** (1.0 / factor) if key in SHARES else value * factor


@contextmanager
def changed(module: str, name: str, value: Any) -> Iterator[None]:
    """The constant as another value wherever it was imported."""
    old = value_of(module, name)
    whole = [m for key, m in sys.modules.items() if key.startswith(LOOP) and m is not None]
    places = [m for m in whole if vars(m).get(name) is old and _is_of(m, module, name)]
    for place in places:
        setattr(place, name, value)
    try:
        yield
    finally:
        for place in places:
            setattr(place, name, old)


def _is_of(place: ModuleType, module: str, name: str) -> bool:
    """Whether the name in a module is that of another one, which it imports it from."""
    if place.__name__ == f"{LOOP}.{module}":
        return True
    text = Path(place.__file__ or "").read_text("utf-8")
    _, found, after = text.partition(f"from {LOOP}.{module} import ")
    names = after.partition(")" if after.startswith("(") else "\n")[0]
    return bool(found) and name in names.replace(",", " ").replace("(", " ").split()


def answer(data: DataSet) -> tuple[tuple[Any, ...], float]:
    """What `identify` says of a set, and its error, rpm, on the flight left out."""
    fit, new = ([one.track for one in part] for part in (data.fit, data.held_out))
    said = tm.identify(fit, tm.load_model(), held_out=new).to_json()
    open_ = said["unexplained"]
    return (
        sorted((e["name"], e["rotor"] or 0) for e in said["effects"]),
        [[(e["name"], e["rotor"] or 0) for e in one["effects"]] for one in said["one_of"]],
        [one["rotor"] for one in said["mentioned"]],
        (open_["mode"], open_["channel"], open_["rotor"]),
    ), said["after"]["rmse_rpm"]


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("seeds", type=int, nargs="+")
    given.add_argument("--json", type=Path)
    options = given.parse_args()
    constants = sorted(
        (module, name)
        for module, name in LISTED
        if not module.startswith(LATER) and f"{module}.{name}" not in FIXED
    )
    found: dict[str, list[str]] = defaultdict(list)
    for seed in options.seeds:
        data = build_recorded(seed)
        names, error = answer(data)
        for module, name in constants:
            import_module(f"{LOOP}.{module}")
            for factor in (2.0, 0.5):
                value = scaled(f"{module}.{name}", value_of(module, name), factor)
                with changed(module, name, value):
                    other, after = answer(data)
                if other != names or abs(after / error - 1.0) > SAME_ERROR:
                    what = f"set {seed}, times {factor:g}: error {error:.1f} -> {after:.1f} rpm"
                    found[f"{module}.{name}"].append(
                        what if other == names else f"{what}, {names} -> {other}"
                    )
                    print(f"{module}.{name} {found[f'{module}.{name}'][-1]}", flush=True)
    print(f"{len(found)} of {len(constants)} constants change an answer of these sets")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
