"""Learn an aircraft from its flights, keep them for a season, and match its load with its power."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.store.hangar import Hangar, KnownAircraft
    from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "learn": "Make aircraft known from their logs, or take the logs of a season into its store",
    "match": "Match an aircraft's load with its power system",
    "train": "Train the rotor speed model of one aircraft on its own good flights",
}


def _learn_words(words: Sequence[str]) -> list[str]:
    """Return the words of `learn` that take logs into the store as `ingest` did with `words`."""
    from thrustmargin.gcs_plugin.store.hangar import open_hangar

    stored = any(word.partition("=")[0] == "--store" for word in words)
    return ["learn", *(() if stored else ("--store", str(open_hangar().folder))), *words]


#: Subcommand of an older version -> the command line that does the same now, by its words.
RETIRED = {"ingest": _learn_words}
#: Libraries of the season's store and of the sums that it keeps.
NEEDED = ("fsspec", "pyarrow", "filelock", "scipy")


def keep_flights(
    flights: Sequence[tuple[LearntFlight, FlightLog]], aircraft: KnownAircraft, hangar: Hangar
) -> None:
    """Write flights of a known aircraft to the season's store in the hangar's folder.

    Do nothing if the store's libraries are not installed. Raises DataError if the store cannot be
    written.
    """
    if not flights or any(find_spec(name) is None for name in NEEDED):
        return
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import keep_flights

    keep_flights(flights, aircraft, hangar)


def forget_flight(flight: str, hangar: Hangar) -> None:
    """Remove a flight from the season's store, where its libraries are installed."""
    if any(find_spec(name) is None for name in NEEDED):
        return
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import forget_flight

    forget_flight(flight, hangar)
