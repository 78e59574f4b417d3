"""Say what was found as data: its kind, and the numbers and names that its sentence needs.

`gcs_plugin/wording/check_words.py` has one sentence for each kind, which is translated. Code that
decides reads numbers and verdicts, never a sentence.
"""

from __future__ import annotations

from dataclasses import dataclass


class Source:
    """What a statement can name as the source of a number: a `Provenance`."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Statement:
    """A finding to put into words: the kind of its sentence, the clauses after it, and the
    values of both."""

    kind: str
    clauses: tuple[str, ...] = ()  # kinds of the clauses that follow the sentence
    values: tuple[tuple[str, Value], ...] = ()

    @classmethod
    def of_text(cls, text: str) -> Statement:
        """Return the statement of a text, which earlier versions wrote into files."""
        return cls("as written", values=(("text", text),))

    def __str__(self) -> str:
        """Return the statement as data, for programmers: `swapped (first 1, second 2)`."""
        values = ", ".join(f"{name} {_text(value)}" for name, value in self.values)
        words = ", ".join((self.kind, *self.clauses))
        return f"{words} ({values})" if values else words


def _text(value: Value) -> str:
    """Return a value as text, numbers with at most 6 digits."""
    if isinstance(value, tuple):
        return "; ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


#: A number, a name, the source of a number, or what another sentence or a list of them holds.
Value = float | str | Statement | Source | tuple[Statement, ...]


def state(kind: str, *clauses: str, **values: Value) -> Statement:
    """Return a statement of a kind with its clauses and values."""
    return Statement(kind, clauses, tuple(values.items()))
