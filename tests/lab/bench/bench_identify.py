"""What identify costs on a day's work: six flights, against the aim of 60 s and 1 GiB on two cores.

Run: `pytest tests/lab/bench/bench_identify.py --benchmark-only -o python_files='bench_*.py' -s`.
Flights of the tests' plant last five minutes at 10 Hz and are judged against a model trained on
its good flights; recorded ones last three and a half and are judged against the shipped model.
Nothing here passes or fails by its time.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import thrustmargin as tm
from tests.gcs_plugin.logs.csv_files import write_csv
from tests.lab.undeclared import subject
from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.plan import build, fly_season, missions_of
from tests.lab.undeclared.recorded import hosts, implanted
from tests.lab.undeclared.rotor_aero import cut_for_loss
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.loop import identify

FLIGHTS = 6
MINUTES = 5.0
AIM_SECONDS, AIM_MEGABYTES = 60.0, 1024.0
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
MISSING = {"nothing": (), "one effect": (WORN,), "three effects": (WORN, LOADED, SHIFTED)}
#: Runs a command from a small process: the peak of a child starts at the size of who starts it.
LAUNCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Flights and the model that they are judged against."""

    name: str
    tracks: Sequence[FlightTrack]
    model: Path | None  # None for the shipped one


@pytest.fixture(scope="session")
def plant_model(tmp_path_factory) -> Path:
    return subject.trained_model(F16, tmp_path_factory.mktemp("plant"))


@pytest.fixture(params=MISSING)
def missing(request) -> str:
    return request.param


@pytest.fixture(params=["plant", "recorded"])
def case(request, missing) -> Case:
    name = f"{request.param}, {missing} missing"
    if request.param == "recorded":
        every = hosts()
        chosen = [every[round(k)] for k in np.linspace(0, len(every) - 1, FLIGHTS)]
        tracks = [implanted(track, MISSING[missing]) for track in chosen]
        return Case(name=name, tracks=tracks, model=None)
    model = request.getfixturevalue("plant_model")
    missions = [
        (replace(style, duration=60.0 * MINUTES), day)
        for style, day in missions_of(F16, np.random.default_rng(5), FLIGHTS)
    ]
    tracks = [flight.track for flight in fly_season(F16, MISSING[missing], missions, 5)]
    return Case(name=name, tracks=tracks, model=model)


def _told(case: Case, wall: float, processor: float, megabytes: float | None = None) -> str:
    minutes = sum(t.time_s[-1] for t in case.tracks) / 60.0
    words = f"{case.name}, {minutes:.0f} min of flight: {wall:.1f} s ({wall / AIM_SECONDS:.0%} of "
    words += f"{AIM_SECONDS:.0f} s), {processor:.1f} s of processor"
    if megabytes is not None:
        words += f", peak {megabytes:.0f} MiB ({megabytes / AIM_MEGABYTES:.0%} of 1 GiB)"
    return words


SEASON = """
import resource, sys, time
from tests.lab.bench.bench_identify import season
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.model.model_file import shipped_model
tracks = season(int(sys.argv[1]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
wall, begun = time.perf_counter(), time.process_time()
found = identify(tracks, shipped_model())
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
spent = time.process_time() - begun
print(time.perf_counter() - wall, spent, before, peak, [f.term.key for f in found.found])
"""


def season(count: int) -> list[FlightTrack]:
    """The recorded campaign flown again and again, each time with a little noise of its own, and
    with one propeller worn: a season in which there is something to find."""
    rng, every = np.random.default_rng(1), [implanted(track, (WORN,)) for track in hosts()]
    tracks = []
    for number in range(count):
        track = every[number % len(every)]
        day = 1.0 + rng.normal(0.0, 2e-4)
        noise = rng.normal(0.0, 3.0, track.rotor_speed_rpm.shape)
        speeds = day * track.rotor_speed_rpm + noise
        tracks.append(replace(track, name=f"flight {number + 1}", rotor_speed_rpm=speeds))
    return tracks


@pytest.mark.parametrize("count", [6, 60, 200])
def test_a_season_of_one_aircraft(count):
    """Seconds and peak memory; aims: 15 s for six, 120 s for 200."""
    command = [sys.executable, "-c", SEASON, str(count)]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    *figures, names = told.split(maxsplit=4)
    wall, seconds, before, peak = map(float, figures)
    words = f"{wall:.0f} s, {seconds:.0f} s of processor, peak {peak:.0f} MiB"
    print(f"\n{count} flights: {words} ({before:.0f} before), {names}")


def test_a_season_from_the_command_line(tmp_path):
    """The same 200 flights as logs, by `identify` with default settings; the aim is 120 s."""
    logs = [tmp_path / f"flight_{number + 1}.csv" for number in range(200)]
    for track, path in zip(season(len(logs)), logs, strict=True):
        write_csv(track, path)
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "identify", *map(str, logs)]
    launch = [sys.executable, "-c", LAUNCHER, *command]
    begun = time.perf_counter()
    told = subprocess.run(launch, check=True, capture_output=True, text=True).stdout
    wall = time.perf_counter() - begun
    seconds, kilobytes = map(float, told.split()[-2:])
    words = f"{wall:.0f} s, {seconds:.0f} s of processor, peak {kilobytes / 1024.0:.0f} MiB"
    print(f"\n{len(logs)} flights by the command: {words}; {told.splitlines()[0]}")


def test_making_a_data_set(benchmark):
    benchmark(build, 5, "mixed", F16)


def test_identify_in_process(benchmark, case):
    model = tm.load_model(case.model) if case.model else tm.load_model()
    spent: list[float] = []

    def run() -> list[str]:
        begun = time.process_time()
        found = identify(case.tracks, model)
        spent.append(time.process_time() - begun)
        return [f.term.key for f in found.found]

    names = benchmark.pedantic(run, rounds=1)
    wall = benchmark.stats.stats.min
    benchmark.extra_info.update(processor_s=spent[-1], found=names)
    print(f"\nidentify in process, {_told(case, wall, spent[-1])}; found {names}")


@pytest.mark.parametrize("threads", [1, 2])
def test_identify_from_the_command_line(benchmark, case, threads, tmp_path):
    logs = [tmp_path / f"flight_{number}.csv" for number in range(1, FLIGHTS + 1)]
    for track, path in zip(case.tracks, logs, strict=True):
        write_csv(track, path)
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "identify", *map(str, logs)]
    command += ["--json", str(tmp_path / "found.json"), "--html", str(tmp_path / "found.html")]
    if case.model is not None:
        command += ["--model", str(case.model)]
    spent: list[tuple[float, float]] = []

    def run() -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
        launch = [sys.executable, "-c", LAUNCHER, *command]
        told = subprocess.run(launch, env=environment, check=True, capture_output=True, text=True)
        processor, kilobytes = told.stdout.split()[-2:]
        spent.append((float(processor), float(kilobytes) / 1024.0))

    benchmark.pedantic(run, rounds=1)
    wall, (processor, megabytes) = benchmark.stats.stats.min, spent[-1]
    benchmark.extra_info.update(processor_s=processor, peak_mib=megabytes)
    told = _told(case, wall, processor, megabytes)
    print(f"\nthrustmargin identify, OMP_NUM_THREADS={threads}, {told}")
