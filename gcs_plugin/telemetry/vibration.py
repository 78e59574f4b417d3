"""Measure how much each rotor shakes the body: the amplitude at the frequency at which it turns.

An unbalanced rotor pulls the motor round once per revolution. The rotor's own measured speed gives
the phase, phi_i = 2 pi / 60 * integral of N_i, so that rotors of different speed are separated and
a changing speed smears nothing. In windows of WINDOW_S the specific force is fitted by least
squares:

    f(t) = c_0 + c_1 t + sum_i a_i cos phi_i(t) + b_i sin phi_i(t)      per axis

The amplitude is sqrt(sum over axes of a_i² + b_i²), with the part that noise alone adds removed.
Rotors whose speeds differ by less than one turn a window cannot be separated: they are unknown.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.signals import Signals
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.statement import state

WINDOW_S = 2.0
#: Samples a revolution: with fewer, the once-per-revolution part is aliased.
LEAST_SAMPLES = 2.5
#: Variance of a coefficient over that of a well separated rotor, above which two rotors are too
#: close in speed to be separated.
SEPARATED = 4.0
SLOWEST_RPM = 300.0  # below which a rotor is at rest or idles


def vibration_per_rev(signals: Signals, speeds: Sequence[Signal | None]) -> list[Signal | None]:
    """Return for each rotor a signal of the vibration amplitude, m/s², at its own frequency.

    It has one value at the middle of each window of WINDOW_S in which it is known. `speeds` are the
    rotors' measured speeds, rpm. None for a rotor without a value, and for all if the accelerometer
    has fewer than LEAST_SAMPLES samples a revolution.
    """
    nothing: list[Signal | None] = [None] * len(speeds)
    force = _fastest([*signals.get("fast_force_frd", ()), *signals.get("specific_force_frd", ())])
    turning = [one for one in speeds if one is not None and one.time_s.size > 1]
    if force is None or not turning:
        return nothing
    time_s, values = force.time_s, force.values
    usual = max(map(_usual_rpm, turning))
    if not usual > 0.0 or _rate(force) < LEAST_SAMPLES * usual / 60.0:
        return nothing
    edges = np.arange(time_s[0], time_s[-1], WINDOW_S)
    bounds = np.searchsorted(time_s, np.append(edges, edges[-1] + WINDOW_S))
    middle = edges + WINDOW_S / 2.0
    found = np.full((edges.size, len(speeds)), np.nan)
    for window, (first, end) in enumerate(pairwise(bounds)):
        found[window] = _amplitudes(time_s[first:end], values[first:end], speeds)
    source = Provenance(
        kind=SourceKind.INFERRED, parts=(force.source,), remarks=(state("own frequency"),)
    )
    return [
        Signal("vibration_per_rev", source, middle[known], column[known])
        if (known := np.isfinite(column)).any()
        else None
        for column in found.T
    ]


def _rate(signal: Signal) -> float:
    """Return the median rate, Hz, of a signal's reports; 0 with fewer than two."""
    steps = np.diff(signal.time_s)
    steps = steps[steps > 0.0]
    return float(1.0 / np.median(steps)) if steps.size else 0.0


def _fastest(sources: Iterable[Signal]) -> Signal | None:
    """Return the source with the highest rate, with its finite samples only, in increasing time.

    `sources` have values (n, 3). None if there is no source.
    """
    one = max(sources, key=_rate, default=None)
    if one is None:
        return None
    known = np.isfinite(one.values).all(axis=1) & np.isfinite(one.time_s)
    known[1:] &= np.diff(one.time_s) > 0.0
    return one._replace(time_s=one.time_s[known], values=one.values[known])


def _usual_rpm(speed: Signal) -> float:
    """Return the median speed, rpm, of a rotor while it turns; 0 where it never does."""
    turning = speed.values[speed.values > SLOWEST_RPM]
    return float(np.median(turning)) if turning.size else 0.0


def _amplitudes(time_s: Floats, force: Floats, speeds: Sequence[Signal | None]) -> Floats:
    """Return the amplitudes (R,), m/s², in a window of specific force (n, 3), m/s², at times (n,).

    `speeds` are the R rotors' speeds, rpm, of the whole flight. NaN for a rotor that does not turn
    throughout, or is too close in speed to another.
    """
    found = np.full(len(speeds), np.nan)
    columns, rotors = [], []
    for rotor, speed in enumerate(speeds):
        if speed is None or time_s.size < 2:
            continue
        inside = (speed.time_s >= time_s[0]) & (speed.time_s <= time_s[-1])
        if inside.sum() < 3 or not speed.values[inside].min() > SLOWEST_RPM:
            continue
        turns = np.interp(time_s, speed.time_s, speed.values) / 60.0
        steps = 0.5 * (turns[1:] + turns[:-1]) * np.diff(time_s)
        phase = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(steps)])
        columns += [np.cos(phase), np.sin(phase)]
        rotors.append(rotor)
    unknowns = 2 + len(columns)
    if not rotors or time_s.size < 3 * unknowns:
        return found
    late = (time_s - time_s.mean()) / WINDOW_S
    design = np.column_stack([np.ones(time_s.size), late, *columns])
    # Two rotors of one speed make the matrix singular: the small term makes their variance large.
    inverse = np.linalg.inv(design.T @ design + 1e-6 * time_s.size * np.eye(unknowns))
    solved = inverse @ (design.T @ force)
    left = force - design @ solved
    noise = np.sum(left**2, axis=0) / (time_s.size - unknowns)  # of each axis
    variance = np.diag(inverse)
    for place, rotor in enumerate(rotors):
        pair = slice(2 + 2 * place, 4 + 2 * place)
        if variance[pair].max() * time_s.size / 2.0 > SEPARATED:
            continue
        square = np.sum(solved[pair] ** 2) - noise.sum() * variance[pair].sum()
        found[rotor] = np.sqrt(max(float(square), 0.0))
    return found
