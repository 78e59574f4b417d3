"""Turn streams of messages into signals of channels, and signals into values at given times.

The tables are those of `mavlink.decode`. Of the two ways of sampling, `linear` interpolates between
the reports on both sides, for recorded flights; `hold` takes the last report, as a live listener
must. With both, a value older than the channel's age limit becomes NaN.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import ESC_TELEMETRY_FIRST, MAVLINK_RULES, esc_silent
from thrustmargin.gcs_plugin.mavlink.rules import Columns, Rule, Signal, decode
from thrustmargin.gcs_plugin.wording.language import printable
from thrustmargin.mission.plan_check import parameter
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, Floats, TrackChannel
from thrustmargin.models.provenance import Meaning, Provenance, Reason, Rejected, SourceKind
from thrustmargin.models.statement import state

_HUD_AIRSPEED = Provenance(
    kind=SourceKind.MESSAGE, name="VFR_HUD", fields=("airspeed",), unit="m/s"
)

#: Rotor speeds, rpm, that on_vehicle/margin_inputs.lua sends where a link is slow.
_ESC_SPEED = re.compile(r"TM_RPM([1-9]\d?)")

OUTPUTS_OF_PORT = 16  # of SERVO_OUTPUT_RAW: the second has ArduPilot's 17 on, PX4's AUX outputs


class Stream(NamedTuple):
    """Messages of one type: `time_s` (n,), s of the vehicle's clock, and fields as columns (n,
    ...).

    Rows are in the order of the file; time may repeat or step back a little (reordering).
    """

    time_s: Floats
    columns: Columns


#: Channel -> its sources, preferred first.
Signals = Mapping[str, tuple[Signal, ...]]


def signals_by_channel(signals: Iterable[Signal]) -> Signals:
    """Group signals by channel, in the order given."""
    channels: dict[str, list[Signal]] = {}
    for signal in signals:
        channels.setdefault(signal.channel, []).append(signal)
    return {channel: tuple(found) for channel, found in channels.items()}


def best(signals: Signals, channel: str) -> Signal | None:
    """Return a channel's first source that covers 90 % or more of the time of the best one.

    None if no source has a finite value.
    """
    there = signals.get(channel, ())
    if not there:
        return None
    if len(there) == 1:
        return there[0] if known_rows(there[0].values).any() else None
    covered = [coverage(signal) for signal in there]
    most = max(covered)
    if most == 0:
        return None
    return next(s for s, seconds in zip(there, covered, strict=True) if seconds >= 0.9 * most)


def rejected_sources(there: Iterable[Signal], used: Signal) -> tuple[Rejected, ...]:
    """Return a channel's sources other than `used`, each with the reason why it is not used.

    `there` are all its sources, preferred first. The reason is that a source has no finite value,
    covers less time than `used`, or is less preferred.
    """
    rejected, before = [], True
    for signal in there:
        if signal is used:
            before = False
        elif not known_rows(signal.values).any():
            rejected.append(Rejected(signal.source, Reason.NO_NUMBERS))
        else:
            why = Reason.COVERS_LESS if before else Reason.LESS_PREFERRED
            rejected.append(Rejected(signal.source, why))
    return tuple(rejected)


def by_index(signals: Signals, channel: str) -> dict[int | str, Signal]:
    """Return the sources of one channel by their index: output number, battery id or name.

    Sources without an index are left out. Of several with one index the first with a value other
    than 0 is used. Those of a battery are joined, because BATTERY_STATUS_V2 replaces BATTERY_STATUS
    once a ground station requests it.
    """
    by_number: dict[int | str, Signal] = {}
    for signal in signals.get(channel, ()):
        if signal.index is None:
            continue
        first = by_number.setdefault(signal.index, signal)
        if first is not signal and channel.startswith("battery_"):
            by_number[signal.index] = _together(first, signal)
        elif first is not signal and not np.nan_to_num(first.values).any():
            by_number[signal.index] = signal
    return by_number


def _together(first: Signal, second: Signal) -> Signal:
    """Merge two sources of one quantity into one signal with the source of `second`.

    If one of them has no finite value, return the other.
    """
    for one, other in ((first, second), (second, first)):
        if not known_rows(other.values).any():
            return one
    time_s = np.concatenate([first.time_s, second.time_s])
    values = np.concatenate([first.values, second.values])
    time_s, values = in_time_order(time_s, values)
    return second._replace(time_s=time_s, values=values)


def mavlink_signals(streams: dict[str, Stream], airspeed: Provenance) -> Signals:
    """Return the signals of every MAVLink message in `streams`, by channel.

    `airspeed` is the source of VFR_HUD's airspeed. `streams` (message name -> Stream) is emptied in
    the process to limit memory.
    """
    signals = sorted(decoded(streams, airspeed), key=lambda item: item[0])
    return signals_by_channel(
        _used_outputs(s) if s.channel == "servo_us" else s for _, s in signals
    )


def decoded(streams: dict[str, Stream], airspeed: Provenance) -> Iterator[tuple[int, Signal]]:
    """Yield (rank, signal) for each source of a channel in `streams`; rank 0 is the best.

    `airspeed` is the source of VFR_HUD's airspeed. `streams` (message name -> Stream) is emptied.
    """
    while streams:
        message, stream = streams.popitem()
        times = stream.time_s
        put = Signal if (times[1:] >= times[:-1]).all() else ordered_signal
        for rank, rule, source in _ranked(message):
            if message == "VFR_HUD" and rule.channel == "airspeed":
                source = airspeed
            for index, rows, values in decode(rule, stream.columns):
                time_s = times if index is None else times[rows]
                if rule.channel == "named_value":
                    yield from ((rank, signal) for signal in _by_name(stream, values))
                elif rule.channel.startswith("esc_"):
                    if rule.channel == "esc_rpm" and message in ESC_TELEMETRY_FIRST:
                        values = np.where(esc_silent(stream.columns), np.nan, values)
                    first = ESC_TELEMETRY_FIRST.get(message, index or 0)
                    for k in range(values.shape[1]):
                        yield rank, put(rule.channel, source, time_s, values[:, k], first + k)
                else:
                    of_one = source if rule.channel == "servo_us" else source.of_instance(index)
                    yield rank, put(rule.channel, of_one, time_s, values, index)


@cache
def _ranked(message: str) -> tuple[tuple[int, Rule, Provenance], ...]:
    """Return rank in the table, rule and source of each rule for a message, preferred first."""
    ranked = ((n, rule) for n, rule in enumerate(MAVLINK_RULES) if rule.message == message)
    return tuple((n, rule, rule.source) for n, rule in ranked)


class _Times:
    """A cache of the time arrays that several signals of one vehicle share.

    Keys are the ids of the input arrays, which the cache keeps alive.
    """

    def __init__(self, after_s: float, since: float) -> None:
        self._after_s, self.since = after_s, since
        self._made: dict[tuple[int, ...], tuple[Any, ...]] = {}

    def later(self, time_s: Floats) -> tuple[int, Floats]:
        """Return the first row later than `after_s`, and the times from that row on."""
        key = (id(time_s),)
        if key not in self._made:
            row = int(time_s.searchsorted(self._after_s, side="right"))
            self._made[key] = row, time_s[row:] if row else time_s, time_s
        return self._made[key][:2]

    def after(self, old: Floats, new: Floats) -> Floats:
        """Return `old` and `new` concatenated."""
        key = id(old), id(new)
        if key not in self._made:
            self._made[key] = np.concatenate([old, new]), old, new
        return self._made[key][0]

    def shortened(self, time_s: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Return times (n,), s, and values (n, ...) without the rows before `since`, s.

        Of the rows before `since` only the last one with a finite value is kept.
        """
        first = int(time_s.searchsorted(self.since))
        known = np.flatnonzero(known_rows(values[:first]))
        last = int(known[-1]) if known.size else first
        rows = np.concatenate([known[-1:], np.arange(first, time_s.size)])
        key = id(time_s), first, last
        if key not in self._made:
            self._made[key] = time_s[rows], time_s
        return self._made[key][0], values[rows]


class SignalBuffer:
    """The recent signals of one vehicle: from `seconds` before its newest reports, and the last
    known before.

    `heard` are the names of the messages received. Signals of one message share one array of times.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._kept: dict[tuple[int, int | str], Signal] = {}
        self._order: list[tuple[int, int | str]] = []  # of all that are kept, preferred first
        self.heard: set[str] = set()

    def add(self, streams: dict[str, Stream], airspeed: Provenance, after_s: float) -> None:
        """Append to the signals the reports later than `after_s`, s of the vehicle's clock.

        `streams` (message name -> Stream) is emptied. `airspeed` is the source of VFR_HUD's
        airspeed. Reports more than `seconds` before `after_s` may be dropped, except each signal's
        last known one.
        """
        self.heard |= set(streams)
        times = _Times(after_s, after_s - self._seconds)
        for rank, new in decoded(streams, airspeed):
            later, time_s = times.later(new.time_s)
            values = new.values[later:] if later else new.values
            key = (rank, -1 if new.index is None else new.index)
            old = self._kept.get(key)
            if old is not None:
                time_s = times.after(old.time_s, time_s)
                values = np.concatenate([old.values, values])
            # In large steps, so that most rounds copy nothing twice.
            if time_s.size > 2 and time_s[1] <= times.since - self._seconds:
                time_s, values = times.shortened(time_s, values)
            source = new.source if old is None else old.source
            self._kept[key] = Signal(new.channel, source, time_s, values, new.index)
            if old is None:
                self._order = sorted(
                    [*self._order, key], key=lambda k: (k[0], isinstance(k[1], str), k[1])
                )

    @property
    def signals(self) -> Signals:
        """Return all signals in the buffer, preferred sources first."""
        return signals_by_channel(self._kept[key] for key in self._order)


def _used_outputs(servos: Signal) -> Signal:
    """Drop the servo outputs after the last one that ever has a pulse: most of the 16 never do."""
    used = np.flatnonzero(np.any(servos.values > 0, axis=0))
    last = int(used[-1]) + 1 if used.size else 1
    return servos._replace(values=servos.values[:, :last].copy())


def output_pulses(signals: Signals, output: int) -> Signal | None:
    """Return the pulses (n,) of one servo output, counted from 0 through all ports.

    None if the output was not received.
    """
    for servos in signals.get("servo_us", ()):
        column = output - OUTPUTS_OF_PORT * int(servos.index or 0)
        if 0 <= column < servos.values.shape[1]:
            return servos._replace(values=servos.values[:, column], index=None)
    return None


def _by_name(stream: Stream, values: Floats) -> list[Signal]:
    names = stream.columns["name"]
    signals = []
    for raw in np.unique(names):
        rows = names == raw
        name = printable(raw)
        source = Provenance(kind=SourceKind.MESSAGE, name="NAMED_VALUE_FLOAT", fields=(name,))
        of_esc = _ESC_SPEED.fullmatch(name)
        channel, index = ("esc_rpm", int(of_esc[1]) - 1) if of_esc else ("named_value", name)
        signals.append(ordered_signal(channel, source, stream.time_s[rows], values[rows], index))
    return signals


def ordered_signal(
    channel: str, source: Provenance, time_s: Floats, values: Floats, index: int | str | None = None
) -> Signal:
    """Return the signal of reports in any order of time, sorted by time."""
    return Signal(channel, source, *in_time_order(time_s, values), index)


def airspeed_sources(signals: Signals, sampling: Sampling) -> Iterator[Signal]:
    """Yield the airspeed's sources, m/s, preferred first: reported airspeeds, then velocity - wind.

    The latter is left out if a reported one covers as much of a recorded flight (`sampling`
    "linear"). Without a wind it is the speed over ground. An airspeed of 0 is no airspeed, as PX4
    sends it without a sensor: in a recorded flight if it is 0 throughout, for a listener ("hold")
    in each report. A wind of 0 throughout is no wind estimate.
    """
    own, live = signals.get("airspeed", ()), sampling == "hold"
    for signal in own if live else ():
        none = signal.values == 0.0
        yield (
            signal._replace(values=np.where(none, np.nan, signal.values)) if none.any() else signal
        )
    own = tuple(s for s in own if np.any(s.values > 0.0))
    yield from () if live else own
    velocity, known = best(signals, "velocity_ned"), best({"airspeed": own}, "airspeed")
    if velocity is None:
        return
    if not live and known and coverage(known) >= 0.9 * coverage(velocity):
        return
    source, wind = velocity.source, best(signals, "wind_ned")
    through_air = velocity.values
    if wind is None or not np.nansum(np.abs(wind.values)):
        source = replace(source, meaning=Meaning.GROUND_SPEED)
    else:
        source = source.remarked(state("less wind", wind=wind.source.name))
        blown = last_before(wind, velocity.time_s)
        through_air = through_air - np.where(np.isfinite(blown), blown, 0.0)
    yield Signal("airspeed", source, velocity.time_s, np.linalg.norm(through_air, axis=1))


def pitot_present(streams: Mapping[str, Stream], parameters: Mapping[str, float]) -> bool | None:
    """Return True if the vehicle reports that it has an airspeed sensor, False if it reports none.

    By ARSPD_TYPE, else by SYS_STATUS; None if it reports neither.
    """
    kind = parameter(parameters, "ARSPD_TYPE")
    if np.isfinite(kind):
        return kind > 0
    status = streams.get("SYS_STATUS")
    if status is None or status.time_s.size == 0:
        return None
    # Bit 4 of MAV_SYS_STATUS_SENSOR: differential pressure.
    return bool(np.any(status.columns["onboard_control_sensors_enabled"] & 16))


def hud_airspeed(autopilot: str, pitot: bool | None) -> Provenance:
    """Return the source of VFR_HUD's airspeed, with a remark on what that is.

    The meaning depends on the `autopilot`, by name, and on a `pitot`, None if unknown.
    """
    if autopilot == "PX4":
        remark = "calibrated airspeed"
    elif pitot:
        remark = "pitot"
    elif pitot is None:
        remark = "pitot or estimate"
    else:
        remark = "estimate without pitot"
    return _HUD_AIRSPEED.remarked(state(remark))


Sampling = Literal["linear", "hold"]

#: Rows closer than this to the one before are thinned out: at most 10 Hz, with room for jitter.
ROW_SPACING = 0.09
GRID = 0.1  # s between rows when no report triggers them
_BLOCK = 1 << 14


def within(channel: str, values: Floats) -> bool:
    """Return True if there are values and all are in the channel's range."""
    limit = TRACK_CHANNELS[channel]
    return bool(
        values.size
        and np.minimum.reduce(values, axis=None) >= limit.low
        and np.maximum.reduce(values, axis=None) <= limit.high
    )


def plausible(channel: str, values: Floats) -> Floats:
    """Return the values, with NaN for those out of the channel's range or not finite."""
    limit = TRACK_CHANNELS[channel]
    good = (values >= limit.low) & (values <= limit.high)
    return values if good.all() else np.where(good, values, np.nan)


def all_true(flags: Bools) -> bool:
    """Return True if all flags are True; five times as fast as `all` for few flags."""
    return int(np.count_nonzero(flags)) == flags.size


def known_rows(values: Floats) -> Bools:
    """Flag the rows (n,) in which every column is finite."""
    finite = np.isfinite(values)
    # Along the rows numpy is ten times as quick as along a row's few columns.
    return finite if values.ndim == 1 else np.logical_and.reduce(finite.T.copy())


def sample(channel: str, signal: Signal, time_s: Floats, sampling: Sampling) -> Floats:
    """Return the channel's signal at the times `time_s` (T,), as (T,) or (T, k).

    NaN where no report is within the channel's age limit. "linear" interpolates, after averaging
    fast reports; "hold" takes the last report.
    """
    when, values = _reports(channel, signal)
    if when.size == 0:
        return np.full((time_s.size, *values.shape[1:]), np.nan)
    averaged = sampling == "linear" and TRACK_CHANNELS[channel].averaged and when.size > 4
    if averaged and np.median(np.diff(when)) < GRID / 2:
        when, values = _averaged(when, values)
    if time_s.size <= _BLOCK:
        return _interpolate(TRACK_CHANNELS[channel], when, values, time_s, sampling)
    # In blocks: the steps between take several times the memory of the result.
    result = np.empty((time_s.size, *values.shape[1:]))
    for low in range(0, time_s.size, _BLOCK):
        rows = slice(low, low + _BLOCK)
        result[rows] = _interpolate(TRACK_CHANNELS[channel], when, values, time_s[rows], sampling)
    return result


def _reports(channel: str, signal: Signal) -> tuple[Floats, Floats]:
    """Return times (n,) and values (n,) or (n, k) of the signal's reports in the channel's range.

    Of several at one time the last is returned.
    """
    limit, values, time_s = TRACK_CHANNELS[channel], signal.values, signal.time_s
    if within(channel, values) and all_true(time_s[1:] > time_s[:-1]):
        return time_s, values
    keep = (values >= limit.low) & (values <= limit.high)
    keep = keep if keep.ndim == 1 else np.logical_and.reduce(keep, axis=1)
    if time_s.size:
        keep[:-1] &= (time_s[1:] > time_s[:-1]) | ~keep[1:]
    return (time_s, values) if keep.all() else (time_s[keep], values[keep])


def _averaged(when: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return means of times `when` (n,) and `values` (n,) or (n, k) over each GRID s.

    So vibration faster than the rows is not aliased.
    """
    bins = np.floor(when / GRID)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(bins)) + 1])
    counts = np.diff(edges, append=when.size).astype(np.float64)
    sums = np.add.reduceat(values, edges, axis=0)
    return np.add.reduceat(when, edges) / counts, sums / _shaped(counts, values)


def _interpolate(
    limit: TrackChannel, when: Floats, values: Floats, time_s: Floats, sampling: Sampling
) -> Floats:
    after = when.searchsorted(time_s, side="right")
    previous = np.maximum(after - 1, 0)
    before, earlier = values.take(previous, axis=0), when.take(previous)
    fresh = (after > 0) & (time_s - earlier <= limit.max_age)
    if sampling == "hold" or limit.kind == "state":
        return _masked(before, fresh)
    right = np.minimum(after, when.size - 1)
    later = when.take(right)
    near = (after < when.size) & (later - time_s <= limit.max_age)
    # With a report on one side only (the ends, or a pause) that one is held.
    share = (time_s - earlier) / np.where(fresh & near, later - earlier, np.inf)
    share[near & ~fresh] = 1.0
    step = values.take(right, axis=0) - before
    if limit.kind == "angle":
        interpolated = _wrapped(before + _shaped(share, values) * _wrapped(step))
    else:
        interpolated = before + _shaped(share, values) * step
    return _masked(interpolated, fresh | near)


def _wrapped(angle: Floats) -> Floats:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _shaped(rows: NDArray[Any], like: Floats) -> NDArray[Any]:
    """Return (n,) as (n, 1) if `like` has columns."""
    return rows[:, None] if like.ndim == 2 else rows


def _masked(values: Floats, keep: Bools) -> Floats:
    return values if all_true(keep) else np.where(_shaped(keep, values), values, np.nan)


def first_known(
    channel: str, sources: Iterable[Signal], time_s: Floats
) -> tuple[Floats | None, list[Signal]]:
    """Return a channel's values at `time_s` (T,) as a live listener has them, and the sources used.

    Each row has the value of the first source, in the order given, with a recent report, NaN
    without. The values are (T,) or (T, k), None without any source.
    """
    values, used = None, []
    for signal in sources:
        sampled = sample(channel, signal, time_s, "hold")
        if values is None:
            values, used = sampled, [signal]
        else:
            missing = ~known_rows(values)
            if np.any(known_rows(sampled) & missing):
                values = np.where(_shaped(missing, values), sampled, values)
                used.append(signal)
        if all_true(np.isfinite(values)):
            break
    return values, used


def last_before(signal: Signal, time_s: Floats) -> Floats:
    """Return the last known report at each of the times `time_s` (T,), however old.

    The result is (T,) or (T, k), NaN before the first report.
    """
    values, when = signal.values, signal.time_s
    keep = known_rows(values)
    if not all_true(keep):
        values, when = values[keep], when[keep]
    if when.size == 0:
        return np.full((time_s.size, *values.shape[1:]), np.nan)
    last = when.searchsorted(time_s, side="right") - 1
    return _masked(values[np.maximum(last, 0)], last >= 0)


def thinned(time_s: Floats, after_s: float = -np.inf) -> Floats:
    """Drop times (n,), s, so that the others are ROW_SPACING or more apart; the first one stays.

    The first is at least ROW_SPACING after `after_s`, the last row so far. NaN are dropped.
    """
    time_s = increasing(time_s[np.isfinite(time_s)])
    time_s = time_s[np.searchsorted(time_s, after_s + ROW_SPACING) :]
    if np.all(np.diff(time_s) >= ROW_SPACING):
        return time_s
    kept = []
    row = 0
    while row < time_s.size:
        kept.append(row)
        row = max(int(np.searchsorted(time_s, time_s[row] + ROW_SPACING)), row + 1)
    return time_s[np.array(kept)]


def increasing(values: Floats) -> Floats:
    """Return the sorted distinct `values` (n,), as `np.unique`, but faster if already sorted."""
    if all_true(values[1:] > values[:-1]):
        return values
    step = np.diff(values)
    if not (step >= 0.0).all():
        return np.unique(values)
    return values[np.append(True, step > 0.0)]


def coverage(signal: Signal) -> int:
    """Return the number of whole seconds with a finite value of the signal."""
    return increasing(np.floor(signal.time_s[known_rows(signal.values)])).size


def in_time_order(time_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return times and values sorted by time, infinite values as NaN."""
    if np.isinf(values).any():
        values = np.where(np.isinf(values), np.nan, values)
    if time_s.size < 2 or np.all(time_s[1:] >= time_s[:-1]):
        return time_s, values
    order = np.argsort(time_s, kind="stable")
    return time_s[order], values[order]
