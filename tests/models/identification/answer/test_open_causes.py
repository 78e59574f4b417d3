"""Causes without a name that go into the model: only what flights left out show again."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_curve, known_effect
from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.model_update import margin_changes, update_model
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_faults import faults_in_model

MODEL = curve_model()
FLIGHTS, SECONDS = 4, 60.0
KNOTS = {"at_1": 0.0, "at_2": 0.02, "at_3": 0.04, "at_4": 0.06}
PITCH = Placed(effect=known_curve("pitch", "time_s"), values={**KNOTS, "low": 0.0, "high": SECONDS})
FAST = {"at_1": 0.02, "at_2": 0.03, "at_3": 0.05, "at_4": 0.09, "low": 0.0, "high": 7.0}
ROTOR = Placed(effect=known_curve("rotor", "airspeed"), values=FAST, rotor=2)


def with_causes(causes: Sequence[Sequence[Placed]]) -> list[FlightTrack]:
    """Flights, each with some causes put into its rotor speeds."""
    changed = []
    for track, own in zip(made_flights(len(causes), duration=SECONDS), causes, strict=True):
        alone = assemble(MODEL, [track])
        more = np.zeros_like(track.rotor_speed_rpm)
        rows = np.searchsorted(track.time_s, alone.channels.time_s + track.time_s[0])
        more[rows] = alone.speeds(list(own)) - alone.speeds()
        changed.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + more))
    return changed


def identified(flights: Sequence[FlightTrack], *keys: str, held_out=()) -> Identification:
    return identify(flights, MODEL, catalogue=table(keys or ("extra_mass",)), held_out=held_out)


@pytest.fixture(scope="module")
def pitching() -> Identification:
    *fit, unused = with_causes([[PITCH]] * (FLIGHTS + 1))
    return identified(fit, held_out=[unused])


def test_what_acts_in_every_flight_is_taken_as_it_was_seen(pitching):
    assert pitching.found == ()
    cause = pitching.open_causes[0]
    assert cause.place == ("pitch", "time_s")
    problem = pitching.problem
    wanted = problem.speeds([PITCH]) - problem.speeds()
    assert cause.rms_rpm == pytest.approx(np.sqrt(np.mean(wanted**2)), rel=0.15)
    assert pitching.after.rmse_rpm < 0.5 * pitching.before.rmse_rpm
    assert pitching.after.rmse_rpm < 1.1 * pitching.sensor_noise_rpm


def test_its_curve_range_and_intervals_are_in_the_json(pitching):
    told = pitching.to_json()["unnamed_causes"][0]
    assert (told["mode"], told["rotor"], told["channel"]) == ("pitch", None, "time_s")
    assert told["range"] == pytest.approx([0.02 * SECONDS, 0.98 * SECONDS], abs=3.0)
    last = told["parameters"]["at_4"]
    assert last["ci95"][0] < 0.06 < last["ci95"][1]
    assert last["ci95"][1] - last["ci95"][0] < 0.02


def test_the_new_model_and_the_margin_hold_it(pitching, tmp_path):
    path = tmp_path / "with.safetensors"
    save_model(update_model(MODEL, pitching, date="2026-01-02").model, path)
    new = load_model(path)
    cause, record = pitching.open_causes[0], new.effects[0]
    assert (record.parameters["low"].value, record.parameters["high"].value) == cause.range
    unused = with_causes([[PITCH]] * (FLIGHTS + 1))[-1]
    old, trials = (
        np.nanmean((analyse(unused, m).prediction.rotor_speed_rpm - unused.rotor_speed_rpm) ** 2)
        for m in (MODEL, new)
    )
    assert trials < 0.25 * old
    steps, whole = margin_changes(pitching)
    assert steps == ()
    assert whole.worst_after < whole.worst_before - 0.01


def test_the_uneven_loss_of_a_rotor_is_corrected_for_and_stays_an_alarm():
    found = identified(with_causes([[ROTOR]] * FLIGHTS), "rotor_degradation")
    assert found.found == ()
    assert {one.found.term.rotor for one in found.open_causes} == {2}
    told = found.to_json()["unnamed_causes"]
    assert {(one["mode"], one["rotor"]) for one in told} == {("rotor", 3), (None, 3)}
    (steady,) = (one for one in told if one["mode"] is None)
    assert steady["parameters"]["loss"]["value"] == pytest.approx(0.02, abs=0.015)
    assert found.after.rmse_rpm < 0.5 * found.before.rmse_rpm
    new = update_model(MODEL, found).model
    (fault,) = faults_in_model(new)
    assert fault.rotor == 2
    assert 0.05 < fault.size < 0.13
    assert "holding damage: rotor 3" in new.description


def test_what_the_held_out_flights_do_not_show_is_in_no_model(pitching):
    """The fitted flights have a curve in pitch, the one that is not used has none."""
    fit, (sound,) = with_causes([[PITCH]] * FLIGHTS), with_causes([[]])
    found = identified(fit, held_out=[replace(sound, name="sound")])
    assert pitching.open_causes != ()
    assert found.open_causes == ()
    assert found.after.rmse_rpm == found.before.rmse_rpm


def test_what_flights_left_out_do_not_show_again_is_not_taken():
    found = identified(with_causes([[], [], [PITCH], []]))
    assert found.open_causes == ()
    assert update_model(MODEL, found).model.effects == MODEL.effects


@pytest.mark.slow
def test_what_each_flight_has_otherwise_is_not_taken_though_one_seems_to_fit():
    """A choice among all curves seems to help, and one made anew without each flight does not."""
    rng = np.random.default_rng(5)
    causes = [
        [
            Placed(
                effect=known_curve(mode, "time_s"),
                values={
                    **{f"at_{k + 1}": v for k, v in enumerate(rng.normal(0.0, 0.012, 4))},
                    "low": 0.0,
                    "high": SECONDS,
                },
            )
            for mode in ("collective", "roll", "pitch", "yaw")
        ]
        for _ in range(FLIGHTS)
    ]
    assert identified(with_causes(causes)).open_causes == ()


def test_a_name_that_explains_all_leaves_no_cause():
    loss = Placed(
        effect=known_effect("rotor_degradation"),
        values={"loss": 0.08, "torque_share": 1.0},
        rotor=0,
    )
    found = identified(with_causes([[loss]] * FLIGHTS), "rotor_degradation")
    assert [f.term.key for f in found.found] == ["rotor_degradation@1"]
    assert found.open_causes == ()


def test_what_is_likely_and_not_sure_enough_for_a_name_is_corrected_for():
    """Hidden mass and thin air without a tank level that tells: no name, and no error either."""
    mass = Placed(effect=known_effect("extra_mass"), values={"mass": 1.0})
    found = identified(with_causes([[mass]] * FLIGHTS), "extra_mass", "air_density")
    assert found.after.rmse_rpm < 0.4 * found.before.rmse_rpm
    assert len(found.found) + len(found.open_causes) == 1
