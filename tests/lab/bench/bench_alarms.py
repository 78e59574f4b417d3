"""How often each alarm is false, and how soon a bad propeller is named.

False alarms are counted on three groups of recorded flights, each through the whole monitor:
- campaign: the healthy aircraft. The thresholds were chosen on these flights, and the shipped model
  was trained on them;
- other conditions: the same healthy aircraft in wind, at altitude, climbing, with a sagging pack,
  and the reference of the onset; neither the thresholds nor the model have seen them;
- other aircraft: 3 kg too heavy, or its centre of gravity shifted; a rotor named bad would be
  false.
Explained is: a margin where weight, air and pack alone leave less than the limit; an empty tank; a
tank that parts from the thrust of the aircraft that is too heavy; and a training domain that is
left in conditions that the model has not seen. A margin is always measured: where it is not
explained, wind, climb or a turn took it, and it is counted as false all the same. The largest rate
that goes with what was counted is given beside it (95 %, Poisson): no alarm in an hour does not
prove none in ten.

How soon is what a pilot waits: from the fault until the alarm can be read (`screened`), not its
time stamp.

Losses of a propeller are put into the healthy flights: the autopilot holds the thrust, so that the
rotor turns faster by 1/sqrt(1 - loss). That the others answer is only in the recorded faults.

Each third flight is taken; THRUSTMARGIN_EVERY=1 takes all.
THRUSTMARGIN_SITL names a folder of recorded flights other than the project's: the hexacopter and
the hard turns are not among those. Other layouts: bench_rotor_faults.py.
"""

import math
import os
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

from tests.gcs_plugin.live.live_vehicle import log_frames
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import RULES
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.rows.tank_balance import virtual_gauge
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_faults import fault_model
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.margin import ceiling, hover_use, weight

LIMIT = 0.5
EVERY = int(os.environ.get("THRUSTMARGIN_EVERY", "3"))
GROUPS = {
    "campaign": ("campaign/*.tlog",),
    "other conditions": (
        "dev/windy_*.tlog",
        "dev/high_altitude_*.tlog",
        "dev/climb_*.tlog",
        "voltage/sag_real_rpm.tlog",
        "onset/reference.tlog",
    ),
    "other aircraft": ("dev/extra_mass_*.tlog", "dev/cg_forward_*.tlog"),
    "hard turns": ("hard_yaw/f16_B.tlog", "hexa/hexa_H[1-4].tlog"),
}
#: File, alarm, rotor from 1, and its onset: s after 2 m of height, None: from take-off.
FAULTS = (
    ("dev/worn_prop_1.tlog", "rotor", 1, None),
    ("dev/worn_prop_2.tlog", "rotor", 1, None),
    ("dev/worn_prop_3.tlog", "rotor", 1, None),
    ("hard_yaw/f16_C.tlog", "rotor", 2, 25.0),
    ("hard_yaw/f16_C.tlog", "rotor", 3, 80.0),
    ("hard_yaw/f16_C.tlog", "motor", 1, 130.0),
    ("hexa/hexa_H5.tlog", "rotor", 4, 30.0),
)

#: File, airframe (the shipped model without one), weak rotor from 1, and its onset, s of boot.
RIGHT_ARMS = (
    ("right_arms/quad_thrustonly_3_80.tlog", "", 3, 412.2),
    ("right_arms/quad_thrustonly_3_80.tlog", "topxgun-f16-sitl", 3, 412.2),
    ("right_arms/octo_rotor3_80.tlog", "octo.toml", 3, 411.2),
    ("right_arms/px4_rotor2_90.tlog", "topxgun-f16-sitl", 2, 121.2),
)
ROUND = 0.1  # s of frames that are taken at once


@pytest.fixture
def recorded(sitl_logs) -> Path:
    return Path(os.environ.get("THRUSTMARGIN_SITL") or sitl_logs)


def model_of(path: Path) -> RotorModel:
    """The shipped model; of another aircraft the airframe file beside its flights, alone."""
    own = [load_airframe(file) for file in path.parent.glob("*.toml")]
    return physics_model(own[0]) if own else shipped_model()


class Kept(Output):
    """A subscriber that keeps the events, each with the rows that it came with."""

    def __init__(self) -> None:
        self.events, self.flown_s = [], 0.0
        self._last = None

    def on_update(self, update) -> None:
        self.flown_s += 0.1 * int(np.sum(update.analysis.track.flying[update.first :]))
        self._last = update

    def on_event(self, vehicle, event) -> None:
        self.events.append((vehicle, event, self._last))


def watched(path: Path) -> Kept:
    kept = Kept()
    monitor = LiveMonitor(model_of(path), MonitorSettings(urls=(str(path),)), outputs=[kept])
    monitor.start()
    while not monitor.finished:
        time.sleep(0.02)
    monitor.close()
    monitor.check()
    return kept


def screened(path: Path, model: RotorModel) -> list[tuple[float, AlarmEvent]]:
    """Return the events of a .tlog, each with the time at which a pilot can read it.

    Times are s of the vehicle's clock. Frames are taken as they came, in rounds of ROUND seconds;
    what the processor takes for a round is not in it.
    """
    fleet, events = Fleet(model), []
    frames = log_frames(path)
    rounds = [(frame.stamp_us - frames[0].stamp_us) // round(ROUND * 1e6) for frame in frames]
    for n, part in groupby(zip(rounds, frames, strict=True), key=lambda pair: pair[0]):
        fleet.take([frame for _, frame in part])
        ends_us = frames[0].stamp_us + (n + 1) * round(ROUND * 1e6)
        for update in fleet.updates():
            late = (ends_us - int(update.stamp_us[-1])) * 1e-6
            events += [(float(update.clock_s[-1]) + late, event) for event in update.events]
    return events


def justified(update) -> bool:
    """Whether weight, air and pack alone leave less than the limit (and its hysteresis)."""
    analysis, airframe = update.analysis, update.analysis.model.airframe
    track = analysis.track
    limits = ceiling(airframe, analysis.density, track.voltage)
    left = 1.0 - hover_use(airframe, limits, weight(airframe, track.tank_kg))
    return float(np.nanmin(left)) < LIMIT + 0.03


@dataclass
class Count:
    """What was raised on one group of flights."""

    flights: int = 0
    hours: float = 0.0
    false: Counter = field(default_factory=Counter)
    true: Counter = field(default_factory=Counter)  # explained

    def most(self, name: str) -> float:
        """Upper end of the 95 % interval of the false alarms an hour."""
        return float(chi2.ppf(0.975, 2 * (self.false[name] + 1))) / 2 / self.hours


def explained(path: Path, event, update) -> bool:
    """Whether what was raised is what the flight was recorded for, or its load."""
    name, text = event.alarm.name, event.alarm.text
    if name in ("margin", "margin ahead"):
        return justified(update)
    if name == "tank":
        return text.startswith("Tank empty") or path.name.startswith("extra_mass")
    return name == "envelope" and path.parent.name != "campaign"


def counted(paths: list[Path]) -> Count:
    count = Count()
    for path in paths:
        kept = watched(path)
        count.flights, count.hours = count.flights + 1, count.hours + kept.flown_s / 3600
        for _, event, update in kept.events:
            if event.raised:
                known = explained(path, event, update)
                (count.true if known else count.false)[event.alarm.name] += 1
    return count


def table(counts: dict[str, Count]) -> Table:
    titles = [f"{name}: {c.flights} flights, {c.hours:.2f} h" for name, c in counts.items()]
    shown = Table("alarm", *titles, title="alarms raised: false (an hour, at most), and explained")
    for name in (rule.name for rule in RULES):
        shown.add_row(
            name,
            *(
                f"{c.false[name]} ({c.false[name] / c.hours:.1f}/h, < {c.most(name):.1f}/h), "
                f"{c.true[name]} explained"
                for c in counts.values()
            ),
        )
    return shown


def test_false_alarms(benchmark, recorded):
    counts: dict[str, Count] = {}

    def measure() -> None:
        for name, patterns in GROUPS.items():
            paths = [path for pattern in patterns for path in sorted(recorded.glob(pattern))]
            found = counted(paths[::EVERY])
            if found.flights:
                counts[name] = found

    benchmark.pedantic(measure, rounds=1)
    Console(width=150).print(table(counts))
    benchmark.extra_info.update({name: dict(c.false) for name, c in counts.items()})


def named(track, model, loss: float, rotor: int, onset: float) -> list[tuple[float, int]]:
    """(s after the onset, rotor from 1) of the rotor alarms, with the loss put into the flight."""
    factor = np.ones((track.time_s.size, 4))
    factor[track.time_s >= onset, rotor] = 1 / math.sqrt(1 - loss)
    analysis = analyse(replace(track, rotor_speed_rpm=track.rotor_speed_rpm * factor), model)
    nothing = np.full(track.time_s.size, np.nan)
    events = Alarms().rows(
        analysis, 0, clock_s=track.time_s, pumped_kg=nothing, virtual_kg=virtual_gauge(analysis)
    )
    # What rows wait for comes on top.
    return [
        (e.time_s - onset + fault_model(model).look_ahead_s, e.alarm.rotor or 0)
        for e in events
        if e.raised and e.alarm.name == "rotor"
    ]


@pytest.mark.parametrize("loss", [0.10, 0.07, 0.05])
def test_seconds_until_a_bad_propeller_is_named(benchmark, sitl_logs, loss):
    model = shipped_model()
    random = np.random.default_rng(7)
    delays: list[float] = []
    wrong = 0

    def measure() -> None:
        nonlocal wrong
        for path in sorted((sitl_logs / "campaign").glob("*.tlog"))[::EVERY]:
            track = read_log(path, airframe=model.airframe, sampling="hold").track
            flying = track.time_s[track.flying]
            for rotor in range(4):
                onset = random.uniform(flying[0] + 15, flying[-1] - 40)
                found = named(track, model, loss, rotor, onset)
                delays.append(found[0][0] if found else math.inf)
                wrong += bool(found) and found[0][1] != rotor + 1

    benchmark.pedantic(measure, rounds=1)
    late = sum(delay > 10 for delay in delays)
    print(
        f"\nloss of {loss:.0%}: named after {np.median(delays):.1f} s (median), "
        f"{np.quantile(delays, 0.95):.1f} s (95 %), {max(delays):.1f} s (all {len(delays)}); "
        f"{late} later than 10 s, {wrong} named the wrong rotor"
    )


def test_the_recorded_onset(benchmark, sitl_logs):
    """Rotor 3 makes 0.88 of its thrust from 180 s after boot, 143.95 s into the log."""
    path = sitl_logs / "onset" / "worn_prop_onset.tlog"
    kept: list[tuple[float, AlarmEvent]] = []
    benchmark.pedantic(lambda: kept.extend(screened(path, shipped_model())), rounds=1)
    print(f"\nrecorded onset of 12 %: {waits(kept, 'rotor', 3, 180.0)}")


def waits(events: list[tuple[float, AlarmEvent]], name: str, rotor: int, onset: float) -> str:
    """Return in words how long a pilot waits for the first alarm of a rotor, and what else came."""
    raised = [(at, e) for at, e in events if e.raised and e.alarm.name in ("rotor", "motor")]
    right = [(at, e) for at, e in raised if (e.alarm.name, e.alarm.rotor) == (name, rotor)]
    right = [(at, e) for at, e in right if at > onset]
    if not right:
        return f"not named; {len(raised)} others"
    at, event = right[0]
    stamp = event.time_s - onset
    return f"{at - onset:.1f} s (its time stamp: {stamp:.1f} s): {event.alarm.text}"


def test_seconds_that_a_pilot_waits(benchmark, recorded):
    """From the fault to the screen, of flights whose onset is known by the vehicle's clock."""
    said: list[str] = []

    def measure() -> None:
        for file, airframe, rotor, onset in RIGHT_ARMS:
            path = recorded / file
            if path.exists():
                own = str(path.parent / airframe) if airframe.endswith(".toml") else airframe
                model = physics_model(load_airframe(own)) if airframe else shipped_model()
                waited = waits(screened(path, model), "rotor", rotor, onset)
                said.append(f"{file} by {airframe or 'the shipped model'}: {waited}")

    benchmark.pedantic(measure, rounds=1)
    print("", *said, sep="\n")


def test_the_recorded_faults(benchmark, recorded):
    """Each through the whole monitor: when and what is said of the rotor, and of any other."""
    known: dict[str, list[tuple[float, AlarmEvent]]] = {}

    def measure() -> None:
        for file, *_ in FAULTS:
            if file not in known and (path := recorded / file).exists():
                known[file] = screened(path, model_of(path))

    benchmark.pedantic(measure, rounds=1)
    for file, name, rotor, onset in FAULTS:
        if file not in known:
            continue
        log = read_log(recorded / file, airframe=model_of(recorded / file).airframe)
        up = log.track.flying if onset is None else np.nan_to_num(log.track.height_agl) > 2.0
        began = log.clock_start_s + log.track.time_s[np.argmax(up)] + (onset or 0.0)
        raised = [(at, e) for at, e in known[file] if e.raised and e.alarm.name == name]
        right = [(at, e) for at, e in raised if e.alarm.rotor == rotor and e.time_s > began]
        of_file = {(n, r) for f, n, r, _ in FAULTS if f == file}
        wrong = sum((e.alarm.name, e.alarm.rotor) not in of_file for _, e in raised)
        said = "not named"
        if right:
            said = f"{right[0][0] - began:.1f} s: {right[0][1].alarm.text}"
        print(f"\n{file} {name} {rotor}: {said}; {wrong} wrong", end="")
    print()
