"""Find the times of a flight at which a rotor worked hardest, and what the aircraft did then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.physics.smoothing import known_mean

#: Peaks closer than this are one peak, s: about the length of a turn at a line end.
APART_S = 6.0
MOST_PEAKS = 8

#: From these on a movement is named. Turn: a quarter turn in under 9 s. Speed: walking pace.
TURN_RATE = np.radians(10.0)  # rad/s
CLIMB_RATE = 0.5  # m/s
SPEED_CHANGE = 0.5  # m/s²
HOVER_SPEED = 0.5  # m/s
BANK = np.radians(15.0)  # rad
#: The movement is measured over this time around the moment, s: shorter is sensor noise.
AROUND_S = 1.0
TAKE_OFF_S = 5.0


@dataclass(frozen=True, slots=True)
class Activity:
    """One thing that the aircraft was doing at a time."""

    kind: str  # in English, such as "braking"
    tilt_deg: float = math.nan  # of "tilted"


@dataclass(frozen=True, slots=True, kw_only=True)
class UtilisationPeak:
    """A local maximum of the worst rotor's thrust utilisation; NaN for what is unknown."""

    time_s: float  # from the first row
    rotor: int  # from 0
    rotor_name: str
    utilisation: float
    utilisation_low: float  # ends of its 90 % interval: the same where nothing was inferred
    utilisation_high: float
    basis: str  # a SpeedBasis
    activities: tuple[Activity, ...]
    tank_kg: float
    ground_speed: float
    airspeed: float
    climb_rate: float
    height_agl: float
    north: float
    east: float
    latitude_deg: float
    longitude_deg: float
    redundancy_yaw_uncontrolled: float

    @property
    def margin(self) -> float:
        """Return the thrust margin of the rotor, 1 - utilisation."""
        return 1.0 - self.utilisation


def airborne_use(analysis: FlightAnalysis) -> Floats:
    """Return the known thrust utilisation (T, R), a share of 1; NaN on the ground."""
    return np.where(analysis.track.flying[:, None], analysis.known_utilisation, np.nan)


def utilisation_peaks(analysis: FlightAnalysis) -> tuple[UtilisationPeak, ...]:
    """Return the up to MOST_PEAKS highest peaks of thrust utilisation, worst first.

    They are APART_S s or more apart. When rotors peak together the peak is listed once, with its
    worst rotor. Left out are values whose interval includes 0. Empty where no utilisation is known.
    """
    use = airborne_use(analysis)
    # One that may as well be none says nothing.
    use = np.where(analysis.use_ends[0] > 0.0, use, np.nan)
    left, _ = worst_rotor(use)
    time_s = analysis.track.time_s
    found = []
    while len(found) < MOST_PEAKS and np.any(np.isfinite(left)):
        row = int(np.nanargmax(left))
        found.append(_peak(analysis, use, row))
        left[np.abs(time_s - time_s[row]) < APART_S] = np.nan
    return tuple(found)


def _peak(analysis: FlightAnalysis, use: Floats, row: int) -> UtilisationPeak:
    """Return the peak at a row, of its most used rotor; `use` (T, R) is the utilisation in flight.

    Values are NaN where unknown; so is a load of 0 kg of an aircraft without a tank, since it may
    carry a payload.
    """
    track = analysis.track
    tankless = not analysis.model.airframe.tank_volume_l
    rotor = int(np.nanargmax(use[row]))
    low, high = (float(end[row, rotor]) for end in analysis.use_ends)
    north, east, down = (float(x) for x in track.position_ned[row])
    latitude = longitude = float("nan")
    if track.origin is not None and np.isfinite(north) and np.isfinite(east):
        place = np.array([north, east, np.nan_to_num(down)])
        latitude, longitude, _ = track.origin.geodetic(place).tolist()
    return UtilisationPeak(
        time_s=float(track.time_s[row]),
        rotor=rotor,
        rotor_name=analysis.places[rotor],
        utilisation=float(use[row, rotor]),
        utilisation_low=low,
        utilisation_high=high,
        basis=analysis.basis_of(row, rotor),
        activities=activities(track, row),
        # An aircraft without a tank carries no 0 kg of liquid, but may carry a payload.
        tank_kg=float(track.tank_kg[row] or np.nan) if tankless else float(track.tank_kg[row]),
        ground_speed=float(np.hypot(*track.velocity_ned[row, :2])),
        airspeed=float(track.airspeed[row]),
        climb_rate=-float(track.velocity_ned[row, 2]),
        height_agl=float(track.height_agl[row]),
        north=north,
        east=east,
        latitude_deg=latitude,
        longitude_deg=longitude,
        redundancy_yaw_uncontrolled=float(analysis.redundancy_yaw_uncontrolled[row]),
    )


def activities(track: FlightTrack, row: int) -> tuple[Activity, ...]:
    """List the vehicle's activities in the AROUND_S s around a row, as far as the log has channels
    for them.

    "hovering" only if speed is steady and low, and neither at take-off nor landing; "flying, not
    spraying" only if nothing else applies. Only "tilted" has an amount, degrees; others have NaN.
    """
    time_s = track.time_s
    near = np.abs(time_s - time_s[row]) <= AROUND_S / 2
    words = []
    flying = np.flatnonzero(track.flying)
    if flying.size and time_s[row] - time_s[flying[0]] < TAKE_OFF_S:
        words.append("taking off")
    elif (
        flying.size
        and time_s[flying[-1]] - time_s[row] < TAKE_OFF_S
        and flying[-1] + 1 < (time_s.size)
    ):
        words.append("landing")
    yaw_rate = known_mean(track.angular_rate_frd[near, 2])
    if abs(yaw_rate) > TURN_RATE:
        words.append(f"turning {'right' if yaw_rate > 0 else 'left'}")
    climb = -known_mean(track.velocity_ned[near, 2])
    if abs(climb) > CLIMB_RATE:
        words.append("climbing" if climb > 0 else "descending")
    speed = np.hypot(track.velocity_ned[near, 0], track.velocity_ned[near, 1])
    at, known = time_s[near] - time_s[near][0], np.isfinite(speed)
    change = np.polyfit(at[known], speed[known], 1)[0] if known.sum() > 2 else np.nan
    if abs(change) > SPEED_CHANGE:
        words.append("speeding up" if change > 0 else "braking")
    elif known_mean(speed) < HOVER_SPEED and "taking off" not in words and "landing" not in words:
        words.append("hovering")
    roll, pitch = known_mean(track.attitude[near, 0]), known_mean(track.attitude[near, 1])
    tilt = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))
    if tilt > BANK:
        words.append("tilted")
    spraying = track.spraying[row]
    if spraying > 0.5:
        words.append("spraying")
    elif np.isfinite(spraying) and not words:
        words.append("flying, not spraying")
    tilts = {"tilted": float(np.degrees(tilt))}
    return tuple(Activity(kind, tilts.get(kind, math.nan)) for kind in words)
