"""Bench tables as makers and test stands write them: names, units, delimiters, faults."""

import os
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs.bench_table import read_bench
from thrustmargin.models.errors import DataError

SPEED = np.linspace(1000.0, 3000.0, 9)
THRUST = 2e-5 * SPEED**2  # N


def table(path: Path, header: str, rows: list[str], *, encoding: str = "utf-8") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding=encoding)
    return path


@pytest.mark.parametrize(
    ("name", "newtons"),
    [
        ("thrust_N", 1.0),
        ("Thrust (g)", 9.80665e-3),
        ("thrust [kgf]", 9.80665),
        ("Pull (lbf)", 4.4482216),
        ("thrust_oz", 0.2780139),
    ],
)
def test_the_unit_of_thrust_is_read_from_the_columns_name(tmp_path, name: str, newtons: float):
    rows = [f"{n:g},{t / newtons:.9g}" for n, t in zip(SPEED, THRUST, strict=True)]
    found = read_bench(table(tmp_path / "bench.csv", f"RPM,{name}", rows))
    assert found.fit.coefficient.value == pytest.approx(2e-5, rel=1e-6)


def test_a_test_stands_own_file_is_read_with_semicolons_and_a_byte_order_mark(tmp_path):
    header = "Time (s);ESC signal (µs);Thrust (N);Voltage (V);Motor Electrical Speed (RPM);App"
    pulse = np.linspace(1200.0, 2000.0, 9)
    rows = [f"0;{p:g};{-t:g};48;{n:g};" for p, t, n in zip(pulse, THRUST, SPEED, strict=True)]
    found = read_bench(table(tmp_path / "stand.csv", header, rows, encoding="utf-8-sig"))
    assert found.fit.coefficient.value == pytest.approx(2e-5, rel=1e-4)
    assert found.fit.full_throttle
    assert found.fit.ceiling_voltage == 48.0
    assert found.columns["rotor_speed_rpm"] == "Motor Electrical Speed (RPM)"


def test_a_row_that_does_not_agree_is_named_by_its_line(tmp_path):
    rows = [f"{n:g},{t:.9g}" for n, t in zip(SPEED, THRUST, strict=True)]
    rows[2] = "2900,30"
    assert read_bench(table(tmp_path / "b.csv", "rpm,thrust_N", rows)).lines_left_out == (4,)


@pytest.mark.parametrize(
    ("header", "rows", "said"),
    [
        ("speed,thrust_N", ["1,2"], "no column of rotor_speed_rpm"),
        ("rpm,force", ["1,2"], "no column of thrust"),
        ("rpm,thrust", ["1,2"], "does not say its unit; name it thrust_N"),
        ("rpm,thrust_N", ["1,2"], "b.csv: 1 bench points"),
        ("", [], "no column of rotor_speed_rpm"),
    ],
)
def test_what_is_missing_is_named(tmp_path, header: str, rows: list[str], said: str):
    with pytest.raises(DataError, match=said):
        read_bench(table(tmp_path / "b.csv", header, rows))


def test_no_file_and_other_bytes_are_one_line(tmp_path):
    with pytest.raises(DataError, match="cannot read bench table"):
        read_bench(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(bytes(range(256)))
    with pytest.raises(DataError, match=r"b.csv line 2: byte 0x80 is not UTF-8"):
        read_bench(tmp_path / "b.csv")
    (tmp_path / "b.csv").write_text("rpm,thrust_N\n" + "1" * 131_073 + ",2\n")
    with pytest.raises(DataError, match="no table of cells"):
        read_bench(tmp_path / "b.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "b.csv")
    with pytest.raises(DataError, match="pipe"):
        read_bench(tmp_path / "b.csv")
