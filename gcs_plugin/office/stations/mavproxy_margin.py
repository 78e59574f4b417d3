"""A MAVProxy module: `module load thrustmargin.gcs_plugin.mavproxy_module`, then `margin`.

Options at loading are those of `thrustmargin monitor`, as JSON without spaces:
`module load thrustmargin.gcs_plugin.mavproxy_module:{"model":"f16.safetensors","tank":"pump"}`;
there are model, airframe, max_utilisation and the reading options: vehicle, tank, tank_start_kg,
load, load_end, air_temperature_c. Each can be set later too: `margin airframe f16.toml`,
`margin tank NAMED_VALUE_FLOAT TANK`, `margin load 8`; `-` takes it back.
Nothing happens when this file is imported; everything that takes time runs in
`mavproxy_worker`, on a thread of its own. The 3D view is
`thrustmargin monitor`, a process that hears what MAVProxy hears, frame by frame over loopback UDP,
and can send nothing to the vehicle.
"""

from __future__ import annotations

import contextlib
import dataclasses
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from MAVProxy.modules.lib import mp_module

from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import (
    MarginOptions,
    MarginWorker,
    fields,
    summary,
)

MAIN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"


class ViewProcess:
    """A running monitor process; `address` is that of its page."""

    def __init__(self, options: list[str]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._port, page = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
        self.address = f"http://127.0.0.1:{page}"
        url = f"udpin:127.0.0.1:{self._port}"
        self._process = subprocess.Popen(
            [sys.executable, "-c", MAIN, "monitor", url, "--port", str(page), *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def send(self, data: bytes) -> None:
        """Send one frame to the process; drop the frame if the process has ended."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, ("127.0.0.1", self._port))

    def last_words(self) -> str:
        """Return the last line of a process that ended by itself; empty while it runs."""
        if self.running or self._process.stderr is None:
            return ""
        lines = [line for line in self._process.stderr.read().splitlines() if line.strip()]
        return lines[-1] if lines else f"exit code {self._process.returncode}"

    def close(self) -> None:
        """End the process that serves the view, by force after 3 s; later calls have no effect."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


#: MAVProxy finds a module again by the name that it was loaded under.
NAME = "thrustmargin.gcs_plugin.mavproxy_module"
#: What the module can be given, as it is written in MAVProxy -> its name in MarginOptions.
OPTIONS = {
    field.name.replace("_", "-"): field.name
    for field in dataclasses.fields(MarginOptions)
    if field.name != "max_utilisation"
}
USAGE = (
    "margin: thrust margin of every vehicle\n"
    "margin view: 3D view in the browser\n"
    "margin max-utilisation 50%: warn when more of a rotor's maximum thrust is in use\n"
    f"margin OPTION VALUE, or - for none: {', '.join(OPTIONS)}"
)
PERIOD = 0.5  # s between two looks at what the thread found
ROW = 4  # of the console, below MAVProxy's own


class MarginModule(mp_module.MPModule):
    """Shows and announces the thrust margin of every vehicle that MAVProxy hears."""

    def __init__(self, mpstate: Any, options: MarginOptions) -> None:
        super().__init__(mpstate, NAME, "thrust margin and redundancy", multi_vehicle=True)
        self._worker = MarginWorker(options)
        self._view: ViewProcess | None = None
        self._next = 0.0
        words = ["view", "max-utilisation", *OPTIONS]
        self.add_command("margin", self.cmd_margin, "thrust margin", words)
        self._worker.start()

    def mavlink_packet(self, packet: Any) -> None:
        """Queue a message for the worker; MAVProxy calls this with every message of every
        vehicle."""
        self._worker.put(bytes(packet.get_msgbuf()))

    def idle_task(self) -> None:
        """Print the worker's messages and update the console, at most every PERIOD s.

        MAVProxy calls this far more often.
        """
        now = time.monotonic()
        self._worker.looked()
        if now < self._next:
            return
        self._next = now + PERIOD
        while self._worker.messages:
            urgent, words = self._worker.messages.popleft()
            if urgent:
                self.say(words)
            else:
                self.console.writeln(words)
        if self._view is not None and not self._view.running:
            self.say(f"margin view ended: {self._view.last_words()}")
            self._close_view()
        found = self._worker.readings.get(self.target_system)
        age = float("nan") if found is None else now - found.stamp
        for name, (text, colour) in fields(found, self._worker.max_utilisation, age).items():
            self.console.set_status(name, text, row=ROW, fg=colour)

    def cmd_margin(self, args: Sequence[str]) -> None:
        """Run MAVProxy's command `margin`; `args` are the words after it. Print the usage for other
        words.
        """
        match list(args):
            case []:
                self._print_margins()
            case ["view"]:
                self._show_view()
            case ["max-utilisation"]:
                print(f"margin max-utilisation {100.0 * self._worker.max_utilisation:g}%")
            case ["max-utilisation", text]:
                self._set_max_utilisation(text)
            case [name] if name in OPTIONS:
                print(f"margin {name} {getattr(self._worker.options, OPTIONS[name])}")
            case [name, *value] if name in OPTIONS:
                self._set(name, " ".join(value))
            case _:
                print(USAGE)

    def unload(self) -> None:
        """End the worker; called by MAVProxy when the module is unloaded, and at its end."""
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
            print("\n".join(summary(now, worker.max_utilisation, age)))
        if worker.dropped:
            print(f"margin: {worker.dropped} messages were too many to compute with")

    def _set_max_utilisation(self, text: str) -> None:
        try:
            value = usable(text)
        except ValueError as error:
            print(f"margin max-utilisation {error}")
            return
        self._worker.max_utilisation = value
        print(f"margin max-utilisation {100.0 * value:g}%")

    def _set(self, name: str, text: str) -> None:
        """Set the option `name` from `text` and restart the worker with it.

        What vehicles reported about themselves so far is passed to the new worker. A text that is
        no number is refused in print.
        """
        before = self._worker
        try:
            options = with_option(before.options, OPTIONS[name], text)
        except ValueError:
            print(f"margin {name} {text} is no number")
            return
        before.stop(timeout=0.0)
        self._worker = MarginWorker(options, kept=before.kept)
        self._worker.max_utilisation = before.max_utilisation
        if self._view is not None:
            self._close_view()
            print("margin view closed: open it again for the new option")
        self._worker.start()
        print(f"margin {name} {text}")

    def _show_view(self) -> None:
        if self._view is not None and self._view.running:
            print(f"margin view is open: {self._view.address}")
            return
        self._close_view()
        options = self._worker.options
        given = dataclasses.asdict(options)
        given["max_utilisation"] = self._worker.max_utilisation
        given["air_temperature"] = given.pop("air_temperature_c")
        words = {f"--{name.replace('_', '-')}": value for name, value in given.items()}
        self._view = ViewProcess([f"{k}={v}" for k, v in words.items() if v is not None])
        self._worker.pass_on_to(self._view.send)
        print(f"margin view: {self._view.address}")

    def _close_view(self) -> None:
        view, self._view = self._view, None
        if view is not None:
            self._worker.stop_passing_on()
            view.close()


def init(mpstate: Any, **options: Any) -> MarginModule:
    """Return the module; MAVProxy calls this with itself and the options of `module load`.

    Raises ImportError, which MAVProxy prints as one line, for an unknown option or a wrong value.
    """
    unknown = sorted(set(options) - {field.name for field in dataclasses.fields(MarginOptions)})
    if unknown:
        raise ImportError(f"no option {', '.join(unknown)}; see docs/live.md")
    try:
        options["max_utilisation"] = usable(options.get("max_utilisation", 0.5))
    except ValueError as error:
        raise ImportError(f"max_utilisation {error}") from error
    return MarginModule(mpstate, MarginOptions(**options))


def with_option(options: MarginOptions, name: str, text: str) -> MarginOptions:
    """Return the options with the field `name` parsed from `text`; "-" restores the default.

    Raises ValueError if the field is a number and the text is not.
    """
    kind = next(field.type for field in dataclasses.fields(options) if field.name == name)
    default = {f.name: f.default for f in dataclasses.fields(options)}[name]
    value: Any = text
    if text == "-":
        value = default
    elif "int" in str(kind):
        value = int(text)
    elif "float" in str(kind):
        value = float(text)
    return dataclasses.replace(options, **{name: value})


def usable(value: Any) -> float:
    """Parse a share such as `0.5` or `50%`, between 0 and 1 exclusive.

    Raises ValueError for anything else.
    """
    number, percent, _ = str(value).partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except (TypeError, ValueError):
        share = float("nan")
    if not 0.0 < share < 1.0:
        raise ValueError(f"{value} is not a share; give one between 0 and 1, such as 0.5 or 50%")
    return share
