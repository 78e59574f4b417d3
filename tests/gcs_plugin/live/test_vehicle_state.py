"""What a vehicle's state does with late, doubled, lost and lying frames. No clock runs here."""

import math
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame, log_frames
from thrustmargin.gcs_plugin.link.sequence import SenderWatch, Verdict
from thrustmargin.gcs_plugin.live.vehicle_state import VehicleState, fold


def after(state: VehicleState, *frames) -> VehicleState:
    for frame in frames:
        state = fold(state, frame)
    return state


def value(state: VehicleState, channel: str):
    reading = state.best(channel)
    assert reading is not None
    return reading.value


def test_folding_leaves_the_state_before_as_it_was():
    vehicle = Vehicle()
    before = after(VehicleState(system=1), *vehicle.tick())
    held = dict(before.readings)
    later = after(before, *vehicle.tick())
    assert dict(before.readings) == held
    assert later.clock_s == pytest.approx(before.clock_s + 0.1)


def test_every_reading_has_the_vehicles_time_and_the_grounds():
    vehicle = Vehicle(clock_s=50.0)
    state = after(VehicleState(system=1), *vehicle.tick())
    # ESC telemetry has no clock of its own: it has that of the last message that does.
    rpm = state.by_index("esc_rpm")[2]
    assert (rpm.value, rpm.clock_s, rpm.stamp_us) == (2000.0, 50.1, vehicle.stamp_us)
    assert value(state, "airspeed") == pytest.approx(4.0)
    assert state.by_index("named_value")["TANK"].value == pytest.approx(10.0)


def test_values_that_cannot_be_true_do_not_replace_the_last_good_one():
    vehicle = Vehicle()
    state = after(VehicleState(system=1), *vehicle.tick())
    bad = [as_frame(vehicle.speed(float("nan"))), as_frame(vehicle.speed(1e9))]
    assert value(after(state, *bad), "airspeed") == pytest.approx(4.0)


def test_an_esc_that_was_never_heard_is_unknown_and_not_stopped():
    vehicle = Vehicle()
    four = [0] * 4
    silent = dialect.MAVLink_esc_telemetry_1_to_4_message(four, four, four, four, four, four)
    state = after(VehicleState(system=1), vehicle.frame(silent))
    assert state.by_index("esc_rpm") == {}


def test_a_companion_does_not_speak_over_the_autopilot():
    vehicle, companion = Vehicle(), Vehicle()
    companion.packer.srcComponent = 191
    state = after(VehicleState(system=1), as_frame(vehicle.heartbeat()), *vehicle.tick())
    state = after(state, as_frame(companion.speed(9.0)), as_frame(companion.attitude(1.0)))
    assert value(state, "airspeed") == pytest.approx(4.0)
    # But it may add what the autopilot does not send.
    extra = dialect.MAVLink_named_value_float_message(1, b"TANK_L", 3.0)
    state = after(state, companion.frame(extra))
    assert state.by_index("named_value")["TANK_L"].value == pytest.approx(3.0)


def test_an_overtaken_clock_is_left_out_and_counted():
    vehicle = Vehicle(clock_s=100.0)
    state = after(VehicleState(system=1), *vehicle.tick())
    vehicle.clock_s -= 5.0
    late = as_frame(vehicle.attitude(roll=1.0), vehicle.stamp_us)
    vehicle.clock_s += 5.0
    state = after(state, late)
    assert (state.late, state.boot) == (1, 0)
    assert value(state, "attitude").tolist() == [0.0, 0.0, 0.0]
    state = after(state, *vehicle.tick())
    assert state.doubt is None
    assert state.clock_s == pytest.approx(100.2)


def test_a_restart_forgets_the_readings_but_not_what_is_stored_aboard():
    vehicle = Vehicle(clock_s=500.0)
    parameter = dialect.MAVLink_param_value_message(b"SERVO5_FUNCTION", 22.0, 9, 1, 0)
    state = after(VehicleState(system=1), *vehicle.tick(), vehicle.frame(parameter))
    vehicle.clock_s = 3.0
    frames = [f for _ in range(4) for f in vehicle.tick()]
    notes = []
    for frame in frames:
        state = fold(state, frame)
        notes += [state.note] if state.note else []
    assert state.boot == 1
    assert [n for n in notes if "restarted" in n] == notes
    assert len(notes) == 1
    assert state.parameters == {"SERVO5_FUNCTION": 22.0}
    assert all(r.clock_s < 5.0 for r in state.readings.values())


def test_a_clock_that_leaps_ahead_is_told_and_makes_older_readings_stale():
    vehicle = Vehicle(clock_s=100.0)
    state = after(VehicleState(system=1), *vehicle.tick())
    vehicle.clock_s += 1000.0
    state = fold(state, as_frame(vehicle.attitude(), vehicle.stamp_us + SECOND))
    assert "jumped 1000 s ahead" in state.note
    airspeed = state.best("airspeed")
    assert airspeed is not None
    assert state.now(state.stamp_us) - airspeed.clock_s > 900.0


def test_when_clocked_messages_stay_away_the_grounds_clock_carries_on():
    vehicle = Vehicle(clock_s=10.0)
    state = after(VehicleState(system=1), *vehicle.tick())
    stamp = vehicle.stamp_us
    assert state.now(stamp + SECOND // 2) == pytest.approx(10.1)
    assert state.now(stamp + 4 * SECOND) == pytest.approx(13.1)


def test_a_mission_is_overheard_whoever_uploads_it(sitl_logs):
    from thrustmargin.gcs_plugin.live.fleet import Fleet
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.physics.airframe import load_airframe

    fleet = Fleet(physics_model(load_airframe("topxgun-f16-sitl")))
    fleet.take(log_frames(sitl_logs / "campaign" / "v4_m16_q2.5.tlog")[:2000])
    assert list(fleet.vehicles) == [1]
    mission = fleet.vehicles[1].state.mission
    assert sorted(mission) == list(range(29))
    assert mission[1].command == 22
    assert mission[3].latitude_deg == pytest.approx(36.6500898)


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


def test_a_state_before_anything_was_heard_knows_nothing():
    state = VehicleState(system=1)
    assert math.isnan(state.clock_s)
    assert state.best("airspeed") is None
