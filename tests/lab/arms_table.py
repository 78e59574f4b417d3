"""How often the cause of a bad arm is found: a plant's arms, by cause, size and channels reported.

Example: python -m tests.lab.arms_table 0 20

The two numbers are the first seed of an aircraft and the one after the last. Each aircraft has
eight sound flights on eight days to learn from, then one flight with each cause of each size on one
arm, and four sound ones. Counted are: the right cause alone; it and others ("one of"); another
cause of the right arm; another arm; nothing. No constant of models/checks/arms is fitted to these.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.models.checks.arms.arm_plant import CAUSES, F16, Bad, arm_flight
from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.flight_arms import flight_arm_answer, learnt_arms
from thrustmargin.models.model.rotor_model import physics_model

SIZES = (0.03, 0.06, 0.12)
GOOD_FLIGHTS, SOUND_FLIGHTS = 8, 4
TEMPERATURES = ("esc_temperature", "motor_temperature")
#: What is not reported.
WITHOUT = {
    "nothing": (),
    "ESC voltage": ("esc_voltage",),
    "ESC current": ("esc_current",),
    "temperatures": TEMPERATURES,
    "motor outputs": ("throttle",),
    "vibration": ("vibration_per_rev",),
    "level of vibration": ("vibration", "clipping"),
    "lost frames": ("esc_lost",),
    "all but speeds": (
        *("esc_voltage", "esc_current", *TEMPERATURES),
        *("throttle", "vibration_per_rev", "vibration", "clipping", "esc_lost"),
    ),
}
MODEL = physics_model(F16)


def silenced(track: FlightTrack, channels: Sequence[str]) -> FlightTrack:
    """The flight without these channels."""
    return replace(track, **{c: np.full_like(getattr(track, c), np.nan) for c in channels})


def outcome(answer: ArmAnswer, bad: Bad) -> str:
    """One word for an answer about a flight with a known cause."""
    if bad.cause == "shaken" and answer.shaken is not None and not answer.findings:
        return "right"
    if not answer.findings:
        return "nothing" if answer.shaken is None else "of the aircraft"
    if bad.cause == "shaken":
        return "OTHER ARM"
    if any(one.arm != bad.arm for one in answer.findings):
        return "OTHER ARM"
    listed = [one.cause.value for one in answer.findings[0].causes]
    if bad.cause not in listed:
        return "OTHER CAUSE"
    return "right" if len(listed) == 1 else "one of"


def table_of(name: str, channels: Sequence[str], seeds: Sequence[int]) -> Table:
    """Outcomes by cause and size, without some channels; the title has the sound flights."""
    alarms, counts = 0, {(cause, size): Counter[str]() for cause in CAUSES for size in SIZES}
    for seed in seeds:
        good = [arm_flight(1000 * seed + k, k, aircraft=seed) for k in range(GOOD_FLIGHTS)]
        law = learnt_arms(MODEL, [silenced(track, channels) for track in good])
        known = replace(MODEL, arms=law)

        def answer(track: FlightTrack, known=known) -> ArmAnswer:
            return flight_arm_answer(analyse(silenced(track, channels), known))

        for k in range(SOUND_FLIGHTS):
            found = answer(arm_flight(90_000 + 100 * seed + k, 20 + k, aircraft=seed))
            alarms += bool(found.findings) or found.shaken is not None
        for k, (cause, size) in enumerate(counts):
            bad = Bad(cause=cause, size=size, arm=(seed + k) % 4)
            track = arm_flight(50_000 + 100 * seed + k, 30, bad, aircraft=seed)
            counts[cause, size][outcome(answer(track), bad)] += 1
    flights = SOUND_FLIGHTS * len(seeds)
    table = Table("cause", *(f"{100 * s:.0f} %" for s in SIZES))
    table.title = f"without {name}: {alarms} of {flights} sound flights with a finding"
    for cause in CAUSES:
        cells = (counts[cause, size].most_common() for size in SIZES)
        table.add_row(cause, *(", ".join(f"{n} {word}" for word, n in cell) for cell in cells))
    return table


def main(first: int, end: int) -> None:
    """Print one table for each set of missing channels."""
    console = Console(width=150)
    for name, channels in WITHOUT.items():
        console.print(table_of(name, channels, range(first, end)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
