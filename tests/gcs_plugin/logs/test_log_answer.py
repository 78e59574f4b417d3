"""A log of an aircraft that is not known: what it shows, what is asked, a line to copy."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.findings import names_wrong
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.logs.log_answer import first_contact_of
from thrustmargin.gcs_plugin.office.season.stored_words import flight_reason
from thrustmargin.gcs_plugin.wording.report_words import (
    command,
    contact_facts,
    contact_headline,
)
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.statement import state

ROOT = Path(__file__).resolve().parents[3]
PATH = ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog"
LOG = read_log(PATH)
UNKNOWN = AirframeMatch(
    basis="not known", no_verdict=(state("no airframe given"),), source=shlex.quote(str(PATH))
)
#: What each option of the line to copy is replaced by, for the simulated sprayer of the log.
TRUTH = {
    "NAME": "mine",
    "KG": "21.1",
    "M": "1.92",
    "DIAMETERxPITCH": "41x13",
    "KGF": "20",
    "L": "16",
}


def outputs(values):
    """The log with these motor outputs (R,) in every row."""
    rows = np.tile(np.asarray(values, dtype=float), (LOG.track.time_s.size, 1))
    return replace(LOG, track=replace(LOG.track, throttle=rows))


def test_outputs_are_said_as_outputs_and_rows_on_the_ground_do_not_count():
    log = outputs([0.5, 0.6, 0.7, 0.6])
    log.track.throttle[~log.track.flying] = 1.0
    log.track.throttle[np.flatnonzero(log.track.flying)[7], 2] = 0.83
    contact = first_contact_of(log, UNKNOWN)
    assert contact_headline(contact) == "Motors at 60 %, worst 83 %"
    assert contact.worst_motor == 3
    assert "an output is no thrust" in contact_facts(contact)[0][1]


def test_without_outputs_speeds_are_a_share_of_the_highest_seen():
    speeds = np.where(LOG.track.flying[:, None], 2000.0, np.nan) * np.ones(4)
    speeds[np.flatnonzero(LOG.track.flying)[9], 1] = 4000.0
    track = replace(
        LOG.track, throttle=np.full_like(LOG.track.throttle, np.nan), rotor_speed_rpm=speeds
    )
    contact = first_contact_of(replace(LOG, track=track), UNKNOWN)
    assert contact_headline(contact) == "Rotors at 50 % of the highest speed seen"
    assert "4 000 rpm" in contact_facts(contact)[0][1].replace("\u202f", " ").replace(",", " ")


def test_of_a_known_aircraft_or_of_nothing_that_flies_there_is_no_first_contact():
    assert first_contact_of(LOG, AirframeMatch()) is None
    ground = replace(LOG.track, flying=np.zeros_like(LOG.track.flying))
    assert first_contact_of(replace(LOG, track=ground), UNKNOWN) is None


def test_two_numbers_of_motors_are_a_layout_to_ask_for_and_no_rotor_names():
    log = replace(LOG, facts=replace(LOG.facts, rotor_conflict="6 by MAV_TYPE 13"))
    contact = first_contact_of(log, UNKNOWN)
    assert (contact.layout, contact.asked[0]) == (None, "layout")
    found = inspect_log(log, load_airframe("topxgun-f16-sitl"), UNKNOWN).findings
    (words,) = names_wrong(found)
    assert words.endswith("4 rotors by FRAME_CLASS 1, but 6 by MAV_TYPE 13")
    assert not names_wrong(inspect_log(LOG, load_airframe("topxgun-f16-sitl"), UNKNOWN).findings)


@pytest.mark.parametrize("gauge", [True, False])
def test_the_load_is_asked_only_where_no_gauge_says_it(gauge):
    tank = LOG.track.tank_kg if gauge else np.full(LOG.track.time_s.size, np.nan)
    contact = first_contact_of(replace(LOG, track=replace(LOG.track, tank_kg=tank)), UNKNOWN)
    assert ("load" in contact.asked) is not gauge
    assert contact.gauge is gauge
    assert contact.asked[:4] == ("mass", "wheelbase", "power_set", "tank_litres")


def test_a_load_that_is_stated_is_no_gauge_in_the_log_and_is_not_asked_again():
    contact = first_contact_of(read_log(PATH, load=3.0), UNKNOWN)
    assert not contact.gauge
    assert "load" not in contact.asked


def test_the_line_to_copy_works_at_once_and_answers_with_the_verdict(tmp_path, capsys):
    words = shlex.split(command(first_contact_of(LOG, UNKNOWN)))
    assert words[:4] == ["thrustmargin", "learn", str(PATH), "--aircraft"]
    filled = [TRUTH.get(word, word) for word in words[1:]]
    own = ["--hangar", str(tmp_path / "hangar")]
    assert run([*filled, *own]) == 0
    said = capsys.readouterr().out
    assert f"{PATH.name}: THRUST LEFT " in said
    assert "mine: no flight has made its model" in said
    # From then on its report needs no more than the name.
    page = ["--out", str(tmp_path / "r.html")]
    assert run(["report", str(PATH), "--aircraft", "mine", *own, *page]) == 0
    assert "what to do: " in capsys.readouterr().out


def test_the_report_of_an_unknown_aircraft_names_no_other_and_its_page_has_the_line(
    tmp_path, capsys
):
    log, out = tmp_path / "mine.csv", tmp_path / "r.html"
    write_csv(replace(LOG.track, voltage=0.3 * LOG.track.voltage), log)
    assert run(["report", str(log), "--out", str(out)]) == 0
    said, page = capsys.readouterr().out, out.read_text("utf-8")
    assert ": Motors at " in said
    for text in (said, page):
        assert f"thrustmargin learn {log}" in text
        assert "topxgun" not in text
        assert "NO VERDICT" not in text


def test_an_unknown_aircraft_that_lost_control_is_said_to_have_and_is_grounded(tmp_path, capsys):
    """By report, page, replay and store; and the line to copy is there too."""
    log, out = tmp_path / "mine.csv", tmp_path / "r.html"
    track = LOG.track
    over = track.time_s > track.time_s[0] + 100.0
    attitude, velocity = track.attitude.copy(), track.velocity_ned.copy()
    attitude[over, 0], velocity[over, 2] = 2.8, 15.0
    fallen = replace(track, voltage=0.3 * track.voltage, attitude=attitude, velocity_ned=velocity)
    write_csv(fallen, log)
    assert run(["report", str(log), "--out", str(out)]) == 0
    said, page = " ".join(capsys.readouterr().out.split()), out.read_text("utf-8")
    grounded = "o not fly it before it is known why"
    assert ": LOST CONTROL AT 1:40" in said
    for text in (said, page):
        assert grounded in text
        assert "thrustmargin learn " in text
    view = replay_view(log, shipped_model(), given=False, port=0, paused=True)
    assert view.whole.headline.startswith("LOST CONTROL AT 1:40")
    assert grounded in view.whole.action
    (stored,) = season_flights(log, "0" * 16, IngestSettings(store=""), name=log.name)
    assert stored.summary["verdict"] == "lost"
    assert flight_reason(stored.summary) == "LOST CONTROL AT 1:40"
