"""The load that hover thrust shows: by hand, and against the gauge of recorded flights."""

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.checks.speed_readings import check_speed_scale
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.rows.usable_flights import too_little
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.inferred.load_evidence import (
    LoadEvidence,
    load_fit,
    whole_flight_evidence,
)
from thrustmargin.models.model.inferred.load_inference import (
    with_load,
    with_load_for_verdict,
    with_load_so_far,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.network.records import gather
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.provenance import (
    Provenance,
    Reason,
    Rejected,
    SourceKind,
    stated,
)
from thrustmargin.models.statement import state

G0 = 9.80665  # m/s²


#: As the code has them, written down by hand: a change there is to be seen here.
NINETY = 1.645

SPAN = 10.0  # s of one mean
F16 = load_airframe("topxgun-f16-sitl")
SITL = Path("sitl_logs")
START = LoadEvidence()
RNG = np.random.default_rng(7)


def hover(kilograms, *, craft: Airframe = F16, noise: float = 0.01, **channels) -> FlightTrack:
    """A hover at 10 Hz of the reference air with `kilograms` (T,) on board and noisy speeds."""
    load = np.asarray(kilograms, dtype=float)
    rows = load.size
    thrust = (craft.empty_mass + load) * G0 / craft.rotor_effectiveness.sum()
    speed = np.sqrt(thrust / craft.thrust_coefficient)[:, None] * np.ones(craft.rotor_count)
    level = np.zeros((rows, 3))
    given = {
        "rotor_speed_rpm": speed * (1.0 + noise * RNG.standard_normal(speed.shape)),
        "specific_force_frd": level - [0.0, 0.0, G0],
        "attitude": level,
        "velocity_ned": level,
        "airspeed": np.zeros(rows),
        "height_agl": np.full(rows, 5.0),
    }
    return FlightTrack.of(
        name="hover",
        time_s=np.arange(rows, dtype=np.float64) / 10.0,
        rotor_count=craft.rotor_count,
        **given | channels,
    )


def guessed(craft: Airframe, name: str) -> Airframe:
    quantities = {**craft.quantities, name: replace(craft.quantities[name], guessed=True)}
    return replace(craft, quantities=MappingProxyType(quantities))


def test_an_instrument_that_was_turned_down_is_still_said_beside_the_load_that_thrust_shows():
    frozen = (Rejected(sent("NAMED_VALUE_FLOAT"), Reason.FROZEN),)
    track = hover(np.full(600, 8.0))
    gone = Provenance(kind=SourceKind.ABSENT, rejected=frozen)
    track = replace(track, sources={**track.sources, "tank_kg": gone})
    source = with_load(track, F16).source("tank_kg")
    assert (source.kind, source.rejected) == ("inferred", frozen)
    part, _ = with_load_so_far(track, F16, START)
    assert part.source("tank_kg").rejected == frozen


@pytest.mark.parametrize(("until", "stays"), [(400, True), (100, False)])
def test_a_gauge_that_falls_silent_early_hides_no_load_that_thrust_shows(until, stays):
    """Of 60 s: 40 s of a gauge are two thirds of the flight, 10 s a sixth."""
    gauge = np.where(np.arange(600) < until, 8.0, np.nan)
    track = hover(np.full(600, 8.0), tank_kg=gauge)
    track = replace(track, sources={**track.sources, "tank_kg": sent("NAMED_VALUE_FLOAT")})
    made = with_load(track, F16)
    assert (made is track) is stays
    assert np.isfinite(made.tank_kg[track.flying]).all() == (not stays)
    if not stays:
        source = made.source("tank_kg")
        assert [one.reason for one in source.rejected] == [Reason.COVERS_LESS]
        assert "covers 17% of the flight" in source_words(source)
        assert np.median(made.tank_kg) == pytest.approx(8.0, abs=0.3)


def test_a_hover_shows_its_load_with_an_interval_that_holds_it():
    found = with_load(hover(np.full(600, 9.0), spraying=np.zeros(600)), F16)
    error = found.standard_errors["tank_kg"]
    # 3 % of the curve and 8 % of air that nothing tells, of 30.1 kg, and little scatter
    common = np.hypot(0.03, 0.1 / 1.225) * (F16.empty_mass + 9.0)
    np.testing.assert_allclose(error, common, rtol=0.03)
    np.testing.assert_allclose(found.tank_kg, 9.0, atol=0.2)
    width = f"± {NINETY * np.median(error):.1f} kg, 90 %"
    assert (
        source_words(found.sources["tank_kg"]) == f"inferred from hover thrust ({width}; constant)"
    )
    assert not np.isfinite(found.measured("tank_kg")).any()


@pytest.mark.parametrize("told", [None, "3 kg"])
def test_a_margin_is_judged_with_the_load_of_thrust_where_a_gauge_surely_has_less(told):
    # 3 % of the curve and 8 % of the air of 30.1 kg: 2.6 kg, of which 2.6 make 6.9 kg.
    sources = {"tank_kg": stated(state("as written", text=told)) if told else sent("GAUGE")}

    def judged(tank_kg):
        gauge = np.full(600, tank_kg)
        flight = hover(np.full(600, 9.0), spraying=np.zeros(600), tank_kg=gauge, sources=sources)
        return flight, with_load_for_verdict(flight, F16)

    for near in (2.7, 9.0, 30.0):  # a gauge that has more leaves less margin: it is believed
        before, after = judged(near)
        assert after is before
    before, after = judged(1.7)
    np.testing.assert_allclose(after.tank_kg, 9.0, atol=0.2)
    assert not np.isfinite(after.measured("tank_kg")).any()
    by = "as stated" if told else "by GAUGE"
    words = f"1.7 kg {by} are too little for these rotor speeds: check gauge and empty mass"
    assert words in source_words(after.sources["tank_kg"])
    assert with_load_for_verdict(after, F16) is after
    # What is looked for in the flight still sees the load as it was told.
    np.testing.assert_array_equal(with_load(before, F16).tank_kg, 1.7)


def test_it_falls_while_the_pump_runs_until_the_tank_is_empty():
    spraying = (np.arange(2400) % 300 > 100).astype(float)
    load = np.maximum(6.0 - 0.05 * 0.1 * np.cumsum(spraying), 0.0)
    assert np.mean(load == 0.0) > 0.1
    found = with_load(hover(load, spraying=spraying), F16)
    np.testing.assert_allclose(found.tank_kg, load, atol=0.35)
    assert source_words(found.sources["tank_kg"]).endswith("falling with the pump's output)")


def test_before_a_fall_is_seen_the_pump_is_taken_to_run_at_half_its_flow():
    rows = int(10 * SPAN)  # one mean: a level, and nothing of a slope
    found = with_load(hover(np.full(rows, 9.0), spraying=np.ones(rows)), F16)
    half = 0.5 * F16.pump_max_flow_l_min / 60.0 * F16.liquid_density  # kg/s
    np.testing.assert_allclose(np.diff(found.tank_kg), -0.1 * half, rtol=1e-3)


def test_a_load_that_falls_from_the_first_row_to_the_last_is_one_line():
    _, shown = with_load_so_far(hover(8.0 - 0.004 * np.arange(1800), noise=1e-4), F16, START)
    fit = load_fit(shown, F16)
    assert fit is not None
    assert fit.span == (0.0, np.inf)
    np.testing.assert_allclose(fit.values, [8.0, 0.04], rtol=0.02)  # kg, kg/s


def test_without_a_pump_it_falls_by_its_own_trend_and_never_fills_in_flight():
    load = np.interp(np.arange(1800), [400, 1500], [8.0, 2.0])
    found = with_load(hover(load), F16)
    np.testing.assert_allclose(found.tank_kg, load, atol=0.5)
    assert source_words(found.sources["tank_kg"]).endswith("falling by its own trend)")
    fuller = with_load(hover(load[::-1]), F16)
    np.testing.assert_allclose(fuller.tank_kg, fuller.tank_kg[0])
    assert source_words(fuller.sources["tank_kg"]).endswith("constant)")


def test_a_tank_that_is_filled_between_two_flights_has_two_loads():
    flying = np.ones(1800, dtype=bool)
    flying[800:1000] = False
    load = np.where(np.arange(1800) < 900, 2.0, 12.0)
    found = with_load(hover(load, flying=flying, spraying=np.zeros(1800)), F16)
    np.testing.assert_allclose(found.tank_kg[flying], load[flying], atol=0.3)


@pytest.mark.parametrize("stays_s", [0.5, 1.5, 4.5])
def test_a_tank_filled_in_seconds_has_two_loads_and_a_touch_of_the_ground_has_one(stays_s):
    rows = np.arange(1200)
    flying = (rows < 600) | (rows > 600 + 10.0 * stays_s)
    filled = with_load(hover(np.where(rows < 600, 3.0, 9.0), flying=flying), F16)
    early, late = filled.tank_kg[:600], filled.tank_kg[700:]
    if stays_s < 1.0:  # no hose is that quick: the fit is one, whatever it is off by
        assert np.median(late) < 8.0
    else:
        np.testing.assert_allclose(early, 3.0, atol=0.3)
        np.testing.assert_allclose(late, 9.0, atol=0.3)
    # Where thrust shows one load, one fit has all of the evidence.
    shown, *_ = whole_flight_evidence(hover(np.full(1200, 6.0), flying=flying), F16)
    assert shown.leg == 1


def test_a_guessed_curve_widens_the_interval():
    track = hover(np.full(600, 9.0), pressure=np.full(600, 101_325.0))
    sure = with_load(track, F16).standard_errors["tank_kg"]
    unsure = with_load(track, guessed(F16, "thrust_coefficient")).standard_errors["tank_kg"]
    assert np.all(unsure > 1.8 * sure)


@pytest.mark.parametrize(
    ("kilograms", "says"),
    [(-9.0, "less than nothing"), (60.0, "more than the aircraft can carry")],
)
def test_what_cannot_be_is_not_used_but_said(kilograms: float, says: str):
    found = with_load(hover(np.full(600, kilograms)), F16)
    assert not found.reports("tank_kg")
    note = statement_words(found.statements[-1])
    assert note.startswith("load not known: hover thrust shows")
    assert says in note
    assert "--load" in note


def test_too_unsure_a_load_is_not_used():
    rough = hover(np.full(600, 9.0), standard_errors={"rotor_speed_rpm": np.full((600, 4), 250.0)})
    assert "too unsure" in statement_words(with_load(rough, F16).statements[-1])


def test_speeds_that_were_inferred_count_with_twice_their_share_of_error():
    """Thrust goes with the square of speed: 3 % of speed are 6 % of the mass."""
    track = hover(np.full(600, 9.0), noise=0.0)
    inferred = {"rotor_speed_rpm": 0.03 * track.rotor_speed_rpm}
    _, shown = with_load_so_far(replace(track, standard_errors=inferred), F16, START)
    fit = load_fit(shown, F16)
    assert fit is not None
    assert fit.speeds == pytest.approx(0.06**2)


def test_nothing_below_zero_is_shown_within_the_interval():
    found = with_load(hover(np.full(600, -0.5)), F16)
    np.testing.assert_array_equal(found.tank_kg, 0.0)


def test_a_reported_load_and_an_aircraft_without_a_tank_stay_as_they_are():
    gauged = hover(np.full(600, 9.0), tank_kg=np.full(600, 8.0))
    assert with_load(gauged, F16) is gauged
    tankless = hover(np.full(600, 9.0))
    assert with_load(tankless, replace(F16, tank_volume_l=0.0)) is tankless


def test_a_stated_load_stays_and_is_contradicted_only_by_thrust_that_surely_differs():
    spraying = np.zeros(600)
    right = hover(
        np.full(600, 9.0),
        spraying=spraying,
        tank_kg=np.full(600, 8.0),
        sources={"tank_kg": stated(state("as written", text="8 kg"))},
        pressure=np.full(600, 101_325.0),
    )
    assert with_load(right, F16) is right
    wrong = with_load(replace(right, tank_kg=np.zeros(600)), F16)
    assert np.all(wrong.tank_kg == 0.0)
    assert not wrong.standard_errors
    alone = with_load(replace(right, tank_kg=np.full(600, np.nan), sources={}), F16)
    load, error = np.median(alone.tank_kg), np.median(alone.standard_errors["tank_kg"])
    shows = f"hover thrust shows {load:.1f} ± {NINETY * error:.1f} kg (90 %)"
    assert source_words(wrong.sources["tank_kg"]) == f"stated: 8 kg; but {shows}"


@pytest.mark.parametrize(("errors", "said"), [(2.4, False), (2.8, True), (-2.8, True)])
def test_a_stated_load_is_contradicted_beyond_its_99_percent_interval(errors, said):
    track = hover(np.full(600, 9.0), spraying=np.zeros(600), pressure=np.full(600, 101_325.0))
    shown = with_load(track, F16)
    off = errors * shown.standard_errors["tank_kg"]
    given = replace(
        track,
        tank_kg=shown.tank_kg + off,
        sources={"tank_kg": stated(state("as written", text="so much"))},
    )
    assert ("but hover thrust" in source_words(with_load(given, F16).sources["tank_kg"])) == said


@pytest.mark.parametrize(("seconds", "enough"), [(2.5, False), (3.5, True)])
def test_three_seconds_of_level_flight_show_a_load(seconds, enough):
    found = with_load(hover(np.full(1 + int(10 * seconds), 9.0)), F16)
    assert found.reports("tank_kg") == enough


def live(track: FlightTrack, cuts) -> FlightTrack:
    """The track as a listener has it, in pieces."""
    so_far, parts = LoadEvidence(), []
    for rows in np.split(np.arange(track.time_s.size), cuts):
        part, so_far = with_load_so_far(track.rows(rows), F16, so_far)
        parts.append(part)
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.followed_by(part)
    return whole


def test_a_listener_has_the_same_in_any_pieces_and_does_not_look_ahead():
    load = np.linspace(10.0, 4.0, 900)
    track = hover(load, spraying=np.ones(900))
    whole, cut = live(track, []), live(track, [1, 7, 250, 251, 600])
    np.testing.assert_allclose(cut.tank_kg, whole.tank_kg, atol=1e-9)
    later = replace(
        track,
        rotor_speed_rpm=np.where(np.arange(900)[:, None] < 500, 1.0, 1.2) * track.rotor_speed_rpm,
    )
    np.testing.assert_allclose(live(later, []).tank_kg[:500], whole.tank_kg[:500], atol=1e-9)
    assert not np.isfinite(whole.tank_kg[:100]).any()  # nothing was shown yet
    error = whole.standard_errors["tank_kg"][100:]
    assert np.mean(np.abs(whole.tank_kg - load)[100:] < NINETY * error) > 0.9
    assert "so far" in source_words(whole.sources["tank_kg"])


def test_a_listener_that_hears_a_gauge_infers_no_more():
    track = hover(np.full(600, 9.0), tank_kg=np.where(np.arange(600) < 300, 9.0, np.nan))
    assert not np.isfinite(live(track, [300]).tank_kg[300:]).any()


@pytest.mark.parametrize("name", ["v4_m16_q2.5", "v2_m4_q3.5", "v6_m10_q1.5"])
def test_recorded_flights_without_their_gauge_show_its_level(name: str):
    track = read_log(SITL / "campaign" / f"{name}.tlog", airframe=F16).track
    without = replace(track, tank_kg=np.full_like(track.tank_kg, np.nan))
    found = with_load(without, F16)
    off = np.abs(found.tank_kg - track.tank_kg)[track.flying]
    assert np.nanmean(off) < 0.25
    assert np.all(off < NINETY * found.standard_errors["tank_kg"][track.flying])


def test_its_redundancy_is_free_of_the_curves_error():
    instruments: dict[str, Any] = {
        "pressure": np.full(900, 101_325.0),
        "voltage": np.full(900, 55.0),
    }
    exact = hover(np.full(900, 9.0), spraying=np.zeros(900), **instruments)
    wrong = replace(F16, thrust_coefficient=1.05 * F16.thrust_coefficient)
    found, other = (
        analyse(with_load(exact, craft), physics_model(craft)) for craft in (F16, wrong)
    )
    assert np.median(other.track.tank_kg) > 10.3
    np.testing.assert_allclose(
        found.redundancy_yaw_uncontrolled, other.redundancy_yaw_uncontrolled, rtol=2e-3
    )
    # 3 % from one rotor to the next is 1.5 % of four
    assert np.all((found.redundancy_error > 0.015) & (found.redundancy_error < 0.02))


def test_an_inferred_load_confirms_nothing():
    track = with_load(hover(np.full(900, 9.0)), F16)
    model = physics_model(F16)
    analysis = analyse(track, model)
    assert np.isfinite(analysis.weight).all()
    assert np.isfinite(analysis.redundancy_yaw_uncontrolled).all()
    assert not np.isfinite(analysis.residual_rpm).any()
    assert not training_rows(track).any()
    assert too_little(track, model) == (
        "the load was inferred from these rotor speeds; state it with --load to compare them"
    )
    with pytest.raises(DataError, match="none reports a tank level"):
        gather([track])
    # Electrical rpm of 7 pole pairs would show a load that explains them.
    fast = replace(track, rotor_speed_rpm=7.0 * track.rotor_speed_rpm)
    assert check_speed_scale(fast, F16).verdict == "electrical"


def in_pieces(track: FlightTrack, size: int) -> np.ndarray:
    """The load of a flight that comes `size` rows at a time, (T,) kg."""
    so_far, parts = START, []
    for first in range(0, track.time_s.size, size):
        part, so_far = with_load_so_far(track.rows(slice(first, first + size)), F16, so_far)
        parts.append(part.tank_kg)
    return np.concatenate(parts)


@pytest.mark.parametrize("after", [2.0, 14.0], ids=["dropped", "taken up"])
@pytest.mark.parametrize("spraying", [None, 0.0, 1.0], ids=["no pump", "off", "on"])
def test_a_load_that_changes_at_once_is_unknown_within_5_s_and_then_the_new_one(after, spraying):
    time_s = np.arange(1500) / 10.0
    load = np.where(time_s < 73.0, 8.0, after) - (0.01 * time_s if spraying else 0.0)
    channels: dict[str, Any] = {} if spraying is None else {"spraying": np.full(1500, spraying)}
    live = in_pieces(hover(load, **channels), 100)
    off = np.abs(live - load)
    assert np.isfinite(live[(time_s > 20.0) & (time_s < 73.0)]).all()
    assert np.nanmax(off[time_s < 73.0]) < 0.6
    assert not np.any(off[time_s > 78.0] > 0.8)
    assert np.isnan(live[(time_s > 78.0) & (time_s < 80.0)]).all()
    assert np.isfinite(live[time_s > 100.0]).all()


def test_the_live_load_is_the_same_however_its_rows_are_cut():
    time_s = np.arange(600) / 10.0
    track = hover(np.where(time_s < 36.0, 8.0, 2.0))
    once = with_load_so_far(track, F16, START)[0].tank_kg
    for size in (37, 200):
        np.testing.assert_allclose(in_pieces(track, size), once, equal_nan=True)


def test_a_gust_of_three_seconds_is_no_other_load():
    time_s = np.arange(1200) / 10.0
    load = np.where((time_s >= 62.5) & (time_s < 65.0), 14.0, 8.0)
    live = in_pieces(hover(load), 100)
    assert np.nanmax(np.abs(live - 8.0)[time_s > 20.0]) < 0.6
    assert np.isfinite(live[time_s > 70.0]).all()
