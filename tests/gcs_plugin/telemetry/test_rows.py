"""Which reports the rows of a flight are made of, and what says that it flies."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.tlog_files import (
    FLIGHT,
    ROOT,
    STAMPED,
    flight_of,
    link,
    stamped,
    written,
)
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.physics.airframe import load_airframe


def test_motors_are_found_on_the_outputs_that_the_parameters_name(tmp_path):
    """Motors 1 to 4 on outputs 6, 5, 8, 7: ESC telemetry is numbered by output."""
    made, out = link(), []
    for motor, output in enumerate((6, 5, 8, 7)):
        name = f"SERVO{output}_FUNCTION".encode()
        out.append(
            stamped(dialect.MAVLink_param_value_message(name, 33 + motor, 9, 1, 0).pack(made), 9)
        )
    for tick in range(30):
        t = 10 + tick / 10
        speeds = [1005, 1006, 1007, 1008]
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_5_to_8_message(
                [30] * 4, [5000] * 4, [900] * 4, [1] * 4, speeds, [tick + 1] * 4
            ),
            dialect.MAVLink_servo_output_raw_message(
                int(t * 1e6), 0, 1000, 1000, 1000, 1000, 1150, 1160, 1170, 1180
            ),
        ]
        out += [stamped(m.pack(made), t) for m in messages]
    track = read_log(written(tmp_path, b"".join(out))).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[5], [1006, 1005, 1008, 1007])
    np.testing.assert_allclose(track.throttle[5], [0.16, 0.15, 0.18, 0.17])
    assert "motors on outputs 6, 5, 8, 7 by SERVOn_FUNCTION" in source_words(
        track.sources["rotor_speed_rpm"]
    )


def test_attitude_of_a_gimbal_is_not_the_vehicles(tmp_path):
    craft, gimbal = link(), link(1, 154)
    data = flight_of(lambda m: m.pack(craft), 10)
    tilted = b"".join(
        stamped(
            dialect.MAVLink_attitude_message(10_000 + 200 * i, 1.0, 1.0, 1.0, 0, 0, 0).pack(gimbal),
            10 + 0.2 * i,
        )
        for i in range(40)
    )
    track = read_log(written(tmp_path, data + tilted)).track
    assert np.nanmax(track.attitude) < 0.1


def test_an_esc_that_falls_silent_is_unknown_not_zero(tmp_path):
    made, out = link(), []
    for tick in range(60):
        t = 10 + tick / 10
        heard = tick < 30
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4,
                [5000] * 4,
                [900] * 4,
                [1] * 4,
                [1500 if heard else 0, 1501, 1502, 1503],
                [tick if heard else 29, tick, tick, tick],
            ),
        ]
        out += [stamped(m.pack(made), t) for m in messages]
    speeds = read_log(written(tmp_path, b"".join(out))).track.rotor_speed_rpm
    assert np.nanmin(speeds[:, 0]) == 1500
    assert np.isnan(speeds[-20:, 0]).all()
    assert np.isfinite(speeds[:, 1:]).all()


def landed_flight(*, told: bool, height: bool) -> bytes:
    """Idle on the ground for 10 s, 20 s in the air, 10 s on the ground; motors answer."""
    made, out = link(), []
    for tick in range(400):
        t = 10 + tick / 10
        up = 100 <= tick < 300
        boot = int(t * 1000)
        messages = [
            dialect.MAVLink_attitude_message(boot, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [5000] * 4, [900] * 4, [1] * 4, [1900 if up else 450] * 4, [tick + 1] * 4
            ),
        ]
        if height:
            above = min(max(tick - 120, 0), max(280 - tick, 0), 30) * 100
            messages.append(
                dialect.MAVLink_global_position_int_message(
                    boot, 366500000, 1169000000, 5000 + above, above, 0, 0, 0, 0
                )
            )
        if told and tick % 10 == 0:
            messages.append(dialect.MAVLink_extended_sys_state_message(0, 2 if up else 1))
        out += [stamped(m.pack(made), t) for m in messages]
    return b"".join(out)


@pytest.mark.parametrize(
    ("told", "height", "said", "first", "last"),
    [
        (True, False, "EXTENDED_SYS_STATE landed_state", 100, 300),
        (True, True, "0.2 m clear of it", 123, 278),
        (False, False, "rotor speeds above 0.5", 100, 300),
    ],
)
def test_flying_is_told_by_the_best_evidence_there_is(tmp_path, told, height, said, first, last):
    track = read_log(written(tmp_path, landed_flight(told=told, height=height))).track
    rows = np.flatnonzero(track.flying)
    assert rows[0] == pytest.approx(first, abs=2)
    assert rows[-1] == pytest.approx(last, abs=2)
    assert said in source_words(track.sources["flying"])


def test_home_moved_while_armed_is_not_the_place_of_zero(tmp_path):
    """Zero is home as it was at take-off, not where it is set later."""
    made = link()
    place = (366500000, 1169000000, 5000)
    before = dialect.MAVLink_home_position_message(*place, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    later = dialect.MAVLink_home_position_message(
        366600000, 1169000000, 9000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
    )
    data = stamped(before.pack(made), 9) + landed_flight(told=True, height=True)
    data += stamped(later.pack(made), 49)
    track = read_log(written(tmp_path, data)).track
    assert track.origin is not None
    assert track.origin.altitude == 5.0
    np.testing.assert_allclose(track.position_ned[200], [0, 0, -3.0], atol=0.01)


def test_an_airframe_with_another_number_of_rotors_is_refused(tmp_path):
    agras = next(a for a in ("agras-t20", "agras-t40") if load_airframe(a).rotor_count != 4)
    with pytest.raises(AirframeError, match="4 rotors by FRAME_CLASS 1, but airframe"):
        read_log(FLIGHT, airframe=load_airframe(agras))
    no_parameters = [p for p in STAMPED if p[15] != 22 or p[16]]
    with pytest.raises(AirframeError, match="4 rotors by MAV_TYPE 2"):
        read_log(written(tmp_path, b"".join(no_parameters)), airframe=load_airframe(agras))


def test_sources_say_which_message_each_channel_came_from():
    log = read_log(FLIGHT)
    assert source_words(log.track.sources["tank_kg"]) == "NAMED_VALUE_FLOAT TANK"
    assert source_words(log.track.sources["airspeed"]).startswith("VFR_HUD airspeed (EKF estimate")
    assert "(from home; by HOME_POSITION)" in source_words(log.track.sources["position_ned"])
    assert "not above the crop" in source_words(log.track.sources["height_agl"])
    reports = {report.name: report for report in log.channels}
    assert reports["rotor_speed_rpm"].rate_hz == pytest.approx(10.0, rel=0.05)
    assert reports["tank_kg"].rate_hz == pytest.approx(2.0, rel=0.05)
    assert reports["rotor_speed_rpm"].gaps == 0


@pytest.mark.parametrize("path", sorted((ROOT / "sitl_logs/campaign").glob("*.tlog"))[::9])
def test_the_tank_of_the_manifest_is_the_tank_of_the_log(path):
    import tomllib

    flights = tomllib.loads((ROOT / "sitl_logs/manifest.toml").read_text())["flight"]
    stated = next(f for f in flights if f["file"].endswith(path.name))
    track = read_log(path).track
    assert track.tank_kg[0] == pytest.approx(stated["payload_start_kg"], abs=1e-3)
    assert track.tank_kg[-1] == pytest.approx(stated["tank_end_kg"], abs=1e-3)
    flown = track.time_s[track.flying]
    assert flown[-1] - flown[0] == pytest.approx(stated["flight_s"], abs=12.0)
