"""Ports of this machine that a peer or a link can be given, and that nobody else takes meanwhile.

A port that the system gave and got back may be given again at once, to any process, before the
peer binds it. So ports come from below the range that the system gives from, each worker of
the tests has a stretch of its own, and no port is handed out twice.
"""

import itertools
import os
import socket

#: Below what Linux (32768), macOS and Windows (49152) give by themselves.
LOWEST, PER_WORKER, WORKERS = 20_000, 1_000, 12

_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % WORKERS
#: Two runs of the tests at once on a machine begin at places of their own.
_places = itertools.count(os.getpid() * 37)


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of the loopback address that is free now. Raises OSError when none is left."""
    for place in itertools.islice(_places, PER_WORKER):
        port = LOWEST + _worker * PER_WORKER + place % PER_WORKER
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
    raise OSError(f"no free port in the stretch of this worker ({PER_WORKER} ports)")


def free_udp_port() -> int:
    """The same, for datagrams."""
    return free_port(socket.SOCK_DGRAM)
