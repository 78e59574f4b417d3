"""Which vehicle a log is of, from each form of log; and what is refused or read of it."""

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.log_files import DataFlashWriter, UlogWriter
from tests.gcs_plugin.logs.tlog_files import link, stamped, written
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import LogError

NAN = float("nan")
SIX_MOTORS = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 7)}
HOVER_MOTORS = {f"SERVO{n}_FUNCTION": 28.0 + n for n in range(5, 9)}


def dataflash(*texts: str, **parameters: float) -> DataFlashWriter:
    """Ten seconds of attitude and eight motor outputs."""
    log = DataFlashWriter()
    log.message("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw")
    log.message("RCOU", "Q" + "H" * 8, "TimeUS," + ",".join(f"C{n}" for n in range(1, 9)))
    log.texts(*texts)
    log.parameters(**parameters)
    for tick in range(100):
        time_us = 1_000_000 + tick * 100_000
        log.row("ATT", time_us, 100, 200, 300)
        log.row("RCOU", time_us, *[1000 + 10 * n for n in range(1, 9)])
    return log


def in_both_forms(tmp_path: Path, log: DataFlashWriter) -> list[Path]:
    paths = [tmp_path / "flight.BIN", tmp_path / "flight.log"]
    for path, data in zip(paths, (log.binary(), log.text()), strict=True):
        path.write_bytes(data)
    return paths


@pytest.mark.parametrize(
    ("text", "parameters", "kind"),
    [
        ("ArduPlane V4.3.0 (abc)", {"MOT_PWM_MIN": NAN}, "plane"),
        ("ArduRover V4.2.3 (abc)", {"FRAME_CLASS": 1.0}, "rover"),
        ("ArduRover V4.2.3 (abc)", {"FRAME_CLASS": 2.0}, "boat"),
        (
            "ArduSub V4.1.0 (abc)",
            {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 7)},
            "submarine",
        ),
        ("ArduCopter V4.4.0 (abc)", {"FRAME_CLASS": 6.0}, "helicopter"),
        ("no program named", {"TECS_CLMB_MAX": 5.0}, "plane"),
    ],
)
def test_other_vehicles_are_refused_and_read_for_inspection(tmp_path, text, parameters, kind):
    for path in in_both_forms(tmp_path, dataflash(text, **parameters)):
        with pytest.raises(LogError, match=rf"^{path.name}: this is a {kind} \(by .*multirotors$"):
            read_log(path)
        log = read_log(path, any_vehicle=True)
        assert (log.facts.kind, log.track.rotor_count) == (kind, 0)
        assert log.track.reports("attitude")


def test_the_hover_motors_of_a_quadplane_are_taken(tmp_path):
    quadplane = dataflash("ArduPlane V4.3.0 (abc)", Q_ENABLE=1.0, Q_FRAME_CLASS=1.0, **HOVER_MOTORS)
    for path in in_both_forms(tmp_path, quadplane):
        log = read_log(path)
        assert (log.facts.kind, log.track.rotor_count) == ("quadplane", 4)
        np.testing.assert_allclose(log.track.throttle[50], [0.05, 0.06, 0.07, 0.08])
        assert any(
            "forward flight on its wings is not hover" in n
            for n in map(statement_words, log.track.notes)
        )
    hidden = dataflash("ArduPlane V4.3.0 (abc)", Q_ENABLE=1.0, Q_FRAME_CLASS=1.0)
    for path in in_both_forms(tmp_path, hidden):
        with pytest.raises(LogError, match="nothing says which outputs are its hover motors"):
            read_log(path)


def test_a_quadplane_on_its_wings_is_not_in_hover(tmp_path):
    pulses = {"Q_M_PWM_MIN": 1100.0, "Q_M_PWM_MAX": 1900.0}
    log = dataflash("ArduPlane V4.3.0", Q_ENABLE=1.0, Q_FRAME_CLASS=1.0, **pulses, **HOVER_MOTORS)
    for tick in range(100, 200):
        time_us = 1_000_000 + tick * 100_000
        log.row("ATT", time_us, 100, 200, 300)
        log.row("RCOU", time_us, *[1500] * 4, *[1500 if tick >= 150 else 1100] * 4)
    for path in in_both_forms(tmp_path, log):
        track = read_log(path).track
        assert not track.flying[:149].any()
        assert track.flying[150:].all()
        assert source_words(track.sources["flying"]).endswith("hover motors driven")
        assert np.nanmax(track.throttle) == pytest.approx(0.5)
        assert "Q_M_PWM_MIN/MAX" in source_words(track.sources["throttle"])


@pytest.mark.parametrize("value", [NAN, float("inf"), -1.0, 1.5])
def test_parameters_that_are_no_whole_numbers_tell_nothing(tmp_path, value):
    log = dataflash("ArduCopter V4.5.7", FRAME_CLASS=value, SERVO1_FUNCTION=value)
    for path in in_both_forms(tmp_path, log):
        found = read_log(path)
        assert (found.facts.kind, found.facts.rotor_count) == ("multirotor", 0)
        assert found.track.rotor_speed_rpm.shape[1] == found.track.throttle.shape[1] == 0
        assert statement_words(found.facts.statement).endswith("rotors: not reported")
        assert any(
            "reports the number of rotors" in note
            for note in map(statement_words, found.track.notes)
        )


@pytest.mark.parametrize(
    ("letters", "volts", "amperes"),
    [
        ("QhIhhhf", 1198, 2739),  # 2014: whole hundredths
        ("Qhffffh", 11.98, 27.39),
        ("QhIcchf", 1198, 2739),  # hundredths by their letter
    ],
)
def test_volts_and_amperes_of_old_firmware_are_hundredths(tmp_path, letters, volts, amperes):
    log = dataflash("APM:Copter V3.2.1", FRAME=1.0)
    log.message("CURR", letters, "TimeUS,ThrOut,ThrInt,Volt,Curr,Vcc,CurrTot")
    for tick in range(100):
        log.row("CURR", 1_000_000 + tick * 100_000, 400, 5, volts, amperes, 4900, 7)
    for path in in_both_forms(tmp_path, log):
        track = read_log(path).track
        assert np.nanmedian(track.voltage) == pytest.approx(11.98, abs=0.01)
        assert np.nanmedian(track.current) == pytest.approx(27.39, abs=0.01)


@pytest.mark.parametrize(
    ("mav_type", "kind"), [(1, "plane"), (10, "rover"), (12, "submarine"), (4, "helicopter")]
)
def test_a_heartbeat_says_what_a_telemetry_log_is_of(tmp_path, mav_type, kind):
    made, out = link(), []
    for tick in range(50):
        t = 10.0 + tick / 10
        messages = [
            dialect.MAVLink_heartbeat_message(mav_type, 3, 81, 0, 3, 3),
            dialect.MAVLink_attitude_message(int(t * 1000), 0.01, 0.02, 0.03, 0, 0, 0),
        ]
        out += [stamped(m.pack(made), t) for m in messages]
    path = written(tmp_path, b"".join(out))
    with pytest.raises(LogError, match=rf"this is a {kind} \(by MAV_TYPE {mav_type}\)"):
        read_log(path)
    assert read_log(path, any_vehicle=True).facts.kind == kind


@pytest.mark.parametrize(
    ("parameters", "kind", "rotors"),
    [
        ({"MAV_TYPE": 1}, "plane", 0),
        ({"CA_AIRFRAME": 5, "CA_ROTOR_COUNT": 0}, "rover", 0),
        ({"MAV_TYPE": 13}, "multirotor", 6),
        ({"SYS_AUTOSTART": 13000, "CA_ROTOR_COUNT": 4}, "quadplane", 4),
        ({}, "unknown", 0),
    ],
)
def test_px4_says_it_in_its_parameters(tmp_path, parameters, kind, rotors):
    log = UlogWriter()
    for name, value in parameters.items():
        log.parameter(name, value)
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    for tick in range(50):
        log.row("vehicle_attitude", 1.0 + tick / 10, 1.0, 0.0, 0.0, 0.0)
    path = written(tmp_path, log.bytes(), "flight.ulg")
    found = read_log(path, any_vehicle=True)
    assert (found.facts.kind, found.track.rotor_count) == (kind, rotors)
    if kind in ("plane", "rover"):
        with pytest.raises(LogError, match="thrustmargin is for multirotors"):
            read_log(path)


def test_the_type_that_px4_reports_goes_before_the_one_it_is_set_to(tmp_path):
    log = UlogWriter()
    log.parameter("MAV_TYPE", 2)
    log.topic("vehicle_status", [("uint8_t", "system_type")], "B")
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    for tick in range(50):
        log.row("vehicle_attitude", 1.0 + tick / 10, 1.0, 0.0, 0.0, 0.0)
        log.row("vehicle_status", 1.0 + tick / 10, 14)
    found = read_log(written(tmp_path, log.bytes(), "flight.ulg"))
    assert (found.facts.kind, found.facts.rotor_count) == ("multirotor", 8)
