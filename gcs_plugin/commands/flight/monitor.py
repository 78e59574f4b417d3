"""thrustmargin monitor: watch vehicles that fly now."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.live import Live
from tyro.conf import Positional, UseAppendAction

from thrustmargin.gcs_plugin.commands.shared.analysed import OPTIONS, Chosen
from thrustmargin.gcs_plugin.commands.shared.options import (
    LONGEST_S,
    UsageError,
    check_port,
    check_range,
    check_utilisation,
)
from thrustmargin.gcs_plugin.commands.shared.reading import (
    AS_HEARD,
    Reading,
    Share,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import LinkError, require

LOOK_FOR = 5.0  # s until the places where nothing was heard are listed
PATIENCE = 3.0  # s that its end waits for what came and is not yet analysed

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.collector import MetricsServer
    from thrustmargin.gcs_plugin.live.console import EventPrinter
    from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor
    from thrustmargin.gcs_plugin.view.live_view import LiveView
    from thrustmargin.models.physics.airframe import Airframe


def monitor(
    url: Positional[str | None] = None,
    /,
    *,
    forward: UseAppendAction[tuple[str, ...]] = (),
    record: Path = Path("recordings"),
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
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
            is over puts its forecast beside it, and says which assumption was off.
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
    from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan

    check_port(port)
    check_port(bar, "--bar")
    check_port(metrics, "--metrics")
    check_range("--seconds", seconds, 0.0, LONGEST_S, "s")
    # A plan that is none is refused before the rest is loaded.
    planned = None if plan is None else read_plan(plan)
    beforehand = None if assumed is None else read_assumed(assumed, beside=plan)
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmSettings
    from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
    from thrustmargin.gcs_plugin.live.recording.recorder import tabulates
    from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
    from thrustmargin.gcs_plugin.telemetry.tank_source import check_source
    from thrustmargin.gcs_plugin.view.page.guard import page_token
    from thrustmargin.gcs_plugin.wording.live_words import FETCH, NO_SAMPLES, RATES

    began = time.monotonic()
    check_utilisation(max_utilisation)
    if announce_battery and not announce:
        raise UsageError("--announce-battery sends nothing without --announce; give both")
    if metrics is not None:
        require("monitor --metrics", "prometheus_client")
    where = {"host": host, "port": port, "token": page_token(host, token_file)}
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
    options = Chosen(
        model=model, airframe=airframe, max_utilisation=max_utilisation, reading=reading
    )
    settings = MonitorSettings(
        urls=(url,),
        forwards=tuple(forward),
        record=record,
        beside={OPTIONS: (json.dumps(options.as_table(), indent=2) + "\n").encode()},
        watch=WatchSettings(
            alarms=AlarmSettings(max_utilisation=max_utilisation),
            airframe_given=options.given,
            asked=frozenset(
                option for option, on in ((RATES, request_rates), (FETCH, fetch_mission)) if on
            ),
            link=url,
            **keywords,
        ),
    )
    chosen = chosen_model(model, airframe)
    check_source(chosen.airframe.tank_source)
    if not tabulates():
        Terminal(stderr=True, soft_wrap=True).print(f"note: {NO_SAMPLES}", markup=False)
    live = LiveMonitor(chosen, settings, accept=accept, refused_why=why)
    if announce or request_rates:
        from thrustmargin.gcs_plugin.link.sender import Sender
        from thrustmargin.gcs_plugin.live.announce import Announcer
        from thrustmargin.gcs_plugin.live.message_rates import RateRequester

        sender = Sender(live.listener, sign)
        if announce:
            least = 1.0 - max_utilisation
            live.subscribers.append(Announcer(sender, limit=least, battery=announce_battery))
        if request_rates:
            live.subscribers.append(RateRequester(sender, chosen.airframe.rotor_count))
    pilot_bar = None
    if bar is not None:
        from thrustmargin.gcs_plugin.live.pilot_bar import PilotBar

        pilot_bar = PilotBar(live.now_us, limit=1.0 - max_utilisation, port=bar, host=host)
        live.subscribers.append(pilot_bar)
    fetcher = None
    if fetch_mission:
        from thrustmargin.gcs_plugin.vehicle.mission_fetcher import MissionFetcher

        fetcher = MissionFetcher(live.listener, sign=sign)
        live.subscribers.append(fetcher)
        live.taps.append(fetcher.feed)
    unprinted: list[OSError] = []
    printer: EventPrinter | None = None
    events = Terminal(ends=True)  # the table on it wraps; lines are printed whole

    def print_line(words: str) -> None:
        # A full disk behind a redirected answer must not end the watch.
        try:
            events.print(words, soft_wrap=True)
        except OSError as error:
            unprinted.append(error)

    watch = None
    if planned is not None:
        from thrustmargin.gcs_plugin.live.plan_watch import PlanWatch
        from thrustmargin.gcs_plugin.wording.live_words import of_vehicle

        def say(vehicle: int, words: str) -> None:
            print_line(of_vehicle(vehicle, words))
            if page is not None:
                page.on_plan(vehicle, words)

        watch = PlanWatch(planned, chosen, say, beforehand)
        live.subscribers.append(watch)
    if not sys.stdout.isatty():
        from thrustmargin.gcs_plugin.live.console import EventPrinter

        printer = EventPrinter(live, print_line)
        live.subscribers.append(printer)
    elif not view and not silent:
        from thrustmargin.gcs_plugin.live.console import Bell

        live.subscribers.append(Bell(Terminal().bell))
    page = _page(live, chosen.airframe, silent, max_utilisation, **where) if view else None
    served = None if metrics is None else _metrics(live, metrics)
    until = math.inf if seconds is None else time.monotonic() + seconds
    try:
        if pilot_bar is not None:
            pilot_bar.start()
        live.start()
        if page is not None:
            page.announce(browser=browser)
        _show(live, until, printer, events, page=page is not None)
    finally:
        if fetcher is not None:
            fetcher.close()
        if pilot_bar is not None:
            pilot_bar.stop()
        if served is not None:
            served.close()
        live.close(PATIENCE)
        if watch is not None:
            watch.close()
        if page is not None:
            page.stop()
        _summary(live)
    live.check()
    if unprinted:
        raise unprinted[0]


def _found_link(seconds: float) -> str:
    """The usual endpoint on which a vehicle is heard; says what was tried while none is.

    Raises LinkError after so many s.
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


def _page(
    live: LiveMonitor, airframe: Airframe, silent: bool, max_utilisation: float, **where: Any
) -> LiveView:
    from thrustmargin.gcs_plugin.live.console import rowless_lines, status_lines
    from thrustmargin.gcs_plugin.view.live_view import LiveView

    page = LiveView(
        airframe,
        **where,
        status=lambda: [*status_lines(live.status(), page=True), *rowless_lines(live.fleet)],
        clock=live.now_us,
        silent=silent,
        max_utilisation=max_utilisation,
        acknowledged=live.acknowledge,
    )
    try:
        page.start()
    except BaseException:
        live.close()
        raise
    live.subscribers.append(page)
    return page


def _metrics(live: LiveMonitor, port: int) -> MetricsServer:
    from thrustmargin.gcs_plugin.live.collector import MetricsServer, MonitorCollector

    try:
        served = MetricsServer(MonitorCollector(live), port)
    except BaseException:
        live.close()
        raise
    Terminal(stderr=True, soft_wrap=True).print(f"metrics: {served.url}")
    return served


def _show(
    live: LiveMonitor,
    until: float,
    printer: EventPrinter | None,
    console: Terminal,
    *,
    page: bool,
) -> None:
    """The table, above which `console` prints, or lines alone where there is no terminal."""
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
    """What has been heard and the answer of the flight; also when nobody watches the table."""
    from thrustmargin.gcs_plugin.live.console import answer_lines, status_lines
    from thrustmargin.gcs_plugin.wording.live_words import copies_words, of_vehicle

    out = Terminal(stderr=True)
    for number, watch in live.fleet.vehicles.items():
        lines = [f"{watch.rows} samples, {watch.problem or watch.claim.described}"]
        lines += answer_lines(watch)
        if watch.doubled:
            lines.append(copies_words(watch.doubled))
        for line in lines:
            out.print(of_vehicle(number, line), soft_wrap=True, markup=False)
    for line in status_lines(live.status()):
        out.print(line, soft_wrap=True)
