"""What is changed about RotorPy's aircraft, how it is flown, and what the loop says of it.

    python -m tests.lab.undeclared.rotorpy_cases [CASE ...] [--curve] [--seed N]

prints the table: name found, value and interval, truth, error before and after on a flight that
was not used. The model is closed once on good flights of the same aircraft; `--curve` starts from
the airframe's own curve instead.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from tests.lab.undeclared.days import elsewhere, random_day
from tests.lab.undeclared.missions import Style
from tests.lab.undeclared.rotorpy_plant import QUAD, SEASON_START, Airframe, fly_rotorpy
from thrustmargin.models.flight import FlightTrack

if TYPE_CHECKING:
    from tests.lab.undeclared.subject import RotorModel

HEALTHY = Airframe(drag_area=0.3)
MINUTES_BETWEEN_FLIGHTS = 20.0
SECONDS = 60.0  # of lines; a mission ends with its last line
CRUISE = (6.0, 7.5, 4.5, 7.0, 3.0, 5.5)  # m/s, flight after flight
FILL = (0.94, 0.5, 0.81, 0.69, 0.375, 0.56)  # of the tank
GOOD_FLIGHTS, FIT_FLIGHTS, HELD_FLIGHTS = 6, 3, 1
WEAKER = 0.06  # of the thrust coefficient of a worn set of propellers
AS_WARM = 288.15 * (1.0 / (1.0 - WEAKER) - 1.0)  # K that take as much density

#: What a healthy aircraft of RotorPy has beyond weight and curve.
NATURAL = frozenset({"load_factor", "manoeuvre_moment", "translational_lift", "parasite_drag"})


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One change, and the answer that the loop should give: empty when nothing is changed."""

    changed: Mapping[str, Any] = field(default_factory=dict)  # numbers of `Airframe`
    lift: float = HEALTHY.lift
    field_at: tuple[float, float] | None = None  # m above the sea, K above standard air
    wind: tuple[float, float] | None = None  # m/s north, east
    climb: float = 6.0  # m between some lines
    cruise: tuple[float, ...] = CRUISE
    name: str = ""
    rotor: int | None = None  # counted from 1, as told
    truth: Mapping[str, float] = field(default_factory=dict)  # parameter as told -> value

    @property
    def airframe(self) -> Airframe:
        return replace(HEALTHY, lift=self.lift, **self.changed)


CASES: Mapping[str, Case] = MappingProxyType(
    {
        "nothing": Case(),
        "worn rotor": Case(
            changed={"rotor_loss": 0.07, "lossy_rotor": 1},
            name="rotor_degradation",
            rotor=2,
            truth={"loss": 0.07, "torque_share": 1.0},
        ),
        "chipped in flight": Case(
            changed={
                "rotor_loss": 0.1,
                "lossy_rotor": 3,
                "loss_from_clock": 60.0 * MINUTES_BETWEEN_FLIGHTS + 50.0,
            },
            name="rotor_degradation",
            rotor=4,
            truth={
                "loss": 0.1,
                "onset_clock": SEASON_START + 60.0 * MINUTES_BETWEEN_FLIGHTS + 50.0,
            },
        ),
        "hidden mass": Case(changed={"hidden_mass": 2.0}, name="extra_mass", truth={"mass": 2.0}),
        "gauge": Case(changed={"gauge_gain": 1.15}, name="tank_scale", truth={"gain": 1.15}),
        # RotorPy's lift adds to each rotor's thrust, the table's multiplies it: what is shared out
        # unevenly then differs by the mean lift, about 1 %.
        "balance": Case(
            changed={"balance": (0.03, -0.01)},
            name="cg_offset",
            truth={"x": 0.03, "y": -0.01},
        ),
        "high and warm": Case(
            field_at=(1500.0, 10.0), name="air_density", truth={"temperature_offset": 10.0}
        ),
        # Nothing in the table but the air makes all rotors weaker for good.
        "weaker propellers": Case(
            changed={"thrust_coefficient": (1.0 - WEAKER) * HEALTHY.thrust_coefficient},
            name="air_density",
            truth={"temperature_offset": AS_WARM},
        ),
        "fouling": Case(
            changed={"fouling_rate": 0.08 / 300.0}, name="thrust_drift", truth={"rate": 0.08 / 300}
        ),
        "inflow": Case(changed={"inflow_slope": 0.8}, name="climb_inflow", truth={"slope": 0.8}),
        # Adds in quadrature to the drag that the healthy aircraft has. Level, as RotorPy's drag
        # holds a climb back too, which the table's does not.
        "drag": Case(
            changed={"drag_area": 2.5},
            climb=0.0,
            name="parasite_drag",
            truth={"drag_area": float(np.sqrt(2.5**2 - HEALTHY.drag_area**2))},
        ),
        # RotorPy's lift goes with V² and has no gain of momentum theory: a name, no number.
        "lift": Case(lift=0.12, name="translational_lift"),
        "unreported wind": Case(
            changed={"blind_to_wind": True},
            wind=(3.0, -2.0),
            cruise=(5.0, 4.0, 4.5),  # through the air no faster than the good flights
            name="wind",
            truth={"wind_north": 3.0, "wind_east": -2.0},
        ),
    }
)


def fly_one(case: Case, number: int, seed: int) -> FlightTrack:
    """One flight of a case; `number` from 0."""
    rng = np.random.default_rng([seed, number])
    style = Style(
        cruise=case.cruise[number % len(case.cruise)],
        acceleration=1.0,
        line_length=60.0,
        climb=case.climb,
        sway=0.1,
        duration=SECONDS,
    )
    day = replace(
        random_day(rng),
        fill=FILL[number % len(FILL)],
        flow=0.25,
        pressure=101325.0,
        temperature=288.15,
        clock_start=60.0 * MINUTES_BETWEEN_FLIGHTS * number,
        wind_reported=True,
    )
    if case.field_at is not None:
        day = elsewhere(day, *case.field_at)
    if case.wind is not None:
        day = replace(day, wind=case.wind)
    return fly_rotorpy(case.airframe, style, day, rng, f"rotorpy {number + 1}")


def flights(case: Case, count: int, seed: int) -> list[FlightTrack]:
    """The flights of a case, flown on two cores."""
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(fly_one, [case] * count, range(count), [seed] * count))


def holds(case: Case, effect: Mapping[str, Any], parameter: str) -> bool:
    """True when the interval has the truth inside."""
    low, high = effect["parameters"][parameter]["ci95"]
    return bool(low <= case.truth[parameter] <= high)


def good_model(folder: Path, *, seed: int = 0) -> tuple[RotorModel, dict[str, Any]]:
    """The airframe's curve with its loop closed on good flights, and what was found on them."""
    from tests.lab.undeclared.subject import closed, curve_model

    good = flights(CASES["nothing"], GOOD_FLIGHTS + HELD_FLIGHTS, 1000 + seed)
    return closed(curve_model(QUAD, folder), good[:GOOD_FLIGHTS], good[GOOD_FLIGHTS:])


def answer(model: RotorModel, case: Case, *, seed: int = 0) -> dict[str, Any]:
    """What the loop says of a case."""
    from tests.lab.undeclared.subject import run_identify

    own = crc32(repr((sorted(case.changed), case.name)).encode())
    flown = flights(case, FIT_FLIGHTS + HELD_FLIGHTS, own + seed)
    return run_identify(model, flown[:FIT_FLIGHTS], flown[FIT_FLIGHTS:])


def lines_of(label: str, case: Case, result: Mapping[str, Any]) -> list[str]:
    """The rows of a case in the table, one a parameter with a truth."""
    errors = f"{result['before']['rmse_rpm']:6.1f} {result['after']['rmse_rpm']:5.1f}"
    errors += f" {result['floor_rpm']:5.1f}"
    rows = []
    for effect in result["effects"]:
        on = f"{effect['name']} {effect['rotor'] or ''}"
        mine = effect["name"] == case.name
        stated = effect["parameters"]
        told = [k for k in stated if k in case.truth] if mine else []
        for parameter in told or list(stated)[:1]:
            value, (low, high) = stated[parameter]["value"], stated[parameter]["ci95"]
            start = case.truth[parameter] if parameter == "onset_clock" and mine else 0.0
            truth = f"{case.truth[parameter] - start:9.5g}" if parameter in told else "        -"
            inside = ("yes" if holds(case, effect, parameter) else "NO") if told else "-"
            rows.append(
                f"{on:22.22s} {parameter:18s} {value - start:9.4g} "
                f"[{low - start:9.4g}, {high - start:9.4g}] {truth} {inside:4s}"
            )
    rows = rows or [f"{'(nothing)':22s} {'':65s}"]
    kept = result["unexplained"]["fraction_of_variance"]
    rest = f" {100 * kept:4.0f} %" if kept else ""
    return [f"{label:18s} {rows[0]} {errors}{rest}", *(f"{'':18s} {row}" for row in rows[1:])]


def main() -> None:
    """Print the table for the cases that are named, or for all."""
    from tests.lab.undeclared.subject import curve_model

    parser = argparse.ArgumentParser(description="What the loop finds on flights of RotorPy.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--curve", action="store_true", help="start from the airframe's curve")
    parser.add_argument("--seed", type=int, default=0, help="other missions, air and noise")
    asked = parser.parse_args()
    if unknown := set(asked.cases) - set(CASES):
        parser.error(f"no case {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    print(
        f"{'changed':18s} {'found':22s} {'parameter':18s} {'value':>9s} "
        f"{'95 % interval':>22s} {'truth':>9s} {'in':4s} {'before':>6s} {'after':>5s} {'floor':>5s}"
        " unexplained"
    )
    with tempfile.TemporaryDirectory() as folder:
        if asked.curve:
            model = curve_model(QUAD, Path(folder))
        else:
            model, found = good_model(Path(folder), seed=asked.seed)
            print("\n".join(lines_of("good, from curve", CASES["nothing"], found)), flush=True)
        for name in asked.cases or CASES:
            case = CASES[name]
            result = answer(model, case, seed=asked.seed)
            print("\n".join(lines_of(name, case, result)), flush=True)


if __name__ == "__main__":
    main()
