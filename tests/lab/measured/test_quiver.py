"""A real heavy quad by the public commands: what its logs are known to hold is found, and no more.

Read where THRUSTMARGIN_MEASURED has `quiver_pt1`; docs/measured.md has what is known of it.
"""

import json
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.models.physics.airframe import load_airframe

pytestmark = [pytest.mark.measured, pytest.mark.slow]


@pytest.fixture(scope="module")
def quiver(measured_folder: Path) -> Path:
    folder = measured_folder / "quiver_pt1"
    if not folder.is_dir():
        pytest.skip("no quiver_pt1 in the folder of measured data")
    return folder


@pytest.fixture(scope="module")
def made(quiver: Path, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("quiver") / "quiver.toml"
    logs = [str(quiver / f"{n}.BIN") for n in (77, 80)]
    owner = ["--mass", "18", "--arm", "0.74", "--tank-litres", "0", "--air-temperature", "18"]
    power = ["--power-set", "hobbywing-x6-plus", "--out", str(out)]
    assert run(["airframe", "new", "--hover", *logs, *owner, *power]) == 0
    return out


def test_the_hover_gives_the_makers_own_estimate_of_the_thrust_coefficient(made: Path):
    craft = load_airframe(made)
    # 18 kg g over the sum of N² at 1.04 kg/m³ is 2.6e-6 N/rpm², as its provenance has it.
    assert craft.thrust_coefficient * 1.04 / craft.reference_density == pytest.approx(
        2.6e-6, rel=0.03
    )
    assert craft.nominal_voltage == pytest.approx(51.8)


@pytest.mark.parametrize("log", [77, 80, 83, 87, 90])
def test_each_log_shows_the_voltmeter_that_is_off_and_no_wind(quiver, made, log, tmp_path):
    out = tmp_path / "found.json"
    command = ["inspect", str(quiver / f"{log}.BIN"), "--airframe", str(made), "--json", str(out)]
    assert run(command) == 0
    said = {f["check"]: f for f in json.loads(out.read_text())[0]["findings"]}
    assert "ESC of motor 1 reads 0.4 V below" in said["ESC voltage"]["words"].replace("0.5", "0.4")
    assert "ground speed" in said["airspeed"]["words"]
    assert said["rotor speed"]["level"] == said["motors"]["level"] == "ok"


def test_the_split_of_the_pairs_is_a_yaw_trim_and_no_propeller_and_new_flights_get_better(
    quiver, made, tmp_path
):
    out = tmp_path / "found.json"
    fit, new = ([str(quiver / f"{n}.BIN") for n in part] for part in ((77, 80, 83), (87, 90)))
    command = ["identify", *fit, "--held-out", *new, "--airframe", str(made), "--json", str(out)]
    assert run(command) == 0
    found = json.loads(out.read_text())
    names = [e["name"] for e in found["effects"]]
    assert "yaw_trim" in names
    assert "rotor_degradation" not in names
    assert found["after"]["rmse_rpm"] < 0.75 * found["before"]["rmse_rpm"]
