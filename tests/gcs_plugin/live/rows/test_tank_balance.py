"""Where the tank level comes from live, and whether its estimates agree."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import Vehicle, as_frame, first_part, live_rows, log_frames
from thrustmargin.gcs_plugin.live.rows.tank_balance import (
    BalanceWatch,
    DeliveryMeter,
    virtual_gauge,
)
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")
LARGER_PUMP = replace(AIRFRAME, pump_max_flow_l_min=4.5)


def levels(frames, tank: str = "auto", start: float | None = None, airframe=AIRFRAME):
    """Level (kg), its source, notes and what was pumped, at each row."""
    rows, _ = live_rows(frames, airframe, tank=tank, tank_start_kg=start, piece=50)
    assert rows is not None
    source = source_words(rows.track.source("tank_kg"))
    return [
        (float(level), source, rows.notes, float(pumped))
        for level, pumped in zip(rows.track.tank_kg, rows.pumped_kg, strict=True)
    ]


def battery(number: int, *, volts: float, percent: int, used: int) -> object:
    cells = [round(volts * 1000)] + [65535] * 9
    return dialect.MAVLink_battery_status_message(number, 0, 0, 32767, cells, -1, used, -1, percent)


def fuel(number: int, remaining_ml: float) -> bytes:
    """FUEL_STATUS as PX4 sends it (371, CRC_EXTRA 10); pymavlink has no class for it."""
    payload = struct.pack(
        "<5fI2B", 16_000.0, math.nan, remaining_ml, math.nan, math.nan, 1, number, 255
    )
    body = bytes([len(payload), 0, 0, 0, 1, 1]) + (371).to_bytes(3, "little") + payload
    crc = dialect.x25crc(body)
    crc.accumulate(bytes([10]))
    return b"\xfd" + body + struct.pack("<H", crc.crc)


def hover(extra, seconds: float = 2.0, *, gauge: bool = False):
    vehicle = Vehicle()
    frames = []
    for _ in range(round(seconds * 10)):
        frames += [f for f in vehicle.tick() if gauge or f.id != 251]
        frames += [as_frame(data, vehicle.stamp_us) for data in extra(vehicle)]
    return frames


def test_auto_prefers_the_named_value_and_says_so():
    found = levels(
        hover(lambda v: [v.pack(battery(1, volts=1.7, percent=50, used=8000))], gauge=True)
    )
    assert found[-1][:2] == (pytest.approx(10.0), "NAMED_VALUE_FLOAT TANK")


def test_a_battery_that_is_a_tank_is_recognised_by_its_senders_voltage():
    def both(vehicle: Vehicle) -> list[bytes]:
        pack = battery(0, volts=50.0, percent=80, used=3000)
        return [vehicle.pack(pack), vehicle.pack(battery(1, volts=1.7, percent=50, used=8000))]

    found = levels(hover(both))
    assert found[-1][0] == pytest.approx(8.0, abs=0.1)
    assert "BATTERY_STATUS current_consumed of id 1 (a tank" in found[-1][1]


def test_px4s_fuel_status_is_the_tank_too():
    found = levels(hover(lambda _: [fuel(0, 7250.0)]))
    assert found[-1][0] == pytest.approx(7.25)
    assert "FUEL_STATUS" in found[-1][1]


def test_a_named_source_that_is_silent_is_not_replaced_by_another():
    found = levels(hover(lambda _: [], gauge=True), tank="FUEL_STATUS 0")
    assert math.isnan(found[-1][0])
    assert "FUEL_STATUS" in " ".join(map(statement_words, found[-1][2]))
    assert levels(hover(lambda _: [], gauge=True), tank="none")[-1][:2][1] == "not in the log"


def test_a_level_that_is_no_longer_reported_is_unknown_after_its_limit():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(60) for f in vehicle.tick() if f.id != 251]
    found = levels(frames)
    assert found[30][0] == pytest.approx(10.0)
    assert math.isnan(found[-1][0])


def test_the_pump_alone_gives_the_level_from_a_stated_start(sitl_logs, tmp_path):
    log = first_part(sitl_logs / "campaign" / "v4_m16_q2.5.tlog", 120.0, tmp_path)
    frames = log_frames(log)
    without = [f for f in frames if f.id not in (251, 147)]
    found = levels(without, tank="pump", start=16.0)
    pumped = found[-1][3]
    assert found[-1][0] == pytest.approx(16.0 - pumped)
    assert "stated 16 kg" in found[-1][1]
    # The same sum as the file's reader makes of the whole flight.
    read = read_log(
        log,
        airframe=AIRFRAME,
        sampling="hold",
        tank="pump",
        tank_start_kg=16.0,
    ).track
    assert found[-1][0] == pytest.approx(float(read.tank_kg[-1]), abs=0.05)
    assert math.isnan(levels(without, tank="pump")[-1][0])


def test_the_delivery_meter_finds_what_the_nozzles_let_through(sitl_logs, tmp_path):
    meter = DeliveryMeter()
    log = first_part(sitl_logs / "campaign" / "v6_m10_q3.5.tlog", 150.0, tmp_path)
    frames = log_frames(log)
    for level, _, _, pumped in levels(frames, airframe=LARGER_PUMP):
        meter.add(level, pumped)
    # The simulated nozzles pass 3.5 of the pump's 4.5 L/min.
    assert meter.first == pytest.approx(3.5 / 4.5, abs=0.04)
    assert meter.now == pytest.approx(3.5 / 4.5, abs=0.04)


@pytest.mark.parametrize("filled", [16.0, 3.0])
def test_the_delivery_meter_starts_anew_after_a_refill_and_ignores_an_empty_gauge(filled: float):
    """From 2 kg on to so many."""
    meter = DeliveryMeter()
    for step in range(200):
        meter.add(10.0 - 0.04 * step, 0.05 * step)
    assert meter.now == pytest.approx(0.8, abs=0.01)
    for step in range(200, 226):  # 1.25 kg by the pump
        meter.add(filled - 0.03 * (step - 200), 0.05 * step)
    assert meter.now == pytest.approx(0.6, abs=0.01)
    assert meter.first == pytest.approx(0.8, abs=0.01)
    for step in range(226, 400):
        meter.add(0.1, 0.05 * step)
    assert meter.now == pytest.approx(0.6, abs=0.05)


def test_the_virtual_gauge_weighs_what_the_gauge_does_not_see(sitl_logs):
    model = physics_model(AIRFRAME)

    def apart(name: str) -> float:
        track = read_log(sitl_logs / f"{name}.tlog", airframe=AIRFRAME, sampling="hold").track
        slow = track.flying & (track.airspeed < 1.0)
        return float(np.nanmedian((virtual_gauge(analyse(track, model)) - track.tank_kg)[slow]))

    # dev/extra_mass: 3 kg that the tank gauge does not see. Weight alone as model: hover rows only.
    assert apart("dev/extra_mass_1") - apart("campaign/v4_m16_q2.5") == pytest.approx(3.0, abs=0.6)


def test_without_a_gauge_the_thrust_itself_is_weighed(sitl_logs):
    path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    track = read_log(path, airframe=AIRFRAME, sampling="hold").track
    blind = replace(track, tank_kg=np.full(track.time_s.size, np.nan))
    weighed = virtual_gauge(analyse(blind, physics_model(AIRFRAME)))
    steady = track.flying & (track.airspeed < 1.0) & (np.abs(track.velocity_ned[:, 2]) < 0.3)
    error = (weighed - track.tank_kg)[steady]
    assert abs(float(np.nanmedian(error))) < 0.8
    assert np.all(np.isnan(weighed[~track.flying]))


def test_a_balance_needs_a_full_window_and_forgets_over_a_pause():
    watch = BalanceWatch(seconds=40.0, end=10.0)
    for step in range(350):
        watch.add(step / 10, 10.0 - step / 1000, step / 1000, 10.0 - step / 1000)
    assert watch.balance() is None
    for step in range(350, 450):
        watch.add(step / 10, 10.0 - step / 1000, step / 1000, 10.0 - step / 1000)
    balance = watch.balance()
    assert balance is not None
    # 0.01 kg/s over the 30 s between the middles of both ends.
    assert balance.seconds == pytest.approx(30.0, abs=0.2)
    assert (balance.gauge, balance.pump, balance.thrust) == pytest.approx((0.3,) * 3, abs=0.01)
    watch.add(60.0, 9.0, 1.0, 9.0)
    assert watch.balance() is None


def test_a_balance_is_that_of_its_window_however_long_the_flight_is():
    """Of a tank that empties ever faster; some estimates are unknown for a while."""
    rng, watch = np.random.default_rng(3), BalanceWatch(seconds=40.0, end=10.0)
    time_s = np.cumsum(rng.uniform(0.05, 0.12, 4000))
    kept = np.stack([30.0 - 1e-4 * time_s**2, 1e-4 * time_s**2, 29.0 - 1e-4 * time_s**2])
    kept[2, rng.random(4000) < 0.2] = np.nan
    for row, (now_s, *values) in enumerate(zip(time_s, *kept, strict=True)):
        watch.add(now_s, *values)
        if row % 37 or now_s < 45.0:
            continue
        inside = (time_s <= now_s) & (time_s >= now_s - 40.0)
        first = inside & (time_s <= time_s[inside][0] + 10.0)
        last = inside & (time_s >= now_s - 10.0)
        gauge, pump, thrust = (np.nanmean(k[first]) - np.nanmean(k[last]) for k in kept)
        balance = watch.balance()
        assert balance is not None
        found = (balance.gauge, balance.pump, balance.thrust, balance.seconds, balance.apart_kg)
        seconds = time_s[last].mean() - time_s[first].mean()
        apart = np.nanmean((kept[2] - kept[0])[inside])
        np.testing.assert_allclose(found, (gauge, -pump, thrust, seconds, apart), atol=1e-9)
        assert balance.level_kg == kept[0, row]


@pytest.mark.parametrize(("gap", "whole"), [(5.0, True), (5.5, False)])
def test_samples_more_than_5_s_apart_are_of_two_windows(gap: float, whole: bool):
    """Of 40 s: 35 s of samples, then 10 s of them after a gap."""
    watch = BalanceWatch()
    for time_s in (*range(36), *(35.0 + gap + k for k in range(10))):
        watch.add(float(time_s), 10.0 - 0.1 * time_s, 0.1 * time_s, 10.0 - 0.1 * time_s)
    found = watch.balance()
    assert (found is not None) == whole
    if found is not None:
        assert found.gauge == pytest.approx(0.1 * found.seconds)
