"""A season of 12 aircraft made from recorded flights, as a store that `fleet` reads.

What wears, is swapped, drifts and ages is put into the flights' reports by the tests' own plant
(`tests.lab.undeclared.recorded`), and they go into the store as `learn` puts any flight there.

    python -m tests.lab.season_plant STORE [--flights 40] [--aircraft 12]
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.recorded import CAMPAIGN, implanted

START = 1.7776224e9  # s, 1 May 2026, 8:00 UTC
APART = 0.5 * 86400.0  # s, two flights a day


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What is wrong with one aircraft of the season."""

    words: str
    implant: Callable[[int, int], Implant] | None = None  # of a flight, of so many
    ohm: Callable[[int, int], float] | None = None  # more in the battery
    parts: tuple[str, ...] = ()  # position of a part that is new where the fault ends


def bad_rotor(rotor: int, loss: float) -> Implant:
    return Implant(kind="rotor", size=loss, condition={"rotor": rotor}, truth={"loss": loss})


def worn(k: int, n: int) -> Implant:
    return bad_rotor(1, 0.002 * max(0, k - n // 2 + 1))


def swapped(k: int, n: int) -> Implant:
    return bad_rotor(2, 0.03 if n // 4 <= k < 3 * n // 4 else 0.0)


def drifting(k: int, n: int) -> Implant:
    return Implant(kind="gauge", size=0.0, condition={"gauge_gain": 1.0 + 0.12 * k / n})


def shifted(k: int, n: int) -> Implant:
    return Implant(kind="cg", size=0.0, condition={"cg": (0.012 if k >= n // 2 else 0.0, 0.0)})


FAULTS: Mapping[str, Fault] = {
    "sprayer-02": Fault(words="propeller 2 wears", implant=worn),
    "sprayer-05": Fault(words="propeller 3 swapped", implant=swapped, parts=("propeller 3",)),
    "sprayer-07": Fault(words="gauge drifts", implant=drifting),
    "sprayer-08": Fault(words="battery ages", ohm=lambda k, n: 0.3 * max(0.0, k / n - 0.3)),
    "sprayer-11": Fault(words="centre of gravity moved", implant=shifted),
}


@dataclass(frozen=True)
class Work:
    """One flight to be made."""

    store: str
    aircraft: str
    number: int
    flights: int


@cache
def _log(place: int):  # a FlightLog and its AirframeMatch
    from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import season_model

    paths = [*sorted(CAMPAIGN.glob("*.tlog")), *sorted(CAMPAIGN.parent.glob("dev/windy_*.tlog"))]
    return matched_flights(paths[place], season_model(None, None)[0], given=False)[0]


def make_flight(work: Work) -> str:
    """Stage one flight of the season; returns its name."""
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore
    from thrustmargin.gcs_plugin.store.staging import stage
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, flight_of_log

    k, n = work.number, work.flights
    own = int(work.aircraft[-2:])
    rng = np.random.default_rng([own, k])
    log, airframe_match = _log(int(rng.integers(30)))
    fault = FAULTS.get(work.aircraft, Fault(words=""))
    track = implanted(log.track, [fault.implant(k, n)] if fault.implant else [])
    ohm = fault.ohm(k, n) if fault.ohm else 0.0
    voltage = track.voltage - ohm * np.nan_to_num(track.current)
    track = replace(track, voltage=voltage, start_unix_s=START + APART * k + 60.0 * own)
    name = hashlib.sha256(f"{work.aircraft} {k}".encode()).hexdigest()[:16]
    settings = IngestSettings(store=work.store, aircraft=work.aircraft)
    flight = flight_of_log(replace(log, track=track), airframe_match, name, settings)
    flight.summary["log_name"] = f"{work.aircraft}_{k + 1:03d}.tlog"
    stage(SeasonStore.open(work.store), flight)
    return name


def make_season(store: Path, *, flights: int, aircraft: list[str], workers: int = 2) -> None:
    """Fill a store with a season, and its parts.csv."""
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore
    from thrustmargin.gcs_plugin.store.staging import merge, staged_partitions

    store.mkdir(parents=True, exist_ok=True)
    todo = [Work(str(store), name, k, flights) for name in aircraft for k in range(flights)]
    with ProcessPoolExecutor(workers) as pool:
        for done, _ in enumerate(pool.map(make_flight, todo, chunksize=4), 1):
            if done % 20 == 0:
                print(f"{done} of {len(todo)} flights", flush=True)
    opened = SeasonStore.open(str(store))
    for where, keys in staged_partitions(opened).items():
        merge(opened, *where, keys)
    lines = ["part,aircraft,position,installed_at,removed_at"]
    swap = np.datetime64(int(START + APART * (3 * flights // 4) - 3600.0), "s")
    for name in aircraft:
        for position in FAULTS.get(name, Fault(words="")).parts:
            lines.append(f"P-{name[-2:]}-old,{name},{position},,{swap}")
            lines.append(f"P-{name[-2:]}-new,{name},{position},{swap},")
    (store / "parts.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    given = argparse.ArgumentParser()
    given.add_argument("store", type=Path)
    given.add_argument("--flights", type=int, default=40)
    given.add_argument("--aircraft", nargs="*", help="names; without them sprayer-01 to -12")
    asked = given.parse_args()
    every = asked.aircraft or [f"sprayer-{k:02d}" for k in range(1, 13)]
    make_season(asked.store, flights=asked.flights, aircraft=every)
