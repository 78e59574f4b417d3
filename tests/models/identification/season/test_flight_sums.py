"""Sums of one flight: cheap, small, and saying what the rows say."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.recorded import CAMPAIGN, implanted
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import effects_for
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.rows.reduced import reduce_flights
from thrustmargin.models.identification.season.flight_sums import (
    FlightEvidence,
    flight_sums,
    from_arrays,
    to_arrays,
)
from thrustmargin.models.identification.sets import discrepancy
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.model.model_file import shipped_model

DEV = CAMPAIGN.parent / "dev"


def value_alone(evidence: FlightEvidence, name: str) -> float:
    """What the flight says of one value if nothing else is there."""
    k = evidence.names.index(name)
    return evidence.gram[k, -1] / evidence.gram[k, k]


def test_a_worn_propeller_is_in_the_sums_of_its_flight():
    model = shipped_model()
    worn = flight_sums(model, read_log(DEV / "worn_prop_1.tlog").track)
    sound = flight_sums(model, read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track)
    assert 0.07 < value_alone(worn, "rotor_degradation.loss@1") < 0.095  # 8 %, not linear
    assert abs(value_alone(sound, "rotor_degradation.loss@1")) < 0.01


def test_the_sums_are_the_linear_problem_of_the_search():
    model, track = shipped_model(), read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track
    # Sums of flights add up about one place, so a delay stands at none, whatever the rows show.
    means = reduce_flights(model, [track], delays=False)
    # An effect on one arm is in the sums as its variant without one.
    lasting_effects = [e for e in effects_for(model.airframe) if not e.of_one_arm]
    space = search_space(model, [track], lasting_effects, means)
    search = Search(space.reduced, space.nuisance, space.candidates)
    linear = search.linearise(search.fit(frozenset(), ()))
    evidence = flight_sums(model, track)
    q = len(evidence.names)
    loss = evidence.names.index("rotor_degradation.loss@3")
    lasting = [k for k in range(q) if "rotor_degradation.torque_share" not in evidence.names[k]]
    assert loss in lasting
    mine, whole = evidence.gram, 1.25**2 * linear.gram  # a search takes the noise for larger
    np.testing.assert_allclose(mine[np.ix_(lasting, lasting)], whole[np.ix_(lasting, lasting)])
    np.testing.assert_allclose(mine[lasting, -1], whole[lasting, -1])
    assert mine[-1, -1] == pytest.approx(whole[-1, -1])
    assert np.all(evidence.known >= mine.diagonal()[:q] - 1e-6)


def test_a_late_flight_has_its_sums_about_no_delay_as_every_other():
    model, track = shipped_model(), read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track
    columns = [np.interp(track.time_s - 0.1, track.time_s, c) for c in track.rotor_speed_rpm.T]
    late = replace(track, rotor_speed_rpm=np.column_stack(columns))
    for flight in (track, late):
        sums = flight_sums(model, flight)
        assert sums.limit("absent")[sums.names.index("sensor_lag:rotor speed.lag")] == 0.0
    # The search of the same flight starts where its rows show the delay.
    space = search_space(model, [late], effects_for(model.airframe))
    search = Search(space.reduced, space.nuisance, space.candidates)
    (began,) = [h for h in search.start if h.candidate.key == "sensor_lag:rotor speed"]
    assert began.values[0, 0] == pytest.approx(0.1, abs=0.01)


def test_about_a_loss_the_sums_are_those_of_an_aircraft_that_has_it():
    model, track = shipped_model(), read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track
    worn = [Implant(kind="rotor", size=0.1, condition={"rotor": 2}, truth={"loss": 0.1})]
    evidence = flight_sums(model, implanted(track, worn))
    k = evidence.names.index("rotor_degradation.loss@3")
    values = np.where(np.arange(len(evidence.names)) == k, 0.1, 0.0)
    about = evidence.linearise_at(values)
    linear = evidence.gram[k, -1] / evidence.gram[k, k]
    sound = flight_sums(model, track)
    own = sound.gram[k, -1] / sound.gram[k, k]  # what the flight had before
    assert about[k, -1] / about[k, k] == pytest.approx(0.1 + own, rel=0.06)  # torque differs
    assert linear > 1.06 * (0.1 + own)


def test_arrays_and_back_are_the_same_and_small():
    evidence = flight_sums(shipped_model(), read_log(DEV / "worn_prop_1.tlog").track)
    arrays = to_arrays(evidence)
    assert {a.dtype for a in arrays.values()} == {np.dtype(np.float64)}
    assert sum(a.nbytes for a in arrays.values()) < 13_000
    back = from_arrays(arrays)
    assert back.names == evidence.names
    np.testing.assert_array_equal(back.gram, evidence.gram)
    np.testing.assert_array_equal(back.limits, evidence.limits)
    assert (back.seconds, back.means) == (evidence.seconds, evidence.means)
    with pytest.raises(DataError, match="do not go together"):
        from_arrays({**arrays, "gram": arrays["gram"][:-1]})


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


def test_slow_noise_of_a_flight_is_learnt_as_with_all_nuisances_kept(monkeypatch):
    """What one flight shares with others leaves before the steps; the sums are the same."""
    model, track = shipped_model(), read_log(CAMPAIGN / "v4_m10_q2.5.tlog").track
    quick = flight_sums(model, track)
    kept = []

    def keep(sums, level):
        kept.append(level)
        return sums

    monkeypatch.setattr(discrepancy, "_marginalise_shared", keep)
    whole = flight_sums(model, track)
    assert kept
    size = np.sqrt(np.outer(np.diag(whole.gram), np.diag(whole.gram)))
    np.testing.assert_allclose(quick.gram / size, whole.gram / size, atol=2e-6)
