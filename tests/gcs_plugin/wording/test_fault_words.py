"""A bad rotor is told in the same words live, in the report and in the replay of its recording."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import first_part, log_frames
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.wording.actions import Phase, Urgency, bad_rotor
from thrustmargin.gcs_plugin.wording.alarm_words import episode_words, fault_words
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_faults import FaultEpisode, fault_episodes

MOST = 0.6  # the largest fault that is searched for
SAID = "Rotor 3 front left 12% (11-13) less thrust: land"  # of the flight below, at its end
FAULT = RotorFault(kind="propeller", rotor=2, size=0.12, lower=0.094, upper=0.153)


def test_words_name_part_amount_and_action_in_the_length_of_a_statustext():
    motor = RotorFault(kind="motor", rotor=7, size=0.3, lower=0.28, upper=MOST)
    assert fault_words(FAULT) == "Rotor 3 makes 12% (9-15) less thrust: prop? land"
    assert fault_words(motor) == "Motor 8 or ESC >28% slow for output: land"
    assert all(len(fault_words(fault)) <= 50 for fault in (FAULT, motor))
    episode = FaultEpisode(begin_s=145.0, end_s=None, fault=FAULT)
    assert episode_words(episode) == "Rotor 3 makes 12% (9-15) less thrust (found at 2:25)"


@pytest.mark.parametrize("kind", ["propeller", "motor", "stopped"])
@pytest.mark.parametrize("rotors", [(), (0, 3)])
def test_only_in_flight_is_anybody_asked_to_land(kind, rotors):
    fault = replace(FAULT, kind=kind, rotors=rotors)
    for names in ((), ("front right", "rear left", "front left", "rear right")):
        assert fault_words(fault, names).endswith(": land") or "? land" in fault_words(fault, names)
        for phase in (Phase.LANDED, Phase.RECORDED):
            assert "land" not in fault_words(fault, names, phase)


def test_one_finding_has_one_urgency_and_one_action_when_it_is_over():
    """By hand: 3 % is the least loss that an alarm reports."""
    landed, recorded = (bad_rotor((3,), 0.03, p) for p in (Phase.LANDED, Phase.RECORDED))
    assert landed == recorded
    assert (landed.urgency, landed.action.text) == (
        Urgency.STOP,
        "do not fly it before propeller, motor and ESC of rotor 3 were looked at, battery off",
    )
    small = bad_rotor((3,), 0.029, Phase.RECORDED)
    assert small.urgency is Urgency.BEFORE_NEXT
    assert "inspect its propeller" in small.action.text
    assert bad_rotor((3,), 0.029, Phase.IN_FLIGHT).action.text == "land"
    assert {one.proof for one in (landed, recorded, small)} == {landed.proof}


def test_faults_that_come_and_go_are_episodes():
    motor = RotorFault(kind="motor", rotor=0, size=0.3, lower=0.2, upper=0.4)
    later = RotorFault(kind="propeller", rotor=2, size=0.11, lower=0.1, upper=0.12)
    history = [(1.0, (FAULT,)), (2.0, (later, motor)), (3.0, (motor,)), (5.0, ()), (9.0, (FAULT,))]
    assert fault_episodes(history) == (
        FaultEpisode(begin_s=1.0, end_s=3.0, fault=later),
        FaultEpisode(begin_s=2.0, end_s=5.0, fault=motor),
        FaultEpisode(begin_s=9.0, end_s=None, fault=FAULT),
    )
    assert fault_episodes([]) == ()


def test_a_fault_that_is_over_has_the_size_at_which_it_stood_longest():
    """19 % for ten seconds; then it goes away by way of "over 3 %" and of 4 %."""
    known = replace(FAULT, size=0.19, lower=0.17, upper=0.21)
    begins = replace(FAULT, size=0.22, lower=0.2, upper=MOST)
    going, gone = (replace(FAULT, size=0.04, lower=0.03, upper=end) for end in (MOST, 0.05))
    steps = (begins, known, going, gone)
    times = (113.0, 124.0, 134.0, 152.0)
    history = [(at, (fault,)) for at, fault in zip(times, steps, strict=True)]
    (episode,) = fault_episodes([*history, (153.0, ())])
    assert (episode.begin_s, episode.end_s, episode.fault) == (113.0, 153.0, known)
    # One that stands is as it is known now, and one that was never bounded as it was last.
    assert fault_episodes(history)[0].fault == gone
    assert fault_episodes([history[0], (120.0, ())])[0].fault == begins


def test_what_a_fault_was_found_by_is_said_in_an_episode():
    fades = FaultEpisode(begin_s=240.0, end_s=None, fault=replace(FAULT, evidence="fade"))
    assert episode_words(fades).endswith(
        "(found at 4:00), slowly: against the first minute of this flight"
    )
    outputs = FaultEpisode(begin_s=112.0, end_s=130.0, fault=replace(FAULT, evidence="outputs"))
    assert episode_words(outputs).endswith(
        "(found at 1:52, until 2:10), by a sudden change of motor outputs, without ESC telemetry"
    )


@pytest.fixture(scope="module")
def worn(sitl_logs, tmp_path_factory) -> Path:
    """The log of a flight in which a propeller becomes weak, up to a minute after that is found."""
    log = sitl_logs / "onset" / "worn_prop_onset.tlog"
    return first_part(log, 245.0, tmp_path_factory.mktemp("worn"))


@pytest.fixture(scope="module")
def said_live(worn) -> str:
    """The rotor alarm as it stood at the end of the flight."""
    fleet = Fleet(shipped_model(), WatchSettings(airframe_given=False))
    frames = log_frames(worn)
    words = ""
    for first in range(0, len(frames), 400):
        fleet.take(frames[first : first + 400])
        fleet.updates()
        alarms = fleet.vehicles[1].alarms.listed if fleet.vehicles else {}
        words = alarms[("rotor", 3)].text if ("rotor", 3) in alarms else words
    return words


@pytest.mark.slow
def test_the_report_says_what_the_live_alarm_said(sitl_logs, worn, tmp_path, capsys, said_live):
    assert said_live == SAID
    assert run(["report", str(worn), "--json", "-", "--out", str(tmp_path / "r.html")]) == 0
    flight = json.loads(capsys.readouterr().out)["flights"][0]
    (alarm,) = flight["alarms"]
    assert (alarm["rotor"], alarm["until_s"]) == (3, None)
    assert f"{alarm['words']}: land" == said_live
    assert flight["verdict"]["headline"] == (
        "ROTOR 3, FRONT LEFT: 12 % LESS THRUST (LOG ENDS IN FLIGHT)"
    )
    facts = {fact["label"]: fact["text"] for fact in flight["verdict"]["facts"]}
    assert alarm["words"] in facts["alarm"]
    assert alarm["words"] in (tmp_path / "r.html").read_text("utf-8")
    sound = str(sitl_logs / "onset" / "reference.tlog")
    assert run(["report", sound, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["flights"][0]["alarms"] == []


def test_the_replay_shows_it_from_when_it_was_found(worn):
    model = shipped_model()
    ((log, airframe_match),) = matched_flights(worn, model, given=False)
    view = ReplayView(analyse(log.track, model, airframe_match=airframe_match), port=0, paused=True)
    shown = {at: view._summary_at(at).first_line[0] for at in (100.0, 147.0, 200.0)}
    assert shown[100.0] == ""
    # As it was found then, while it grew; nobody can land a recording.
    assert shown[147.0].startswith("alarm then: rotor 3 front left, over ")
    assert shown[200.0] == "alarm then: rotor 3 front left, 12 % less thrust"


def test_inspect_says_first_what_the_report_finds(tmp_path):
    out = tmp_path / "found.json"
    log = "sitl_logs/onset/worn_prop_onset.tlog"
    assert run(["inspect", log, "--json", str(out)]) == 0
    first, second, *rest = json.loads(out.read_text())[0]["findings"]
    assert (first["check"], first["level"]) == ("rotors", "grave")
    assert first["words"] == f"{SAID.removesuffix(': land')} (found at 2:25)"
    assert second["words"].startswith("do not fly it before propeller, motor and ESC of rotor 3")
    assert "rotors" not in [one["check"] for one in rest]
    assert run(["inspect", "sitl_logs/campaign/v2_m4_q1.5.tlog", "--json", str(out)]) == 0
    sound = {one["check"]: one["level"] for one in json.loads(out.read_text())[0]["findings"]}
    assert sound["rotors"] == "ok"
