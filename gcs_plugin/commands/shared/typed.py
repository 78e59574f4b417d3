"""The words of a command line before they are read: what a user may write in more than one way.

This file imports no library at its head: the help must be there at once.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass, replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

if TYPE_CHECKING:
    from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

#: In the wheel as in the project, next to `gcs_plugin`.
BUNDLED = Path(__file__).resolve().parents[3] / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
#: The field of `cover demo`, in the wheel too.
BUNDLED_FIELD = Path(__file__).resolve().parents[3] / "mission" / "demo_field.kml"
#: In place of a log: the bundled flight.
DEMO = "demo"
#: Options whose value may be that word and is no log.
_NO_LOG = ("--name", "--title", "--store", "--airframe", "--tank")
_SHARE = "--max-utilisation"


def as_read(argv: Sequence[str]) -> list[str]:
    """Return the words of a command line as the parser takes them.

    `demo` is replaced by the bundled file, unless the working folder has a file of that name. A
    limit in per cent becomes a share, an amount with a unit the number alone, and an older option's
    name the present one.
    """
    words: list[str] = []
    for word in _without_units(_renamed(argv)):
        before = words[-1] if words else ""
        if word == "%" and words[-2:-1] == [_SHARE]:
            words[-1] = _share(f"{before} %")
            continue
        if before == _SHARE or word.startswith(f"{_SHARE}="):
            word = _share(word)
        if word == DEMO and words and before not in _NO_LOG and not Path(DEMO).exists():
            word = str(BUNDLED_FIELD if words[0] == "cover" else BUNDLED)
        words.append(word)
    return words


def _renamed(argv: Sequence[str]) -> Sequence[str]:
    """Return the command line with older options of `train` and `identify` replaced by the present
    ones.

    --out of a model becomes --out-model, --html becomes --out. Other commands are unchanged.
    """
    if not argv or argv[0] not in ("train", "identify"):
        return argv
    words = [word for given in argv for word in _split(given)]
    for place, (word, value) in enumerate(zip(words, [*words[1:], ""], strict=True)):
        if word == "--out" and (words[0] == "train" or value.endswith(".safetensors")):
            words[place] = "--out-model"
        elif word == "--html":
            words[place] = "--out"
    return words


def _split(word: str) -> list[str]:
    """Split `--out=x` and `--html=x` into two words; return any other word alone."""
    return word.split("=", 1) if word.startswith(("--out=", "--html=")) else [word]


def _share(word: str) -> str:
    """Return `50%` or `50 %` as `0.5`; other words unchanged."""
    found = re.fullmatch(r"(--[\w-]+=)?\s*(\d+(?:[.,]\d+)?)\s*%", word)
    if found is None:
        return word
    return f"{found[1] or ''}{float(found[2].replace(',', '.')) / 100.0:.6g}"


#: Option -> the units in which its amount may be typed. Those of liquid take both, and convert.
_UNITS = {
    **dict.fromkeys(("--load", "--load-end", "--tank-start-kg"), ("kg",)),
    **dict.fromkeys(("--mass", "--max-takeoff-kg"), ("kg",)),
    "--tank-litres": ("l",),
    "--fill": ("kg", "l"),
}


def _without_units(words: Sequence[str]) -> list[str]:
    """Return the words without a unit after amounts: `6 kg` or `6kg` after an option in kg becomes
    `6`.

    An option that takes several units keeps the unit, joined to the number. A unit that the option
    does not take is kept, so that the parser rejects it.
    """
    made: list[str] = []
    for word in words:
        before = made[-2] if len(made) > 1 else ""
        if before in _UNITS and word.lower() in _UNITS[before] and _AMOUNT.fullmatch(made[-1]):
            made[-1] = f"{made[-1]}{word}"
        else:
            made.append(word)
    for place, word in enumerate(made):
        option, given, value = word.partition("=")
        if not given:
            option, value = made[place - 1] if place else "", word
        units = _UNITS.get(option, ())
        found = _AMOUNT_IN_UNIT.fullmatch(value)
        if found is not None and len(units) == 1 and found[2].lower() in units:
            number = found[1].replace(",", ".")
            made[place] = f"{option}={number}" if given else number
    return made


_AMOUNT = re.compile(r"\d+(?:[.,]\d+)?")
_AMOUNT_IN_UNIT = re.compile(rf"\s*({_AMOUNT.pattern})\s*([a-zA-Z]+)\s*")


def hide_none(target: Any) -> None:
    """Change the annotations of a command so that its help prints no `(default: None)`.

    Dataclasses among its parameters are changed too.
    """
    import tyro

    nothing = tyro.conf.arg(help_behavior_hint="")
    hints = get_type_hints(target, include_extras=True)
    for name, about in inspect.signature(target).parameters.items():
        for inner in _inner_types(hints.get(name)):
            if isinstance(inner, type) and is_dataclass(inner):
                hide_none(inner)
        if about.default is None and name in hints:
            hints[name] = Annotated[hints[name], nothing]
    target.__annotations__ = hints


def _inner_types(hint: Any) -> Iterator[Any]:
    yield hint
    for inner in get_args(hint):
        yield from _inner_types(inner)


def plain_optionals() -> ConstructorRegistry:
    """Return tyro's rules with one more, by which help prints PATH and not {None}|PATH.

    It applies to each option of a type or None.
    """
    from tyro.constructors import ConstructorRegistry, PrimitiveTypeInfo

    registry = ConstructorRegistry()

    @registry.primitive_rule
    def optional(about: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        kinds = get_args(about.type)
        if NoneType not in kinds or len(kinds) != 2:
            return None
        inner = next(kind for kind in kinds if kind is not NoneType)
        of_inner = ConstructorRegistry.get_primitive_spec(
            PrimitiveTypeInfo.make(inner, about.markers)
        )
        if isinstance(of_inner, Exception):
            return None
        spec: Any = of_inner
        return replace(
            spec,
            is_instance=lambda value: value is None or spec.is_instance(value),
            str_from_instance=lambda value: (
                ["None"] if value is None else spec.str_from_instance(value)
            ),
        )

    return registry
