"""Where the vehicle was: position from home or from the estimator's origin, and where that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import Sampling, known_rows, plausible, sample
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.models.flight import Bools, Floats, Origin

#: Where zero may be, preferred first.
_PLACES = (("home", "home"), ("ekf_origin", "the estimator's origin"))


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Position (T, 3) m and what it counts from; None where nothing tells."""

    position_ned: Floats | None
    origin: Origin | None
    signal: Signal | None = None
    words: str = ""


def position_of(signals: Signals, clock_s: Floats, flying: Bools, sampling: Sampling) -> Place:
    """Position from home (or the first fix) by latitude and longitude, else the local position."""
    fixes = best(signals, "geodetic")
    # Local positions count from the estimator's own origin, wherever home is.
    places = _PLACES if fixes is not None else _PLACES[1:]
    origin, whose = _origin(signals, fixes, clock_s, flying, places)
    if fixes is not None and origin is not None:
        latitude, longitude, altitude = fixes.values.T
        at_zero = (latitude == 0) & (longitude == 0)
        inside = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360) & ~at_zero
        ned = pymap3d.geodetic2ned(
            np.where(inside, latitude, np.nan),
            longitude,
            plausible("altitude", altitude),
            origin.latitude_deg,
            origin.longitude_deg,
            origin.altitude,
        )
        signal = Signal("position_ned", fixes.source, fixes.time_s, np.stack(ned, axis=-1))
        words = f"{fixes.source} from {whose}"
        return Place(sample("position_ned", signal, clock_s, sampling), origin, signal, words)
    local = best(signals, "position_ned")
    if local is None:
        return Place(None, origin)
    position = sample("position_ned", local, clock_s, sampling)
    return Place(position, origin, local, local.source)


def _origin(
    signals: Signals,
    fixes: Signal | None,
    clock_s: Floats,
    flying: Bools,
    places: tuple[tuple[str, str], ...],
) -> tuple[Origin | None, str]:
    takeoff = clock_s[int(np.argmax(flying))] if flying.any() else clock_s[-1]
    for channel, whose in places:
        for signal in signals.get(channel, ()):
            placed = np.flatnonzero(_on_earth(signal.values))
            if placed.size:
                before = placed[signal.time_s[placed] <= takeoff]
                row = before[-1] if before.size else placed[0]
                return _as_origin(signal.values[row]), f"{whose} ({signal.source.split()[0]})"
    if fixes is not None:
        good = _on_earth(fixes.values)
        if good.any():
            return _as_origin(
                fixes.values[int(np.argmax(good))]
            ), "the first fix (no home reported)"
    return None, ""


def _on_earth(places: Floats) -> Bools:
    """(n,) True where latitude, longitude and altitude are a place, and not the 0, 0 of no fix."""
    latitude, longitude = places[:, 0], places[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360)
    return known_rows(places) & inside & ((latitude != 0) | (longitude != 0))


def _as_origin(values: Floats) -> Origin:
    return Origin(
        latitude_deg=float(values[0]), longitude_deg=float(values[1]), altitude=float(values[2])
    )
