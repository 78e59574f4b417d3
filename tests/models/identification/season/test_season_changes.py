"""What changed over a season, from sums alone: the right value, its date, and silence."""

import numpy as np
import pytest

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.recorded import CAMPAIGN, implanted
from tests.models.identification.season.made_seasons import (
    GAIN,
    LOSS_2,
    good_sums,
    good_tracks,
    season,
    wear,
    with_change,
)
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.flight_sums import flight_sums, season_sums
from thrustmargin.models.identification.season.season_changes import SeasonChanges, season_changes
from thrustmargin.models.model.model_file import shipped_model


def of(flights) -> SeasonChanges:
    return season_changes(season_sums(flights))


def entries(found: SeasonChanges) -> list[tuple[str, bool]]:
    return [(t.name, c.ramp) for t in found.trends for c in t.changes]


def test_a_propeller_that_wears_from_flight_60_of_100_is_dated_within_10():
    flights = season(np.random.default_rng(0), 100)
    found = of(with_change(flights, LOSS_2, wear(100, 60, 0.002)))
    assert entries(found) == [(LOSS_2, True)]
    (change,) = found.trends[0].changes
    assert abs(change.flight - 60) <= 10
    assert change.per_flight == pytest.approx(0.002, rel=0.1)
    assert found.trends[0].instead == ()


def test_a_swap_is_a_step_back_and_the_wear_before_it_stays_dated():
    flights = season(np.random.default_rng(4), 100)
    lost = np.where(np.arange(100) < 80, wear(100, 60, 0.002), 0.0)
    found = of(with_change(flights, LOSS_2, lost))
    assert entries(found) == [(LOSS_2, True), (LOSS_2, False)]
    swap = found.trends[0].changes[1]
    assert swap.flight == 80
    assert swap.after == pytest.approx(0.0, abs=0.004)


def test_a_drifting_gauge_beside_a_worn_propeller_are_two_changes():
    flights = season(np.random.default_rng(5), 100)
    flights = with_change(flights, GAIN, wear(100, 40, 0.002))
    found = of(with_change(flights, LOSS_2, np.where(np.arange(100) < 70, 0.0, 0.03)))
    assert sorted(entries(found)) == [(LOSS_2, False), (GAIN, True)]


def test_healthy_seasons_are_silent():
    # 15 here; `python -m tests.lab.bench.bench_season` counts 300.
    rng = np.random.default_rng(6)
    assert [e for _ in range(15) for e in entries(of(season(rng, 100)))] == []


def test_the_smallest_loss_that_would_have_been_seen_is_seen_and_half_of_it_is_not():
    flights = season(np.random.default_rng(7), 60)
    least = of(flights).trend(LOSS_2)
    assert least is not None
    late = np.arange(60) >= 50
    assert 0.0005 < least.least_seen < 0.005
    assert entries(of(with_change(flights, LOSS_2, 1.5 * least.least_seen * late)))
    assert not entries(of(with_change(flights, LOSS_2, 0.3 * least.least_seen * late)))


def test_what_a_twentieth_of_a_large_loss_could_make_is_not_named_beside_it():
    late = np.arange(40) >= 20
    flights = with_change(season(np.random.default_rng(12), 40), LOSS_2, 0.08 * late)
    assert entries(of(with_change(flights, "cg_offset.y", 0.001 * late))) == [(LOSS_2, False)]


def test_what_the_form_of_a_large_loss_leaves_elsewhere_is_no_change():
    model = shipped_model()
    logs = sorted(CAMPAIGN.parent.glob("dev/worn_prop_*.tlog"))
    worn = [flight_sums(model, read_log(path).track) for path in logs]  # 8 %, as flown
    found = of([*season(np.random.default_rng(12), 30), *worn * 10])
    assert entries(found) == [("rotor_degradation.loss@1", False)]
    assert found.trends[0].changes[0].size == pytest.approx(0.08, rel=0.1)


@pytest.mark.parametrize(("rotor", "loss", "forward"), [(2, 0.08, 0.002), (1, 0.15, 0.0)])
def test_a_large_loss_beside_a_small_shift_has_its_size_and_is_no_other_rotors(
    rotor: int, loss: float, forward: float
):
    model = shipped_model()
    faults = [
        Implant(kind="rotor", size=loss, condition={"rotor": rotor - 1}, truth={"loss": loss}),
        Implant(kind="cg", size=0.0, condition={"cg": (forward, 0.0)}),
    ]
    bad = [flight_sums(model, implanted(track, faults)) for track in good_tracks(12)[:6]]
    name = f"rotor_degradation.loss@{rotor}"
    changed = of([*good_sums(12), *bad * 2])
    assert entries(changed) == [(name, False), *([("cg_offset.x", False)] if forward else [])]
    assert changed.trends[0].changes[0].size == pytest.approx(loss, rel=0.03)
    always = of(bad)
    assert [one.name for one in always.shared] == [name]
    assert always.shared[0].value == pytest.approx(loss, rel=0.06)
    assert entries(always) == []


@pytest.mark.parametrize(
    ("kind", "name", "truth"),
    [("worn_prop", "rotor_degradation.loss@1", 0.08), ("cg_forward", "cg_offset.x", 0.04)],
)
def test_what_all_flights_have_in_common_is_named_with_an_interval_from_flights(
    kind: str, name: str, truth: float
):
    model = shipped_model()
    logs = sorted(CAMPAIGN.parent.glob(f"dev/{kind}_*.tlog"))
    flights = [flight_sums(model, read_log(path).track) for path in logs]
    (shared,) = of(flights).shared
    assert shared.name == name
    assert shared.value == pytest.approx(truth, rel=0.06)
    many = of(flights * 20).shared[0]  # the model's own uncertainty does not go away with flights
    assert many.error > 0.2 * shared.error


def test_two_per_cent_in_all_flights_may_be_the_models_own_and_is_not_named():
    flights = with_change(season(np.random.default_rng(8), 50), LOSS_2, np.full(50, 0.01))
    assert of(flights).shared == ()


def test_a_flights_own_estimate_is_its_share_of_the_sums():
    flights = good_sums(12)[:3]
    sums = season_sums(flights)
    value, error = sums.estimates(sums.names.index(LOSS_2), np.zeros((3, len(sums.names))))
    k = flights[0].names.index(LOSS_2)
    own = flights[0].limit("per_flight") > 0.0
    assert own.any()  # the wind of each flight is its own and is taken out
    mine = np.flatnonzero(np.append(own, False))
    bends = len(flights[0].bent)
    gram = np.delete(np.delete(flights[0].gram, range(-1 - bends, -1), 0), range(-1 - bends, -1), 1)
    block = gram[np.ix_(mine, mine)] + np.diag(flights[0].limit("scale")[own] ** -2.0)
    left = gram - gram[:, mine] @ np.linalg.inv(block) @ gram[mine]
    assert value[0] == pytest.approx(left[k, -1] / left[k, k])
    assert error[0] == pytest.approx(left[k, k] ** -0.5)


def test_a_flight_that_says_nothing_of_a_value_is_no_zero():
    flights = season(np.random.default_rng(9), 20)
    dumb = season_sums(flights)
    place = dumb.names.index(LOSS_2)
    dumb.information[7, place, :] = dumb.information[7, :, place] = dumb.pull[7, place] = 0.0
    value, error = dumb.estimates(place, np.zeros((20, len(dumb.names))))
    assert np.isnan(value[7])
    assert np.isinf(error[7])
    trend = season_changes(dumb).trend(LOSS_2)
    assert trend is not None
    assert np.isnan(trend.value[7])


def test_no_flights_are_no_season():
    with pytest.raises(DataError, match="no flight with sums"):
        season_sums([])
