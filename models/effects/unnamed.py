"""Causes without a name: a share of thrust, or a moment, that goes along a channel as it was seen.

What no effect of the table explains is still there on the next flight. A curve g between knots over
the range in which it was seen takes it into the model: of the collective as a share of every
rotor's thrust, else as a moment g x thrust x arm. Beyond that range it is held at its edge, and
`seen` says so. A search weighs them as it does effects, and what flights left out show again goes
into the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter, Values
from thrustmargin.models.effects.channels import Channels

KNOTS = 4  # of a curve
NAME = "unnamed_cause"
MODES = ("collective", "roll", "pitch", "yaw")
#: of thrust or of thrust x arm: its usual size, and the largest that is believed without a name
USUAL, MOST = 0.05, 0.3


@dataclass(frozen=True, slots=True)
class Along:
    """A channel that a cause may go along, the least span over which that shows, its reading from
    `needs`, and whether nothing acts along it where it is 0."""

    unit: str
    least: float
    needs: tuple[str, ...]
    read: Callable[[Channels], Any]
    rests: bool = True


def _plain(name: str, unit: str, least: float) -> Along:
    return Along(unit, least, (name,), lambda x: getattr(x, name))


ALONG: Mapping[str, Along] = {
    "airspeed": _plain("airspeed", "m/s", 1.0),
    "forward_speed": Along(
        "m/s",
        1.0,
        ("velocity_north", "velocity_east", "heading"),
        lambda x: x.velocity_north * np.cos(x.heading) + x.velocity_east * np.sin(x.heading),
    ),
    "side_speed": Along(
        "m/s",
        1.0,
        ("velocity_north", "velocity_east", "heading"),
        lambda x: x.velocity_east * np.cos(x.heading) - x.velocity_north * np.sin(x.heading),
    ),
    "along_acceleration": _plain("along_acceleration", "m/s^2", 0.5),
    "advance_ratio": _plain("advance_ratio", "1", 0.01),
    "tank_kg": _plain("tank_kg", "kg", 0.1),
    "radius_over_height": _plain("radius_over_height", "1", 0.05),
    "time_s": _plain("time_s", "s", 20.0),
    "yaw_rate": _plain("yaw_rate", "rad/s", 0.1),
    "spraying": _plain("spraying", "1", 0.5),
    "air_temperature": replace(_plain("air_temperature", "K", 1.0), rests=False),
    "load": Along("kg", 0.5, ("load_factor",), lambda x: x.total_mass * x.load_factor),
}
#: that of one rotor, and the channels along which its loss may go: what it carries, where it meets
#: another's wake, and what gets warm; the first is not one of a mode
ROTOR, OF_ROTOR, ONLY_ROTORS = "rotor", ("load", "airspeed", "time_s"), ("load",)
SLOW = ("time_s", "tank_kg", "air_temperature")  # channels that change over minutes
CONSTANT = "constant"  # along nothing: the same all the time


def _values(count: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(name=f"at_{k + 1}", unit="1", lower=-MOST, upper=MOST, scale=0.02, absent=None)
        for k in range(count)
    )


def _ends(unit: str) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(name=name, unit=unit, lower=-1e9, upper=1e9, scale=1.0, absent=None, detail=True)
        for name in ("low", "high")
    )


def curve_columns(values: Any, low: Any, high: Any) -> Any:
    """(T, KNOTS) weights of the knots of a curve from `low` to `high`, held at its ends."""
    place = np.clip((values - low) / np.maximum(high - low, 1e-9), 0.0, 1.0) * (KNOTS - 1)
    return np.maximum(1.0 - np.abs(place[..., None] - np.arange(KNOTS)), 0.0)


def _made(mode: str, channel: str) -> Effect:
    along = ALONG.get(channel)

    def curve(p: Values, x: Channels) -> Any:
        if along is None:
            return p["at_1"] + 0.0 * x.time_s
        columns = curve_columns(along.read(x), p["low"], p["high"])
        return np.nan_to_num(columns @ np.array([p[f"at_{k + 1}"] for k in range(KNOTS)]))

    def seen(p: Values, x: Channels) -> Any:
        assert along is not None
        values = along.read(x)
        return ~((values < p["low"]) | (values > p["high"]))

    def moments(p: Values, x: Channels, thrust: Any) -> tuple[Any, ...]:
        turning = curve(p, x) * thrust * x.arm
        return tuple(turning if of == mode else 0.0 * thrust for of in MODES[1:])

    def kappa(p: Values, x: Channels) -> Any:
        return 1.0 - curve(p, x)

    collective = mode in (MODES[0], ROTOR)
    return Effect(
        name=NAME,
        variant=f"{mode} along {channel}",
        kind=Kind.COEFFICIENT if collective else Kind.MOMENTS,
        parameters=_values(1) if along is None else (*_values(KNOTS), *_ends(along.unit)),
        needs=() if along is None else along.needs,
        neutral={} if along is None else dict.fromkeys(along.needs, float("nan")),
        source="what flights left out show again, and no effect of the table explains",
        apply=kappa if collective else moments,
        torque=kappa if mode == ROTOR else None,
        of_one_rotor=mode == ROTOR,
        seen=None if along is None else seen,
    )


UNNAMED: Mapping[tuple[str, str], Effect] = {
    **{(mode, channel): _made(mode, channel) for mode in MODES for channel in (CONSTANT, *ALONG)},
    **{(ROTOR, channel): _made(ROTOR, channel) for channel in (CONSTANT, *OF_ROTOR)},
}
_PLACES = {effect.key: place for place, effect in UNNAMED.items()}


def place_of(effect: Effect) -> tuple[str, str]:
    """The mode, or "rotor", and the channel of a cause without a name."""
    return _PLACES[effect.key]
