"""Reader of imrc_crazyflie_rpm: flights of a 37 g quad with the measured speed of each rotor.

Source: github.com/IMRCLab/crazyflie-data-collection, commit 4d777a5, IMRC Lab, TU Berlin; no
licence is stated there, so the files stay where they are. One Parquet file holds the flights
without payload, one those with 4.7 g on a cable; rows are about 2 ms apart.

Columns used: flight; t_s; x_m y_m z_m, vx_mps vy_mps vz_mps (motion capture, x forward at yaw 0,
z up); qw qx qy qz (body to world, body forward-left-up); gx_dps gy_dps gz_dps; ax_g ay_g az_g
(specific force in g, forward-left-up); rpm1..4 (measured, rpm); pwm1..4 (0..65535); vbat_mV;
total_mass_g; payload_g.

With payload also pay_x_mm, pay_y_mm, pay_z_mm: the load, by motion capture.

A row of a FlightTrack is the mean over 0.2 s around its time, as rows at 10 Hz need it against
aliasing; but 50 such rows a second are kept, for the flights last 4 to 9 s. Rotor speed is averaged
as its square, which thrust goes with.

A flight with a fault that shows without any thrust model is read, but said to be faulty: a rotor
that reports a speed that cannot be its own, and a velocity that is not the change of position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from tests.lab.measured.tables import Columns, parquet_columns
from tests.made_sources import sent
from thrustmargin.models.flight import FlightTrack, Floats

G0 = 9.80665  # m/s²

FOLDER = "imrc_crazyflie_rpm"
FREE_FLIGHTS = "brushless_flights.parquet"
CABLE_FLIGHTS = "brushless_flights_payload.parquet"
ROTORS = 4
RATE = 50.0  # rows a second
MEAN_OVER = 0.2  # s: a mean that ends at half the rate of 10 rows a second, 5 Hz
LEAST_SHARE = 0.5  # of the samples that a row should have; a row with fewer is left out
WRONG_SENSOR = 0.75  # of the other rotors' speed: steady flight on four like rotors needs more
WRONG_VELOCITY = 0.4  # m/s, RMS, off the change of position; all other flights have 0.05 to 0.19
FULL_PWM = 65535.0
DELAYS = tuple(0.01 * k for k in range(9))  # s by which a motor may be behind its command

_SINGLE = (
    *("t_s", "x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps", "qw", "qx", "qy", "qz"),
    *("gx_dps", "gy_dps", "gz_dps", "ax_g", "ay_g", "az_g", "vbat_mV"),
    *("total_mass_g", "payload_g"),
)
_LOAD = ("pay_x_mm", "pay_y_mm", "pay_z_mm")
_ROTOR = tuple(f"{kind}{k + 1}" for kind in ("rpm", "pwm") for k in range(ROTORS))

SOURCES = MappingProxyType(
    {
        "position_ned": "motion capture; north is the room's x axis",
        "velocity_ned": "motion capture",
        "attitude": "on-board estimate",
        "angular_rate_frd": "gyro",
        "specific_force_frd": "accelerometer",
        "airspeed": "speed by motion capture: the air of the room is taken as still",
        "rotor_speed_rpm": "measured at each motor",
        "throttle": "motor command",
        "voltage": "battery",
        "height_agl": "motion capture",
        "tank_kg": "0 kg: the aircraft has no tank",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredFlight:
    """One flight: its track, what it weighed, and what the reader put aside."""

    track: FlightTrack
    mass: float  # kg with payload
    payload: float  # kg on the cable, 0 without
    faults: tuple[str, ...]  # why it is put aside, in words; empty for a good flight
    load_ned: Floats  # (T, 3) m from the aircraft to the load; NaN without one
    earlier_command: Floats  # (T, len(DELAYS)) mean command of the rotors, 0..1, that much earlier


def read_flights(folder: Path, file: str, *, mean_over: float = MEAN_OVER) -> list[MeasuredFlight]:
    """All flights of one of the two files in `folder`, in the file's order.

    `mean_over` in s is what a row is the mean of. Raises DataError when the file is missing or is
    not of this kind.
    """
    path = folder / file
    load = _LOAD if file == CABLE_FLIGHTS else ()
    columns = parquet_columns(path, (*_SINGLE, *_ROTOR, *load), words=("flight",))
    names = columns.pop("flight").astype(str)
    starts = np.flatnonzero(np.concatenate([[True], names[1:] != names[:-1]]))
    ends = np.append(starts[1:], names.size)
    return [
        _flight(str(names[i]), {k: v[i:j] for k, v in columns.items()}, mean_over)
        for i, j in zip(starts, ends, strict=True)
    ]


def _flight(name: str, columns: Columns, mean_over: float) -> MeasuredFlight:
    mass, payload = (float(np.median(columns[k])) * 1e-3 for k in ("total_mass_g", "payload_g"))
    speed = _stack(columns, "rpm")
    wrong = _wrong_sensors(speed)
    time_s = columns["t_s"]
    grid = np.arange(time_s[0] + mean_over / 2, time_s[-1] - mean_over / 2, 1.0 / RATE)
    average = _Average(time_s, grid, mean_over)

    def three(*keys: str) -> Floats:
        return average(np.stack([columns[k] for k in keys], axis=1))

    rotor_speed = np.sqrt(average(speed**2))
    rotor_speed[:, list(wrong)] = np.nan
    velocity = three("vx_mps", "vy_mps", "vz_mps") * [1, -1, -1]
    position = three("x_m", "y_m", "z_m") * [1, -1, -1]
    command = _stack(columns, "pwm") / FULL_PWM
    together = command.mean(axis=1, keepdims=True)
    faults = (*_speed_faults(wrong, speed), *_velocity_faults(average.time_s, position, velocity))
    track = FlightTrack.of(
        name=name,
        time_s=average.time_s - average.time_s[0],
        rotor_count=ROTORS,
        position_ned=position,
        velocity_ned=velocity,
        attitude=_attitude(three("qw", "qx", "qy", "qz")),
        angular_rate_frd=np.radians(three("gx_dps", "gy_dps", "gz_dps")) * [1, -1, -1],
        specific_force_frd=G0 * three("ax_g", "ay_g", "az_g") * [1, -1, -1],
        airspeed=np.linalg.norm(velocity, axis=1),
        wind_ned=np.zeros((average.time_s.size, 3)),
        tank_kg=np.zeros(average.time_s.size),
        rotor_speed_rpm=rotor_speed,
        throttle=average(command),
        voltage=average(columns["vbat_mV"][:, None])[:, 0] * 1e-3,
        height_agl=average(columns["z_m"][:, None])[:, 0],
        sources={channel: sent(words) for channel, words in SOURCES.items()},
        notes=faults,
    )
    load = np.full((average.time_s.size, 3), np.nan)
    if _LOAD[0] in columns:
        load = three(*_LOAD) * 1e-3 * [1, -1, -1] - track.position_ned
    return MeasuredFlight(
        track=track,
        mass=mass,
        payload=payload,
        faults=faults,
        load_ned=load,
        earlier_command=np.concatenate([average(together, delay) for delay in DELAYS], axis=1),
    )


def _wrong_sensors(speed: Floats) -> tuple[int, ...]:
    """Rotors whose median speed is far below or above that of the flight's rotors together.

    In payload flights eckart51 to 54 rotor 3 reports 0.55 of the others' speed all the way, which
    would be 0.3 of their thrust: the aircraft could not have held its attitude.
    """
    ratio = np.median(speed, axis=0) / np.median(speed)
    return tuple(
        int(k) for k in np.flatnonzero((ratio < WRONG_SENSOR) | (ratio > 1.0 / WRONG_SENSOR))
    )


def _velocity_faults(time_s: Floats, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """In flight eckart28 without payload the reported velocity lets go of the positions."""
    if time_s.size < 3:
        return ()
    gap = velocity - np.gradient(position, time_s, axis=0)
    off = float(np.sqrt(np.mean(np.sum(gap**2, axis=1))))
    if off <= WRONG_VELOCITY:
        return ()
    return (f"reported velocity is {off:.2f} m/s off the change of position: put aside",)


def _speed_faults(wrong: Sequence[int], speed: Floats) -> tuple[str, ...]:
    return tuple(
        f"rotor {k + 1} reports {np.median(speed[:, k]) / np.median(speed):.2f} of the rotors' "
        "usual speed: a wrong sensor, put aside"
        for k in wrong
    )


def _stack(columns: Columns, kind: str) -> Floats:
    return np.stack([columns[f"{kind}{k + 1}"] for k in range(ROTORS)], axis=1)


def _attitude(quaternion: Floats) -> Floats:
    """Roll, pitch, yaw (T, 3) rad against NED from body-to-world (w, x, y, z), both z up.

    Turning both frames about their x axis by half a turn makes forward-left-up forward-right-down
    and leaves w and x, while y and z change sign.
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True) * [1, 1, -1, -1]).T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


class _Average:
    """Means over a span around each time of a grid; `time_s` are the times that have enough."""

    def __init__(self, time_s: Floats, grid: Floats, span: float) -> None:
        first = np.searchsorted(time_s, grid - span / 2)
        last = np.searchsorted(time_s, grid + span / 2)
        usual = span / float(np.median(np.diff(time_s)))
        enough = last - first >= LEAST_SHARE * usual
        self.time_s = grid[enough]
        self._samples, self._half = time_s, span / 2

    def __call__(self, values: Floats, earlier: float = 0.0) -> Floats:
        """Means (T, C) of samples (n, C) taken `earlier` s before; NaN where there are none."""
        first = np.searchsorted(self._samples, self.time_s - earlier - self._half)
        last = np.searchsorted(self._samples, self.time_s - earlier + self._half)
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        with np.errstate(invalid="ignore"):
            return (total[last] - total[first]) / (last - first)[:, None]
