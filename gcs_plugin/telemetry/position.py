"""Where the vehicle was: position from home or from the estimator's origin, and where that is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import known_rows, plausible
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.models.flight import Bools, Floats, Origin

#: Where zero may be, preferred first.
_PLACES = (("home", "home"), ("ekf_origin", "the estimator's origin"))


@dataclass(frozen=True, slots=True)
class PlaceOfZero:
    """Where positions count from, how good that is (0: home), and whether it still may move."""

    origin: Origin
    rank: int
    words: str
    settled: bool  # by a take-off since


def position_sources(
    signals: Signals, zero: PlaceOfZero | None
) -> tuple[tuple[Signal, ...], dict[str, str]]:
    """Sources of the position, and their words: latitude and longitude from zero, the local one."""
    sources, words = [], {}
    fixes = best(signals, "geodetic")
    if fixes is not None and zero is not None:
        latitude, longitude, altitude = fixes.values.T
        at_zero = (latitude == 0) & (longitude == 0)
        with np.errstate(invalid="ignore"):
            inside = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360) & ~at_zero
        ned = pymap3d.geodetic2ned(
            np.where(inside, latitude, np.nan),
            longitude,
            plausible("altitude", altitude),
            zero.origin.latitude_deg,
            zero.origin.longitude_deg,
            zero.origin.altitude,
        )
        placed = Signal("position_ned", fixes.source, fixes.time_s, np.stack(ned, axis=-1))
        sources.append(placed)
        words[fixes.source] = f"{fixes.source} from {zero.words}"
    local = best(signals, "position_ned")
    if local is not None:
        sources.append(local)
    return tuple(sources), words


def place_of_zero(
    signals: Signals, clock_s: Floats, flying: Bools, before: PlaceOfZero | None = None
) -> PlaceOfZero | None:
    """Home as it was at take-off, else the estimator's origin, else the first fix.

    A place `before` that a take-off has settled gives way only to a better kind of place.
    """
    fixes = best(signals, "geodetic")
    settled = bool(flying.any()) or (before is not None and before.settled)
    takeoff = clock_s[int(np.argmax(flying))] if flying.any() else clock_s[-1]
    for rank, (channel, whose) in enumerate(_PLACES):
        # Local positions count from the estimator's own origin, wherever home is.
        if fixes is None and channel == "home":
            continue
        if before is not None and before.settled and rank >= before.rank:
            break
        for signal in signals.get(channel, ()):
            placed = np.flatnonzero(_on_earth(signal.values))
            if placed.size:
                earlier = placed[signal.time_s[placed] <= takeoff]
                row = earlier[-1] if earlier.size else placed[0]
                words = f"{whose} ({signal.source.split()[0]})"
                return PlaceOfZero(_as_origin(signal.values[row]), rank, words, settled)
    if before is not None:
        return replace(before, settled=settled)
    good = np.empty(0) if fixes is None else np.flatnonzero(_on_earth(fixes.values))
    if fixes is None or good.size == 0:
        return None
    words = "the first fix (no home reported)"
    return PlaceOfZero(_as_origin(fixes.values[good[0]]), len(_PLACES), words, settled)


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
