"""Reader and fits of uiuc_propeller_db: thrust in axial flow, the form of `climb_inflow`.

Source: github.com/Piotrek2133/Drone-Propellers-Optimizer, commit efcecfd (no licence stated
there), a copy of the UIUC Propeller Database (Brandt, Deters, Ananda, Dantsker, Selig). Columns
used: PropName, D and P (diameter and pitch) [in], J = V/(n D), N [rpm], CT.

A climb at 3 m/s of a 36 in propeller at 2100 rpm is J = 0.09, so the curve near J = 0 is what
counts: kappa = C_T(J)/C_T(0) = 1 - k J below J_SMALL, and 1 - k J - k2 J² over all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.tables import csv_columns
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats

FOLDER = "uiuc_propeller_db"
FILES = ("volume1_exp.csv", "volume2_exp.csv", "volume3_exp.csv")
J_SMALL = 0.3
FEWEST, FOLDS = 20, 5
LEAST_SHARE = 0.15  # of C_T(0): rows beyond are near the windmill and not flown
PITCH_RATIOS = (0.2, 1.6)  # a pitch outside these is a slip of the table
NEAR = 0.15  # of a pitch ratio: propellers this close are taken as alike
F16, SMALL = "the F16's 36 x 11.5", "the 37 g quad's 55-35"
PITCHES = {F16: 11.5 / 36.0, SMALL: 35.0 / 55.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propeller:
    """Wind tunnel points of one propeller, static ones included."""

    name: str
    pitch_ratio: float  # pitch over diameter
    advance_ratio: Floats  # (n,)
    thrust_coefficient: Floats  # (n,)


@dataclass(frozen=True, slots=True, kw_only=True)
class InflowFit:
    """How C_T goes with J on one propeller; errors are on points left out, over C_T(0)."""

    name: str
    pitch_ratio: float
    slope: float  # k of 1 - k J below J_SMALL
    rmse_constant: float
    rmse_linear: float
    rmse_quadratic: float


def read_propellers(folder: Path) -> list[Propeller]:
    """All propellers of the three volumes. Raises DataError when a file is missing or odd."""
    names, words = ("D", "P", "J", "CT"), ("PropName",)
    tables = [csv_columns(folder / file, names, words=words) for file in FILES]
    table = {name: np.concatenate([t[name] for t in tables]) for name in (*names, *words)}
    order = np.argsort(table["PropName"].astype(str), kind="stable")
    table = {name: values[order] for name, values in table.items()}
    labels = table["PropName"].astype(str)
    starts = np.flatnonzero(np.concatenate([[True], labels[1:] != labels[:-1]]))
    return [
        Propeller(
            name=str(labels[i]),
            pitch_ratio=float(table["P"][i] / table["D"][i]),
            advance_ratio=table["J"][i:j],
            thrust_coefficient=table["CT"][i:j],
        )
        for i, j in zip(starts, np.append(starts[1:], labels.size), strict=True)
    ]


def fit_inflow(propeller: Propeller) -> InflowFit | None:
    """Constant, linear and quadratic C_T in J; None with too few points in flow."""
    j, ct = propeller.advance_ratio, propeller.thrust_coefficient
    good = np.isfinite(j) & np.isfinite(ct) & (j >= 0.0)
    j, ct = j[good], ct[good]
    near = j < J_SMALL
    if np.sum(near) < FEWEST // 2 or np.ptp(j[near]) < J_SMALL / 3:
        return None
    line = np.polynomial.polynomial.polyfit(j[near], ct[near], 1)
    used = ct > LEAST_SHARE * line[0]
    if line[0] <= 0.0 or np.sum(used) < FEWEST:
        return None
    errors = [_left_out(j[used], ct[used], degree) / line[0] for degree in (0, 1, 2)]
    return InflowFit(
        name=propeller.name,
        pitch_ratio=propeller.pitch_ratio,
        slope=float(-line[1] / line[0]),
        rmse_constant=errors[0],
        rmse_linear=errors[1],
        rmse_quadratic=errors[2],
    )


def _left_out(j: Floats, ct: Floats, degree: int) -> float:
    """RMSE of a polynomial on every fifth point, fitted without it, in order of J."""
    order = np.argsort(j, kind="stable")
    fold = np.empty(j.size, dtype=np.intp)
    fold[order] = np.arange(j.size) % FOLDS
    left = np.zeros(j.size)
    for k in range(FOLDS):
        test = fold == k
        curve = np.polynomial.Polynomial.fit(j[~test], ct[~test], degree)
        left[test] = ct[test] - curve(j[test])
    return float(np.sqrt(np.mean(left**2)))


def slope_near(fits: list[InflowFit], pitch_ratio: float) -> tuple[float, float, float, int]:
    """Median, 10 % and 90 % quantile of the slope of propellers of about this pitch; how many."""
    slopes = [f.slope for f in fits if abs(f.pitch_ratio / pitch_ratio - 1.0) < NEAR]
    if not slopes:
        return float("nan"), float("nan"), float("nan"), 0
    low, middle, high = np.quantile(slopes, [0.1, 0.5, 0.9])
    return float(middle), float(low), float(high), len(slopes)


def find(folder: Path) -> Finding:
    """How thrust falls with axial inflow, and with which slope for which pitch."""
    propellers = read_propellers(folder)
    low_pitch, high_pitch = PITCH_RATIOS
    usual = [p for p in propellers if low_pitch <= p.pitch_ratio <= high_pitch]
    fits = [f for f in map(fit_inflow, usual) if f is not None and f.slope > 0.0]
    if len(fits) < 3:
        raise DataError(f"{folder}: only {len(fits)} propellers with thrust in axial flow")
    slopes = np.array([f.slope for f in fits])
    middle = [
        float(np.median([getattr(f, f"rmse_{form}") for f in fits]))
        for form in ("constant", "linear", "quadratic")
    ]
    alike = {name: slope_near(fits, ratio) for name, ratio in PITCHES.items()}
    low, high = np.quantile(slopes, [0.1, 0.9])
    return Finding(
        name=FOLDER,
        title="Thrust in axial flow: the form of climb_inflow",
        numbers=(
            Number("propellers", len(fits)),
            Number("rmse_constant", middle[0]),
            Number("rmse_linear", middle[1]),
            Number("rmse_quadratic", middle[2]),
            Number("slope_median", float(np.median(slopes))),
            Number("slope_low", float(low)),
            Number("slope_high", float(high)),
            Number("slope_for_f16_pitch", alike[F16][0]),
            Number("slope_for_55_35", alike[SMALL][0]),
        ),
        notes=(
            f"left out: {len(propellers) - len(usual)} of {len(propellers)} propellers whose pitch "
            f"over diameter is not in {low_pitch:g} to {high_pitch:g}, and "
            f"{len(usual) - len(fits)} with too few points below J = {J_SMALL:g}",
        ),
    )
