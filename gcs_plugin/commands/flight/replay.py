"""`thrustmargin replay`: a recorded flight in the 3D view, with a timeline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.reading import AS_HEARD, Reading, ReadingOptions
from thrustmargin.gcs_plugin.commands.shared.recorded import LIMIT, Chosen, with_recorded
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.view.replay_view import ReplayView
    from thrustmargin.models.model.rotor_model import RotorModel


def replay(
    log: Positional[Path],
    *,
    model: Path | None = None,
    before: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
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

    Example: thrustmargin replay sitl_logs/campaign/v4_m16_q2.5.tlog --speed 5

    Args:
        log: Recorded flight: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        before: Model file that --model was made from by `identify`; the route can then be coloured
            by the residual before and after.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the log is read.
        port: Port of the page.
        host: Address to serve the page on; only this computer can reach 127.0.0.1. On any other a
            token is asked for, which is printed.
        token_file: File with the token that a browser must know, instead of a new one each time.
        speed: Speed of the replay, 1 is real time; the page offers x1 to x60.
        browser: Open the page in the browser.
        start_paused: Wait at the start of the flight.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
    from thrustmargin.gcs_plugin.view.page.token_door import page_token
    from thrustmargin.gcs_plugin.view.replay_view import run_replay

    chosen = with_recorded(
        [log],
        Chosen(model=model, airframe=airframe, reading=reading),
        Terminal(stderr=True, soft_wrap=True),
    )
    rotor_model = chosen_model(chosen.model, chosen.airframe)
    older = None if before is None else chosen_model(before, rotor_model.airframe.name)
    options = {"host": host, "port": port, "token": page_token(host, token_file)}
    options |= {"speed": speed, "paused": start_paused}
    options |= {"given": chosen.given, "reading": chosen.reading, "limit": chosen.limit}
    view = replay_view(log, rotor_model, older, **options)
    run_replay(view, browser=browser)


def replay_view(
    log: Path,
    model: RotorModel,
    before: RotorModel | None = None,
    *,
    given: bool = True,
    reading: ReadingOptions = AS_HEARD,
    limit: float = LIMIT,
    **options: Any,
) -> ReplayView:
    """The view of a recorded flight; with a model `before` also its residual before and after.

    A model that was not `given` is taken only for a flight that is recognised as one of its
    airframe. `limit` is the largest share of a rotor's thrust that may be in use. `options` are
    those of ReplayView.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import read_flight
    from thrustmargin.gcs_plugin.reports.margin import flight_verdict
    from thrustmargin.gcs_plugin.view.replay_view import ReplayView
    from thrustmargin.gcs_plugin.view.scene.overlays import before_and_after
    from thrustmargin.models.model.analysis import analyse, for_verdict

    with Terminal(stderr=True).status(escape(f"reading {log.name}")):
        flight, claim = read_flight(log, model, given=given, reading=reading)
        analysis = for_verdict(analyse(flight.track, model, claim=claim))
        older = None if before is None else analyse(analysis.track, before, claim=claim)
        verdict = flight_verdict(analysis, max_utilisation=limit)
    return ReplayView(
        analysis,
        waypoints=flight.waypoints,
        messages=flight.messages,
        overlays=() if older is None else before_and_after(older, analysis),
        verdict=(verdict.headline, verdict.level),
        **options,
    )
