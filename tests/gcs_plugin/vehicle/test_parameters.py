"""The parameters of vehicles that run as processes of their own, over loopback UDP."""

import numpy as np
import pytest

from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.processes import vehicle
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
from thrustmargin.gcs_plugin.vehicle.downloads import download_parameters
from thrustmargin.models.errors import LinkError
from thrustmargin.models.physics.airframe import load_airframe

REAL, WHOLE = 9, 6  # MAV_PARAM_TYPE_REAL32, _INT32
ARDUPILOT = [["FRAME_CLASS", 4, 2], ["FRAME_TYPE", 1, 2], ["MOT_BAT_VOLT_MAX", 58.8, REAL]]
ARDUPILOT += [["BATT_LOW_VOLT", 50.4, REAL]] + [[f"FILL_{n}", n / 8, REAL] for n in range(200)]


def test_an_aircraft_is_made_from_the_vehicle_itself(tmp_path, monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.vehicle.connection.SECOND_VEHICLE", 0.1)
    monkeypatch.setattr("thrustmargin.gcs_plugin.vehicle.downloads._PAUSE", 0.4)
    port, out = free_udp_port(), tmp_path / "x8.toml"
    with vehicle(port=port, parameters=ARDUPILOT, lose_parameters=[0, 3, 77]):
        told = f"--mass 50 --arm 1.1 --tank-litres 40 --power-set hobbywing-x11-plus --out {out}"
        code = run(["airframe", "new", "--from", f"udpin:127.0.0.1:{port}", *told.split()])
    craft = load_airframe(out)
    assert code == 0
    assert craft.layout == "octo-coaxial-x8"
    np.testing.assert_array_equal(craft.rotor_spin, load_airframe("agras-t40").rotor_spin)
    np.testing.assert_array_equal(
        craft.rotor_effectiveness, load_airframe("agras-t40").rotor_effectiveness
    )
    assert craft.nominal_voltage == pytest.approx(51.8)
    assert "lower_rotor_effectiveness" in craft.guessed


@pytest.mark.parametrize("autopilot", [3, 12])
def test_whole_numbers_are_read_as_each_autopilot_sends_them(autopilot):
    port, seen = free_udp_port(), []
    # By MAV_PARAM_TYPE 1 to 5: of 8 bits without and with a sign, of 16, and of 32 without.
    whole = {"U8": (200, 1), "S8": (-100, 2), "U16": (60_000, 3), "S16": (-30_000, 4)}
    whole |= {"U32": (3_000_000, 5)}
    given = [["CA_ROTOR_COUNT", 6, WHOLE], ["CA_ROTOR0_KM", -0.05, REAL]]
    given += [[name, value, kind] for name, (value, kind) in whole.items()]
    with (
        vehicle(port=port, parameters=given, autopilot=autopilot),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        found = download_parameters(link, link.vehicle(1), lambda *at: seen.append(at))
    expected = {"CA_ROTOR_COUNT": 6.0, "CA_ROTOR0_KM": pytest.approx(-0.05)}
    assert found == expected | {name: value for name, (value, _) in whole.items()}
    assert seen[-1] == (7, 7)


def test_a_vehicle_that_sends_none_is_named(monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.vehicle.downloads._PAUSE", 0.1)
    port = free_udp_port()
    with (
        vehicle(port=port, mute=True),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
        pytest.raises(LinkError, match="did not send its parameters"),
    ):
        download_parameters(link, link.vehicle(1))
