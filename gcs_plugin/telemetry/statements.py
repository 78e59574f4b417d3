"""Channels that the user states: the load on board, the air of the day; and a tank that is none.

A stated load takes the place of every gauge. From its start it falls by what the pump's output says
has been delivered. A stated end scales that fall to reach it; with no pump it falls evenly over the
time of spraying, else of flight. A listener knows no end of the flight: there the pump alone makes
it fall, and the stated end is the least that is left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.telemetry.resample import Sampling
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Provenance, SourceKind, stated

#: K: how well a thermometer in the shade or a weather report has the air at the rotors.
STATED_TEMPERATURE_ERROR = 2.0
LONGEST_STEP = 2.0  # s between rows beyond which nothing is summed up


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to read: see `logs.read_sorties`."""

    airframe: Airframe | None = None
    sampling: Sampling = "linear"
    tank: str = "auto"
    tank_start_kg: float | None = None
    load: float | None = None  # kg
    load_end: float | None = None  # kg
    air_temperature: float | None = None  # K


def stated_channels(
    options: Options,
    *,
    time_s: Floats,
    flying: Bools,
    spraying: Floats,
    pumped_kg: Floats,
) -> Iterator[tuple[str, Floats, Provenance, Floats | None]]:
    """Each channel that `options` state: its name, values (T,), source and standard error (T,).

    `spraying` (T,) is 1 while the pump runs, `pumped_kg` (T,) what its output sums up to; both are
    NaN where unknown. The error is None where there is none to state. An aircraft without a tank
    carries 0 kg whatever a gauge says, unless `options` name the gauge.
    """
    rows = time_s.size
    if options.load is not None:
        step = np.minimum(np.diff(time_s, prepend=time_s[:1]), LONGEST_STEP)
        sums = {
            "the pump's output": np.maximum.accumulate(np.nan_to_num(pumped_kg)),
            "the time of spraying": np.cumsum(step * (spraying == 1.0)),
            "the time of flight": np.cumsum(step * flying),
        }
        load, remark = _load(options, options.load, sums)
        yield "tank_kg", load, stated(remark), None
    elif no_tank(options) and (craft := options.airframe) is not None:
        tankless = Provenance(
            kind=SourceKind.AIRFRAME, name=craft.name, remarks=("without a tank: 0 kg",)
        )
        yield "tank_kg", np.zeros(rows), tankless, None
    if options.air_temperature is not None:
        outside = stated(f"{options.air_temperature - 273.15:g} °C outside")
        error = np.full(rows, STATED_TEMPERATURE_ERROR)
        yield "temperature", np.full(rows, options.air_temperature), outside, error


def no_tank(options: Options) -> bool:
    """True when the airframe has no tank and nobody names a gauge of one."""
    craft = options.airframe
    return craft is not None and craft.tank_volume_l == 0.0 and options.tank in ("auto", "none")


def stated_track(track: FlightTrack, options: Options) -> FlightTrack:
    """A track read as a table with what `options` state in the place of its own."""
    unknown = np.full(track.time_s.size, np.nan)
    sources, errors = dict(track.sources), dict(track.standard_errors)
    arrays: dict[str, Floats] = {}
    if options.tank.strip().lower() == "none":
        arrays["tank_kg"] = unknown
    for channel, values, source, error in stated_channels(
        options,
        time_s=track.time_s,
        flying=track.flying,
        spraying=track.spraying,
        pumped_kg=unknown,
    ):
        arrays[channel], sources[channel] = values, source
        if error is not None:
            errors[channel] = error
    return replace(track, sources=sources, standard_errors=errors, **arrays)


def _load(options: Options, start: float, sums: dict[str, Floats]) -> tuple[Floats, str]:
    """kg (T,) on board, and how it falls, for people.

    `sums` (T,) grow with the load's fall, best first.
    """
    begins, end = f"{start:g} kg", options.load_end
    pump = sums["the pump's output"]
    if end is not None and options.sampling == "linear":
        for words, total in sums.items():
            if total[-1] > 0.0:
                load = start - (start - end) * total / total[-1]
                return load, f"{begins} at the start, falling with {words} to {end:g} kg"
    elif pump[-1] > 0.0 or end is not None:
        least = 0.0 if end is None else end
        limit = "" if end is None else f", at least {end:g} kg"
        words = f"{begins} at the start, falling with the pump's output{limit}"
        return np.maximum(start - pump, least), words
    return np.full(pump.size, start), f"{begins}, constant: nothing shows that it falls"
