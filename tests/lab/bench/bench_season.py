"""How late wear is seen, and how often something is that is not there.

    python -m tests.lab.bench.bench_season [--seasons 20] [--healthy 300] [--seed 1]

Seasons are drawn from the sums of recorded good flights, which scatter as real ones do; one rotor
of one of them wears from flight 60 of 100. CUSUM and EWMA watch the same flights' raw speed ratio
of that rotor (median of measured over predicted speed), with the mean and the spread of the first
30 flights. Their limits are set so that 1 in 100 healthy seasons of four rotors has an alarm. A
battery ages from the same flight on, by its resistances in these flights.
"""

from __future__ import annotations

import argparse
import sys
from functools import cache

import numpy as np

from tests.models.identification.season.made_seasons import (
    LOSS_2,
    good_sums,
    good_tracks,
    wear,
    with_change,
)
from thrustmargin.gcs_plugin.office.season.part_history import resistance
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.season.change_points import SeasonEntry
from thrustmargin.models.identification.season.flight_sums import season_sums
from thrustmargin.models.identification.season.season_changes import season_changes
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.physics.known_battery import battery_resistance

FLIGHTS, FIRST, LEARNT = 100, 60, 30
RATES, AGEING = (0.0005, 0.001, 0.002, 0.005), (0.005, 0.01, 0.02)
SLACK, SMOOTHING = 0.5, 0.2  # of CUSUM in standard deviations; of EWMA


@cache
def ratios() -> np.ndarray:
    """(30, 4) median of measured over predicted speed of each good flight."""
    parts = [assemble(shipped_model(), [track]) for track in good_tracks()]
    return np.array([np.median(p.measured_rpm / p.speeds(), axis=0) for p in parts])


@cache
def resistances() -> np.ndarray:
    """(30, 2) ohm of the battery in each good flight, and its standard error."""
    tracks = good_tracks()
    return np.array([battery_resistance(t.time_s, t.voltage, t.current, t.flying) for t in tracks])


def battery(drawn: np.ndarray, per_flight: float = 0.0) -> tuple[SeasonEntry, ...]:
    """What is said of a battery whose resistance grows by such a share from FIRST on."""
    ohm, error = resistances()[drawn].T
    grown = ohm * (1.0 + per_flight * np.maximum(np.arange(drawn.size) - FIRST + 1, 0))
    flights = [
        {"battery_ohm": a, "battery_ohm_error": b} for a, b in zip(grown, error, strict=True)
    ]
    trend = resistance(flights)
    return trend.changes if trend else ()


def battery_seen_after(drawn: np.ndarray, per_flight: float) -> float:
    """Flights after the first aged one until it is found."""
    ends = range(FIRST + 1, FLIGHTS + 1)
    found = (end - FIRST for end in ends if battery(drawn[:end], per_flight))
    return float(next(found, np.inf))


def charts(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(F,) CUSUM and EWMA of a speed ratio, upwards, in standard deviations of its first flights;
    0 in these."""
    z = (ratio - ratio[:LEARNT].mean()) / ratio[:LEARNT].std(ddof=1)
    cusum, ewma = np.zeros(z.size), np.zeros(z.size)
    for k in range(LEARNT, z.size):
        cusum[k] = max(0.0, cusum[k - 1] + z[k] - SLACK)
        ewma[k] = (1.0 - SMOOTHING) * ewma[k - 1] + SMOOTHING * z[k]
    return cusum, ewma


def limits(rng: np.random.Generator, seasons: int = 4000) -> tuple[float, float]:
    """Of CUSUM and EWMA, that 1 in 100 healthy seasons goes beyond with any rotor."""
    highest = []
    for _ in range(seasons):
        drawn = ratios()[rng.integers(0, len(ratios()), FLIGHTS)]
        highest.append(np.max([[c.max() for c in charts(drawn[:, r])] for r in range(4)], axis=0))
    cusum, ewma = np.quantile(highest, 0.99, axis=0)
    return float(cusum), float(ewma)


def seen_after(flights: list, rate: float) -> tuple[float, float]:
    """Flights after the first worn one until the right entry is there, and by how many flights
    its date is off then; infinite and NaN where it is never seen."""
    worn = with_change(flights, LOSS_2, wear(FLIGHTS, FIRST, rate))

    def off(count: int) -> float | None:
        trend = season_changes(season_sums(worn[:count])).trend(LOSS_2)
        return float(trend.changes[0].flight - FIRST) if trend and trend.changes else None

    low, high = FIRST, FLIGHTS
    if off(high) is None:
        return np.inf, np.nan
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if off(middle) is not None else (middle, high)
    return float(high - FIRST), float(off(FLIGHTS) or 0.0)


def first_above(chart: np.ndarray, limit: float) -> float:
    above = np.flatnonzero(chart[FIRST:] > limit)
    return float(above[0] + 1) if above.size else np.inf


def main(words: list[str]) -> None:
    given = argparse.ArgumentParser()
    given.add_argument("--seasons", type=int, default=20)
    given.add_argument("--healthy", type=int, default=300)
    given.add_argument("--seed", type=int, default=1)
    asked = given.parse_args(words)
    rng = np.random.default_rng(asked.seed)
    of_cusum, of_ewma = limits(rng)
    good = good_sums()
    print(f"wear from flight {FIRST + 1} of {FLIGHTS}; {asked.seasons} seasons each; flights until")
    print("it is seen (median), and the date's error at the end of the season (largest)")
    print("wear a flight  thrustmargin  CUSUM  EWMA  date off by")
    for rate in RATES:
        own, cusum, ewma = [], [], []
        for _ in range(asked.seasons):
            drawn = rng.integers(0, len(good), FLIGHTS)
            own.append(seen_after([good[k] for k in drawn], rate))
            lost = wear(FLIGHTS, FIRST, rate)
            found = charts(ratios()[drawn, 1] / np.sqrt(1.0 - lost))
            cusum.append(first_above(found[0], of_cusum))
            ewma.append(first_above(found[1], of_ewma))
        late = [float(np.median(x)) for x in (np.array(own)[:, 0], cusum, ewma)]
        dates = np.nanmax(np.abs(np.array(own)[:, 1]))
        print(
            f"{100 * rate:11.2f} % {late[0]:13g} {late[1]:6g} {late[2]:5g} {dates:12g}", flush=True
        )
    print("battery's resistance grows a flight, seen after flights (median)")
    for rate in AGEING:
        drawn = [rng.integers(0, len(good), FLIGHTS) for _ in range(asked.seasons)]
        late = [battery_seen_after(one, rate) for one in drawn]
        print(f"{100 * rate:11.1f} % {float(np.median(late)):13g}", flush=True)
    false = of_battery = 0
    for _ in range(asked.healthy):
        drawn = rng.integers(0, len(good), FLIGHTS)
        found = season_changes(season_sums([good[k] for k in drawn]))
        of_battery += (aged := bool(battery(drawn)))
        false += aged or any(t.changes for t in found.trends) or bool(found.shared)
    print(f"healthy seasons with an entry: {false} of {asked.healthy}, {of_battery} of a battery")


if __name__ == "__main__":
    main(sys.argv[1:])
