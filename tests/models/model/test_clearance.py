"""What the last flights of an aircraft leave open for its next take-off."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.model.advice import Advice, FlightLevel, advise
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.clearance import clearance, grounding_level
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_faults import FaultEpisode

FAULT = RotorFault(kind="propeller", rotor=2, size=0.12, lower=0.11, upper=0.13)


@pytest.fixture(scope="module")
def sound(sitl_logs) -> Advice:
    log = read_log(sitl_logs / "campaign/v4_m4_q2.5.tlog")
    return advise(analyse(log.track, shipped_model())).advice


def with_levels(sound: Advice, *levels: str, **changed) -> Advice:
    return replace(sound, levels=tuple(map(FlightLevel, levels)), **changed)


def damaged(sound: Advice) -> Advice:
    episode = FaultEpisode(begin_s=145.0, end_s=None, fault=FAULT)
    return with_levels(sound, "damaged", "under", faults=(episode,))


def lost(sound: Advice) -> Advice:
    sign = LossOfControl(kind=LossKind.TURNED_OVER, time_s=9.0, value=2.0)
    return with_levels(sound, "lost", losses=(sign,))


def test_a_sound_flight_leaves_nothing_open(sound):
    made = clearance([sound])
    assert made.level is None
    assert not made.conditions


@pytest.mark.parametrize("level", ["critical", "over", "near", "order"])
def test_what_the_load_made_is_not_carried_to_the_next_flight(sound, level):
    assert clearance([with_levels(sound, level)]).level is None


def test_no_thrust_grounds_where_one_rotor_alone_had_none(sound):
    heavy = with_levels(sound, "no_thrust")
    assert grounding_level(heavy) is None
    alone = replace(heavy, use=replace(heavy.use, spent_alone=1))
    assert clearance([alone]).level is FlightLevel.NO_THRUST
    assert clearance([alone]).rotors == (2,)


@pytest.mark.parametrize("level", ["lost", "battery"])
def test_what_went_wrong_grounds_the_aircraft(sound, level):
    bad = lost(sound) if level == "lost" else with_levels(sound, level)
    made = clearance([bad])
    assert made.level == level
    assert made.flight is bad


def test_a_bad_rotor_of_an_earlier_flight_is_a_condition_once_a_later_one_saw_it_sound(sound):
    bad = damaged(sound)
    assert clearance([sound, bad]).rotors == (3,)
    again = clearance([bad, sound])
    assert again.level is None
    assert again.caveats == (Caveat.BAD_BEFORE,)
    blind = replace(sound, caveats=(Caveat.ROTORS_BY_OUTPUTS,))
    still = clearance([bad, blind])
    assert still.level is FlightLevel.DAMAGED
    assert still.flight is bad


def test_lost_control_is_explained_by_no_later_flight(sound):
    assert clearance([lost(sound), sound]).level is FlightLevel.LOST


def test_what_a_flight_does_not_show_is_a_condition(sound):
    left_out = replace(sound, caveats=(Caveat.GAUGE, Caveat.VOLTAGE))
    assert clearance([left_out]).caveats == (Caveat.GAUGE, Caveat.VOLTAGE)
    assert clearance([sound, left_out]).conditions[0].flight is left_out
    assert not clearance([left_out, sound]).conditions


def test_a_log_without_a_flight_shows_no_rotor(sound):
    bench = with_levels(sound, "unknown", airborne_s=0.0)
    assert clearance([bench]).caveats == (Caveat.ROTORS_NOT_SOUGHT,)


def test_without_a_margin_there_is_no_answer(sound):
    assert clearance([with_levels(sound, "unknown", no_verdict=True)]).level is FlightLevel.UNKNOWN
    against = with_levels(sound, "unknown", caveats=(Caveat.MODEL,))
    assert clearance([against]).level is FlightLevel.UNKNOWN
    assert clearance([]).level is None


def test_a_log_that_ends_in_the_air_says_so(sitl_logs):
    log = read_log(sitl_logs / "campaign/v4_m4_q2.5.tlog")
    whole = advise(analyse(log.track, shipped_model())).advice
    cut = int(np.flatnonzero(log.track.flying)[-1]) - 300
    part = advise(analyse(log.track.rows(slice(0, cut)), shipped_model())).advice
    assert whole.caveats == ()
    assert part.caveats == (Caveat.UNSEEN,)
    assert part.ends_in_flight
