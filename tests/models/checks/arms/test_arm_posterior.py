"""What is wrong with which arm, on flights of a plant with one cause on one arm."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.checks.arms.arm_plant import CAUSES, F16, Bad, arm_flight
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_figures import ArmFigure, ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_law import ArmLaw, departures
from thrustmargin.models.checks.arms.arm_posterior import arm_answer, loss_evidence
from thrustmargin.models.errors import ModelError
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.flight_arms import (
    figures_of,
    flight_arm_answer,
    flight_arm_figures,
    flights_arm_answer,
    learnt_arms,
)
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_faults import mode_directions
from thrustmargin.models.model.rotor_model import physics_model

MODEL = physics_model(F16)
MODES = mode_directions(MODEL)
GOOD = [arm_flight(k, day=k, aircraft=3) for k in range(8)]
KNOWN = replace(MODEL, arms=learnt_arms(MODEL, GOOD))
OF_ESC = ("esc_voltage", "esc_current", "esc_temperature", "motor_temperature")
#: A rise of temperature that reads 12 % too high is within the scatter of flights. A short and a
#: current that reads too high at rest look alike; what shakes the whole aircraft is of no arm.
NOT_SHOWN = ("esc_temperature_reading", "motor_temperature_reading", "short", "shaken")


def answer(track, model=KNOWN, **given):
    return flight_arm_answer(analyse(track, model), **given)


def together(model, tracks, **weak):
    return flights_arm_answer(model, figures_of(model, tracks), **weak)


def without(track, *channels):
    return replace(track, **{c: np.full_like(getattr(track, c), np.nan) for c in channels})


@pytest.mark.parametrize("cause", [c for c in CAUSES if c not in NOT_SHOWN])
def test_a_cause_of_12_percent_is_found_on_its_arm(cause):
    found = answer(arm_flight(71, 30, Bad(cause=cause, size=0.12, arm=2), aircraft=3)).findings
    assert [one.arm for one in found] == [2]
    (first, *_) = found[0].causes
    assert found[0].cause == cause
    low, high = sorted((abs(first.lower), abs(first.upper)))
    assert 0.5 * low < 0.12 < 1.5 * high
    assert found[0].only_sensors == (cause.endswith("_reading") or cause == "telemetry")


def test_current_of_a_rotor_that_stands_is_of_a_short_or_of_the_ammeters_zero():
    found = answer(arm_flight(71, 30, Bad(cause="short", size=0.12, arm=2), aircraft=3)).findings
    assert [one.arm for one in found] == [2]
    assert {one.cause for one in found[0].causes} == {Cause.SHORT, Cause.CURRENT_OFFSET_READING}


def test_what_shakes_the_whole_aircraft_is_of_no_arm():
    """Ten times the usual level, and 4.6 times, without a rotor's own amplitude."""
    for size, ratio in ((0.3, 10.0), (0.12, 4.6)):
        found = answer(arm_flight(71, 30, Bad(cause="shaken", size=size, arm=2), aircraft=3))
        assert found.findings == ()
        assert found.shaken is not None
        assert found.shaken.lower < ratio < found.shaken.upper
    assert answer(arm_flight(71, 30, aircraft=3)).shaken is None


@pytest.mark.parametrize(("deviations", "found"), [(2.9, False), (3.4, True)])
def test_a_shake_of_three_deviations_of_a_long_history_is_found(deviations, found):
    """By Student's t one sound flight in a thousand is so far off."""
    rng = np.random.default_rng(5)
    levels = 0.3 * rng.standard_normal(200)
    levels = (levels - levels.mean()) * (0.3 / levels.std(ddof=1))
    law = ArmLaw(
        flights=tuple(
            figures(str(k), k, [level], ArmQuantity.SHAKING) for k, level in enumerate(levels)
        )
    )
    shaken = arm_answer([figures("new", 999, [0.3 * deviations], ArmQuantity.SHAKING)], law).shaken
    assert (shaken is not None) == found


def test_an_unbalanced_propeller_that_shakes_the_aircraft_is_of_its_arm():
    bad = arm_flight(71, 30, Bad(cause="imbalance", size=0.5, arm=1), aircraft=3)
    found = answer(bad)
    assert [(one.arm, one.cause) for one in found.findings] == [(1, Cause.IMBALANCE)]
    assert found.shaken is None


def test_lost_frames_and_falls_out_of_step_need_no_earlier_flight():
    unknown = replace(MODEL, arms=None)
    for cause in ("telemetry", "desync"):
        bad = arm_flight(71, 30, Bad(cause=cause, size=0.12, arm=0), aircraft=3)
        found = answer(bad, unknown).findings
        assert [(one.arm, one.causes[0].cause) for one in found] == [(0, cause)]
        assert {one.cause for one in found[0].causes} <= {cause, "esc"}


@pytest.mark.parametrize("seed", range(80, 86))
def test_of_a_sound_aircraft_nothing_is_said(seed):
    assert answer(arm_flight(seed, 30 + seed, aircraft=3)).findings == ()


def test_what_cannot_be_told_apart_is_one_of_several():
    """Without temperatures more power is the motor's, the ESC's or the ammeter's."""
    model = replace(MODEL, arms=learnt_arms(MODEL, [without(t, *OF_ESC[2:]) for t in GOOD]))
    bad = arm_flight(72, 30, Bad(cause="motor", size=0.12, arm=1), aircraft=3)
    (found,) = answer(without(bad, *OF_ESC[2:]), model).findings
    assert found.arm == 1
    assert found.cause is None
    assert {Cause.MOTOR, Cause.CURRENT_READING} <= {one.cause for one in found.causes}
    assert sum(one.probability for one in found.causes) > 0.9


def test_without_readings_of_the_escs_a_bad_motor_is_not_blamed_on_anything_else():
    bad = arm_flight(73, 30, Bad(cause="motor", size=0.12), aircraft=3)
    found = answer(without(bad, *OF_ESC, "vibration_per_rev"))
    assert found.findings == ()
    assert ArmQuantity.POWER not in found.quantities


def test_the_thrust_search_is_never_contradicted():
    """Of an arm that it reports only the causes that it leaves are possible."""
    bad = arm_flight(74, 30, Bad(cause="speed_reading", size=0.12, arm=1), aircraft=3)
    flight = [flight_arm_figures(analyse(bad, KNOWN), flight="new")]
    assert arm_answer(flight, KNOWN.arms, modes=MODES).findings[0].cause is Cause.SPEED_READING
    left = (Cause.PROPELLER, Cause.MOTOR)
    given = arm_answer(flight, KNOWN.arms, modes=MODES, given={1: left})
    assert {one.cause for f in given.findings for one in f.causes} <= set(left)
    assert {f.arm for f in given.findings} <= {1}
    # A single cause explains what it moves: it is reported already.
    alone = arm_answer(flight, KNOWN.arms, modes=MODES, given={1: (Cause.SPEED_READING,)})
    assert alone.findings == ()


def test_of_a_rotor_that_a_search_reports_the_figures_choose_between_propeller_and_reading():
    for cause in (Cause.PROPELLER, Cause.SPEED_READING):
        bad = arm_flight(75, 30, Bad(cause=cause.value, size=0.12, arm=1), aircraft=3)
        (found,) = together(KNOWN, [bad], weak=[1]).findings
        assert (found.arm, found.cause) == (1, cause)
    sound = arm_flight(77, 30, aircraft=3)
    assert together(KNOWN, [sound], weak=[1]).findings == ()
    assert together(MODEL, [sound], weak=[1]).findings == ()


def test_two_bad_arms_are_both_found():
    one = arm_flight(76, 30, Bad(cause="lead", size=0.12, arm=0), aircraft=3)
    other = arm_flight(76, 30, Bad(cause="imbalance", size=0.12, arm=3), aircraft=3)
    both = replace(one, vibration_per_rev=other.vibration_per_rev)
    found = {f.arm: f.cause for f in answer(both).findings}
    assert found == {0: Cause.LEAD, 3: Cause.IMBALANCE}


def test_several_flights_show_what_one_does_not():
    tracks = [
        arm_flight(400 + k, 40 + k, Bad(cause="current_reading", size=0.05, arm=2), aircraft=3)
        for k in range(6)
    ]
    assert answer(tracks[0]).findings == ()
    (found,) = together(KNOWN, tracks).findings
    assert found.arm == 2
    assert Cause.CURRENT_READING in {one.cause for one in found.causes}
    assert together(KNOWN, []).findings == ()


def of_loss(bad, *channels):
    """Log likelihood ratios of a loss of 3 % and of 6 % of each arm."""
    track = without(arm_flight(71, 30, bad, aircraft=3), *channels)
    found = loss_evidence([flight_arm_figures(analyse(track, KNOWN), flight="new")], KNOWN.arms)
    return np.array([[one.at(0.03), one.at(0.06)] for one in found])


def test_power_and_output_are_evidence_of_a_propellers_loss_on_its_arm_alone():
    ratios = of_loss(Bad(cause="propeller", size=0.06, arm=2))
    assert (ratios[2] > 5.0).all()
    assert (np.delete(ratios, 2, axis=0) < 0.0).all()


def test_figures_of_a_sound_arm_speak_against_a_loss():
    assert (of_loss(None) < -1.0).all()
    assert loss_evidence([], KNOWN.arms) == ()
    assert of_loss(None, *OF_ESC, "throttle", "vibration_per_rev", "vibration", "clipping") == (
        pytest.approx(np.zeros((4, 2)), abs=1e-9)
    )


@pytest.mark.parametrize("cause", ["motor", "esc"])
def test_power_that_another_part_explains_is_no_evidence_of_a_propeller(cause):
    ratios = of_loss(Bad(cause=cause, size=0.12, arm=1))
    assert ratios[1] == pytest.approx([0.0, 0.0], abs=0.7)


def test_lost_frames_leave_what_power_says_of_the_propeller():
    sound, lossy = of_loss(None), of_loss(Bad(cause="telemetry", size=0.05, arm=1))
    assert lossy[1] == pytest.approx(sound[1], abs=0.5)


def test_a_bad_arm_is_no_evidence_of_the_others():
    ratios = of_loss(Bad(cause="imbalance", size=0.12, arm=1))
    assert (np.delete(ratios, 1, axis=0) < 1.0).all()


def figures(flight, day, value, quantity=ArmQuantity.POWER, unit=1.0):
    error = (0.001,) * len(value)
    one = ArmFigure(quantity=quantity, value=tuple(value), error=error, unit=unit)
    return ArmFigures(flight=flight, day=day, figures=(one,))


def test_what_all_arms_do_together_is_no_evidence():
    flights = [figures(str(k), k, [0.001 * k] * 4) for k in range(6)]
    law = ArmLaw(flights=tuple(flights))
    assert arm_answer([figures("new", 9, [0.25] * 4)], law).findings == ()
    assert arm_answer([figures("new", 9, [0.25, 0.0, 0.0, 0.0])], law).findings[0].arm == 0


def test_a_flight_is_not_compared_with_itself_and_few_flights_show_nothing():
    flights = tuple(figures(str(k), k, [0.0] * 4) for k in range(3))
    law = ArmLaw(flights=flights)
    assert arm_answer([figures("new", 9, [0.3, 0, 0, 0])], law).quantities == (ArmQuantity.POWER,)
    again = arm_answer([figures("1", 1, [0.3, 0, 0, 0])], law)
    assert (again.quantities, again.flights, again.days) == ((), 2, 2)
    assert arm_answer([figures("new", 9, [0.3, 0, 0, 0])], None).quantities == ()


def test_the_scatter_between_days_is_the_yardstick():
    """Arms that differ by 5 % from day to day are not bad at 10 %."""
    rng = np.random.default_rng(5)
    calm, wild = (
        ArmLaw(
            flights=tuple(figures(str(k), k, scatter * rng.standard_normal(4)) for k in range(10))
        )
        for scatter in (0.003, 0.05)
    )
    new = [figures("new", 20, [0.0, 0.1, 0.0, 0.0])]
    assert arm_answer(new, calm).findings[0].arm == 1
    assert arm_answer(new, wild).findings == ()
    (one,) = departures(new, wild)
    assert np.sqrt(np.diag(one.covariance)) == pytest.approx([0.05] * 4, rel=0.35)


def test_an_instrument_s_offset_needs_no_earlier_flight():
    low = figures("new", 0, [0.9, 0.0, 0.02, -0.03], ArmQuantity.OFFSET, unit=50.0)
    (found,) = arm_answer([low], None).findings
    assert (found.arm, found.cause) == (0, Cause.VOLTAGE_READING)
    assert found.causes[0].size == pytest.approx(0.018, rel=0.3)


def test_a_law_of_different_numbers_of_arms_is_refused():
    with pytest.raises(ModelError, match=r"of \[4, 6\] arms"):
        ArmLaw(flights=(figures("a", 0, [0.0] * 4), figures("b", 1, [0.0] * 6)))


def test_a_model_file_keeps_what_is_known_of_the_arms(tmp_path):
    save_model(KNOWN, tmp_path / "known.safetensors")
    read = load_model(tmp_path / "known.safetensors").arms
    assert read is not None
    assert [one.flight for one in read.flights] == [track.name for track in GOOD]
    bad = arm_flight(71, 30, Bad(cause="lead", size=0.12, arm=2), aircraft=3)
    again = answer(bad, replace(MODEL, arms=read)).findings
    assert [one.cause for one in again] == [Cause.LEAD]
