"""Motor outputs as a third estimate of thrust, beside weight and rotor speeds, by hand."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from tests.made_sources import pulses
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.instruments import without_frozen
from thrustmargin.models.checks.output_evidence import output_evidence
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.airframe_match import match_airframe
from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
from thrustmargin.models.model.inferred.load_inference import fill_channels
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Reason, SourceKind
from thrustmargin.models.vehicle_facts import VehicleFacts

F16 = load_airframe("topxgun-f16-sitl")
FACTS = VehicleFacts(kind="multirotor", rotor_count=4, rotor_evidence="a test")
G0 = 9.80665
#: Thrust is the square of the output: f(x) = x².
SQUARE = {"MOT_THST_EXPO": 1.0, "MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0}
FULL = 4.0 * 2.011e-5 * 3000.0**2  # N of four rotors at 3000 rpm and 58.8 V
RNG = np.random.default_rng(5)


def hover(load, rows: int = 900, *, speeds: float = 1.0, gauge=None) -> FlightTrack:
    """90 s of an F16 with `load` kg on a full battery at sea level, its speeds off by a factor."""
    load = np.broadcast_to(load, rows)
    weight = (F16.empty_mass + load) * G0
    rpm = speeds * 3000.0 * np.sqrt(weight / FULL)
    return FlightTrack.of(
        name="hover",
        time_s=np.arange(rows) / 10.0,
        rotor_count=4,
        rotor_speed_rpm=np.tile(rpm[:, None], (1, 4)),
        throttle=np.tile(np.sqrt(weight / FULL)[:, None], (1, 4)),
        voltage=np.linspace(58.9, 58.7, rows)
        + 0.01 * np.random.default_rng(5).standard_normal(rows),
        pressure=np.full(rows, 101_325.0),
        altitude=np.zeros(rows),
        velocity_ned=np.zeros((rows, 3)),
        attitude=np.zeros((rows, 3)),
        tank_kg=load.copy() if gauge is None else np.broadcast_to(gauge, rows).copy(),
        sources={"throttle": pulses("SERVO_OUTPUT_RAW"), "tank_kg": pulses("GAUGE")}
        | {"voltage": pulses("BATTERY_STATUS")},
    )


def without(track: FlightTrack, *channels: str) -> FlightTrack:
    silent = {c: np.full_like(getattr(track, c), np.nan) for c in channels}
    return replace(track, **silent)


def claim_of(track: FlightTrack):
    return match_airframe(track, F16, FACTS, SQUARE, given=True)


def test_outputs_lift_the_weight_and_agree_with_the_speeds():
    found = output_evidence(hover(9.0), F16, SQUARE)
    assert found.lifted_kg == pytest.approx(30.1, rel=0.01)
    assert found.over_speeds == pytest.approx(0.0, abs=0.01)
    # ln of the share is ln(30.1 x 9.80665 / 724) = -0.897; its steepness is good to 15 %.
    assert found.error == pytest.approx(np.hypot(0.15 * 0.897, 0.05), rel=0.02)


def test_one_full_output_is_no_thrust_and_all_of_them_are():
    """A rotor that stands still is asked for all in vain: 600 of 900 rows."""
    track = hover(9.0)
    outputs = track.throttle.copy()
    outputs[300:, 1] = 1.0
    found = output_evidence(replace(track, throttle=outputs), F16, SQUARE)
    assert found.lifted_kg == pytest.approx(30.1, rel=0.01)
    found = output_evidence(replace(track, throttle=np.ones((900, 4))), F16, SQUARE)
    assert found.lifted_kg == pytest.approx(FULL / G0, rel=0.01)


@pytest.mark.parametrize("silent", ["rotor_speed_rpm", "throttle"])
def test_what_is_silent_for_half_of_the_flight_is_compared_with_the_load_of_its_half(silent):
    # 16 to 4 kg: 13 in the middle of the first half, 10 in that of the flight.
    track = hover(np.linspace(16.0, 4.0, 900))
    values = getattr(track, silent).copy()
    values[450:] = np.nan
    found = output_evidence(replace(track, **{silent: values}), F16, SQUARE)
    assert found.load_kg == pytest.approx(10.0, abs=0.1)
    assert found.by_speeds_kg == pytest.approx(31.1, rel=0.01)
    assert found.share_beyond(31.1) == 0.0


@pytest.mark.parametrize(("speeds", "no_verdict"), [(1.0, False), (0.9, False), (0.8, True)])
def test_speeds_that_outputs_rule_out_leave_no_verdict(speeds, no_verdict):
    # 0.9² and 0.8² are ln -0.21 and -0.45 of thrust, where 2.6 errors are 0.37.
    track = without(hover(9.0, speeds=speeds), "tank_kg")
    assert bool(claim_of(track).no_verdict) == no_verdict


@pytest.mark.parametrize(("gauge", "no_verdict"), [(16.0, False), (9.0, False), (0.0, True)])
def test_without_speeds_a_gauge_that_outputs_rule_out_leaves_no_verdict(gauge, no_verdict):
    # 37.1 kg over 21.1 is ln 0.56, over 30.1 is 0.21; 2.6 errors are 0.30.
    track = without(hover(16.0, gauge=gauge), "rotor_speed_rpm")
    assert bool(claim_of(track).no_verdict) == no_verdict
    # With speeds of its own the load that thrust shows is taken, and the verdict stands.
    assert not claim_of(hover(16.0, gauge=gauge)).no_verdict


def test_a_load_from_slow_speeds_reaches_to_what_the_outputs_lift():
    whole = without(hover(16.0), "tank_kg")
    slow = without(hover(16.0, speeds=0.92), "tank_kg")
    sure, unsure = (fill_channels(track, F16, SQUARE) for track in (whole, slow))
    assert np.nanmedian(sure.tank_kg) == pytest.approx(16.0, abs=0.3)
    # 0.8464 of 37.1 kg less 21.1 is 10.3 kg; what the outputs lift is 5.7 kg more.
    assert np.nanmedian(unsure.tank_kg) == pytest.approx(10.3, abs=0.3)
    error = float(np.nanmedian(unsure.standard_errors["tank_kg"]))
    assert 1.645 * error > 5.7
    slower = fill_channels(without(hover(16.0, speeds=0.9), "tank_kg"), F16, SQUARE)
    assert not slower.reports("tank_kg")
    assert "too unsure to be used" in statement_words(slower.statements[-1])
    assert np.nanmedian(sure.standard_errors["tank_kg"]) < 2.0


def test_gauge_and_speeds_that_are_both_wrong_do_not_reassure():
    track = hover(16.0, speeds=0.9, gauge=0.0)
    analysis = analyse(
        fill_channels(track, F16, SQUARE), physics_model(F16), airframe_match=claim_of(track)
    )
    judged = analysis_for_verdict(analysis)
    low = judged.redundancy_yaw_uncontrolled * np.exp(-1.645 * judged.redundancy_error)
    true = analyse(hover(16.0), physics_model(F16)).redundancy_yaw_uncontrolled
    assert np.all(low < true)


def test_a_voltage_that_stands_still_is_none_and_widens_the_margin():
    track = replace(hover(9.0), voltage=np.full(900, 58.8))
    found = without_frozen(track, F16, SQUARE)
    assert np.isnan(found.voltage).all()
    assert found.source("voltage").kind is SourceKind.ABSENT
    assert [r.reason for r in found.source("voltage").rejected] == [Reason.FROZEN]
    assert statement_words(found.statements[-1]).startswith(
        "battery voltage stood at 58.8 V throughout"
    )
    assert without_frozen(hover(9.0), F16, SQUARE).reports("voltage")
    short = track.rows(slice(0, 590))  # 59 s
    assert without_frozen(short, F16, SQUARE) is short
    sure, unsure = (analyse(t, physics_model(F16)) for t in (hover(9.0), found))
    assert np.all(unsure.utilisation_error > sure.utilisation_error + 0.04 * unsure.utilisation)


@pytest.mark.parametrize("silent", [(), ("rotor_speed_rpm",)])
def test_a_gauge_that_stands_still_while_the_aircraft_grows_lighter_is_none(silent):
    emptied = hover(np.linspace(16.0, 4.0, 900), gauge=4.0)
    found = without_frozen(without(emptied, *silent), F16, SQUARE)
    assert not found.reports("tank_kg")
    assert "tank gauge stood at 4 kg throughout" in statement_words(found.statements[-1])
    # A load that is carried and not sprayed stays where it is.
    carried = hover(9.0, gauge=4.0)
    assert without_frozen(carried, F16, SQUARE) is carried
    moving = hover(np.linspace(16.0, 4.0, 900))
    assert without_frozen(moving, F16, SQUARE) is moving


@pytest.mark.parametrize(("channel", "what"), [("rotor_speed_rpm", "gauge"), ("tank_kg", "speeds")])
def test_what_outputs_show_beyond_gauge_or_speeds_lies_within_the_interval(channel, what):
    # 37.1 kg by the outputs; 30.1 by a gauge stuck at 9 kg, and as much by speeds 10 % low: ln 0.21
    # and less than the 0.30 or so beyond which nothing would be said. Truth: 37.1 x 9.80665 / 724.
    wrong = hover(16.0, gauge=9.0) if what == "gauge" else hover(16.0, speeds=np.sqrt(30.1 / 37.1))
    track = fill_channels(without(wrong, channel), F16, SQUARE)
    found = analyse(track, physics_model(F16), airframe_match=claim_of(without(wrong, channel)))
    assert not found.no_verdict
    row = 450
    use, error = found.utilisation[row, 0], found.utilisation_error[row, 0]
    assert use == pytest.approx(30.1 * G0 / FULL, rel=0.01)
    assert 0.999 < (use + 1.645 * error) / (37.1 * G0 / FULL) < 1.06
    if what == "gauge":
        # What holds 30.1 kg so often holds 37.1 kg as much less often.
        assert np.exp(1.645 * found.redundancy_error[row]) > 37.1 / 30.1
    sound = analyse(hover(16.0), physics_model(F16), airframe_match=claim_of(hover(16.0)))
    assert sound.utilisation_error[row, 0] == 0.0


def redundancy_low(track: FlightTrack, airframe=F16) -> float:
    """The low end of the least redundancy that is told of a flight."""
    airframe_match = match_airframe(track, airframe, FACTS, SQUARE, given=True)
    made = analysis_for_verdict(
        analyse(
            fill_channels(track, airframe, SQUARE),
            physics_model(airframe),
            airframe_match=airframe_match,
        )
    )
    low = made.redundancy_yaw_uncontrolled * np.exp(-1.645 * made.redundancy_error)
    return float(np.nanmin(low))


def changed(**values: float):
    """The F16 with other numbers in its file."""
    quantities = {k: replace(F16.quantities[k], value=v) for k, v in values.items()}
    return replace(F16, **values, quantities=MappingProxyType({**F16.quantities, **quantities}))


def test_what_is_shown_beyond_makes_an_answer_graver_and_never_better():
    # By the gauge 34 kg, by outputs and speeds 37.1: too heavy either way, and as surely so.
    track = hover(16.0, gauge=13.0)
    airframe_match = claim_of(track)
    made = [
        advise(
            analyse(fill_channels(track, F16, SQUARE), physics_model(F16), airframe_match=one)
        ).advice
        for one in (airframe_match, replace(airframe_match, outputs=None))
    ]
    assert airframe_match.outputs is not None
    assert airframe_match.outputs.share_beyond(34.1) == pytest.approx(3.0 / 34.1, rel=0.02)
    shown, without_it = made
    assert shown.level is without_it.level
    assert shown.rotor_lost.redundancy_min_high == pytest.approx(
        without_it.rotor_lost.redundancy_min_high
    )
    assert shown.rotor_lost.redundancy_min_low < without_it.rotor_lost.redundancy_min_low / 1.08
    assert shown.fill.low_kg < without_it.fill.low_kg - 1.0
    assert shown.fill.high_kg == pytest.approx(without_it.fill.high_kg)
    assert shown.use.lasting_low == pytest.approx(without_it.use.lasting_low)


TRUE_LOST = FULL / 2.0 / (37.1 * G0)  # two of four rotors hold what one pair of a quad can


@pytest.mark.parametrize(
    "wrong",
    [
        {"max_rotor_speed_rpm": 3150.0},
        {"max_rotor_speed_rpm": 3300.0},
        {"empty_mass": 18.9},
        {"empty_mass": 16.9},
        {"thrust_coefficient": 2.212e-5},
    ],
    ids=lambda wrong: " ".join(f"{k} {v:g}" for k, v in wrong.items()),
)
@pytest.mark.parametrize("silent", [(), ("rotor_speed_rpm",)], ids=["both", "outputs"])
def test_an_airframe_that_is_off_does_not_reassure(wrong, silent):
    track = without(hover(16.0), *silent)
    assert redundancy_low(track) == pytest.approx(TRUE_LOST, rel=0.06)
    assert redundancy_low(track, changed(**wrong)) < TRUE_LOST


def test_rotor_speeds_alone_show_a_mass_that_the_airframe_lacks():
    light = changed(empty_mass=18.9)  # 6 % of 37.1 kg less, where a bench is good to 3 %
    assert redundancy_low(without(hover(16.0), "throttle"), light) < TRUE_LOST


def test_without_a_parameter_for_their_curve_outputs_show_less():
    # 10 % of speed are 21 % of thrust: less than the 30 % that an assumed curve may be off.
    track = hover(16.0, speeds=1.0 / 1.1)
    curve = {"MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0}
    by_set, assumed = (output_evidence(track, F16, p) for p in (SQUARE, curve))
    assert by_set.shows == pytest.approx(0.5 * by_set.error)
    assert assumed.shows == pytest.approx(assumed.error)
    assert by_set.share_beyond_speeds == pytest.approx(0.21, abs=0.005)


@pytest.mark.parametrize("high", [1.03, 1.04, 1.06])
@pytest.mark.parametrize("silent", [(), ("throttle",)], ids=["outputs", "none"])
def test_a_voltmeter_that_reads_too_much_does_not_reassure(high, silent):
    # At rest 58.8 V are read as more; in flight 55 V carry the weight.
    volts = np.append(np.full(50, 58.8), 55.0 + 0.01 * RNG.standard_normal(850))
    track = replace(hover(16.0), flying=np.arange(900) >= 50)
    share = np.sqrt(37.1 * G0 / FULL) * 58.8 / 55.0
    true = replace(track, voltage=volts, throttle=np.full((900, 4), share))
    true = without(true, *silent)
    lost = (55.0 / 58.8) ** 2 * TRUE_LOST
    assert redundancy_low(true) == pytest.approx(lost, rel=0.06)
    assert redundancy_low(replace(true, voltage=high * volts)) < lost


def test_rows_in_which_a_voltage_stands_still_are_left_out_and_others_are_not():
    moving = hover(9.0)
    volts = moving.voltage.copy()
    volts[200:] = 57.0
    found = without_frozen(replace(moving, voltage=volts), F16, SQUARE)
    assert np.isnan(found.voltage[200:]).all()
    assert np.array_equal(found.voltage[:200], volts[:200])
    assert [r.reason for r in found.source("voltage").rejected] == [Reason.FROZEN]
    assert statement_words(found.statements[-1]).startswith(
        "battery voltage stood at 57 V for a minute or more"
    )
    # One that shows whole volts stands for long, and is no worse than it says.
    coarse = replace(moving, voltage=np.repeat([59.0, 58.0, 57.0], [100, 700, 100]))
    assert without_frozen(coarse, F16, SQUARE) is coarse


def test_a_gauge_that_sticks_on_the_way_is_not_believed_before_either():
    emptied = np.linspace(16.0, 4.0, 900)
    stuck = np.minimum.accumulate(np.where(np.arange(900) < 200, emptied, emptied[200]))
    found = without_frozen(hover(emptied, gauge=stuck), F16, SQUARE)
    assert not found.reports("tank_kg")
    # A pump that is off leaves gauge and weight as they are.
    paused = np.append(np.linspace(16.0, 13.0, 200), np.full(700, 13.0))
    sound = hover(paused)
    assert without_frozen(sound, F16, SQUARE) is sound
