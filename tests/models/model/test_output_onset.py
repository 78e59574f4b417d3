"""A rotor that becomes weak in an aircraft without ESC telemetry, by its motor outputs."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.recorded import CAMPAIGN
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.inferred.load_inference import fill_channels
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.output_faults import of_outputs, square_of_outputs
from thrustmargin.models.model.rotor_faults import fault_episodes, fault_history
from thrustmargin.models.physics.motor_output import curve_of, output_curve
from thrustmargin.models.provenance import NOT_REPORTED

MODEL = shipped_model()
FLOWN = ("v2_m10_q2.5", "v6_m4_q1.5")
ONSET = 100.0  # s
PATTERNS = {  # of the thrust asked of each rotor: front right, rear left, front left, rear right
    "weak 1": (1.0 / 0.7, 1.0, 1.0, 1.0),
    "weak 4": (1.0, 1.0, 1.0, 1.0 / 0.8),
    "centre of gravity forward": (1.15, 0.85, 1.15, 0.85),
    "centre of gravity at a corner": (1.2, 0.8, 1.0, 1.0),
    "heavier": (1.2, 1.2, 1.2, 1.2),
    "yaw": (1.15, 1.15, 0.85, 0.85),
}


def flown(name: str, asked: tuple[float, ...], since: float = ONSET) -> FlightAnalysis:
    """A recorded flight without rotor speeds, its rotors asked for other thrusts from a time on."""
    log = read_log(CAMPAIGN / f"{name}.tlog", airframe=MODEL.airframe)
    track = log.track
    curve = output_curve(log.parameters, track.source("throttle"))
    grid = np.linspace(0.16, 1.0, 2000)
    thrust = curve.thrust_share(track.throttle)
    thrust = thrust * np.where((track.time_s >= since)[:, None], asked, 1.0)
    throttle = np.interp(thrust, curve.thrust_share(grid), grid)
    sources = {key: of for key, of in track.sources.items() if key != "rotor_speed_rpm"}
    silent = replace(
        track,
        rotor_speed_rpm=np.full_like(thrust, np.nan),
        throttle=np.where(np.isfinite(thrust), throttle, track.throttle),
        sources=sources,
    )
    return analyse(fill_channels(silent, MODEL.airframe, log.parameters), MODEL)


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize(("pattern", "rotor", "loss"), [("weak 1", 0, 0.3), ("weak 4", 3, 0.2)])
def test_a_rotor_that_becomes_weak_is_named_by_the_outputs(name, pattern, rotor, loss):
    (episode,) = fault_episodes(fault_history(flown(name, PATTERNS[pattern])))
    fault = episode.fault
    assert (fault.kind, fault.rotor, fault.evidence, fault.rotors) == (
        *("propeller", rotor, "outputs"),
        (),
    )
    assert ONSET <= episode.begin_s <= ONSET + 6.0
    assert fault.lower <= loss <= fault.upper
    assert fault.size == pytest.approx(loss, rel=0.15)


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize("pattern", ["centre of gravity forward", "heavier", "yaw"])
def test_what_moves_one_mode_alone_is_no_rotor(name, pattern):
    assert fault_history(flown(name, PATTERNS[pattern])) == []


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize("pattern", ["centre of gravity at a corner"])
def test_a_load_that_moves_to_a_corner_is_no_rotor(name, pattern):
    assert fault_history(flown(name, PATTERNS[pattern])) == []


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize("pattern", list(PATTERNS))
def test_a_level_that_stands_from_the_start_names_none(name, pattern):
    """It may be a centre of gravity off the middle, or motors that differ."""
    assert fault_history(flown(name, PATTERNS[pattern], since=0.0)) == []


def test_the_answer_says_what_can_be_found_and_what_not():
    sound = advise(flown(FLOWN[0], PATTERNS["heavier"], since=1e9)).advice
    assert sound.by_outputs_s > 0.9 * sound.airborne_s
    assert sound.unsought_s < 0.1 * sound.airborne_s
    weak = advise(flown(FLOWN[0], PATTERNS["weak 1"])).advice
    assert [one.fault.rotor for one in weak.faults] == [0]
    assert str(weak.level) == "damaged"


def test_the_outputs_part_as_their_curve_says_around_the_mean_of_equivalent_speeds():
    speeds = np.array([[1000.0, 1000.0, 2000.0, 2000.0], [np.nan, 1.0, 1.0, 1.0]])
    share = np.array([[0.2, 0.4, 0.6, 0.8], [0.5, 0.5, 0.5, 0.5]])
    found = square_of_outputs(speeds, share)
    assert found[0] == pytest.approx([1.0e6, 2.0e6, 3.0e6, 4.0e6])
    assert np.isnan(found[1]).all()


def test_the_interval_holds_what_the_curve_may_be_off():
    """29 % of the size, at 1.96 standard errors of 15 %, and the test's own interval."""
    fault = RotorFault(kind="propeller", rotor=1, size=0.2, lower=0.18, upper=0.23)
    found = of_outputs(fault)
    assert found.evidence == "outputs"
    assert found.lower == pytest.approx(0.2 - np.hypot(0.0588, 0.02), abs=1e-6)
    assert found.upper == pytest.approx(0.2 + np.hypot(0.0588, 0.03), abs=1e-6)
    grows = of_outputs(replace(fault, upper=0.6))
    assert grows.upper == 0.6


def test_the_curve_of_inferred_speeds_is_the_vehicles_own():
    log = read_log(CAMPAIGN / f"{FLOWN[0]}.tlog", airframe=MODEL.airframe)
    made = flown(FLOWN[0], PATTERNS["heavier"], since=1e9).track
    own = curve_of(made.source("rotor_speed_rpm"), made.source("throttle"))
    assert log.parameters["MOT_THST_EXPO"] == own.expo == 1.0
    assert own.thrust_share(np.array([0.55])) == pytest.approx(0.25)
    assert curve_of(NOT_REPORTED, NOT_REPORTED).expo == 0.65
