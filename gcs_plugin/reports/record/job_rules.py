"""The rules that ask for a record, as data, and what of them a record answers."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache
from importlib import resources
from typing import Any


@dataclass(frozen=True, slots=True)
class RuleItem:
    """One thing that a rule asks for, the fields that answer it, and when it is due at all."""

    asks: str
    fields: tuple[str, ...]
    when: str = ""  # empty: always


@dataclass(frozen=True, slots=True)
class JobRule:
    """One rule: its title, how long its record is kept, and within how many hours it is due."""

    name: str
    title: str
    keep: str
    items: tuple[RuleItem, ...]
    due_hours: int | None = None


@cache
def job_rules() -> Mapping[str, JobRule]:
    """Name of each rule -> the rule."""
    text = (resources.files(__package__ or "") / "rules.toml").read_text("utf-8")
    return {name: _rule(name, table) for name, table in tomllib.loads(text).items()}


def _rule(name: str, table: Mapping[str, Any]) -> JobRule:
    items = tuple(
        RuleItem(item["asks"], tuple(item["fields"]), item.get("when", ""))
        for item in table["items"]
    )
    return JobRule(name, table["title"], table["keep"], items, table.get("due_hours"))


def open_items(rule: JobRule, known: Collection[str]) -> list[dict[str, Any]]:
    """The rule's items that the `known` fields do not answer: what, which fields, and when due."""
    return [
        {"asks": item.asks, "fields": lacking, "when": item.when}
        for item in rule.items
        if (lacking := [name for name in item.fields if name not in known])
    ]


def due_utc(rule: JobRule, finished: datetime | None) -> datetime | None:
    """When the record of a job that finished then is due; None where the rule sets no time."""
    if rule.due_hours is None or finished is None:
        return None
    return finished + timedelta(hours=rule.due_hours)


def fields_asked(rules: Sequence[JobRule]) -> tuple[str, ...]:
    """Fields that the rules ask for without a condition, each once, in their order."""
    asked = [f for rule in rules for item in rule.items if not item.when for f in item.fields]
    return tuple(dict.fromkeys(asked))
