"""thrustmargin monitor: watch vehicles that fly now."""

from __future__ import annotations

import json
import math
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.live import Live
from tyro.conf import Positional, UseAppendAction

from thrustmargin.gcs_plugin.commands import extras
from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    OPTIONS,
    Inputs,
    Known,
    Reading,
    Share,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.options import (
    LONGEST_S,
    UsageError,
    check_port,
    check_range,
    check_utilisation,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import LinkError, require

LOOK_FOR = 5.0  # s until the places where nothing was heard are listed
PATIENCE = 3.0  # s that its end waits for what came and is not yet analysed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from thrustmargin.gcs_plugin.live.console import EventPrinter
    from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, OutputFactory

#: Option of `monitor` -> the module whose `output` makes the output that it switches on, in the
#: order in which they start. Extras have a table of their own in their `__init__`.
OUTPUTS = {
    "announce": "thrustmargin.gcs_plugin.live.announce",
    "request_rates": "thrustmargin.gcs_plugin.live.message_rates",
    "bar": "thrustmargin.gcs_plugin.live.pilot_bar",
    "fetch_mission": "thrustmargin.gcs_plugin.vehicle.mission_fetcher",
    "plan": "thrustmargin.gcs_plugin.live.plan_watch",
    "view": "thrustmargin.gcs_plugin.view.live_view",
}


def monitor(
    url: Positional[str | None] = None,
    /,
    *,
    forward: UseAppendAction[tuple[str, ...]] = (),
    record: Path = Path("recordings"),
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    max_utilisation: Share = 0.5,
    announce: bool = False,
    announce_battery: bool = False,
    bar: int | None = None,
    request_rates: bool = False,
    fetch_mission: bool = False,
    plan: Path | None = None,
    assumed: Path | None = None,
    signing_key_file: Path | None = None,
    view: bool = True,
    host: str = "127.0.0.1",
    port: int = 8080,
    token_file: Path | None = None,
    browser: bool = True,
    silent: bool = False,
    metrics: Annotated[int | None, tyro.conf.arg(metavar="PORT")] = None,
    seconds: float | None = None,
) -> None:
    """Watch every aircraft on a link: thrust margin, redundancy, tank and alarms as they happen.

    Listens only; nothing is sent unless --announce, --request-rates, --fetch-mission or --forward
    asks for it.
    Everything heard is recorded, with these options, which `report` and `replay` then take.
    Shows a table here and the aircraft in the browser, on a page that this computer alone can
    open. Ctrl-C ends it.

    Example: thrustmargin monitor udpin:127.0.0.1:14550 --forward udpout:127.0.0.1:14551

    Args:
        url: Where to listen: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, a
            serial port such as /dev/ttyUSB0,57600, or a recording (.tlog). Without it the usual
            places are tried: UDP 14550 and 14540, TCP 5760, 5762, 5763 and 5777 of this computer,
            and serial ports on USB.
        forward: Pass every byte on, unchanged, to a ground station at udpout:HOST:PORT (or
            tcpin:HOST:PORT), and its answers back to the vehicle. May be given several times.
        record: Folder in which the recording's own folder is made.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the link is read.
        known: The known aircraft on the link; see `thrustmargin learn`.
        max_utilisation: Largest share of a rotor's maximum thrust that may be in use; above it an
            alarm is raised.
        announce: Send alarms and figures to vehicles and ground stations as STATUSTEXT and
            NAMED_VALUE_FLOAT.
        announce_battery: With --announce, on trial: margin and tank besides as batteries 90 and 91
            (BATTERY_STATUS), for ground stations that show no named values.
        bar: Serve the pilot's bar on this port of --host, for BlueOS and Cockpit:
            margin, rotor, action, no positions and no token.
        request_rates: Ask the vehicle for the messages that are needed, at the rates needed.
        fetch_mission: Ask each vehicle for its mission when it appears, to forecast the margin
            along it.
        plan: Plan that is flown (.plan, .waypoints, or a log with it): a line at each stretch that
            is over compares it with its forecast, and says which assumption was off.
        assumed: With --plan, what it was forecast with: the JSON that `forecast --json` wrote.
        signing_key_file: Key of signed links; with it every frame that is not signed with it is
            dropped and counted.
        view: Show the aircraft in 3D on a page of this computer; --no-view for the table alone.
        host: Address to serve the page on; only this computer can reach 127.0.0.1. On any other a
            token is asked for, which is printed.
        port: Port of the page.
        token_file: File with the token that a browser must know, instead of a new one each time.
        browser: Open the page in the browser.
        silent: Make no sound: without it the page has a button that switches tone and voice on, and
            the terminal without a page rings its bell.
        metrics: Port at which Prometheus on this computer collects margins, alarms, ages and
            losses; without it none.
        seconds: End by itself after so long.
    """
    options = dict(locals())
    from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan

    check_port(port)
    check_port(bar, "--bar")
    check_port(metrics, "--metrics")
    check_range("--seconds", seconds, 0.0, LONGEST_S, "s")
    # A plan that is none is refused before the rest is loaded.
    planned = None if plan is None else read_plan(plan)
    beforehand = None if assumed is None else read_assumed(assumed, plan=plan)
    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmSettings
    from thrustmargin.gcs_plugin.live.console import Bell, EventPrinter, PlanPrinter
    from thrustmargin.gcs_plugin.live.live_monitor import (
        LiveMonitor,
        MonitorSettings,
        OutputContext,
    )
    from thrustmargin.gcs_plugin.live.recording.recorder import tabulates
    from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
    from thrustmargin.gcs_plugin.telemetry.battery_and_tank import check_source
    from thrustmargin.gcs_plugin.view.page.guard import page_token
    from thrustmargin.gcs_plugin.wording.live_words import FETCH, NO_SAMPLES, RATES
    from thrustmargin.models.errors import install_line

    began = time.monotonic()
    check_utilisation(max_utilisation)
    if announce_battery and not announce:
        raise UsageError("--announce-battery sends nothing without --announce; give both")
    options |= {"token": page_token(host, token_file), "plan": planned, "assumed": beforehand}
    makers = _makers(options)
    keywords = reading_keywords(reading)
    if url is None:
        url = _found_link(math.inf if seconds is None else seconds)
        seconds = None if seconds is None else max(seconds - (time.monotonic() - began), 0.0)
    accept, sign, why = None, None, str
    if signing_key_file is not None:
        from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter, read_signing_key

        found = read_signing_key(signing_key_file)
        for note in found.notes:
            Terminal(stderr=True, soft_wrap=True).print(f"note: {note}")
        key = found.key
        recorded = url.lower().endswith(".tlog")
        guard = SigningFilter(key, clock=None) if recorded else SigningFilter(key)
        accept, why = guard.accept, lambda: guard.counts.reasons
        sign = Signer(key, after=lambda: guard.latest).sign
    inputs = Inputs(
        model=model,
        airframe=airframe,
        max_utilisation=max_utilisation,
        reading=reading,
        known=known,
    )
    settings = MonitorSettings(
        urls=(url,),
        forwards=tuple(forward),
        record=record,
        extra_files={OPTIONS: (json.dumps(inputs.as_table(), indent=2) + "\n").encode()},
        watch=WatchSettings(
            alarms=AlarmSettings(max_utilisation=max_utilisation),
            airframe_given=inputs.given,
            asked=frozenset(
                option for option, on in ((RATES, request_rates), (FETCH, fetch_mission)) if on
            ),
            link=url,
            **keywords,
        ),
    )
    chosen = inputs.rotor_model()
    check_source(chosen.airframe.tank_source)
    if not tabulates():
        note = NO_SAMPLES.format(line=install_line("fleet"))
        Terminal(stderr=True, soft_wrap=True).print(f"note: {note}", markup=False)
    live = LiveMonitor(chosen, settings, accept=accept, refused_why=why)
    unprinted: list[OSError] = []
    printer: EventPrinter | None = None
    events = Terminal(ends=True)  # the table on it wraps; lines are printed whole

    def print_line(words: str) -> None:
        # A full disk behind a redirected answer must not end the watch.
        try:
            events.print(words, soft_wrap=True)
        except OSError as error:
            unprinted.append(error)

    context = OutputContext(
        monitor=live,
        options=options,
        sign=sign,
        print_line=print_line,
        print_note=Terminal(stderr=True, soft_wrap=True).print,
    )
    started = False
    until = math.inf if seconds is None else time.monotonic() + seconds
    try:
        live.outputs += [make(context, value) for make, value in makers]
        if planned is not None:
            live.outputs.append(PlanPrinter(print_line))
        if not sys.stdout.isatty():
            live.outputs.append(printer := EventPrinter(live, print_line))
        elif not view and not silent:
            live.outputs.append(Bell(Terminal().bell))
        live.start()
        started = True
        _show(live, until, printer, events, page=view)
    finally:
        live.close(PATIENCE)
        if started:
            _summary(live)
    live.check()
    if unprinted:
        raise unprinted[0]


def _makers(options: Mapping[str, Any]) -> list[tuple[OutputFactory, Any]]:
    """Return (factory, option's value) of each output that `options` switch on.

    An option that is None or False switches nothing on. Raises InstallError if an output's library
    is missing, UsageError if its extra is.
    """
    tables = [OUTPUTS, *(getattr(extra, "OUTPUTS", {}) for extra in extras())]
    modules = {option: module for table in tables for option, module in table.items()}
    if options["metrics"] is not None and "metrics" not in modules:
        raise UsageError("--metrics needs gcs_plugin/office/streams, which is not installed")
    found = []
    for option, name in modules.items():
        value = options[option]
        if value is None or value is False:
            continue
        module = import_module(name)
        if library := getattr(module, "LIBRARY", ""):
            require(f"monitor --{option}", library)
        found.append((module.output, value))
    return found


def _found_link(seconds: float) -> str:
    """Return the URL of the first usual endpoint on which a vehicle is heard.

    Print meanwhile which endpoints are tried. Raises LinkError if none is heard within `seconds` s.
    """
    from thrustmargin.gcs_plugin.link.find_link import LinkFinder
    from thrustmargin.gcs_plugin.wording.live_words import tried_words

    console, finder = Terminal(soft_wrap=True), LinkFinder()
    until = time.monotonic() + seconds
    tried: dict[str, str] = {}
    while (left := until - time.monotonic()) > 0.0:
        url = finder.find(min(LOOK_FOR, left))
        if url is not None:
            console.print(f"vehicle heard on {url}")
            return url
        if finder.tried != tried and left > LOOK_FOR:
            tried = dict(finder.tried)
            console.print(tried_words(tried))
            console.print("still looking; Ctrl-C ends it")
    raise LinkError(tried_words(finder.tried))


def _show(
    live: LiveMonitor,
    until: float,
    printer: EventPrinter | None,
    console: Terminal,
    *,
    page: bool,
) -> None:
    """Display the live table in the terminal until `until` (time.monotonic(), s) or the link's end.

    `console` prints lines above the table. With a `printer`, for output that is no terminal, only
    lines are printed. `page`: a page is served too, which the output names.
    """
    from thrustmargin.gcs_plugin.live.console import Screen

    if printer is not None:
        while time.monotonic() < until and not live.finished:
            time.sleep(0.1)
            printer.look(page=page)
        return
    shown = Screen(live, page=page)
    with Live(shown, console=console, auto_refresh=False, transient=True) as display:
        while time.monotonic() < until and not live.finished:
            display.refresh()
            time.sleep(0.25)


def _summary(live: LiveMonitor) -> None:
    """Print on stderr the vehicles heard, results of their last flights, and the link's state."""
    from thrustmargin.gcs_plugin.live.console import answer_lines, status_lines
    from thrustmargin.gcs_plugin.wording.check_words import described_words, statement_words
    from thrustmargin.gcs_plugin.wording.live_words import of_vehicle
    from thrustmargin.models.statement import state

    out = Terminal(stderr=True)
    for number, watch in live.fleet.vehicles.items():
        lines = [f"{watch.rows} samples, {watch.problem or described_words(watch.airframe_match)}"]
        lines += answer_lines(watch)
        if watch.link.doubled:
            copies = state("copies dropped", count=float(watch.link.doubled))
            lines.append(statement_words(copies))
        for line in lines:
            out.print(of_vehicle(number, line), soft_wrap=True, markup=False)
    for line in status_lines(live.status()):
        out.print(line, soft_wrap=True)
