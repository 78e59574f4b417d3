"""When a rotor went bad: in one flight, in each, or in one and all flights after it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, QUICK, made_flight
from thrustmargin.models.effects.rotor_degradation import ONSETS, ROTOR_DEGRADATION
from thrustmargin.models.identification import onset
from thrustmargin.models.identification.fit import Evaluator, fit_terms, linearise
from thrustmargin.models.identification.identify import identify
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.identification.search import look
from thrustmargin.models.identification.terms import Term, layout_of, starts
from thrustmargin.models.model.rotor_model import physics_model

DAY = 1.78e9  # s, Unix time


def flights(losses, at):
    """Three dated flights with `losses` of rotor 3 from `at` seconds into each."""
    tracks = [
        made_flight(k + 1, loss=loss, rotor=2, loss_from=time)
        for k, (loss, time) in enumerate(zip(losses, at, strict=True))
    ]
    return [replace(t, start_unix_s=DAY + 1200.0 * k) for k, t in enumerate(tracks)]


def scanned(tracks):
    problem = assemble(physics_model(F16), tracks)
    evaluator = Evaluator(problem)
    base = fit_terms(evaluator, (), scales=np.ones(4))
    columns = [near_loss(evaluator, base, rotor) for rotor in range(4)]
    return onset.scan(problem, np.stack(columns), base.whitened)


def near_loss(evaluator, base, rotor):
    """Weighted derivative (T, R) by the loss of a rotor that is sound."""
    term = Term(effect=ROTOR_DEGRADATION, rotor=rotor)
    layout = layout_of((term,), evaluator.problem.flights)
    near = linearise(evaluator, (term,), layout, starts(layout), base.scales)
    return near.jacobian[:, :, 0]


def test_the_kind_of_onset_with_the_largest_gain_is_the_one_that_was_flown():
    one = scanned(flights([0.0, 0.1, 0.0], [0.0, 40.0, 0.0]))
    each = scanned(flights([0.1, 0.1, 0.1], [40.0] * 3))
    since = scanned(flights([0.0, 0.1, 0.1], [0.0, 40.0, 0.0]))
    for found, kind in ((one, onset.ONE), (each, onset.EACH), (since, onset.SINCE)):
        best = max(found.values(), key=lambda o: o.gain)
        assert best.kind == kind
        assert best.rotor == 2
        assert best.time_s == pytest.approx(40.0, abs=1.5)
        assert best.loss == pytest.approx(0.1, abs=0.02)
    assert since[onset.SINCE].flight == 1


def test_flights_without_a_date_have_no_order():
    tracks = [replace(t, start_unix_s=None) for t in flights([0.1] * 3, [40.0] * 3)]
    assert set(scanned(tracks)) == {onset.ONE, onset.EACH}


def test_a_chipped_propeller_is_found_beside_a_rotor_known_to_be_worn():
    """The worn one comes first in the order of rotors, and is no candidate any more."""
    worn = np.array([np.sqrt(0.9), 1.0, 1.0, 1.0])
    tracks = [
        replace(t, rotor_speed_rpm=t.rotor_speed_rpm / worn)
        for t in flights([0.0, 0.1, 0.1], [0.0, 40.0, 0.0])
    ]
    evaluator = Evaluator(assemble(physics_model(F16), tracks))
    known = (Term(effect=ROTOR_DEGRADATION, rotor=0),)
    base = fit_terms(evaluator, known, scales=np.ones(4))
    catalogue = (ROTOR_DEGRADATION, *ONSETS)
    step = look(evaluator, base, catalogue, QUICK, np.random.default_rng(0))
    assert step.chosen is not None
    assert (step.chosen.term.effect.variant, step.chosen.term.rotor) == (onset.SINCE, 2)


def test_a_rotor_bad_all_along_gains_more_than_any_step():
    tracks = flights([0.1] * 3, [0.0] * 3)
    evaluator = Evaluator(assemble(physics_model(F16), tracks))
    base = fit_terms(evaluator, (), scales=np.ones(4))
    column = near_loss(evaluator, base, 2)
    all_along = onset.gain_all_along(column, base.whitened)
    assert all_along > max(found.gain for found in scanned(tracks).values())


@pytest.mark.slow
def test_a_propeller_that_chipped_is_bad_in_the_flights_after_it():
    tracks = flights([0.0, 0.1, 0.1], [0.0, 40.0, 0.0])
    later = replace(made_flight(9, loss=0.1, rotor=2), start_unix_s=DAY + 5000.0)
    found = identify(tracks, physics_model(F16), held_out=[later], config=QUICK)
    assert [(f.term.effect.variant, f.term.rotor) for f in found.found] == [("since", 2)]
    told = found.found[0].parameters(found.problem.names)
    assert told["loss"]["ci95"][0] <= 0.1 <= told["loss"]["ci95"][1]
    chipped = DAY + 1200.0 + 40.0
    assert told["onset_clock"]["value"] == pytest.approx(chipped, abs=1.5)
    assert found.after.rmse_rpm < 0.5 * found.before.rmse_rpm
