"""What identify costs: 6, 30 and 200 flights of one aircraft, and a day's six with more missing.

Run: `pytest tests/lab/bench/bench_identify.py --benchmark-only -o python_files='bench_*.py' -s`.
The recorded campaign is flown again and again, each time with a little noise of its own, and judged
against the shipped model. Ridge is fitted to the same residuals in the same process, which predicts
them anew: one column for each textbook effect, on means of a second. It names nothing and gives no
interval. Nothing here passes or fails by its time.
"""

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.recorded import hosts, implanted
from tests.lab.undeclared.rotor_aero import cut_for_loss
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel

AIM_MEGABYTES = 1024.0
F16 = CRAFTS[0]
WORN = Implant(
    kind="rotor",
    size=0.08,
    rotor=1,
    condition={"rotor": 1, "cut": cut_for_loss(F16.blade, 0.08)},
    truth={"loss": 0.08},
)
LOADED = Implant(kind="mass", size=0.065, condition={"hidden_mass": 2.0})
SHIFTED = Implant(kind="cg", size=0.026, condition={"cg": (0.02, -0.015)})
#: What is missing from the model.
MISSING = {"nothing": (), "three effects": (WORN, LOADED, SHIFTED)}
#: Processor seconds and largest memory, MiB, of a command, which alone says them last.
LAUNCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)
"""
SEASON = "import sys; from tests.lab.bench.bench_identify import main; main(int(sys.argv[1]))"


def season(count: int, missing: Sequence[Implant] = (WORN,)) -> list[FlightTrack]:
    """That many flights; by default with one propeller worn, so that there is something to find."""
    rng, every = np.random.default_rng(1), [implanted(track, missing) for track in hosts()]
    tracks = []
    for number in range(count):
        track = every[round(number * len(every) / min(count, len(every))) % len(every)]
        day = 1.0 + rng.normal(0.0, 2e-4)
        noise = rng.normal(0.0, 3.0, track.rotor_speed_rpm.shape)
        speeds = day * track.rotor_speed_rpm + noise
        tracks.append(replace(track, name=f"flight {number + 1}", rotor_speed_rpm=speeds))
    return tracks


def ridge(model: RotorModel, tracks: Sequence[FlightTrack]) -> np.ndarray:
    """(K,) coefficients of the textbook effects in what the model leaves."""
    from tests.lab.undeclared.methods import blocks, columns_of
    from tests.lab.undeclared.subject import residuals

    parts = []
    for track, residual in zip(tracks, residuals(model, tracks), strict=True):
        left = blocks(residual)
        rows = np.isfinite(left).all(axis=1)
        columns = [blocks(c)[rows].ravel() for c in columns_of(F16, track).values()]
        parts.append(np.column_stack([*columns, left[rows].ravel()]))
    whole = np.concatenate(parts)
    whole /= np.maximum(np.sqrt(np.mean(whole**2, axis=0)), 1e-12)
    x, y = whole[:, :-1], whole[:, -1]
    return np.linalg.solve(x.T @ x + 1e-3 * len(x) * np.eye(x.shape[1]), x.T @ y)


def main(count: int) -> None:
    """Print what a season costs in this process, as JSON."""
    import resource

    tracks, model = season(count), shipped_model()
    ridge(model, tracks[:1])  # imports
    begun = time.process_time()
    ridge(model, tracks)
    beside, wall, begun = time.process_time() - begun, time.perf_counter(), time.process_time()
    found = identify(tracks, model)
    spent = time.process_time() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    told = {"wall": time.perf_counter() - wall, "spent": spent, "ridge": beside, "peak": peak}
    print(json.dumps(told | {"found": [f.term.key for f in found.found]}))


@pytest.mark.parametrize("count", [6, 30, 200])
def test_a_season_of_one_aircraft(benchmark, count):
    """Seconds and peak memory; aims: 15 s for six, 120 s for 200."""
    command = [sys.executable, "-c", SEASON, str(count)]
    run = benchmark.pedantic(
        lambda: subprocess.run(command, check=True, capture_output=True, text=True), rounds=1
    )
    told = json.loads(run.stdout.splitlines()[-1])
    benchmark.extra_info.update(told)
    ratio = told["spent"] / told["ridge"]
    print(
        f"\nidentify, {count} flights: {told['wall']:.1f} s, {told['spent']:.1f} s of processor, "
        f"peak {told['peak']:.0f} MiB ({told['peak'] / AIM_MEGABYTES:.0%} of 1 GiB), found "
        f"{told['found']}; ridge on them {told['ridge']:.2f} s: {ratio:.0f} x"
    )


@pytest.mark.parametrize("missing", MISSING)
def test_six_flights_in_process(benchmark, missing):
    tracks, model, spent = season(6, MISSING[missing]), shipped_model(), []
    ridge(model, tracks[:1])  # imports

    def run() -> list[str]:
        begun = time.process_time()
        found = identify(tracks, model)
        spent.append(time.process_time() - begun)
        return [f.term.key for f in found.found]

    names = benchmark.pedantic(run, rounds=1)
    begun = time.process_time()
    ridge(model, tracks)
    beside = time.process_time() - begun
    print(
        f"\nidentify, six flights, {missing} missing: {spent[0]:.1f} s of processor, found "
        f"{names}; ridge on them {beside:.2f} s: {spent[0] / beside:.0f} x"
    )


def test_six_flights_by_the_command(benchmark, tmp_path):
    logs = [tmp_path / f"flight_{number}.csv" for number in range(1, 7)]
    for track, path in zip(season(6), logs, strict=True):
        write_csv(track, path)
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "identify", *map(str, logs)]
    command += ["--json", str(tmp_path / "found.json"), "--html", str(tmp_path / "found.html")]
    launch = [sys.executable, "-c", LAUNCHER, *command]
    run = benchmark.pedantic(
        lambda: subprocess.run(launch, check=True, capture_output=True, text=True), rounds=1
    )
    seconds, megabytes = map(float, run.stdout.split())
    print(
        f"\nidentify, six flights by the command: "
        f"{benchmark.stats.stats.min:.1f} s, {seconds:.1f} s of processor, {megabytes:.0f} MiB"
    )
