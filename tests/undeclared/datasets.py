"""A sealed data set: flights to fit on, flights held out, and what is missing from their model.

Two changes that move the same rotors the same way at the same time (|correlation| above
`TOO_ALIKE`) are not put together: no one could tell them apart.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.undeclared.changes import NAMED, Change
from tests.undeclared.days import Day, random_day
from tests.undeclared.missions import random_style
from tests.undeclared.outside import OUTSIDE, Outside, draw_outside
from tests.undeclared.physics import QUAD, Array, Layout, Physics, hexa
from tests.undeclared.plant import Flight, fly
from tests.undeclared.truth import (
    ASKED_FROM_RPM,
    Base,
    Missing,
    error_of_truth,
    naturals,
    rms,
    settled,
    signal_of,
)

TOO_ALIKE = 0.9
MINUTES_BETWEEN_FLIGHTS = 20.0
CURVE_ONLY = "load_factor"  # a trained model has it from its own good flights
KINDS = ("none", *NAMED, CURVE_ONLY, "two", *OUTSIDE)

#: A healthy aircraft with everything that flight adds to the curve; its model is trained on it.
AIRCRAFT = Physics(drag_area=0.15, lift_gain=0.12, inertia=(2.2, 2.2, 4.5), damping=(1.5, 1.5, 1.0))
#: What a model must have learnt from good flights to miss it when it is not so.
TRAINED_ONLY = frozenset({"wind", "manoeuvre_moment"})


def bare(layout: Layout = QUAD) -> Physics:
    """An aircraft of which the airframe's curve tells all, but for its inertia."""
    return Physics(layout=layout, inertia=AIRCRAFT.inertia, damping=AIRCRAFT.damping)


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSet:
    """Flights and, sealed, the truth about them."""

    seed: int
    kind: str  # "none", a key of NAMED, "load_factor", "two", or one of OUTSIDE
    base: Base
    layout: Layout
    fit: tuple[Flight, ...]
    held_out: tuple[Flight, ...]
    missing: tuple[Missing, ...]
    outside: Outside | None
    outside_rpm: float  # RMS over the flights to fit on
    floor_rpm: float  # RMS of the reports about a model that knows the truth, flights to fit on
    knowing_rmse_rpm: float  # the same on the flights held out
    tries: int  # attempts until it asked for its change

    @property
    def asked(self) -> tuple[Missing, ...]:
        return tuple(m for m in self.missing if m.asked)


def healthy_flights(count: int, seed: int, physics: Physics = AIRCRAFT) -> list[Flight]:
    """Good flights over the whole range of missions and fills, to train and calibrate on."""
    rng = np.random.default_rng([seed, 1])
    flights = []
    for i in range(count):
        day = replace(random_day(rng), fill=4.0 + 12.0 * ((i * 0.618) % 1.0))
        style = replace(random_style(rng), cruise=2.0 + 6.0 * ((i * 0.382 + 0.1) % 1.0))
        flights.append(fly(physics, style, day, rng, f"good {i + 1}"))
    return flights


def the_days(
    rng: np.random.Generator, count: int, changes: Sequence[Change], still: bool
) -> list[Day]:
    """Days of one season at one field, in order; channels that a vehicle lacks it always lacks."""
    first = random_day(rng, still=still)
    days = []
    windy = any(c.name == "wind" for c in changes)
    strength, way = rng.uniform(2.5, 8.0), rng.uniform(0.0, 2 * np.pi)
    for i in range(count):
        day = replace(
            random_day(rng, still=still),
            board_heat=first.board_heat,
            wind_reported=first.wind_reported,
            clock_start=60.0 * MINUTES_BETWEEN_FLIGHTS * i,
        )
        if windy:
            # One day's work: the wind is the same for all its flights.
            day = replace(day, wind=(float(strength * np.cos(way)), float(strength * np.sin(way))))
        for change in changes:
            day = change.at(day)
        days.append(day)
    return days


def base_for(kind: str, rng: np.random.Generator) -> Base:
    if kind == CURVE_ONLY:
        return "curve"
    return "trained" if kind in TRAINED_ONLY or rng.random() < 0.6 else "curve"


def draw_changes(
    kind: str, base: Base, rng: np.random.Generator, healthy: Physics
) -> tuple[list[Change], Outside | None]:
    """The changes of one attempt at a data set of a kind."""
    if kind in ("none", CURVE_ONLY):
        return [], None
    if kind in OUTSIDE:
        return [], draw_outside(kind, rng, healthy.layout.rotors)
    if kind in NAMED:
        return [NAMED[kind](rng, healthy)], None
    if kind != "two":
        raise ValueError(f"no kind {kind!r}; there are {', '.join(KINDS)}")
    able = [n for n in NAMED if base == "trained" or n not in TRAINED_ONLY]
    while True:
        one, other = (NAMED[str(n)](rng, healthy) for n in rng.choice(able, 2, replace=False))
        if one.name != other.name:
            return [one, other], None


def build(kind: str, seed: int, base: Base | None = None, *, tries: int = 200) -> DataSet:
    """Draw a data set of one of `KINDS`, again and again until it asks for its change.

    Raises ValueError for an unknown kind and RuntimeError when no try gives one.
    """
    rng = np.random.default_rng([seed, 2, zlib.crc32(kind.encode())])
    base = base or base_for(kind, rng)
    for attempt in range(1, tries + 1):
        made = attempt_one(kind, seed, base, rng, attempt)
        if made is not None:
            return made
    raise RuntimeError(f"no data set of kind {kind!r} asks for its change in {tries} tries")


def attempt_one(
    kind: str, seed: int, base: Base, rng: np.random.Generator, attempt: int
) -> DataSet | None:
    """One data set, or None when its changes are too small to ask for or too alike."""
    layout = hexa(rng) if base == "curve" and rng.random() < 0.2 else QUAD
    healthy = AIRCRAFT if base == "trained" else bare(layout)
    # The curve alone misses every acceleration and turn; a gentle flight hardly has them.
    gentle = base == "curve" and (kind == "none" or rng.random() < 0.5)
    changes, outside = draw_changes(kind, base, rng, healthy)
    physics = healthy
    for change in changes:
        physics = change.on(physics)
    fit_count, held_count = int(rng.integers(3, 6)), int(rng.integers(1, 3))
    flights = [
        fly(physics, random_style(rng, gentle=gentle), day, rng, f"flight {i + 1}", outside)
        for i, day in enumerate(the_days(rng, fit_count + held_count, changes, gentle))
    ]
    fit, held_out = tuple(flights[:fit_count]), tuple(flights[fit_count:])
    signals = [signal_of(c, healthy, fit) for c in changes]
    missing = [
        Missing(
            name=c.name,
            variant=c.variant,
            rotor=c.rotor,
            truth={**c.truth, **truth_of_days(c, fit)},
            signal_rpm=rms(s),
            drawn=True,
        )
        for c, s in zip(changes, signals, strict=True)
    ] + naturals(base, fit)
    outside_rpm = rms(f.outside_rpm[settled(f)] for f in fit)
    if not all(m.asked for m in missing if m.drawn):
        return None
    if kind == "load_factor" and not any(m.asked for m in missing if m.name == kind):
        return None
    if outside is not None and outside_rpm < ASKED_FROM_RPM:
        return None
    if len(signals) == 2 and alike(*signals) > TOO_ALIKE:
        return None
    return DataSet(
        seed=seed,
        kind=kind,
        base=base,
        layout=layout,
        fit=fit,
        held_out=held_out,
        missing=tuple(missing),
        outside=outside,
        outside_rpm=outside_rpm,
        floor_rpm=error_of_truth(fit),
        knowing_rmse_rpm=error_of_truth(held_out),
        tries=attempt,
    )


def truth_of_days(change: Change, flights: Sequence[Flight]) -> dict[str, float]:
    """Parameters that belong to the day and not to the aircraft."""
    if change.name == "wind":
        north, east = flights[0].day.wind
        return {"north": north, "east": east}
    return {}


def alike(one: Sequence[Array], other: Sequence[Array]) -> float:
    """|correlation| about zero of two signals over the same flights, rotors and rows."""
    a, b = (np.concatenate([np.ravel(p) for p in parts]) for parts in (one, other))
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b)))
