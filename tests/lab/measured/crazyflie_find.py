"""What is found on imrc_crazyflie_rpm: plain checks of the data, then the public commands.

The flights are written as CSV files of the project's own columns, rows of 0.02 s, as an owner of
such logs would write them, and given to `identify` with default settings, every third flight left
out: those without payload start from the shipped airframe, those with 7.4 g more from the model
that came out of the first, and from the airframe alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.lab.measured.crazyflie import (
    CABLE_FLIGHTS,
    FOLDER,
    FREE_FLIGHTS,
    RATE,
    MeasuredFlight,
    read_flights,
)
from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.public_runs import Answer, identify
from tests.lab.measured.speed_regression import regression_rmse_rpm
from tests.lab.measured.swing_check import check_swing
from tests.lab.measured.thrust_check import command_check, hover_lift, plain_check
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = "crazyflie-rpm"
THIRDS = 3
PLAIN_MEAN = 0.1  # s; rows of the plain check, as the independent check seems to have had them
#: rpm held out of an independent regression, and what the load adds: 7.4 g on the scale, 6.3 g by
#: the thrust of hover
REGRESSION = {"free": 126.0, "load": 540.0}
PAYLOAD = "extra mass, wanted 6 to 8"
GRAMS = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """What `identify` says of the flights."""

    free: Answer  # without payload, from the airframe
    load: Answer  # with payload, from the model of the flights without
    load_alone: Answer  # with payload, from the airframe


def find(folder: Path) -> Finding:
    """All numbers. Raises DataError when a file is missing or of another kind."""
    free, load = (read_flights(folder, file) for file in (FREE_FLIGHTS, CABLE_FLIGHTS))
    with tempfile.TemporaryDirectory() as place:
        answers = identified(folder, Path(place))
    said = {"free": answers.free, "load": answers.load, "load_alone": answers.load_alone}
    aside = [f"{f.track.name}: {'; '.join(f.faults)}" for f in (*free, *load) if f.faults]
    return Finding(
        name=FOLDER,
        title="Real flights with measured rotor speeds, every third left out of identify",
        numbers=(*_identified_numbers(folder, answers), *_plain_numbers(folder, sound(load))),
        notes=(*(f"{name}: {_said(answer)}" for name, answer in said.items()), *aside),
    )


def sound(flights: Sequence[MeasuredFlight]) -> list[MeasuredFlight]:
    """The flights whose sensors show no fault."""
    return [flight for flight in flights if not flight.faults]


def as_logged(folder: Path, file: str) -> list[MeasuredFlight]:
    """The sound flights of a file, each row the mean of its own time."""
    return sound(read_flights(folder, file, mean_over=1.0 / RATE))


def split(flights: Sequence) -> tuple[list, list]:
    """Those to learn from, and every third, left out."""
    held = list(flights[::THIRDS])
    return [flight for k, flight in enumerate(flights) if k % THIRDS], held


def identified(folder: Path, place: Path) -> Identified:
    """The public command on the flights of `folder`; files are made in `place`."""
    model = place / "free.safetensors"
    free, load = (
        written(as_logged(folder, file), place / Path(file).stem)
        for file in (FREE_FLIGHTS, CABLE_FLIGHTS)
    )

    def answer(logs: Sequence[Path], *options: str | Path) -> Answer:
        fit, held = split(logs)
        return identify(fit, "--held-out", *held, *options, into=place)

    return Identified(
        free=answer(free, "--airframe", AIRFRAME, "--out", model),
        load=answer(load, "--model", model),
        load_alone=answer(load, "--airframe", AIRFRAME),
    )


def written(flights: Sequence[MeasuredFlight], place: Path) -> list[Path]:
    """The flights as CSV files in `place`, in their order."""
    place.mkdir()
    paths = [place / f"{flight.track.name}.csv" for flight in flights]
    for flight, path in zip(flights, paths, strict=True):
        write_csv(flight.track, path)
    return paths


def _identified_numbers(folder: Path, answers: Identified) -> list[Number]:
    numbers: list[Number] = []
    for name, file, answer in (
        ("free", FREE_FLIGHTS, answers.free),
        ("load", CABLE_FLIGHTS, answers.load),
        ("load_alone", CABLE_FLIGHTS, answers.load_alone),
    ):
        quoted = REGRESSION.get(name)
        numbers.append(Number(f"{name}_before", answer.error("before"), "rpm"))
        after = answer.error("after")
        numbers.append(Number(f"{name}_after", after, "rpm", quoted, "at most" if quoted else ""))
        if quoted:
            own = regression_rmse_rpm(*split(as_logged(folder, file)))
            numbers.append(Number(f"{name}_regression", own, "rpm"))
        if file == CABLE_FLIGHTS:
            mass = GRAMS * answer.value("extra_mass", "mass")
            numbers.append(Number(f"{name}_extra_mass", mass, "g", label=f"{name}: {PAYLOAD}"))
    seconds = sum(a.run.seconds for a in (answers.free, answers.load, answers.load_alone))
    return [*numbers, Number("seconds", seconds, "s")]


def _plain_numbers(folder: Path, load: Sequence[MeasuredFlight]) -> list[Number]:
    """Checks of the data that need no search."""
    free = sound(read_flights(folder, FREE_FLIGHTS))
    finer = sound(read_flights(folder, FREE_FLIGHTS, mean_over=PLAIN_MEAN))
    plain, command = plain_check(finer), command_check(finer)
    distance = float(np.nanmedian([np.nanmedian(_length(flight)) for flight in load]))
    swing = check_swing(load, distance, load_airframe(AIRFRAME).thrust_coefficient)
    share = "% of weight"
    ratio = hover_lift(load) / hover_lift(free)
    return [
        Number("plain_before", plain.before, share, 1.65, "like"),
        Number("plain_after", plain.after, share, 1.17, "at most"),
        Number("plain_before_fast", plain.before_fast, share, 3.43),
        Number("plain_after_fast", plain.after_fast, share, 1.82, "at most"),
        Number("voltage_correlation", plain.voltage_correlation, "1", 0.04),
        Number("speed_by_command", command.command, "rpm", 253.0),
        Number("speed_by_command_and_voltage", command.voltage, "rpm", 134.0, "at most"),
        Number("speed_by_command_voltage_and_delay", command.delayed, "rpm", 134.0, "at most"),
        Number("motor_delay", command.delay, "s"),
        Number("hover_lift_ratio", ratio, "1", 1.171, "like"),
        Number("mass_ratio", load[0].mass / free[0].mass, "1", 1.2, "like"),
        Number("load_distance", distance, "m"),
        Number("slung_mass_by_regression", GRAMS * swing.mass, "g", 4.7),
        Number("slung_mass_by_regression_on_capture", GRAMS * swing.mass_by_capture, "g", 4.7),
        Number("swing_apart", swing.apart, "deg"),
        Number("swing_apart_if_hanging", swing.apart_if_hanging, "deg"),
        Number("swing_largest", swing.swing_largest, "deg"),
    ]


def _length(flight: MeasuredFlight) -> np.ndarray:
    return np.linalg.norm(flight.load_ned, axis=1)


def _said(answer: Answer) -> str:
    if not answer.result:
        return "traceback" if answer.run.traceback else answer.run.refusal
    return ", ".join(answer.effects) or "nothing named"
