"""Predicted thrust left before and with effects, by hand from weight and thrust curve."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, curve_model, made_flights
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.answer.model_update import margin_changes
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.physics.margin import ceiling

#: As the code has them, written down by hand: a change there is to be seen here.
WORST_SHARE = 0.01

MODEL = curve_model()
MASS, WIND = known_effect("extra_mass"), known_effect("wind")


@pytest.fixture(scope="module")
def problems():
    flights = made_flights(3)
    return assemble(MODEL, flights[:2]), assemble(MODEL, flights[2:])


def found(problem, held_out, *effects: Any) -> Any:
    return SimpleNamespace(found=effects, problem=problem, held_out=held_out, open_causes=())


def heavier(kg: float, flights: int = 2) -> Any:
    return SimpleNamespace(term=Term(effect=MASS), value=np.full((flights, 1), kg))


def margins(problem, *extra_kg: float) -> np.ndarray:
    """(T,) of rotors alike: thrust over the most at this voltage and density; each mass is a share
    of the weight more."""
    x = problem.channels
    speed = problem.speeds()[:, 0]
    for mass in extra_kg:
        speed = speed * np.sqrt(1.0 + mass / x.total_mass)
    return 1.0 - (speed / ceiling(F16, x.density, x.voltage).max_rotor_speed_rpm) ** 2


def figures(margin: np.ndarray) -> list[float]:
    return [float(np.median(margin)), float(np.quantile(margin, WORST_SHARE))]


def test_each_effect_takes_its_part_on_the_flights_held_out(problems):
    fit, unused = problems
    steps, whole = margin_changes(found(fit, unused, heavier(2.0), heavier(1.0)))
    none, first, both = (figures(margins(unused, *kg)) for kg in ((), (2.0,), (2.0, 1.0)))
    assert [steps[0].typical_before, steps[0].worst_before] == pytest.approx(none, rel=1e-6)
    assert [steps[0].typical_after, steps[0].worst_after] == pytest.approx(first, rel=1e-6)
    assert [steps[1].typical_before, steps[1].worst_before] == pytest.approx(first, rel=1e-6)
    assert [whole.typical_before, whole.worst_before] == pytest.approx(none, rel=1e-6)
    assert [whole.typical_after, whole.worst_after] == pytest.approx(both, rel=1e-6)
    assert {s.flights for s in (*steps, whole)} == {"held_out"}
    assert whole.rotor is None


def test_without_flights_held_out_it_is_that_of_the_fitted_ones(problems):
    fit, _ = problems
    (step,), _ = margin_changes(found(fit, None, heavier(2.0)))
    assert step.flights == "fit"
    assert step.typical_after == pytest.approx(np.median(margins(fit, 2.0)), rel=1e-6)


def test_the_margin_before_is_with_the_effects_that_the_model_had():
    mass = Identified(value=4.0, unit="kg", ci95=(3.9, 4.1))
    known = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    fit = assemble(replace(MODEL, effects=(known,)), made_flights(2))
    _, whole = margin_changes(found(fit, None))
    assert whole.typical_before == whole.typical_after
    plain = assemble(MODEL, made_flights(2))
    assert whole.typical_before == pytest.approx(np.median(margins(plain, 4.0)), rel=1e-6)


def test_values_of_single_flights_are_those_of_their_own_rows(problems):
    fit, unused = problems
    wind = SimpleNamespace(term=Term(effect=WIND), value=np.array([[0.0, 0.0], [6.0, 0.0]]))
    steps, _ = margin_changes(found(fit, unused, wind))
    assert steps[0].flights == "fit"
    nobody = SimpleNamespace(term=Term(effect=WIND), value=np.zeros((2, 2)))
    calm, _ = margin_changes(found(fit, unused, nobody))
    assert steps[0].typical_before == pytest.approx(calm[0].typical_before)


def test_a_bad_rotor_s_margin_is_its_own(problems):
    fit, _ = problems
    effect = known_effect("rotor_degradation")
    start = [p.start for p in effect.parameters]
    values = np.array([[0.1, *start[1:]]] * 2)
    bad = SimpleNamespace(term=Term(effect=effect, rotor=2), value=values)
    (step,), whole = margin_changes(found(fit, None, bad))
    assert step.rotor == 2
    assert step.typical_before == pytest.approx(np.median(margins(fit)), rel=1e-6)
    assert step.typical_after < step.typical_before - 0.02
    assert whole.typical_after <= step.typical_after + 1e-9
