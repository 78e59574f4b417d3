"""Reader and fits of vendor_bench_tmotor_kde: makers' static bench tables, 11 to 40 in propellers.

Source: github.com/luis-i-reyes-castro/UAV_Powerplant, commit ba4cb79, MIT; the numbers are those
that T-Motor and KDE Direct publish, retyped. Columns used: brand, motor, file, D_in and pitch_in
[in], blades, test_V [V], rpm, thrust_g [gf]. Density and temperature are not stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.tables import csv_columns
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.thrust import ThrustFit, fit_thrust_curve

G0 = 9.80665  # m/s²

FOLDER = "vendor_bench_tmotor_kde"
FILE = "motor_prop_bench_tidy.csv"
PAPER = 2.011e-5  # N/rpm², propeller 36115 of Han et al. 2024, Table 7
LARGE = (36.0, 11.5, 2.0)  # diameter in, pitch in, blades
ODD_SHEET = 0.15  # of the coefficient: mistaken sheets stand out by more, propellers differ by less
#: sheet, rpm, gf -> why the row is left out
TYPOS = {
    ("T-motor_U10_KV80.xlsx", 149.0, 1471.0): "149 rpm between rows of over 1000",
    ("T-motor_U13_KV100.xlsx", 1967.0, 4794.0): "about 1690 rpm by the rows around it",
}
#: a sheet that repeats another, row by row: file, voltage
COPIES = {("T-motor_U13_KV100.xlsx", 40.0): "an identical copy of the 32 V sheet"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """One motor and propeller at one voltage."""

    brand: str
    motor: str
    file: str
    voltage: float
    size: tuple[float, float, float]  # diameter in, pitch in, blades
    speed_rpm: Floats  # (n,)
    thrust: Floats  # (n,) N


def read_sheets(folder: Path) -> tuple[list[Sheet], tuple[str, ...]]:
    """Sheets without the rows known to be wrong, and what was left out in words.

    Raises DataError when the table is missing or is not of this kind.
    """
    words, names = ("brand", "motor", "file"), ("D_in", "pitch_in", "blades", "test_V")
    table = csv_columns(folder / FILE, (*names, "rpm", "thrust_g"), words=words)
    cells = (table[name] for name in (*words, *names, "rpm", "thrust_g"))
    rows = list(zip(*cells, strict=True))
    left_out: list[str] = []
    sheets: dict[tuple, list[tuple[float, float]]] = {}
    for brand, motor, file, diameter, pitch, blades, voltage, rpm, grams in rows:
        if (file, voltage) in COPIES:
            left_out.append(f"{file}, {voltage:g} V: {COPIES[file, voltage]}")
        elif (file, rpm, grams) in TYPOS:
            left_out.append(f"{file}: {rpm:g} rpm at {grams:g} gf, {TYPOS[file, rpm, grams]}")
        else:
            key = (brand, motor, file, voltage, (diameter, pitch, blades))
            sheets.setdefault(key, []).append((rpm, grams * 1e-3 * G0))
    made = [
        Sheet(
            brand=str(brand),
            motor=str(motor),
            file=str(file),
            voltage=float(voltage),
            size=size,
            speed_rpm=np.array([r for r, _ in points]),
            thrust=np.array([t for _, t in points]),
        )
        for (brand, motor, file, voltage, size), points in sheets.items()
    ]
    return made, tuple(dict.fromkeys(left_out))


def fit_size(sheets: list[Sheet], size: tuple[float, float, float]) -> ThrustFit:
    """T = a N² through all sheets of one propeller size. Raises DataError when there is none."""
    mine = [s for s in sheets if s.size == size]
    if not mine:
        raise DataError(f"{FILE} has no {size[0]:g} x {size[1]:g} in propeller")
    return fit_thrust_curve(
        np.concatenate([s.speed_rpm for s in mine]), np.concatenate([s.thrust for s in mine])
    )


def spreads(sheets: list[Sheet]) -> Floats:
    """Standard deviation over mean of the coefficient among sheets of each size with several."""
    by_size: dict[tuple, list[float]] = {}
    for sheet in sheets:
        if np.unique(sheet.speed_rpm).size > 1:
            fit = fit_thrust_curve(sheet.speed_rpm, sheet.thrust)
            by_size.setdefault(sheet.size, []).append(fit.coefficient)
    several = [np.array(a) for a in by_size.values() if len(a) > 1]
    return np.array([a.std(ddof=1) / a.mean() for a in several])


def odd_sheets(sheets: list[Sheet]) -> tuple[str, ...]:
    """Sheets whose coefficient is far from those of the same propeller size on other sheets."""
    by_size: dict[tuple, list[tuple[Sheet, float]]] = {}
    for sheet in sheets:
        if np.unique(sheet.speed_rpm).size > 1:
            fit = fit_thrust_curve(sheet.speed_rpm, sheet.thrust)
            by_size.setdefault(sheet.size, []).append((sheet, fit.coefficient))
    return tuple(
        f"{s.file}, {s.size[0]:g} x {s.size[1]:g} in at {s.voltage:g} V: a is {a / usual:.2f} of "
        f"the median of {len(alike)} sheets of that propeller"
        for alike in by_size.values()
        if len(alike) > 2
        for usual in (float(np.median([b for _, b in alike])),)
        for s, a in alike
        if abs(a / usual - 1.0) > ODD_SHEET
    )


def find(folder: Path) -> Finding:
    """The 36 in propeller's thrust curve beside the paper's, and how much propellers differ."""
    sheets, left_out = read_sheets(folder)
    fit = fit_size(sheets, LARGE)
    spread = spreads(sheets)
    odd = odd_sheets(sheets)
    return Finding(
        name=FOLDER,
        title="Thrust curves of large propellers on makers' benches",
        numbers=(
            Number(
                *("coefficient_36x11.5", fit.coefficient, "N/rpm^2", 1.683e-5, "like"),
                label="a of the 36 x 11.5 in propeller",
            ),
            Number("r2_36x11.5", fit.r2, "1", 0.997, "like", label="its R²"),
            Number("points_36x11.5", fit.points),
            Number("rmse_36x11.5", fit.rmse, "N"),
            Number("ratio_to_paper", fit.coefficient / PAPER),
            Number("spread_of_one_size", float(np.median(spread))),
            Number("sizes_with_several_sheets", spread.size),
            Number("odd_sheets", len(odd)),
        ),
        notes=(
            *(f"left out: {words}" for words in left_out),
            *(f"odd: {words}" for words in odd),
            "air density is not stated",
        ),
    )
