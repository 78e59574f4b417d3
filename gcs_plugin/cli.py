"""The `thrustmargin` command: one typed function a subcommand, errors as one line.

Exit codes: 0 done, 1 the input or the environment does not allow it, 2 the command line is wrong,
130 stopped by Ctrl-C.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import tyro

from thrustmargin.gcs_plugin.commands.options import UsageError, refuse_renamed
from thrustmargin.gcs_plugin.mavlink.layouts import clean_lines
from thrustmargin.models.errors import ThrustMarginError

#: subcommand -> module of thrustmargin.gcs_plugin.commands that holds a function of the same name.
COMMANDS = (
    "airframe",
    "demo",
    "fetch",
    "fill",
    "identify",
    "inspect",
    "match",
    "monitor",
    "replay",
    "report",
    "stream",
    "train",
)

DESCRIPTION = (
    "How much thrust a spraying multirotor has left, and why. "
    "Example: thrustmargin report sitl_logs/campaign/v4_m16_q2.5.tlog"
)


def command_function(name: str) -> Callable[..., Any]:
    """The function behind a subcommand; raises ImportError when the name is none."""
    return getattr(import_module(f"thrustmargin.gcs_plugin.commands.{name}"), name)


def main(argv: Sequence[str] | None = None) -> None:
    """Run one subcommand and exit with its code."""
    # Either may be closed, and a name that the terminal cannot show is no reason to fail.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    _end_as_by_ctrl_c()
    sys.exit(run(sys.argv[1:] if argv is None else list(argv)))


def _end_as_by_ctrl_c() -> None:
    """SIGTERM, SIGHUP and the closing of a window on Windows end as Ctrl-C does: files whole."""
    found = [getattr(signal, n) for n in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, n)]
    ours = [number for number in found if signal.getsignal(number) is signal.SIG_DFL]

    def end(*_: object) -> None:
        for number in ours:
            signal.signal(number, signal.SIG_IGN)  # a second one must not disturb the ending
        raise KeyboardInterrupt

    for number in ours:
        signal.signal(number, end)


def run(argv: Sequence[str]) -> int:
    """Run one subcommand; returns the exit code. Raises SystemExit(2) for a wrong command line."""
    chosen = [name for name in argv[:1] if name in COMMANDS]
    functions = {name: command_function(name) for name in chosen or COMMANDS}
    try:
        refuse_renamed(argv)
        try:
            outcome = tyro.extras.subcommand_cli_from_dict(
                functions, prog="thrustmargin", description=DESCRIPTION, args=list(argv)
            )
        finally:
            _flush()
    except ThrustMarginError as error:
        _complain(str(error))
        return 2 if isinstance(error, UsageError) else 1
    except BrokenPipeError:
        return 1  # whoever read has heard enough
    except OSError as error:
        where = error.filename or "standard output"
        _complain(f"cannot read or write {where}: {error.strerror or error}")
        return 1
    except KeyboardInterrupt:
        _complain("stopped; files that were finished are whole")
        return 130
    return outcome if isinstance(outcome, int) else 0


def _complain(words: str) -> None:
    with contextlib.suppress(OSError):
        print(f"thrustmargin: {clean_lines(words)}", file=sys.stderr)


def _flush() -> None:
    """Write out what is still held back; raises OSError when it cannot, and gives it up."""
    try:
        sys.stdout.flush()
    except OSError:
        # Else it would be tried again, and complained about, at the very end.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


if __name__ == "__main__":
    main()
