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

from tests.measured.findings import Finding, Number
from tests.measured.plots import bar_figure
from tests.measured.tables import csv_columns
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.modes import robust_scale
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.thrust import fit_thrust_curve

FOLDER = "strawson_static_thrust"
FILE = "rcbenchmark1520_5in_tidy.csv"
SOURCE = "github.com/StrawsonDesign/motor_propeller_testing (MIT), RCbenchmark 1520"
HUBER = 1.345  # robust scales; 95 % as good as least squares where nothing is wrong (Huber 1964)
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
    hurt = [f for f in fits if f.wrong_runs]
    lost = sum(len(f.wrong_runs) for f in fits)
    turned = sum(len(f.turned_runs) for f in fits)
    worst = max(fits, key=lambda f: abs(f.plain / f.right - 1))
    figure = bar_figure(
        groups=[("least squares", plain.tolist()), ("robust (Huber)", robust.tolist())],
        labels=[f"propeller {f.propeller}" for f in fits],
        y_title="off the coefficient of good runs, %",
    )
    return Finding(
        name=FOLDER,
        title="Wrong bench runs and a robust fit",
        source=SOURCE,
        answer=(
            f"{lost} of the runs, on {len(hurt)} of {len(fits)} propellers, have a coefficient "
            f"more than {100 * WRONG_RUN:.0f} % off their propeller's median (with thrust below 0, "
            f"so a sensor turned round: {turned}).",
            f"They pull least squares by up to {plain.max():.1f} % (propeller {worst.propeller}, "
            f"R² {worst.r2:.2f} against {worst.right_r2:.3f} of the good runs), a robust fit by "
            f"up to {robust.max():.1f} %.",
        ),
        numbers=(
            Number(name="wrong_runs", value=lost),
            Number(name="turned_runs", value=turned),
            Number(name="worst_pull_plain", value=float(plain.max()), unit="%"),
            Number(name="worst_pull_robust", value=float(robust.max()), unit="%"),
            Number(name="median_pull_plain", value=float(np.median(plain)), unit="%"),
            Number(name="median_pull_robust", value=float(np.median(robust)), unit="%"),
            *(
                Number(
                    name=f"r2_propeller_{f.propeller}",
                    label=f"R² of least squares, propeller {f.propeller}",
                    aim="like",
                    value=f.r2,
                    quoted={7: 0.84, 8: 0.83}.get(f.propeller),
                    quoted_from="independent check" if f.propeller in (7, 8) else "",
                )
                for f in fits
            ),
        ),
        notes=tuple(f"propeller {f.propeller}: wrong runs {', '.join(f.wrong_runs)}" for f in hurt),
        figures={"pull of wrong runs on the coefficient": figure},
    )
