"""`thrustmargin demo`: the main job on one bundled flight: report, then replay."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import (
    LONGEST_S,
    check_port,
    check_range,
    check_speed,
)
from thrustmargin.gcs_plugin.commands.shared.typed import BUNDLED


def demo(
    log: Positional[Path | None] = None,
    *,
    out: Path = Path("report.html"),
    port: int = 8080,
    speed: float = 5.0,
    seconds: float | None = None,
    browser: bool = True,
) -> int:
    """Show what thrustmargin does: write the margin report of a flight, then replay it in 3D.

    The flight is a simulated F16 that starts with 16 kg in the tank. The view is served to this
    computer alone; Ctrl-C ends it. Your own aircraft begins with `thrustmargin learn LOG`.

    Example: thrustmargin demo

    Args:
        log: Recorded flight; without it the bundled one.
        out: Page of the report.
        port: Port of the view.
        speed: Speed of the replay, 1 is real time.
        seconds: End by itself after so many seconds; without it at Ctrl-C.
        browser: Open the view in the browser.
    """
    import threading

    from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
    from thrustmargin.gcs_plugin.commands.flight.report import report
    from thrustmargin.gcs_plugin.view.replay_view import run_replay
    from thrustmargin.models.errors import LogError
    from thrustmargin.models.model.model_file import shipped_model

    check_port(port)
    check_speed(speed)
    check_range("--seconds", seconds, 0.0, LONGEST_S, "s")
    if log is None:
        log = BUNDLED
    if not log.exists():
        raise LogError(f"no flight {log}; name a log")
    code = report((log,), out=out)
    if code:
        return code
    stop = threading.Event()
    if seconds is not None:
        threading.Timer(seconds, stop.set).start()
    view = replay_view(log, shipped_model(), given=False, port=port, speed=speed)
    run_replay(view, browser=browser, stop=stop)
    return 0
