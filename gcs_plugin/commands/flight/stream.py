"""thrustmargin stream: play a telemetry log onto the network."""

from __future__ import annotations

from pathlib import Path

from rich.progress import Progress, TextColumn, TimeElapsedColumn
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import check_speed
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import LinkError, LogError
from thrustmargin.models.whole_file import regular

TOO_FAST = (
    "faster than the flight: ESC messages carry no clock, so who listens dates them up to 0.1 s "
    "wrong; sizes of faults and the motor order are true at --speed 1 alone"
)


def stream(
    log: Positional[Path],
    /,
    *,
    to: str = "udpout:127.0.0.1:14550",
    speed: float = 1.0,
    loop: bool = False,
) -> None:
    """Play a telemetry log onto the network as if the vehicle were there.

    Every message goes out unchanged, in order and at its time. To try out `thrustmargin monitor`,
    or any ground station, without an aircraft.

    Example: thrustmargin stream demo --to udpout:127.0.0.1:14550 --speed 10

    Args:
        log: Telemetry log (.tlog) to play.
        to: Where to: udpout:HOST:PORT, tcpin:HOST:PORT (waits for a listener), tcp:HOST:PORT or a
            serial port such as /dev/ttyUSB0,57600.
        speed: How many times as fast as it was recorded.
        loop: Start again at the end, until stopped with Ctrl-C.
    """
    from thrustmargin.gcs_plugin.link.playback import Played, play
    from thrustmargin.gcs_plugin.link.transport import open_transport, parse_url
    from thrustmargin.gcs_plugin.logs.read import formats

    check_speed(speed)
    if not log.exists():
        raise LogError(f"{log}: no such file; check the name")
    try:
        regular(log)
    except OSError as error:
        raise LogError(f"{log}: {error.strerror}; give a log") from error
    found = formats(log)[0].name
    if found != "tlog":
        raise LogError(
            f"{log.name} is a {found} log, which has no frames to send; stream plays telemetry "
            f"logs (.tlog); to look at this one: thrustmargin replay {log}"
        )
    if parse_url(to).kind == "tlog":
        raise LinkError(f"--to {to} is a recording; give a link such as udpout:127.0.0.1:14550")
    if speed > 1.0:
        Terminal(stderr=True).print(TOO_FAST)
    transport = open_transport(to)
    try:
        columns = (TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        with Progress(*columns, console=Terminal(stderr=True), transient=True) as progress:
            task = progress.add_task(f"{log.name} to {to}", total=None)

            def show(played: Played) -> None:
                progress.update(task, description=_words(played, log, to))

            played = play(log, transport, speed=speed, loop=loop, progress=show)
    finally:
        transport.close()
    Terminal(stderr=True).print(_words(played, log, to))


def _words(played: object, log: Path, to: str) -> str:
    from thrustmargin.gcs_plugin.link.playback import Played

    assert isinstance(played, Played)
    late = f", up to {played.late_s:.2f} s late" if played.late_s > 0.05 else ""
    return f"{log.name} to {to}: {played.frames} messages, {played.log_s:.0f} s of the log{late}"
