"""`identify` itself on imrc_crazyflie_rpm: every third flight left out, then the load.

The flights are written as CSV files of the project's own columns, as any owner of such logs would
write them, and given to the public commands with default settings: first those without payload to
`identify --airframe`, then those with 7.4 g more to the model file that came out.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.measured.crazyflie import CABLE_FLIGHTS, FREE_FLIGHTS, read_flights
from tests.measured.findings import Finding, Number
from tests.measured.public_runs import Answer, identify
from thrustmargin.gcs_plugin.logs.csv_table import write_csv

NAME = "imrc_crazyflie_identify"
AIRFRAME = "crazyflie-rpm"
THIRDS = 3
#: rpm held out of a plain regression on load factor, climb and speed, by an independent check
REGRESSION = {"free": 126.0, "load": 540.0}
#: 7.4 g more on the scale, 6.3 g by the thrust of hover
PAYLOAD = "extra mass, wanted 6 to 8"


def find(folder: Path) -> Finding:
    """Errors held out before and after, without and with the load."""
    with tempfile.TemporaryDirectory() as place:
        free, load = identified(folder, Path(place))
    mass = 1e3 * load.value("extra_mass", "mass")
    numbers: list[Number] = []
    for name, answer in (("free", free), ("load", load)):
        numbers.append(Number(f"{name}_before", answer.error("before"), "rpm"))
        after = answer.error("after")
        numbers.append(Number(f"{name}_after", after, "rpm", REGRESSION[name], "at most"))
    return Finding(
        name=NAME,
        title="identify on flights with measured rotor speeds, every third left out",
        numbers=(
            *numbers,
            Number(
                "extra_mass",
                mass,
                "g",
                label=f"extra mass, wanted {PAYLOAD[0]:g} to {PAYLOAD[1]:g}",
            ),
            Number("seconds", free.run.seconds + load.run.seconds, "s"),
        ),
        notes=(_said("without payload", free), _said("with a load on a cable", load)),
    )


def identified(folder: Path, place: Path) -> tuple[Answer, Answer]:
    """Without payload, then with it; files are made in `place`."""
    model = place / "free.safetensors"
    answers = []
    for file, start in (
        (FREE_FLIGHTS, ("--airframe", AIRFRAME)),
        (CABLE_FLIGHTS, ("--model", model)),
    ):
        logs = written(folder, file, place / Path(file).stem)
        held = logs[::THIRDS]
        fit = [log for log in logs if log not in held]
        out = ("--out", model) if file == FREE_FLIGHTS else ()
        answers.append(identify(fit, "--held-out", *held, *start, *out, into=place))
    return answers[0], answers[1]


def written(folder: Path, file: str, place: Path) -> list[Path]:
    """The flights of a file as CSV, in its order; those with a faulty sensor are left out."""
    place.mkdir()
    paths = []
    for flight in read_flights(folder, file):
        if not flight.faults:
            paths.append(place / f"{flight.track.name}.csv")
            write_csv(flight.track, paths[-1])
    return paths


def _said(name: str, answer: Answer) -> str:
    if not answer.result:
        return f"{name}: {answer.run.refusal}"
    return f"{name}: {', '.join(answer.effects) or 'nothing named'}"
