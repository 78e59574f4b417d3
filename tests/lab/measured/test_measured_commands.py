"""`python -m tests.lab.measured` on small files in the sets' formats: known laws, and damage."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import tyro

from tests.lab.measured import __main__ as command
from tests.lab.measured import aerostack2, crazypad, strawson, uiuc, vendor_bench
from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.measured_files import (
    aerostack_rows,
    crazypad_rows,
    uiuc_rows,
    vendor_rows,
    write_benches,
    write_csv,
)
from tests.lab.measured.study import Study, study
from thrustmargin.models.errors import DataError

BENCHES = tuple(c.FOLDER for c in (vendor_bench, uiuc, aerostack2, strawson, crazypad))
VENDOR, STRAWSON = "vendor_bench_tmotor_kde", "strawson_static_thrust"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "measured"
    write_benches(made)
    return made


def value_of(finding: Finding, name: str) -> float:
    return finding.number(name)


def test_the_coefficient_of_a_bench_table_is_found_and_the_odd_sheet_named(folder: Path):
    found = vendor_bench.find(folder / VENDOR)
    assert value_of(found, "coefficient_36x11.5") == pytest.approx(1.7e-5, rel=1e-9)
    assert value_of(found, "r2_36x11.5") == pytest.approx(1.0)
    assert [n for n in found.notes if n.startswith("odd")] == [
        "odd: C.xlsx, 20 x 6 in at 24 V: a is 1.50 of the median of 3 sheets of that propeller"
    ]


def test_known_typos_and_the_copied_sheet_are_left_out_and_said(folder: Path):
    rows = vendor_rows()
    wrong = ("T-motor", "U13", "T-motor_U13_KV100.xlsx", 36.0, 11.5, 2)
    for voltage, rpm, grams in ((32.0, 1967.0, 4794.0), (40.0, 1500.0, 9000.0)):
        for column, cell in zip(rows.values(), (*wrong, voltage, rpm, grams), strict=True):
            column.append(cell)
    write_csv(folder / VENDOR / "motor_prop_bench_tidy.csv", rows)
    found = vendor_bench.find(folder / VENDOR)
    assert value_of(found, "coefficient_36x11.5") == pytest.approx(1.7e-5, rel=1e-9)
    assert sum(n.startswith("left out") for n in found.notes) == 2


def test_a_bench_run_with_its_sensor_turned_round_is_named_and_a_robust_fit_resists_it(folder):
    fit = strawson.fit_propellers(folder / STRAWSON)[0]
    assert fit.wrong_runs == fit.turned_runs == ("run4.csv",)
    assert fit.right == pytest.approx(2e-8, rel=1e-9)
    assert abs(fit.robust / fit.right - 1.0) < 0.35 * abs(fit.plain / fit.right - 1.0)


def test_thrust_at_a_command_goes_with_the_voltage_to_the_power_that_it_was_made_with(folder):
    found = aerostack2.find(folder / "aerostack2_thrust_vs_voltage")
    assert value_of(found, "speed_exponent") == pytest.approx(1.0, abs=1e-3)
    assert value_of(found, "speed_exponent_on_airframe") == pytest.approx(0.7, abs=1e-3)
    assert value_of(found, "rmse_by_command_and_voltage") < 1e-3
    assert value_of(found, "rmse_by_command") > 0.1


def test_thrust_of_the_other_sign_is_refused_and_not_read_as_nothing(folder: Path):
    path = folder / "aerostack2_thrust_vs_voltage/xNova-TM-SR.csv"
    write_csv(path, aerostack_rows(sign=1.0), delimiter=";")
    with pytest.raises(DataError, match=r"xNova-TM-SR\.csv has 0 rows with a negative thrust"):
        aerostack2.find(path.parent)


def test_the_share_of_commands_falls_in_a_straight_line_with_blade_length(folder: Path):
    found = crazypad.find(folder / "crazypad_damaged_rotor")
    assert value_of(found, "correlation") == pytest.approx(-1.0)
    assert value_of(found, "share_per_mm") == pytest.approx(-0.01)


def test_hovers_without_a_cut_propeller_cannot_say_anything(folder: Path):
    path = folder / "crazypad_damaged_rotor/hover_medians_per_log.csv"
    write_csv(path, {**crazypad_rows(), "cond": ["normal_flight"] * 6})
    with pytest.raises(DataError, match="no hover with a cut propeller on motor 3"):
        crazypad.find(path.parent)


def test_the_slope_of_thrust_with_inflow_is_found_on_every_propeller(folder: Path):
    found = uiuc.find(folder / "uiuc_propeller_db")
    assert value_of(found, "propellers") == 12
    assert value_of(found, "slope_median") == pytest.approx(0.8, rel=1e-6)
    assert value_of(found, "rmse_linear") < 1e-9 < 0.01 < value_of(found, "rmse_constant")


def test_a_pitch_that_cannot_be_is_left_out_and_counted(folder: Path):
    rows = uiuc_rows(0.8, 1)
    rows["P"][:40] = [100.0] * 40
    write_csv(folder / "uiuc_propeller_db/volume1_exp.csv", rows)
    found = uiuc.find(folder / "uiuc_propeller_db")
    assert value_of(found, "propellers") == 11
    assert "left out: 1 of 12 propellers" in found.notes[0]


def run(*arguments: str) -> int:
    return tyro.cli(command.main, args=list(arguments))


def test_the_command_prints_found_beside_quoted(folder: Path, capsys):
    assert run(str(folder), "--only", *BENCHES) == 0
    text = capsys.readouterr().out
    assert re.search(
        r"a of the 36 x 11.5 in propeller +1.7e-05 N/rpm\^2 +1.683e-05 N/rpm\^2 +reached", text
    )
    assert re.search(r"speed exponent on airframe +0.7 +- *\n", text)


def test_the_command_writes_every_number_as_json_to_a_file(folder: Path, tmp_path: Path, capsys):
    out = tmp_path / "out.json"
    assert run(str(folder), "--only", *BENCHES, "--json", "--out", str(out)) == 0
    assert capsys.readouterr().out == ""
    found = json.loads(out.read_text(encoding="utf-8"))
    assert [d["name"] for d in found["data_sets"]] == list(BENCHES)
    assert found["missing"] == []
    numbers = {n["name"]: n for n in found["data_sets"][0]["numbers"]}
    assert numbers["coefficient_36x11.5"]["quoted"] == 1.683e-5
    assert numbers["coefficient_36x11.5"]["met"] is True


def test_a_number_off_what_is_quoted_is_said_not_to_reach_it():
    def met(value: float, quoted: float | None, aim) -> bool | None:
        return Number("n", value, "1", quoted, aim).met

    assert met(1.0, 1.17, "at most") is True
    assert met(1.2, 1.17, "at most") is False
    assert met(1.19, 1.17, "like") is True
    assert met(-0.9, -0.957, "like") is False
    assert met(np.nan, 1.0, "like") is False
    assert met(1.0, None, "like") is None
    assert met(1.0, 2.0, "") is None


#: file -> what is done to it, what is said
DAMAGE = {
    "missing file": (lambda p: p.unlink(), "no file"),
    "empty file": (lambda p: p.write_bytes(b""), "cannot read"),
    "other bytes": (lambda p: p.write_bytes(bytes(range(256)) * 40), "r"),
    "missing column": (
        lambda p: write_csv(p, {k: v for k, v in vendor_rows().items() if k != "thrust_g"}),
        "motor_prop_bench_tidy.csv has no column 'thrust_g'; it has brand,",
    ),
    "words for numbers": (
        lambda p: write_csv(p, {**vendor_rows(), "rpm": ["fast"] * 10}),
        "column 'rpm' holds words",
    ),
    "no rows": (lambda p: write_csv(p, {k: [] for k in vendor_rows()}), "holds no rows"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_data_set_is_one_line_and_the_others_are_told(damage, folder, capsys):
    change, said = DAMAGE[damage]
    change(folder / VENDOR / "motor_prop_bench_tidy.csv")
    assert run(str(folder), "--only", VENDOR, STRAWSON) == 1
    out, err = capsys.readouterr()
    assert "Wrong bench runs and a robust fit" in out
    assert "T-Motor U13" not in out
    lines = err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"not used: {VENDOR}: ")
    assert said in lines[0]


def test_a_data_set_that_is_not_there_is_named_once(folder: Path, capsys):
    assert run(str(folder), "--only", "px4_ulog", STRAWSON) == 1
    assert capsys.readouterr().err.strip() == (
        f"not used: px4_ulog: no folder px4_ulog in {folder}"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no folder nowhere; give the folder that holds the data sets"),
        ([".", "--only", "uiuc"], "no data set 'uiuc'; there are vendor_bench"),
        (["."], "none of the data sets can be used: no folder vendor_bench_tmotor_kde in ."),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_1(
    arguments, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert said in err


def test_a_damaged_px4_log_is_one_line(tmp_path: Path):
    place = tmp_path / "px4_ulog"
    place.mkdir()
    with pytest.raises(DataError, match="no file"):
        study(tmp_path, only=("px4_ulog",))
    (place / "sample_px4_events.ulg").write_bytes(b"ULog" + bytes(40))
    with pytest.raises(DataError, match=r"none of the data sets can be used: .*sample_px4_events"):
        study(tmp_path, only=("px4_ulog",))


def test_a_number_that_was_not_found_is_null_in_json():
    number = Number("n", float("nan"), "1", 1.0, "like")
    finding = Finding(name="x", title="x", numbers=(number,))
    told = Study(findings=(finding,), missing=()).to_json()
    text = json.dumps(told, allow_nan=False)
    assert json.loads(text)["data_sets"][0]["numbers"][0]["value"] is None
