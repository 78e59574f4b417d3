"""A season taken in by one person in one language is read by another in another language."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.gcs_plugin.office.season.made_store import empty_store, flight_row, rows_of
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.stored_answer import answer_columns, read_answer
from thrustmargin.gcs_plugin.office.season import aircraft_season, fleet_page
from thrustmargin.gcs_plugin.office.season.fleet_seasons import fleet_season
from thrustmargin.gcs_plugin.office.season.stored_words import (
    SQL_WORDS,
    flight_action,
    flight_alarms,
    flight_doing,
    flight_reason,
)
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, query
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, merge, stage, staged_partitions
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights
from thrustmargin.models.model.advice import Caveat

#: A rotor that wears, and a load too heavy to lose a rotor.
LOGS = ("onset/worn_prop_onset.tlog", "campaign/v4_m16_q2.5.tlog")
GERMAN = "nicht fliegen, bevor Propeller, Motor und ESC von Rotor 3 angesehen sind"
ENGLISH = "do not fly it before propeller, motor and ESC of rotor 3 were looked at"


@pytest.fixture(scope="module")
def taken_in(sitl_logs: Path) -> dict[str, list[SeasonFlight]]:
    """The flights of LOGS as they are taken in, by the language of who does."""
    taken: dict[str, list[SeasonFlight]] = {}
    for language in ("de", "en"):
        with pytest.MonkeyPatch.context() as env:
            env.setenv("THRUSTMARGIN_LANGUAGE", language)
            taken[language] = [
                one
                for k, name in enumerate(LOGS)
                for one in season_flights(
                    sitl_logs / name, f"{k:016x}", IngestSettings(store=""), name=name
                )
            ]
    return taken


def pages(folder: Path, flights: list[SeasonFlight], env: pytest.MonkeyPatch) -> dict[str, str]:
    """The fleet page of a store with these flights, by the language of its reader."""
    store = empty_store(folder)
    for one in flights:
        stage(store, one)
    for where, keys in staged_partitions(store).items():
        merge(store, *where, keys)
    made = {}
    for language in ("de", "en"):
        env.setenv("THRUSTMARGIN_LANGUAGE", language)
        season = replace(fleet_season(store), store="S")
        made[language] = fleet_page.html_text(season) + fleet_page.as_json(season)
    return made


def test_the_store_keeps_no_language_and_the_page_has_the_readers(
    taken_in: dict[str, list[SeasonFlight]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    german, english = taken_in["de"], taken_in["en"]
    for one, other in zip(german, english, strict=True):
        assert repr(one.summary) == repr(other.summary)
    made = {
        language: pages(tmp_path / language, flights, monkeypatch)
        for language, flights in taken_in.items()
    }
    assert made["de"] == made["en"]
    shown = made["de"]
    plain = {k: v.replace("\N{NO-BREAK SPACE}", " ") for k, v in shown.items()}
    assert ENGLISH in plain["en"]
    assert "weniger Schub" not in plain["en"]
    assert "less thrust: land" not in plain["de"]
    assert ENGLISH not in plain["de"]
    assert GERMAN in plain["de"]


def test_sql_answers_in_the_readers_language(
    taken_in: dict[str, list[SeasonFlight]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    pages(tmp_path / "store", taken_in["de"], monkeypatch)
    asked = (
        "select action, alarms, verdict_reason, worst_doing, tank_source from flights order by 1"
    )
    said = {}
    for language in ("de", "en"):
        monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", language)
        capsys.readouterr()
        assert run(["fleet", str(tmp_path / "store"), "--sql", asked, "--csv", "-"]) == 0
        said[language] = capsys.readouterr().out
    assert ENGLISH in said["en"]
    assert "Rotor 3 front left 12% (11-13) less thrust" in said["en"]
    assert "turning left, speeding up" in said["en"]
    assert GERMAN in said["de"]
    assert "less thrust" not in said["de"]


def test_report_store_and_sql_have_the_same_numbers_level_and_action(
    sitl_logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    log, store, report = sitl_logs / LOGS[1], tmp_path / "store", tmp_path / "r.json"
    assert run(["report", str(log), "--json", str(report)]) == 0
    assert run(["learn", str(log), "--store", str(store), "--workers", "1"]) == 0
    capsys.readouterr()
    asked = "select fill_kg, fill_limit_kg, verdict, levels, action, action_kinds from flights"
    assert run(["fleet", str(store), "--sql", asked, "--csv", str(tmp_path / "q.csv")]) == 0
    (flight,) = json.loads(report.read_text())["flights"]
    verdict = flight["verdict"]
    (row,) = query(SeasonStore.open(str(store)), asked, SQL_WORDS).to_pylist()
    assert row["fill_kg"] == verdict["fill"]["kg"] == 8.6
    assert row["fill_limit_kg"] == verdict["fill"]["limit_kg"] == pytest.approx(9.76, abs=0.01)
    assert row["verdict"] == verdict["level"] == row["levels"][0] == "critical"
    assert row["action_kinds"] == ["fill_at_most"]
    assert row["action"] == verdict["action"]
    assert "8.6 kg" in row["action"]
    assert row["action"] in (tmp_path / "q.csv").read_text()


def old(**known: Any) -> dict[str, Any]:
    """A row of a version that stored texts."""
    return flight_row(0, verdict="damaged", **known)


def test_the_text_of_an_older_row_is_shown_as_that_of_its_day():
    day = " (in the words of the day it was taken in)"
    row = old(action="Rotor 3 ansehen", alarms=["Rotor 3 weak"], verdict_reason="why")
    row["worst_doing"] = "steigt"
    assert flight_action(row) == f"Rotor 3 ansehen{day}"
    assert flight_alarms(row) == [f"Rotor 3 weak{day}"]
    assert flight_reason(row) == f"why{day}"
    assert flight_doing(row) == f"steigt{day}"
    silent = old()
    assert (flight_action(silent), flight_alarms(silent), flight_doing(silent)) == ("", [], "")
    assert flight_reason(silent) == "not known why"


def test_an_answer_of_a_version_with_other_fields_is_acted_on_by_its_level(
    taken_in: dict[str, list[SeasonFlight]],
):
    stored = taken_in["en"][0].summary
    known = json.loads(stored["answer"])
    assert read_answer(json.dumps(known)) is not None
    for change in ({"advice": {**known["advice"], "more": 1}}, {"reasons": ["new"]}, {"doing": 3}):
        assert read_answer(json.dumps(known | change)) is None
    for damaged in ("", "{", "[]", "1", "null"):
        assert read_answer(damaged) is None
    rows = rows_of(1, verdict="damaged", answer=json.dumps(known | {"doing": 3}))
    (found,) = (f for f in aircraft_season.aircraft_season("A", rows, []).findings if f.verdict)
    assert (found.level, found.verdict) == ("look first", "damaged")
    assert found.action.startswith("do not fly it before its propellers, motors and ESCs")


def test_an_answer_comes_back_whole(taken_in: dict[str, list[SeasonFlight]]):
    for one in taken_in["en"]:
        read = read_answer(one.summary["answer"])
        assert read is not None
        kept = answer_columns(read)
        assert kept == {name: one.summary[name] for name in kept}


def test_weeks_later_a_bad_rotor_is_named_and_nobody_is_asked_to_land(
    taken_in: dict[str, list[SeasonFlight]],
):
    """The alarm of the flight ended in "land"; the page is read at a desk."""
    row = flight_row(0, verdict="damaged", answer=taken_in["en"][0].summary["answer"])
    (found,) = (f for f in aircraft_season.aircraft_season("A", [row], []).findings if f.verdict)
    assert found.sentence == (
        "a rotor or motor was bad in 1 of the last 1 flights: rotor 3, front left: 12 % less thrust"
    )
    assert flight_alarms(row) == ["Rotor 3 front left 12% (11-13) less thrust"]


def test_an_open_caveat_of_the_last_flight_does_not_count_flights_without_verdict(taken_in):
    """One of 12 flights has no verdict: too few for a finding, whatever the last one left open."""
    answer = json.loads(taken_in["en"][1].summary["answer"])
    answer["advice"]["caveats"] = [Caveat.GAUGE.value]
    rows = rows_of(12)
    rows[0].update(verdict="unknown", verdict_reason="why it has none")
    rows[-1]["answer"] = json.dumps(answer)
    found = aircraft_season.aircraft_season("a", rows, []).findings
    assert [one.sentence for one in found if "have no verdict" in one.sentence] == []
    assert any("1 of the last" in one.sentence for one in found)
