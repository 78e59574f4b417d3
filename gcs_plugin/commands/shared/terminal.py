"""Print for commands: text of a log or a file name is shown, never obeyed; and progress bars."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment

from thrustmargin.gcs_plugin.commands.shared.options import QUIET
from thrustmargin.gcs_plugin.wording.language import clean_lines


class Terminal(Console):
    """A rich console for untrusted text: markup, emoji codes and control bytes stay text.

    With --quiet standard output is silent, and standard error has words and no progress. Once
    nobody reads the output any more it is silent too: the command continues with its files, or ends
    if `ends` is set.
    """

    unread: ClassVar[bool] = False  # the output was closed in this run; the exit code reports it

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
        """Silence the terminal; raise SystemExit if a closed pipe ends the command."""
        if self._ends:
            super().on_broken_pipe()
        self.quiet, Terminal.unread = True, True

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments to print; only rich's own ones may control the terminal."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=clean_lines(segment.text))


@contextmanager
def steps(
    console: Console, *, total: float, lines: bool = False
) -> Iterator[Callable[[str, float], None]]:
    """Display a progress bar that is full at `total`, and yield the function to update it.

    It takes a text, the present work, and the amount done. Without a terminal there is no bar; with
    `lines` each kind of work, the text before a colon, then prints a line when it begins.
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
    """Display a progress bar on stderr for the `with` block, and yield two functions.

    The first sets the bar's text, the second the amount done and the total.
    """
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
