"""The `thrustmargin` command: one typed function a subcommand, errors as one line.

Exit codes: 0 done, 1 some input is not usable, 2 the command line is wrong, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import contextlib
import difflib
import gc
import inspect
import io
import os
import re
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any

from thrustmargin.gcs_plugin.commands import HERE, extras
from thrustmargin.gcs_plugin.commands.shared.options import QUIET, UsageError
from thrustmargin.gcs_plugin.commands.shared.typed import as_read, hide_none, plain_optionals
from thrustmargin.gcs_plugin.wording.language import LANGUAGES, clean_lines
from thrustmargin.gcs_plugin.wording.language import VARIABLE as LANGUAGE
from thrustmargin.models.errors import ThrustMarginError

#: Subcommand of the core -> the first words of the docstring of its function, here so that the help
#: loads none of them.
CORE = {
    "aircraft": "List the known aircraft, or show one",
    "airframe": "Make, show and check the file of an aircraft",
    "demo": "Show what thrustmargin does",
    "fetch": "Download the mission or a flight log from the vehicle",
    "fill": "Say how much liquid to fill for a day, and how that changes with air and battery",
    "forecast": "Say before take-off whether a plan can be flown with a fill",
    "inspect": "Show what a log holds",
    "monitor": "Watch every aircraft on a link",
    "replay": "Replay a recorded flight",
    "report": "Write a margin report of one or more flights",
    "stream": "Play a telemetry log onto the network as if the vehicle were there",
}
#: Folder of `commands` -> its subcommands: modules that hold a function of the same name.
#: `airframe` is a folder.
FOLDERS = {
    "flight": ("demo", "fetch", "inspect", "monitor", "replay", "report", "stream"),
    "load": ("fill", "forecast"),
}


def _extras() -> Iterator[tuple[str, str, str]]:
    """Yield each subcommand of each extra: its name, the module of its function, first words."""
    for extra in extras():
        for name, words in extra.COMMANDS.items():
            yield name, f"{extra.__name__}.{name}", words


_OF_EXTRAS = tuple(_extras())
#: Subcommand -> the first words of the docstring of its function, in the order of the names.
COMMANDS = dict(sorted({**CORE, **{name: words for name, _, words in _OF_EXTRAS}}.items()))
#: Subcommand of an older version -> the function of its words that returns those to type now.
RETIRED = {name: now for extra in extras() for name, now in getattr(extra, "RETIRED", {}).items()}
#: Subcommand -> the module that holds the function of its name.
MODULES = {
    "aircraft": f"{HERE}.commands.aircraft",
    "airframe": f"{HERE}.commands.airframe",
    **{
        name: f"{HERE}.commands.{folder}.{name}"
        for folder, held in FOLDERS.items()
        for name in held
    },
    **{name: module for name, module, _ in _OF_EXTRAS},
}

USAGE = """usage: thrustmargin COMMAND [OPTIONS]

How much thrust a spraying multirotor has left, and why.
Example: thrustmargin report demo

commands:
{commands}
options:
  -h, --help  this help; after a command, that command's
  --version   the version that is installed
  --language  with any command: en or de, for alarms, advice and the page;
              findings of identify, inspect and train stay English
  --quiet     with any command: print nothing but results that go to standard output, and errors

Where a log is asked for, `demo` is the bundled flight, and a folder is all logs in it.
Exit codes: 0 done, 1 some input is not usable, 2 the command line is wrong, 130 stopped by Ctrl-C.
"""


def command_function(name: str) -> Callable[..., Any]:
    """Return the function of a subcommand. Raises KeyError for an unknown name.

    Each description of an option becomes one line, which the help wraps to the terminal.
    """
    function = getattr(import_module(MODULES[name]), name)
    function.__doc__ = re.sub(r"\n {8,}(?=\S)", " ", inspect.getdoc(function) or "")
    return function


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command that `argv` names, and exit with its code.

    `argv` is the command line without the program's name; None means that of this process.
    """
    # Either may be closed, and a name that the terminal cannot show is no reason to fail.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # Small matrices: threads would only wait for each other, a third of the time of a report.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(50_000)  # imports make objects that stay: to look through them takes 0.1 s
    _end_as_by_ctrl_c()
    sys.exit(run(sys.argv[1:] if argv is None else list(argv)))


def _end_as_by_ctrl_c() -> None:
    """Make SIGTERM, SIGHUP and the closing of a Windows console raise KeyboardInterrupt.

    Files are then completed or left unchanged, as after Ctrl-C. Signals that already have a handler
    keep it.
    """
    found = [getattr(signal, n) for n in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, n)]
    ours = [number for number in found if signal.getsignal(number) is signal.SIG_DFL]

    def end(*_: object) -> None:
        for number in ours:
            signal.signal(number, signal.SIG_IGN)  # a second one must not disturb the ending
        raise KeyboardInterrupt

    for number in ours:
        signal.signal(number, end)


def usage() -> str:
    """Return the help that lists the commands."""
    wide = max(map(len, COMMANDS))
    lines = [f"  {name:{wide}}  {what}\n" for name, what in COMMANDS.items()]
    return USAGE.format(commands="".join(lines))


def not_a_command(name: str) -> str:
    """Return the error for an unknown command, with the commands of a similar name."""
    near = difflib.get_close_matches(name, COMMANDS, n=2, cutoff=0.6)
    meant = f"; did you mean {' or '.join(near)}?" if near else ""
    return f"no command {name!r}{meant} (thrustmargin --help lists them)"


def run(argv: Sequence[str]) -> int:
    """Run the command that `argv` names and return the exit code.

    It is 0 or what the command returns; 1 for an error, an unread log or a closed pipe, 2 for a
    wrong usage, 130 after Ctrl-C; the error is printed. Raise SystemExit(2) for a command line that
    cannot be parsed.
    """
    if argv and argv[0] in RETIRED:
        now = shlex.join(RETIRED[argv[0]](argv[1:]))
        _complain(f"{argv[0]} is no command any more; type: thrustmargin {now}")
        return 2
    argv = _in_language(argv)
    options = list(argv[: argv.index("--")] if "--" in argv else argv)
    if "--quiet" in options:
        os.environ[QUIET] = "1"
        argv = [word for word in options if word != "--quiet"] + list(argv[len(options) :])
    try:
        try:
            outcome = _answer(argv)
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
    except (KeyboardInterrupt, ImportError) as error:
        if not _stopped(error):
            raise
        _complain("stopped; files that were finished are whole")
        return 130
    terminal = sys.modules.get("thrustmargin.gcs_plugin.commands.shared.terminal")
    if terminal is not None and terminal.Terminal.unread:
        return 1
    return outcome if isinstance(outcome, int) else 0


def _stopped(error: BaseException | None) -> bool:
    """Return True if Ctrl-C caused an error.

    A compiled module that is interrupted in its import raises an ImportError from it.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _in_language(argv: Sequence[str]) -> list[str]:
    """Set the language that --language names, and return the command line without that option.

    Raise SystemExit(2) if the language is unknown.
    """
    words = list(argv)
    if "--language" in words[: words.index("--")] if "--" in words else "--language" in words:
        at = words.index("--language")
        code = "".join(words[at + 1 : at + 2])
        if code not in LANGUAGES:
            _complain(f"--language {code}: there are {' and '.join(LANGUAGES)}")
            raise SystemExit(2)
        os.environ[LANGUAGE] = code
        del words[at : at + 2]
    return words


def _answer(argv: Sequence[str]) -> Any:
    """Run the command that `argv` names and return its result; an int is the exit status.

    Without a command print the usage on stderr and return 2; print it for --help and the version
    for --version and return 0. Raise SystemExit(2) for an unknown command or arguments that cannot
    be parsed.
    """
    first = argv[0] if argv else ""
    if first in ("", "-h", "--help"):
        print(usage(), end="", file=sys.stdout if first else sys.stderr)
        return 0 if first else 2
    if first == "--version":
        from importlib.metadata import version

        print(f"thrustmargin {version('thrustmargin')}")
        return 0
    if first not in COMMANDS and not first.startswith("--tyro"):
        _complain(not_a_command(first))
        raise SystemExit(2)
    chosen = [first] if first in COMMANDS else [*COMMANDS]
    functions = {name: command_function(name) for name in chosen}
    import tyro  # takes half of the time of a help that needs nothing of it

    if {"-h", "--help"} & set(argv):
        for function in functions.values():
            hide_none(function)
    with plain_optionals():
        return tyro.extras.subcommand_cli_from_dict(
            functions, prog="thrustmargin", args=as_read(argv)
        )


def _complain(words: str) -> None:
    with contextlib.suppress(OSError):
        print(f"thrustmargin: {clean_lines(words)}", file=sys.stderr)


def _flush() -> None:
    """Flush standard output; if that fails, discard what is buffered and raise OSError."""
    try:
        sys.stdout.flush()
    except OSError:
        # Else it would be tried again, and complained about, at the very end.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


if __name__ == "__main__":
    main()
