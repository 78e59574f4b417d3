"""An effect that asks for a channel that no flight has is refused by the catalogue."""

from dataclasses import replace

import pytest

from tests.models.known_effects import known_effect
from thrustmargin.models.effects import with_known_channels
from thrustmargin.models.errors import ModelError


def test_a_misspelt_channel_is_refused_with_the_one_that_is_meant():
    tank = known_effect("tank_scale")
    with pytest.raises(
        ModelError, match="tank_scale: no channel 'tank_kgs' is known; is it tank_kg"
    ):
        with_known_channels([replace(tank, needs=("tank_kgs",))])
    with pytest.raises(ModelError, match="no channel 'air_speed' is known"):
        with_known_channels([replace(tank, neutral={"air_speed": 0.0})])


def test_what_an_effect_makes_for_itself_is_known_to_others():
    made = known_effect("drag_moment")
    asks = replace(known_effect("tank_scale"), needs=(made.name,))
    assert with_known_channels([made, asks]) == [made, asks]
    with pytest.raises(ModelError):
        with_known_channels([asks])
