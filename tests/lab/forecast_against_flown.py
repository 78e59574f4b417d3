"""Forecasts of recorded flights beside the flown: `python -m tests.lab.forecast_against_flown`.

`--leave-out` trains a model without the flights that are compared (some minutes, once: it is kept
in --model FILE, and taken from there if it is).

Each is forecast from the mission and the parameters in its log, and from wind, height of the field,
flow and fill at the start as the manifest has them: nothing of the flight. Stretches are found
again in the flight by their share of the whole level way.
"""

from __future__ import annotations

import argparse
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_plan
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.mission.forecast.battery import FlightBattery, stated_capacity
from thrustmargin.mission.forecast.plan_forecast import PlanForecast, TakeOff, forecast
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import isa_temperature

LOGS = Path(__file__).parents[2] / "sitl_logs"
FLIGHTS = (
    "campaign/v4_m16_q2.5.tlog",
    "campaign/v2_m10_q1.5.tlog",
    "campaign/v6_m4_q3.5.tlog",
    "dev/windy_1.tlog",
    "dev/windy_2.tlog",
    "dev/windy_3.tlog",
    "dev/high_altitude_1.tlog",
)
LEAST_ROWS = 5  # of a stretch that is compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """One leg or turn; utilisation of the worst rotor in points, per cent of its largest thrust."""

    item: int
    kind: str
    mean: tuple[float, float]  # forecast, flown
    peak: tuple[float, float]
    interval: tuple[float, float]  # 90 %, of the forecast peak

    @property
    def mean_error(self) -> float:
        return self.mean[0] - self.mean[1]

    @property
    def inside(self) -> bool:
        """Whether the flown peak lies in the forecast interval."""
        return self.interval[0] <= self.peak[1] <= self.interval[1]

    @property
    def peak_error(self) -> float:
        return self.peak[0] - self.peak[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One flight."""

    name: str
    learnt: bool  # the model has seen it
    stretches: tuple[Stretch, ...]
    flight_s: tuple[float, float]
    tank_end_kg: tuple[float, float]
    fill_kg: float

    def worst(self, kind: str, error: str) -> float:
        """Of the stretches of a kind the error that is furthest from zero."""
        errors = [getattr(s, error) for s in self.stretches if s.kind == kind]
        return max(errors, key=abs, default=math.nan)

    def rms(self, kind: str, error: str) -> float:
        errors = [getattr(s, error) for s in self.stretches if s.kind == kind]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def compare(file: str, model: RotorModel) -> Compared:
    """The forecast of a flight of the manifest, and the flight."""
    manifest = tomllib.loads((LOGS / "manifest.toml").read_text("utf-8"))
    listed = next(f for f in manifest["flight"] if f["file"] == file)
    log = read_log(LOGS / file, airframe=model.airframe)
    made = forecast(
        read_plan(LOGS / file),
        model,
        TakeOff(
            fill_kg=listed["payload_start_kg"],
            altitude=listed["home_altitude_m"],
            air_temperature=float(isa_temperature(listed["home_altitude_m"])),
            wind=listed["wind_m_s"],
            wind_from_deg=listed["wind_from_deg"],
            flow=listed["flow_l_min"] / 60.0,
            battery=FlightBattery(capacity_ah=stated_capacity(log.parameters)),
        ),
        parameters=log.parameters,
        refilled=False,
    )
    flown = log.track.rows(log.track.flying)
    use = np.nanmax(analyse(flown, model).utilisation, axis=1)
    learnt = model.training_domain is not None and Path(file).name in model.training_domain.flights
    return Compared(
        name=file,
        learnt=learnt,
        stretches=_stretches(made, flown, use),
        flight_s=(made.flight.track.duration, flown.duration),
        tank_end_kg=(float(made.flight.track.tank_kg[-1]), float(flown.tank_kg[-1])),
        fill_kg=listed["payload_start_kg"],
    )


def _stretches(made: PlanForecast, flown: FlightTrack, use: Floats) -> tuple[Stretch, ...]:
    planned, real = _share_flown(made.flight.track), _share_flown(flown)
    real = real + 1e-9 * np.arange(real.size)  # in hover it stands still
    forecast_use = 100.0 * np.max(made.advised.analysis.utilisation_predicted, axis=1)
    found = []
    for span, leg in zip(made.flight.course.spans, made.legs, strict=True):
        ends = planned[[span.first, span.last - 1]]
        first, last = np.searchsorted(real, ends)
        if span.kind not in ("leg", "turn") or last - first < LEAST_ROWS:
            continue
        ours, theirs = forecast_use[span.first : span.last], 100.0 * use[first:last]
        found.append(
            Stretch(
                item=span.item,
                kind=span.kind,
                mean=(float(ours.mean()), float(theirs.mean())),
                peak=(float(ours.max()), float(theirs.max())),
                interval=(100.0 * leg.interval[0], 100.0 * leg.interval[1]),
            )
        )
    return tuple(found)


def _share_flown(track: FlightTrack) -> Floats:
    """(T,) share of the whole level way that is flown."""
    steps = np.hypot(*np.diff(track.position_ned[:, :2], axis=0).T)
    way = np.append(0.0, np.cumsum(steps))
    return way / way[-1]


def left_out(files: Sequence[str], path: Path) -> RotorModel:
    """The shipped kind of model, trained on the campaign without `files`; kept in `path`."""
    if not path.exists():
        rest = [p for p in sorted((LOGS / "campaign").glob("*.tlog")) if campaign(p) not in files]
        craft = ("--airframe", "topxgun-f16-sitl")
        words = ["train", *map(str, rest), *craft, "--split", "flights", "--out-model", str(path)]
        if run(words) != 0:
            raise SystemExit("no model could be trained")
    return load_model(path)


def campaign(path: Path) -> str:
    return f"campaign/{path.name}"


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("files", nargs="*", default=FLIGHTS)
    asked.add_argument("--leave-out", action="store_true")
    asked.add_argument("--model", type=Path, default=Path("left-out.safetensors"))
    given = asked.parse_args()
    files = given.files
    model = left_out(files, given.model) if given.leave_out else load_model()
    print(
        "| flight | learnt | leg mean, points | turn mean | turn peak | time | tank |\n"
        "|---|---|---|---|---|---|---|"
    )
    inside: dict[bool, list[bool]] = {True: [], False: []}
    for file in files:
        made = compare(file, model)
        inside[made.learnt] += [s.inside for s in made.stretches]
        time, tank = made.flight_s, made.tank_end_kg
        cells = [
            f"{made.rms(kind, error):.1f}, worst {made.worst(kind, error):+.1f}"
            for kind, error in (
                ("leg", "mean_error"),
                ("turn", "mean_error"),
                ("turn", "peak_error"),
            )
        ]
        print(
            f"| {made.name} | {'yes' if made.learnt else 'no'} | {' | '.join(cells)} | "
            f"{100.0 * (time[0] / time[1] - 1.0):+.1f} % | "
            f"{100.0 * (tank[0] - tank[1]) / made.fill_kg:+.1f} % |"
        )
    for learnt, held in inside.items():
        if held:
            print(
                f"\nPeaks in their 90 % interval, of flights that the model has "
                f"{'' if learnt else 'not '}learnt from: {np.mean(held):.0%} of {len(held)}."
            )


if __name__ == "__main__":
    main()
