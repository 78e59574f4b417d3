"""The words of a command line before they are read: what one may write in more than one way."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

#: In the wheel as in the project, beside `gcs_plugin`.
BUNDLED = Path(__file__).resolve().parents[3] / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
#: The field of `cover demo`, in the wheel too.
BUNDLED_FIELD = Path(__file__).resolve().parents[3] / "mission" / "coverage" / "demo_field.kml"
#: In place of a log: the bundled flight.
DEMO = "demo"
#: Options whose value may be that word and is no log.
_NO_LOG = ("--name", "--title", "--store", "--airframe", "--tank")
_SHARE = "--max-utilisation"


def as_read(argv: Sequence[str]) -> list[str]:
    """The words with `demo` as what is bundled, and the limit in percent as a share.

    A file or folder of that name in the working folder is meant itself.
    """
    words: list[str] = []
    for word in _renamed(argv):
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
    """`train` and `identify` with their options of now: --out was the model, --html the page."""
    if not argv or argv[0] not in ("train", "identify"):
        return argv
    words = [word for given in argv for word in _apart(given)]
    for place, (word, value) in enumerate(zip(words, [*words[1:], ""], strict=True)):
        if word == "--out" and (words[0] == "train" or value.endswith(".safetensors")):
            words[place] = "--out-model"
        elif word == "--html":
            words[place] = "--out"
    return words


def _apart(word: str) -> list[str]:
    """`--out=x` as two words."""
    return word.split("=", 1) if word.startswith(("--out=", "--html=")) else [word]


def _share(word: str) -> str:
    """`50%`, `50 %` as 0.5; another word as it is."""
    found = re.fullmatch(r"(--[\w-]+=)?\s*(\d+(?:[.,]\d+)?)\s*%", word)
    if found is None:
        return word
    return f"{found[1] or ''}{float(found[2].replace(',', '.')) / 100.0:.6g}"


def plain_optionals() -> ConstructorRegistry:
    """Makes help say PATH of an option that may be left out, not {None}|PATH."""
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
