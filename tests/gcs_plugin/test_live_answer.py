"""What flies live says at the end of a flight what the report of the same flight says.

Page, terminal, bar, metrics, MAVProxy, alarms and what is sent, each by the way it is read.
"""

import io
import json
from csv import DictReader
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.gcs_plugin.logs.made_flights import made_airframe, made_flight
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
from thrustmargin.gcs_plugin.live.announce import figures
from thrustmargin.gcs_plugin.live.console import Screen
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.pilot_bar import PilotBar
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import reading, summary
from thrustmargin.gcs_plugin.office.streams.collector import MonitorCollector
from thrustmargin.gcs_plugin.view.live_view import LiveView
from thrustmargin.models.model.advice import FlightLevel

#: Flight -> tank of the aircraft in L, its layout, and how it flew; None: a recorded one.
MADE = {
    "hexa without a tank, a weak rotor": (0.0, "hexa-x", {"weak": 2, "lost": 0.12, "after": 50.0}),
    "quad with 3 kg more than its gauge": (5.0, "quad-x", {"load_kg": 4.0, "gauge_kg": 1.0}),
    "quad without a gauge": (5.0, "quad-x", {"load_kg": 3.0}),
}
RECORDED = ("onset/worn_prop_onset.tlog", "campaign/v4_m16_q2.5.tlog")


class Kept(Output):
    """Every update, as it came."""

    def __init__(self) -> None:
        self.updates: list[Update] = []

    def on_update(self, update: Update) -> None:
        self.updates.append(update)


def plain(text: str) -> str:
    return " ".join(text.replace("\N{NO-BREAK SPACE}", " ").split())


def flown(name: str, folder: Path, sitl_logs: Path) -> tuple[Path, str | None]:
    """The log of a flight, and its airframe where one is given."""
    if name in RECORDED:
        return sitl_logs / name, None
    tank_l, layout, how = MADE[name]
    airframe = made_airframe(folder, tank_l=tank_l, layout=layout)
    return made_flight(airframe, **how), str(airframe)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*RECORDED, *MADE])
def test_every_live_surface_ends_with_what_the_report_says(
    sitl_logs: Path, tmp_path: Path, capsys, name: str
):
    path, airframe = flown(name, tmp_path, sitl_logs)
    model = chosen_model(None, airframe)
    option = [] if airframe is None else ["--airframe", airframe]
    assert run(["report", str(path), *option, "--out", str(tmp_path / "r.html")]) == 0
    capsys.readouterr()
    (report,) = json.loads((tmp_path / "r.json").read_text())["flights"]
    verdict = report["verdict"]
    first, do, level = verdict["headline"], verdict["action"], verdict["level"]
    fill_kg = verdict["fill"]["kg"]
    rotors = [alarm["rotor"] for alarm in report["alarms"]]

    view, kept = LiveView(model.airframe, port=0), Kept()
    bar = PilotBar(lambda: 0, limit=0.5, port=0, host="127.0.0.1")
    settings = MonitorSettings(
        urls=(str(path),), watch=WatchSettings(airframe_given=airframe is not None)
    )
    with LiveMonitor(model, settings, outputs=[view, bar, kept]) as monitor:
        while not monitor.finished:
            monitor.wait(0.05)
        update = monitor.wait(0.0)[1]
        (page,) = view._screen.state()["vehicles"]
        assert (page["flight"]["level"], page["flight"]["headline"]) == (level, first)
        assert (page["flight"]["action"], page["flight"]["rotors"]) == (do, rotors)
        assert page["flight"]["fill_kg"] == fill_kg
        assert page["flight"]["until_s"] is None  # nothing is "so far" any more
        (heard,) = bar.content()["vehicles"]
        assert heard["flight"] == {k: v for k, v in page["flight"].items() if k != "line"}
        shown = io.StringIO()
        Console(file=shown, width=4000).print(Screen(monitor))
        assert f"Last flight: {first}: {do}" in plain(shown.getvalue())
        assert f"{first}: {do}" in plain(" ".join(summary(reading(update, 0.0), 0.5, 0.0)))
        sent = figures(update)
        assert sent.get("NEXT_FILL") == fill_kg
        assert list(FlightLevel)[int(sent["FLIGHT_LVL"])] == level
        found = {m.name: m.samples for m in MonitorCollector(monitor).collect()}
        if fill_kg is not None:
            assert found["thrustmargin_next_fill_kg"][0].value == fill_kg
        assert found["thrustmargin_flight_level"][0].value == sent["FLIGHT_LVL"]
        standing = monitor.fleet.vehicles[1].alarms.listed.values()
        bad = [alarm for alarm in standing if alarm.name == "rotor"]
        assert [alarm.rotor for alarm in bad] == rotors
        said = [alarm["words"] for alarm in report["alarms"]]
        # Nobody can land any more when a report is read.
        assert [one.text.removesuffix(": land") for one in bad] == said
    assert update.answer is not None
    assert len(update.answer.brief) <= 50
    assert_rows_agree(kept.updates, tmp_path / "r.csv")


def assert_rows_agree(updates: list[Update], csv: Path) -> None:
    """In the last quarter of the flight every row shows the report's redundancy."""
    column, theirs = "redundancy_yaw_uncontrolled", {}
    with csv.open(encoding="utf-8") as file:
        for row in DictReader(file):
            named = {name.partition(" ")[0]: cell for name, cell in row.items()}
            if named["flying"] == "1":  # blank: a rotor is bad
                theirs[round(float(named["time_s"]), 1)] = float(named[column] or "nan")
    last_s, seen = max(theirs), 0
    for update in updates:
        times = np.round(update.analysis.track.time_s[update.first :], 1).tolist()
        free = update.analysis.redundancy_yaw_uncontrolled[update.first :].tolist()
        for time_s, ours in zip(times, free, strict=True):
            if 0.75 * last_s < time_s < last_s - 3.0 and time_s in theirs:
                seen += 1
                assert ours == pytest.approx(theirs[time_s], rel=0.01, nan_ok=True), time_s
    assert seen > 50
