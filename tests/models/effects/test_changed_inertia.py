"""An aircraft that turns by another inertia than its model has, from the law to the new model."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, NOISE_RPM, curve_model, made_flight, table
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_sentence
from thrustmargin.models.effects.base import Effect, Values
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.model_update import update_model
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.margin import mixer

#: As the code has them, written down by hand: a change there is to be seen here.
USUAL_ARM = 0.9595439
USUAL_MASS = 21.1

TURNING = known_effect("manoeuvre_moment")
HAS = {
    **{p.name: p.start for p in TURNING.parameters},
    **{"inertia_roll": 1.5, "inertia_pitch": 1.6, "inertia_yaw": 3.0},
    **{"damping_yaw": 0.4, "load_exponent": 0.0, "derivative_correction_yaw": 0.0, "lag": 0.0},
}


def change_of(*has: Values, scatter: dict[str, float] | None = None) -> Effect:
    assert TURNING.change is not None
    change = TURNING.change(TURNING, has or (HAS,), scatter or {})
    assert change is not None
    return change


def kept(share: float, *has: Values) -> Values:
    """What a model keeps of a change by a share."""
    kept_as = change_of(*has).kept_as
    assert kept_as is not None
    return kept_as({"share": share})


def knowing(width: float = 0.02) -> RotorModel:
    """Weight and thrust curve with the moments of turning of `HAS`, known to a part."""
    parameters = {
        p.name: Identified(
            value=HAS[p.name],
            unit=p.unit,
            ci95=(HAS[p.name] * (1 - width), HAS[p.name] * (1 + width)),
        )
        for p in TURNING.parameters
    }
    record = EffectRecord(name=TURNING.name, rotor=None, parameters=parameters)
    return replace(curve_model(), effects=(record,))


def turned(seed: int, times: float) -> FlightTrack:
    """A flight that turns its nose to and fro, with so many times the inertia that `HAS` has.

    Moment = I d(rate)/dt + damping x rate, shared by the rotors as the mixer's inverse does.
    """
    track = made_flight(seed, tank_kg=14.0 - 2.0 * seed, duration=120.0)
    t, way = track.time_s, 2.0 * np.pi / (6.0 + seed)
    rate, faster = 0.9 * np.sin(way * t), 0.9 * way * np.cos(way * t)
    moment = times * (HAS["inertia_yaw"] * faster + HAS["damping_yaw"] * rate)
    thrust = F16.thrust_coefficient * track.rotor_speed_rpm**2
    thrust = thrust + moment[:, None] * np.linalg.pinv(mixer(F16))[:, 3]
    rpm = np.round(np.sqrt(thrust / F16.thrust_coefficient))
    angular = np.column_stack([track.angular_rate_frd[:, :2], rate])
    return replace(track, angular_rate_frd=angular, rotor_speed_rpm=rpm)


def test_a_change_is_a_share_of_all_moments_that_the_model_has():
    change = change_of()
    assert (change.name, change.key) == ("manoeuvre_moment", "manoeuvre_moment:changed")
    (share,) = change.parameters
    assert (share.name, share.start, share.absent, share.lower) == ("share", 0.0, 0.0, -1.0)
    assert change.looks({"share": 0.3}) == TURNING.looks(HAS)
    assert change.change is None
    half = kept(0.5)
    assert half["inertia_yaw"] == 1.5
    assert half["inertia_roll"] == 0.75
    assert half["damping_yaw"] == 0.2
    assert (
        half["derivative_correction_tilt"] == HAS["derivative_correction_tilt"]
    )  # a shape is as it was


def test_a_model_that_was_changed_before_changes_by_a_share_of_the_whole():
    assert kept(-0.2, HAS, kept(0.5))["inertia_yaw"] == pytest.approx(-0.2 * 4.5)


def test_what_is_no_moment_is_kept_as_the_model_first_had_it():
    other = {**HAS, "lag": 0.3, "inertia_yaw": 1.0}
    assert kept(0.5, HAS, other)["lag"] == HAS["lag"]
    assert kept(0.5, other, HAS)["lag"] == 0.3


def test_the_inertia_stays_between_none_and_that_of_all_mass_at_the_rotors():
    (share,) = change_of().parameters
    assert (1.0 + share.upper) * HAS["inertia_yaw"] == pytest.approx(USUAL_MASS * USUAL_ARM**2)
    (large,) = change_of({**HAS, "inertia_yaw": 18.0}).parameters
    assert large.upper == 1.0  # twice what it has is always possible
    assert TURNING.change is not None  # but not of an inertia that is none
    assert TURNING.change(TURNING, [{**HAS, "inertia_yaw": 0.0}], {}) is None
    assert TURNING.change(TURNING, [{**HAS, "inertia_yaw": 0.01}], {}) is not None


@pytest.mark.parametrize(("shown", "scatter"), [(None, 0.2), (0.6, 0.6), (0.0, 0.1)])
def test_sound_flights_scatter_as_good_ones_showed_and_not_by_nothing(shown, scatter):
    known = {} if shown is None else {"manoeuvre_moment.inertia_yaw": shown}
    (share,) = change_of(scatter=known).parameters
    assert share.smallest == pytest.approx(scatter / HAS["inertia_yaw"])


def test_a_heavier_boom_is_found_described_and_kept_in_the_new_model():
    flights = [turned(k, 1.5) for k in range(4)]
    model = knowing()
    effects = table(["manoeuvre_moment", "extra_mass", "yaw_trim", "sensor_lag:rotor speed"])
    found = identify(flights[:3], model, held_out=flights[3:], catalogue=effects)
    (one,) = found.found
    assert one.term.key == "manoeuvre_moment:changed"
    assert one.lower[0, 0] < 0.5 < one.upper[0, 0]
    assert one.value[0, 0] == pytest.approx(0.5, abs=0.1)
    said = effect_sentence(one, found)
    assert said.startswith("The aircraft turns as if its inertia were ")
    assert " % larger (" in said
    new = update_model(model, found).model
    assert [e.name for e in new.effects] == ["manoeuvre_moment"] * 2
    assert new.effects[1].parameters["inertia_yaw"].value == pytest.approx(1.5, abs=0.3)
    low, high = new.effects[1].parameters["inertia_yaw"].ci95
    assert low < 1.5 < high
    # Rates begin and end with the log.
    left = [analyse(flights[3], of).residual_rpm[20:-20] for of in (model, new)]
    before, after = (np.sqrt(np.mean(rpm**2)) for rpm in left)
    assert after < 1.5 * NOISE_RPM < 0.5 * before


def test_a_sound_aircraft_that_turns_gets_no_name():
    found = identify([turned(k, 1.0) for k in range(3)], knowing())
    assert found.found == ()
