"""Real logs without some messages, as vehicles without that equipment would have made them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink import mavutil


def without(log: Path, out: Path, *types: str, drop: Callable[[Any], bool] | None = None) -> Path:
    """Copy a .tlog or .BIN to `out` but for messages of `types` or for which `drop` is true."""
    source = mavutil.mavlink_connection(str(log))
    with out.open("wb") as file:
        while (message := source.recv_msg()) is not None:
            if message.get_type() in types or (drop and drop(message)):
                continue
            if out.suffix.lower() == ".tlog":
                file.write(struct.pack(">Q", int(message._timestamp * 1e6)))
            file.write(message.get_msgbuf())
    source.close()
    return out


def is_tank(message: Any) -> bool:
    """True for what the recorded flights say of their tank: TANK, and battery 1."""
    kind = message.get_type()
    if kind == "BATTERY_STATUS":
        return message.id == 1
    return kind == "NAMED_VALUE_FLOAT" and message.name == "TANK"
