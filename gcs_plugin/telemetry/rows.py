"""Build the rows of a flight, and every channel on them, for logs and for live links alike.

Positions are in metres from `PlaceOfZero`: home as at take-off, else the estimator's origin, else
the first fix.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.airborne import GroundContact, airborne, airborne_so_far
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import (
    PumpedSoFar,
    TankContext,
    first_level,
    power,
    pump_share,
    pumped,
    spraying_sources,
    tank_levels,
)
from thrustmargin.gcs_plugin.telemetry.esc_frames import lost_frames
from thrustmargin.gcs_plugin.telemetry.motors import (
    MotorMap,
    RotorMemory,
    lifting,
    measured_speeds,
    rejected_readings,
    stopped_in_flight,
)
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import NOTHING_SENT, Span
from thrustmargin.gcs_plugin.telemetry.signals import (
    Sampling,
    Signals,
    airspeed_sources,
    best,
    first_known,
    increasing,
    known_rows,
    last_before,
    plausible,
    rejected_sources,
    sample,
    thinned,
    within,
)
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options, stated_channels
from thrustmargin.gcs_plugin.telemetry.vibration import vibration_per_rev
from thrustmargin.models.checks.held import HeldSoFar
from thrustmargin.models.flight import (
    TRACK_CHANNELS,
    Bools,
    FlightTrack,
    Floats,
    FlyingBy,
    Origin,
    known_date,
)
from thrustmargin.models.provenance import Provenance, Rejected
from thrustmargin.models.statement import Statement, state

SILENT = 2.0  # s without reports after which the next kind of report triggers the rows
#: Channels of each motor's ESC besides its speed.
ESC_CHANNELS = ("esc_voltage", "esc_current", "esc_temperature", "motor_temperature")
KEPT = 8.0  # s of reports that rows may need: the longest age limit, and the falling tank's window


@dataclass(frozen=True, slots=True, kw_only=True)
class RowState:
    """The state of one vehicle's rows that later batches need and the buffered signals no longer
    contain.
    """

    heard_s: float = -np.inf  # vehicle's clock up to which reports have made their rows
    start_s: float | None = None  # of the first row
    row_s: float = -np.inf  # of the last row
    contact: GroundContact = field(default_factory=GroundContact)
    held: HeldSoFar = field(default_factory=HeldSoFar)
    rotors: tuple[RotorMemory, ...] = ()
    sent: Span = NOTHING_SENT  # to the motors: which protocol it is may show on the ground alone
    zero: PlaceOfZero | None = None
    pumped: PumpedSoFar | None = None
    esc_steps_s: tuple[float, ...] = ()  # usual s between the reports of each motor's ESC


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightRows:
    """Every channel on T rows, and the state for the next batch."""

    track: FlightTrack
    clock_s: Floats  # (T,) vehicle's clock
    motors: MotorMap
    reported: Mapping[str, list[Signal]]
    unmeasured: tuple[Statement, ...]  # of the notes, those on readings that are no measurement
    pump_share: Floats  # (T,) 0 off to 1 full, as last reported
    pumped_kg: Floats  # (T,) by the pump's output since it was first heard
    row_state: RowState


def flight_rows(
    signals: Signals,
    motors: MotorMap,
    parameters: Mapping[str, float],
    options: Options,
    row_state: RowState | None = None,
    *,
    name: str = "",
    unix_minus_clock: float | None = None,
    notes: Iterable[Statement] = (),
) -> FlightRows | None:
    """Resample every channel of the signals to common rows; return None if there are no rows.

    Time counts from the flight's first row; `unix_minus_clock`, s, plus the vehicle's clock is Unix
    time. `name` and `notes` go into the track. With sampling "hold" no row depends on a later
    report, and with the `row_state` of the last batch the rows of consecutive batches equal those
    of the whole flight, if `signals` includes the last KEPT seconds before a batch. Raise LogError
    if the tank source named in the options is absent.
    """
    live = options.sampling == "hold"
    before = RowState() if row_state is None else row_state
    speeds_of_escs = motors.rotor_speed(signals)
    clock_s = row_times(signals, speeds_of_escs, before, options.sampling)
    if clock_s.size == 0:
        return None
    start_s = float(clock_s[0]) if before.start_s is None else before.start_s
    notes = list(notes)
    channels: dict[str, Floats] = {}
    sources: dict[str, Provenance] = {}
    reported: dict[str, list[Signal]] = {}

    def put(channel: str, candidates: Iterable[Signal]) -> None:
        if live:
            values, used = first_known(channel, candidates, clock_s)
            rejected: tuple[Rejected, ...] = ()
        else:
            there = tuple(candidates)
            signal = best({channel: there}, channel)
            used = [] if signal is None else [signal]
            values = None if signal is None else sample(channel, signal, clock_s, "linear")
            rejected = () if signal is None else rejected_sources(there, signal)
        if values is not None:
            channels[channel], reported[channel] = values, used
            source = used[0].source
            sources[channel] = replace(source, rejected=rejected) if rejected else source

    for channel, column in TRACK_CHANNELS.items():
        if column.direct:
            if channel == "airspeed":
                put(channel, airspeed_sources(signals, options.sampling))
            else:
                put(channel, signals.get(channel, ()))
    for channel, candidates in power(signals, options.sampling, notes).items():
        put(channel, candidates)
    context = TankContext(
        airframe=options.airframe,
        parameters=parameters,
        start_kg=options.tank_start_kg,
        pump_output=motors.pump_output,
        pumped=before.pumped,
    )
    stated = options.load is not None
    levels = iter(()) if stated else tank_levels(signals, context, options.tank)
    tank = first_level(levels)
    notes += tank.notes
    if tank.signal is not None:
        others = (level.signal for level in levels if level.signal is not None)
        put("tank_kg", chain((tank.signal,), others if live else ()))
    share = pump_share(signals, context)
    spraying = spraying_sources(share, tank.signal, options.sampling, notes)
    put("spraying", spraying if live else spraying[:1])

    outputs = motors.throttle(signals, parameters, before.sent)
    measured = measured_speeds(
        speeds_of_escs,
        outputs,
        options.airframe,
        look_ahead=not live,
        heard_s=before.heard_s,
        memory=before.rotors,
    )
    for channel, found in (("rotor_speed_rpm", measured.signals), ("throttle", outputs)):
        channels[channel] = _columns(channel, found, clock_s, options.sampling)
        reported[channel] = [signal for signal in found if signal is not None]
    for channel in ESC_CHANNELS:
        found = motors.esc_readings(signals, channel)
        if any(found):
            channels[channel] = _columns(channel, found, clock_s, options.sampling)
            reported[channel] = [signal for signal in found if signal is not None]
            sources[channel] = motors.esc_source(found)
    shaken = [] if live else vibration_per_rev(signals, measured.signals)
    if found := [signal for signal in shaken if signal is not None]:
        channels["vibration_per_rev"] = _columns("vibration_per_rev", shaken, clock_s, "linear")
        reported["vibration_per_rev"], sources["vibration_per_rev"] = found, found[0].source
    lost, usual_s = lost_frames(
        signals, motors, speeds_of_escs, heard_s=before.heard_s, usual_s=before.esc_steps_s
    )
    if found := [signal for signal in lost if signal is not None]:
        channels["esc_lost"] = _columns("esc_lost", lost, clock_s, options.sampling)
        reported["esc_lost"], sources["esc_lost"] = found, found[0].source
    for channel in ("vibration", "clipping"):
        put(channel, signals.get(channel, ()))
    if reported["rotor_speed_rpm"]:
        sources["rotor_speed_rpm"] = motors.esc_source(measured.signals)
    if reported["throttle"]:
        sources["throttle"] = motors.throttle_source(outputs, signals, parameters, before.sent)
    contact, held_so_far, flying_by = before.contact, before.held, FlyingBy.GIVEN
    if live:
        flying, flying_source, contact, held_so_far = airborne_so_far(
            signals, clock_s, channels, options.airframe, contact, held_so_far
        )
    else:
        off = airborne(signals, clock_s, channels, options.airframe)
        flying, flying_by, flying_source = off.flying, off.by, off.source
    if motors.facts.kind == "quadplane":
        flying &= lifting(channels["rotor_speed_rpm"], channels["throttle"])
        flying_source = flying_source.remarked(state("hover motors driven"))
    sources["flying"] = flying_source
    speeds = channels["rotor_speed_rpm"]
    hidden = stopped_in_flight(speeds, channels["throttle"], flying)
    channels["rotor_speed_rpm"] = np.where(hidden, np.nan, speeds)
    unmeasured = rejected_readings(
        measured, channels["rotor_speed_rpm"], hidden, clock_s, flying, counted=not live
    )
    zero = place_of_zero(signals, clock_s, flying, before.zero)
    put("position_ned", position_sources(signals, zero))
    nothing = np.full(clock_s.size, np.nan)
    total = None if share is None else pumped(share, context)
    pumped_kg = nothing if total is None else last_before(total, clock_s)
    errors: dict[str, Floats] = {}
    for channel, values, source, error in stated_channels(
        options,
        time_s=clock_s,
        flying=flying,
        spraying=channels.get("spraying", nothing),
        pumped_kg=pumped_kg,
    ):
        channels[channel], sources[channel] = values, source
        reported[channel] = [Signal(channel, source, clock_s, values)]
        if error is not None:
            errors[channel] = error
    track = FlightTrack.of(
        name=name,
        time_s=clock_s - start_s,
        rotor_count=motors.rotor_count,
        start_unix_s=known_date(None if unix_minus_clock is None else unix_minus_clock + start_s),
        flying=flying,
        flying_by=flying_by,
        origin=None if zero is None else zero.origin,
        sources=sources,
        standard_errors=errors,
        notes=(*notes, *unmeasured),
        **channels,
    )
    return FlightRows(
        track=track,
        clock_s=clock_s,
        motors=motors,
        reported=reported,
        unmeasured=unmeasured,
        pump_share=nothing if share is None else last_before(share, clock_s),
        pumped_kg=pumped_kg,
        row_state=RowState(
            start_s=start_s,
            row_s=float(clock_s[-1]),
            contact=contact,
            held=held_so_far,
            rotors=measured.memory,
            sent=motors.span(signals, before.sent),
            esc_steps_s=usual_s,
            zero=zero,
            pumped=before.pumped
            if share is None or total is None
            else PumpedSoFar(
                time_s=float(total.time_s[-1]),
                share=float(np.nan_to_num(share.values[-1])),
                kg=float(total.values[-1]),
            ),
        ),
    )


def row_times(
    signals: Signals, rotors: Sequence[Signal | None], row_state: RowState, sampling: Sampling
) -> Floats:
    """Return the times (T,) of the rows, s of the vehicle's clock: the reports of a trigger signal.

    They are thinned to at most 10 Hz and later than `row_state.heard_s`. `rotors` are the speeds,
    one signal a rotor. The trigger is the speed of rotor 1; after SILENT s without one, that of the
    next rotor; then attitude; then any report of the flight. A recorded flight (sampling "linear")
    prefers the rotor with most reports, and begins with the first speed, or at arming if that was
    long before.
    """
    reported = [s for s in rotors if s is not None]
    if sampling == "hold" and reported:
        first = increasing(_known_times(reported[:1]))
        if _covers(first, row_state.heard_s, signals):
            return thinned(first[first > row_state.heard_s], row_state.row_s)
    speeds = [increasing(_known_times([s])) for s in reported]
    if sampling == "linear":
        speeds.sort(key=lambda times: -times.size)
    direct = [name for name, column in TRACK_CHANNELS.items() if column.direct]
    others = (*direct, "geodetic", "named_value", "battery_percent", "fuel_remaining")
    triggers = [
        *speeds,
        _known_times(signals.get("attitude", ())),
        _known_times(s for name in others for s in signals.get(name, ())),
    ]
    rows = np.empty(0)
    for times in triggers:
        rows = increasing(np.concatenate([rows, times[_silent(rows, times)]]))
    if sampling == "linear" and speeds:
        rows = rows[rows >= _first_row(float(speeds[0][0]), signals)]
    return thinned(rows[rows > row_state.heard_s], row_state.row_s)


def _first_row(spoke_s: float, signals: Signals) -> float:
    """Return the start, s, of a recorded flight: the first rotor speed, `spoke_s`, or arming.

    Arming counts if it was more than SILENT s before.
    """
    armed = best(signals, "armed")
    on_s = np.empty(0) if armed is None else armed.time_s[armed.values > 0]
    return float(on_s[0]) if on_s.size and spoke_s - on_s[0] > SILENT else spoke_s


def _known_times(signals: Iterable[Signal]) -> Floats:
    """Concatenate the times of all finite reports of the signals."""
    times = [s.time_s[known_rows(s.values) & np.isfinite(s.time_s)] for s in signals]
    return np.concatenate(times) if times else np.empty(0)


def _covers(triggers: Floats, since_s: float, signals: Signals) -> bool:
    """Return True if the trigger times (n,), s, never pause for more than SILENT s after `since_s`.

    The pause up to the newest report of any signal counts too. False if the first trigger is later
    than `since_s`.
    """
    first = int(np.searchsorted(triggers, since_s, side="right")) - 1
    newest = max(
        float(s.time_s[-1])
        for channel_signals in signals.values()
        for s in channel_signals
        if s.time_s.size
    )
    return first >= 0 and bool(np.all(np.diff(triggers[first:], append=newest) <= SILENT))


def _silent(triggers: Floats, time_s: Floats) -> Bools:
    """Flag the times `time_s` (n,) without a trigger in the SILENT s before or at them.

    `triggers` (m,) ascend; all on the vehicle's clock, s.
    """
    if triggers.size == 0:
        return np.ones(time_s.size, dtype=np.bool_)
    last = np.searchsorted(triggers, time_s, side="right") - 1
    return (last < 0) | (time_s - triggers[np.maximum(last, 0)] > SILENT)


def _columns(
    channel: str, signals: list[Signal | None], clock_s: Floats, sampling: Sampling
) -> Floats:
    first = signals[0] if signals else None
    if first is not None and all(s is not None and s.time_s is first.time_s for s in signals):
        values = np.stack([s.values for s in signals if s is not None], axis=-1)
        if within(channel, values):  # else each rotor goes by the reports that it has
            return sample(channel, first._replace(values=values), clock_s, sampling)
    empty = np.full(clock_s.size, np.nan)
    parts = [empty if s is None else sample(channel, s, clock_s, sampling) for s in signals]
    return np.stack(parts, axis=-1) if parts else np.empty((clock_s.size, 0))


#: Where zero may be, and the kind of the remark on it, preferred first.
_PLACES = (("home", "from home"), ("ekf_origin", "from estimator's origin"))


@dataclass(frozen=True, slots=True)
class PlaceOfZero:
    """The origin of positions, its rank (0: home), and whether a take-off has fixed it."""

    origin: Origin
    rank: int
    remark: str  # kind of the remark on it
    source: Provenance
    settled: bool  # by a take-off since


def position_sources(signals: Signals, zero: PlaceOfZero | None) -> tuple[Signal, ...]:
    """Return the sources of the position, m NED, best first: geographic about `zero`, then local.

    Local positions count from the estimator's origin. Geographic fixes are left out if `zero` is
    None; without any source the tuple is empty.
    """
    sources = []
    fixes = best(signals, "geodetic")
    if fixes is not None and zero is not None:
        places = np.where(_on_earth(fixes.values)[:, None], fixes.values, np.nan)
        places[:, 2] = plausible("altitude", places[:, 2])
        source = fixes.source.remarked(Statement(zero.remark))
        if zero.source is not fixes.source:
            source = source.remarked(Statement("by source", values=(("name", zero.source.name),)))
        sources.append(Signal("position_ned", source, fixes.time_s, zero.origin.ned(places)))
    local = best(signals, "position_ned")
    if local is not None:
        sources.append(local)
    return tuple(sources)


def place_of_zero(
    signals: Signals, clock_s: Floats, flying: Bools, before: PlaceOfZero | None = None
) -> PlaceOfZero | None:
    """Return the origin of positions: home at take-off, else the estimator's, else first fix.

    None without any. `flying` (T,) flags rows in flight, at `clock_s` (T,), s. Of several reports
    the last one up to the take-off counts, else the first. Home counts only if fixes are reported.
    An origin `before` that a take-off has fixed is replaced only by a better kind; another one by
    any report of home or the estimator.
    """
    fixes = best(signals, "geodetic")
    settled = bool(flying.any()) or (before is not None and before.settled)
    takeoff = clock_s[int(np.argmax(flying))] if flying.any() else clock_s[-1]
    for rank, (channel, remark) in enumerate(_PLACES):
        # Local positions count from the estimator's own origin, wherever home is.
        if fixes is None and channel == "home":
            continue
        if before is not None and before.settled and rank >= before.rank:
            break
        for signal in signals.get(channel, ()):
            placed = np.flatnonzero(_on_earth(signal.values))
            if placed.size:
                earlier = placed[signal.time_s[placed] <= takeoff]
                row = earlier[-1] if earlier.size else placed[0]
                place = _as_origin(signal.values[row])
                return PlaceOfZero(place, rank, remark, signal.source, settled)
    if before is not None:
        return replace(before, settled=settled)
    good = np.empty(0) if fixes is None else np.flatnonzero(_on_earth(fixes.values))
    if fixes is None or good.size == 0:
        return None
    place = _as_origin(fixes.values[good[0]])
    return PlaceOfZero(place, len(_PLACES), "from first fix", fixes.source, settled)


def _on_earth(places: Floats) -> Bools:
    """Flag `places` (n, 3), latitude and longitude, °, altitude, m, that are finite and in range.

    Latitude 0 with longitude 0 is not flagged: it means no fix.
    """
    latitude, longitude = places[:, 0], places[:, 1]
    inside = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360)
    return known_rows(places) & inside & ((latitude != 0) | (longitude != 0))


def _as_origin(values: Floats) -> Origin:
    return Origin(
        latitude_deg=float(values[0]), longitude_deg=float(values[1]), altitude=float(values[2])
    )
