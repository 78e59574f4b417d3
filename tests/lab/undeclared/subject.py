"""The only place that touches the code under test: its commands and its public functions.

Nothing but flight tables, an airframe file and a model file crosses here; the truth stays on the
other side. `told_the_names` alone goes inside, and what it says goes into no answer.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import thrustmargin as tm
from tests.gcs_plugin.logs.csv_files import write_csv
from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.crafts import Craft
from tests.lab.undeclared.plan import good_flights
from tests.lab.undeclared.rotor_aero import Array
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.rows.candidates import Candidate
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

COMMAND = (sys.executable, "-m", "thrustmargin.gcs_plugin.cli")


def airframe_of(craft: Craft, folder: Path) -> Airframe:
    """The airframe file of a craft, written and read as a user would."""
    path = folder / f"{craft.name}.toml"
    path.write_text(craft.airframe_toml(), encoding="utf-8")
    return load_airframe(path)


def curve_model(craft: Craft, folder: Path) -> RotorModel:
    """The airframe's own curve and weight: no flights needed."""
    return physics_model(airframe_of(craft, folder))


def command(*words: object) -> str:
    """Run a thrustmargin command; raises RuntimeError with what it said when it fails."""
    done = subprocess.run([*COMMAND, *map(str, words)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(map(str, words))}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def trained_model(craft: Craft, folder: Path, flights: int | None = None) -> Path:
    """The model file of a craft by `thrustmargin train` on its good flights, kept in the folder."""
    path = folder / f"{craft.name}.safetensors"
    if path.exists():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    airframe_of(craft, folder)
    logs = []
    for number, flight in enumerate(good_flights(craft, flights), 1):
        logs.append(folder / f"{craft.name}-good-{number}.csv")
        write_csv(flight.track, logs[-1])
    new, airframe = folder / f"new-{path.name}", folder / f"{craft.name}.toml"
    quick = ("--split", "samples", "--members", 3, "--max-epochs", 300, "--force")
    command("train", *logs, "--airframe", airframe, "--out", new, *quick)
    new.rename(path)  # a training that was stopped leaves no model behind
    for other in (*logs, *folder.glob(f"new-{craft.name}*")):
        other.unlink()
    return path


@cache
def model_of(craft: Craft, folder: Path | None) -> RotorModel:
    """The trained model of a craft, kept in the folder; without one that which ships."""
    return tm.load_model() if folder is None else tm.load_model(trained_model(craft, folder))


def residuals(model: RotorModel, tracks: Sequence[FlightTrack]) -> list[Array]:
    """(T, R) rpm measured minus predicted of each flight; NaN on the ground and just after."""
    parts = []
    for track in tracks:
        left = np.array(tm.analyse(track, model).residual_rpm)
        begun = int(np.argmax(track.flying)) + 30
        left[~track.flying | (np.arange(len(left)) < begun)] = np.nan
        parts.append(left)
    return parts


def closed(
    model: RotorModel, fit: Sequence[FlightTrack], held_out: Sequence[FlightTrack]
) -> tuple[RotorModel, dict[str, Any]]:
    """The model with the effects that the loop finds on good flights, and its answer."""
    from thrustmargin.models.identification.answer.model_update import update_model

    found = tm.identify(fit, model, held_out=held_out)
    return update_model(model, found).model, found.to_json()


def run_identify(
    model: RotorModel, fit: Sequence[FlightTrack], held_out: Sequence[FlightTrack]
) -> dict[str, Any]:
    """The answer of the loop in the schema `thrustmargin.identify/1`, with what it asks for."""
    from thrustmargin.gcs_plugin.workshop.identify.asked_words import requested_actions

    found = tm.identify(fit, model, held_out=held_out)
    return found.to_json() | {"actions": [asdict(one) for one in requested_actions(found)]}


def told_the_names(
    model: RotorModel, fit: Sequence[FlightTrack], implants: Sequence[Implant]
) -> list[float]:
    """Size of each change over its standard error, of one who is told which effects act.

    All are estimated at once, by the loop's own likelihood: beside the noise it knows how much
    flights of a sound aircraft differ. What stays below 2 here nobody sees who must learn the size
    from these flights. NaN where a change has no parameter of its name.
    """
    from thrustmargin.models.effects import CATALOGUE, effects_for
    from thrustmargin.models.identification.rows.reduced import rows_and_means
    from thrustmargin.models.identification.sets.search_space import search_space
    from thrustmargin.models.identification.sets.set_search import Search

    _, means = rows_and_means(model, fit)
    space = search_space(model, fit, effects_for(model.airframe, CATALOGUE), means)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.fit(frozenset(), ())
    places = [
        next((c for c, one in enumerate(space.candidates) if _is_of(one, i)), None)
        for i in implants
    ]
    found = search.fit(frozenset(c for c in places if c is not None), ())
    error = np.sqrt(found.set_score.variance)
    sizes, first = {}, 0
    for c, trial in zip(sorted(found.key), found.trials, strict=True):
        truth = implants[places.index(c)].truth
        own = trial.candidate.parameters
        sizes[c] = [
            (truth[p.name] - (p.absent or 0.0)) / e
            for p, e in zip(own, error[first : first + len(own)], strict=True)
            if p.name in truth
        ]
        first += len(own)
    return [
        float(np.linalg.norm(sizes[c])) if c is not None and i.truth else float("nan")
        for c, i in zip(places, implants, strict=True)
    ]


def _is_of(one: Candidate, implant: Implant) -> bool:
    """True for the candidate of a change that is there all along."""
    term = one.term
    return (
        (term.effect.name, term.rotor) == (implant.name, implant.rotor)
        and set(implant.truth) <= {p.name for p in one.parameters}
        and not {"cut_from", "cut_until"} & set(implant.condition)
    )
