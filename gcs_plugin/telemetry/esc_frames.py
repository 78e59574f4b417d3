"""Compute the share of its telemetry frames that each ESC loses, for recorded flights.

A loose signal or telemetry plug, or a desync, shows as lost frames before the speed is missing for
good. Three kinds of reports show it, the best one first:

- an error rate that the autopilot computes: ArduPilot's ESC.Err, of bidirectional DShot;
- a counter of errors: PX4's esc_errorcount, MAVLink's ESC_INFO.error_count. The errors of a window
  are compared with the reports in it;
- pauses of the ESC's own reports. Their number shows nothing: a logger that looks as often as an
  ESC reports skips up to half of sound frames, by phase (seen on a heavy quad).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap
from thrustmargin.gcs_plugin.telemetry.signals import Signals, by_index
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import SourceKind

WINDOW_S = 5.0
#: Steps between an ESC's reports, over its median step, from which the rest of a step is a pause.
PAUSE = 4.0


def lost_frames(
    signals: Signals, motors: MotorMap, speeds: Sequence[Signal | None]
) -> list[Signal | None]:
    """Return one signal for each motor: the share of telemetry frames lost, 0 to 1.

    `speeds` are the reported speeds of the motors' ESCs, at their own times. Error rates are used
    if any is above 0, else counters if any is; else pauses. Shares by counters and pauses are of
    windows of WINDOW_S. None for a motor whose ESC has no report of the kind used, or is reported
    too briefly.
    """
    rates = list(map(by_index(signals, "esc_error_rate").get, motors.escs))
    # Without bidirectional DShot the rate is logged as well, as 0 throughout.
    if any(one is not None and np.nan_to_num(one.values).any() for one in rates):
        return [None if one is None else one._replace(channel="esc_lost") for one in rates]
    counters = list(map(by_index(signals, "esc_errors").get, motors.escs))
    # A driver that counts none reports 0 throughout.
    if any(one is not None and np.nan_to_num(one.values).any() for one in counters):
        pairs = zip(speeds, counters, strict=True)
        return [None if one is None else _by_counter(one, errors) for one, errors in pairs]
    return [None if one is None else _by_pauses(one) for one in speeds]


def _by_counter(speed: Signal, errors: Signal | None) -> Signal | None:
    """Return the signal of the share of lost frames in each window: errors over errors and reports.

    Windows begin with the reports of `speed`. `errors` is a counter, whose fall is a restart and
    counts as 0. None without one, or with fewer than two windows' edges.
    """
    edges = _edges(speed.time_s)
    if errors is None or edges.size < 2:
        return None
    counter = np.nan_to_num(errors.values)
    steps = np.maximum(np.diff(counter, prepend=counter[:1]), 0.0)
    grown = np.histogram(errors.time_s, edges, weights=steps)[0]
    reports = np.histogram(speed.time_s, edges)[0]
    share = grown / np.maximum(grown + reports, 1.0)
    return _signal(errors, edges, share, speed.index)


def _by_pauses(speed: Signal) -> Signal | None:
    """Return the signal of the share of each window that pauses in the ESC's known speeds take.

    A pause is a step of more than PAUSE times the median step; its first median step is no loss.
    None with fewer than two windows' edges.
    """
    time_s = speed.time_s[np.isfinite(speed.values)]
    edges = _edges(time_s)
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if steps.size else 0.0
    if edges.size < 2 or not usual > 0.0:
        return None
    pauses = steps > PAUSE * usual
    # Of a pause all but one usual step is lost; its parts belong to the windows that it crosses.
    lost = np.zeros(edges.size - 1)
    for begin, end in zip(time_s[:-1][pauses] + usual, time_s[1:][pauses], strict=True):
        lost += np.clip(np.minimum(end, edges[1:]) - np.maximum(begin, edges[:-1]), 0.0, None)
    return _signal(speed, edges, lost / WINDOW_S, speed.index)


def _edges(time_s: Floats) -> Floats:
    """Return the edges, s, of windows of WINDOW_S from the first to the last of the times (n,).

    Fewer than two edges if the times do not fill a window.
    """
    return np.arange(time_s[0], time_s[-1], WINDOW_S) if time_s.size > 1 else np.empty(0)


def _signal(of: Signal, edges: Floats, share: Floats, index: int | str | None) -> Signal:
    """Return the signal of a share in each window, at the middle of it."""
    source = replace(of.source, kind=SourceKind.INFERRED)
    return Signal("esc_lost", source, edges[:-1] + WINDOW_S / 2.0, share, index)
