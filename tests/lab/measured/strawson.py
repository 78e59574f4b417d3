"""Reader and fits of strawson_static_thrust: 5 in propellers, with runs that went wrong.

Source: github.com/StrawsonDesign/motor_propeller_testing, commit 7031418, MIT; RCbenchmark 1520,
13 motors x 8 propellers x 2 voltages. Columns used: rpm (electrical sensor), thrust_gf, file,
prop (its number). What is asked: does a coefficient survive wrong runs?
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.tables import csv_columns
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.modes import robust_scale
from thrustmargin.models.physics.thrust import fit_thrust_curve

G0 = 9.80665  # m/s²

FOLDER = "strawson_static_thrust"
FILE = "rcbenchmark1520_5in_tidy.csv"
HUBER = 1.345  # robust scales; 95 % as good as least squares where nothing is wrong (Huber 1964)
QUOTED = {7: 0.84, 8: 0.83}  # R² of least squares by propeller, by an independent check
WRONG_RUN = 0.2  # a run whose own coefficient is further than this from the propeller's median


@dataclass(frozen=True, slots=True, kw_only=True)
class PropellerFit:
    """One propeller over all its runs; coefficients in N/rpm²."""

    propeller: int
    points: int
    plain: float  # least squares
    r2: float  # of it
    robust: float  # Huber
    right: float  # least squares without the wrong runs
    right_r2: float
    wrong_runs: tuple[str, ...]
    turned_runs: tuple[str, ...]  # of them, those with thrust below 0: the sensor turned round


def fit_robust(speed_rpm: Floats, thrust: Floats) -> float:
    """a of T = a N², N/rpm², by Huber's M-estimate with the scale of its own residuals."""
    start = float(np.median(thrust / speed_rpm**2))
    scale = robust_scale(thrust - start * speed_rpm**2)

    def error(a: Floats) -> Floats:
        return thrust - a[0] * start * speed_rpm**2

    found = least_squares(error, [1.0], loss="huber", f_scale=max(HUBER * scale, 1e-12))
    return float(found.x[0]) * start


def fit_propellers(folder: Path) -> list[PropellerFit]:
    """Fits of every propeller. Raises DataError when the table is missing or of another kind."""
    table = csv_columns(folder / FILE, ("rpm", "thrust_gf", "prop"), words=("file",))
    speed, thrust = table["rpm"], table["thrust_gf"] * 1e-3 * G0
    files = table["file"].astype(str)
    fits = []
    for propeller in np.unique(table["prop"]):
        mine = table["prop"] == propeller
        runs = {
            file: fit_thrust_curve(speed[mine & (files == file)], thrust[mine & (files == file)])
            for file in np.unique(files[mine])
        }
        usual = float(np.median([run.coefficient for run in runs.values()]))
        wrong = tuple(
            file for file, run in runs.items() if abs(run.coefficient / usual - 1) > WRONG_RUN
        )
        right = mine & ~np.isin(files, wrong)
        plain = fit_thrust_curve(speed[mine], thrust[mine])
        clean = fit_thrust_curve(speed[right], thrust[right])
        fits.append(
            PropellerFit(
                propeller=int(propeller),
                points=plain.points,
                plain=plain.coefficient,
                r2=plain.r2,
                robust=fit_robust(speed[mine], thrust[mine]),
                right=clean.coefficient,
                right_r2=clean.r2,
                wrong_runs=wrong,
                turned_runs=tuple(file for file in wrong if runs[file].coefficient < 0.0),
            )
        )
    return fits


def find(folder: Path) -> Finding:
    """How far wrong runs pull a coefficient, plain and robust."""
    fits = fit_propellers(folder)
    plain = np.array([100 * abs(f.plain / f.right - 1) for f in fits])
    robust = np.array([100 * abs(f.robust / f.right - 1) for f in fits])
    return Finding(
        name=FOLDER,
        title="Wrong bench runs and a robust fit",
        numbers=(
            Number("wrong_runs", sum(len(f.wrong_runs) for f in fits)),
            Number("turned_runs", sum(len(f.turned_runs) for f in fits)),
            Number("worst_pull_plain", float(plain.max()), "%"),
            Number("worst_pull_robust", float(robust.max()), "%"),
            Number("median_pull_plain", float(np.median(plain)), "%"),
            Number("median_pull_robust", float(np.median(robust)), "%"),
            *(
                Number(f"r2_propeller_{f.propeller}", f.r2, "1", QUOTED.get(f.propeller), "like")
                for f in fits
            ),
        ),
        notes=tuple(
            f"propeller {f.propeller}: wrong runs {', '.join(f.wrong_runs)}"
            for f in fits
            if f.wrong_runs
        ),
    )
