"""Every surface says the same of one flight: the same first line, action and numbers."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.commands.season.season_flight import IngestSettings, season_flights
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.advice_words import action, headline
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fill_limits import largest_fills
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.next_fill import before_take_off

FLIGHTS = ("onset/worn_prop_onset.tlog", "campaign/v4_m16_q2.5.tlog")


def plain(text: str) -> str:
    return " ".join(text.replace("\N{NO-BREAK SPACE}", " ").split())


@pytest.mark.parametrize("name", FLIGHTS)
def test_report_page_json_console_replay_store_and_python_agree(
    sitl_logs: Path, tmp_path: Path, capsys, name: str
):
    path, page = sitl_logs / name, tmp_path / "r.html"
    assert run(["report", str(path), "--out", str(page)]) == 0
    console = plain(capsys.readouterr().out)
    verdict = json.loads(page.with_suffix(".json").read_text())["flights"][0]["verdict"]
    first, do = verdict["headline"], verdict["action"]
    assert plain(f"{path.name}: {first}") in console
    assert plain(f"what to do: {do}") in console
    shown = plain(page.read_text("utf-8"))
    assert first in shown
    assert plain(do[:1].upper() + do[1:]) in shown
    view = replay_view(path, shipped_model(), given=False, port=0, paused=True)
    assert view.whole is not None
    assert (view.whole.headline, view.whole.action) == (first, do)
    (stored,) = season_flights(path, "0" * 16, IngestSettings(store=""), name=path.name)
    assert stored.summary["verdict"] == verdict["level"]
    assert stored.summary["verdict_reason"] == first
    assert stored.summary["action"] == do
    advice = advise(analyse(read_log(path).track, shipped_model())).advice
    assert (headline(advice), action(advice)) == (first, do)
    assert f"{np.floor(advice.fill.kg * 10) / 10:.1f} kg" in do


def test_fill_says_before_the_flight_what_the_report_says_after_it(sitl_logs: Path):
    """In the air, on the battery and at the airspeed of the flight the fill is the same."""
    model = shipped_model()
    analysis = analyse(read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog").track, model)
    # Of a question the air is known; of a flight it is not, which is kept back besides.
    sure = replace(analysis, redundancy_error=np.zeros_like(analysis.redundancy_error))
    after = advise(sure).advice.fill
    rows = np.flatnonzero(analysis.track.flying)
    lowest = rows[np.argmin(analysis.max_thrust[rows, 0])]
    asked = largest_fills(
        model,
        analysis.density[lowest],
        analysis.track.voltage[lowest],
        airspeed=float(np.median(analysis.track.airspeed[rows])),
    )
    before = before_take_off(asked, model.airframe)
    assert after.kg == pytest.approx(before.kg, abs=1e-6)
    assert after.reason == before.reason
