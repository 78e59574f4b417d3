"""`thrustmargin replay`: a recorded flight in the 3D view, with a timeline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    LIMIT,
    Inputs,
    Known,
    Reading,
    ReadingOptions,
    reading_keywords,
    with_recorded,
)
from thrustmargin.gcs_plugin.commands.shared.log_flights import model_of_log
from thrustmargin.gcs_plugin.commands.shared.options import (
    UsageError,
    check_port,
    check_range,
    check_speed,
    require_logs,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.flight_words import sortie_words
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.view.replay_view import ReplayView
    from thrustmargin.models.model.rotor_model import RotorModel

MOST_NAMED = 12  # logs of a folder


def replay(
    log: Positional[Path],
    *,
    model: Path | None = None,
    before: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    sortie: int | None = None,
    port: int = 8080,
    host: str = "127.0.0.1",
    token_file: Path | None = None,
    speed: float = 1.0,
    browser: bool = True,
    start_paused: bool = False,
) -> None:
    """Replay a recorded flight: route, thrust margin of every rotor, tank and rotor speeds.

    Opens a page in your browser, served by this computer alone; nothing is sent anywhere.
    Ctrl-C in this window ends it.

    Example: thrustmargin replay demo --speed 5

    Args:
        log: Recorded flight: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or the folder of
            one.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        before: Model file that --model was made from by `identify`; the route can then be coloured
            by the residual before and after.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the log is read.
        known: The known aircraft that flew; see `thrustmargin learn`.
        sortie: Number of the sortie to show, of a log that holds several; without it the worst.
        port: Port of the page.
        host: Address to serve the page on; only this computer can reach 127.0.0.1. On any other a
            token is asked for, which is printed.
        token_file: File with the token that a browser must know, instead of a new one each time.
        speed: Speed of the replay, 1 is real time; the page offers x1 to x60.
        browser: Open the page in the browser.
        start_paused: Wait at the start of the flight.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
    from thrustmargin.gcs_plugin.view.page.guard import page_token
    from thrustmargin.gcs_plugin.view.replay_view import run_replay

    check_port(port)
    check_speed(speed)
    check_range("--sortie", sortie, 1, 100_000)
    reading_keywords(reading)
    logs = require_logs([log])
    first, *others = logs
    if others:
        names = ", ".join(str(path.relative_to(log)) for path in logs[:MOST_NAMED])
        more = f" and {len(logs) - MOST_NAMED} more" if len(logs) > MOST_NAMED else ""
        raise UsageError(f"{log} holds {len(logs)} logs; name one of them: {names}{more}")
    inputs = with_recorded(
        Inputs(logs=logs, model=model, airframe=airframe, reading=reading, known=known),
        Terminal(stderr=True, soft_wrap=True),
    )
    rotor_model = model_of_log(inputs, logs[0], Terminal(stderr=True, soft_wrap=True))
    older = None if before is None else chosen_model(before, rotor_model.airframe.name)
    options = {"host": host, "port": port, "token": page_token(host, token_file)}
    options |= {"speed": speed, "paused": start_paused}
    options |= {
        "given": inputs.given or rotor_model.state is not None,
        "reading": inputs.reading,
        "limit": inputs.limit,
    }
    view = replay_view(first, rotor_model, older, sortie=sortie, **options)
    run_replay(view, browser=browser)


def replay_view(
    log: Path,
    model: RotorModel,
    before: RotorModel | None = None,
    *,
    given: bool = True,
    reading: ReadingOptions = AS_HEARD,
    sortie: int | None = None,
    limit: float = LIMIT,
    **options: Any,
) -> ReplayView:
    """Return the view of a recorded flight; with an older model `before`, also its residual under
    both.

    `given`: the user chose `model`; else it is used only for a flight recognised as one of its
    airframe. Of several sorties the view shows number `sortie` (from 1), or the one with the worst
    verdict if None; a list of all is printed on stderr, after the notes on the log. `limit` is the
    largest share of a rotor's thrust that may be in use; `options` are passed to ReplayView. Raise
    DataError for a sortie that is not there.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import log_lines
    from thrustmargin.gcs_plugin.logs.findings import names_wrong, report_findings
    from thrustmargin.gcs_plugin.logs.log_answer import answer_log, matched_flights
    from thrustmargin.gcs_plugin.view.replay_view import ReplayView
    from thrustmargin.gcs_plugin.view.scene.overlays import before_and_after
    from thrustmargin.gcs_plugin.wording.advice_words import headline
    from thrustmargin.gcs_plugin.wording.answer import answer_of
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict

    console = Terminal(stderr=True, soft_wrap=True)
    with console.status(escape(f"reading {log.name}")):
        flights = matched_flights(log, model, given=given, **reading_keywords(reading))
        if sortie is not None and not 1 <= sortie <= len(flights):
            raise DataError(f"--sortie {sortie}: {log.name} holds sorties 1 to {len(flights)}")
        analyses = [
            analysis_for_verdict(analyse(f.track, model, airframe_match=airframe_match))
            for f, airframe_match in flights
        ]
        answers = [answer_log(f, one, limit) for (f, _), one in zip(flights, analyses, strict=True)]
        advices = [one.advice for one in answers]
        order = sorted(
            range(len(flights)), key=lambda k: (advices[k].level.gravity, -advices[k].use.peak)
        )
        shown = order[0] if sortie is None else sortie - 1
        (flight, airframe_match), analysis = flights[shown], answers[shown].whole
        older = (
            None
            if before is None
            else analyse(analysis.track, before, airframe_match=airframe_match)
        )
        found = report_findings(answers[shown].findings)
        whole = answer_of(advices[shown], answers[shown].contact)
        dated = [(one.time_s, one.words) for one in found if one.time_s is not None]
    for line in log_lines(flight, stated=reading.states_load):
        console.print(escape(f"{log.name}: {line}"))
    for line in (*names_wrong(found), *whole.contact_lines):
        console.print(escape(f"  {line}"))
    for k, (other, _) in enumerate(flights) if len(flights) > 1 else ():
        line = f"{sortie_words(other.sortie, other.track)}: {headline(advices[k])}"
        console.print(f"  {line}; {'shown' if k == shown else f'--sortie {k + 1} shows it'}")
    return ReplayView(
        analysis,
        waypoints=flight.waypoints,
        messages=(*flight.messages, *dated),
        overlays=() if older is None else before_and_after(older, analysis),
        whole=lambda: answer_of(advices[shown], answers[shown].contact),
        limit=limit,
        **options,
    )
