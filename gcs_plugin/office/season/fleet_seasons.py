"""Compute the season of every aircraft of a store, on all cores if there are many aircraft."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, steps
from thrustmargin.gcs_plugin.office.season.aircraft_season import (
    AircraftSeason,
    aircraft_season,
    group_by_frame,
)
from thrustmargin.gcs_plugin.office.season.fleet_page import FleetSeason, rank_aircraft
from thrustmargin.gcs_plugin.office.season.part_history import with_parts
from thrustmargin.gcs_plugin.office.season.parts import Part
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, read_flights, read_sums
from thrustmargin.gcs_plugin.store.worker_processes import in_processes, own_cores
from thrustmargin.models.errors import DataError

#: Number of aircraft from which on other processes save time, and aircraft per task of a process.
MANY, GIVEN = 24, 8


def fleet_season(
    store: SeasonStore, aircraft: str | None = None, parts: Sequence[Part] = ()
) -> FleetSeason:
    """Return the season of all aircraft of a store, or of the one named `aircraft`.

    `parts` are the installed and removed parts of all aircraft. A progress bar is shown on stderr.
    Raises DataError if the store has no aircraft of that name.
    """
    names = store.aircraft()
    if aircraft is not None and aircraft not in names:
        raise DataError(f"no aircraft {aircraft!r} in the store; it has {', '.join(names)}")
    chosen = names if aircraft is None else [aircraft]
    done: list[AircraftSeason] = []
    with steps(Terminal(stderr=True), total=len(chosen)) as step:
        for many in _seasons(store, chosen, parts):
            done += many
            step(many[-1].name, float(min(len(done), len(chosen))))
    done.sort(key=lambda one: one.name)
    rejected = store.table("rejected", columns=["log_name"]).num_rows
    where = store.url if store.naming_key() is None else "anonymised"  # a path may name people
    return rank_aircraft(where, with_parts(done, parts), rejected)


def _seasons(
    store: SeasonStore, names: Sequence[str], parts: Sequence[Part]
) -> Iterator[list[AircraftSeason]]:
    """Yield lists of seasons, each of at most GIVEN of the aircraft `names`.

    Many aircraft are computed by several processes; lists then come in the order in which they are
    ready.
    """
    groups = [names[k : k + GIVEN] for k in range(0, len(names), GIVEN)]
    processes = own_cores() if len(names) >= MANY else 1
    yield from in_processes(partial(seasons_of, store.url, parts=parts), groups, processes)


def seasons_of(url: str, names: Sequence[str], parts: Sequence[Part]) -> list[AircraftSeason]:
    """Return the seasons of the aircraft `names` in the store at `url`.

    If aircraft of different frames (rotor number and layout) share a name, each frame has a season.
    """
    from threadpoolctl import threadpool_limits

    store, found = SeasonStore.open(url), []
    with threadpool_limits(1):  # small matrices: threads would only wait for each other
        for name in names:
            flights, sums = read_flights(store, name).to_pylist(), list(read_sums(store, name))
            frames = group_by_frame(flights)
            counts = {words: len(own) for words, own in frames.items()}
            for words, own in frames.items():
                whose = f"{name} ({words})" if len(frames) > 1 else name
                found.append(aircraft_season(whose, own, sums, parts, counts))
    return found
