"""What a vehicle's state does with late, doubled, lost and lying frames. No clock runs here."""

import math
import random
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import (
    SECOND,
    Vehicle,
    as_frame,
    live_rows,
    log_frames,
)
from tests.gcs_plugin.live.monitored import AIRFRAME
from thrustmargin.gcs_plugin.link.sequence import SenderWatch, Verdict
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState, fold
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import VehicleTelemetry
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.models.flight import FlightTrack


def after(*frames) -> VehicleTelemetry:
    telemetry = VehicleTelemetry(1, Options(airframe=AIRFRAME, sampling="hold"))
    for frame in frames:
        telemetry.take(frame)
    telemetry.rows()
    return telemetry


def track(*frames) -> FlightTrack:
    rows, _ = live_rows(frames, AIRFRAME)
    assert rows is not None
    return rows.track


def test_folding_leaves_the_state_before_as_it_was():
    vehicle = Vehicle()
    before = fold(VehicleState(system=1), as_frame(vehicle.heartbeat()))
    parameter = dialect.MAVLink_param_value_message(b"SERVO5_FUNCTION", 22.0, 9, 1, 0)
    later = fold(before, vehicle.frame(parameter))
    assert dict(before.parameters) == {}
    assert dict(later.parameters) == {"SERVO5_FUNCTION": 22.0}
    assert (later.component, later.autopilot, later.kind, later.armed) == (1, 3, 2, True)


@pytest.mark.parametrize("count", [1000, -1])
def test_whole_numbers_of_px4_are_its_bits_and_of_ardupilot_a_number(count):
    """A saturated output in every row came of PWM_MAIN_MIN1 read as 1.4e-42."""
    vehicle = Vehicle()
    bits = struct.unpack("<f", struct.pack("<i", count))[0]
    state = VehicleState(system=1)
    for k, value in enumerate((bits, float(count))):
        name = f"PWM_MAIN_MIN{k + 1}".encode()
        state = fold(
            state, vehicle.frame(dialect.MAVLink_param_value_message(name, value, 6, 9, k))
        )
    assert dict(state.parameters) == {"PWM_MAIN_MIN1": count, "PWM_MAIN_MIN2": count}


def test_values_that_cannot_be_true_do_not_replace_the_last_good_one():
    vehicle = Vehicle()
    frames = vehicle.tick()
    frames += [as_frame(vehicle.speed(v), vehicle.stamp_us) for v in (float("nan"), 1e9)]
    assert track(*frames, *vehicle.tick()).airspeed[-1] == pytest.approx(4.0)


def test_an_esc_that_was_never_heard_is_unknown_and_not_stopped():
    vehicle = Vehicle()
    four = [0] * 4
    silent = dialect.MAVLink_esc_telemetry_1_to_4_message(four, four, four, four, four, four)
    frames = [as_frame(vehicle.attitude(), 1), as_frame(vehicle.pack(silent), 2)]
    assert np.isnan(track(*frames).rotor_speed_rpm).all()


def test_a_companion_does_not_speak_over_the_autopilot():
    vehicle, companion = Vehicle(), Vehicle()
    companion.packer.srcComponent = 191
    stamp = vehicle.stamp_us
    frames = [as_frame(vehicle.heartbeat(), stamp), *vehicle.tick()]
    # But it may add what the autopilot does not send.
    extra = dialect.MAVLink_named_value_float_message(1, b"TANK_L", 3.0)
    others = [companion.speed(9.0), companion.attitude(1.0), companion.pack(extra)]
    frames += [as_frame(data, vehicle.stamp_us) for data in others]
    heard = track(*frames, *vehicle.tick())
    assert heard.airspeed[-1] == pytest.approx(4.0)
    assert np.all(heard.attitude[:, 0] == 0.0)


def test_an_overtaken_clock_is_left_out_and_counted():
    vehicle = Vehicle(clock_s=100.0)
    frames = vehicle.tick()
    vehicle.clock_s -= 5.0
    frames.append(as_frame(vehicle.attitude(roll=1.0), vehicle.stamp_us))
    vehicle.clock_s += 5.0
    frames += vehicle.tick()
    telemetry = after(*frames)
    assert (telemetry.clock.late, telemetry.clock.boot) == (1, 0)
    assert np.all(track(*frames).attitude[:, 0] == 0.0)
    assert telemetry.clock.now_s(vehicle.stamp_us) == pytest.approx(100.2)


def test_a_restart_forgets_the_readings_but_not_what_is_stored_aboard():
    vehicle = Vehicle(clock_s=500.0)
    parameter = dialect.MAVLink_param_value_message(b"SERVO5_FUNCTION", 22.0, 9, 1, 0)
    frames = [*vehicle.tick(), vehicle.frame(parameter)]
    vehicle.clock_s = 3.0
    frames += [f for _ in range(4) for f in vehicle.tick()]
    telemetry = after(*frames)
    assert telemetry.clock.boot == 1
    assert len(telemetry.events) == 1
    (at_us, words), seen_us = telemetry.events[0], frames[-1].stamp_us - 3 * SECOND // 10
    assert (at_us, words.split(":")[0]) == (seen_us, "the vehicle restarted")
    assert telemetry.state.parameters == {"SERVO5_FUNCTION": 22.0}


def test_a_clock_that_leaps_ahead_is_reported_and_makes_older_readings_stale():
    vehicle = Vehicle(clock_s=100.0)
    frames = vehicle.tick()
    vehicle.clock_s += 1000.0
    stamp = vehicle.stamp_us + SECOND
    telemetry = after(*frames, as_frame(vehicle.attitude(), stamp))
    assert telemetry.events[0][0] == stamp
    assert "jumped 1000 s ahead" in telemetry.events[0][1]
    assert telemetry.stale()["airspeed"] > 900.0


def test_when_clocked_messages_stay_away_the_grounds_clock_carries_on():
    vehicle = Vehicle(clock_s=10.0)
    telemetry = after(*vehicle.tick())
    stamp = vehicle.stamp_us
    assert telemetry.clock.now_s(stamp + SECOND // 2) == pytest.approx(10.2)
    assert telemetry.clock.now_s(stamp + 4 * SECOND) == pytest.approx(13.2)


def test_a_mission_is_overheard_whoever_uploads_it(sitl_logs):
    from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.physics.airframe import load_airframe

    fleet = Fleet(physics_model(load_airframe("topxgun-f16-sitl")))
    fleet.take(log_frames(sitl_logs / "campaign" / "v4_m16_q2.5.tlog")[:2000])
    assert list(fleet.vehicles) == [1]
    mission = fleet.vehicles[1].state.mission
    assert sorted(mission) == list(range(29))
    assert mission[1].command == 22
    assert mission[3].parameters[4] == pytest.approx(36.6500898)


def verdicts(sequence, watch: SenderWatch | None = None) -> tuple[SenderWatch, list[Verdict], int]:
    """Frames by number, each with bytes of its own; how often two senders were seen."""
    watch = watch or SenderWatch()
    given, shared = [], 0
    for turn, number in enumerate(sequence):
        given.append(watch.look(number % 256, turn.to_bytes(4, "big")))
        shared += watch.shared
    return watch, given, shared


def test_a_clean_sender_is_neither_late_nor_lossy_nor_two():
    watch, given, shared = verdicts(range(3000))
    assert set(given) == {Verdict.NEW}
    assert (watch.missing, watch.late, watch.doubled, shared) == (0, 0, 0, 0)


@pytest.mark.parametrize("loss", [0.02, 0.2, 0.5])
def test_lost_frames_are_counted_and_are_never_taken_for_two_vehicles(loss):
    random.seed(1)
    kept = [n for n in range(20_000) if random.random() > loss]
    watch, _, shared = verdicts(kept)
    assert watch.missing == pytest.approx(20_000 - len(kept), abs=30)
    assert shared == 0


def test_frames_that_were_overtaken_are_late_and_not_missing():
    order = list(range(2000))
    for at in range(0, 1990, 10):
        order[at], order[at + 1] = order[at + 1], order[at]
    watch, given, shared = verdicts(order)
    assert given.count(Verdict.LATE) == watch.late == 199
    assert (watch.missing, shared) == (0, 0)


def test_a_doubled_frame_is_used_once_even_out_of_turn():
    watch = SenderWatch()
    first, second = watch.look(1, b"a"), watch.look(2, b"b")
    assert [first, second, watch.look(1, b"a"), watch.look(2, b"b")] == [
        Verdict.NEW,
        Verdict.NEW,
        Verdict.DOUBLED,
        Verdict.DOUBLED,
    ]
    # The same bytes a whole count later are a new message that says the same.
    _, given, _ = verdicts(range(3, 258), watch)
    assert set(given) == {Verdict.NEW}
    assert watch.look(1, b"a") is Verdict.NEW
    assert watch.doubled == 2


@pytest.mark.parametrize("apart", [1, 10, 77, 128, 200])
@pytest.mark.parametrize("burst", [1, 4])
def test_two_senders_of_one_id_are_found_out(apart, burst):
    random.seed(apart)
    one, two = iter(range(3000)), iter(range(apart, 3000 + apart))
    mixed = [
        number
        for _ in range(400)
        for side in (one, two)
        for number in [next(side) for _ in range(random.randint(1, burst))]
        if random.random() > 0.05
    ]
    _, _, shared = verdicts(mixed)
    assert shared > 0.8 * len(mixed)


def test_before_anything_was_heard_nothing_is_known():
    telemetry = after()
    assert math.isnan(telemetry.clock.now_s(0))
    assert telemetry.rows() == []
    assert telemetry.stale() == {}
