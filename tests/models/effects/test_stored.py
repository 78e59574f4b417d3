"""Effects of a model file become effects in place, or the file is refused with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from thrustmargin.models.effects.compose import EffectRecord, Identified, losses_of, placed_from
from thrustmargin.models.errors import ModelError


def number(value: float, unit: str) -> Identified:
    return Identified(value=value, unit=unit, ci95=(value, value))


WORN = EffectRecord(
    name="rotor_degradation",
    rotor=4,
    parameters={"loss": number(0.1, "1"), "torque_share": number(0.5, "1")},
)
ALONG = EffectRecord(
    name="cg_offset",
    variant="tank",
    rotor=None,
    parameters={"x_full": number(0.02, "m"), "y_full": number(-0.01, "m")},
)


def test_rotors_count_from_one_in_files_and_variants_have_their_own_form():
    worn, along = placed_from([WORN, ALONG], 4)
    assert worn.effect is known_effect("rotor_degradation")
    assert (worn.rotor, dict(worn.values)) == (3, {"loss": 0.1, "torque_share": 0.5})
    assert along.effect is known_effect("cg_offset:tank")
    assert (along.rotor, dict(along.values)) == (None, {"x_full": 0.02, "y_full": -0.01})
    assert placed_from([replace(WORN, rotor=1)], 4)[0].rotor == 0


def test_what_older_files_did_not_know_is_as_it_was():
    record = EffectRecord(
        name="battery_voltage", rotor=None, parameters={"exponent": number(2.0, "1")}
    )
    (placed,) = placed_from([record], 4)
    assert dict(placed.values) == {"exponent": 2.0, "level": 0.0}


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (replace(WORN, rotor=0), "names rotor 0 of 4"),
        (replace(WORN, rotor=5), "names rotor 5 of 4"),
        (replace(WORN, rotor=None), "names rotor None"),
        (replace(ALONG, rotor=2), "names rotor 2"),
        (replace(WORN, name="rust"), "'rust', which this version does not know"),
        (replace(ALONG, variant="spray"), "'cg_offset:spray'"),
        (replace(WORN, parameters={"loss": number(0.1, "1")}), "needs torque_share in '1'"),
        (
            replace(ALONG, parameters={**ALONG.parameters, "x_full": number(20.0, "mm")}),
            "needs x_full in 'm'",
        ),
        (
            replace(ALONG, parameters={**ALONG.parameters, "y_full": number(np.nan, "m")}),
            "needs y_full in 'm'",
        ),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_what_cannot_be_of_this_aircraft_is_refused(record, words):
    with pytest.raises(ModelError, match="effect") as refused:
        placed_from([record], 4)
    assert words in str(refused.value)


def test_a_rotor_loses_what_all_its_records_say_together_and_of_a_curve_the_most():
    values = {f"at_{k + 1}": number(v, "1") for k, v in enumerate((0.0, 0.01, 0.04, 0.02))}
    ends = {"low": number(0.0, "m/s"), "high": number(9.0, "m/s")}
    curve = EffectRecord(
        name="unnamed_cause",
        variant="rotor along airspeed",
        rotor=4,
        parameters={**values, **ends},
    )
    other = replace(WORN, rotor=2)
    losses = losses_of([WORN, ALONG, curve, other])
    assert {rotor: round(loss.value, 6) for rotor, loss in losses.items()} == {4: 0.14, 2: 0.1}
    assert losses[4].ci95 == pytest.approx((0.14, 0.14))
