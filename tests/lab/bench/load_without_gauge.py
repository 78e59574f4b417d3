"""The load and the redundancy that hover thrust shows, against the gauge of recorded flights.

    python tests/lab/bench/load_without_gauge.py GROUP=LOG... [GROUP=LOG...] [--airframe NAME]

Each log is read with its gauge and again without one (as with `--tank none`), as a file and as a
listener has it; prints the rows of the table in docs/measured.md. A GROUP is any word.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.inferred.load_inference import (
    Inferred,
    fill_channels,
    fill_channels_so_far,
)
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe

INTERVAL = 1.645  # standard errors of a 90 % interval

PIECE = 25  # rows a listener gets at once
HEADING = (
    "| flights | n | as | mean error, kg | RMS error, kg | worst flight, kg | ±, kg | load inside "
    "| redundancy, RMS | redundancy ± | redundancy inside |\n" + "|---" * 11 + "|"
)


def heard(log: FlightLog, model: RotorModel) -> FlightTrack:
    """The track as a listener has it, in pieces."""
    so_far, parts = Inferred(), []
    track = log.track
    for first in range(0, track.time_s.size, PIECE):
        rows = track.rows(slice(first, first + PIECE))
        part, so_far = fill_channels_so_far(rows, model.airframe, log.parameters, so_far)
        parts.append(part)
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.followed_by(part)
    return whole


def errors(path: Path, model: RotorModel) -> Iterator[tuple[str, Floats]]:
    """For file and listener: (n, 4) off by kg, its ±, ln redundancy off by, its ±, in flight."""
    with_gauge = read_log(path, airframe=model.airframe)
    without = read_log(path, airframe=model.airframe, tank="none")
    whole = fill_channels(without.track, model.airframe, without.parameters)
    true = analyse(fill_channels(with_gauge.track, model.airframe, with_gauge.parameters), model)
    for kind, track in (("file", whole), ("live", heard(without, model))):
        found = analyse(track, model)
        both = true.track.flying & np.isfinite(true.track.tank_kg) & np.isfinite(track.tank_kg)
        off = track.tank_kg - true.track.tank_kg
        ratio = np.log(found.redundancy_yaw_uncontrolled / true.redundancy_yaw_uncontrolled)
        reach = track.standard_errors.get("tank_kg", np.full_like(off, np.nan))
        yield (
            kind,
            np.stack([off, INTERVAL * reach, ratio, INTERVAL * found.redundancy_error])[:, both].T,
        )


def row(group: str, kind: str, flights: list[Floats]) -> str:
    """One row of the table; shares of rows, so that a flight in which all is off counts fully."""
    known = [f for f in flights if f.size]
    if not known:
        return f"| {group} | 0 of {len(flights)} | {kind} |" + " |" * 8
    off, reach, ratio, around = np.concatenate(known).T
    rms = [float(np.sqrt(np.mean(f[:, 0] ** 2))) for f in known]
    return (
        f"| {group} | {len(known)} of {len(flights)} | {kind} | {off.mean():+.2f} "
        f"| {np.sqrt(np.mean(off**2)):.2f} | {max(rms):.2f} | {np.median(reach):.1f} "
        f"| {np.mean(np.abs(off) <= reach):.0%} | {np.sqrt(np.mean(ratio**2)):.1%} "
        f"| {np.median(around):.1%} | {np.mean(np.abs(ratio) <= around):.0%} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Load and redundancy against the gauge.")
    parser.add_argument("logs", nargs="+", help="GROUP=LOG, or LOG of the group before it")
    parser.add_argument("--airframe", default="topxgun-f16-sitl")
    given = parser.parse_args()
    model = physics_model(load_airframe(given.airframe))
    found: dict[tuple[str, str], list[Floats]] = defaultdict(list)
    group = "flights"
    for word in given.logs:
        name, equals, path = word.partition("=")
        group, path = (name, path) if equals else (group, word)
        for kind, made in errors(Path(path), model):
            found[group, kind].append(made)
    print(HEADING)
    for (group, kind), flights in found.items():
        print(row(group, kind, flights))


if __name__ == "__main__":
    main()
