"""Real logs without some messages, as vehicles without that equipment would have made them."""

from __future__ import annotations

import struct
from pathlib import Path

from pymavlink import mavutil


def without(log: Path, out: Path, *types: str, where: str | None = None) -> Path:
    """Copy a .tlog or .BIN to `out` but for messages of `types`; returns `out`.

    `where` like "BATTERY_STATUS.id==1" takes out those messages too in which it holds.
    """
    source = mavutil.mavlink_connection(str(log))
    kind, _, rest = (where or "").partition(".")
    field, _, value = rest.partition("==")
    with out.open("wb") as file:
        while (message := source.recv_msg()) is not None:
            name = message.get_type()
            if name in types or (name == kind and str(getattr(message, field)) == value):
                continue
            if out.suffix.lower() == ".tlog":
                file.write(struct.pack(">Q", int(message._timestamp * 1e6)))
            file.write(message.get_msgbuf())
    return out
