"""Field laptops run Windows: nothing imports or names what only POSIX has, unless it asks first."""

import ast

import pytest

from tests.import_graph import modules

POSIX_MODULES = {
    *("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "readline", "syslog", "curses"),
    *("crypt", "nis", "ossaudiodev", "spwd"),
}
POSIX_NAMES = {
    "os": {
        *("fork", "forkpty", "getuid", "geteuid", "getgid", "setsid", "killpg", "getpgid", "uname"),
        *("mkfifo", "chown", "O_DIRECTORY", "O_NONBLOCK", "sched_setaffinity", "nice", "wait"),
        *("openpty", "posix_fallocate", "pread", "pwrite", "sync", "statvfs", "getloadavg"),
    },
    "signal": {
        *("SIGHUP", "SIGKILL", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGQUIT", "SIGCHLD", "SIGPIPE"),
        *("alarm", "setitimer", "pause", "sigwait", "pthread_sigmask"),
    },
    "socket": {"AF_UNIX", "SO_REUSEPORT", "socketpair", "MSG_DONTWAIT", "CMSG_SPACE"},
    "time": {"clock_gettime", "CLOCK_MONOTONIC_RAW", "tzset"},
}
#: Text files without an encoding are read in the code page of the computer.
OPENS = {"read_text", "write_text"}


def posix_only(source: str) -> list[str]:
    """What Windows has not, of a module's source; `hasattr` and `getattr` ask first."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".")[0] for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")[0]
            names = [module]
            of = POSIX_NAMES.get(module, set())
            found += [f"{module}.{a.name}" for a in node.names if a.name in of]
        else:
            names = []
        found += [name for name in names if name in POSIX_MODULES]
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            of = POSIX_NAMES.get(node.value.id, set())
            found += [f"{node.value.id}.{node.attr}"] if node.attr in of else []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            given = {keyword.arg for keyword in node.keywords}
            if node.func.attr in OPENS and not node.args[:1] and "encoding" not in given:
                found.append(f"{node.func.attr} without an encoding")
    return found


def test_no_module_needs_what_windows_has_not():
    found = {name: posix_only(path.read_text("utf-8")) for name, path in modules().items()}
    assert len(found) > 300
    assert {name: needs for name, needs in found.items() if needs} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import fcntl",
        "from termios import tcgetattr",
        "import os\nos.fork()",
        "import signal\nsignal.signal(signal.SIGHUP, print)",
        "from signal import SIGHUP",
        "path.read_text()",
    ],
)
def test_what_windows_has_not_is_found(source: str):
    assert posix_only(source)


def test_asking_first_is_allowed():
    asks = "import signal\nfound = getattr(signal, 'SIGHUP') if hasattr(signal, 'SIGHUP') else None"
    assert posix_only(asks) == []
