"""A log of several sorties: how each is named, and what is said of the rest of the log."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from thrustmargin.gcs_plugin.wording.numbers import duration
from thrustmargin.models.flight import FlightTrack


def sortie_suffix(number: int, of: int) -> str:
    """` sortie 2 of 3` behind the name of a log; nothing where it holds one alone."""
    return f" sortie {number} of {of}" if of > 1 else ""


def sortie_words(number: int, track: FlightTrack) -> str:
    """Which one it is, when it began, and how long it flew."""
    flown = f"{duration(float(track.row_seconds[track.flying].sum()))} in flight"
    unknown = float("nan")
    try:
        begun = datetime.fromtimestamp(
            unknown if track.start_unix_s is None else track.start_unix_s, tz=UTC
        )
    except (ValueError, OverflowError, OSError):  # none is known, or what is known is no time
        return f"sortie {number}: {flown}"
    return f"sortie {number}: from {begun:%Y-%m-%d %H:%M:%S} UTC, {flown}"


def restart_words(restarts: int) -> str:
    """That the vehicle's clock began anew in the log."""
    return f"time went backwards {restarts} time(s) (restart): each stretch is read alone"


def several_words(sorties: int, *, load_stated: bool) -> str:
    """That a log holds several sorties, and that what the user states is taken for each."""
    each = "; the load that you state is taken for each of them" if load_stated else ""
    return f"{sorties} sorties in the log, each a flight of its own{each}"


def unflown_words(seconds: Sequence[float], reasons: Sequence[str]) -> tuple[str, ...]:
    """What of a log has no verdict: stretches without flight, s, and those that cannot be read."""
    idle = ()
    if seconds:
        several = "a stretch" if len(seconds) == 1 else f"{len(seconds)} stretches"
        idle = (f"no verdict on {several} without flight, {duration(sum(seconds))} in all",)
    return (*idle, *(f"no verdict on a stretch between restarts: {reason}" for reason in reasons))
