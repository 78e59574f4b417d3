"""Large changes that cancel, on made flights of a sound aircraft."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.plan import good_flights
from tests.lab.undeclared.subject import airframe_of
from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.identification.rows.candidates import Held, candidates_of, predicted
from thrustmargin.models.identification.rows.reduced import reduce_flights
from thrustmargin.models.identification.sets import set_search
from thrustmargin.models.identification.sets.discrepancy import form_columns
from thrustmargin.models.identification.sets.effect_forms import cancel, forms_of
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
IMPOSSIBLE = -1000000000.0

SPACE = search_space(
    curve_model(),
    made_flights(2, duration=60.0, hidden_mass=2.0),
    effects_for(F16, table(["extra_mass", "cg_offset", "rotor_degradation"])),
)


def held(values: Mapping[str, tuple[float, ...]]) -> list[Held]:
    """Effects by their keys, with their first values."""
    by_key = {c.key: c for c in SPACE.candidates}
    found = []
    for key, first in values.items():
        start = by_key[key].start.copy()
        start[:, : len(first)] = first
        found.append(Held(candidate=by_key[key], values=start))
    return found


def test_rotors_and_a_centre_of_gravity_that_take_back_each_other_cancel():
    """Rotors 2 and 4 are the rear pair: with a third less thrust they pitch as weight in front."""
    rear = {"rotor_degradation@2": (0.3, 1.0), "rotor_degradation@4": (0.3, 1.0)}
    shifts = np.linspace(-0.3, 0.3, 25)
    both = [cancel(SPACE.reduced, held({**rear, "cg_offset": (x, 0.0)})) for x in shifts]
    assert 1 <= sum(both) <= 6  # where it takes back what they do, and only there
    assert not both[12]  # of a centre of gravity that is in the middle nothing is taken back
    assert not cancel(SPACE.reduced, held(rear))


@pytest.mark.parametrize(
    "alone", [{}, {"rotor_degradation@2": (0.3, 1.0)}, {"cg_offset": (0.2, 0.0)}]
)
def test_one_effect_cancels_nothing(alone):
    assert not cancel(SPACE.reduced, held(alone))


def test_small_changes_that_cancel_buy_no_freedom():
    rear = {"rotor_degradation@2": (0.01, 1.0), "rotor_degradation@4": (0.01, 1.0)}
    shifts = np.linspace(-0.01, 0.01, 25)
    assert not any(cancel(SPACE.reduced, held({**rear, "cg_offset": (x, 0.0)})) for x in shifts)


def test_masses_change_no_share_however_large():
    assert not cancel(SPACE.reduced, held({"extra_mass": (15.0,), "cg_offset": (0.001, 0.0)}))


def test_a_set_that_cancels_has_no_weight_in_a_search(monkeypatch):
    search = Search(SPACE.reduced, SPACE.nuisance, SPACE.candidates)
    empty = search.fit(frozenset(), ())
    monkeypatch.setattr(set_search, "cancel", lambda _, held: len(held) == 2)
    pair, one = frozenset({0, 1}), frozenset({0})
    assert search.fit(pair, ()).total < IMPOSSIBLE / 2
    assert search.fit(one, ()).total > empty.total
    assert set(search.possible) == {frozenset(), one}
    search._again(search.linearise(search.best))
    assert search.fitted[pair].total < IMPOSSIBLE / 2


def test_how_a_rotor_answers_to_load_is_uncertain_where_no_flight_has_taught_the_model():
    """A column a rotor: a twentieth of what it is predicted to do about the mean of its flight."""
    speed = predicted(SPACE.reduced, []) @ SPACE.reduced.modes.directions.T
    about = np.concatenate([speed[f] - speed[f].mean(axis=0) for f in flights_of(SPACE.reduced)])
    forms = forms_of(SPACE.reduced, form_columns(SPACE.reduced.channels), [])
    assert forms.count == 4
    for rotor in range(4):
        own = np.zeros_like(about)
        own[:, rotor] = 0.05 * about[:, rotor]
        by_hand = own @ SPACE.reduced.modes.directions
        np.testing.assert_allclose(forms.values[:, :, rotor], by_hand, atol=1e-9)
    assert forms.values.std() > 0.05
    model = replace(SPACE.reduced.model, good_flights=GoodFlights(flights=3))
    taught = replace(SPACE.reduced, model=model)
    assert forms_of(taught, form_columns(SPACE.reduced.channels), []).count == 0


def test_no_load_asks_for_another_share_among_rotors_that_makes_no_force_and_no_moment(tmp_path):
    """On a hexacopter mass and a bad rotor may have another form in four modes of six."""
    craft = next(one for one in CRAFTS if one.name == "hexa-x-12kg")
    tracks = [flight.track for flight in good_flights(craft, 2)]
    model = physics_model(airframe_of(craft, tmp_path))
    reduced = reduce_flights(replace(model, good_flights=GoodFlights(flights=2)), tracks)
    slow = form_columns(reduced.channels)
    by_key = {c.key: c for c in candidates_of(reduced, effects_for(model.airframe))}
    for key, value, rest in (("extra_mass", 1.0, 0.0), ("rotor_degradation@1", 0.1, 0.1)):
        start = by_key[key].start.copy()
        start[:, 0] = value
        held = [Held(candidate=by_key[key], values=start)]
        change = predicted(reduced, held) - predicted(reduced, [])
        main = change @ np.linalg.eigh(change.T @ change)[1][:, -1]
        by_hand = np.sum(np.mean((0.05 * main[:, None] * slow) ** 2, axis=0))
        wide = forms_of(reduced, slow, held).wide(reduced.flight)
        square = np.sum(np.mean(np.square(wide), axis=0), axis=1)
        assert square[:4] == pytest.approx(by_hand, rel=0.02)  # a constant part, and along channels
        assert np.all(square[4:] <= rest**2 * square.max())  # of what it does there by the way


def flights_of(reduced):
    return [reduced.flight == f for f in range(reduced.flights)]
