"""Voltage and current of the flight pack, and whether the pump runs."""

from __future__ import annotations

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.signals import SENDER_VOLTAGE, Signals, best, by_index
from thrustmargin.gcs_plugin.telemetry.tank_source import TankContext, pack_id, pump_share

#: A tank that loses more than this over the window is being sprayed, kg/s.
_SPRAY_RATE = 0.008
_SPRAY_WINDOW = 4.0  # s


def power(signals: Signals, notes: list[str]) -> dict[str, Signal]:
    """Voltage and current of the flight pack: its battery message, SYS_STATUS, or the ESCs.

    Adds to `notes` when there are more packs than the one that is used.
    """
    chosen: dict[str, Signal] = {}
    pack = pack_id(signals)
    for channel in ("voltage", "current"):
        battery = by_index(signals, f"battery_{channel}")
        candidates = [*signals.get(channel, ())]
        if pack is not None and pack in battery:
            candidates.insert(0, battery[pack])
        escs = [s for s in by_index(signals, f"esc_{channel}").values() if np.any(s.values > 0)]
        if escs:
            candidates.append(_of_escs(channel, escs))
        found = best({channel: tuple(candidates)}, channel)
        if found is not None:
            chosen[channel] = found
    others = [
        str(number)
        for number, signal in by_index(signals, "battery_voltage").items()
        if number != pack and np.mean(signal.values > 2 * SENDER_VOLTAGE) > 0.5
    ]
    if pack is not None and others:
        extra = ", ".join(others)
        notes.append(f"battery {extra} reads a pack's voltage too; only battery {pack} is used")
    return chosen


def _of_escs(channel: str, escs: list[Signal]) -> Signal:
    time_s = escs[0].time_s
    stack = np.stack([np.interp(time_s, s.time_s, s.values) for s in escs], axis=-1)
    if channel == "voltage":
        return Signal(channel, f"{escs[0].source} (mean of ESCs)", time_s, stack.mean(axis=-1))
    return Signal(channel, f"{escs[0].source} (sum of ESCs)", time_s, stack.sum(axis=-1))


def spraying_of(
    signals: Signals, context: TankContext, tank: Signal | None, notes: list[str]
) -> Signal | None:
    """1 while the pump runs, by its servo output or else by the falling tank; adds to `notes`."""
    share = pump_share(signals, context)
    if share is not None:
        on = np.where(np.isfinite(share.values), (share.values > 0.0).astype(np.float64), np.nan)
        return Signal("spraying", f"{share.source} above its minimum", share.time_s, on)
    if tank is None or tank.time_s.size < 2:
        return None
    earlier = np.interp(tank.time_s - _SPRAY_WINDOW, tank.time_s, tank.values)
    falling = (earlier - tank.values) / _SPRAY_WINDOW > _SPRAY_RATE
    notes.append("no pump output known: spraying is read from the falling tank level")
    words = f"tank level falling by more than {_SPRAY_RATE * 60:.2f} kg/min"
    return Signal("spraying", words, tank.time_s, falling.astype(np.float64))
