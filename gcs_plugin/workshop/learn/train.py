"""The command `thrustmargin train`: learn the rotor speed model of one aircraft from its own
flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import AS_HEARD, Reading
from thrustmargin.models.errors import DataError, LogError, require

if TYPE_CHECKING:
    from rich.console import Console

    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.identification.good_flights.commissioning import Commissioned
    from thrustmargin.models.identification.good_flights.weak_flights import WeakFlight
    from thrustmargin.models.model.rotor_model import RotorModel
    from thrustmargin.models.model.training import Fold, Trained, TrainSettings
    from thrustmargin.models.physics.airframe import Airframe


SPLITS = {"both": ("samples", "flights"), "samples": ("samples",), "flights": ("flights",)}


def train(
    logs: Positional[tuple[Path, ...]],
    *,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    out_model: Path = Path("my-model.safetensors"),
    members: int = 5,
    seed: int = 0,
    split: Literal["both", "samples", "flights"] = "both",
    max_epochs: int = 1000,
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """Train the rotor speed model of one aircraft on its own good flights.

    Fits the network from airspeed and tank level, and on it what belongs to every aircraft: moments
    of turning and of the flow, load factor, drag, lift, centre of gravity, yaw trim, air. Each is
    kept if flights left out are predicted better with it. What all flights repeat beyond that along
    speeds, accelerations, load or time is learnt as curves. Where flights left out are predicted
    better without the network, weight and thrust curve take its place; where neither airspeed nor
    tank varies, none is fitted. The first line says whether the model is
    fit for use: its error on flights that the model predicting them has not seen, or why not and
    what to do.
    Writes the model file, with what good flights show of how they differ, and the network's loss
    curves (.loss.svg, .loss.csv) in its folder.
    Give flights of a healthy aircraft, over the speeds and tank levels of its work: at least 3.
    The interval is conformal from 9 flights on, below that a wider one by Student's t.

    Example: thrustmargin train flights --airframe my-aircraft.toml --out-model mine.safetensors
    (flights is the folder of your logs, my-aircraft.toml made by `thrustmargin airframe new`)

    Args:
        logs: Recorded flights: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or folders of
            them.
        airframe: Name of a shipped airframe, or an airframe file (.toml), of the aircraft; without
            it only flights that are recognised as those of topxgun-f16-sitl are learnt from.
        reading: How the logs are read.
        out_model: Model file to write (--out is an older name of it).
        members: Networks in the ensemble; their disagreement is the model's uncertainty.
        seed: Number from which all chance is drawn; the same seed gives the same model.
        split: Split of the table: by samples as the paper does, by flight, or both.
        max_epochs: Most epochs for a network; early stopping usually ends it before.
        force: Replace the model file if it is there.
    """
    require("train", "torch", "scipy")
    from thrustmargin.gcs_plugin.commands.shared.inputs import SHIPPED_AIRFRAME, Inputs
    from thrustmargin.gcs_plugin.commands.shared.log_flights import listed, matching_logs, read_logs
    from thrustmargin.gcs_plugin.commands.shared.options import (
        OutputFile,
        check_outputs,
        check_range,
        require_logs,
    )
    from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
    from thrustmargin.gcs_plugin.wording.aircraft_words import owner_words
    from thrustmargin.gcs_plugin.wording.language import Verbatim, say
    from thrustmargin.gcs_plugin.workshop.learn.model_figures import loss_paths, write_loss_curves
    from thrustmargin.gcs_plugin.workshop.learn.training_tables import training_tables
    from thrustmargin.models.model.model_file import save_model
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.model.training import TrainSettings
    from thrustmargin.models.network.network import NetConfig
    from thrustmargin.models.physics.airframe import load_airframe

    progress = Terminal(stderr=True)
    inputs = Inputs(logs=require_logs(logs), airframe=airframe, reading=reading)
    check_outputs(
        [
            OutputFile("--out-model", out_model, (".safetensors",), keep=not force),
            *(OutputFile("--out-model", path) for path in loss_paths(out_model)),
        ],
        inputs=inputs.files,
    )
    check_range("--members", members, 3, 100)
    check_range("--max-epochs", max_epochs, 1, 1_000_000)
    check_range("--seed", seed, 0, 2**32 - 1)
    aircraft = load_airframe(SHIPPED_AIRFRAME if airframe is None else airframe)
    settings = TrainSettings(
        splits=SPLITS[split], members=members, seed=seed, net=NetConfig(max_epochs=max_epochs)
    )
    unread: list[UnusedLog] = []
    read = read_logs(inputs, unread, progress, model=physics_model(aircraft))
    tracks = [log.track for log in matching_logs(read, unread, progress)]
    if not tracks:
        raise LogError(f"no flight can be used; {listed(unread)}")
    run = training_run(tracks, aircraft, settings, progress)
    made, trained, tracks, written = run.model, run.trained, run.tracks, [out_model]
    unread += run.unfit
    save_model(made, out_model)
    if trained is not None:
        written += write_loss_curves(trained.curves, out_model)

    console = Terminal()
    for part in training_tables(made):
        console.print(part)
    for one in (*unread, *_logs_without_rows(tracks)):
        words = say("left out: {log}: {reason}", log=Verbatim(one.name), reason=say(one.reason))
        console.print(words, soft_wrap=True)
    for path in written:
        console.print(say("wrote {file}", file=path), soft_wrap=True)
    console.print(owner_words(), soft_wrap=True)
    return 1 if unread else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRun:
    """A trained model, the fit of its network (None without one), and its training flights."""

    model: RotorModel
    trained: Trained | None
    tracks: list[FlightTrack]
    unfit: list[UnusedLog]


def training_run(
    tracks: Sequence[FlightTrack], aircraft: Airframe, settings: TrainSettings, console: Console
) -> TrainingRun:
    """Train the model of an aircraft on its flights, with a progress line on the console.

    A flight in which a rotor is weak compared with a model of the other flights is left out, and
    the model trained again. Raises LogError if no flight can be used, and DataError if fewer than
    FEWEST_FLIGHTS are left.
    """
    from datetime import UTC, datetime
    from importlib.metadata import version

    from rich.markup import escape

    from thrustmargin.gcs_plugin.commands.shared.log_flights import listed
    from thrustmargin.gcs_plugin.commands.shared.terminal import steps
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.actions import Phase
    from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
    from thrustmargin.gcs_plugin.wording.language import Verbatim, say
    from thrustmargin.models.checks.instruments import learnt_thermometer, with_air_temperature
    from thrustmargin.models.identification.good_flights.commissioning import (
        FEWEST_FLIGHTS,
        commission,
        held_out_curves,
        held_out_flights,
    )
    from thrustmargin.models.identification.good_flights.weak_flights import weak_flights
    from thrustmargin.models.model.flight_arms import learnt_arms
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.model.training import train as fit
    from thrustmargin.models.physics.flight_phases import NETWORK_INPUTS

    kept, unfit = select_flights(tracks, physics_model(aircraft))
    thermometer = learnt_thermometer(kept, aircraft)
    kept = [with_air_temperature(track, thermometer) for track in kept]
    names, date = settings.names(), datetime.now(UTC).date().isoformat()

    def without(weak: Sequence[WeakFlight]) -> list[FlightTrack]:
        """Return the flights without those of a weak rotor, which are listed as unfit."""
        bad = [
            UnusedLog(
                name=one.name,
                reason=say(
                    "{fault}, beside a model of the other flights",
                    fault=Verbatim(fault_words(one.fault, aircraft.rotor_names, Phase.RECORDED)),
                ),
            )
            for one in weak
        ]
        unfit.extend(bad)
        sound = [track for track in kept if track.name not in {one.name for one in bad}]
        if len(sound) < FEWEST_FLIGHTS:
            raise DataError(
                f"{listed(bad)}; that leaves {len(sound)} of the {FEWEST_FLIGHTS} sound flights "
                "that a model takes"
            )
        console.print(escape(f"made without {listed(bad)}"), soft_wrap=True)
        return sound

    def run(
        good: Sequence[FlightTrack], curve_folds: Sequence[Fold] | None
    ) -> tuple[Trained | None, Commissioned]:
        """Return the trained network, and the model made with it, of the flights `good`.

        The network is None if neither airspeed nor tank level varies in them. `curve_folds`: folds
        of the thrust curve that are fitted already, of the same flights; None to fit them.
        """
        trained = None
        with steps(console, total=len(names) + 1, lines=True) as step:

            def on_epoch(name: str, epoch: int, loss: float) -> None:
                step(f"{name}: epoch {epoch}, validation loss {loss:.4f}", names.index(name))

            if network_can_learn(good):
                trained = fit(
                    good,
                    aircraft,
                    settings,
                    date=date,
                    version=version("thrustmargin"),
                    progress=on_epoch,
                )
            made = commission(
                trained,
                good,
                aircraft,
                date=date,
                curve_folds=curve_folds,
                seed=settings.seed,
                coverage=settings.coverage,
                progress=lambda what: step(what, len(names)),
            )
        return trained, made

    # A weak rotor shows without a network too, so the networks are fitted without its flight.
    inputs = NETWORK_INPUTS if network_can_learn(kept) else physics_model(aircraft).inputs
    with steps(console, total=1, lines=True) as step:
        folds = held_out_curves(kept, aircraft, inputs, lambda what: step(what, 0))
    if weak := weak_flights(held_out_flights(folds, kept)):
        kept, folds = without(weak), None
    trained, made = run(kept, folds)
    if weak := weak_flights(made.left_out):
        kept = without(weak)
        trained, made = run(kept, None)
    model = replace(made.model, thermometer=thermometer)
    model = replace(model, arms=learnt_arms(model, kept))
    return TrainingRun(model=model, trained=trained, tracks=kept, unfit=unfit)


def network_can_learn(tracks: Sequence[FlightTrack]) -> bool:
    """Return True if tank level or measured airspeed, the network's inputs, vary enough in
    `tracks`.

    Only rows for training count. An airspeed that is really ground speed does not count, because
    the wind in it is unknown.
    """
    import numpy as np

    from thrustmargin.models.effects.unnamed import ALONG
    from thrustmargin.models.identification.rows.problem import airspeed_is_ground_speed
    from thrustmargin.models.physics.flight_phases import training_rows

    rows = [training_rows(track) for track in tracks]
    for name in ("tank_kg", "airspeed"):
        values = [
            getattr(track, name)[some]
            for track, some in zip(tracks, rows, strict=True)
            if name == "tank_kg" or not airspeed_is_ground_speed(track)
        ]
        seen = np.concatenate([np.zeros(0), *values])
        if seen.size and np.ptp(seen) > ALONG[name].least:
            return True
    return False


def select_flights(
    tracks: Sequence[FlightTrack], model: RotorModel
) -> tuple[list[FlightTrack], list[UnusedLog]]:
    """Return the flights to train on, and the others with the reason.

    A flight is unusable if it has too few rows for training, or if its rotor speeds belong to other
    rotors or times. Flights without any row for training are returned as usable:
    `_logs_without_rows` reports them. Raise LogError if no flight is usable.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import listed
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.check_words import statement_words
    from thrustmargin.models.identification.rows.usable_flights import too_little, wrong_speeds
    from thrustmargin.models.physics.flight_phases import training_rows

    kept, unfit = [], []
    for track in tracks:
        reason = None
        if training_rows(track, model.inputs).any():
            reason = too_little(track, model)
            if reason is None and (wrong := wrong_speeds(track, model.airframe)):
                reason = statement_words(wrong)
        if reason is None:
            kept.append(track)
        else:
            unfit.append(UnusedLog(name=track.name, reason=reason))
    if not kept:
        raise LogError(f"no flight can be used; {listed(unfit)}")
    return kept, unfit


def _logs_without_rows(tracks: Sequence[FlightTrack]) -> list[UnusedLog]:
    """Return the flights that have no row for training, each with the reason."""
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.inferred.load_inference import LOAD_FROM_SPEEDS
    from thrustmargin.models.physics.flight_phases import training_rows

    return [
        UnusedLog(
            name=track.name,
            reason=LOAD_FROM_SPEEDS
            if "tank_kg" in track.standard_errors
            else "no row in steady flight with rotor speeds, airspeed and tank level",
        )
        for track in tracks
        if not training_rows(track).any()
    ]
