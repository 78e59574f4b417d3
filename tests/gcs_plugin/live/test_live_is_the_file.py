"""A recording fed to the live path in pieces of any size gives what the file's reader gives.

What may differ, and why it cannot be known in time, is listed in `live.vehicle_telemetry`; in these
recordings only `position_ned` before take-off, until when home may still move.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.gcs_plugin.live.live_vehicle import ROOT, log_frames
from tests.gcs_plugin.live.monitored import AIRFRAME
from thrustmargin.gcs_plugin.live.alarms import Alarms
from thrustmargin.gcs_plugin.live.tank_balance import virtual_gauge
from thrustmargin.gcs_plugin.live.vehicle_monitor import VehicleMonitor, WatchSettings
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.flight import TRACK_CHANNELS
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel, physics_model

LOGS = ("campaign/v4_m16_q2.5", "onset/worn_prop_onset", "dev/climb_1", "dev/windy_1")
#: Alarms that rest on rows alone: the others need the mission, or the ground's clock.
OF_ROWS = ("margin", "rotor", "envelope", "saturation")


@cache
def recorded(name: str):
    """Its frames, and its rows as the file's reader has them."""
    path = ROOT / "sitl_logs" / f"{name}.tlog"
    frames = [f for f in log_frames(path) if f.system == 1]
    return frames, read_log(path, airframe=AIRFRAME, sampling="hold").track


def having(effects, track) -> RotorModel:
    """A model with the effects, each with values off those at which it does nothing.

    A load on a cable hangs below an aircraft without a tank. What begins, begins in mid-flight.
    """
    onset = {"onset_time": 100.0, "onset_clock": (track.start_unix_s or 0.0) + 100.0}
    records = tuple(
        EffectRecord(
            name=effect.name,
            variant=effect.variant,
            rotor=2 if effect.of_one_rotor else None,
            parameters={
                p.name: Identified(
                    value=onset.get(p.name, p.start + 0.4 * p.scale),
                    unit=p.unit,
                    ci95=(0.0, 0.0),
                )
                for p in effect.parameters
            },
        )
        for effect in effects
    )
    carries = any(effect.name == "slung_load" for effect in effects)
    airframe = replace(AIRFRAME, tank_volume_l=0.0) if carries else AIRFRAME
    return replace(physics_model(airframe), effects=records)


def live(frames, model, cuts):
    """Every update of the frames, cut at `cuts`."""
    monitor = VehicleMonitor(1, model, WatchSettings())
    made = []
    for first, end in zip([0, *cuts], [*cuts, len(frames)], strict=True):
        for frame in frames[first:end]:
            monitor.take(frame)
        made += monitor.updates()
    return made + monitor.updates(final=True)


def events(found):
    return [
        (e.raised, e.alarm.name, e.alarm.rotor, round(e.time_s, 6))
        for e in found
        if e.alarm.name in OF_ROWS
    ]


def assert_the_same(frames, track, model, cuts):
    made = live(frames, model, cuts)
    whole = analyse(track, model)
    rows = np.concatenate([u.clock_s[u.first :] for u in made])
    assert rows.size == track.time_s.size
    time_s = np.concatenate([u.analysis.track.time_s[u.first :] for u in made])
    np.testing.assert_array_equal(time_s, track.time_s)
    for channel in (*TRACK_CHANNELS, "flying"):
        ours = np.concatenate([getattr(u.analysis.track, channel)[u.first :] for u in made])
        theirs = getattr(track, channel)
        if channel == "position_ned":
            after = int(np.argmax(track.flying))
            ours, theirs = ours[after:], theirs[after:]
        np.testing.assert_array_equal(ours, theirs, err_msg=channel)
    final = [slice(u.unsettled, u.settled) for u in made]
    for name in ("rotor_speed_rpm", "thrust"):
        ours = [getattr(u.analysis.prediction, name)[s] for u, s in zip(made, final, strict=True)]
        theirs = getattr(whole.prediction, name)
        np.testing.assert_allclose(np.concatenate(ours), theirs, rtol=1e-9, atol=1e-6)
    for name in ("margin", "redundancy_yaw_uncontrolled"):
        ours = np.concatenate([getattr(u.analysis, name)[u.first :] for u in made])
        np.testing.assert_allclose(ours, getattr(whole, name), rtol=1e-9, atol=1e-9)
    alarms = Alarms()
    nothing = np.full(track.time_s.size, np.nan)
    clock_s = track.time_s + rows[0]
    of_file = alarms.rows(
        whole, 0, clock_s=clock_s, pumped_kg=nothing, virtual_kg=virtual_gauge(whole)
    )
    assert sorted(events(e for u in made for e in u.events)) == sorted(events(of_file))


@settings(
    max_examples=4,
    deadline=None,
    phases=[Phase.generate],  # a smaller example of a whole flight tells no more
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_any_recording_in_any_pieces_with_any_effects_is_as_its_file(data):
    name = data.draw(st.sampled_from(LOGS))
    effects = data.draw(
        st.lists(st.sampled_from(CATALOGUE), max_size=3, unique_by=lambda e: e.name)
    )
    frames, track = recorded(name)
    count = data.draw(st.integers(20, 200))
    seed = data.draw(st.integers(0, 2**32 - 1))
    # A piece at least every second or so, as the monitor has them; and some of a few frames.
    cuts = np.random.default_rng(seed).choice(np.arange(1, len(frames)), count, replace=False)
    assert_the_same(frames, track, having(effects, track), sorted(cuts.tolist()))


@pytest.mark.slow
@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_each_effect_is_live_what_it_is_in_the_file(effect):
    frames, track = recorded("campaign/v4_m16_q2.5")
    cuts = list(range(40, len(frames), 97))
    assert_the_same(frames, track, having([effect], track), cuts)
