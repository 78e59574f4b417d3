"""A rotor that loses .4 % of its thrust a flight, in the plant's flights, through the offsets."""

from typing import Any

import numpy as np
import pytest

from tests.lab.slow_loss import Season, flights_of
from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
from thrustmargin.models.model.flight_lessons import flight_offsets
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.offset_total import rotor_total


def first_named(season: Season, count: int) -> Any:
    """The flights after which a rotor is first named, and the total."""
    rows = []
    for track in flights_of(season):
        if len(rows) == count:
            break
        analysis = analysis_for_verdict(analyse(track, shipped_model()))
        assert track.start_unix_s is not None
        row = flight_offsets(
            analysis, flight=track.name, start_unix_s=track.start_unix_s, longitude_deg=np.nan
        )
        rows.append(row)
        if found := rotor_total(rows, shipped_model()):
            return len(rows), found
    return None, None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [100, 103])
def test_a_worn_rotor_is_named_before_six_per_cent(seed: int):
    count, found = first_named(Season(seed=seed, rotor=seed % 4, per_flight=0.004), 15)
    assert found is not None
    assert found.rotor == seed % 4
    assert found.low <= 0.004 * count <= found.high


@pytest.mark.slow
def test_a_sound_aircraft_is_left_alone():
    assert first_named(Season(seed=200), 40)[1] is None
