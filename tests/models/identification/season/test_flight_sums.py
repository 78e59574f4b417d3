"""Sums of one flight: cheap, small, and saying what the rows say."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.undeclared.recorded import CAMPAIGN
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import effects_for
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.flight_sums import (
    KEPT_LEVELS,
    FlightEvidence,
    flight_sums,
    from_arrays,
    to_arrays,
)
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.model.model_file import shipped_model

DEV = CAMPAIGN.parent / "dev"


def value_alone(evidence: FlightEvidence, name: str) -> float:
    """What the flight says of one value if nothing else is there."""
    k = evidence.names.index(name)
    return evidence.gram[0, k, -1] / evidence.gram[0, k, k]


def test_a_worn_propeller_is_in_the_sums_of_its_flight():
    model = shipped_model()
    worn = flight_sums(model, read_log(DEV / "worn_prop_1.tlog").track)
    sound = flight_sums(model, read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track)
    assert 0.07 < value_alone(worn, "rotor_degradation.loss@1") < 0.095  # 8 %, not linear
    assert abs(value_alone(sound, "rotor_degradation.loss@1")) < 0.01


def test_the_sums_are_the_linear_problem_of_the_search():
    model, track = shipped_model(), read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track
    space = search_space(model, [track], effects_for(model.airframe))
    search = Search(space.reduced, space.nuisance, space.candidates)
    linear = search.linearise(search.fit(frozenset(), ()))
    evidence = flight_sums(model, track)
    q = len(evidence.names)
    loss = evidence.names.index("rotor_degradation.loss@3")
    lasting = [k for k in range(q) if "rotor_degradation.torque_share" not in evidence.names[k]]
    assert loss in lasting
    for mine, theirs in enumerate(KEPT_LEVELS):
        whole = linear.gram[theirs]
        np.testing.assert_allclose(
            evidence.gram[mine][np.ix_(lasting, lasting)], whole[np.ix_(lasting, lasting)]
        )
        np.testing.assert_allclose(evidence.gram[mine][lasting, -1], whole[lasting, -1])
        assert evidence.gram[mine][-1, -1] == pytest.approx(whole[-1, -1])
    assert np.all(evidence.known >= evidence.gram[0].diagonal()[:-1] - 1e-6)


def test_arrays_and_back_are_the_same_and_small():
    evidence = flight_sums(shipped_model(), read_log(DEV / "worn_prop_1.tlog").track)
    arrays = to_arrays(evidence)
    assert {a.dtype for a in arrays.values()} == {np.dtype(np.float64)}
    assert sum(a.nbytes for a in arrays.values()) < 40_000
    back = from_arrays(arrays)
    assert back.names == evidence.names
    np.testing.assert_array_equal(back.gram, evidence.gram)
    np.testing.assert_array_equal(back.limits, evidence.limits)
    assert (back.seconds, back.means) == (evidence.seconds, evidence.means)
    with pytest.raises(DataError, match="do not go together"):
        from_arrays({**arrays, "gram": arrays["gram"][:, :-1]})


def test_a_flight_without_rotor_speeds_says_so():
    track = read_log(DEV / "worn_prop_1.tlog").track
    silent = replace(track, rotor_speed_rpm=np.full_like(track.rotor_speed_rpm, np.nan))
    with pytest.raises(DataError, match="0 rows in flight"):
        flight_sums(shipped_model(), silent)


@pytest.mark.slow
def test_a_five_minute_flight_takes_less_than_a_second():
    model, track = shipped_model(), read_log(DEV / "worn_prop_1.tlog").track
    flight_sums(model, track)
    began = time.process_time()
    flight_sums(model, track)
    assert time.process_time() - began < 1.0 * max(1.0, track.time_s[-1] / 300.0)
