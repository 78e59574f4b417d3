"""`identify` on logs that lack, hold or repeat channels: an answer, or one sentence that says why.

Whatever a log reports, the search ends with a result that can be written or with an error of the
project's own family; never with an exception of a library.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.models.made_flights import curve_model, made_flight
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.gcs_plugin.workshop.identify.identify_page import html_text
from thrustmargin.gcs_plugin.workshop.identify.identify_result import json_text, make_result
from thrustmargin.models.errors import ThrustMarginError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.usable_flights import too_little, wrong_speeds
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe

MEASURED = sorted(set(TRACK_CHANNELS) - {"position_ned", "throttle", "current", "spraying"})
TREATMENTS = ("missing", "constant", "zero", "quantised", "gaps", "late start", "one column")
#: With tank and airspeed, without a tank, and a network that needs airspeed.
MODELS = (curve_model(), physics_model(load_airframe("crazyflie-rpm")), shipped_model())

treated = st.dictionaries(st.sampled_from(MEASURED), st.sampled_from(TREATMENTS), max_size=4)
lengths = st.sampled_from([1.0, 20.0, 30.0])


def as_treated(values: np.ndarray, time_s: np.ndarray, how: str) -> np.ndarray:
    rows = time_s.reshape(-1, *[1] * (values.ndim - 1))
    match how:
        case "missing":
            return np.full_like(values, np.nan)
        case "constant":
            return np.zeros_like(values) + np.median(values, axis=0)
        case "zero":
            return np.zeros_like(values)
        case "quantised":
            return np.round(values / (np.ptp(values) / 3 or 1.0)) * np.ptp(values) / 3
        case "gaps":
            return np.where(rows // 7 % 2 == 0, values, np.nan)
        case "late start":
            return np.where(rows > 20, values, np.nan)
        case _:
            first = np.arange(values.shape[-1]) == 0 if values.ndim > 1 else rows < 0.0
            return np.where(first, np.nan, values)


def flights_of(
    count: int, length: float, loss: float, how: dict[str, str], seed: int = 0
) -> list[FlightTrack]:
    made = [
        made_flight(seed + k, duration=length, tank_kg=12.0 - 4.0 * k, loss=loss)
        for k in range(count)
    ]
    return [
        replace(t, **{c: as_treated(getattr(t, c), t.time_s, how[c]) for c in how}) for t in made
    ]


def ends_in_an_answer(
    flights: Sequence[FlightTrack], model: RotorModel, held_out: Sequence[FlightTrack] = ()
) -> None:
    """As the command goes about it, from the flights as read to all that it writes."""
    for track in (*flights, *held_out):
        reasons = wrong_speeds(track, model.airframe), too_little(track, model)
        words = [r if isinstance(r, str) else statement_words(r) for r in reasons if r is not None]
        assert not any("\n" in text for text in words)
    try:
        found = identify(flights, model, held_out=held_out)
    except ThrustMarginError as error:
        found, why = None, str(error)
    if found is None:
        assert why
        assert "\n" not in why
        return
    assert math.isfinite(found.before.rmse_rpm)
    assert math.isfinite(found.after.rmse_rpm)
    result = make_result(found, tracks=(*flights, *held_out))
    assert json.loads(json_text(result))["answer"]
    assert html_text(result)


@pytest.mark.slow
@settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[*HealthCheck],  # type: ignore[list-item]
)
@given(
    how=treated,
    held=treated,
    length=lengths,
    flights=st.integers(1, 3),
    loss=st.sampled_from([0.0, 0.1, 0.4]),
    model=st.sampled_from(MODELS),
)
def test_identify_answers_whatever_many_logs_report(how, held, length, flights, loss, model):
    unused = flights_of(flights - 1, length, loss, held, seed=7)
    ends_in_an_answer(flights_of(flights, length, loss, how), model, unused)
