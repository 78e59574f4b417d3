"""Closing the loop: the new model holds what was found, and leaves behind what is of one flight."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, NOISE_RPM, curve_model, made_flights, table
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.effects.thrust_effects import (
    ROTOR_DEGRADATION,
    ROTOR_DEGRADATION_ONSET,
    ROTOR_DEGRADATION_UNTIL,
)
from thrustmargin.models.errors import ModelError
from thrustmargin.models.identification.answer import model_update
from thrustmargin.models.identification.answer.held_out_errors import rotor_errors
from thrustmargin.models.identification.answer.model_update import (
    margin_changes,
    record_of,
    update_model,
)
from thrustmargin.models.identification.answer.result import Identification, ReportedEffect
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_model import RotorModel, hover_speed, physics_model
from thrustmargin.models.network.network import RotorNetwork
from thrustmargin.models.network.validity import TrainingDomain
from thrustmargin.models.physics.airframe import load_airframe

LOSS = 0.08


@pytest.fixture(scope="module")
def worn() -> Identification:
    """Two flights with a worn rotor 1, and a third that no step has used."""
    flights = made_flights(3, loss=LOSS)
    few = table(["rotor_degradation"])
    return identify(flights[:2], curve_model(), held_out=flights[2:], catalogue=few)


def found_by_hand(effect, rows: list[list[float]], rotor: int | None = None) -> ReportedEffect:
    values = np.array(rows)
    return ReportedEffect(
        term=Term(effect=effect, rotor=rotor),
        value=values,
        lower=values - 0.01,
        upper=values + 0.01,
        rmse_before_rpm=40.0,
        rmse_after_rpm=10.0,
    )


@pytest.mark.parametrize("rotor", [0, 2])
def test_a_rotor_that_went_bad_in_flight_is_said_by_its_number_and_flight(rotor):
    found = found_by_hand(ROTOR_DEGRADATION_ONSET, [[0.0, 60.0, 1.0], [0.1, 60.0, 1.0]], rotor)
    words = model_update._omission_note(found, ("first.tlog", "second.tlog"))
    flight = ("first.tlog", "second.tlog")[found.flight]
    assert words.startswith(f"rotor {rotor + 1} went bad during {flight}: the new model has it bad")


def test_the_new_model_predicts_the_worn_rotor_and_comes_back_from_its_file(worn, tmp_path):
    old, path = curve_model(), tmp_path / "new.safetensors"
    save_model(update_model(old, worn, date="2026-01-02").model, path)
    new = load_model(path)
    assert [(e.name, e.rotor) for e in new.effects] == [("rotor_degradation", 1)]
    loss = new.effects[0].parameters["loss"]
    assert loss.ci95[0] < LOSS < loss.ci95[1]
    assert new.effects[0].flights == worn.problem.names
    assert new.effects[0].date == "2026-01-02"
    track = made_flights(5, loss=LOSS)[4]
    before, after = analyse(track, old), analyse(track, new)
    ratio = after.prediction.rotor_speed_rpm / before.prediction.rotor_speed_rpm
    assert np.median(ratio[:, 0]) == pytest.approx(1 / np.sqrt(1 - LOSS), rel=2e-3)
    assert np.median(ratio[:, 1:]) == pytest.approx(1.0, abs=2e-3)
    rms = [np.sqrt(np.nanmean(a.residual_rpm**2)) for a in (before, after)]
    assert rms[0] > 4 * rms[1]


def test_the_old_model_stays_as_it_was(worn):
    old = curve_model()
    new = update_model(old, worn).model
    assert old.effects == ()
    assert worn.model.effects == ()
    assert new is not old


def test_effects_join_those_that_the_model_had(worn):
    mass = Identified(value=2.0, unit="kg", ci95=(1.9, 2.1))
    known = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavy = replace(curve_model(), effects=(known,))
    new = update_model(heavy, worn).model
    assert [e.name for e in new.effects] == ["extra_mass", "rotor_degradation"]
    assert new.effects[0] == known
    track = made_flights(1, hidden_mass=2.0, loss=LOSS)[0]
    residual = analyse(track, new).residual_rpm
    assert np.sqrt(np.mean(residual**2)) < 1.2 * NOISE_RPM


def test_a_wind_stays_behind_and_it_is_said(worn):
    wind = found_by_hand(known_effect("wind"), [[-6.0, 1.0], [2.0, 0.0]])
    update = update_model(curve_model(), replace(worn, found=(wind, *worn.found)))
    assert [e.name for e in update.model.effects] == ["rotor_degradation"]
    assert any("wind" in note and "not in the new model" in note for note in update.notes)


def test_an_onset_with_limits_of_another_aircraft_is_kept_too():
    loss, *others = ROTOR_DEGRADATION_ONSET.parameters
    other = replace(ROTOR_DEGRADATION_ONSET, parameters=(replace(loss, upper=0.5), *others))
    sudden = found_by_hand(other, [[0.0, 30.0, 0.5], [0.12, 45.0, 0.7]], rotor=2)
    record = record_of(sudden, ("one", "two"))
    assert record is not None
    assert (record.name, record.variant) == ("rotor_degradation", "")
    assert record.parameters.keys() == {"loss", "torque_share"}


def test_a_rotor_that_went_bad_in_flight_is_bad_from_now_on(worn):
    names = worn.problem.names
    sudden = found_by_hand(ROTOR_DEGRADATION_ONSET, [[0.0, 30.0, 0.5], [0.12, 45.0, 0.7]], rotor=2)
    record = record_of(sudden, names)
    assert record is not None
    assert (record.name, record.variant, record.rotor) == ("rotor_degradation", "", 3)
    assert record.parameters["loss"].value == pytest.approx(0.12)
    assert record.parameters["torque_share"].value == pytest.approx(0.7)
    assert "onset_time" not in record.parameters
    update = update_model(curve_model(), replace(worn, found=(sudden,)))
    track = made_flights(1)[0]
    ratio = (
        analyse(track, update.model).prediction.rotor_speed_rpm
        / analyse(track, curve_model()).prediction.rotor_speed_rpm
    )
    assert ratio[:5, 2] == pytest.approx(ratio[-5:, 2])
    assert np.median(ratio[:, 2]) > 1.04
    assert any(f"during {names[1]}" in note for note in update.notes)


def test_effects_of_another_aircraft_are_refused(worn):
    other = physics_model(load_airframe("agras-t20"))
    with pytest.raises(ModelError, match="agras-t20"):
        update_model(other, worn)


def learnt_model(flights: tuple[str, ...] = ()) -> RotorModel:
    """A straight line of rotor speed in the tank mass, as an ensemble of two that nearly agree."""
    empty, full = hover_speed(F16, np.array([0.0, 16.0]), np.full(2, F16.reference_density))[:, 0]
    slope = np.array([0.0, (full - empty) / 2])[:, None] * np.ones((1, 4))
    return RotorModel(
        airframe=F16,
        network=RotorNetwork(
            weights=(np.stack([slope, slope]).astype(np.float32),),
            biases=(np.array([[0.0] * 4, [1.0] * 4], dtype=np.float32),),
            input_mean=np.tile([3.0, 8.0], (2, 1)),
            input_scale=np.tile([1.0, 8.0], (2, 1)),
            output_mean=np.full((2, 4), (full + empty) / 2),
            output_scale=np.ones((2, 4)),
        ),
        training_domain=TrainingDomain(
            airspeed=(0.0, 7.0),
            tank_kg=(0.0, 16.0),
            density=(1.2, 1.25),
            height_agl=(2.0, 4.0),
            wind_speed=(0.0, 1.0),
            flights=flights,
        ),
        reference_density=F16.reference_density,
        reference_voltage=F16.nominal_voltage,
    )


def test_the_interval_is_calibrated_anew_with_enough_flights():
    flights = made_flights(9, loss=LOSS, duration=40.0)
    base = learnt_model(flights=(flights[0].name, "elsewhere.tlog"))
    found = identify(flights, base, catalogue=table(["rotor_degradation"]))
    update = update_model(base, found)
    interval = update.model.interval
    assert interval is not None
    assert interval.flights == 9
    assert interval.coverage == 0.9
    fresh = made_flights(12, loss=LOSS, duration=60.0)[11]
    prediction = analyse(fresh, update.model).prediction
    inside = (fresh.rotor_speed_rpm >= prediction.lower_rpm) & (
        fresh.rotor_speed_rpm <= prediction.upper_rpm
    )
    assert 0.85 < inside.mean() <= 1.0
    width = np.nanmedian(prediction.upper_rpm - prediction.lower_rpm)
    assert 2 * 1.64 * NOISE_RPM < width < 8 * 1.64 * NOISE_RPM
    assert any("calibrated anew on 9 flights" in note for note in update.notes)
    assert any("learnt from 1 of them" in note for note in update.notes)


def test_a_model_without_network_says_that_it_has_no_interval(worn):
    assert any("no network" in note for note in update_model(curve_model(), worn).notes)


def test_the_margin_is_that_which_replay_and_report_show(worn):
    steps, total = margin_changes(worn)
    assert len(steps) == len(worn.found) == 1
    assert (steps[0].rotor, steps[0].flights) == (0, "held_out")
    track = made_flights(3, loss=LOSS)[2]
    rows = np.isin(track.time_s, worn.held_out.channels.time_s)  # type: ignore[union-attr]
    for model, mine in (
        (curve_model(), steps[0].typical_before),
        (update_model(curve_model(), worn).model, steps[0].typical_after),
    ):
        shown = analyse(track, model).margin_predicted[rows, 0]
        assert mine == pytest.approx(float(np.median(shown)), abs=2e-4)
    assert total.rotor is None
    assert total.typical_after < total.typical_before
    assert total.worst_after < total.typical_after


def test_a_stronger_rotor_gains_margin_whatever_the_worst_one_does(worn):
    strong = found_by_hand(ROTOR_DEGRADATION, [[-0.1, 1.0]] * 2, rotor=2)
    (step,), total = margin_changes(replace(worn, found=(strong,)))
    assert step.rotor == 2
    assert step.typical_after > step.typical_before + 0.02
    assert total.typical_after <= total.typical_before + 1e-6


def test_effects_of_single_flights_have_their_margin_on_those_flights(worn):
    sudden = found_by_hand(ROTOR_DEGRADATION_ONSET, [[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]], rotor=3)
    steps, _ = margin_changes(replace(worn, found=(sudden,)))
    assert steps[0].flights == "fit"
    # Only the second of the two flights lost it: the middle moves by less than the worst.
    assert steps[0].worst_before - steps[0].worst_after > 0.02


def test_errors_by_rotor_are_of_the_same_rows_as_the_errors_in_all(worn):
    unseen = worn.unseen
    assert [u.role for u in unseen] == ["fit", "held_out"]
    every, *rotors = rotor_errors(unseen[-1])
    assert every.before == worn.before
    assert every.after == worn.after
    assert [e.after.rmse_rpm for e in rotors] == pytest.approx(list(worn.after.per_rotor_rmse_rpm))
    for one in (every, *rotors):
        assert one.before.rmse_ci95_rpm[0] < one.before.rmse_rpm < one.before.rmse_ci95_rpm[1]
        assert one.after.rmse_ci95_rpm[0] < one.after.rmse_rpm < one.after.rmse_ci95_rpm[1]
    assert rotors[0].before.bias_rpm > 50.0
    assert abs(rotors[0].after.bias_rpm) < 2.0
    trials = worn.held_out
    assert trials is not None
    for k, one in enumerate(rotors):
        spread = np.sum((trials.measured_rpm[:, k] - trials.measured_rpm[:, k].mean()) ** 2)
        left = np.sum(unseen[-1].after_rpm[:, k] ** 2)
        assert one.after.r2 == pytest.approx(1.0 - left / spread)


def test_without_held_out_flights_the_errors_are_cross_validated():
    flights = made_flights(3, loss=LOSS)
    found = identify(flights, curve_model(), catalogue=table(["rotor_degradation"]))
    (only,) = found.unseen
    assert only.role == "fit"
    assert rotor_errors(only)[0].after == found.after
    # Each flight is predicted with values that were found without it.
    assert not np.allclose(only.after_rpm, found.residual_after_rpm)
    assert np.sum(only.after_rpm**2) == pytest.approx(np.sum(found.residual_after_rpm**2), rel=0.1)


def test_an_identification_prints_in_a_few_lines(worn):
    first, second = repr(worn).splitlines()
    assert first == (
        f"{F16.name}, 2 flights: rotor speed error {worn.before.rmse_rpm:.1f} -> "
        f"{worn.after.rmse_rpm:.1f} rpm, flights that were not used"
    )
    low, high = worn.found[0].lower[0, 0], worn.found[0].upper[0, 0]
    loss = worn.found[0].value[0, 0]
    assert second == f"rotor_degradation of rotor 1: loss {loss:.2g} ({low:.2g} to {high:.2g})"
    assert "no effect is named" in repr(replace(worn, found=()))


def test_a_rotor_that_was_repaired_is_sound_in_the_new_model(worn):
    found = found_by_hand(ROTOR_DEGRADATION_UNTIL, [[0.1, 1e9, 1e9 + 600.0, 1.0]] * 2, 2)
    update = update_model(worn.model, replace(worn, found=(found,), open_causes=()))
    assert update.model.effects == worn.model.effects
    assert update.notes[0].startswith("rotor 3 was repaired during these flights")
    assert ROTOR_DEGRADATION_UNTIL.of_its_flights
    assert not ROTOR_DEGRADATION.of_its_flights
