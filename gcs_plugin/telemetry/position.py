"""Where the vehicle was: off the ground or on it, and its place from which zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import known_rows, last_before, plausible
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.models.flight import Bools, Floats, Origin
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.provenance import Provenance

NAN = float("nan")

#: MAV_LANDED_STATE: in the air, taking off, landing.
IN_AIR, TAKING_OFF, LANDING = 2, 3, 4
#: m above the place of take-off or landing below which the legs may still touch
CLEAR = 0.2
#: share of the thrust in cruise below which a rotor only idles
IDLE_SHARE = 0.5


def airborne(
    signals: Signals, clock_s: Floats, channels: Mapping[str, Floats]
) -> tuple[Bools, str]:
    """(T,) True off the ground, and the evidence in words."""
    height = channels.get("height_agl")
    landed = best(signals, "landed")
    if landed is not None:
        known = np.isfinite(landed.values)
        when, state = landed.time_s[known], landed.values[known]
        last = np.searchsorted(when, clock_s, side="right") - 1
        off = np.isin(state, (IN_AIR, TAKING_OFF, LANDING))
        flying = np.where(last >= 0, off[np.maximum(last, 0)], False)
        if height is None:
            return flying, landed.source.words
        return _clear_of_ground(
            flying, height
        ), f"{landed.source.words}, and {CLEAR:g} m clear of it"
    speeds = channels.get("rotor_speed_rpm")
    thrust = _known_mean(np.square(speeds)) if speeds is not None else np.empty(0)
    words = "rotor speeds"
    if not np.isfinite(thrust).any():
        throttle = channels.get("throttle")
        thrust = _known_mean(throttle) if throttle is not None else np.empty(0)
        words = "motor outputs"
    if np.any(thrust > 0):
        cruise = float(np.nanpercentile(thrust, 75))
        with np.errstate(invalid="ignore"):
            flying = thrust > IDLE_SHARE * cruise if cruise > 0 else np.zeros(thrust.size, bool)
        return flying, f"{words} above {IDLE_SHARE:g} of the thrust in cruise (no landed state)"
    if height is not None and np.isfinite(height).any():
        with np.errstate(invalid="ignore"):
            return height > 1.0, "more than 1 m above home (no landed state, no rotor speeds)"
    return np.ones(clock_s.size, dtype=np.bool_), "unknown: every row counts as flying"


@dataclass(frozen=True, slots=True)
class GroundContact:
    """What is known of the last time on the ground, from which later rows go on."""

    on_ground: bool = False  # the vehicle has been heard on the ground
    height: float = NAN  # m, of the ground: the first height since it said that it flies
    clear: bool = False  # it has been CLEAR above that


def airborne_so_far(
    signals: Signals,
    clock_s: Floats,
    channels: Mapping[str, Floats],
    airframe: Airframe | None,
    contact: GroundContact,
) -> tuple[Bools, str, GroundContact]:
    """(T,) True off the ground by what is known up to each row, the evidence, and what is carried.

    As `airborne`, but that the last moments before a landing count as flying, that cruise is not
    known (half the empty weight counts), and that armed counts where no rotor is heard.
    """
    landed = best(signals, "landed")
    state = np.full(clock_s.size, NAN) if landed is None else last_before(landed, clock_s)
    armed = best(signals, "armed")
    motors_on = np.full(clock_s.size, NAN) if armed is None else last_before(armed, clock_s)
    speeds = channels["rotor_speed_rpm"]
    # Zero says nothing: most ESCs report it while they have not measured.
    carried = (np.abs(speeds) > 0.0).any(axis=1) & (airframe is not None)
    least = IDLE_SHARE * airframe.empty_mass * G0 if airframe is not None else 0.0
    coefficient = airframe.thrust_coefficient if airframe is not None else 0.0
    lifted = coefficient * np.nansum(np.square(speeds), axis=1) > least
    heights = channels.get("height_agl", np.full(clock_s.size, NAN))
    with np.errstate(invalid="ignore"):
        flying = np.where(np.isfinite(motors_on), motors_on > 0, heights > 1.0)
    flying = np.where(carried, lifted, flying)
    for row in np.flatnonzero(np.isfinite(state)).tolist():
        flying[row] = int(state[row]) in (IN_AIR, TAKING_OFF, LANDING)
        if not flying[row]:
            contact = GroundContact(on_ground=True)
        elif contact.on_ground and not contact.clear and np.isfinite(heights[row]):
            # First heard in the air, where the ground is cannot be known.
            ground = heights[row] if np.isnan(contact.height) else contact.height
            clear = bool(heights[row] > ground + CLEAR)
            contact = GroundContact(on_ground=True, height=float(ground), clear=clear)
            flying[row] = clear
        elif contact.on_ground and not contact.clear:
            flying[row] = np.isnan(contact.height)
    words = "rotor speeds, else armed" if landed is None else landed.source.words
    return flying.astype(np.bool_), words, contact


def _known_mean(values: Floats) -> Floats:
    """(T,) mean of the known columns of (T, R); NaN where none is."""
    known = np.isfinite(values)
    total = np.sum(values, axis=1, where=known)
    return np.divide(
        total, known.sum(axis=1), out=np.full(total.size, NAN), where=known.any(axis=1)
    )


def _clear_of_ground(flying: Bools, height: Floats) -> Bools:
    """Each stretch without its ends in which the height is still that of the ground."""
    result = flying.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flying.astype(np.int8), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        part = height[first:end]
        known = np.flatnonzero(np.isfinite(part))
        if known.size == 0:
            continue
        up = np.flatnonzero(part > part[known[0]] + CLEAR)
        if up.size == 0:
            continue
        result[first : first + up[0]] = False
        if end < flying.size:
            above = np.flatnonzero(part > part[known[-1]] + CLEAR)
            if above.size:
                result[first + above[-1] + 1 : end] = False
    return result


#: Where zero may be, preferred first.
_PLACES = (("home", "home"), ("ekf_origin", "the estimator's origin"))


@dataclass(frozen=True, slots=True)
class PlaceOfZero:
    """Where positions count from, how good that is (0: home), and whether it still may move."""

    origin: Origin
    rank: int
    whose: str  # home, the estimator's origin or the first fix, for people
    source: Provenance
    settled: bool  # by a take-off since


def position_sources(signals: Signals, zero: PlaceOfZero | None) -> tuple[Signal, ...]:
    """Sources of the position: latitude and longitude from zero, the local one."""
    sources = []
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
        source = fixes.source.remarked(f"from {zero.whose}")
        if zero.source is not fixes.source:
            source = source.remarked(f"by {zero.source.name}")
        sources.append(Signal("position_ned", source, fixes.time_s, np.stack(ned, axis=-1)))
    local = best(signals, "position_ned")
    if local is not None:
        sources.append(local)
    return tuple(sources)


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
                place = _as_origin(signal.values[row])
                return PlaceOfZero(place, rank, whose, signal.source, settled)
    if before is not None:
        return replace(before, settled=settled)
    good = np.empty(0) if fixes is None else np.flatnonzero(_on_earth(fixes.values))
    if fixes is None or good.size == 0:
        return None
    place, whose = _as_origin(fixes.values[good[0]]), "the first fix, for no home is reported"
    return PlaceOfZero(place, len(_PLACES), whose, fixes.source, settled)


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
