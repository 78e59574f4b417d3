"""The check before take-off on recorded logs: a false "do not lift" would be seen here.

    python -m tests.lab.bench.takeoff_on_logs sitl_logs FOLDER...

Each run-up is checked three times: as the log is read, as a listener hears it (rows in parts of
0.5 s), and thinned to 2 Hz and 1 Hz. A line per run-up, then the sums. Made flights with a late
motor, none without propeller and a standing one are made of each sound run-up with rotor speeds:
the share that is said before lift-off is the last line.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.logs import read_sorties
from thrustmargin.gcs_plugin.logs.read import log_endings
from thrustmargin.models.checks.takeoff import TakeoffCheck, TakeoffWatch, takeoff_checks
from thrustmargin.models.errors import ThrustMarginError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import match_airframe
from thrustmargin.models.physics.airframe import Airframe, load_airframe

KNOWN = "topxgun-f16-sitl"
PART = 5  # rows in which a listener gets them
RATES = (2.0, 1.0)


@dataclass(frozen=True, slots=True)
class Flown:
    """One sortie: its name, its rows as read, as heard, and its airframe if it is known."""

    name: str
    track: FlightTrack
    heard: FlightTrack
    airframe: Airframe | None


def sorties(folders: list[Path]) -> Iterator[Flown]:
    """Yield every sortie of the logs in the folders; name those that cannot be read."""
    craft, endings = load_airframe(KNOWN), log_endings()
    for folder in folders:
        files = [folder] if folder.is_file() else sorted(folder.rglob("*"))
        for path in (p for p in files if p.suffix.lower() in endings):
            try:
                read, heard = (read_sorties(path, sampling=s) for s in ("linear", "hold"))
            except ThrustMarginError as error:
                print(f"{path.name}: not read: {str(error)[:90]}")
                continue
            for one, live in zip(read, heard, strict=False):
                airframe_match = match_airframe(
                    one.track, craft, one.facts, one.parameters, given=False
                )
                known = None if airframe_match.no_verdict else craft
                yield Flown(f"{path.parent.name}/{one.name}", one.track, live.track, known)


def listened(track: FlightTrack, airframe: Airframe | None) -> list[TakeoffCheck]:
    """Return the last check of each run-up, as a listener has it."""
    watch, found = TakeoffWatch(), dict[float, TakeoffCheck]()
    for first in range(0, track.time_s.size, PART):
        now = watch.add(track.rows(slice(first, first + PART)), airframe)
        if now is not None:
            found[now.begin_s] = now
    return list(found.values())


def thinned(track: FlightTrack, hz: float) -> FlightTrack:
    """Return the rows of a track at most `hz` a second."""
    kept = np.unique(np.floor((track.time_s - track.time_s[0]) * hz + 1e-6), return_index=True)[1]
    return track.rows(kept)


def shown(checks: list[TakeoffCheck]) -> str:
    """Return the findings of checks as text."""
    return "; ".join(
        f"{one.kind} {','.join(str(m + 1) for m in one.motors)} at {one.time_s:.1f}"
        for check in checks
        for one in check.findings
    )


def late(track: FlightTrack, check: TakeoffCheck, motor: int) -> FlightTrack:
    """A motor that turns only 1.5 s after it did."""
    speeds = track.rotor_speed_rpm.copy()
    speeds[track.time_s < check.motors[motor].turned_s + 1.5, motor] = 0.0
    return replace(track, rotor_speed_rpm=speeds)


def stands(track: FlightTrack, check: TakeoffCheck, motor: int) -> FlightTrack:  # noqa: ARG001
    """A motor that never turns."""
    speeds = track.rotor_speed_rpm.copy()
    speeds[:, motor] = 0.0
    return replace(track, rotor_speed_rpm=speeds)


def bare(track: FlightTrack, check: TakeoffCheck, motor: int) -> FlightTrack:  # noqa: ARG001
    """A motor that turns half as fast again from an output of 0.2 on: no propeller."""
    speeds = track.rotor_speed_rpm.copy()
    speeds[:, motor] *= np.where(track.throttle[:, motor] > 0.2, 1.5, 1.0)
    return replace(track, rotor_speed_rpm=speeds)


FAULTS: dict[str, Callable[[FlightTrack, TakeoffCheck, int], FlightTrack]] = {
    "late": late,
    "stands": stands,
    "without propeller": bare,
}


def said_in_time(flown: Flown, check: TakeoffCheck, hz: float | None) -> dict[str, list[bool]]:
    """Return by fault and motor whether that motor is named before lift-off."""
    begin = np.searchsorted(flown.track.time_s, check.begin_s - 1.0)
    end = np.searchsorted(flown.track.time_s, check.until_s, side="right")
    whole = flown.track.rows(slice(begin, end))
    result: dict[str, list[bool]] = {}
    for name, fault in FAULTS.items():
        for motor, start in enumerate(check.motors):
            if not np.isfinite(start.turned_s):
                continue
            made = fault(whole, check, motor)
            made = made if hz is None else thinned(made, hz)
            found = [f for one in takeoff_checks(made, flown.airframe) for f in one.forbidding]
            before = any(f.motors == (motor,) and f.time_s <= check.lift_s for f in found)
            result.setdefault(name, []).append(before)
    return result


def main(folders: list[Path]) -> None:
    counts: Counter[str] = Counter()
    named: dict[tuple[str, str], list[bool]] = {}
    for flown in sorties(folders):
        checks = takeoff_checks(flown.track, flown.airframe)
        live = listened(flown.heard, flown.airframe)
        others = {
            f"{hz:g} Hz": takeoff_checks(thinned(flown.track, hz), flown.airframe) for hz in RATES
        }
        ways = {"log": checks, "live": live, **others}
        counts["sorties"] += 1
        counts["run-ups"] += len(checks)
        for way, found in ways.items():
            counts[f"do not lift, {way}"] += any(one.forbidding for one in found)
        apart = [
            max(m.turned_s for m in one.motors) - min(m.turned_s for m in one.motors)
            for one in checks
        ]
        states = Counter(m.state.value for one in checks for m in one.motors)
        print(
            f"{flown.name[:44]:44} {'known' if flown.airframe else '-':5} "
            f"{', '.join(f'{n} {s}' for s, n in states.items()) or 'no run-up':28} "
            f"{' '.join(f'{a:.1f}' for a in apart):8} "
            + (" | ".join(f"{way}: {said}" for way, f in ways.items() if (said := shown(f))) or "-")
        )
        for check in checks:
            if np.isfinite(check.lift_s) and not check.forbidding and check.reporting:
                for way, hz in (("10 Hz", None), ("2 Hz", 2.0)):
                    for fault, said in said_in_time(flown, check, hz).items():
                        named.setdefault((fault, way), []).extend(said)
                        if not all(said):
                            print(f"    {fault}, {way}: {said.count(False)} of {len(said)} not")
    print("\n".join(f"{count:5} {what}" for what, count in counts.items()))
    for (fault, way), said in named.items():
        print(f"{fault}, {way}: {sum(said)} of {len(said)} said before lift-off")


if __name__ == "__main__":
    main([Path(folder) for folder in sys.argv[1:]])
