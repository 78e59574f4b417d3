"""A MAVProxy module: `module load thrustmargin.gcs_plugin.mavproxy_module`, then `margin`.

Options at loading, as JSON without spaces:
`module load thrustmargin.gcs_plugin.mavproxy_module:{"model":"f16.safetensors","limit":45}`.
Nothing happens when this file is imported (MAVProxy imports it twice); everything that takes time
runs in `thrustmargin.gcs_plugin.mavproxy.worker`, on a thread of its own.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from MAVProxy.modules.lib import mp_module

from thrustmargin.gcs_plugin.mavproxy.monitor_process import ViewProcess
from thrustmargin.gcs_plugin.mavproxy.worker import MarginWorker, Options, fields, share, summary

#: MAVProxy finds a module again by the name that it was loaded under.
NAME = "thrustmargin.gcs_plugin.mavproxy_module"
USAGE = (
    "margin: thrust margin of every vehicle\n"
    "margin view: 3D view in the browser\n"
    "margin limit N: warn below N % thrust margin"
)
PERIOD = 0.5  # s between two looks at what the thread found
ROW = 4  # of the console, below MAVProxy's own


class MarginModule(mp_module.MPModule):
    """Shows and announces the thrust margin of every vehicle that MAVProxy hears."""

    def __init__(self, mpstate: Any, options: Options) -> None:
        super().__init__(mpstate, NAME, "thrust margin and redundancy", multi_vehicle=True)
        self._worker = MarginWorker(options)
        self._view: ViewProcess | None = None
        self._next = 0.0
        self.add_command("margin", self.cmd_margin, "thrust margin", ["view", "limit"])
        self._worker.start()

    def mavlink_packet(self, packet: Any) -> None:
        """Called by MAVProxy with every message of every vehicle."""
        self._worker.put(bytes(packet.get_msgbuf()))

    def idle_task(self) -> None:
        """Called by MAVProxy hundreds of times a second; works twice a second."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + PERIOD
        while self._worker.said:
            urgent, words = self._worker.said.popleft()
            if urgent:
                self.say(words)
            else:
                self.console.writeln(words)
        if self._view is not None and not self._view.running:
            self.say(f"margin view ended: {self._view.last_words()}")
            self._close_view()
        found = self._worker.readings.get(self.target_system)
        age = float("nan") if found is None else now - found.stamp
        for name, (text, colour) in fields(found, self._worker.limit, age).items():
            self.console.set_status(name, text, row=ROW, fg=colour)

    def cmd_margin(self, args: Sequence[str]) -> None:
        """The command `margin`."""
        match list(args):
            case []:
                self._print_margins()
            case ["view"]:
                self._show_view()
            case ["limit"]:
                print(f"margin limit {share(self._worker.limit)}")
            case ["limit", text]:
                self._set_limit(text)
            case _:
                print(USAGE)

    def unload(self) -> None:
        """Called by MAVProxy when the module is unloaded, and at its end."""
        self.remove_command("margin")
        self._worker.stop()
        self._close_view()

    def _print_margins(self) -> None:
        worker = self._worker
        if worker.failure:
            print(f"margin: {worker.failure}")
            return
        if not worker.readings:
            print("margin: no vehicle heard yet")
        for now in worker.readings.values():
            age = time.monotonic() - now.stamp
            print("\n".join(summary(now, worker.limit, age)))
        if worker.dropped:
            print(f"margin: {worker.dropped} messages were too many to compute with")

    def _set_limit(self, text: str) -> None:
        try:
            limit = float(text.removesuffix("%")) / 100.0
        except ValueError:
            limit = float("nan")
        if not 0.0 <= limit < 1.0:
            print(f"margin limit {text}: give a number of percent from 0 to 99, as in 50")
            return
        self._worker.limit = limit
        print(f"margin limit {share(limit)}")

    def _show_view(self) -> None:
        if self._view is not None and self._view.running:
            print(f"margin view is open: {self._view.address}")
            return
        self._close_view()
        options = self._worker.options
        given = {
            "--model": options.model,
            "--airframe": options.airframe,
            "--tank": options.tank,
            "--limit": f"{self._worker.limit:g}",
        }
        self._view = ViewProcess([t for k, v in given.items() if v for t in (k, v)])
        self._worker.pass_on_to(self._view.send)
        print(f"margin view: {self._view.address}")

    def _close_view(self) -> None:
        view, self._view = self._view, None
        if view is not None:
            self._worker.stop_passing_on()
            view.close()


def init(mpstate: Any, **options: Any) -> MarginModule:
    """Called by MAVProxy when it loads the module. `limit` is in percent."""
    if "limit" in options:
        options["limit"] = float(options["limit"]) / 100.0
    return MarginModule(mpstate, Options(**options))
