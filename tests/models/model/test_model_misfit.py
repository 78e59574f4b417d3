"""What measured rotor speeds and the model say of each other, on recorded flights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs.read import read_log
from thrustmargin.models.model.advice import FlightLevel, advise
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.model_misfit import Caveat, ModelMisfit, model_misfit, with_misfit

ROOT = Path(__file__).resolve().parents[3]
MODEL = shipped_model()
#: 4 kg on board: far below the limit.
LIGHT = read_log(ROOT / "sitl_logs/campaign/v4_m4_q2.5.tlog", airframe=MODEL.airframe).track
RNG = np.random.default_rng(4)
#: As by motor outputs that nobody reports, so that the flight's own evidence alone speaks.
ALONE = AirframeMatch()


def analysed(scale: float = 1.0, **channels):
    speeds = scale * LIGHT.rotor_speed_rpm
    return analyse(
        replace(LIGHT, **{"rotor_speed_rpm": speeds, **channels}), MODEL, airframe_match=ALONE
    )


def test_a_sound_flight_agrees_with_its_model_in_level_and_gain():
    found = model_misfit(analysed())
    assert 0.9 < found.coverage < 0.98
    assert found.promised == pytest.approx(0.9)
    assert abs(found.bias) < 0.002
    # Squares of speeds as they are have a gain of 1.
    assert 0.97 < found.gain_low <= found.gain_high < 1.03
    assert not found.found
    made = advise(analysed()).advice
    assert made.level is FlightLevel.UNDER
    assert Caveat.MODEL not in made.caveats


@pytest.mark.parametrize(("scale", "beyond"), [(0.9, 0.235), (0.95, 0.108)])
def test_speeds_that_read_low_give_no_good_answer_and_more_may_be_in_use(scale, beyond):
    found = model_misfit(analysed(scale))
    assert found.interval_fails
    assert found.bias == pytest.approx(np.log(scale), abs=0.003)
    assert found.thrust_beyond == pytest.approx(beyond, abs=0.01)  # 1/scale² - 1
    made = advise(analysed(scale)).advice
    assert made.level is FlightLevel.UNKNOWN
    assert Caveat.MODEL in made.caveats


@pytest.mark.parametrize(("scale", "shown"), [(0.9, 0.9), (1.0, 1.0), (1.1, 1.1), (0.97, 1.0)])
def test_the_gain_of_manoeuvres_shows_the_scale_of_the_speeds_without_any_load(scale, shown):
    """Also where the load was made to agree: 0.97 and 1.03 are not told from 1."""
    assert model_misfit(analysed(scale)).speed_scale == pytest.approx(shown, abs=0.015)


def test_where_outputs_are_known_they_and_not_manoeuvres_speak_of_the_scale():
    track = replace(LIGHT, rotor_speed_rpm=0.9 * LIGHT.rotor_speed_rpm)
    by_outputs = analyse(track, MODEL)  # its airframe_match is made of the flight, with its outputs
    assert np.isnan(model_misfit(by_outputs).gain_low) or by_outputs.no_verdict


def test_what_may_be_hidden_widens_use_to_the_high_side_alone():
    analysis = analysed()
    low, high = analysis.use_ends
    wide = with_misfit(analysis, ModelMisfit(coverage_high=0.1, bias=float(np.log(0.9))))
    wide_low, wide_high = wide.use_ends
    rows = analysis.track.flying
    assert wide_low[rows] == pytest.approx(low[rows], nan_ok=True)
    more = (wide_high - high)[rows] / analysis.known_utilisation[rows]
    assert np.nanmedian(more) == pytest.approx(1.0 / 0.81 - 1.0, abs=0.005)


def test_heavier_than_reported_is_a_misfit_that_hides_nothing_of_the_use():
    """The speeds show it: what is in use is what they say."""
    found = model_misfit(analysed(1.06))
    assert found.interval_fails
    assert found.bias == pytest.approx(0.058, abs=0.003)
    assert ModelMisfit(coverage_high=0.0, bias=0.058).thrust_beyond == 0.0


def test_half_a_minute_of_flight_is_enough_and_ten_seconds_are_not():
    long = LIGHT.rows(slice(600, 900))
    made = replace(long, rotor_speed_rpm=0.9 * long.rotor_speed_rpm)
    assert model_misfit(analyse(made, MODEL, airframe_match=ALONE)).interval_fails
    assert not model_misfit(analyse(made.rows(slice(0, 99)), MODEL, airframe_match=ALONE)).found


def test_readings_that_scatter_are_held_against_the_model_by_their_mean():
    noise = 1.0 + 0.16 * RNG.standard_normal(LIGHT.rotor_speed_rpm.shape)
    found = advise(analysed(rotor_speed_rpm=LIGHT.rotor_speed_rpm * noise)).advice
    assert Caveat.ROTOR_SPEEDS in found.caveats
    assert FlightLevel.NO_THRUST not in found.levels
