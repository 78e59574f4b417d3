"""Parts of every report: the page around it, its style, its plots, and the logs left out."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusedLog:
    """A log that took no part in a report or an identification, and why."""

    name: str
    reason: str
