"""Does every rotor speed sensor follow its rotor, or does one hold its last reading?

In flight no two readings of a rotor that is being controlled stay exactly alike for long, and how
long they may (coarse steps, calm air) the other rotors of the same flight show. A reading that is
held for much longer than theirs is not of the rotor; one that all rotors hold together was not
reported anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats

HELD_S = 1.0  # a shorter run of equal readings says nothing
STALE_S = 10.0  # that all rotors may hold their readings together
FAR_LONGER = 5.0  # times the longest run that the other rotors show
SUSPECT_S = 2.0  # held in all, from which a sensor is named
LONGEST_STEP = 1.0  # s; rows further apart are not one run
FEWEST_ROWS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckSensor:
    """What the runs of exactly equal readings in flight say."""

    verdict: Literal["follows", "sticks", "stale", "unknown"]
    words: str
    rotors: tuple[int, ...]  # 0-based, that stick
    held_s: float  # for which they do, in all
    share: float  # of the time in flight


def check_stuck_sensor(track: FlightTrack) -> StuckSensor:
    """Look for rotor speeds that stand still in flight while the others of the flight move.

    Needs two or more rotors with readings; says "unknown" with fewer or with few rows.
    """
    readings = track.rotor_speed_rpm
    known = np.isfinite(readings).all(axis=1) & (readings > 0.0).all(axis=1) & track.flying
    if np.sum(known) < FEWEST_ROWS or track.rotor_count < 2:
        words = "cannot tell: too few rows in flight with every rotor's speed"
        return StuckSensor(
            verdict="unknown", words=words, rotors=(), held_s=0.0, share=float("nan")
        )
    joined = known[1:] & known[:-1] & (np.diff(track.time_s) <= LONGEST_STEP)
    flown = float(np.sum(np.diff(track.time_s)[joined]))
    same = (readings[1:] == readings[:-1]) & joined[:, None]
    runs = [_runs(track.time_s, same[:, k]) for k in range(track.rotor_count)]
    together = _runs(track.time_s, same.all(axis=1))
    stale = together[together[:, 1] >= STALE_S]
    if stale.size:
        return _stale(stale, flown)
    longest = np.array([r[:, 1].max(initial=0.0) for r in runs])
    found = []
    for k, run in enumerate(runs):
        others = float(np.median(np.delete(longest, k)))
        held = run[run[:, 1] >= max(HELD_S, FAR_LONGER * others)]
        if held[:, 1].sum() >= SUSPECT_S:
            found.append((k, held))
    if not found:
        words = f"every rotor speed moves; none stays alike for more than {longest.max():.1f} s"
        return StuckSensor(verdict="follows", words=words, rotors=(), held_s=0.0, share=0.0)
    total = float(sum(held[:, 1].sum() for _, held in found))
    return StuckSensor(
        verdict="sticks",
        words="; ".join(_sticks(k, held, longest) for k, held in found),
        rotors=tuple(k for k, _ in found),
        held_s=total,
        share=total / flown,
    )


def _runs(time_s: Floats, same: Bools) -> Floats:
    """(n, 2) start and length in s of each run; `same` (T-1,) says a row is like the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    first, last = edges[::2], edges[1::2]
    return np.stack([time_s[first], time_s[last] - time_s[first]], axis=1)


def _sticks(rotor: int, held: Floats, longest: Floats) -> str:
    start, length = held[np.argmax(held[:, 1])]
    others = float(np.delete(longest, rotor).max())
    return (
        f"the speed sensor of rotor {rotor + 1} sticks: {held.shape[0]} time(s) its reading stays "
        f"exactly alike, the longest {length:.1f} s at {start:.0f} s; the others' at most "
        f"{others:.1f} s"
    )


def _stale(stale: Floats, flown: float) -> StuckSensor:
    start, length = stale[np.argmax(stale[:, 1])]
    total = float(stale[:, 1].sum())
    return StuckSensor(
        verdict="stale",
        words=(
            f"all rotor speeds stand still together {stale.shape[0]} time(s), the longest "
            f"{length:.1f} s at {start:.0f} s: they were not reported anew"
        ),
        rotors=(),
        held_s=total,
        share=total / flown,
    )
