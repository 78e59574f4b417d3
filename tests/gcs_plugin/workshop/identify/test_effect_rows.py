"""The table of effects: amounts of one unit are all in it, or all in the smaller one."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.models.known_effects import known_effect
from thrustmargin.gcs_plugin.workshop.identify.identify_result import effect_rows


def found(largest: float) -> Any:
    """An identification whose only effect has inertias of `largest` and a millionth of it."""
    effect = known_effect("manoeuvre_moment")
    value = np.full((1, len(effect.parameters)), 1e-6 * largest)
    value[0, 0] = largest
    one = SimpleNamespace(
        term=SimpleNamespace(effect=effect, rotor=None),
        value=value,
        lower=0.5 * value,
        upper=1.5 * value,
        flight=0,
        probability=0.99,
    )
    return SimpleNamespace(
        found=[one],
        gaining=frozenset(),
        problem=SimpleNamespace(names=["a"]),
        model=SimpleNamespace(airframe=SimpleNamespace(rotor_names=("front",))),
    )


def test_inertias_of_one_table_share_a_unit():
    inertias = [amount for name, amount, *_ in effect_rows(found(0.3)) if "inertia" in name]
    assert len(inertias) > 1
    assert all(amount.endswith(" kg m²") for amount in inertias)


def test_inertias_of_a_small_aircraft_are_all_in_the_smaller_unit():
    inertias = [amount for name, amount, *_ in effect_rows(found(0.001)) if "inertia" in name]
    assert all(amount.endswith(" g cm²") for amount in inertias)
