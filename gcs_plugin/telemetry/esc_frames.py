"""Compute the share of its telemetry frames that each ESC loses, for logs and live links alike.

A loose signal or telemetry plug, or a desync, shows as lost frames before the speed is missing for
good. Three kinds of reports show it, the best one first:

- an error rate that the autopilot computes: ArduPilot's ESC.Err, of bidirectional DShot;
- a counter of errors: PX4's esc_errorcount, MAVLink's ESC_INFO.error_count. The errors of a window
  are compared with the reports in it;
- pauses of the ESC's own reports. Their number shows nothing: a logger that looks as often as an
  ESC reports skips up to half of sound frames, by phase (seen on a heavy quad).

A window ends at each full second of the vehicle's clock and uses nothing later, so that a link's
shares are those of a recording of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap
from thrustmargin.gcs_plugin.telemetry.signals import Signals, by_index
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import SourceKind

WINDOW_S, STEP_S = 5.0, 1.0
#: s before the end of a window in which the usual step between an ESC's reports is measured: as
#: long as the reports of a link are kept.
USUAL_S = 7.0
#: Share of the steps that do not exceed the usual one: a logger that looks now and then makes short
#: and long steps in turn (10 and 90 ms on a heavy quad).
USUAL_SHARE = 0.75
#: Steps between an ESC's reports, over its usual step, from which the rest of a step is a pause.
PAUSE = 4.0


def lost_frames(
    signals: Signals,
    motors: MotorMap,
    speeds: Sequence[Signal | None],
    *,
    heard_s: float = -math.inf,
    usual_s: Sequence[float] = (),
) -> tuple[list[Signal | None], tuple[float, ...]]:
    """Return one signal a motor, the share of frames lost, 0 to 1, and the usual step, s, between
    the reports of each motor's ESC.

    Shares by counters and pauses are of windows of WINDOW_S. `speeds` are the reported speeds of
    the motors' ESCs, at their own times. None for a motor whose ESC reports no speed. Of a link
    `heard_s` is the vehicle's clock up to which rows were made, and `usual_s` are the steps that
    the call before returned: an ESC that pauses for longer than USUAL_S has no others.
    """
    # Of other motors than before nothing is known.
    known = tuple(usual_s) if len(usual_s) == len(speeds) else (math.nan,) * len(speeds)
    rates = list(map(by_index(signals, "esc_error_rate").get, motors.escs))
    # Without bidirectional DShot the rate is logged as well, as 0 throughout.
    if any(one is not None and np.nan_to_num(one.values).any() for one in rates):
        return [None if one is None else one._replace(channel="esc_lost") for one in rates], known
    counters = list(map(by_index(signals, "esc_errors").get, motors.escs))
    times = [np.empty(0) if one is None else one.time_s[np.isfinite(one.values)] for one in speeds]
    end_s = max((float(one[-1]) for one in times if one.size), default=-math.inf)
    found: list[Signal | None] = []
    steps: list[float] = []
    for speed, time_s, errors, usual in zip(speeds, times, counters, known, strict=True):
        first_s = max(float(time_s[0]) + WINDOW_S, heard_s - STEP_S) if time_s.size else math.inf
        edges = (
            STEP_S * np.arange(math.ceil(first_s / STEP_S), math.floor(end_s / STEP_S) + 1.0)
            if first_s <= end_s
            else np.empty(0)
        )
        share = np.empty(edges.size)
        for k, edge in enumerate(edges):
            share[k], usual = _paused(time_s, float(edge), usual)
        steps.append(usual)
        if speed is None or not edges.size:
            found.append(None)
            continue
        if errors is not None:
            # A driver that counts none reports 0 throughout.
            counts = np.any(
                [_last(one, edges) > 0.0 for one in counters if one is not None], axis=0
            )
            share = np.where(counts, _counted(errors, time_s, edges), share)
        source = replace((speed if errors is None else errors).source, kind=SourceKind.INFERRED)
        found.append(Signal("esc_lost", source, edges, share, speed.index))
    return found, tuple(steps)


def _paused(time_s: Floats, end_s: float, usual: float) -> tuple[float, float]:
    """Return the share of the window up to `end_s` that is spent in pauses of reports at `time_s`
    (n,), s, and the usual step, s, between them; `usual` is that before.

    Of a pause all but one usual step is lost. A pause that lasts counts up to `end_s`.
    """
    begin_s = end_s - WINDOW_S
    since, end = np.searchsorted(time_s, [end_s - USUAL_S, end_s], side="right")
    since = max(int(since) - 1, 0)
    steps = np.diff(time_s[since:end])
    if steps.size > 1:
        usual = float(np.quantile(steps, USUAL_SHARE))
    if not usual > 0.0:
        return math.nan, usual
    reports = np.append(time_s[since:end], end_s)
    paused = np.flatnonzero(np.diff(reports) > PAUSE * usual)
    begins = np.maximum(reports[paused] + usual, begin_s)
    return float(np.maximum(reports[paused + 1] - begins, 0.0).sum()) / WINDOW_S, usual


def _last(signal: Signal, edges: Floats) -> Floats:
    """Return the last report of a counter at each of `edges` (E,), s; 0 before the first."""
    place = np.searchsorted(signal.time_s, edges, side="right")
    return np.append(0.0, np.nan_to_num(signal.values))[place]


def _counted(errors: Signal, time_s: Floats, edges: Floats) -> Floats:
    """Return the errors over errors and reports, at `time_s`, of the windows that end at `edges`
    (E,); a counter that falls restarted."""
    counter = np.nan_to_num(errors.values)
    total = np.append(0.0, np.cumsum(np.maximum(np.diff(counter, prepend=counter[:1]), 0.0)))
    grown, reports = (
        of[np.searchsorted(at, edges, side="right")]
        - of[np.searchsorted(at, edges - WINDOW_S, side="right")]
        for at, of in ((errors.time_s, total), (time_s, np.arange(time_s.size + 1.0)))
    )
    return grown / np.maximum(grown + reports, 1.0)
