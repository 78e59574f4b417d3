"""What identify costs on a day's work: six flights, against the aim of 60 s and 1 GiB on two cores.

Run with `pytest tests/bench/bench_identify.py --benchmark-only -o python_files='bench_*.py' -s`.
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

from tests.undeclared import subject
from tests.undeclared.datasets import AIRCRAFT, the_days
from tests.undeclared.missions import random_style
from tests.undeclared.physics import Physics
from tests.undeclared.plant import fly
from tests.undeclared.recorded import hosts, implant_named
from thrustmargin.gcs_plugin.logs.csv_table import write_csv
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.identify import identify

FLIGHTS = 6
MINUTES = 5.0
AIM_SECONDS, AIM_MEGABYTES = 60.0, 1024.0
#: What is missing from the model, in numbers of the plant's aircraft.
MISSING = {
    "nothing": {},
    "one effect": {"rotor_loss": 0.08, "lossy_rotor": 1},
    "three effects": {
        "rotor_loss": 0.08,
        "lossy_rotor": 1,
        "hidden_mass": 2.0,
        "balance": (0.02, -0.015),
    },
}
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
    return subject.save_base(tmp_path_factory.mktemp("plant"))


@pytest.fixture(params=MISSING)
def missing(request) -> str:
    return request.param


@pytest.fixture(params=["plant", "recorded"])
def case(request, missing) -> Case:
    name = f"{request.param}, {missing} missing"
    if request.param == "recorded":
        physics = replace(Physics(), **MISSING[missing])
        every = hosts()
        chosen = [every[round(k)] for k in np.linspace(0, len(every) - 1, FLIGHTS)]
        tracks = [implant_named(track, physics, None) for track in chosen]
        return Case(name=name, tracks=tracks, model=None)
    model = request.getfixturevalue("plant_model")
    physics, rng = replace(AIRCRAFT, **MISSING[missing]), np.random.default_rng(5)
    tracks = []
    for number, day in enumerate(the_days(rng, FLIGHTS, (), False), 1):
        style = replace(random_style(rng), duration=60.0 * MINUTES)
        tracks.append(fly(physics, style, day, rng, f"flight {number}").track)
    return Case(name=name, tracks=tracks, model=model)


def _told(case: Case, wall: float, processor: float, megabytes: float | None = None) -> str:
    minutes = sum(t.time_s[-1] for t in case.tracks) / 60.0
    words = f"{case.name}, {minutes:.0f} min of flight: {wall:.1f} s ({wall / AIM_SECONDS:.0%} of "
    words += f"{AIM_SECONDS:.0f} s), {processor:.1f} s of processor"
    if megabytes is not None:
        words += f", peak {megabytes:.0f} MiB ({megabytes / AIM_MEGABYTES:.0%} of 1 GiB)"
    return words


def test_identify_in_process(benchmark, case):
    model = subject.shipped() if case.model is None else subject.load_base(case.model)
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
