"""A recording fed to the live path in pieces of any size gives what the file's reader gives.

What may differ, and why it cannot be known in time, is listed in `live.vehicle_telemetry`. Here
that is `position_ned` before take-off, until when home may still move; and what comes before the
parameters of the outputs and before the first GPS time, which the file knows from its start on.
All alarms are compared but `telemetry` and `rotor speeds`, which follow the ground's clock between
messages and have no rows.
"""

import struct
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import ROOT, as_frame, log_frames, write_log
from tests.gcs_plugin.live.monitored import AIRFRAME
from tests.gcs_plugin.logs.log_files import with_rotor_speeds
from tests.made_sources import sent
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.tank_balance import virtual_gauge
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState, fold
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows
from thrustmargin.gcs_plugin.live.watch.outlook import LookAhead
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.tlog import tlog_boots
from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap, motor_map
from thrustmargin.gcs_plugin.telemetry.rows import FlightRows, flight_rows
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best, last_before, mavlink_signals
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe

LOGS = ("campaign/v4_m16_q2.5", "onset/worn_prop_onset", "dev/climb_1", "dev/windy_1")
#: Of the parameters, those that rows depend on.
OF_ROWS = ("SERVO", "MOT_PWM", "FRAME_CLASS", "BATT", "ARSPD", "WP", "RC3_", "RCMAP")
OF_MISSION = {"MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_COUNT"}
OF_MISSION |= {"MISSION_CLEAR_ALL", "MISSION_ACK"}
EFFECTS = {effect.key: effect for effect in CATALOGUE}
#: A swinging load takes as long as all others together, and has a test below.
APART = [effect for effect in CATALOGUE if effect.name != "slung_load"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """Frames of vehicle 1 and of its ground station, and what the file's readers make of them."""

    frames: list[Frame]
    airframe: Airframe
    track: FlightTrack
    rows: FlightRows
    motors: MotorMap
    signals: Signals
    state: VehicleState
    said_us: int  # ground's clock when the last parameter that counts was first heard
    gps_us: int  # when the first GPS time was


@cache
def recorded(name: str, count: int | None = None) -> Recorded:
    """The first `count` frames of a recording of this repository, in which an ESC fails."""
    frames = log_frames(ROOT / "sitl_logs" / f"{name}.tlog")[:count]
    return as_recorded(with_esc_reports(frames), AIRFRAME)


def with_esc_reports(frames: list[Frame]) -> list[Frame]:
    """The frames with reports of the ESCs on themselves: the third fails in the middle."""
    found = []
    for number, frame in enumerate(frames):
        found.append(frame)
        if number % 50 == 0:
            fails = 0.4 < number / len(frames) < 0.6
            found.append(esc_report(number // 50 % 256, frame.stamp_us, 16 * fails))
    return found


def esc_report(sequence: int, stamp_us: int, flags: int) -> Frame:
    """ESC_INFO of component 42, which pymavlink's dialect lacks."""
    layout = next(m for m in layouts().values() if m.name == "ESC_INFO")
    payload = np.zeros(1, layout.dtype)
    payload["time_usec"], payload["failure_flags"][0, 2], payload["info"] = stamp_us, flags, 15
    body = struct.pack("<8B", layout.dtype.itemsize, 0, 0, sequence, 1, 42, 290 % 256, 290 // 256)
    body += b"\0" + payload.tobytes()
    crc = dialect.x25crc(body)
    crc.accumulate(bytes([layout.crc_extra]))
    return as_frame(b"\xfd" + body + struct.pack("<H", crc.crc), stamp_us)


def as_recorded(frames: list[Frame], airframe: Airframe) -> Recorded:
    """Frames written to a file and read again."""
    options = Options(airframe=airframe, sampling="hold")
    with tempfile.TemporaryDirectory() as folder:
        path = write_log(Path(folder) / "flight.tlog", frames)
        track = read_log(path, airframe=airframe, sampling="hold", vehicle=1).track
        recording = next(tlog_boots(path, vehicle=1, on_arrival=True))
    signals = mavlink_signals(dict(recording.streams), sent("VFR_HUD"))
    facts = vehicle_facts(recording.parameters, mav_type=recording.mav_type)
    motors = motor_map("flight", recording.parameters, signals, airframe, facts=facts)
    rows = flight_rows(signals, motors, recording.parameters, options)
    assert rows is not None
    state, said_us, gps_us = VehicleState(system=1), 0, 0
    for frame in (f for f in frames if f.system == 1):
        before, state = state, fold(state, frame)
        new = [n for n in state.parameters if n not in before.parameters]
        if any(n.startswith(OF_ROWS) for n in new) or state.component != before.component:
            said_us = frame.stamp_us
        if not gps_us and layouts()[frame.id].name == "SYSTEM_TIME":
            gps_us = frame.stamp_us
    mission = {w.number: w for w in recording.waypoints}
    return Recorded(
        frames=frames,
        airframe=airframe,
        track=track,
        rows=rows,
        motors=motors,
        signals=signals,
        state=replace(state, mission=mission),
        said_us=said_us,
        gps_us=gps_us,
    )


def having(effects, flight: Recorded) -> RotorModel:
    """A model with the effects, each with values off those at which it does nothing.

    What begins, begins in mid-flight.
    """
    middle = flight.track.duration / 2
    start_s: float = flight.track.start_unix_s or 0.0
    onset: dict[str, float] = {"onset_time": middle, "onset_clock": start_s + middle}
    records = tuple(
        EffectRecord(
            name=effect.name,
            variant=effect.variant,
            rotor=2 if effect.of_one_rotor else None,
            parameters={
                p.name: Identified(
                    value=float(onset.get(p.name, p.start + 0.4 * p.scale) or 0.0),
                    unit=p.unit,
                    ci95=(0.0, 0.0),
                )
                for p in effect.parameters
            },
        )
        for effect in effects
    )
    return replace(physics_model(flight.airframe), effects=records)


def live(frames, model, cuts):
    """Every update of the frames, cut at `cuts`."""
    monitor = VehicleMonitor(1, model, WatchSettings())
    made = []
    for first, end in zip([0, *cuts], [*cuts, len(frames)], strict=True):
        for frame in frames[first:end]:
            if frame.system == 1:
                monitor.take(frame)
            elif layouts()[frame.id].name in OF_MISSION and fields(frame) is not None:
                monitor.overhear(frame)
        made += monitor.updates()
    return made + monitor.updates(final=True)


def of_file(flight: Recorded, model: RotorModel):
    """The analysis of the whole file, and its alarms."""
    whole, rows = analyse(flight.track, model), flight.rows
    item = best(flight.signals, "mission_item")
    nowhere = np.full(rows.clock_s.size, np.nan)
    new = LiveRows(
        boot=0,
        track=flight.track,
        clock_s=rows.clock_s,
        stamp_us=np.zeros(rows.clock_s.size, dtype=np.int64),
        pump_share=rows.pump_share,
        pumped_kg=rows.pumped_kg,
        mission_item=nowhere if item is None else last_before(item, rows.clock_s),
        esc_failures=flight.motors.failures(flight.signals, rows.clock_s),
        notes=(),
    )
    delivered, ahead = LookAhead(model).rows(whole, 0, new, flight.state)
    events = Alarms().rows(
        whole,
        0,
        clock_s=rows.clock_s,
        pumped_kg=delivered,
        virtual_kg=virtual_gauge(whole),
        margin_ahead=ahead,
        esc_failures=new.esc_failures,
    )
    return whole, events


def events_of(found):
    """Of all alarms but that of messages that do not come: a file's rows have no messages."""
    return sorted(
        (e.time_s, e.alarm.name, e.alarm.rotor or 0, e.raised)
        for e in found
        if e.alarm.name != "rotor speeds"
    )


def assert_the_same(flight: Recorded, model: RotorModel, cuts) -> set[str]:
    """Compare all, and return the names of the alarms that were raised."""
    track, made = flight.track, live(flight.frames, model, cuts)
    whole, alarms = of_file(flight, model)
    time_s = np.concatenate([u.analysis.track.time_s[u.first :] for u in made])
    np.testing.assert_array_equal(time_s, track.time_s)
    assert made[-1].analysis.track.start_unix_s == pytest.approx(track.start_unix_s, abs=1e-6)
    stamp_us = np.concatenate([u.stamp_us[u.first :] for u in made])
    said = int(np.searchsorted(stamp_us, flight.said_us))
    timed = int(np.searchsorted(stamp_us, flight.gps_us)) if needs_unix_time(model) else 0
    takeoff = int(np.argmax(track.flying))
    assert max(said, timed) < 0.3 * time_s.size
    for channel in (*TRACK_CHANNELS, "flying"):
        ours = np.concatenate([getattr(u.analysis.track, channel)[u.first :] for u in made])
        since = max(said, takeoff) if channel == "position_ned" else said
        theirs = getattr(track, channel)
        np.testing.assert_array_equal(ours[since:], theirs[since:], err_msg=channel)
    final = [slice(u.unsettled, u.settled) for u in made]
    since = max(said, timed)
    for name in ("rotor_speed_rpm", "thrust", "basis"):
        ours = np.concatenate(
            [getattr(u.analysis.prediction, name)[s] for u, s in zip(made, final, strict=True)]
        )
        theirs = getattr(whole.prediction, name)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours[since:], theirs[since:], rtol=1e-9, atol=1e-6)
    for name in ("margin", "redundancy_yaw_uncontrolled"):
        ours = np.concatenate([getattr(u.analysis, name)[u.first :] for u in made])
        theirs = getattr(whole, name)
        np.testing.assert_allclose(ours[said:], theirs[said:], rtol=1e-9, atol=1e-9)
    assert events_of(e for u in made for e in u.events) == events_of(alarms)
    return {e.alarm.name for e in alarms}


def needs_unix_time(model: RotorModel) -> bool:
    return any("onset_clock" in record.parameters for record in model.effects)


@pytest.mark.slow
@settings(
    max_examples=2,
    deadline=None,
    phases=[Phase.generate],  # a smaller example of a whole flight tells no more
    suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large),
)
@given(data=st.data())
def test_any_recording_in_any_pieces_with_any_effects_is_as_its_file(data):
    flight = recorded(data.draw(st.sampled_from(LOGS)), 5000)
    effects = data.draw(st.lists(st.sampled_from(APART), max_size=3, unique_by=lambda e: e.name))
    count, seed = data.draw(st.integers(20, 100)), data.draw(st.integers(0, 2**32 - 1))
    # A piece every few seconds; and some of a few frames.
    places = np.arange(1, len(flight.frames))
    cuts = np.random.default_rng(seed).choice(places, count, replace=False)
    assert_the_same(flight, having(effects, flight), sorted(cuts.tolist()))


@pytest.mark.parametrize(
    "keys",
    [
        pytest.param(("thrust_drift", "slung_load:cable of 44 to 65 arms"), marks=pytest.mark.slow),
        ("rotor_degradation:since",),
    ],
    ids=" and ".join,
)
def test_what_grows_swings_or_begins_in_flight_does_so_live(keys):
    flight = recorded("dev/windy_1", 5000)
    cuts = list(range(40, len(flight.frames), 300))
    raised = assert_the_same(flight, having([EFFECTS[key] for key in keys], flight), cuts)
    assert raised >= {"margin", "esc", "margin ahead"}  # what is compared did happen


def with_faults(speeds: np.ndarray) -> np.ndarray:
    """Rotor 2 reads zero for a while, 3 repeats a value, 1 and 4 have a lone one; all in flight."""
    bad = speeds.copy()
    bad[500:560, 1] = 0
    bad[600:700, 2] = bad[600, 2]
    bad[720, 0], bad[730, 3] = 65535, 0
    return bad


@pytest.mark.slow
@pytest.mark.parametrize("step", [31, 150])
def test_readings_that_are_no_measurement_are_none_live_too(tmp_path, step):
    path = tmp_path / "faults.tlog"
    path.write_bytes(with_rotor_speeds(ROOT / "sitl_logs/dev/windy_1.tlog", with_faults))
    flight = as_recorded(log_frames(path)[:5500], AIRFRAME)
    speeds = flight.track.rotor_speed_rpm
    assert np.isnan(speeds[510:555, 1]).all()
    assert np.isnan(speeds[640:695, 2]).all()
    assert np.isfinite(speeds[300:490]).all()
    assert np.nanmax(speeds) < 4000
    assert_the_same(flight, having([], flight), list(range(40, len(flight.frames), step)))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(8))
def test_each_effect_is_live_what_it_is_in_the_file(first):
    """Eight models with every eighth effect, so that those of one name are apart."""
    flight = recorded("campaign/v4_m16_q2.5", 5000)
    cuts = list(range(40, len(flight.frames), 300))
    assert_the_same(flight, having(APART[first::8], flight), cuts)
