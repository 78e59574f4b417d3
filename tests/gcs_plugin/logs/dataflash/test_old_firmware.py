"""Logs of ArduCopter 3.1 to 3.3: times in ms or none at all, hundredths, other names."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gcs_plugin.logs.log_files import DataFlashWriter
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.dataflash.binary import dataflash_boots
from thrustmargin.gcs_plugin.logs.dataflash.columns import DataFlashColumns
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import dataflash_signals
from thrustmargin.gcs_plugin.logs.dataflash.text_log import dataflash_text_boots
from thrustmargin.gcs_plugin.telemetry.recording import channel_source
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.gcs_plugin.telemetry.signals import Stream
from thrustmargin.gcs_plugin.wording.check_words import value_words
from thrustmargin.models.errors import LogError, ThrustMarginError

#: 5 km west of Zürich, 120 m above home, 8.5 m/s to the east.
LAT, LNG, ALT = 473_700_000, 84_700_000, 52_000


def old_log(
    *, monitor: int = 4, hundredths: bool = True, imu: bool = True, rate: str = "TimeMS"
) -> DataFlashWriter:
    """Six seconds of ArduCopter 3.2: GPS in the week's ms with the vehicle's clock in T."""
    log = DataFlashWriter()
    log.message("PARM", "Nf", "Name,Value")
    log.message("MSG", "Z", "Message")
    log.message(
        "GPS", "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"
    )
    log.message("ATT", "IccccCCCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw")
    kind, many = ("Q", 1000) if rate == "TimeUS" else ("I", 1)
    log.message("RATE", f"{kind}fffffffff", f"{rate},RDes,R,ROut,PDes,P,POut,YDes,Y,YOut")
    if imu:
        log.message("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.message(
        "CTUN", "Ihhhffecchh", "TimeMS,ThrIn,AngBst,ThrOut,DAlt,Alt,BarAlt,DSAlt,SAlt,DCRt,CRt"
    )
    log.message("CURR", "IhIhhhf", "TimeMS,ThrOut,ThrInt,Volt,Curr,Vcc,CurrTot")
    log.message("RCOU", "Ihhhhhhhh", "TimeMS,Ch1,Ch2,Ch3,Ch4,Ch5,Ch6,Ch7,Ch8")
    log.message("EV", "B", "Id")
    given = {"FRAME": 1.0, "RC3_MIN": 1100.0, "RC3_MAX": 1900.0, "BATT_MONITOR": monitor}
    for name, value in given.items():
        log.row("PARM", name, value, at=0)
    for text in ("APM:Copter V3.2.1 (36b405fb)", "Frame: QUAD"):
        log.row("MSG", text, at=0)
    log.row("EV", 28, at=60_950)
    scale = 100.0 if hundredths else 1.0
    for tick in range(60):
        t = 60_000 + 100 * tick
        if tick % 2 == 0:
            log.row(
                "GPS",
                3,
                130_000_000 + t,
                1800,
                10,
                120,
                LAT,
                LNG,
                12_000,
                ALT,
                850,
                9000,
                -0.5,
                t,
                at=t,
            )
        log.row("ATT", t, 0, 573, 0, -286, 0, 9000, 0, 0)
        turning = (0, 10.0 * scale, 0, 0, -20.0 * scale, 0, 0, 5.0 * scale, 0)
        log.row("RATE", many * t, *turning, at=t)
        if imu:
            log.row("IMU", t, *np.radians([10.0, -20.0, 5.0]), 0.0, 0.0, -9.81)
        log.row("CTUN", t, 500, 0, 480, 0.0, 12.5, 1240, 0, 0, 0, 0)
        log.row("CURR", t, 480, 0, 2220, 2739, 5000, 12.0)
        log.row("RCOU", t, 1100, 1500, 1900, 1300, 1500, 1500, 1500, 1500)
    return log


def read(tmp_path: Path, data: bytes):
    path = tmp_path / "old.log"
    path.write_bytes(data)
    return read_log(path)


@pytest.mark.parametrize("form", ["binary", "text"])
def test_a_log_of_arducopter_3_2_is_a_flight_in_si(tmp_path, form):
    log = read(tmp_path, getattr(old_log(), form)())
    track = log.track
    assert log.clock_start_s == pytest.approx(60.0)
    assert (track.rotor_count, value_words(log.facts.rotor_evidence)) == (4, "text 'Frame: QUAD'")
    np.testing.assert_allclose(track.attitude[5], np.radians([5.73, -2.86, 90.0]), atol=1e-6)
    np.testing.assert_allclose(track.angular_rate_frd[5], np.radians([10, -20, 5]), atol=1e-5)
    np.testing.assert_allclose(track.velocity_ned[5], [0.0, 8.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(track.altitude, 520.0)
    np.testing.assert_allclose(track.height_agl, 12.5)
    np.testing.assert_allclose(track.voltage, 22.2)
    np.testing.assert_allclose(track.current, 27.39)
    np.testing.assert_allclose(track.throttle[5], [0.0, 0.5, 1.0, 0.25])
    # "Not landed" is logged without a time, between the messages of 60.9 and 61.0 s.
    assert (track.flying[5], track.flying[15]) == (False, True)
    # GPS week 1800 began 1980-01-06 + 1800 weeks; GPS is 18 s ahead as the reader has it.
    unix = 315_964_800 + 1800 * 604_800 + 130_060 - 18
    assert track.start_unix_s == pytest.approx(unix, abs=0.01)
    assert reported_airframe(log.parameters, texts=("Frame: QUAD",)).layout == "quad-x"


@pytest.mark.parametrize("form", ["binary", "text"])
@pytest.mark.parametrize("rate", ["TimeMS", "TimeUS"])
def test_a_message_with_a_damaged_clock_is_placed_by_its_neighbours_or_left_out(
    tmp_path, form, rate
):
    log = old_log(rate=rate)
    log.message("BARO", "If", "TimeMS,Press")
    for at, time in ((61_000, 61_000), (62_000, 99_000_000), (63_000, 63_000)):
        log.row("BARO", time, 96_000.0 + at / 1000, at=at)
    path = tmp_path / "old.log"
    path.write_bytes(getattr(log, form)())
    boots = dataflash_boots if form == "binary" else dataflash_text_boots
    (boot,) = boots(path)
    baro = boot.streams["BARO"]
    # Between 62.0 s, at which the messages before it were, and 62.1 s of those behind it.
    wanted = [61.0, 62.0, 63.0] if rate == "TimeMS" else [61.0, 63.0]
    np.testing.assert_allclose(baro.time_s, wanted, atol=0.1)
    np.testing.assert_allclose(baro.columns["Press"], 96_000.0 + np.array(wanted), atol=0.11)


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize(
    ("hundredths", "clock"), [(True, "TimeMS"), (True, "TimeUS"), (False, "TimeUS")]
)
def test_body_rates_are_in_the_unit_that_the_gyroscope_tells(tmp_path, hundredths, imu, clock):
    log = read(tmp_path, old_log(hundredths=hundredths, imu=imu, rate=clock).binary())
    rate = log.track.angular_rate_frd[5]
    np.testing.assert_allclose(rate, np.radians([10, -20, 5]), atol=1e-5)


@pytest.mark.parametrize(
    ("monitor", "kept"), [(0, ()), (3, ("voltage",)), (4, ("voltage", "current"))]
)
def test_a_battery_monitor_that_is_off_measures_nothing(tmp_path, monitor, kept):
    log = read(tmp_path, old_log(monitor=monitor).binary())
    assert tuple(c for c in ("voltage", "current") if log.track.reports(c)) == kept
    said = {c.name: channel_source(c) for c in log.channels}
    for channel in {"voltage", "current"} - set(kept):
        assert said[channel].endswith(f"not used: BATT_MONITOR {monitor} measures no {channel}")


WHOLE = {form: getattr(old_log(), form)() for form in ("binary", "text")}


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_an_old_log_cut_or_hurt_anywhere_is_a_flight_or_one_clear_error(tmp_path_factory, data):
    whole = bytearray(WHOLE[data.draw(st.sampled_from(["binary", "text"]))])
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=8)):
        whole[place] ^= 0xA5
    end = data.draw(st.integers(0, len(whole)))
    path = tmp_path_factory.getbasetemp() / "old_hurt.bin"
    path.write_bytes(bytes(whole[:end]))
    with contextlib.suppress(ThrustMarginError):
        assert read_log(path).track.time_s.size <= 60


def test_a_log_of_px4_before_its_ulog_is_called_that(tmp_path):
    """It has ArduPilot's frame of messages, and none of its names."""
    log = DataFlashWriter()
    log.message("TIME", "Q", "StartTime")
    log.message("ATT", "fff", "Roll,Pitch,Yaw")
    for k in range(300):
        log.row("TIME", 10_000 * k)
        log.row("ATT", 0.1, 0.2, 0.3, at=10_000 * k)
    path = tmp_path / "11_22_33.px4log"
    path.write_bytes(log.binary())
    with pytest.raises(LogError, match=r"PX4 from before 2016 .* \.ulg") as caught:
        read_log(path)
    assert "\n" not in str(caught.value)


def test_events_say_when_it_was_armed_and_before_the_first_it_was_not():
    """LogEvent 10 armed, 11 disarmed; 18 landed says nothing of that."""
    table = np.array([(10,), (18,), (11,)], dtype=[("Id", np.uint8)])
    events = Stream(np.array([5.0, 60.0, 62.0]), DataFlashColumns(table, {"Id": 1.0}))
    (armed,) = dataflash_signals({"EV": events})["armed"]
    assert armed.time_s.tolist() == [-np.inf, 5.0, 62.0]
    assert armed.values.tolist() == [0.0, 1.0, 0.0]
