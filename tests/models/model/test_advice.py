"""One answer of a flight: every level by what makes it, the gravest first."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.advice_words import facts, headline
from thrustmargin.gcs_plugin.wording.margin_verdict import basis_words
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.model.advice import FlightLevel, advise
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.statement import state


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


@pytest.mark.parametrize("silent_from_s", [0.0, 80.0, 190.0])
def test_what_is_mostly_predicted_is_never_good(sound, silent_from_s):
    silent = sound.track.time_s[:, None] > silent_from_s
    alone = replace(sound, utilisation=np.where(silent, np.nan, sound.utilisation))
    good = FlightLevel.UNDER if silent_from_s == 190.0 else FlightLevel.UNKNOWN
    assert levels(alone) == (good,)
    assert advise(alone, planned=True).advice.level is FlightLevel.UNDER
    # That it would be too much is said by prediction alone too.
    much = replace(alone, utilisation_predicted=1.3 * alone.utilisation_predicted)
    assert levels(much)[-1] in (FlightLevel.OVER, FlightLevel.NEAR)


def test_a_flight_with_motors_in_another_order_is_never_good(sound):
    other = replace(sound, airframe_match=replace(sound.airframe_match, other_order=True))
    advice = advise(other).advice
    assert advice.levels == (FlightLevel.ORDER, FlightLevel.UNDER)
    assert headline(advice) == "MOTOR ORDER DIFFERS: ROTOR NAMES ARE WRONG"
    above = advise(used(other, 1.25)).advice
    assert above.levels == (FlightLevel.OVER, FlightLevel.ORDER)
    assert headline(above).startswith("THRUST LEFT BELOW THE 50 % LIMIT")
    assert headline(above).endswith("; MOTOR ORDER DIFFERS: ROTOR NAMES ARE WRONG")


@pytest.mark.parametrize(("every_s", "says_s"), [(0.0, 0.0), (50.0, 0.0), (10.0, 77.0)])
def test_pauses_are_counted_where_they_are_much_of_the_flight_together(sound, every_s, says_s):
    # 200 s in flight: 20 pauses of 4.1 s, of which 0.25 s belong to the row before; 4 are too few.
    track = sound.track
    there = track.time_s % every_s < (every_s - 4.0) if every_s else track.time_s >= 0.0
    made = advise(
        analyse(track.rows(there), sound.model, airframe_match=sound.airframe_match)
    ).advice
    assert made.paused_s == pytest.approx(says_s, abs=5.0 if says_s else 0.0)
    assert made.complete is (says_s == 0.0)


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


@pytest.mark.parametrize(("share", "left"), [(0.75, True), (0.97, False), (1.2, False)])
def test_speeds_alone_are_no_emergency_where_outputs_ask_for_less(sound, share, left):
    """Outputs that make 0.75 times the thrust of the speeds: 0.97 in use would be 0.73."""
    rows = sound.track.flying & (sound.track.time_s > 60.0) & (sound.track.time_s < 63.0)
    use = np.where(rows[:, None], 0.97, sound.utilisation)
    assert sound.airframe_match.outputs is not None
    outputs = replace(
        sound.airframe_match.outputs, over_speeds=np.log(share), error=0.1, shows=0.05
    )
    made = replace(
        sound, utilisation=use, airframe_match=replace(sound.airframe_match, outputs=outputs)
    )
    assert (FlightLevel.NO_THRUST not in levels(made)) is left


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


def test_a_battery_collapses_in_an_aircraft_that_is_not_known_too(sound):
    track = sound.track
    unknown = replace(sound, airframe_match=AirframeMatch(no_verdict=(state("no airframe given"),)))

    def volts(healthy: float, later: float) -> FlightAnalysis:
        read = np.where(track.time_s > 100.0, later, healthy)
        return analyse(
            replace(track, voltage=read), unknown.model, airframe_match=unknown.airframe_match
        )

    made = advise(volts(58.0, 41.0)).advice
    # 58.0 V are 13 cells of at most 4.5 V, or more: 41.0 V are at most 3.15 V each.
    assert made.levels == (FlightLevel.UNKNOWN,)
    made = advise(volts(58.0, 38.0)).advice
    assert made.levels == (FlightLevel.BATTERY,)
    assert headline(made).startswith("BATTERY COLLAPSED: AT MOST 2.92 V A CELL AT 1:")
    # A regulator, and a level sender that empties: no battery that was ever well.
    assert advise(volts(5.0, 4.9)).advice.levels == (FlightLevel.UNKNOWN,)
    assert advise(volts(4.4, 0.6)).advice.levels == (FlightLevel.UNKNOWN,)


def test_a_bad_rotor_comes_first_and_is_named_where_its_name_is_known(sitl_logs):
    worn = analyse(read_log(sitl_logs / "onset" / "worn_prop_onset.tlog").track, shipped_model())
    made = advise(worn).advice
    assert made.levels == (FlightLevel.DAMAGED, FlightLevel.UNDER)
    assert [episode.fault.rotor for episode in made.faults] == [2]
    assert made.rotor_names[2] == "front left"
    other = replace(worn, airframe_match=replace(worn.airframe_match, other_order=True))
    assert advise(other).advice.rotor_names == ()
    assert other.places == ("",) * 4


def test_what_holds_for_sound_rotors_is_not_said_of_a_bad_one(sitl_logs, sound):
    """Of one more rotor lost it stays known that it would not be survived, not that it would."""
    worn = analyse(read_log(sitl_logs / "onset" / "worn_prop_onset.tlog").track, shipped_model())
    assert np.nanmin(worn.redundancy_yaw_uncontrolled) > 1.0
    made = advise(worn)
    assert np.isnan(
        [made.advice.fill.kg, made.advice.fill.fresh_kg, made.advice.rotor_lost.redundancy_min]
    ).all()
    of_rows = (
        made.whole.redundancy_yaw_uncontrolled,
        made.analysis.trimmable_loss,
        made.fill_limit_kg,
    )
    assert np.isnan(of_rows).all()
    assert dict(facts(made.advice))["one rotor lost"] == "not known while a rotor or motor is bad"
    share = 0.97 / np.nanmin(worn.redundancy_yaw_uncontrolled)
    heavy = replace(worn, redundancy_yaw_uncontrolled=share * worn.redundancy_yaw_uncontrolled)
    bad = advise(heavy)
    assert 0.96 < bad.advice.rotor_lost.redundancy_min < 1.0
    assert np.nanmax(bad.analysis.redundancy_yaw_uncontrolled) < 1.0
    assert np.isnan(bad.advice.fill.kg)
    assert advise(sound).advice.fill.kg > 0.0
    assert not advise(sound).analysis.bad_part


def test_a_flight_that_is_none_has_no_answer(sound):
    grounded = replace(sound.track, flying=np.zeros_like(sound.track.flying))
    assert levels(replace(sound, track=grounded)) == (FlightLevel.UNKNOWN,)
    two_seconds = sound.track.flying & (np.cumsum(sound.track.flying) <= 20)
    assert levels(replace(sound, track=replace(sound.track, flying=two_seconds))) == (
        FlightLevel.UNKNOWN,
    )


def test_a_rotor_that_stood_still_is_never_below_the_limit(sound):
    track = sound.track
    gone = track.time_s > 100.0
    speeds = track.rotor_speed_rpm * np.where(gone, np.sqrt(4.0 / 3.0), 1.0)[:, None]
    speeds[gone, 2] = np.nan
    # The autopilot asks more of all, and most of the one that does not answer.
    outputs = track.throttle * np.where(gone[:, None], [1.15, 1.15, 1.4, 1.15], 1.0)
    stood = replace(track, rotor_speed_rpm=speeds, throttle=outputs)
    made = advise(replace(sound, track=stood)).advice
    assert made.level is FlightLevel.DAMAGED
    assert (made.faults[0].fault.kind, made.faults[0].fault.rotor) == ("stopped", 2)
    assert headline(made).startswith("ROTOR 3, FRONT LEFT: STOOD STILL IN FLIGHT")
    assert "Rotor 3 front left stands still (found" in dict(facts(made))["alarm"]
    # What it lacks is no second fault, of it or of one of two; what was there before is.
    pair = RotorFault(kind="propeller", rotor=3, rotors=(2, 3), size=0.2, lower=0.1, upper=0.3)
    for found_s, kinds in ((150.0, ["stopped"]), (50.0, ["propeller", "stopped"])):
        both = advise(replace(sound, track=stood), history=[(found_s, (pair,))]).advice
        assert [one.fault.kind for one in both.faults] == kinds
    # It needs no airframe, and of one that is not known it has no place.
    unknown = replace(sound, airframe_match=AirframeMatch(no_verdict=(state("no voltage"),)))
    made = advise(replace(unknown, track=stood)).advice
    assert made.level is FlightLevel.DAMAGED
    assert headline(made).startswith("ROTOR 3: STOOD STILL IN FLIGHT")


def test_the_gravest_has_the_smallest_gravity():
    assert FlightLevel.DAMAGED.gravity < FlightLevel.LOST.gravity < FlightLevel.BATTERY.gravity
    assert (
        FlightLevel.BATTERY.gravity < FlightLevel.NO_THRUST.gravity < FlightLevel.CRITICAL.gravity
    )
    assert FlightLevel.CRITICAL.gravity < FlightLevel.OVER.gravity < FlightLevel.NEAR.gravity
    assert FlightLevel.NEAR.gravity < FlightLevel.UNDER.gravity < FlightLevel.UNKNOWN.gravity


def worn_model(loss: float):
    """The shipped model with a weak rotor 1 added to it, as `identify --out` adds one."""
    values = {"loss": (loss, "1"), "torque_share": (1.0, "1")}
    parameters = {
        name: Identified(value=value, unit=unit, ci95=(value - 0.01, value + 0.01))
        for name, (value, unit) in values.items()
    }
    record = EffectRecord(name="rotor_degradation", rotor=1, parameters=parameters)
    return replace(shipped_model(), effects=(*shipped_model().effects, record))


def test_a_loss_that_was_added_to_the_model_is_not_repaired_by_it(sitl_logs):
    track = read_log(sitl_logs / "dev" / "worn_prop_3.tlog").track
    made = advise(analyse(track, worn_model(0.08))).advice
    assert made.level is FlightLevel.DAMAGED
    (episode,) = made.faults
    assert (episode.fault.rotor, episode.end_s, made.repaired) == (0, None, ())
    assert episode.fault.size == pytest.approx(0.08)
    # Without measured speeds nothing shows it sound.
    blind = replace(track, rotor_speed_rpm=np.full_like(track.rotor_speed_rpm, np.nan))
    assert advise(analyse(blind, worn_model(0.08))).advice.level is FlightLevel.DAMAGED
    assert "holding damage: rotor 1 at 8 % less thrust" in worn_model(0.08).description


def test_a_rotor_that_flies_sound_is_repaired_though_the_model_holds_its_loss(sound):
    made = advise(analyse(sound.track, worn_model(0.08))).advice
    assert FlightLevel.DAMAGED not in made.levels
    assert made.faults == ()
    assert [fault.rotor for fault in made.repaired] == [0]
    said = dict(facts(made))
    assert said["model"].startswith("rotor 1 is sound again, and the model still holds its loss")


def test_a_loss_that_no_alarm_would_name_is_none(sound):
    made = advise(analyse(sound.track, worn_model(0.02))).advice
    assert (made.faults, made.repaired) == ((), ())


@pytest.mark.parametrize(("outputs", "words"), [(0.5, "motor outputs went on"), (np.nan, "rest")])
def test_outputs_that_go_on_where_every_esc_fell_silent_are_not_kept_quiet(sound, outputs, words):
    silent = sound.track.time_s > 80.0
    asked = np.where(silent[:, None], outputs, sound.track.throttle)
    use = np.where(silent[:, None], np.nan, sound.utilisation)
    made = replace(sound, utilisation=use, track=replace(sound.track, throttle=asked))
    said = basis_words(made, measured_s=70.0, known_s=200.0, airborne_s=200.0)
    assert words in said.split("predicted for the ")[1]
    assert ("outputs" in said) == np.isfinite(outputs)
    by_outputs = {"rotor_speed_rpm": np.ones_like(sound.utilisation)}
    no_esc = replace(made, track=replace(made.track, standard_errors=by_outputs))
    said = basis_words(no_esc, measured_s=70.0, known_s=200.0, airborne_s=200.0)
    assert "ESC telemetry" not in said
