"""How soon a bad propeller or motor is named on other layouts, and how often a sound one is.

Quad, hexacopter, octocopter and coaxial pairs of the tests' own plant (blade elements, wakes, hard
turns; no law of it is one of the models'), with nothing known but the airframe file: no network, no
good flights. The propeller is cut in flight, or from a moment on a motor's output rises by what its
rotor no longer follows. Seeds 1 to 99 are for development.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from tests.lab.undeclared.conditions import Condition
from tests.lab.undeclared.crafts import CRAFTS, Craft
from tests.lab.undeclared.days import random_day
from tests.lab.undeclared.missions import random_style
from tests.lab.undeclared.plant import EXPO, FIRST_ROW, SPIN_MAX, SPIN_MIN, fly
from tests.lab.undeclared.rotor_aero import cut_for_loss
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.rotor_faults import RotorFaults, fault_signals
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import airframe_from_table

ONSET = 75.0  # s of a mission; the track begins FIRST_ROW later
FLIGHTS = 3


def model_of(craft: Craft) -> RotorModel:
    import tomllib

    return physics_model(airframe_from_table(tomllib.loads(craft.airframe_toml()), craft.name))


@cache
def flown(craft: Craft, seed: int, loss: float, rotor: int) -> FlightTrack:
    """A flight of which one propeller loses so much thrust from ONSET on."""
    rng = np.random.default_rng([seed, 31])
    style, day = random_style(rng, craft.radius), random_day(rng)
    cut = cut_for_loss(craft.blade, loss) if loss else 0.0
    condition = Condition(cut=cut, rotor=rotor, cut_from=day.clock_start + ONSET)
    return fly(craft, condition, style, day, [seed, 32], f"{craft.name} {seed}").track


def weakened(track: FlightTrack, rotor: int, share: float) -> FlightTrack:
    """The same with a motor that from ONSET on turns at `share` of the speed that it did for its
    output: the autopilot raises the output until the speed is as before."""
    output = track.throttle.copy()
    late = track.time_s >= ONSET - FIRST_ROW
    c = (output[late, rotor] - SPIN_MIN) / (SPIN_MAX - SPIN_MIN)
    thrust = ((1.0 - EXPO) * c + EXPO * c**2) / share**2
    c = (EXPO - 1.0 + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * thrust)) / (2.0 * EXPO)
    output[late, rotor] = np.clip(SPIN_MIN + (SPIN_MAX - SPIN_MIN) * c, 0.0, 1.0)
    return replace(track, throttle=output)


def slower(track: FlightTrack, hertz: int) -> FlightTrack:
    """The flight by telemetry that comes so often."""
    return track.rows(slice(None, None, 10 // hertz))


def named(track: FlightTrack, model: RotorModel) -> Iterator[tuple[float, RotorFault]]:
    """Every fault when it is named, and as it is known 12 s later."""
    faults, before = RotorFaults(model), set()
    signals = fault_signals(analyse(track, model), slice(None))
    for time_s, flying, row in zip(track.time_s, track.flying, signals, strict=True):
        if not flying:
            faults.landed(float(time_s))
            continue
        faults.add(float(time_s), row)
        now = {(fault.kind, fault.rotor): fault for fault in faults.current}
        for key in now.keys() - before:
            yield float(time_s), now[key]
        before = set(now)


@pytest.mark.parametrize("hertz", [10, 2, 1])
def test_sound_aircraft_of_other_layouts(benchmark, hertz):
    rows: list[str] = []

    def measure() -> None:
        for craft in CRAFTS:
            model, false, seconds = model_of(craft), [], 0.0
            for seed in range(1, 1 + FLIGHTS):
                track = slower(flown(craft, seed, 0.0, 0), hertz)
                seconds += float(track.row_seconds[track.flying].sum())
                false += [fault for _, fault in named(track, model)]
            most = float(chi2.ppf(0.975, 2 * (len(false) + 1))) / 2 / (seconds / 3600)
            rows.append(
                f"{craft.name} at {hertz} Hz: {len(false)} false in {seconds / 3600:.2f} h "
                f"(< {most:.1f}/h)"
            )

    benchmark.pedantic(measure, rounds=1)
    print("", *rows, sep="\n")


@pytest.mark.parametrize("hertz", [10, 2, 1])
@pytest.mark.parametrize("loss", [0.1, 0.2, 0.3])
def test_a_propeller_cut_in_flight(benchmark, loss, hertz):
    benchmark.pedantic(lambda: print(*table(loss, "propeller", hertz), sep="\n"), rounds=1)


@pytest.mark.parametrize("short", [0.08, 0.2])
def test_a_motor_that_goes_weak(benchmark, short):
    benchmark.pedantic(lambda: print(*table(short, "motor"), sep="\n"), rounds=1)


def table(size: float, kind: str, hertz: int = 10) -> Iterator[str]:
    """One line a layout: how soon, and how many wrong."""
    yield f"\n{kind} {size:.0%} at {hertz} Hz"
    for craft in CRAFTS:
        model, delays, wrong = model_of(craft), [], 0
        for seed in range(1, 1 + FLIGHTS):
            rotor = (3 * seed) % craft.rotors
            if kind == "motor":
                track = weakened(flown(craft, seed, 0.0, 0), rotor, 1.0 - size)
            else:
                track = flown(craft, seed, size, rotor)
            found = [(at, f) for at, f in named(slower(track, hertz), model)]
            right = [
                at + FIRST_ROW - ONSET for at, f in found if (f.kind, f.rotor) == (kind, rotor)
            ]
            delays.append(min(right, default=np.inf))
            wrong += sum((f.kind, f.rotor) != (kind, rotor) for _, f in found)
        words = ", ".join("not" if d == np.inf else f"{d:.1f} s" for d in delays)
        yield f"  {craft.name}: named after {words}; {wrong} wrong"
