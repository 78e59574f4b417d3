"""Reader and fits of aerostack2_thrust_vs_voltage: thrust at a command while the pack runs down.

Source: github.com/aerostack2/thrust_map_estimation, commit cd178f6, no licence stated there. Bench
of RCbenchmark; columns used: ESC signal [us], Thrust [N] (printed with a NEGATIVE sign), Voltage
[V]. The file of the single rotor is separated by semicolons.

At full command the speed of a motor goes with (voltage)^p, thrust with its square; the same holds
at any command, so the fall of thrust with voltage at a command is the airframe file's
`ceiling_voltage_exponent`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from tests.lab.measured.findings import Finding, Number, rmse
from tests.lab.measured.tables import csv_columns
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, Floats

FOLDER = "aerostack2_thrust_vs_voltage"
#: file -> delimiter, what it is
FILES = {
    "xNova-TM-SR.csv": (";", "one rotor alone"),
    "xNova-TM-MR.csv": (",", "four rotors on the airframe"),
}
COLUMNS = ("ESC signal (µs)", "Thrust (N)", "Voltage (V)")
LEAST_THRUST = 0.5  # N: below, the rotor stands or idles
IDLE_US, SPAN_US = 1000.0, 1000.0
FOLDS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustMap:
    """Rows of one file with the rotor turning, in order of time."""

    command: Floats  # (n,) 0 at 1000 us, 1 at 2000 us
    thrust: Floats  # (n,) N, positive
    voltage: Floats  # (n,) V


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageFit:
    """Thrust at a command without and with the voltage."""

    rmse_command: float  # N, rows left out, thrust from the command alone
    rmse_voltage: float  # N, likewise with voltage
    exponent: float  # of rotor speed with voltage, half that of thrust
    rows: int


def read_map(folder: Path, file: str) -> ThrustMap:
    """One file. Raises DataError when it is missing, of another kind, or holds no thrust."""
    table = csv_columns(folder / file, COLUMNS, delimiter=FILES[file][0])
    command, thrust, voltage = (table[name] for name in COLUMNS)
    turning = -thrust > LEAST_THRUST
    if np.sum(turning) < 10 * FOLDS:
        raise DataError(
            f"{file} has {np.sum(turning)} rows with a negative thrust, as it prints it"
        )
    return ThrustMap(
        command=(command[turning] - IDLE_US) / SPAN_US,
        thrust=-thrust[turning],
        voltage=voltage[turning],
    )


def fit_voltage(data: ThrustMap, *, seed: int = 0) -> VoltageFit:
    """T = (b0 + b1 u + b2 u²) (V/V0)^(2p) against the same with p = 0, on rows left out.

    Rows are left out at random, in tenths: each command is held at several voltages, so a stretch
    of time left out would ask about commands and voltages that were never seen together.
    """
    fold = np.random.default_rng(seed).integers(FOLDS, size=data.thrust.size)
    left = np.zeros((2, data.thrust.size))
    for k in range(FOLDS):
        test = fold == k
        for row, with_voltage in enumerate((False, True)):
            found = _fit(data, ~test, with_voltage)
            left[row, test] = (data.thrust - _thrust(data, found))[test]
    exponent = _fit(data, np.ones(data.thrust.size, dtype=np.bool_), True)[3] / 2.0
    return VoltageFit(
        rmse_command=rmse(left[0]),
        rmse_voltage=rmse(left[1]),
        exponent=float(exponent),
        rows=data.thrust.size,
    )


def _fit(data: ThrustMap, rows: Bools, with_voltage: bool) -> Floats:
    def error(b: Floats) -> Floats:
        return (data.thrust - _thrust(data, b if with_voltage else np.append(b, 0.0)))[rows]

    found = least_squares(error, np.ones(3 + with_voltage)).x
    return found if with_voltage else np.append(found, 0.0)


def _thrust(data: ThrustMap, b: Floats) -> Floats:
    u, ratio = data.command, data.voltage / np.median(data.voltage)
    return (b[0] + b[1] * u + b[2] * u**2) * ratio ** b[3]


def find(folder: Path) -> Finding:
    """How thrust at a command falls with the voltage of the battery."""
    single, several = (fit_voltage(read_map(folder, file)) for file in FILES)
    by = "thrust by command"
    return Finding(
        name=FOLDER,
        title="Thrust against the voltage of the battery at one command",
        numbers=(
            Number("rmse_by_command", single.rmse_command, "N", 0.330, label=by),
            Number(
                *("rmse_by_command_and_voltage", single.rmse_voltage, "N", 0.272, "at most"),
                label=f"{by} and voltage",
            ),
            Number("speed_exponent", single.exponent),
            Number("speed_exponent_on_airframe", several.exponent),
        ),
        notes=("thrust is printed with a negative sign; it is turned round here",),
    )
