"""What the screen shows of a flight, row by row: the arrays of an analysis in the view's frames.

Scene frame: ENU in metres from the track's origin (x east, y north, z up). Vehicle frame: forward,
left, up. A replay makes all rows at once, a live link one at a time, by the same function.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis

#: The rotation from NED to ENU, and the one from forward-left-up to forward-right-down.
ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FLU = np.diag([1.0, -1.0, -1.0])

NO_DATA, PREDICTED, MEASURED = 0, 1, 2
SOURCE_WORDS = ("no data", "predicted", "measured")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One moment on the screen. NaN where unknown; `source` says what each margin rests on."""

    time_s: float
    position_enu: Floats  # (3,) m
    wxyz: Floats  # (4,) rotation from the vehicle frame to the scene frame
    margin: Floats  # (R,) measured where there is a measurement, else predicted
    source: NDArray[np.int8]  # (R,) NO_DATA, PREDICTED or MEASURED
    margin_predicted: Floats  # (R,)
    rotor_speed_rpm: Floats  # (R,) measured
    predicted_rpm: Floats  # (R,)
    lower_rpm: Floats  # (R,)
    upper_rpm: Floats  # (R,)
    redundancy_yaw_free: float
    redundancy_yaw_kept: float
    tank_kg: float
    airspeed: float  # m/s
    height_agl: float  # m
    voltage: float  # V
    flying: bool

    @property
    def worst_rotor(self) -> int | None:
        """Index of the rotor with the least margin, from 0; None when no rotor has a number."""
        return int(np.nanargmin(self.margin)) if np.any(np.isfinite(self.margin)) else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """T rows of the screen for R rotors; each field as in Row with a leading axis T."""

    time_s: Floats
    position_enu: Floats
    wxyz: Floats
    margin: Floats
    source: NDArray[np.int8]
    margin_predicted: Floats
    rotor_speed_rpm: Floats
    predicted_rpm: Floats
    lower_rpm: Floats
    upper_rpm: Floats
    redundancy_yaw_free: Floats
    redundancy_yaw_kept: Floats
    tank_kg: Floats
    airspeed: Floats
    height_agl: Floats
    voltage: Floats
    flying: Bools

    @classmethod
    def of(cls, analysis: FlightAnalysis) -> Self:
        """Every row of `analysis`, as the screen needs it."""
        track, prediction = analysis.track, analysis.prediction
        measured = np.isfinite(analysis.margin)
        predicted = np.isfinite(analysis.margin_predicted)
        return cls(
            time_s=track.time_s,
            position_enu=enu(track.position_ned),
            wxyz=wxyz_from_attitude(track.attitude),
            margin=np.where(measured, analysis.margin, analysis.margin_predicted),
            source=np.where(measured, MEASURED, np.where(predicted, PREDICTED, NO_DATA)).astype(
                np.int8
            ),
            margin_predicted=analysis.margin_predicted,
            rotor_speed_rpm=track.rotor_speed_rpm,
            predicted_rpm=prediction.rotor_speed_rpm,
            lower_rpm=prediction.lower_rpm,
            upper_rpm=prediction.upper_rpm,
            redundancy_yaw_free=analysis.redundancy_yaw_free,
            redundancy_yaw_kept=analysis.redundancy_yaw_kept,
            tank_kg=track.tank_kg,
            airspeed=track.airspeed,
            height_agl=track.height_agl,
            voltage=track.voltage,
            flying=track.flying,
        )

    @property
    def count(self) -> int:
        return self.time_s.size

    def row(self, index: int) -> Row:
        """One row; negative indices count from the end."""
        return Row(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def index_at(self, time_s: float) -> int:
        """The last row at or before `time_s`; the first row for an earlier time."""
        return max(int(np.searchsorted(self.time_s, time_s, side="right")) - 1, 0)

    def between(self, start_s: float, end_s: float) -> slice:
        """Rows with start_s <= time <= end_s."""
        return slice(
            int(np.searchsorted(self.time_s, start_s, side="left")),
            int(np.searchsorted(self.time_s, end_s, side="right")),
        )


def ground_height(samples: Samples) -> float:
    """Height of the ground in the scene, m: median of up minus height above ground, else lowest."""
    up = samples.position_enu[:, 2]
    under = (up - samples.height_agl)[np.isfinite(up - samples.height_agl)]
    if under.size:
        return float(np.median(under))
    known = up[np.isfinite(up)]
    return float(known.min()) if known.size else 0.0


def enu(ned: Floats) -> Floats:
    """(..., 3) east, north, up of (..., 3) north, east, down."""
    return np.asarray(ned) @ ENU_NED.T


def wxyz_from_attitude(attitude: Floats) -> Floats:
    """(T, 4) quaternion, scene from vehicle frame, of (T, 3) roll, pitch, yaw in rad; NaN stays."""
    known = np.all(np.isfinite(attitude), axis=1)
    wxyz = np.full((attitude.shape[0], 4), np.nan)
    if np.any(known):
        ned_frd = Rotation.from_euler("ZYX", attitude[known][:, ::-1]).as_matrix()
        turned = Rotation.from_matrix(ENU_NED @ ned_frd @ FRD_FLU)
        wxyz[known] = turned.as_quat(canonical=True, scalar_first=True)
    return wxyz
