"""The words of a command line before they are read: what one may write in more than one way.

What commands print: text of a log or a file name is shown, never obeyed; and progress.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, get_args

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment

from thrustmargin.gcs_plugin.commands.shared.options import QUIET
from thrustmargin.gcs_plugin.mavlink.text import clean_lines

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


class Terminal(Console):
    """A rich console for text from anywhere: markup, emoji codes and control bytes stay text.

    With --quiet standard output is silent, and standard error has words and no progress. Where
    nobody reads any more it is silent too: the command goes on with its files, or with `ends` set
    ends.
    """

    unread: ClassVar[bool] = False  # in this run of a command: its exit code says it

    def __init__(
        self, *, stderr: bool = False, soft_wrap: bool = False, ends: bool = False, **options: Any
    ) -> None:
        self._ends = ends
        if os.environ.get(QUIET):
            options |= {"force_terminal": False} if stderr else {"quiet": True}
        super().__init__(
            stderr=stderr,
            soft_wrap=soft_wrap,
            highlight=False,
            markup=False,
            emoji=False,
            **options,
        )

    def on_broken_pipe(self) -> None:
        """Raises SystemExit where the command is to end."""
        if self._ends:
            super().on_broken_pipe()
        self.quiet, Terminal.unread = True, True

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """The segments of what is printed; only rich's own may steer the terminal."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=clean_lines(segment.text))


@contextmanager
def steps(
    console: Console, *, total: float, lines: bool = False
) -> Iterator[Callable[[str, float], None]]:
    """A bar up to `total`, moved by calls with what is being done and how much has been done.

    With `lines`, where there is no terminal, a line for each kind of work as it begins: minutes
    without a word look like an end.
    """
    begun: set[str] = set()
    columns = (BarColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        task = bars.add_task("loading torch", total=total)

        def step(what: str, done: float) -> None:
            bars.update(task, description=what, completed=done)
            kind = what.partition(":")[0]
            if lines and bars.disable and not os.environ.get(QUIET) and kind not in begun:
                begun.add(kind)
                console.print(f"{kind} ...")

        yield step


@contextmanager
def transfer_bar() -> Iterator[tuple[Callable[[str], None], Callable[[int, int], None]]]:
    """A bar on standard error: what to call with its text, and with done and total."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
    console = Terminal(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        task = bars.add_task("", total=None)

        def announce(text: str) -> None:
            bars.update(task, description=text)

        def show(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield announce, show
