"""How far long work is, on standard error where somebody watches it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def steps(console: Console, *, total: float) -> Iterator[Callable[[str, float], None]]:
    """A bar up to `total`, moved by calls with what is being done and how much has been done."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        task = bars.add_task("loading torch", total=total)

        def step(what: str, done: float) -> None:
            bars.update(task, description=what, completed=done)

        yield step


@contextmanager
def transfer_bar() -> Iterator[tuple[Callable[[str], None], Callable[[int, int], None]]]:
    """A bar on standard error: what to call with its text, and with done and total."""
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        task = bars.add_task("", total=None)

        def say(text: str) -> None:
            bars.update(task, description=escape(text))

        def show(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield say, show
