"""The `thrustmargin` command: one typed function a subcommand, errors as one line.

Exit codes: 0 done, 1 the input or the environment does not allow it, 2 the command line is wrong,
130 stopped by Ctrl-C.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import tyro

from thrustmargin.gcs_plugin.commands.options import UsageError, refuse_renamed
from thrustmargin.models.errors import ThrustMarginError

#: subcommand -> module of thrustmargin.gcs_plugin.commands that holds a function of the same name.
COMMANDS = (
    "airframe",
    "demo",
    "fetch",
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
    sys.exit(run(sys.argv[1:] if argv is None else list(argv)))


def run(argv: Sequence[str]) -> int:
    """Run one subcommand; returns the exit code. Raises SystemExit(2) for a wrong command line."""
    chosen = [name for name in argv[:1] if name in COMMANDS]
    functions = {name: command_function(name) for name in chosen or COMMANDS}
    try:
        refuse_renamed(argv)
        outcome = tyro.extras.subcommand_cli_from_dict(
            functions, prog="thrustmargin", description=DESCRIPTION, args=list(argv)
        )
    except ThrustMarginError as error:
        print(f"thrustmargin: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except KeyboardInterrupt:
        print("thrustmargin: stopped; files that were finished are whole", file=sys.stderr)
        return 130
    return outcome if isinstance(outcome, int) else 0


if __name__ == "__main__":
    main()
