"""Recorded .tlog flights with another ESC telemetry: swapped, scaled, noisy or thinned speeds."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

ESC, OUTPUTS = "ESC_TELEMETRY_1_TO_4", "SERVO_OUTPUT_RAW"


def changed_speeds(
    log: Path,
    out: Path,
    *,
    swapped: tuple[int, int] | None = None,
    rate_hz: float = 0.0,
    noise: float = 0.0,
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
    outputs: bool = True,
) -> Path:
    """Copy a flight of four rotors to `out` with changed ESC telemetry.

    The readings of two rotors, from 1, are `swapped`, all thinned to `rate_hz`, with white `noise`
    as a share, each times its `scale`. Without `outputs` the motor outputs are left out.
    """
    source = mavutil.mavlink_connection(str(log))
    rng, last, order = np.random.default_rng(7), -np.inf, [0, 1, 2, 3]
    if swapped:
        first, second = (rotor - 1 for rotor in swapped)
        order[first], order[second] = second, first
    sender = mavlink.MAVLink(None)
    with out.open("wb") as file:
        while (message := source.recv_msg()) is not None:
            data, kind = message.get_msgbuf(), message.get_type()
            if kind == "BAD_DATA" or (kind == OUTPUTS and not outputs):
                continue
            if kind == ESC:
                if rate_hz and message._timestamp - last < 1.0 / rate_hz - 1e-3:
                    continue
                last = message._timestamp
                factor = np.array(scale) * (1.0 + noise * rng.standard_normal(4))
                speeds = np.round(np.array(message.rpm)[order] * factor).astype(int).tolist()
                made = mavlink.MAVLink_esc_telemetry_1_to_4_message(
                    message.temperature,
                    [message.voltage[k] for k in order],
                    [message.current[k] for k in order],
                    [message.totalcurrent[k] for k in order],
                    speeds,
                    message.count,
                )
                sender.srcSystem, sender.srcComponent = (
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                )
                sender.seq = message.get_seq()
                data = made.pack(sender)
            file.write(struct.pack(">Q", int(message._timestamp * 1e6)) + bytes(data))
    source.close()
    return out
