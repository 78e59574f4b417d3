"""Outputs of the monitor: each is started and closed, and a defect of one ends no other."""

import inspect
import json
import time
from importlib import import_module
from typing import Any

import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle, write_log
from tests.gcs_plugin.live.monitored import MODEL, recording_in
from thrustmargin.gcs_plugin.commands import extras
from thrustmargin.gcs_plugin.commands.flight.monitor import OUTPUTS, monitor
from thrustmargin.gcs_plugin.live.console import EventPrinter, status_lines
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.models.errors import LinkError

CALLS = [name for name, method in vars(Output).items() if callable(method)]


class Kept(Output):
    """Keeps the names of the methods that were called; raises an error in one of them."""

    def __init__(self, name: str, fails_in: str = "") -> None:
        self.name, self.calls = name, list[str]()
        for call in CALLS:
            setattr(self, call, self._noting(call, fails=call == fails_in))

    def _noting(self, call: str, *, fails: bool):
        def note(*arguments: Any) -> None:
            del arguments
            self.calls.append(call)
            if fails:
                raise RuntimeError("a defect")

        return note


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    vehicle = Vehicle()
    frames = [frame for _ in range(60) for frame in vehicle.tick()]
    return write_log(tmp_path_factory.mktemp("log") / "flight.tlog", frames)


def watched(log, folder, *outputs: Output) -> tuple[LiveMonitor, list[str]]:
    """Watch the whole log with outputs, which then are closed; also return the printed lines."""
    settings = MonitorSettings(urls=(str(log),), record=folder)
    live, printed = LiveMonitor(MODEL, settings, outputs=outputs), list[str]()
    live.outputs.append(EventPrinter(live, printed.append))
    live.start()
    while not live.finished:
        time.sleep(0.02)
    live.close()
    return live, printed


def test_an_output_is_started_before_the_first_frame_and_closed_after_the_last_row(log, tmp_path):
    one = Kept("one")
    watched(log, tmp_path, one)
    assert one.calls[0] == "start"
    assert one.calls[-1] == "close"
    assert one.calls.index("on_links_closing") > one.calls.index("on_round")
    assert {"on_frames", "on_update", "on_happening", "on_round"} <= set(one.calls)


@pytest.mark.parametrize("call", ["on_frames", "on_update", "on_happening", "on_round"])
def test_a_defect_of_one_output_closes_it_and_ends_no_other(log, tmp_path, call):
    bad, good = Kept("bad", fails_in=call), Kept("good")
    ended, printed = watched(log, tmp_path, bad, good)
    assert bad.calls.count(call) == 1
    assert bad.calls[-1] == "close"
    assert good.calls.count("on_update") > 3
    assert good.calls[-1] == "close"
    words = "STOPPED BY AN ERROR: bad (RuntimeError: a defect)"
    assert [line for line in printed if words in line]
    assert [line for line in status_lines(ended.status()) if line.startswith(words)]
    with pytest.raises(RuntimeError, match="a defect"):
        ended.check()
    lines = (recording_in(tmp_path) / "events.jsonl").read_text().splitlines()
    assert [e for e in map(json.loads, lines) if e["text"].startswith(words)]
    assert (recording_in(tmp_path) / "telemetry.tlog").read_bytes() == log.read_bytes()


def test_an_output_that_cannot_start_ends_the_start_and_all_are_closed(log):
    class Taken(Output):
        def start(self) -> None:
            raise LinkError("the port is taken")

    before = Kept("before")
    live = LiveMonitor(MODEL, MonitorSettings(urls=(str(log),)), outputs=[before, Taken()])
    with pytest.raises(LinkError, match="the port is taken"):
        live.start()
    assert before.calls == ["start", "on_links_closing", "close"]


def test_every_line_of_a_table_is_an_option_and_a_module_that_makes_its_output():
    tables = [OUTPUTS, *(getattr(extra, "OUTPUTS", {}) for extra in extras())]
    for table in tables:
        assert set(table) <= set(inspect.signature(monitor).parameters)
        for module in table.values():
            assert callable(import_module(module).output)
    assert {"announce", "bar", "view", "metrics"} <= {option for one in tables for option in one}
