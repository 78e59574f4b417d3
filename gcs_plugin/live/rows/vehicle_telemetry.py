"""From the frames of one vehicle to the rows of its flight, as they come.

The rows are those that `read_log(..., sampling="hold")` makes of a recording of the same frames:
`telemetry` makes both, here with the last seconds of every signal and the state of the rows before.
However the frames are cut into pieces, the rows are the same. They differ from the file's only
- before a message from which the file knows something from its start on: the parameters that say
  which output is which motor and how large the tank is, the autopilot's component, the first GPS
  time, before which Unix time is by the ground's clock;
- in `position_ned`, before take-off or the first home: where zero is may change until then;
- after a restart, by the clocked messages that it takes to believe it; each start is a flight;
- where frames came twice or late, which are left out here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.rows.vehicle_state import (
    OF_ITSELF,
    SAYS,
    VehicleState,
    clocks_of,
    dated_by_gps,
    fold,
    grouped,
    places_of,
)
from thrustmargin.gcs_plugin.logs.tlog import AUTOPILOTS
from thrustmargin.gcs_plugin.mavlink.decode import ESC_TELEMETRY_FIRST
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import LEFT_OUT, stated_battery
from thrustmargin.gcs_plugin.telemetry.clock import ArrivalClock, arrival_times, unix_minus_clock
from thrustmargin.gcs_plugin.telemetry.motors import (
    MotorMap,
    counted_by_reports,
    motor_map,
    turned_escs,
)
from thrustmargin.gcs_plugin.telemetry.recording import several_autopilots
from thrustmargin.gcs_plugin.telemetry.rows import KEPT, RowState, flight_rows
from thrustmargin.gcs_plugin.telemetry.signals import (
    SignalBuffer,
    Signals,
    Stream,
    best,
    hud_airspeed,
    known_rows,
    last_before,
    pitot_present,
)
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.gcs_plugin.wording.live_words import FIELD_WORDS, NEXT_SORTIE, RATES
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats, Origin
from thrustmargin.models.statement import Statement
from thrustmargin.models.vehicle_facts import VehicleFacts

CLOCK_WAIT = 20.0  # s without the vehicle's clock after which the ground's counts
#: field, by the name of its limit -> its channels in the signals, any of which will do
FIELDS: Mapping[str, tuple[str, ...]] = {
    "attitude": ("attitude",),
    "position_ned": ("geodetic", "position_ned"),
    "velocity_ned": ("velocity_ned",),
    "height_agl": ("height_agl",),
    "airspeed": ("airspeed",),
    "wind_ned": ("wind_ned",),
    "voltage": ("battery_voltage", "voltage", "esc_voltage"),
    "pressure": ("pressure",),
    "throttle": ("servo_us",),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LiveRows:
    """T new rows since one start of a vehicle, with values that only a live link has."""

    boot: int  # restarts heard before
    track: FlightTrack  # time counts from the first row of this start
    clock_s: Floats  # (T,) vehicle's clock
    stamp_us: NDArray[np.int64]  # (T,) ground's clock when the row's report came
    pump_share: Floats  # (T,) 0 off to 1 full
    pumped_kg: Floats  # (T,) by the pump since it was first heard
    mission_item: Floats  # (T,) that is flown; NaN unknown
    esc_failures: Floats  # (T, R) ESC_FAILURE_FLAGS; NaN where none are reported
    notes: tuple[Statement, ...]

    def rows(self, part: slice) -> LiveRows:
        """Return a part of the rows."""
        names = ("clock_s", "stamp_us", "pump_share", "pumped_kg", "mission_item", "esc_failures")
        arrays = {name: getattr(self, name)[part] for name in names}
        return replace(self, track=self.track.rows(part), **arrays)


@dataclass(slots=True)
class _Piece:
    """Frames in the order of arrival, during which the vehicle's own state does not change."""

    state: VehicleState
    frames: list[Frame]
    rowless: bool = True  # as yet


class VehicleTelemetry:
    """Rows of one vehicle, built from its frames; `problem` is the reason for none, else empty.

    `options` are those of reading a log, with sampling "hold"; `asked` are the options by which the
    vehicle is asked for messages.
    """

    def __init__(self, system: int, options: Options, asked: Collection[str] = ()) -> None:
        self.state = VehicleState(system=system)
        self.stamp_us = 0  # ground's clock when anything last came
        self.read_us = 0  # the same of the last message that `rows` has processed
        self.clock = ArrivalClock()
        self.problem = ""
        #: Restarts, leaps of its clock and changed parameters since the last call, and when
        #: by the ground's.
        self.events: list[tuple[int, str]] = []
        self.counts: Counter[int] = Counter()  # messages that came, by id
        self._options, self._asked = options, asked
        self._airframe = options.airframe
        self._pieces: list[_Piece] = []
        self._by_pilot: set[str] = set()  # messages that the autopilot has sent
        self._motors: MotorMap | None = None
        self._by_ground = False  # its clock has not been heard, and the ground's counts
        self._known: object = None  # what the motors were found from
        self._turned: frozenset[int] = frozenset()  # ESCs
        #: Parameters and kind, and the facts that they give.
        self._identity = ({}, -2, VehicleFacts())
        self._restart()

    def _restart(self) -> None:
        self._buffer = SignalBuffer(KEPT)
        self._row_state = RowState()
        self._heard_s = -math.inf  # vehicle's clock up to which reports are in the buffer
        self._unix_minus_clock = math.nan  # s from the vehicle's clock to Unix time
        self._gps_time = False  # by SYSTEM_TIME, and no longer by the ground's clock
        self._last_escs: dict[str, Stream] = {}
        self._tank_s = math.nan  # vehicle's clock at the last report of the tank level
        self._flew = self._rested = False  # since it was armed; was disarmed on the ground since
        # The most rotors that have turned, where nothing says how many.
        self._counted = VehicleFacts()

    @property
    def waiting(self) -> bool:
        """Return True if frames were received that `rows` has not processed."""
        return bool(self._pieces)

    @property
    def unread_us(self) -> int | None:
        """Return the ground's clock, µs, of the oldest frame that `rows` has not processed; None
        without one."""
        return self._pieces[0].frames[0].stamp_us if self._pieces else None

    @property
    def read_s(self) -> float:
        """Return the vehicle's clock, s, of the last message that `rows` has processed; -inf
        before any."""
        return self._heard_s

    @property
    def origin(self) -> Origin | None:
        """Return the geographic origin of the current positions; None before the first position."""
        zero = self._row_state.zero
        return None if zero is None else zero.origin

    @property
    def facts(self) -> VehicleFacts:
        """Return the kind and rotors of the vehicle by all that it has sent."""
        return self.state.facts if self._motors is None else self._motors.facts

    def take(self, frame: Frame) -> None:
        """Store a frame of this vehicle, in the order of arrival, and fold it into `state`.

        Frames of a second autopilot with this system id are counted, but their data are dropped; an
        event says so. Changes of the state become events.
        """
        self.stamp_us = frame.stamp_us
        self.counts[frame.id] += 1
        changed = False
        if frame.id in SAYS:
            before, self.state = self.state, fold(self.state, frame)
            self.events += [(frame.stamp_us, w) for w in self.state.changed_since(before)]
            changed = _identity(before) != _identity(self.state)
            if others := self.state.other_autopilots - before.other_autopilots:
                found = several_autopilots(self.state.system, self.state.component or 0, others)
                self.events.append((frame.stamp_us, statement_words(found)))
        if frame.component in self.state.other_autopilots:
            return
        if not self._pieces or (changed and not self._pieces[-1].rowless):
            self._pieces.append(_Piece(self.state, []))
        piece = self._pieces[-1]
        piece.state = self.state
        piece.frames.append(frame)
        piece.rowless &= frame.id in OF_ITSELF

    def pass_over(self) -> None:
        """Drop the stored frames without making rows."""
        self._pieces.clear()

    def forget(self) -> None:
        """Reset to the state of a vehicle not heard before."""
        self.state = VehicleState(system=self.state.system)
        self.pass_over()
        self._by_pilot.clear()
        self._restart()

    def rows(self) -> list[LiveRows]:
        """Return the rows of the stored frames, in order, in parts; then drop the frames.

        A new part begins where the vehicle restarted, and where it reported something new
        (parameters, its kind, its first GPS time), which is valid from the next row on. Empty, and
        the frames stay, while the vehicle's clock is unknown, for CLOCK_WAIT s at most.
        """
        frames = [frame for piece in self._pieces for frame in piece.frames]
        pilots = [piece.state.component for piece in self._pieces for _ in piece.frames]
        stamps = np.array([frame.stamp_us for frame in frames], dtype=np.int64)
        self.read_us = int(stamps[-1]) if stamps.size else self.read_us
        places = places_of(frames)
        own = clocks_of(places, frames, pilots)
        if not self.clock.known and not np.isfinite(own).any():
            if stamps.size == 0 or stamps[-1] - stamps[0] < CLOCK_WAIT * 1e6:
                return []
            own[0], self._by_ground = 0.0, True
        elif self._by_ground and np.isfinite(own).any():
            self._by_ground = False
            if own[np.isfinite(own)][0] < self.clock.last * 1e-9:
                # A simulation slower than the ground's clock, which has run ahead of it.
                self.clock = ArrivalClock(boot=self.clock.boot + 1)
        pieces, self._pieces = self._pieces, []
        groups = grouped(places, frames, pilots, self._by_pilot)
        clock_s, boots, clock, notes = arrival_times(self.clock, stamps, own)
        before, self.clock = self.clock.boot, clock
        self.events += [(at_us, statement_words(note)) for at_us, note in notes]
        parts = []
        numbers = np.repeat(np.arange(len(pieces)), [len(piece.frames) for piece in pieces])
        dated = dated_by_gps(boots, groups, before if self._gps_time else None)
        sure = boots >= 0
        for boot, number, known in dict.fromkeys(
            zip(boots[sure].tolist(), numbers[sure].tolist(), dated[sure].tolist(), strict=True)
        ):
            if boot != before:
                self._restart()
                before = boot
            if math.isnan(self._unix_minus_clock):
                clocked = np.flatnonzero((boots == boot) & np.isfinite(own))
                if clocked.size:
                    first = clocked[0]
                    self._unix_minus_clock = float(stamps[first] * 1e-6 - own[first])
            inside = (boots == boot) & (numbers == number) & (dated == known)
            if inside.all():  # as almost always
                streams = {n: Stream(clock_s[at], columns) for n, (at, columns) in groups.items()}
            else:
                streams = {
                    name: Stream(clock_s[at[chosen]], columns[chosen])
                    for name, (at, columns) in groups.items()
                    if (chosen := inside[at]).any()
                }
            made = self._part(boot, pieces[number], streams, float(clock_s[inside][-1]))
            if made is not None:
                at = np.searchsorted(clock_s[inside], made.clock_s)
                parts.append(replace(made, stamp_us=stamps[inside][at]))
        return parts

    def _part(
        self, boot: int, piece: _Piece, streams: dict[str, Stream], until_s: float
    ) -> LiveRows | None:
        """Make the rows of start number `boot` up to `until_s`, s of the vehicle's clock, and keep
        the state for the next call.

        `streams` are the messages by name, during which the vehicle's state was `piece.state`.
        `rows` sets the stamps of the result, which are 0 here. None if no row is complete yet, or
        the vehicle's motors are unknown. A load source that the user named and that is not heard is
        noted, and the load is unknown.
        """
        state, row_state = piece.state, self._row_state
        if self._rested and state.armed:
            # As in a file (sorties): a stated load is valid from each sortie's start.
            self._flew = self._rested = False
            pump = row_state.pumped
            row_state = replace(row_state, pumped=pump and replace(pump, kg=0.0))
            if self._options.load is not None or self._options.tank_start_kg is not None:
                self.events.append((piece.frames[0].stamp_us, NEXT_SORTIE))
        if not self._gps_time and "SYSTEM_TIME" in streams:
            found = unix_minus_clock(streams["SYSTEM_TIME"].columns)
            if found is not None:
                self._unix_minus_clock, self._gps_time = found, True
        for name in [n for n in streams if n in ESC_TELEMETRY_FIRST]:
            # An ESC has stopped reporting when its counter does not change from message to message.
            last, now = self._last_escs.get(name), streams[name]
            self._last_escs[name] = Stream(now.time_s[-1:], now.columns[-1:])  # type: ignore[index]
            if last is not None:
                streams[name] = Stream(
                    np.concatenate([last.time_s, now.time_s]),
                    np.concatenate([last.columns, now.columns]),  # type: ignore[list-item]
                )
        pitot = pitot_present({}, state.parameters)
        airspeed = hud_airspeed(AUTOPILOTS.get(state.autopilot, "unknown"), pitot)
        self._buffer.add(streams, airspeed, self._heard_s)
        self._heard_s, self._row_state = until_s, replace(row_state, heard_s=until_s)
        signals = self._buffer.signals
        motors = self._layout(state, signals)
        if motors is None:
            return None
        notes = list(motors.notes)
        if motors.assumed:
            how = "in vain" if RATES in self._asked else "rates ask"
            notes.append(Statement("order assumed", (how,), (("order", motors.order),)))
        rows_of = partial(
            flight_rows,
            signals,
            motors,
            state.parameters,
            row_state=row_state,
            name=f"vehicle {state.system}",
            unix_minus_clock=self._unix_minus_clock,
        )
        try:
            made = rows_of(self._options)
        except LogError as error:
            # Named by the user and not heard (yet): no other source steps in unasked.
            notes.append(Statement.of_text(str(error)))
            made = rows_of(replace(self._options, tank="none"))
        if made is None:
            self._row_state = (
                row_state  # what came belongs to the next row: rotors report one by one
            )
            return None
        self._row_state = replace(made.row_state, heard_s=until_s)
        for signal in made.reported.get("tank_kg", ()):
            self._tank_s = np.fmax(self._tank_s, signal.time_s[known_rows(signal.values)][-1])
        self._flew |= bool(made.track.flying.any())
        self._rested |= self._flew and state.disarmed and not made.track.flying[-1]
        item = best(signals, "mission_item")
        rows, asked = made.clock_s.size, self._options.tank == "none"
        return LiveRows(
            boot=boot,
            track=made.track,
            clock_s=made.clock_s,
            stamp_us=np.zeros(rows, dtype=np.int64),
            pump_share=made.pump_share,
            pumped_kg=made.pumped_kg,
            mission_item=np.full(rows, np.nan) if item is None else last_before(item, made.clock_s),
            esc_failures=motors.failures(signals, made.clock_s),
            notes=(*notes, *(n for n in made.track.notes if n != LEFT_OUT or asked)),
        )

    def _layout(self, state: VehicleState, signals: Signals) -> MotorMap | None:
        name, identity = f"vehicle {state.system}", (state.parameters, state.kind)
        if self._identity[:2] != identity:
            self._identity = (*identity, state.facts)
        facts = self._identity[2]
        if not facts.rotor_count and not facts.refusal(name):
            turned = counted_by_reports(facts, signals)
            if turned.rotor_count > self._counted.rotor_count:
                self._counted = turned
            facts = replace(
                facts,
                rotor_count=self._counted.rotor_count,
                rotor_evidence=self._counted.rotor_evidence,
            )
        facts = replace(facts, battery=stated_battery(signals))
        self._turned |= turned_escs(signals)
        known = (state.parameters, facts, len(signals.get("esc_rpm", ())), self._turned)
        if known == self._known:
            return self._motors
        self._known = known
        refusal, self._motors = facts.refusal(name), None
        self.problem = "" if refusal is None else statement_words(refusal)
        for craft in () if self.problem else (self._airframe, None):
            with suppress(AirframeError):  # another aircraft is shown without this airframe
                self._motors = motor_map(
                    name, state.parameters, signals, craft, facts=facts, turned=self._turned
                )
                self._options = replace(self._options, airframe=craft)
                break
        return self._motors

    def stale(self) -> dict[str, float]:
        """Return the fields no longer reported, in words, each with the s since its last.

        A field is listed beyond its channel's age limit; one never reported is not. Time is the
        vehicle's clock up to the last message that `rows` has processed: frames not processed may
        contain the field.
        """
        now, signals = self._heard_s, self._buffer.signals
        ages: dict[str, float] = {}
        for limit, channels in FIELDS.items():
            found = (s for name in channels for s in signals.get(name, ()))
            known = [s.time_s[rows][-1] for s in found if (rows := known_rows(s.values)).any()]
            age = now - max(known, default=math.nan)
            if age > TRACK_CHANNELS[limit].max_age and math.isfinite(age):
                ages[FIELD_WORDS[limit]] = age
        if now - self._tank_s > TRACK_CHANNELS["tank_kg"].max_age:
            ages[FIELD_WORDS["tank_kg"]] = now - self._tank_s
        return ages


def _identity(state: VehicleState) -> tuple[object, ...]:
    """Return the parts of a vehicle's state on which its rows depend, to compare two states."""
    return id(state.parameters), state.kind, state.autopilot, state.component, state.armed
