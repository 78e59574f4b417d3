"""One answer of a flight: every level by what makes it, the gravest first."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.advice import FlightLevel, advise
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.model_file import shipped_model


@pytest.fixture(scope="module")
def sound(sitl_logs) -> FlightAnalysis:
    track = read_log(sitl_logs / "campaign" / "v4_m10_q2.5.tlog").track
    return analyse(track, shipped_model())


def levels(analysis: FlightAnalysis, limit: float = 0.5) -> tuple[FlightLevel, ...]:
    return advise(analysis, limit=limit).advice.levels


def used(analysis: FlightAnalysis, factor: float) -> FlightAnalysis:
    return replace(analysis, utilisation=analysis.utilisation * factor)


def test_turns_above_the_limit_are_no_flight_above_it(sound):
    assert np.nanmax(sound.utilisation[sound.track.flying]) > 0.6
    assert levels(sound) == (FlightLevel.UNDER,)


def test_what_lasts_above_the_limit_is_above_it(sound):
    assert levels(used(sound, 1.25)) == (FlightLevel.OVER,)
    error = np.full(sound.utilisation_error.shape, 0.05)
    assert levels(replace(used(sound, 1.1), utilisation_error=error)) == (FlightLevel.NEAR,)


def test_a_rotor_whose_loss_is_not_survived_is_critical(sound):
    heavy = replace(sound, redundancy_yaw_uncontrolled=sound.redundancy_yaw_uncontrolled / 1.3)
    assert levels(heavy) == (FlightLevel.CRITICAL,)
    unsure = replace(
        sound,
        redundancy_yaw_uncontrolled=sound.redundancy_yaw_uncontrolled / 1.05,
        redundancy_error=np.full(sound.redundancy_error.shape, 0.1),
    )
    assert levels(unsure) == (FlightLevel.NEAR,)


def test_no_thrust_left_comes_before_what_the_load_makes(sound):
    rows = sound.track.flying & (sound.track.time_s > 60.0) & (sound.track.time_s < 63.0)
    use = np.where(rows[:, None], 0.97, sound.utilisation)
    assert levels(replace(sound, utilisation=use)) == (FlightLevel.NO_THRUST, FlightLevel.UNDER)


def test_a_battery_that_collapses_comes_before_that(sound):
    track = sound.track
    low = track.flying & (track.time_s > 100.0) & (track.time_s < 105.0)
    sagging = replace(track, voltage=np.where(low, 14 * 2.7, track.voltage))
    made = advise(replace(sound, track=sagging)).advice
    assert made.levels == (FlightLevel.BATTERY, FlightLevel.UNDER)
    assert made.battery.least_cell == pytest.approx(2.7)
    assert 99.0 < made.battery.at_s < 106.0
    spike = track.flying & (track.time_s > 100.0) & (track.time_s < 100.3)
    for_a_moment = replace(track, voltage=np.where(spike, 14 * 2.7, track.voltage))
    assert levels(replace(sound, track=for_a_moment)) == (FlightLevel.UNDER,)


def test_a_bad_rotor_comes_first_and_is_named_where_its_name_is_known(sitl_logs):
    worn = analyse(read_log(sitl_logs / "onset" / "worn_prop_onset.tlog").track, shipped_model())
    made = advise(worn).advice
    assert made.levels == (FlightLevel.DAMAGED, FlightLevel.UNDER)
    assert [episode.fault.rotor for episode in made.faults] == [2]
    assert made.rotor_names[2] == "front left"
    assert advise(worn, names_known=False).advice.rotor_names == ()


def test_a_flight_that_is_none_has_no_answer(sound):
    grounded = replace(sound.track, flying=np.zeros_like(sound.track.flying))
    assert levels(replace(sound, track=grounded)) == (FlightLevel.UNKNOWN,)
    two_seconds = sound.track.flying & (np.cumsum(sound.track.flying) <= 20)
    assert levels(replace(sound, track=replace(sound.track, flying=two_seconds))) == (
        FlightLevel.UNKNOWN,
    )


def test_the_gravest_has_the_smallest_gravity():
    assert FlightLevel.DAMAGED.gravity < FlightLevel.LOST.gravity < FlightLevel.BATTERY.gravity
    assert (
        FlightLevel.BATTERY.gravity < FlightLevel.NO_THRUST.gravity < FlightLevel.CRITICAL.gravity
    )
    assert FlightLevel.CRITICAL.gravity < FlightLevel.OVER.gravity < FlightLevel.NEAR.gravity
    assert FlightLevel.NEAR.gravity < FlightLevel.UNDER.gravity < FlightLevel.UNKNOWN.gravity
