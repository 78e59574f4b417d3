"""With motors in another order than the airframe's no single rotor is sent to the bench."""

from dataclasses import replace

import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.reports.margin.data import Report
from thrustmargin.gcs_plugin.reports.margin.render import write_report
from thrustmargin.gcs_plugin.reports.margin.summary import overview_of, report_flight
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model


@pytest.mark.parametrize(("order", "known"), [([0, 1, 2, 3], True), ([2, 1, 0, 3], False)])
def test_a_worn_rotor_is_named_only_where_names_can_be_trusted(order, known, sitl_logs, tmp_path):
    log = read_log(sitl_logs / "dev/worn_prop_1.tlog")
    track = replace(log.track, rotor_speed_rpm=log.track.rotor_speed_rpm[:, order])
    track = track.rows(slice(0, 1500))
    analysis = analyse(track, shipped_model())
    report = report_flight(analysis, replace(log, track=track), max_utilisation=0.5)
    facts = {fact["label"]: fact["text"] for fact in report.json["verdict"]["facts"]}
    assert ("rotor names" in facts) is not known
    assert ("which rotor that is, is not known" in facts["alarm"]) is not known
    assert ("rotor 1 were" in facts["what to do"]) is known
    assert ("rotors 1, 2, 3 and 4" in facts["what to do"]) is not known
    assert ("ROTOR NAMES ARE WRONG" in report.json["verdict"]["headline"]) is not known
    overview = overview_of([report], 0.5)
    made = Report(
        made_utc="",
        version="",
        max_utilisation=0.5,
        overview=overview,
        flights=(report,),
        unread=(),
    )
    write_report(made, tmp_path / "r.html")
    written = (tmp_path / "r.html").read_text("utf-8") + (tmp_path / "r.json").read_text("utf-8")
    assert all((place in written.lower()) is known for place in ("front left", "rear left"))


def test_a_replay_says_in_its_first_line_what_live_says_and_on_the_terminal_which(
    sitl_logs, tmp_path, capsys
):
    track = read_log(sitl_logs / "campaign/v4_m16_q2.5.tlog").track
    path = tmp_path / "swapped.csv"
    write_csv(replace(track, rotor_speed_rpm=track.rotor_speed_rpm[:, [1, 0, 2, 3]]), path)
    view = replay_view(path, shipped_model(), port=0, paused=True)
    assert view.whole is not None
    assert view.whole.headline.endswith("; MOTOR ORDER DIFFERS: ROTOR NAMES ARE WRONG")
    said = " ".join(capsys.readouterr().err.split())
    assert "rotor names cannot be trusted: motors 1 and 2 look swapped" in said
