"""A flight analysed window by window, as it is live, gives what it gives in one piece."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.forward_flight import ForwardFlight

F16 = load_airframe("topxgun-f16-sitl")
BEGAN = 1.7e9  # Unix time
DRAG = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=6.0)
EFFECTS = CATALOGUE

#: Its motion is made to excite every effect, and is that of no body.
GIVEN = AirframeMatch()


def carrier(effect: Effect) -> Airframe:
    """The F16; without its tank for a load on a cable, which a tank carrier does not have."""
    return replace(F16, tank_volume_l=0.0) if effect.name == "slung_load" else F16


def recorded(effect: Effect) -> EffectRecord:
    """The effect with values off those at which it does nothing."""
    values = {p.name: p.start + 0.4 * p.scale for p in effect.parameters}
    values |= {"onset_time": 14.0} if "onset_time" in values else {}
    values |= {"onset_clock": BEGAN + 14.0} if "onset_clock" in values else {}
    return EffectRecord(
        name=effect.name,
        variant=effect.variant,
        rotor=2 if effect.of_one_rotor else None,
        parameters={
            p.name: Identified(value=values[p.name], unit=p.unit, ci95=(0.0, 0.0))
            for p in effect.parameters
        },
    )


def having(effect: Effect) -> RotorModel:
    base = replace(physics_model(carrier(effect)), forward_flight=DRAG)
    return replace(base, effects=(recorded(effect),))


def lively(seconds: float = 30.0) -> FlightTrack:
    """A flight that reports every channel, in rows not quite 0.1 s apart."""
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, seconds, 0.1)
    time_s[1:] += rng.uniform(-0.002, 0.002, time_s.size - 1)

    def waves(columns: int, size: float) -> np.ndarray:
        rate, phase = rng.uniform(0.5, 3.0, columns), rng.uniform(0, 6.0, columns)
        return size * np.sin(time_s[:, None] * rate + phase)

    velocity = waves(3, 3.0)
    wind = np.tile([1.0, -0.5, 0.0], (time_s.size, 1))
    return FlightTrack.of(
        name="lively",
        time_s=time_s,
        rotor_count=4,
        start_unix_s=BEGAN,
        velocity_ned=velocity,
        wind_ned=wind,
        airspeed=np.hypot(*(velocity - wind)[:, :2].T),
        attitude=waves(3, 0.2),
        angular_rate_frd=waves(3, 0.5),
        specific_force_frd=waves(3, 1.5) + np.array([0.0, 0.0, -9.8]),
        tank_kg=10.0 - 0.05 * time_s,
        rotor_speed_rpm=2000.0 + waves(4, 50.0),
        voltage=56.0 - 0.05 * time_s,
        pressure=101_000.0 + waves(1, 20.0)[:, 0],
        altitude=30.0 + waves(1, 2.0)[:, 0],
        height_agl=3.0 + waves(1, 1.0)[:, 0],
    )


def row_at(track: FlightTrack, time_s: float) -> int:
    return int(np.clip(np.searchsorted(track.time_s, time_s), 0, track.time_s.size - 1))


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.key)
def test_a_flight_in_windows_is_the_flight_in_one_piece(effect):
    track, model = lively(), having(effect)
    whole = analyse(track, model, airframe_match=GIVEN)
    assert np.isfinite(whole.prediction.rotor_speed_rpm[30:-30]).all()
    plain = analyse(track, replace(model, effects=()), airframe_match=GIVEN)
    moved = whole.prediction.rotor_speed_rpm - plain.prediction.rotor_speed_rpm
    assert np.abs(moved).max() > 1.0  # rpm: or the test would say nothing
    done = analyse(track.rows(slice(0, row_at(track, 6.3))), model, airframe_match=GIVEN)
    first, rng = 0, np.random.default_rng(3)
    for cut in np.cumsum(rng.uniform(1.0, 4.0, 8)) + 4.0:
        begins = row_at(track, cut - model.look_back_s)
        state = done.state_at(max(begins, first) - first)
        first = max(begins, first)
        ends = row_at(track, cut + 4.0 + model.look_ahead_s)
        done = analyse(track.rows(slice(first, ends)), model, start=state, airframe_match=GIVEN)
        judged = slice(row_at(track, cut) + 1, row_at(track, cut + 3.9))
        here = slice(judged.start - first, judged.stop - first)
        for of in ("rotor_speed_rpm", "thrust"):
            np.testing.assert_allclose(
                getattr(done.prediction, of)[here],
                getattr(whole.prediction, of)[judged],
                atol=1e-9 * 2000.0,
                rtol=0,
            )


def test_the_state_of_a_row_that_is_not_there_is_refused():
    analysis = analyse(lively(5.0), having(EFFECTS[0]), airframe_match=GIVEN)
    with pytest.raises(IndexError):
        analysis.state_at(50)


def test_how_far_a_model_looks_follows_from_its_effects():
    by_key = {effect.key: effect for effect in EFFECTS}
    assert (physics_model(F16).look_back_s, physics_model(F16).look_ahead_s) == (0.0, 0.0)
    assert having(by_key["extra_mass"]).look_ahead_s == 0.0
    turning, loaded = having(by_key["manoeuvre_moment"]), having(by_key["load_factor"])
    assert 0.5 <= turning.look_ahead_s < loaded.look_ahead_s < 2.5
    late = having(by_key["sensor_lag:rotor speed"])
    assert late.look_back_s > late.look_ahead_s
