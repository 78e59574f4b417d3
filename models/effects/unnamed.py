"""Unnamed causes: a share of thrust, or a moment, as a curve over a channel.

An effect that the catalogue does not explain will be there on the next flight too. A curve g
between knots over the observed range adds it to the model: for the collective as a share of every
rotor's thrust, else as a moment g x thrust x arm. Beyond the range the curve is held at its ends,
which `seen` reports. A search treats unnamed causes like effects, and those that held-out flights
confirm enter the model.
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
MOST = 0.3  # share of thrust or of thrust x arm, the largest credible one without a name


@dataclass(frozen=True, slots=True)
class Along:
    """A channel that a cause may depend on.

    `least` is the least span over which a dependence shows; `read` computes the channel from
    `needs`; `rests`: the cause is zero where the channel is 0.
    """

    unit: str
    least: float
    needs: tuple[str, ...]
    read: Callable[[Channels], Any]
    rests: bool = True


def _channel(name: str, unit: str, least: float) -> Along:
    """Return the entry of the channel `name`, read without conversion; `least` is in `unit`."""
    return Along(unit, least, (name,), lambda x: getattr(x, name))


ALONG: Mapping[str, Along] = {
    "airspeed": _channel("airspeed", "m/s", 1.0),
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
    "along_acceleration": _channel("along_acceleration", "m/s^2", 0.5),
    "advance_ratio": _channel("advance_ratio", "1", 0.01),
    "tank_kg": _channel("tank_kg", "kg", 0.1),
    "radius_over_height": _channel("radius_over_height", "1", 0.05),
    "time_s": _channel("time_s", "s", 20.0),
    "yaw_rate": _channel("yaw_rate", "rad/s", 0.1),
    "spraying": _channel("spraying", "1", 0.5),
    "air_temperature": replace(_channel("air_temperature", "K", 1.0), rests=False),
    "load": Along("kg", 0.5, ("load_factor",), lambda x: x.total_mass * x.load_factor),
}
#: causes on one rotor, and the channels that its loss may depend on: its load, the wake of other
#: rotors by airspeed, and heat by time; `load` is not used for modes
ROTOR, OF_ROTOR, ONLY_ROTORS = "rotor", ("load", "airspeed", "time_s"), ("load",)
SLOW = ("time_s", "tank_kg", "air_temperature")  # channels that change over minutes
CONSTANT = "constant"  # no channel: constant


def _values(count: int) -> tuple[Parameter, ...]:
    """Return the parameters of a curve's knots."""
    return tuple(
        Parameter(name=f"at_{k + 1}", unit="1", lower=-MOST, upper=MOST, scale=0.02, absent=None)
        for k in range(count)
    )


def _ends(unit: str) -> tuple[Parameter, ...]:
    """Return the parameters of a curve's range."""
    return tuple(
        Parameter(name=name, unit=unit, lower=-1e9, upper=1e9, scale=1.0, absent=None, detail=True)
        for name in ("low", "high")
    )


def curve_columns(values: Any, low: Any, high: Any) -> Any:
    """Return the weights (T, KNOTS) of the knots of a curve from `low` to `high`, constant
    beyond."""
    place = np.clip((values - low) / np.maximum(high - low, 1e-9), 0.0, 1.0) * (KNOTS - 1)
    return np.maximum(1.0 - np.abs(place[..., None] - np.arange(KNOTS)), 0.0)


def _unnamed_effect(mode: str, channel: str) -> Effect:
    """Return the effect of an unnamed cause: a curve over a channel, acting in a mode or on one
    rotor.

    `mode` is one of MODES or ROTOR. A `channel` outside ALONG means a constant instead of a curve.
    """
    along = ALONG.get(channel)

    def curve(p: Values, x: Channels) -> Any:
        """Return the value (T,) of the curve; 0 where its channel is NaN."""
        if along is None:
            return p["at_1"] + 0.0 * x.time_s
        columns = curve_columns(along.read(x), p["low"], p["high"])
        return np.nan_to_num(columns @ np.array([p[f"at_{k + 1}"] for k in range(KNOTS)]))

    def seen(p: Values, x: Channels) -> Any:
        """Flag the rows (T,) inside the curve's range."""
        assert along is not None
        values = along.read(x)
        return ~((values < p["low"]) | (values > p["high"]))

    def moments(p: Values, x: Channels, thrust: Any) -> tuple[Any, ...]:
        """Return the moments of the curve in its mode."""
        turning = curve(p, x) * thrust * x.arm
        return tuple(turning if of == mode else 0.0 * thrust for of in MODES[1:])

    def kappa(p: Values, x: Channels) -> Any:
        """Return the factor of thrust of the curve."""
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
    **{
        (mode, channel): _unnamed_effect(mode, channel)
        for mode in MODES
        for channel in (CONSTANT, *ALONG)
    },
    **{(ROTOR, channel): _unnamed_effect(ROTOR, channel) for channel in (CONSTANT, *OF_ROTOR)},
}
_PLACES = {effect.key: place for place, effect in UNNAMED.items()}


def place_of(effect: Effect) -> tuple[str, str]:
    """Return the mode (or "rotor") and the channel of an unnamed cause."""
    return _PLACES[effect.key]
