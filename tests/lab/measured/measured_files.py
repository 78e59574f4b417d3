"""Small files in the formats of the measured data sets, made up from known laws."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

G0 = 9.80665  # m/s²


GRAM = 1e-3 * G0  # N a gf


def write_csv(path: Path, columns: Mapping[str, Sequence], *, delimiter: str = ",") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def vendor_rows(a: float = 1.7e-5) -> dict[str, list]:
    """A U13 with 36 x 11.5 in that follows T = a N² exactly, and three sheets of a smaller size,
    of which the last makes 1.5 times the thrust of the others."""
    rows: list[tuple] = [
        ("T-motor", "U13", "U13.xlsx", 36.0, 11.5, 2, 48.0, n, a * n**2 / GRAM)
        for n in (1000.0, 1500.0, 2000.0, 2500.0)
    ]
    for name, times in (("A", 1.0), ("B", 1.0), ("C", 1.5)):
        rows += [
            ("KDE", name, f"{name}.xlsx", 20.0, 6.0, 2, 24.0, n, times * 1e-6 * n**2 / GRAM)
            for n in (3000.0, 4000.0)
        ]
    names = ("brand", "motor", "file", "D_in", "pitch_in", "blades", "test_V", "rpm", "thrust_g")
    return {name: list(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}


def strawson_rows(a: float = 2e-8) -> dict[str, list]:
    """Five runs of one propeller by T = a N²; in the last the sensor was turned round."""
    speed = np.linspace(5000.0, 20000.0, 12)
    rows = [
        (n, (-1.0 if run == 4 else 1.0) * a * n**2 / GRAM, f"run{run}.csv", 1)
        for run in range(5)
        for n in speed
    ]
    names = ("rpm", "thrust_gf", "file", "prop")
    return {name: list(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}


def aerostack_rows(exponent: float = 1.0, *, sign: float = -1.0, seed: int = 0) -> dict[str, list]:
    """Thrust that goes with voltage to twice `exponent`, printed negative as that bench does."""
    generator = np.random.default_rng(seed)
    command = generator.uniform(1200.0, 2000.0, 400)
    voltage = generator.uniform(20.0, 25.0, 400)
    thrust = (1.0 + 8.0 * ((command - 1000.0) / 1000.0) ** 2) * (voltage / 22.5) ** (2 * exponent)
    return {
        "ESC signal (µs)": command.tolist(),
        "Thrust (N)": (sign * thrust).tolist(),
        "Voltage (V)": voltage.tolist(),
    }


def crazypad_rows() -> dict[str, list]:
    """A share of motor 3 that rises in a straight line as its blades get shorter."""
    lengths = (47.0, 46.0, 45.0, 44.0, 43.0, 42.0)
    names = ["normal_flight", *(f"cut_propeller_M3_{47 - mm:g}mm_{mm:g}mm" for mm in lengths[1:])]
    other = 30000.0
    share = [0.25 + 0.01 * (47.0 - mm) for mm in lengths]
    third = [3.0 * other * s / (1.0 - s) for s in share]
    same = [other] * len(lengths)
    commands = {
        f"{kind}.m{k}": (third if k == 3 else same)
        for kind in ("pwm", "motor")
        for k in range(1, 5)
    }
    return {"cond": names, "craft": ["E8"] * len(lengths), **commands}


def uiuc_rows(slope: float, volume: int) -> dict[str, list]:
    """Four propellers with C_T = 0.1 (1 - slope J); their names hold the volume."""
    advance = np.linspace(0.0, 0.6, 40)
    rows = [
        (f"p{volume}{k}", 10.0, 5.0 + k, j, 0.1 * (1.0 - slope * j))
        for k in range(4)
        for j in advance
    ]
    names = ("PropName", "D", "P", "J", "CT")
    return {name: list(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}


def flight_columns(
    name: str,
    *,
    seed: int = 0,
    inflow: float = 0.0,
    lift: float = 0.0,
    delay: float = 0.0,
    seconds: float = 5.0,
    velocity_gain: float = 1.0,
    coefficient: float = 4e-10,
    mass_g: float = 37.0,
) -> dict[str, np.ndarray]:
    """A level flight of the 37 g quad, 500 Hz: hover, then climbs and fast runs.

    Its rotors' thrust is a N² (1 - inflow J + lift V²) and their speed is quadratic in the command
    `delay` s before, times a line in the voltage. `velocity_gain` scales what velocity is reported.
    """
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.002)
    rate, phase = generator.uniform(2.0, 3.0, 2), generator.uniform(0.0, 6.0, 2)
    voltage = 3.9 - 0.05 * t / seconds - 0.05 * generator.uniform()

    def ramp(at: np.ndarray) -> np.ndarray:
        """0 in the hover of 1.2 s at either end, 1 between."""
        return np.clip(np.minimum(at - 1.2, seconds - 1.2 - at) / 0.5, 0.0, 1.0)

    def state(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed along x and upwards, m/s."""
        on = ramp(at)
        return (
            2.2 * on * np.sin(rate[0] * at + phase[0]),
            0.8 * on * np.sin(rate[1] * at + phase[1]),
        )

    def speed(at: np.ndarray) -> np.ndarray:
        along, up = state(at)
        felt = 1.0 + 0.1 * ramp(at) * np.sin(5.0 * at)
        thrust = felt * mass_g * GRAM
        rpm = np.sqrt(thrust / 4 / coefficient)
        for _ in range(4):
            kappa = 1.0 - inflow * up * 60.0 / (rpm * 0.055) + lift * along**2
            rpm = np.sqrt(thrust / 4 / coefficient / kappa)
        return rpm

    along, up = state(t)
    rpm = speed(t)
    later = speed(t + delay) / (1.0 + 0.2 * (voltage - 3.85))
    command = (-4.0 + np.sqrt(16.0 + 4.0 * later / 1000.0)) / 2.0  # rpm = 1000 (4 u + u²)
    zero, one = np.zeros_like(t), np.ones_like(t)
    columns = {
        "flight": np.full(t.size, name, dtype=object),
        "t_s": t + 3.0,
        "x_m": np.cumsum(along) * 0.002,
        "y_m": zero,
        "z_m": 2.0 + np.cumsum(up) * 0.002,
        "vx_mps": velocity_gain * along,
        "vy_mps": zero,
        "vz_mps": velocity_gain * up,
        **{"qw": one, "qx": zero, "qy": zero, "qz": zero},
        **{"gx_dps": zero, "gy_dps": zero, "gz_dps": 10.0 * one},
        **{"ax_g": zero, "ay_g": zero, "az_g": 1.0 + 0.1 * ramp(t) * np.sin(5.0 * t)},
        "vbat_mV": 1e3 * voltage,
        "total_mass_g": mass_g * one,
        "payload_g": zero,
    }
    for k in range(1, 5):
        columns[f"rpm{k}"] = rpm
        columns[f"pwm{k}"] = 65535.0 * command / 10.0
    return columns


def write_flights(path: Path, flights: Sequence[Mapping[str, np.ndarray]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    tables = [pa.table({k: pa.array(v) for k, v in flight.items()}) for flight in flights]
    pyarrow.parquet.write_table(pa.concat_tables(tables), path)


def write_benches(folder: Path) -> None:
    """Every data set but the flights and the PX4 log."""
    write_csv(folder / "vendor_bench_tmotor_kde/motor_prop_bench_tidy.csv", vendor_rows())
    write_csv(folder / "strawson_static_thrust/rcbenchmark1520_5in_tidy.csv", strawson_rows())
    aerostack = folder / "aerostack2_thrust_vs_voltage"
    write_csv(aerostack / "xNova-TM-SR.csv", aerostack_rows(), delimiter=";")
    write_csv(aerostack / "xNova-TM-MR.csv", aerostack_rows(0.7, seed=1))
    write_csv(folder / "crazypad_damaged_rotor/hover_medians_per_log.csv", crazypad_rows())
    for volume in (1, 2, 3):
        write_csv(folder / f"uiuc_propeller_db/volume{volume}_exp.csv", uiuc_rows(0.8, volume))
