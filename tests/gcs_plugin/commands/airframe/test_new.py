"""`thrustmargin airframe new`: what the vehicle says is taken, what it cannot know is asked for."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.cli import run
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
def test_parameter_files_of_ground_stations_give_the_motor_order(made, separator):
    craft, code, _ = made(HEXA.replace(",", separator), *OWNER, "--arm", "0.45")
    assert code == 0
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
    for option in ("--layout", "--power-set", "--cells", "--arm", "--mass", "--tank-litres"):
        assert option in printed.err


def test_what_nobody_stated_is_marked_as_guessed_and_what_somebody_did_is_not(made):
    craft, _, printed = made(HEXA, *OWNER, "--arm", "0.45")
    assert "thrust_coefficient" in craft.guessed
    assert not {"empty_mass", "propeller_diameter", "nameplate_max_thrust", "arm"} & {
        *craft.guessed
    }
    assert "guessed, not measured" in printed.out
