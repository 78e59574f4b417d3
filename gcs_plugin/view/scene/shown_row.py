"""One row of an analysis on the screen, the screen's frames, and the planned path in them.

Scene frame: ENU in metres from the track's origin (x east, y north, z up). Vehicle frame: forward,
left, up. Replay and live show a row by the same class, which holds no numbers of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from viser.transforms import SO3

from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording import palette, thrust_left
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.flight import Bools, FlightTrack, Floats, Origin
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL

if TYPE_CHECKING:
    from thrustmargin.mission.plan_items import PlanItem

PIXELS = 2000  # of a picture's longer side, by which legs of a plan are distinguished
#: The rotation from NED to ENU, and the one from forward-left-up to forward-right-down.
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FLU = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class ShownRow:
    """Row number `row` (negative: from the end) of an analysis of R rotors; NaN where unknown.

    `offset_ned` (3,) m is the track's origin from that of the scene. `least` is the share of thrust
    that must be left, and `low` (R,) flags rotors that had less and have not recovered since;
    without it the row alone decides.
    """

    analysis: FlightAnalysis
    row: int
    offset_ned: Floats | float = 0.0
    least: float = 0.5
    low: Bools | None = None

    @property
    def position_enu(self) -> Floats:
        """Return the position (3,) in the scene, m east, north and up."""
        return enu(self.analysis.track.position_ned[self.row] + self.offset_ned)

    @property
    def wxyz(self) -> Floats:
        """Return the quaternion (4,), w first, that turns the vehicle frame into the scene
        frame."""
        return wxyz_from_attitude(self.analysis.track.attitude[self.row])

    @property
    def flying(self) -> bool:
        return bool(self.analysis.track.flying[self.row])

    @property
    def measured(self) -> Bools:
        """Flag the rotors (R,) whose margin uses a measured speed, or one from motor outputs."""
        return np.isfinite(self.analysis.utilisation[self.row])

    @property
    def margin(self) -> Floats:
        """Return the thrust margin (R,) by the measured speed, else by the predicted one.

        On the ground it is the predicted one, because a rotor at rest has all its thrust left.
        """
        use = self.analysis.utilisation[self.row]
        return np.where(self.measured & self.flying, 1.0 - use, self.margin_predicted)

    @property
    def margin_predicted(self) -> Floats:
        """Return the thrust margin (R,), a share of 1, from the predicted rotor speeds; NaN where
        a rotor or motor is known to be bad."""
        return self.analysis.margin_predicted[self.row]

    @property
    def ends(self) -> tuple[Floats, Floats]:
        """Return the low and high ends (R,) of the 90 % interval of the known margin; NaN where
        unknown."""
        low, high = self.analysis.use_ends
        return 1.0 - high[self.row], 1.0 - low[self.row]

    def basis(self, rotor: int) -> str:
        """Return, in words, the source of a rotor's margin; empty where the margin is unknown."""
        if not self.flying:
            return words.PREDICTED if np.isfinite(self.margin_predicted[rotor]) else ""
        return self.analysis.basis_of(self.row, rotor)

    @property
    def worst(self) -> tuple[float, int | None]:
        """Return the least known margin, a share of 1, and its rotor from 0; NaN and None if
        none is known."""
        known = self.analysis.known_utilisation[[self.row]]
        use, rotor = worst_rotor(known)
        return 1.0 - float(use[0]), int(rotor[0]) if np.isfinite(rotor[0]) else None

    @property
    def unmeasured(self) -> int:
        """Return the number of rotors without a measurement, one of which may be worse.

        0 where none is measured.
        """
        return int(np.sum(~self.measured)) if self.measured.any() else 0

    @property
    def too_little(self) -> Bools:
        """Flag the rotors (R,) whose thrust left counts as too little, by the lower end of its
        interval."""
        if self.low is not None:
            return self.low
        return thrust_left.below(self._lower, self.least)

    @property
    def _lower(self) -> Floats:
        """Return the margin (R,) that decides the colour, a row of `lower_ends`."""
        low = self.ends[0] if self.flying else self.margin
        return np.where(np.isfinite(low), low, self.margin)

    @property
    def coloured(self) -> Floats:
        """Return the margin (R,) to colour each rotor by: its interval's lower end, with
        hysteresis.

        The hysteresis is that of `too_little`. NaN, no colour, where the margin is sufficient but
        not measured: blue would be a promise.
        """
        low, margin = self.too_little, self._lower
        sure = self.measured & self.flying
        return np.where(sure | low, thrust_left.value_of_colour(margin, self.least, low), np.nan)

    @property
    def scale(self) -> palette.ColourScale:
        """Return the colour scale of margins, which turns at `least`."""
        return palette.thrust_left(self.least)

    @property
    def calm(self) -> bool:
        """Return True if every rotor is measured and surely has enough thrust left."""
        return bool(
            self.surely_left + thrust_left.ROUNDING >= self.least and not self.too_little.any()
        )

    @property
    def surely_left(self) -> float:
        """Return the lower end of the worst rotor's margin, a share of 1; NaN where not all
        rotors are measured."""
        least, rotor = self.worst
        low = least if rotor is None else float(self.ends[0][rotor])
        return low if self.measured.all() else float("nan")

    @property
    def redundancy(self) -> tuple[float, float, float]:
        """Return the redundancy and the low and high ends of its 90 % interval; NaN where unknown.

        It is the thrust with one rotor lost, yaw uncontrolled, over the weight.
        """
        free = float(self.analysis.redundancy_yaw_uncontrolled[self.row])
        error = float(np.nan_to_num(self.analysis.redundancy_error[self.row]))
        low, high = np.exp(INTERVAL * np.array([-error, error - self.analysis.redundancy_beyond]))
        return free, free * float(low), free * float(high)

    @property
    def survives(self) -> bool:
        """Return True if the interval of redundancy allows the loss of one rotor, or is unknown."""
        return not self.redundancy[1] < 1.0

    @property
    def why_unknown(self) -> str:
        """Return the sentence on why there is no worst margin; empty if there is one."""
        if self.analysis.no_verdict:
            return statement_words(self.analysis.no_verdict[0])
        return words.NOTHING_KNOWN if self.worst[1] is None else ""


def lower_ends(analysis: FlightAnalysis) -> Floats:
    """Return the margin (T, R), a share of 1, that decides the colour of each rotor in each row.

    In flight it is the lower end of its 90 % interval, or the margin itself without an interval; on
    the ground it is the predicted margin. NaN where unknown.
    """
    predicted, high = analysis.utilisation_predicted, analysis.use_ends[1]
    known = np.where(np.isfinite(analysis.utilisation), analysis.utilisation, predicted)
    in_flight = np.where(np.isfinite(high), high, known)
    return 1.0 - np.where(analysis.track.flying[:, None], in_flight, predicted)


def ground_height(track: FlightTrack) -> float:
    """Return the height of the ground in the scene, m.

    It is the median of up minus height above ground, else the lowest position.
    """
    up = -track.position_ned[:, 2]
    under = (up - track.height_agl)[np.isfinite(up - track.height_agl)]
    if under.size:
        return float(np.median(under))
    known = up[np.isfinite(up)]
    return float(known.min()) if known.size else 0.0


def row_at(time_s: Floats, moment_s: float) -> int:
    """Return the index of the last row at or before `moment_s`, s; 0 before the first row."""
    return max(int(np.searchsorted(time_s, moment_s, side="right")) - 1, 0)


def enu(ned: Floats) -> Floats:
    """Return (..., 3) east, north, up of (..., 3) north, east, down."""
    return np.asarray(ned) @ ENU_NED.T


def wxyz_from_attitude(attitude: Floats) -> Floats:
    """Return the quaternion (4,) from vehicle frame to scene of roll, pitch, yaw in rad; NaN where
    unknown.
    """
    if not np.all(np.isfinite(attitude)):
        return np.full(4, np.nan)
    ned_frd = SO3.from_rpy_radians(*np.asarray(attitude, dtype=float)).as_matrix()
    return SO3.from_matrix(ENU_NED @ ned_frd @ FRD_FLU).wxyz.astype(np.float64)


#: MAV_FRAME in which altitude is above mean sea level; in the others it is above home or ground.
SEA_LEVEL_FRAMES = (0, 5)


def plan_enu(waypoints: Sequence[PlanItem], origin: Origin | None, ground: float) -> Floats:
    """Return the places of the mission's items (W, 3), m east, north, up from `origin`.

    `ground` is the height of the scene's ground, m, to which altitudes above home are added. Item 0
    (home in ArduPilot) and items without a place are left out. Empty (0, 3) without an origin.
    """
    placed = [(w.frame, *w.place) for w in waypoints if w.number > 0 and w.place is not None]
    frames, *places = np.array(placed or np.empty((0, 4))).T
    known = np.isfinite(places).all(axis=0)
    if origin is None or not known.any():
        return np.empty((0, 3))
    latitude, longitude, altitude = (values[known] for values in places)
    level = np.column_stack([latitude, longitude, np.full(altitude.size, origin.altitude)])
    north, east, _ = origin.ned(level).T
    above_sea = np.isin(frames[known], SEA_LEVEL_FRAMES)
    up = altitude + np.where(above_sea, -origin.altitude, ground)
    return np.column_stack([east, north, up])


def distinct_legs(points: Floats) -> Floats:
    """Return the legs (S, 2, 2) between successive `points` (W, 2), m, that a picture can show.

    A pixel is 1/PIXELS of the longer side. Of legs with both ends on the same two pixels the first
    is returned, and none within one pixel.
    """
    if len(points) < 2:
        return np.empty((0, 2, 2))
    pixel = max(float(np.max(np.ptp(points, axis=0))) / PIXELS, 1e-6)
    at = np.unique(np.round(points / pixel), axis=0, return_inverse=True)[1].ravel()
    ends = np.sort(np.column_stack([at[:-1], at[1:]]), axis=1)
    first = np.sort(np.unique(ends, axis=0, return_index=True)[1])
    legs = first[ends[first, 0] != ends[first, 1]]
    return np.stack([points[legs], points[legs + 1]], axis=1)
