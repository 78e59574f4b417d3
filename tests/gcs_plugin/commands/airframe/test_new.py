"""`thrustmargin airframe new`: what the vehicle says is taken, what it cannot know is asked for."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.airframe.questions import layouts_offered
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe
from thrustmargin.models.physics.airframe import load_airframe

HEXA = """FRAME_CLASS,2
FRAME_TYPE,1
MOT_BAT_VOLT_MAX,25.2
BATT_LOW_VOLT,21.6
"""
_PX4_ROTORS = [(0.5, 0.6, 0.05), (-0.5, -0.6, 0.05), (0.5, -0.6, -0.05), (-0.5, 0.6, -0.05)]
PX4 = "# Onboard parameters for Vehicle 1\n1\t1\tCA_ROTOR_COUNT\t4\t6\n1\t1\tBAT1_N_CELLS\t12\t6\n"
PX4 += "".join(
    f"1\t1\tCA_ROTOR{n}_{key}\t{value}\t9\n"
    for n, (forward, right, torque) in enumerate(_PX4_ROTORS)
    for key, value in (("PX", forward), ("PY", right), ("PZ", -0.1), ("KM", torque))
)
OWNER = ["--mass", "18", "--tank-litres", "0", "--power-set", "hobbywing-x6-plus"]


@pytest.fixture
def made(tmp_path, capsys):
    """The airframe made of a parameter file's text with some options, and what was printed."""

    def make(text, *options, name="vehicle.param"):
        source, out = tmp_path / name, tmp_path / "mine.toml"
        source.write_text(text)
        code = run(["airframe", "new", "--from", str(source), "--out", str(out), *options])
        return (load_airframe(out) if out.exists() else None), code, capsys.readouterr()

    return make


@pytest.mark.parametrize("separator", [",", "\t", "  ", " , "])
@pytest.mark.parametrize("name", ["vehicle.param", "VEHICLE.PARM", "vehicle.txt"])
def test_parameter_files_of_ground_stations_give_the_motor_order(made, separator, name):
    craft, code, printed = made(HEXA.replace(",", separator), *OWNER, "--arm", "0.45", name=name)
    assert code == 0
    assert printed.out.splitlines()[-1].endswith("thrustmargin learn LOGS --aircraft NAME")
    assert craft.rotor_spin.tolist() == [-1, 1, -1, 1, 1, -1]
    np.testing.assert_allclose(craft.rotor_position_frd[4], [0.45 * 0.866, 0.225, 0.0], atol=1e-4)
    assert craft.nominal_voltage == pytest.approx(22.2)
    assert "MOT_BAT_VOLT_MAX 25.2" in craft.quantities["nominal_voltage"].source


def test_px4_gives_positions_and_spin_itself(made):
    craft, _, _ = made(PX4, *OWNER, name="px4.params")
    assert craft.layout == "quad-x"
    assert craft.rotor_spin.tolist() == [1, 1, -1, -1]
    np.testing.assert_allclose(craft.rotor_position_frd[0], [0.5, 0.6, -0.1])
    assert "arm" in craft.guessed
    assert craft.nominal_voltage == pytest.approx(44.4)
    scaled, _, _ = made(PX4, *OWNER, "--arm", "1.562", "--force", name="px4.params")
    np.testing.assert_allclose(scaled.rotor_position_frd[0], [1.0, 1.2, -0.2], atol=1e-3)


def test_what_is_missing_is_named_all_at_once(made):
    craft, code, printed = made("SYSID_THISMAV,1\n")
    assert (craft, code) == (None, 2)
    for option in ("--layout", "--power-set", "--cells", "--wheelbase", "--mass", "--tank-litres"):
        assert option in printed.err
    assert len(printed.err.splitlines()) == 1


def test_of_several_logs_in_the_folder_one_is_to_be_named(tmp_path, monkeypatch, capsys):
    for name in ("b.tlog", "a.BIN"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    assert run(["airframe", "new"]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("thrustmargin: 2 logs in this folder, none named (--from a.BIN says")


def test_the_number_of_rotors_that_the_vehicle_reports_is_said(made):
    outputs = "".join(f"SERVO{n}_FUNCTION,{32 + n}\n" for n in range(1, 7))
    _, _, printed = made(outputs)
    assert "reports 6 rotors" in printed.err


def test_what_nobody_stated_is_marked_as_guessed_and_what_somebody_did_is_not(made):
    craft, _, printed = made(HEXA, *OWNER, "--arm", "0.45")
    assert "thrust_coefficient" in craft.guessed
    assert not {"empty_mass", "propeller_diameter", "nameplate_max_thrust", "arm"} & {
        *craft.guessed
    }
    assert "guessed, not measured" in printed.out


def test_somebody_at_a_terminal_is_asked_and_offered_no_default(tmp_path):
    source, out = tmp_path / "vehicle.param", tmp_path / "mine.toml"
    source.write_text(HEXA)
    own, terminal = os.openpty()
    # Mass, a slip of the finger, motor to motor, no answer, another power set, its figures, tank.
    os.write(own, b"6.2 kg\nfour\n0.9m\n\nother\n15x5.5\n3,33 kgf\n2 l\n")
    run_it = "from thrustmargin.gcs_plugin.cli import main; main()"
    line = [sys.executable, "-c", run_it, "airframe", "new", "--from", str(source)]
    done = subprocess.run(
        [*line, "--out", str(out)], stdin=terminal, capture_output=True, text=True, timeout=200
    )
    os.close(own)
    os.close(terminal)
    assert done.returncode == 0, done.stderr
    craft = load_airframe(out)
    assert (craft.layout, craft.empty_mass, craft.tank_volume_l) == ("hexa-x", 6.2, 2.0)
    assert craft.arm == pytest.approx(0.45, abs=1e-4)
    stated = {"tank_volume_l", "propeller_diameter", "nameplate_max_thrust", "arm", "empty_mass"}
    assert not stated & {*craft.guessed}
    assert "could not convert" in done.stdout
    assert "there is no default" in done.stdout


MEASURED = Path(os.environ.get("THRUSTMARGIN_MEASURED", "/nowhere"))


@pytest.mark.measured
@pytest.mark.parametrize("file", ["parameters.param", "77.BIN"])
@pytest.mark.skipif(not MEASURED.is_dir(), reason="THRUSTMARGIN_MEASURED names no folder")
def test_a_real_quads_log_and_parameters_give_the_same_aircraft(tmp_path, file):
    out = tmp_path / "quiver.toml"
    source = ["--from", str(MEASURED / "quiver_pt1" / file), "--arm", "0.74"]
    assert run(["airframe", "new", *source, *OWNER, "--out", str(out)]) == 0
    craft = load_airframe(out)
    assert craft.layout == "quad-x"
    assert craft.rotor_spin.tolist() == [1, 1, -1, -1]
    assert craft.nominal_voltage == pytest.approx(51.8)  # 14 cells


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--wheelbase", "0.9", "--arm", "0.45"], "say the same"),
        (["--arm", "-1"], "--arm -1 is not a number above 0"),
        (["--arm", "0.45", "--propeller", "24by8"], "write it in inches, as in 24x8"),
        (["--arm", "0.45", "--power-set", "x7"], "no power set 'x7'; known are"),
        (["--arm", "0.45", "--layout", "hexa-z"], "no layout 'hexa-z'; known are"),
    ],
)
def test_a_wrong_option_is_named_with_what_to_write(made, options, words):
    craft, code, printed = made(HEXA, *OWNER, *options)
    assert (craft, code) == (None, 2)
    assert words in printed.err


def test_only_layouts_of_the_motors_found_are_offered():
    hexa = ReportedAirframe(rotor_count=6)
    assert {"hexa-x", "hexa-plus", "y6"} < set(layouts_offered(hexa))
    assert not [name for name in layouts_offered(hexa) if name.startswith(("quad", "octo"))]
    assert set(layouts_offered(ReportedAirframe())) > {"quad-x", "hexa-x", "octo-x"}


def test_the_makers_thrust_and_speed_give_the_curve(made):
    given = ["--propeller", "15x5.5", "--max-thrust-kgf", "3.33", "--max-speed-rpm", "6000"]
    craft, _, _ = made(HEXA, "--mass", "6", "--arm", "0.45", "--tank-litres", "2", *given)
    assert craft.thrust_coefficient == pytest.approx(3.33 * 9.80665 / 6000**2, rel=1e-3)
    assert "thrust_coefficient" not in craft.guessed


def test_nothing_that_stands_is_replaced_or_read_over(made, tmp_path):
    made(HEXA, *OWNER, "--arm", "0.45")
    craft, code, printed = made(HEXA, *OWNER, "--arm", "0.6")
    assert code == 1
    assert craft.arm == pytest.approx(0.45, abs=1e-4)
    assert "already there" in printed.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.toml", "vehicle.param"]
