"""The only place that touches the code under test: base models in, identification out.

Nothing but flight tables and a model crosses here; the truth stays on the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.undeclared.datasets import AIRCRAFT, healthy_flights
from tests.undeclared.physics import Layout
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

if TYPE_CHECKING:
    from thrustmargin.models.model.training import TrainSettings

HEALTHY_FLIGHTS = 27  # as many as the recorded campaign has
AIRFRAME_FILE = """\
extends = "topxgun-f16-sitl"
name = "plant-{name}"
title = "Aircraft of the tests ({name})"
layout = "{name}"

[quantities]
torque_ratio = {{ value = {torque_ratio!r}, unit = "m", source = "the tests' plant" }}
"""
ROTOR = """
[[rotors]]
name = "{number}"
position_frd = [{x!r}, {y!r}, 0.0]
spin = "{spin}"
"""


def airframe_of(layout: Layout, folder: Path) -> Airframe:
    """The airframe file of a layout, written and read as a user would."""
    text = AIRFRAME_FILE.format(name=layout.name, torque_ratio=float(layout.torque_ratio))
    for number, ((x, y), spin) in enumerate(zip(layout.position, layout.spin, strict=True), 1):
        text += ROTOR.format(
            number=number, x=float(x), y=float(y), spin="ccw" if spin > 0 else "cw"
        )
    path = folder / f"plant-{layout.name}.toml"
    path.write_text(text, encoding="utf-8")
    return load_airframe(path)


def curve_model(layout: Layout, folder: Path) -> RotorModel:
    """The airframe's own curve and weight: no flights needed."""
    return physics_model(airframe_of(layout, folder))


def trained_model(folder: Path, *, seed: int = 0) -> RotorModel:
    """A model of the healthy aircraft: network trained on good flights, loop closed on them once.

    The network knows speed and payload only; what turns and gusts do is found by the code under
    test itself on the same good flights, as a user would close the loop at commissioning.
    """
    from thrustmargin.models.model.training import train

    airframe = airframe_of(AIRCRAFT.layout, folder)
    tracks = [f.track for f in healthy_flights(HEALTHY_FLIGHTS, seed)]
    trained = train(tracks, airframe, quick_training(seed), date="2026-01-01", version="tests")
    return closed(trained.model, tracks)


def quick_training(seed: int) -> TrainSettings:
    """Enough for a smooth function of speed and payload, in seconds."""
    from thrustmargin.models.model.training import TrainSettings
    from thrustmargin.models.network.network import NetConfig

    net = NetConfig(hidden=(32, 32), learning_rate=2e-3, patience=60, max_epochs=300)
    return TrainSettings(splits=(), members=3, seed=seed, net=net)


def closed(model: RotorModel, tracks: Sequence[FlightTrack]) -> RotorModel:
    """The model with the effects that the loop finds on its own good flights."""
    return closed_and_told(model, tracks)[0]


def closed_and_told(
    model: RotorModel, fit: Sequence[FlightTrack], held_out: Sequence[FlightTrack] = ()
) -> tuple[RotorModel, dict[str, Any]]:
    """The model with the effects that the loop finds, and its answer."""
    from thrustmargin.models.identification.identify import identify
    from thrustmargin.models.identification.model_update import with_effects

    found = identify(fit, model, held_out=held_out)
    return with_effects(model, found), found.to_json()


def save_base(folder: Path) -> Path:
    """Build the trained model once and keep it in a file, for several workers."""
    path = folder / "healthy.safetensors"
    from thrustmargin.models.model.model_file import save_model

    save_model(trained_model(folder), path)
    return path


@cache
def load_base(path: Path) -> RotorModel:
    from thrustmargin.models.model.model_file import load_model

    return load_model(path)


@cache
def shipped() -> RotorModel:
    """The model that the project ships for the recorded flights' aircraft."""
    from thrustmargin.models.model.model_file import shipped_model

    return shipped_model()


def run_identify(
    model: RotorModel, fit: Sequence[FlightTrack], held_out: Sequence[FlightTrack]
) -> dict[str, Any]:
    """The answer of the loop in the schema `thrustmargin.identify/1`."""
    from thrustmargin.models.identification.identify import identify

    return identify(fit, model, held_out=held_out).to_json()
